//! The files of recorded updates: hyperparameters, batches, weights before and after.

use std::path::{Path, PathBuf};

use safetensors::{Dtype, SafeTensors};
use serde::Deserialize;

use crate::base::error::{Error, Result};
use crate::base::regular;
use crate::environment::Spec;
use crate::nn::{ActorKind, Networks, PredictorSpec, Sharing, TensorSpec, key};
use crate::train::{Backend, Batch, CriticInput, Ends, Estimator, Objective, PredictorSettings, Settings};

/// The most bytes `config.json` may have.
const LARGEST_CONFIG: u64 = 1 << 20;

/// The most bytes an update may have.
const LARGEST: u64 = 1 << 30;

/// `config.json`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    #[serde(rename = "kind")]
    _kind: String,
    pub task: String,
    algorithm: Algorithm,
    actor: ActorKind,
    hidden: usize,
    learning_rate: f64,
    entropy_coefficient: f64,
    gamma: f64,
    clip: f64,
    epochs: usize,
    n_step: usize,
    grad_norm_clip: f64,
    standardise_rewards: bool,
    adam_eps: f64,
    target_update_interval: u64,
    predictor: PredictorConfig,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Algorithm {
    Mappo,
    Ippo,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PredictorConfig {
    learning_rate: f64,
    grad_norm_clip: f64,
    advantage_lambda: f64,
    hidden: usize,
}

impl Config {
    pub(super) fn read(file: &Path) -> Result<Config> {
        let bytes = regular::read(file, LARGEST_CONFIG)?;
        let config: Config = serde_json::from_slice(&bytes).map_err(|e| Error::io("read", file, e))?;
        let refuse = |what: String| Err(Error::io("verify", file, what));
        if config.adam_eps != 1e-8 {
            return refuse(format!("adam_eps is {}, only 1e-8 can be verified", config.adam_eps));
        }
        for (name, value) in [("epochs", config.epochs), ("n_step", config.n_step)] {
            if !(1..=1000).contains(&value) {
                return refuse(format!("{name} is {value}, expected 1 to 1000"));
            }
        }
        match config.target_update_interval {
            0 => refuse("target_update_interval is 0, expected 1 or more".to_owned()),
            _ => config.settings().networks.check().map(|()| config).or_else(refuse),
        }
    }

    /// The same in our words.
    pub(super) fn settings(&self) -> Settings {
        let predictor = &self.predictor;
        let spec = PredictorSpec { hidden: predictor.hidden, ..PredictorSpec::paper("value-aware") };
        let networks =
            Networks { hidden: self.hidden, predictors: vec![spec], ..Networks::paper(self.actor) };
        Settings {
            networks,
            critic_sharing: Sharing::Separate,
            critic_input: match self.algorithm {
                Algorithm::Mappo => CriticInput::AllObservations,
                Algorithm::Ippo => CriticInput::Joint,
            },
            critic_hidden: self.hidden,
            predictors: vec![PredictorSettings {
                learning_rate: predictor.learning_rate,
                largest_gradient: predictor.grad_norm_clip,
                ..PredictorSettings::paper(Objective::ValueAware { lambda: predictor.advantage_lambda })
            }],
            predictor_updates: 1,
            learning_rate: self.learning_rate,
            entropy_coefficient: self.entropy_coefficient,
            gamma: self.gamma,
            estimator: Estimator::Steps(self.n_step),
            clip: self.clip,
            epochs: self.epochs,
            largest_gradient: self.grad_norm_clip,
            standardise_rewards: self.standardise_rewards,
            target_interval: self.target_update_interval,
            backend: Backend::Native,
        }
    }
}

/// `update-N.safetensors`, in memory.
pub(super) struct UpdateFile {
    pub path: PathBuf,
    bytes: Vec<u8>,
}

impl UpdateFile {
    pub(super) fn read(path: PathBuf) -> Result<UpdateFile> {
        let bytes = regular::read(&path, LARGEST)?;
        Ok(UpdateFile { path, bytes })
    }

    /// A network's tensor as we have it: weights are `[outputs, inputs]` in the file.
    pub(super) fn weights(&self, prefix: &str, spec: &TensorSpec) -> Result<Vec<f32>> {
        let stored: Vec<usize> = spec.shape.iter().rev().copied().collect();
        let values = self.floats(&format!("{prefix}.{}", key(&spec.name)), &stored)?;
        Ok(match spec.shape[..] {
            [inputs, outputs] => {
                (0..inputs * outputs).map(|at| values[at % outputs * inputs + at / outputs]).collect()
            }
            _ => values,
        })
    }

    /// The episodes, in our order: by time, then episode, then agent.
    pub(super) fn batch(&self, spec: &Spec) -> Result<Batch> {
        let (n, joint, obs) = (spec.n_agents(), spec.joint_dim(), spec.padded_obs_dim());
        let n_actions = spec.n_actions();
        let (episodes, last) = match self.shape("batch.reward")?[..] {
            [episodes, times, 1] if episodes > 0 && times > 1 => (episodes, times - 1),
            _ => return self.refuse("batch.reward is not [episodes, steps + 1, 1]"),
        };
        let times = last + 1;
        let rewards = self.floats("batch.reward", &[episodes, times, 1])?;
        let observations = self.floats("batch.obs", &[episodes, times, n, obs])?;
        let joints = self.floats("batch.joint_input", &[episodes, times, n, joint])?;
        let actions = self.whole("batch.actions", Dtype::I64, &[episodes, times, n, 1])?;
        let masks = self.whole("batch.avail_actions", Dtype::I32, &[episodes, times, n, n_actions])?;
        let filled = self.whole("batch.filled", Dtype::I64, &[episodes, times, 1])?;

        if filled.iter().any(|&filled| filled != 1) {
            return self.refuse("batch.filled: an episode is shorter than the others");
        }
        let ours = |at: usize| at % n_actions < spec.available_actions(at / n_actions % n);
        if masks.iter().enumerate().any(|(at, &mask)| (mask == 1) != ours(at)) {
            return self.refuse("batch.avail_actions are not those of the task");
        }
        if actions
            .iter()
            .enumerate()
            .any(|(at, action)| !(0..spec.available_actions(at % n) as i64).contains(action))
        {
            return self.refuse("batch.actions: an agent has no such action");
        }
        let mut views = joints.chunks_exact(n * joint);
        if !views.all(|views| views.chunks_exact(joint).all(|view| view == &views[..joint])) {
            return self.refuse("batch.joint_input: not everything was delivered");
        }
        let joint_of_first = by_time(&joints, episodes, times, n * joint);
        Ok(Batch {
            episodes,
            steps: last,
            observations: by_time(&observations, episodes, times, n * obs),
            joint: joint_of_first
                .chunks_exact(n * joint)
                .flat_map(|views| &views[..joint])
                .copied()
                .collect(),
            estimates: Vec::new(),
            ages: Vec::new(),
            actions: by_time(&actions, episodes, last, n).iter().map(|&action| action as u8).collect(),
            rewards: by_time(&rewards, episodes, last, 1),
            ends: Ends::truncated(episodes, last),
        })
    }

    /// Advantages of `batch`, in our order.
    pub(super) fn advantages(&self, batch: &Batch, n_agents: usize) -> Result<Vec<f32>> {
        let values = self.floats("after.advantages", &[batch.episodes, batch.steps, n_agents])?;
        Ok(by_time(&values, batch.episodes, batch.steps, n_agents))
    }

    /// The loss of the predictor.
    pub(super) fn predictor_loss(&self) -> Result<f32> {
        Ok(self.floats("after.predictor_loss", &[1])?[0])
    }

    fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let bytes = self.tensor(name, Dtype::F32, shape)?;
        let values = bytes.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes));
        let values: Vec<f32> = values.collect();
        match values.iter().find(|value| !value.is_finite()) {
            Some(value) => self.refuse(&format!("{name} holds {value}, expected numbers")),
            None => Ok(values),
        }
    }

    fn whole(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<Vec<i64>> {
        let bytes = self.tensor(name, dtype, shape)?;
        Ok(match dtype {
            Dtype::I32 => bytes.as_chunks().0.iter().map(|&bytes| i32::from_le_bytes(bytes).into()).collect(),
            _ => bytes.as_chunks().0.iter().map(|&bytes| i64::from_le_bytes(bytes)).collect(),
        })
    }

    fn shape(&self, name: &str) -> Result<Vec<usize>> {
        let tensors = SafeTensors::deserialize(&self.bytes).map_err(|e| Error::io("read", &self.path, e))?;
        let tensor = tensors.tensor(name).map_err(|e| Error::io("read", &self.path, e))?;
        Ok(tensor.shape().to_vec())
    }

    fn tensor(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<&[u8]> {
        let tensors = SafeTensors::deserialize(&self.bytes).map_err(|e| Error::io("read", &self.path, e))?;
        let tensor = tensors.tensor(name).map_err(|e| Error::io("read", &self.path, e))?;
        if (tensor.dtype(), tensor.shape()) != (dtype, shape) {
            let (found, dims) = (tensor.dtype(), tensor.shape());
            return self.refuse(&format!("{name} is {found:?} {dims:?}, expected {dtype:?} {shape:?}"));
        }
        Ok(tensor.data())
    }

    fn refuse<T>(&self, what: &str) -> Result<T> {
        Err(Error::io("verify", &self.path, what))
    }
}

/// From `[episodes, times, width]` to `[steps, episodes, width]`; times beyond `steps` are left out.
fn by_time<T: Copy>(values: &[T], episodes: usize, steps: usize, width: usize) -> Vec<T> {
    let times = values.len() / (episodes * width);
    let rows = (0..steps).flat_map(|step| (0..episodes).map(move |episode| episode * times + step));
    rows.flat_map(|row| &values[row * width..][..width]).copied().collect()
}
