//! How fast training is on this machine, and where the time goes.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::trainer::{Diverged, Trainer};
use super::trial::test;
use super::{Busy, Config};
use crate::base::error::Result;
use crate::base::threads::side_by_side;
use crate::nn::kernels::{self, Start};
use crate::{failed, supervisor};

/// What was measured over a number of updates, each with the episodes it learns from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Throughput {
    /// Updates.
    pub updates: u64,
    /// Environment steps of their episodes.
    pub env_steps: u64,
    /// All of it.
    pub elapsed: Duration,
    /// Playing the episodes, and handing the new weights over.
    pub rollout: Duration,
    /// Thread time of the networks' turns.
    pub busy: Busy,
}

impl Throughput {
    /// Plays and learns for so long, at least three updates, after enough of them that everything is warm and
    /// replay has begun.
    pub fn measure(
        trainer: &mut Trainer,
        agents: &mut impl supervisor::Team,
        longest: Duration,
    ) -> Result<Throughput> {
        let warm = trainer.config.replay_batch.div_ceil(trainer.config.update_every) as u64;
        while trainer.learner().updates() <= warm {
            let mut ignored = Throughput::default();
            ignored.update(trainer, agents)?;
        }
        let (began, before) = (Instant::now(), trainer.learner().busy());
        let mut measured = Throughput::default();
        while measured.updates < 3 || began.elapsed() < longest {
            measured.update(trainer, agents)?;
        }
        let after = trainer.learner().busy();
        let busy = Busy {
            actors: after.actors - before.actors,
            critics: after.critics - before.critics,
            predictors: after.predictors - before.predictors,
        };
        Ok(Throughput { elapsed: began.elapsed(), busy, ..measured })
    }

    fn update(&mut self, trainer: &mut Trainer, agents: &mut impl supervisor::Team) -> Result<()> {
        let (began, before) = (Instant::now(), trainer.timestep());
        trainer.play(agents)?;
        self.rollout += began.elapsed();
        let weights = trainer.learn().map_err(|Diverged(why)| failed!("training diverges: {why}"))?;
        if let Some(weights) = weights {
            let began = Instant::now();
            agents.renew(weights)?;
            self.rollout += began.elapsed();
            self.updates += 1;
        }
        self.env_steps += trainer.timestep() - before;
        Ok(())
    }

    /// Environment steps a second.
    pub fn env_steps_per_second(&self) -> f64 {
        self.env_steps as f64 / self.elapsed.as_secs_f64()
    }

    /// Time of one update without its rollout.
    pub fn learning(&self) -> Duration {
        (self.elapsed - self.rollout).div_f64(self.updates as f64)
    }

    /// Time of one update with its rollout.
    pub fn per_update(&self) -> Duration {
        self.elapsed.div_f64(self.updates as f64)
    }
}

/// How long a test of all levels with all predictors of `config` takes on so many threads.
pub fn test_duration(config: &Config, threads: usize) -> Result<Duration> {
    let trainer = Trainer::new(config.clone(), threads)?;
    let policy = trainer.policy()?;
    let began = Instant::now();
    test(config, &trainer.task, &policy, 0, threads)?;
    Ok(began.elapsed())
}

/// The rate of the product of 250 x 256 and 256 x 256 matrices with the kernels that training uses, on so many
/// threads at once: floating-point operations a second.
pub fn matmul_rate(threads: usize, longest: Duration) -> f64 {
    const ROWS: usize = 250;
    const WIDTH: usize = 256;
    let products = AtomicU64::new(0);
    let began = Instant::now();
    side_by_side(threads, 0..threads, |_| {
        let (x, weight) = (vec![0.5; ROWS * WIDTH], vec![0.25; WIDTH * WIDTH]);
        let (bias, mut y) = (vec![0.0; WIDTH], vec![0.0; ROWS * WIDTH]);
        while began.elapsed() < longest {
            kernels::linear(ROWS, &x, &weight, Start::Bias(&bias), &mut y);
            std::hint::black_box(&y);
            products.fetch_add(1, Ordering::Relaxed);
        }
    });
    let operations = products.into_inner() as f64 * (2 * ROWS * WIDTH * WIDTH) as f64;
    operations / began.elapsed().as_secs_f64()
}
