//! The memory that a run needs, by arithmetic, before any of it is taken.

use super::Config;
use crate::agent::dims;
use crate::base::error::Result;
use crate::environment::Spec;
use crate::nn::TensorSpec;
use crate::usage;

/// Bytes of a weight or an observed value.
pub(super) const VALUE: usize = size_of::<f32>();

/// Bytes of what replay holds at most.
pub(super) fn remembered(config: &Config, spec: &Spec) -> u64 {
    let episodes = if config.replays() {
        (config.steps / spec.episode_steps as u64).min(config.replay_episodes as u64)
    } else {
        0
    };
    episodes * (spec.episode_steps * spec.joint_dim() * VALUE) as u64
}

/// The memory that a run needs, in bytes, somewhat more rather than less: weights with their gradient, moments,
/// target and the copies that agents and checkpoints have, what lies between the layers, and replay.
pub(super) fn memory_needed(config: &Config, spec: &Spec) -> u64 {
    const COPIES_IN_LEARNER: usize = 5;
    const COPIES_OF_POLICY: usize = 4;
    // Values per row and hidden unit that a backward pass needs, of a GRU or LSTM; an MLP needs fewer.
    const BETWEEN_LAYERS: usize = 16;
    let dims = dims(spec);
    let networks = config.networks();
    let policy: usize = networks.tensors(&dims).iter().map(TensorSpec::n_values).sum();
    let observations = dims.n_agents * spec.padded_obs_dim();
    let critic_hidden = config.settings().critic_hidden;
    let critic = (observations + dims.joint + critic_hidden) * critic_hidden;
    let weights = COPIES_IN_LEARNER * (policy + dims.n_agents * critic) + COPIES_OF_POLICY * policy;
    let rows = (spec.episode_steps + 1) * config.batch_episodes;
    let hidden = dims.n_agents * (config.hidden + critic_hidden) * BETWEEN_LAYERS;
    let predictor_rows = spec.episode_steps * config.batch_episodes.max(config.replay_batch);
    let views = if config.sees_own_actions() { dims.n_agents } else { 1 };
    let predictors =
        config.predictors.len() * views * predictor_rows * config.predictor_hidden * BETWEEN_LAYERS;
    let between = rows * (hidden + 4 * observations + dims.n_agents * dims.joint) + predictors;
    ((weights + between) * VALUE) as u64 + remembered(config, spec)
}

/// An error if this machine has less memory left than a run needs: the kernel would end some process, perhaps
/// another one.
pub(super) fn check_memory(config: &Config, spec: &Spec) -> Result<()> {
    let needed = memory_needed(config, spec);
    let about = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let kibibytes =
        about.lines().find_map(|line| line.strip_prefix("MemAvailable:")?.split_whitespace().next());
    match kibibytes.and_then(|kibibytes| kibibytes.parse::<u64>().ok()) {
        Some(available) if needed > available * 1024 => Err(usage!(
            "a run with these settings needs about {:.1} GB of memory, and this machine has {:.1} GB left; make \
             `hidden`, `batch_episodes` or `replay_episodes` smaller",
            needed as f64 / 1e9,
            (available * 1024) as f64 / 1e9
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Task;
    use crate::train::{Layer, Preset};

    #[test]
    fn a_run_that_would_fill_the_memory_is_refused() {
        let check = |settings: &[(&str, &str)]| {
            let mut layer = Layer::new("test");
            settings.iter().for_each(|(key, value)| layer.set(key, value));
            let config = Config::resolve(Preset::Paper, &[layer]).unwrap();
            check_memory(&config, Task::parse(&config.task).unwrap().spec())
        };
        assert!(check(&[]).is_ok());
        let huge = [("hidden", "16384"), ("task", "spread-xy-64")];
        assert!(check(&huge).unwrap_err().to_string().contains("GB of memory"));
    }
}
