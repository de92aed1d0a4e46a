//! Keeping a fit, to go on with it.

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::SafeTensors;
use serde_json::json;

use super::Parameters;
use super::fit::{PredictorFit, rollout};
use crate::base::error::Result;
use crate::nn::{Precision, TensorSpec, map, write_tensors};
use crate::{failed, usage};

impl PredictorFit {
    /// Writes what it needs to go on to `path`.
    ///
    /// # Errors
    /// `Failed` if it cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut metadata = self.identity();
        metadata.insert("updates", self.updates.to_string());
        metadata.insert("adam", self.predictor.parameters.steps.to_string());
        let Parameters { specs, values, mean, square, .. } = &self.predictor.parameters;
        let parts = [("", values), ("adam.mean.", mean), ("adam.square.", square)];
        let tensors = parts.iter().flat_map(|(beginning, values)| {
            let named = move |(at, spec): (usize, &'_ TensorSpec)| (format!("{beginning}{}", spec.name), at);
            specs
                .iter()
                .enumerate()
                .map(named)
                .map(move |(name, at)| (name, &specs[at].shape[..], values.tensor(at)))
        });
        let tensors: Vec<_> = tensors.collect();
        let tensors: Vec<_> =
            tensors.iter().map(|(name, shape, values)| (&name[..], *shape, *values)).collect();
        write_tensors(path, &metadata, Precision::Full, &tensors)
    }

    /// This fit, before its first update, as it was when it was [saved](PredictorFit::save) to `path`; what follows is the
    /// same to the bit.
    ///
    /// # Errors
    /// `Usage` if there is no such file, or another fit was saved there; `Failed` if it is damaged.
    pub fn resume(mut self, path: &Path) -> Result<PredictorFit> {
        let (map, source) = (map(path)?, path.display());
        let damaged = |what: &str| failed!("{source} is damaged, or not an unfinished fit: {what}");
        let (_, content) = SafeTensors::read_metadata(&map).map_err(|error| damaged(&error.to_string()))?;
        let words = content.metadata().clone().unwrap_or_default();
        for (key, expected) in self.identity() {
            let found = words.get(key).map_or("nothing", String::as_str);
            if found != expected {
                return Err(usage!(
                    "{source} is from another fit: its `{key}` is {found}, not {expected}; continue with the same options, \
                     or remove the file"
                ));
            }
        }
        let number = |key: &str| {
            let number = words.get(key).and_then(|number| number.parse().ok());
            number.ok_or_else(|| damaged(&format!("it has no number of `{key}`")))
        };
        (self.updates, self.predictor.parameters.steps) = (number("updates")?, number("adam")?);
        let tensors = SafeTensors::deserialize(&map).map_err(|error| damaged(&error.to_string()))?;
        let specs = self.predictor.parameters.specs.clone();
        let beginnings = ["", "adam.mean.", "adam.square."];
        for (beginning, to) in beginnings.into_iter().zip(self.predictor.parameters.state_mut()) {
            for (at, spec) in specs.iter().enumerate() {
                let name = format!("{beginning}{}", spec.name);
                let tensor = tensors.tensor(&name).map_err(|_| damaged(&format!("{name} is missing")))?;
                let values: &[f32] = bytemuck::try_cast_slice(tensor.data()).map_err(|_| damaged(&name))?;
                if values.len() != spec.n_values() {
                    return Err(damaged(&format!("{name} has {} values", values.len())));
                }
                to.tensor_mut(at).copy_from_slice(values);
            }
        }
        self.rollout = rollout(&self.task, &self.settings, self.updates * self.settings.episodes as u64);
        Ok(self)
    }

    /// What tells it from other fits.
    fn identity(&self) -> BTreeMap<&'static str, String> {
        BTreeMap::from([
            ("format", "vamaro-swarm fit".to_owned()),
            ("version", "1".to_owned()),
            ("policy", self.policy.fingerprint()),
            ("physics", self.task.physics().to_string()),
            ("predictor", json!(self.spec).to_string()),
            ("settings", json!(self.settings).to_string()),
        ])
    }
}
