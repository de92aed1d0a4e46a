//! A policy: the actors of all agents, and the predictors that keep their joint estimate alive.

use super::file::{self, PolicyFile, Precision};
use super::inference::Inference;
use super::kernels;
use super::meta::Meta;
use super::network::{Network, TensorSpec};
use super::networks::{Networks, Sharing};
use super::predictor::Predictor;
use super::weights::{Storage, Tensor};
use super::{Dims, PredictorSpec};
use crate::base::error::Result;
use crate::dynamics::Dynamics;
use crate::{failed, usage};
use serde_json::json;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// The networks of a task's agents, ready to run. Clones share the weights.
#[derive(Clone, Debug)]
pub struct Policy {
    meta: Meta,
    networks: Networks,
    dynamics: Option<Dynamics>,
    dims: Dims,
    tensors: Vec<(TensorSpec, Tensor)>,
    actors: Vec<Inference>,
    predictors: Vec<Predictor>,
}

impl Policy {
    /// The policy in the file at `path`. Its weights are mapped, not copied: they are in memory once for all
    /// processes that open the file.
    ///
    /// # Errors
    /// `Usage` if there is no such file, or it is not a policy, or one for another task; `Failed` if it is
    /// damaged: a tensor missing, unexpected, of another shape or type than its description asks for, or
    /// with a value that is not finite.
    pub fn open(path: &Path, dims: &Dims) -> Result<Policy> {
        Policy::open_copy(path, dims)?.checked(&path.display().to_string())
    }

    /// The policy in a file that this program has just [saved](Policy::save) from a policy it had checked: as
    /// [`Policy::open`], but the values are not looked at, so that only those of networks that run are read.
    ///
    /// # Errors
    /// As [`Policy::open`], except that values that are not finite go unnoticed.
    pub(crate) fn open_copy(path: &Path, dims: &Dims) -> Result<Policy> {
        let map = file::map(path)?;
        let source = path.display().to_string();
        let file = PolicyFile::parse(&map, &source)?;
        let Some(precision) = file.precision() else {
            return Policy::converted(file, &map, dims, &source);
        };
        let storage = Storage::mapped(map, file.data, precision);
        Policy::from_file(file, storage, dims, &source)
    }

    /// The policy in a file that is part of the program. The bytes are used where they are if they are
    /// [`Aligned`](super::Aligned), and else copied.
    ///
    /// # Errors
    /// As [`Policy::open`].
    pub(crate) fn from_static(bytes: &'static [u8], dims: &Dims) -> Result<Policy> {
        let source = "the embedded policy";
        let file = PolicyFile::parse(bytes, source)?;
        let Some(precision) = file.precision() else {
            return Policy::converted(file, bytes, dims, source)?.checked(source);
        };
        let storage = Storage::from_static(&bytes[file.data..], precision);
        Policy::from_file(file, storage, dims, source)?.checked(source)
    }

    /// A policy that has learned nothing: PyTorch's default initialisation, [drawn](TensorSpec::untrained)
    /// tensor by tensor.
    ///
    /// # Errors
    /// `Usage` if there cannot be such networks.
    pub fn untrained(dims: &Dims, seed: u64, networks: Networks) -> Result<Policy> {
        networks.check().map_err(|error| usage!("{error}"))?;
        let tensors = networks.tensors(dims);
        let values: Vec<f32> = tensors.iter().flat_map(|tensor| tensor.untrained(seed)).collect();
        Policy::new(dims, Meta::new(&dims.task, seed), networks, &values)
    }

    /// A policy with these values: those of [`Networks::tensors`], one tensor after the other, which it
    /// copies.
    ///
    /// # Errors
    /// `Usage` if there cannot be such networks; `Failed` if there are too many values or too few, or one is
    /// not finite.
    pub fn new(dims: &Dims, meta: Meta, networks: Networks, values: &[f32]) -> Result<Policy> {
        networks.check().and_then(|()| networks.check_fit(dims)).map_err(|error| usage!("{error}"))?;
        let specs = networks.tensors(dims);
        let expected: usize = specs.iter().map(TensorSpec::n_values).sum();
        if values.len() != expected {
            return Err(failed!(
                "a policy for {} got {} weights, expected {expected}",
                dims.task,
                values.len()
            ));
        }
        let mut rest = values;
        let parts = specs.iter().map(|spec| {
            let (values, behind) = rest.split_at(spec.n_values());
            rest = behind;
            values
        });
        let (storage, ranges) = Storage::copy(parts);
        let storage = Arc::new(storage);
        let tensors = ranges.into_iter().map(|range| Tensor::new(storage.clone(), range, Precision::Full));
        let tensors = specs.into_iter().zip(tensors).collect();
        Policy::assemble(dims, meta, networks, tensors).checked("the new policy")
    }

    /// This policy with other values, in the order of [`Policy::copy_values`].
    ///
    /// # Errors
    /// `Failed` if there are too many values or too few, or one is not finite.
    pub fn with_values(&self, values: &[f32]) -> Result<Policy> {
        self.with(self.networks.clone(), values)
    }

    /// This policy with one more predictor, or another in place of the one of that name, with these values: those of its
    /// tensors, one after the other.
    ///
    /// # Errors
    /// `Usage` if there cannot be such a predictor; `Failed` if there are too many values or too few, or one is not
    /// finite.
    pub(crate) fn with_predictor(&self, spec: &PredictorSpec, values: &[f32]) -> Result<Policy> {
        let mut all = vec![0.0; self.n_values()];
        self.copy_values(&mut all);
        let mut networks = self.networks.clone();
        match networks.predictors.iter().position(|predictor| predictor.name == spec.name) {
            Some(at) => {
                let range = self.predictor_range(&spec.name).expect("it has this predictor");
                all.splice(range, values.iter().copied());
                networks.predictors[at] = spec.clone();
            }
            None => {
                all.extend_from_slice(values);
                networks.predictors.push(spec.clone());
            }
        }
        self.with(networks, &all)
    }

    /// This policy with other networks.
    fn with(&self, networks: Networks, values: &[f32]) -> Result<Policy> {
        let policy = Policy::new(&self.dims, self.meta.clone(), networks, values)?;
        Ok(Policy { dynamics: self.dynamics.clone(), ..policy })
    }

    /// This policy, of which that is said.
    #[cfg(feature = "python")]
    pub(crate) fn with_meta(self, meta: Meta) -> Policy {
        Policy { meta, ..self }
    }

    /// This policy with the dynamics of the environment that it is for.
    pub(crate) fn with_dynamics(self, dynamics: Dynamics) -> Policy {
        Policy { dynamics: Some(dynamics), ..self }
    }

    /// Writes the policy to `path`, where there is always the old file or the new one.
    ///
    /// # Errors
    /// `Failed` if it cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        self.write(path, Precision::Full)
    }

    /// As [`save`](Policy::save), with f16 values: half the size, for keeping.
    ///
    /// # Errors
    /// `Failed` if it cannot be written, or a value is too large for that.
    pub fn save_half(&self, path: &Path) -> Result<()> {
        const LARGEST: f32 = 65504.0;
        for (spec, tensor) in self.tensors() {
            if let Some(value) = tensor.values().iter().find(|value| value.abs() > LARGEST) {
                return Err(failed!("tensor {} holds {value}, which is too large for f16", spec.name));
            }
        }
        self.write(path, Precision::Half)
    }

    fn write(&self, path: &Path, precision: Precision) -> Result<()> {
        let tensors = self.tensors().map(|(spec, tensor)| (&spec.name[..], &spec.shape[..], tensor.values()));
        file::write(path, (&self.meta, &self.networks, self.dynamics.as_ref()), precision, tensors)
    }

    /// As [`save`](Policy::save), for processes that run it on this machine: as f16 if it is, and networks run on that.
    ///
    /// # Errors
    /// `Failed` if it cannot be written.
    pub(crate) fn save_copy(&self, path: &Path) -> Result<()> {
        let is_half = self.tensors.iter().all(|(_, tensor)| tensor.halves().is_some());
        let precision = if is_half && kernels::take_halves() { Precision::Half } else { Precision::Full };
        self.write(path, precision)
    }

    /// Whether its weights are in memory once for all processes that run it: mapped, or part of the program, and not to be
    /// converted.
    pub(crate) fn is_shared(&self) -> bool {
        let in_place = |tensor: &Tensor| kernels::take_halves() || tensor.halves().is_none();
        self.tensors.iter().all(|(_, tensor)| tensor.storage.is_shared() && in_place(tensor))
    }

    /// The actor of this agent, which must be one of the task's.
    pub fn actor(&self, agent: usize) -> &Inference {
        &self.actors[agent]
    }

    /// The predictor of this name.
    pub fn predictor(&self, name: &str) -> Option<&Predictor> {
        self.predictors.iter().find(|predictor| predictor.spec.name == name)
    }

    /// The names of the predictors.
    pub fn predictor_names(&self) -> impl Iterator<Item = &str> {
        self.predictors.iter().map(|predictor| &predictor.spec.name[..])
    }

    /// Where this policy comes from.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// The dynamics of its environment, if they have been fitted.
    pub fn dynamics(&self) -> Option<&Dynamics> {
        self.dynamics.as_ref()
    }

    /// What networks it is made of.
    pub fn networks(&self) -> &Networks {
        &self.networks
    }

    /// The sizes of its task.
    pub fn dims(&self) -> &Dims {
        &self.dims
    }

    /// Its tensors, in the order of [`Networks::tensors`].
    pub fn tensors(&self) -> impl Iterator<Item = (&TensorSpec, &Tensor)> {
        self.tensors.iter().map(|(spec, tensor)| (spec, tensor))
    }

    /// Tells policies apart: FNV-1a over task, algorithm, networks, dynamics and weights.
    pub(crate) fn fingerprint(&self) -> String {
        let mut values = vec![0.0; self.n_values()];
        self.copy_values(&mut values);
        let meta = self.meta();
        // As they are in policy files, which stay readable: what counts is not how this version spells it in memory.
        let Networks { actor, sharing, hidden, predictors } = self.networks();
        let networks = json!([actor, sharing, hidden, predictors, self.dynamics()]);
        let words = format!("{} {} {networks}", meta.task, meta.algorithm);
        let bytes = words.as_bytes().iter().chain(bytemuck::cast_slice(&values));
        let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        format!("{hash:016x}")
    }

    /// The number of weights and biases.
    pub fn n_values(&self) -> usize {
        self.tensors.iter().map(|(spec, _)| spec.n_values()).sum()
    }

    /// Copies all weights and biases, one tensor after the other, to `out`, which must be
    /// [`n_values`](Policy::n_values) long.
    pub fn copy_values(&self, mut out: &mut [f32]) {
        assert_eq!(out.len(), self.n_values(), "copy_values: wrong length");
        for (_, tensor) in &self.tensors {
            let (front, rest) = out.split_at_mut(tensor.values().len());
            front.copy_from_slice(tensor.values());
            out = rest;
        }
    }

    /// Where the actor of this agent is in the values of [`copy_values`](Policy::copy_values).
    pub(crate) fn actor_range(&self, agent: usize) -> Range<usize> {
        self.range_of(&self.networks.actor(agent, &self.dims))
    }

    /// Where the predictor of this name is in the values of [`copy_values`](Policy::copy_values).
    pub(crate) fn predictor_range(&self, name: &str) -> Option<Range<usize>> {
        self.predictor(name).map(|predictor| self.range_of(&predictor.spec.network(&self.dims)))
    }

    /// Where the tensors of a network are, which are all beside each other.
    fn range_of(&self, network: &Network) -> Range<usize> {
        let specs = || self.tensors.iter().map(|(spec, _)| spec);
        let start = specs().take_while(|spec| !network.owns(&spec.name)).map(TensorSpec::n_values).sum();
        let length: usize = specs().filter(|spec| network.owns(&spec.name)).map(TensorSpec::n_values).sum();
        start..start + length
    }

    /// The policy in the `bytes` of a file of both f32 and f16, in memory of its own.
    fn converted(mut file: PolicyFile, bytes: &[u8], dims: &Dims, source: &str) -> Result<Policy> {
        let values = file.tensors.iter().map(|tensor| tensor.values(&bytes[file.data..]));
        let values: Vec<Vec<f32>> = values.collect();
        let (storage, ranges) = Storage::copy(values.iter().map(|values| &values[..]));
        for (tensor, range) in file.tensors.iter_mut().zip(ranges) {
            (tensor.precision, tensor.start) = (Precision::Full, range.start * size_of::<f32>());
        }
        Policy::from_file(file, storage, dims, source)
    }

    /// Checks what `file` promises against what `dims` needs and `storage` holds, but for the values themselves.
    fn from_file(file: PolicyFile, storage: Storage, dims: &Dims, source: &str) -> Result<Policy> {
        let PolicyFile { meta, networks, dynamics, tensors: found, .. } = file;
        if meta.task != dims.task {
            return Err(usage!("{source} is a policy for task {}, not for {}", meta.task, dims.task));
        }
        networks.check_fit(dims).map_err(|error| failed!("{source}: {error}"))?;
        let specs = networks.tensors(dims);
        let expected: HashSet<&str> = specs.iter().map(|spec| &spec.name[..]).collect();
        if let Some(extra) = found.iter().find(|tensor| !expected.contains(&tensor.name[..])) {
            return Err(failed!("{source}: unexpected tensor {}", extra.name));
        }
        let found: HashMap<&str, _> = found.iter().map(|tensor| (&tensor.name[..], tensor)).collect();
        let storage = Arc::new(storage);
        let mut tensors = Vec::with_capacity(specs.len());
        for spec in specs {
            let Some(tensor) = found.get(&spec.name[..]) else {
                return Err(failed!("{source}: tensor {} {:?} is missing", spec.name, spec.shape));
            };
            if tensor.shape != spec.shape {
                let (found, expected) = (&tensor.shape, &spec.shape);
                return Err(failed!("{source}: tensor {} is {found:?}, expected {expected:?}", spec.name));
            }
            let start = tensor.start / tensor.precision.bytes();
            let range = start..start + spec.n_values();
            tensors.push((spec, Tensor::new(storage.clone(), range, tensor.precision)));
        }
        Ok(Policy { dynamics, ..Policy::assemble(dims, meta, networks, tensors) })
    }

    /// This policy, unless one of its values is not finite.
    fn checked(self, source: &str) -> Result<Policy> {
        for (spec, tensor) in self.tensors() {
            if let Some((at, value)) = tensor.find_not_finite() {
                return Err(failed!(
                    "{source}: tensor {} holds {value} at {at}, expected a number",
                    spec.name
                ));
            }
        }
        Ok(self)
    }

    /// The networks of these tensors, which are those of [`Networks::tensors`].
    fn assemble(dims: &Dims, meta: Meta, networks: Networks, tensors: Vec<(TensorSpec, Tensor)>) -> Policy {
        let inference = |network: Network, id| {
            let own = tensors.iter().filter(|(spec, _)| network.owns(&spec.name));
            Inference::new(&network, id, own.map(|(_, tensor)| tensor))
        };
        let actor = |agent| {
            let id = (networks.sharing == Sharing::Shared).then_some(agent);
            inference(networks.actor(agent, dims), id)
        };
        let predictor = |spec: &PredictorSpec| Predictor {
            spec: spec.clone(),
            network: inference(spec.network(dims), None),
            dims: dims.clone(),
        };
        let actors = (0..dims.n_agents).map(actor).collect();
        let predictors = networks.predictors.iter().map(predictor).collect();
        Policy { meta, networks, dynamics: None, dims: dims.clone(), tensors, actors, predictors }
    }
}
