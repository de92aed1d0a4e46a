//! The rows of `metrics.csv`: what is in them, and what is averaged for the next one.
//!
//! `docs/metrics.md` defines every column.

use serde::{Deserialize, Serialize};

use super::config::Config;
use super::learner::Losses;
use super::trial::{LEVELS, Trial};

/// How far the run is, and the training episodes since the row before.
const FIRST: [&str; 4] = ["episodes", "updates", "return_mean", "return_std"];

/// What an update says of itself, by column; the order is that of [`update_values`].
const OF_UPDATES: [&str; 13] = [
    "critic_loss",
    "critic_grad_norm",
    "td_error_abs",
    "value_mean",
    "target_mean",
    "advantage_mean",
    "pg_loss",
    "actor_loss",
    "entropy",
    "pi_max",
    "clip_fraction",
    "approx_kl",
    "agent_grad_norm",
];

/// The same of a predictor, behind its name.
const OF_PREDICTORS: [&str; 3] = ["loss", "nll", "grad_norm"];

/// The columns of a run, behind `timestep`.
pub fn columns(config: &Config) -> Vec<String> {
    let mut columns: Vec<String> = FIRST.iter().chain(&OF_UPDATES).map(|&name| name.to_owned()).collect();
    for predictor in &config.predictors {
        columns.extend(OF_PREDICTORS.map(|name| format!("{predictor}/{name}")));
    }
    if config.test_episodes > 0 {
        for imputer in config.tested_imputers() {
            for level in LEVELS {
                let test = |what| format!("{imputer}/test_p={level}_{what}");
                columns.extend(["return_mean", "return_std", "imputation_rmse"].map(test));
            }
        }
    }
    columns
}

/// What is averaged between two rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Averages {
    returns: Running,
    updates: Vec<Running>,
}

/// Mean and variance so far (Welford).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Running {
    n: u64,
    mean: f64,
    /// Sum of the squared deviations from the mean.
    squares: f64,
}

impl Running {
    fn push(&mut self, value: f64) {
        self.n += 1;
        let before = value - self.mean;
        self.mean += before / self.n as f64;
        self.squares += before * (value - self.mean);
    }

    fn mean(&self) -> Option<f64> {
        (self.n > 0).then_some(self.mean)
    }

    fn std(&self) -> Option<f64> {
        (self.n > 1).then(|| (self.squares / (self.n - 1) as f64).sqrt())
    }
}

impl Averages {
    /// Counts the return of a training episode in.
    pub fn push_return(&mut self, episode_return: f64) {
        self.returns.push(episode_return);
    }

    /// Counts an update in. The error names a value that is not a finite number.
    pub fn push_update(&mut self, config: &Config, losses: &Losses) -> Result<(), String> {
        let values = update_values(losses);
        let wrong = |value: &Option<f64>| value.is_some_and(|value| !value.is_finite());
        if let Some(at) = values.iter().position(wrong) {
            return Err(format!("{} is no longer a finite number", columns(config)[FIRST.len() + at]));
        }
        self.updates.resize(values.len(), Running::default());
        for (running, value) in self.updates.iter_mut().zip(values) {
            value.into_iter().for_each(|value| running.push(value));
        }
        Ok(())
    }

    /// The values of a row, by column.
    pub fn row(&self, config: &Config, episodes: u64, updates: u64, tests: &[Trial]) -> Vec<Option<f64>> {
        let mut row =
            vec![Some(episodes as f64), Some(updates as f64), self.returns.mean(), self.returns.std()];
        let of_updates = OF_UPDATES.len() + OF_PREDICTORS.len() * config.predictors.len();
        row.extend((0..of_updates).map(|at| self.updates.get(at).and_then(Running::mean)));
        row.extend(
            tests.iter().flat_map(|test| [Some(test.return_mean), test.return_std, test.imputation_rmse]),
        );
        row
    }
}

/// What an update says of itself, in the order of the columns.
fn update_values(losses: &Losses) -> Vec<Option<f64>> {
    let Losses { critics, critic_gradient, actors, actor_gradient, predictors } = losses;
    let mut values = [
        critics.loss,
        *critic_gradient,
        critics.td_error_abs,
        critics.value,
        critics.target,
        critics.advantage,
        actors.policy,
        actors.loss,
        actors.entropy,
        actors.pi_max,
        actors.clip_fraction,
        actors.approx_kl,
        *actor_gradient,
    ]
    .map(Some)
    .to_vec();
    for predictor in predictors {
        values.push(predictor.as_ref().map(|losses| losses.loss));
        values.push(predictor.as_ref().map(|losses| losses.nll));
        values.push(predictor.as_ref().map(|losses| losses.gradient));
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn running_mean_and_deviation_worked_by_hand() {
        let mut running = Running::default();
        assert_eq!((running.mean(), running.std()), (None, None));
        [1.0, 2.0, 3.0, 4.0].into_iter().for_each(|value| running.push(value));
        assert_eq!(running.mean(), Some(2.5));
        assert_eq!(running.std(), Some((5.0f64 / 3.0).sqrt()));
    }
}
