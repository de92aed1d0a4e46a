//! The checkpoint: everything a run needs in order to go on as if it had never stopped.
//!
//! A safetensors file with the tensors of [`Learner::state`], what is remembered for replay (`replay.*`) and, where
//! updates share episodes, the batch (`batch.*`); its metadata hold the configuration and the counters.
//! Actions are remembered where predictors see them (`replay.actions`), ages where actors do (`batch.ages`).
//! Checkpoints from before episodes could end early have no `replay.lengths`, `batch.lengths` and
//! `batch.terminated`: all their episodes are whole.

use std::collections::BTreeMap;
use std::path::Path;

use memmap2::Mmap;
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};

use super::batch::Batch;
use super::config::{Config, Preset};
use super::layer::Layer;
use super::learner::Learner;
use super::learner_state::Counters;
use super::replay::Replay;
use super::rows::Averages;
use crate::base::error::{Error, Result};
use crate::environment::Spec;
use crate::nn::{Precision, map, write_tensors};
use crate::{failed, usage};

const FORMAT: &str = "vamaro-swarm checkpoint";
const VERSION: &str = "1";

/// How far a run has come.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Episodes played for training.
    pub episodes: u64,
    /// Environment steps of these episodes.
    #[serde(default)]
    pub timesteps: u64,
    /// Rows of `metrics.csv` that are final: a longer run has them too.
    pub rows: usize,
    /// What the next row will say.
    pub averages: Averages,
    /// Seconds spent training, over all sittings.
    pub seconds: f64,
}

/// The parts of a run that change as it goes on.
#[derive(Debug)]
pub struct State {
    /// How far it has come.
    pub progress: Progress,
    /// The networks.
    pub learner: Learner,
    /// Remembered episodes.
    pub replay: Replay,
    /// The last episodes.
    pub batch: Batch,
}

impl State {
    /// Writes a checkpoint.
    ///
    /// # Errors
    /// `Failed` if it cannot be written, or if some weight is not a number: then the last checkpoint is the good
    /// one, and stays.
    pub fn save(&self, config: &Config, path: &Path) -> Result<()> {
        let State { progress, learner, replay, batch } = self;
        if !learner.is_finite() {
            return Err(failed!("a weight is no longer a finite number; no checkpoint is written"));
        }
        let metadata = BTreeMap::from([
            ("format", FORMAT.to_owned()),
            ("version", VERSION.to_owned()),
            ("program", concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned()),
            ("config", config.to_toml()),
            ("progress", to_json(progress)),
            ("counters", to_json(&learner.counters())),
        ]);
        let state = learner.state();
        let mut tensors: Vec<(&str, Vec<usize>, &[f32])> =
            state.iter().map(|(name, shape, values)| (&name[..], shape.clone(), *values)).collect();
        let remembered = floats(replay.lengths().iter().map(|&length| length as f32));
        let actions = floats(batch.actions.iter().map(|&action| action.into()));
        let lengths = floats(batch.ends.lengths().iter().map(|&length| length as f32));
        let terminated =
            floats(batch.ends.terminated().iter().map(|&terminated| u8::from(terminated).into()));
        let ages = floats(batch.ages.iter().map(|&age| age.into()));
        let mut parts = vec![("replay.joint", replay.episodes()), ("replay.lengths", &remembered)];
        let remembered_actions = floats(replay.actions().iter().map(|&action| action.into()));
        if config.sees_own_actions() {
            parts.push(("replay.actions", &remembered_actions));
        }
        if config.update_every < config.batch_episodes {
            parts.extend([
                ("batch.observations", &batch.observations[..]),
                ("batch.joint", &batch.joint),
                ("batch.estimates", &batch.estimates),
                ("batch.actions", &actions),
                ("batch.rewards", &batch.rewards),
                ("batch.lengths", &lengths),
                ("batch.terminated", &terminated),
            ]);
            if !batch.ages.is_empty() {
                parts.push(("batch.ages", &ages));
            }
        }
        tensors.extend(parts.into_iter().map(|(name, values)| (name, vec![values.len()], values)));
        let tensors: Vec<_> =
            tensors.iter().map(|(name, shape, values)| (*name, &shape[..], *values)).collect();
        write_tensors(path, &metadata, Precision::Full, &tensors)
    }

    /// Takes over what a checkpoint of this configuration holds.
    ///
    /// # Errors
    /// `Failed` if something is missing or does not fit.
    pub fn restore(&mut self, config: &Config, spec: &Spec, checkpoint: &Checkpoint) -> Result<()> {
        let tensors = checkpoint.tensors()?;
        let find =
            |name: &str| tensors.tensor(name).ok().and_then(|t| bytemuck::try_cast_slice(t.data()).ok());
        self.learner.restore(find, &checkpoint.counters).map_err(|e| checkpoint.damaged(&e))?;
        let need = |name: &str| find(name).ok_or_else(|| checkpoint.damaged(&format!("{name} is missing")));
        let lengths = |name: &str| {
            find(name).map(|values| values.iter().map(|&value| value as usize).collect::<Vec<_>>())
        };
        let available = available_actions(spec);
        let actions_in = |name: &str| {
            let values = need(name)?;
            let there_is =
                |(at, value): (usize, &f32)| (0.0..available[at % available.len()] as f32).contains(value);
            if values.iter().enumerate().all(there_is) {
                Ok(values.iter().map(|&value| value as u8).collect::<Vec<_>>())
            } else {
                Err(checkpoint.damaged(&format!("{name} has an action that there is not")))
            }
        };
        let seen = if config.sees_own_actions() { actions_in("replay.actions")? } else { Vec::new() };
        if !self.replay.restore(need("replay.joint")?, lengths("replay.lengths"), seen) {
            return Err(checkpoint.damaged("replay.joint, replay.lengths or replay.actions does not fit"));
        }
        if config.update_every < config.batch_episodes {
            let Batch { steps, observations, joint, estimates, ages, actions, rewards, ends, .. } =
                &mut self.batch;
            for (name, to) in [
                ("batch.observations", observations),
                ("batch.joint", joint),
                ("batch.estimates", estimates),
                ("batch.rewards", rewards),
            ] {
                copy(need(name)?, to)
                    .ok_or_else(|| checkpoint.damaged(&format!("{name} has another length")))?;
            }
            if let Some(lengths) = lengths("batch.lengths") {
                let terminated = need("batch.terminated")?;
                let fits = |lengths: &[usize]| lengths.iter().all(|length| (1..=*steps).contains(length));
                if [lengths.len(), terminated.len()] != [ends.lengths().len(); 2] || !fits(&lengths) {
                    return Err(checkpoint.damaged("batch.lengths or batch.terminated does not fit"));
                }
                let ended = lengths.iter().zip(terminated).enumerate();
                ended.for_each(|(at, (&length, &terminated))| ends.set(at, length, terminated != 0.0));
            }
            if !ages.is_empty() {
                let kept = need("batch.ages")?.iter().map(|&age| age as u8).collect::<Vec<_>>();
                copy(&kept, ages).ok_or_else(|| checkpoint.damaged("batch.ages has another length"))?;
            }
            copy(&actions_in("batch.actions")?, actions)
                .ok_or_else(|| checkpoint.damaged("batch.actions has another length"))?;
        }
        self.progress = checkpoint.progress.clone();
        if self.is_consistent(config) {
            Ok(())
        } else {
            Err(checkpoint.damaged("its episodes, updates, rows and replay contradict each other"))
        }
    }

    /// Whether the counts belong together: updates begin with the first whole batch, and each has its fresh
    /// episodes.
    fn is_consistent(&self, config: &Config) -> bool {
        let Progress { episodes, rows, .. } = self.progress;
        let (fresh, batch) = (config.update_every as u64, config.batch_episodes as u64);
        let updates = (episodes / fresh + 1).saturating_sub(batch.div_ceil(fresh));
        let remembered = if config.replays() { episodes.min(config.replay_episodes as u64) } else { 0 };
        episodes.is_multiple_of(fresh)
            && episodes < 1 << 46
            && rows as u64 <= episodes / fresh + 1
            && self.learner.updates() == updates
            && self.replay.len() as u64 == remembered
    }
}

/// How many actions each agent has.
pub(super) fn available_actions(spec: &Spec) -> Vec<usize> {
    (0..spec.n_agents()).map(|agent| spec.available_actions(agent)).collect()
}

fn floats(values: impl Iterator<Item = f32>) -> Vec<f32> {
    values.collect()
}

fn copy<T: Copy>(from: &[T], to: &mut [T]) -> Option<()> {
    (from.len() == to.len()).then(|| to.copy_from_slice(from))
}

/// A checkpoint that was found.
#[derive(Debug)]
pub struct Checkpoint {
    /// What the run was configured with.
    pub config: Config,
    /// How far it had come.
    pub progress: Progress,
    counters: Counters,
    source: String,
    map: Mmap,
}

impl Checkpoint {
    /// Opens the checkpoint at `path`.
    ///
    /// # Errors
    /// `Usage` if there is none, or it is one of another version; `Failed` if it is damaged.
    pub fn open(path: &Path) -> Result<Checkpoint> {
        let (map, source) = (map(path)?, path.display().to_string());
        let damaged = |e: &dyn std::fmt::Display| failed!("{source} is damaged, or not a checkpoint: {e}");
        let (_, content) = SafeTensors::read_metadata(&map).map_err(|e| damaged(&e))?;
        let words = content.metadata().clone().unwrap_or_default();
        let word = |key: &str| words.get(key).ok_or_else(|| damaged(&format!("it has no `{key}`")));
        if words.get("format").map(String::as_str) != Some(FORMAT) {
            return Err(usage!("{source} is not a checkpoint of vamaro-swarm"));
        }
        let version = word("version")?;
        if version != VERSION {
            let program = words.get("program").map_or("another program", String::as_str);
            return Err(usage!(
                "{source} is a checkpoint of version {version}, written by {program}; this program continues \
                 version {VERSION}"
            ));
        }
        let config = Layer::parse(word("config")?, &source)?;
        let config = Config::resolve(Preset::Paper, &[config])?;
        let mut progress: Progress = serde_json::from_str(word("progress")?).map_err(|e| damaged(&e))?;
        if progress.timesteps == 0 {
            // Written before episodes could end early, when all of them had 25 steps.
            progress.timesteps = 25 * progress.episodes;
        }
        let counters = serde_json::from_str(word("counters")?).map_err(|e| damaged(&e))?;
        Ok(Checkpoint { config, progress, counters, source, map })
    }

    fn tensors(&self) -> Result<SafeTensors<'_>> {
        SafeTensors::deserialize(&self.map).map_err(|e| self.damaged(&e.to_string()))
    }

    fn damaged(&self, why: &str) -> Error {
        failed!("{} is damaged: {why}", self.source)
    }
}

fn to_json(part: &impl Serialize) -> String {
    serde_json::to_string(part).expect("counters can be written as JSON")
}

impl Progress {
    /// Environment steps so far.
    pub fn timestep(&self) -> u64 {
        self.timesteps
    }
}
