//! A policy: the actors of all agents, and the predictors that keep their joint estimate alive.

use super::actor::Actor;
use super::file::{self, About, PolicyFile, Precision};
use super::inference::{Inference, run_on_halves};
use super::meta::Meta;
use super::network::{Network, TensorSpec};
use super::networks::{ActorKind, Networks, Sharing};
use super::onnx::{Choice, Description, Graphs};
use super::predictor::Predictor;
use super::senses::Senses;
use super::weights::{Storage, Tensor};
use super::{Dims, PredictorSpec};
use crate::base::error::Result;
use crate::base::hash::fnv1a;
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
    given: Option<Dynamics>,
    dims: Dims,
    tensors: Vec<(TensorSpec, Tensor)>,
    /// The ONNX files that are its actors, if they are.
    graphs: Option<Graphs>,
    actors: Vec<Actor>,
    predictors: Vec<Predictor>,
}

impl Policy {
    /// The policy in the file at `path`. Its weights are mapped, not copied: they are in memory once for all
    /// processes that open the file. It may also be a text that describes ONNX files beside it.
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
        if let Some(description) = Description::read(path)? {
            return Policy::of_description(description, dims, &path.display().to_string());
        }
        let map = file::map(path)?;
        let source = path.display().to_string();
        let file = PolicyFile::parse(&map, &source)?;
        let Some(precision) = file.precision() else {
            return Policy::converted(file, &map, dims, &source);
        };
        let storage = Storage::mapped(map, file.data, precision);
        Policy::from_file(file, storage, None, dims, &source)
    }

    /// The policy that a description names the ONNX files of.
    ///
    /// # Errors
    /// `Usage` if it is for another task, a file is not there, or it cannot act for an agent.
    pub(crate) fn of_description(description: Description, dims: &Dims, source: &str) -> Result<Policy> {
        check_task(&description.task, dims, source)?;
        let (meta, networks) = (description.meta(), description.networks());
        let graphs = Graphs::load(description.graphs(dims)?, description.actor, source)?;
        Policy::assemble(dims, meta, networks, Vec::new(), Some(graphs), source)
    }

    /// The policy in a file that is part of the program. The bytes are used where they are if they are
    /// [`Aligned`](super::Aligned), and else copied. The values are not looked at, so that only those of networks that run
    /// are read.
    ///
    /// # Errors
    /// As [`Policy::open`], except that values that are not finite go unnoticed.
    pub(crate) fn from_static(bytes: &'static [u8], dims: &Dims) -> Result<Policy> {
        let source = "the embedded policy";
        let file = PolicyFile::parse(bytes, source)?;
        let Some(precision) = file.precision() else {
            return Policy::converted(file, bytes, dims, source);
        };
        let storage = Storage::from_static(&bytes[file.data..], precision);
        Policy::from_file(file, storage, None, dims, source)
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
        if networks.actor == ActorKind::Onnx {
            return Err(usage!("a policy for {} of ONNX files cannot be made without these", dims.task));
        }
        Policy::with_graphs(dims, meta, networks, values, None)
    }

    fn with_graphs(
        dims: &Dims,
        meta: Meta,
        networks: Networks,
        values: &[f32],
        graphs: Option<Graphs>,
    ) -> Result<Policy> {
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
        let source = "the new policy";
        Policy::assemble(dims, meta, networks, tensors, graphs, source)?.checked(source)
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
        let policy =
            Policy::with_graphs(&self.dims, self.meta.clone(), networks, values, self.graphs.clone())?;
        Ok(Policy { dynamics: self.dynamics.clone(), given: self.given.clone(), ..policy })
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

    /// This policy with the dynamics of the physics that is played, for imputers that are told them.
    pub(crate) fn with_given(self, given: Dynamics) -> Policy {
        Policy { given: Some(given), ..self }
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
        let mut values = vec![0.0; self.n_values()];
        self.copy_values(&mut values);
        let mut rest = &values[..];
        let tensors = self.tensors().map(|(spec, tensor)| {
            let values = rest.split_off(..tensor.len()).expect("there are values for every tensor");
            (&spec.name[..], &spec.shape[..], values)
        });
        let about = About {
            meta: &self.meta,
            networks: &self.networks,
            dynamics: self.dynamics.as_ref(),
            given: self.given.as_ref(),
            onnx: self.graphs.as_ref().map(|graphs| &graphs.spec),
        };
        let names = self.networks.graph_names(&self.dims).into_iter();
        let graphs: Vec<_> = names.zip(self.graphs.iter().flat_map(Graphs::files)).collect();
        file::write(path, &about, precision, tensors, &graphs)
    }

    /// As [`save`](Policy::save), for processes of this machine that run steps of so many rows: as f16 if it is, and they
    /// run on that.
    ///
    /// # Errors
    /// `Failed` if it cannot be written.
    pub(crate) fn save_copy(&self, path: &Path, rows: usize) -> Result<()> {
        let is_half = self.tensors.iter().all(|(_, tensor)| tensor.halves().is_some());
        let precision = if is_half && run_on_halves(rows) { Precision::Half } else { Precision::Full };
        self.write(path, precision)
    }

    /// Whether its weights are in memory once for all processes that run steps of so many rows: mapped, or part of the
    /// program, and not to be converted. What imputers are told of the physics is in this process only.
    pub(crate) fn is_shared(&self, rows: usize) -> bool {
        if self.given.is_some() {
            return false;
        }
        let in_place = |tensor: &Tensor| run_on_halves(rows) || tensor.halves().is_none();
        self.tensors.iter().all(|(_, tensor)| tensor.storage.is_shared() && in_place(tensor))
    }

    /// The actor of this agent, which must be one of the task's.
    pub fn actor(&self, agent: usize) -> &Actor {
        &self.actors[agent]
    }

    /// Whether its agents always take the most probable action, as the description of an ONNX file may say.
    pub fn is_greedy(&self) -> bool {
        self.graphs.as_ref().is_some_and(|graphs| graphs.spec.actions == Choice::Greedy)
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

    /// The dynamics of the physics that is played, if imputers are told them.
    pub(crate) fn given(&self) -> Option<&Dynamics> {
        self.given.as_ref()
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
        let Networks { actor, sharing, hidden, predictors, actor_inputs } = self.networks();
        let networks = json!([actor, sharing, hidden, predictors, self.dynamics()]);
        let inputs = self.networks.actors_have_senses().then(|| json!(actor_inputs).to_string());
        let onnx = self.graphs.as_ref().map(|graphs| json!(graphs.spec).to_string()).unwrap_or_default();
        let words =
            format!("{} {} {networks}{}{onnx}", meta.task, meta.algorithm, inputs.unwrap_or_default());
        let graphs = self.graphs.iter().flat_map(Graphs::files).flatten();
        let bytes = words.as_bytes().iter().chain(bytemuck::cast_slice(&values)).chain(graphs);
        format!("{:016x}", fnv1a(bytes.copied()))
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
            let (front, rest) = out.split_at_mut(tensor.len());
            tensor.copy_to(front);
            out = rest;
        }
    }

    /// Where the actor of this agent is in the values of [`copy_values`](Policy::copy_values).
    /// An ONNX file has no values there.
    pub(crate) fn actor_range(&self, agent: usize) -> Range<usize> {
        if self.graphs.is_some() {
            return 0..0;
        }
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

    /// The policy in the `bytes` of a file that is not all f32 or all f16, in memory of its own.
    fn converted(mut file: PolicyFile, bytes: &[u8], dims: &Dims, source: &str) -> Result<Policy> {
        let graphs = Policy::graphs_in(&file, bytes, dims, source)?;
        let values = file.tensors.iter().map(|tensor| tensor.values(&bytes[file.data..]));
        let values: Vec<Vec<f32>> = values.collect();
        let (storage, ranges) = Storage::copy(values.iter().map(|values| &values[..]));
        for (tensor, range) in file.tensors.iter_mut().zip(ranges) {
            (tensor.precision, tensor.start) = (Precision::Full, range.start * size_of::<f32>());
        }
        Policy::from_file(file, storage, graphs, dims, source)
    }

    /// The ONNX files of `file`, among all its `bytes`.
    fn graphs_in(file: &PolicyFile, bytes: &[u8], dims: &Dims, source: &str) -> Result<Option<Graphs>> {
        let Some(spec) = &file.onnx else { return Ok(None) };
        let graphs = file.graphs(bytes, &file.networks.graph_names(dims), source)?;
        Graphs::load(graphs, spec.clone(), source).map(Some)
    }

    /// Checks what `file` promises against what `dims` needs and `storage` holds, but for the values themselves.
    fn from_file(
        file: PolicyFile,
        storage: Storage,
        graphs: Option<Graphs>,
        dims: &Dims,
        source: &str,
    ) -> Result<Policy> {
        let PolicyFile { meta, networks, dynamics, given, tensors: found, .. } = file;
        check_task(&meta.task, dims, source)?;
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
        Ok(Policy { dynamics, given, ..Policy::assemble(dims, meta, networks, tensors, graphs, source)? })
    }

    /// This policy, unless one of its values is not finite.
    pub(crate) fn checked(self, source: &str) -> Result<Policy> {
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

    /// The networks of these tensors, which are those of [`Networks::tensors`], and of ONNX files if there are any.
    fn assemble(
        dims: &Dims,
        meta: Meta,
        networks: Networks,
        tensors: Vec<(TensorSpec, Tensor)>,
        graphs: Option<Graphs>,
        source: &str,
    ) -> Result<Policy> {
        let inference = |network: Network, id| {
            let own = tensors.iter().filter(|(spec, _)| network.owns(&spec.name));
            Inference::new(&network, id, own.map(|(_, tensor)| tensor))
        };
        let actor = |agent| match &graphs {
            Some(graphs) => graphs.actor(agent, dims, source).map(Actor::from),
            None => {
                let id = (networks.sharing == Sharing::Shared).then_some(agent);
                let senses = Senses::of(&networks.actor_inputs, agent, dims);
                Ok(Actor::of_network(inference(networks.actor(agent, dims), id), senses))
            }
        };
        let predictor = |spec: &PredictorSpec| Predictor {
            spec: spec.clone(),
            network: inference(spec.network(dims), None),
            proximity: spec.proximity(dims),
            dims: dims.clone(),
        };
        let actors = (0..dims.n_agents).map(actor).collect::<Result<_>>()?;
        let predictors = networks.predictors.iter().map(predictor).collect();
        let dims = dims.clone();
        Ok(Policy { meta, networks, dynamics: None, given: None, dims, tensors, graphs, actors, predictors })
    }
}

/// An error if a policy is for another task.
fn check_task(task: &str, dims: &Dims, source: &str) -> Result<()> {
    if task == dims.task {
        return Ok(());
    }
    Err(usage!("{source} is a policy for task {task}, not for {}", dims.task))
}
