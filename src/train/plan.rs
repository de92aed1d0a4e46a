//! What a run will take: its memory by arithmetic, its time measured on a few updates that nobody keeps.

use std::time::{Duration, Instant};

use super::Config;
use super::rows::columns;
use super::trainer::{Diverged, Trainer};
use super::trial::test;
use crate::agents::dims;
use crate::error::Result;
use crate::nn::TensorSpec;
use crate::supervisor::{InProcess, Team as _};
use crate::world::{EPISODE_STEPS, Task};
use crate::{failed, usage};

/// What a run will take.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Updates of the team.
    pub updates: u64,
    /// Rows that will be written to `metrics.csv`.
    pub rows: u64,
    /// Environment steps a second, tests included.
    pub steps_per_second: f64,
    /// How long it will take.
    pub duration: Duration,
    /// The size of its folder when it is done, in bytes.
    pub disk: u64,
    /// The memory it needs, in bytes.
    pub memory: u64,
}

/// How long is measured.
const MEASURED: Duration = Duration::from_millis(1500);

/// Bytes of a cell of `metrics.csv` and of its event for TensorBoard, roughly.
const BYTES_PER_CELL: u64 = 100;

/// Measures what a run of this configuration will take on so many threads, from timestep `from` on.
pub fn estimate(config: &Config, threads: usize, from: u64) -> Result<Plan> {
    let mut trainer = Trainer::new(config.clone(), threads)?;
    let policy = trainer.policy()?;
    let mut agents = InProcess::new(&trainer.agents(), &policy)?;
    let mut update = || -> Result<()> {
        trainer.play(&mut agents)?;
        let weights = trainer.learn().map_err(|Diverged(why)| {
            failed!("training diverges at once: {why}; try a smaller learning rate")
        })?;
        weights.map_or(Ok(()), |weights| agents.renew(weights))
    };
    // Until there is a whole batch, there is no update.
    (0..config.batch_episodes.div_ceil(config.update_every)).try_for_each(|_| update())?;
    let (began, mut measured) = (Instant::now(), 0);
    while began.elapsed() < MEASURED {
        update()?;
        measured += 1;
    }
    let seconds_per_update = began.elapsed().as_secs_f64() / f64::from(measured);
    let began = Instant::now();
    if config.test_episodes > 0 {
        test(config, &trainer.task, &policy, 0, threads)?;
    }
    let seconds_per_row = began.elapsed().as_secs_f64();

    let episodes = config.steps.saturating_sub(from).div_ceil(EPISODE_STEPS as u64);
    let updates = episodes.div_ceil(config.update_every as u64);
    let all_rows = 1 + config.steps.div_ceil(config.test_interval);
    let rows = all_rows.saturating_sub(if from > 0 { 1 + from / config.test_interval } else { 0 });
    let duration = updates as f64 * seconds_per_update + rows as f64 * seconds_per_row;
    let learned: usize = trainer.team().state().iter().map(|(_, _, values)| size_of_val(*values)).sum();
    let policy = (policy.n_values() * VALUE) as u64;
    let cells = all_rows * columns(config).len() as u64;
    Ok(Plan {
        updates,
        rows,
        steps_per_second: (updates * config.update_every as u64 * EPISODE_STEPS as u64) as f64 / duration,
        duration: Duration::from_secs_f64(duration),
        disk: learned as u64 + policy + remembered(config, &trainer.task) + cells * BYTES_PER_CELL,
        memory: memory_needed(config, &trainer.task),
    })
}

/// Bytes of a weight or an observed value.
const VALUE: usize = size_of::<f32>();

/// Bytes of what replay holds at most.
fn remembered(config: &Config, task: &Task) -> u64 {
    let episodes = match config.replays() {
        true => (config.steps / EPISODE_STEPS as u64).min(config.replay_episodes as u64),
        false => 0,
    };
    episodes * (EPISODE_STEPS * task.joint_dim() * VALUE) as u64
}

/// The memory that a run needs, in bytes, somewhat more rather than less: weights with their gradient, moments,
/// target and the copies that agents and checkpoints have, what lies between the layers, and replay.
fn memory_needed(config: &Config, task: &Task) -> u64 {
    const COPIES_IN_LEARNER: usize = 5;
    const COPIES_OF_POLICY: usize = 4;
    // Values per row and hidden unit that a backward pass needs, of a GRU or LSTM; an MLP needs fewer.
    const BETWEEN_LAYERS: usize = 16;
    let dims = dims(task);
    let networks = config.networks();
    let policy: usize = networks.tensors(&dims).iter().map(TensorSpec::n_values).sum();
    let observations = dims.n_agents * task.padded_obs_dim();
    let critic = (observations + dims.joint + config.hidden) * config.hidden;
    let weights = COPIES_IN_LEARNER * (policy + dims.n_agents * critic) + COPIES_OF_POLICY * policy;
    let rows = (EPISODE_STEPS + 1) * config.batch_episodes;
    let hidden = 2 * dims.n_agents * config.hidden * BETWEEN_LAYERS;
    let predictor_rows = EPISODE_STEPS * config.batch_episodes.max(config.replay_batch);
    let predictors = config.predictors.len() * predictor_rows * config.predictor_hidden * BETWEEN_LAYERS;
    let between = rows * (hidden + 4 * observations + dims.n_agents * dims.joint) + predictors;
    ((weights + between) * VALUE) as u64 + remembered(config, task)
}

/// An error if this machine has less memory left than a run needs: the kernel would end some process, perhaps
/// another one.
pub(super) fn check_memory(config: &Config, task: &Task) -> Result<()> {
    let needed = memory_needed(config, task);
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
    use crate::train::{Layer, Preset};

    fn config(settings: &[(&str, &str)]) -> Config {
        let mut layer = Layer::new("test");
        settings.iter().for_each(|(key, value)| layer.set(key, value));
        Config::resolve(Preset::Paper, &[layer]).unwrap()
    }

    #[test]
    fn a_run_that_would_fill_the_memory_is_refused() {
        let check = |settings: &[(&str, &str)]| {
            let config = config(settings);
            check_memory(&config, &Task::parse(&config.task).unwrap())
        };
        assert!(check(&[]).is_ok());
        let huge = [("hidden", "16384"), ("task", "spread-xy-64")];
        assert!(check(&huge).unwrap_err().to_string().contains("GB of memory"));
    }

    #[test]
    fn rows_and_updates_of_what_is_left() {
        let small = [("hidden", "8"), ("test_episodes", "0"), ("steps", "80000"), ("predictors", "none")];
        let whole = estimate(&config(&small), 1, 0).unwrap();
        // At 0, 50000 and 80000.
        assert_eq!((whole.updates, whole.rows), (320, 3));
        let rest = estimate(&config(&small), 1, 60_000).unwrap();
        assert_eq!((rest.updates, rest.rows), (80, 1));
    }
}
