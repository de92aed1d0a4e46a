//! What a run will take: its time is measured on a few updates that nobody keeps.

use std::time::{Duration, Instant};

use super::Config;
use super::memory_needed::{VALUE, memory_needed, remembered};
use super::rows::columns;
use super::trainer::{Diverged, Trainer};
use super::trial::test;
use crate::base::error::Result;
use crate::failed;
use crate::supervisor::{InProcess, Team as _};

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

    // As if no episode ended early.
    let steps = trainer.task.spec().episode_steps as u64;
    let episodes = config.steps.saturating_sub(from).div_ceil(steps);
    let updates = episodes.div_ceil(config.update_every as u64);
    let all_rows = 1 + config.steps.div_ceil(config.test_interval);
    let rows = all_rows.saturating_sub(if from > 0 { 1 + from / config.test_interval } else { 0 });
    let duration = updates as f64 * seconds_per_update + rows as f64 * seconds_per_row;
    let learned: usize = trainer.learner().state().iter().map(|(_, _, values)| size_of_val(*values)).sum();
    let policy = (policy.n_values() * VALUE) as u64;
    let cells = all_rows * columns(config).len() as u64;
    Ok(Plan {
        updates,
        rows,
        steps_per_second: (updates * config.update_every as u64 * steps) as f64 / duration,
        duration: Duration::from_secs_f64(duration),
        disk: learned as u64 + policy + remembered(config, trainer.task.spec()) + cells * BYTES_PER_CELL,
        memory: memory_needed(config, trainer.task.spec()),
    })
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
    fn rows_and_updates_of_what_is_left() {
        let small = [("hidden", "8"), ("test_episodes", "0"), ("steps", "80000"), ("predictors", "none")];
        let whole = estimate(&config(&small), 1, 0).unwrap();
        // At 0, 50000 and 80000.
        assert_eq!((whole.updates, whole.rows), (320, 3));
        let rest = estimate(&config(&small), 1, 60_000).unwrap();
        assert_eq!((rest.updates, rest.rows), (80, 1));
    }
}
