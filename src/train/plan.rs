//! What a run will take: measured on a few updates that nobody keeps.

use std::time::{Duration, Instant};

use super::Config;
use super::rows::columns;
use super::trainer::{Diverged, Trainer};
use super::trial::test;
use crate::error::Result;
use crate::failed;
use crate::supervisor::{InProcess, Team as _};
use crate::world::EPISODE_STEPS;

/// What a run will take.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Updates of the team.
    pub updates: u64,
    /// Rows of `metrics.csv`.
    pub rows: u64,
    /// Timesteps a second, tests included.
    pub steps_per_second: f64,
    /// The size of its folder when it is done.
    pub bytes: u64,
}

/// How long is measured.
const MEASURED: Duration = Duration::from_millis(1500);

/// Bytes of a cell of `metrics.csv` and of its event for TensorBoard, roughly.
const BYTES_PER_CELL: u64 = 100;

/// Measures what a run of this configuration will take on so many threads.
pub fn estimate(config: &Config, threads: usize) -> Result<Plan> {
    let mut trainer = Trainer::new(config.clone(), threads)?;
    let policy = trainer.policy()?;
    let mut agents = InProcess::new(&trainer.agents(), &policy)?;
    let mut update = || -> Result<()> {
        trainer.play(&mut agents)?;
        let weights = trainer.learn().map_err(|Diverged(why)| failed!("training diverges: {why}"))?;
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

    let episodes = config.steps.div_ceil(EPISODE_STEPS as u64);
    let updates = episodes.div_ceil(config.update_every as u64);
    let rows = config.steps / config.test_interval + 1;
    let seconds = updates as f64 * seconds_per_update + rows as f64 * seconds_per_row;
    let learned: usize = trainer.team().state().iter().map(|(_, _, values)| size_of_val(*values)).sum();
    let remembered = if config.replays() { episodes.min(config.replay_episodes as u64) } else { 0 };
    let remembered = remembered * (EPISODE_STEPS * trainer.task.joint_dim() * size_of::<f32>()) as u64;
    let policy = (policy.n_values() * size_of::<f32>()) as u64;
    let cells = rows * columns(config).len() as u64;
    Ok(Plan {
        updates,
        rows,
        steps_per_second: config.steps as f64 / seconds,
        bytes: learned as u64 + policy + remembered + cells * BYTES_PER_CELL,
    })
}
