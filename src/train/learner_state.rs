//! What makes a team in training what it is, by name: for checkpoints, and to go on from them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::learner::Learner;
use super::memory::Flat;
use super::parameters::Parameters;
use crate::nn::TensorSpec;
use crate::nn::kernels::all_finite;

/// What a team has counted.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counters {
    /// Updates so far.
    pub updates: u64,
    /// Steps of Adam so far, by network, such as `actors.0`.
    pub adam: BTreeMap<String, u64>,
}

/// Tensors of one layout: what their names begin with, how they go on, and the values.
type Part<'a> = (&'static str, &'a [TensorSpec], &'a Flat);

impl Learner {
    /// Every tensor that makes the team what it is, with its name and shape: weights as a policy calls them
    /// (`actors.0.fc1.weight`, ..), Adam's moments (`adam.mean.actors.0.fc1.weight`, `adam.square.`..), target
    /// critics (`target.critics.0.fc1.weight`, ..) and the gradients that predictors carry on
    /// (`carried.predictors.maro.fc1.weight`, ..). With the counters that is all.
    pub fn state(&self) -> Vec<(String, Vec<usize>, &[f32])> {
        let tensors = self.parts().into_iter().flat_map(|(beginning, specs, values)| {
            specs.iter().enumerate().map(move |(at, spec)| {
                (format!("{beginning}{}", spec.name), spec.shape.clone(), values.tensor(at))
            })
        });
        tensors.collect()
    }

    /// Updates so far.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// What the team has counted.
    pub(crate) fn counters(&self) -> Counters {
        let adam = self.networks().map(|network| (network.name.clone(), network.steps));
        Counters { updates: self.updates, adam: adam.collect() }
    }

    /// Makes this team one with such a [`state`](Self::state) and [`counters`](Self::counters), given the values
    /// of a tensor by its name. The next update is that of the team they are of, to the bit.
    ///
    /// Fails, and changes nothing, if a tensor is missing or not of the length it has here, or if the counters
    /// are not those of these networks; says which.
    pub(crate) fn restore<T: AsRef<[f32]>>(
        &mut self,
        tensor: impl Fn(&str) -> Option<T>,
        counters: &Counters,
    ) -> Result<(), String> {
        let own = self.counters().adam;
        if let Some(name) = own.keys().find(|name| !counters.adam.contains_key(*name)) {
            return Err(format!("there is no number of Adam steps for {name}"));
        }
        if let Some(name) = counters.adam.keys().find(|name| !own.contains_key(*name)) {
            return Err(format!("Adam steps are counted for {name}, which is no network of this team"));
        }
        let mut found = Vec::new();
        for (name, shape, values) in self.state() {
            let tensor = tensor(&name).ok_or_else(|| format!("there is no tensor {name}"))?;
            let (len, expected) = (tensor.as_ref().len(), values.len());
            if len != expected {
                return Err(format!("tensor {name} has {len} values, expected {expected} for {shape:?}"));
            }
            found.push(tensor);
        }

        let mut found = found.iter();
        for values in self.parts_mut() {
            for (to, from) in values.each_mut().zip(&mut found) {
                to.copy_from_slice(from.as_ref());
            }
        }
        self.updates = counters.updates;
        self.networks_mut().for_each(|network| network.steps = counters.adam[&network.name]);
        Ok(())
    }

    /// Writes the weights of the policy to `out`: those of the actors, then of the predictors, tensor by tensor as
    /// [`Networks::tensors`](crate::nn::Networks::tensors) lists them.
    pub fn policy_values(&self, out: &mut Vec<f32>) {
        let actors = self.actors.iter().map(|actor| &actor.parameters);
        let predictors = self.predictors.iter().map(|predictor| &predictor.parameters);
        out.clear();
        for (_, values) in actors.chain(predictors).flat_map(Parameters::tensors) {
            out.extend_from_slice(values);
        }
    }

    /// Whether every weight is a finite number.
    pub fn is_finite(&self) -> bool {
        self.networks().all(|network| all_finite(network.values.all()))
    }

    /// The networks that learn: actors, critics, predictors.
    pub(super) fn networks(&self) -> impl Iterator<Item = &Parameters> {
        let actors = self.actors.iter().map(|actor| &actor.parameters);
        let critics = self.critics.iter().map(|critic| &critic.parameters);
        let predictors = self.predictors.iter().map(|predictor| &predictor.parameters);
        actors.chain(critics).chain(predictors)
    }

    fn networks_mut(&mut self) -> impl Iterator<Item = &mut Parameters> {
        let actors = self.actors.iter_mut().map(|actor| &mut actor.parameters);
        let critics = self.critics.iter_mut().map(|critic| &mut critic.parameters);
        let predictors = self.predictors.iter_mut().map(|predictor| &mut predictor.parameters);
        actors.chain(critics).chain(predictors)
    }

    /// What [`state`](Self::state) consists of.
    fn parts(&self) -> Vec<Part<'_>> {
        let mut parts: Vec<Part> = Vec::new();
        for network in self.networks() {
            let beginnings = ["", "adam.mean.", "adam.square."].into_iter();
            let values = [&network.values, &network.mean, &network.square];
            parts.extend(beginnings.zip(values).map(|(name, values)| (name, &network.specs[..], values)));
        }
        for critic in &self.critics {
            parts.push(("target.", &critic.parameters.specs, &critic.target));
        }
        for predictor in &self.predictors {
            parts.extend(
                predictor
                    .carried
                    .iter()
                    .map(|carried| ("carried.", &predictor.parameters.specs[..], carried)),
            );
        }
        parts
    }

    /// The values of [`parts`](Self::parts), in the same order.
    fn parts_mut(&mut self) -> Vec<&mut Flat> {
        let (mut parts, mut targets, mut carried) = (Vec::new(), Vec::new(), Vec::new());
        for actor in &mut self.actors {
            parts.extend(actor.parameters.state_mut());
        }
        for critic in &mut self.critics {
            parts.extend(critic.parameters.state_mut());
            targets.push(&mut critic.target);
        }
        for predictor in &mut self.predictors {
            parts.extend(predictor.parameters.state_mut());
            carried.extend(&mut predictor.carried);
        }
        parts.into_iter().chain(targets).chain(carried).collect()
    }
}
