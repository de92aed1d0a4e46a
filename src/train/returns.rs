//! From rewards and values to returns.

use super::settings::Estimator;

/// Shifts and scales rewards to mean 0 and (unbiased) standard deviation 1.
pub(super) fn standardise(rewards: &mut [f32]) {
    let n = rewards.len() as f64;
    let mean = rewards.iter().map(|&r| f64::from(r)).sum::<f64>() / n;
    let variance = rewards.iter().map(|&r| (f64::from(r) - mean).powi(2)).sum::<f64>() / (n - 1.0);
    // A single reward has no deviation from its mean, and is 0.
    let deviation = if n > 1.0 { variance.sqrt() } else { 0.0 };
    rewards.iter_mut().for_each(|r| *r = ((f64::from(*r) - mean) / (deviation + 1e-5)) as f32);
}

/// The returns `[T, rows]` that follow from `rewards` `[T, rows / agents]` and the values `[T + 1, rows]` of the
/// target critic, with rows ordered by episode and then agent.
///
/// Episodes end because time is up and not because nothing is left to earn: beyond the end stands a value,
/// never a zero.
pub(super) fn returns(
    estimator: Estimator,
    gamma: f64,
    rewards: &[f32],
    values: &[f32],
    agents: usize,
    returns: &mut [f32],
) {
    let rows = values.len() - returns.len();
    let steps = returns.len() / rows;
    let reward = |step: usize, row: usize| f64::from(rewards[(step * rows + row) / agents]);
    let value = |step: usize, row: usize| f64::from(values[step * rows + row]);
    for row in 0..rows {
        match estimator {
            // The paper's code takes the value of the last step itself and drops that step's reward.
            Estimator::Steps(n) => {
                for step in 0..steps {
                    let end = (step + n).min(steps - 1);
                    let rest = value(end, row);
                    let sum = (step..end).rev().fold(rest, |rest, at| reward(at, row) + gamma * rest);
                    returns[step * rows + row] = sum as f32;
                }
            }
            Estimator::Gae(lambda) => {
                let mut rest = value(steps, row);
                for step in (0..steps).rev() {
                    rest =
                        reward(step, row) + gamma * ((1.0 - lambda) * value(step + 1, row) + lambda * rest);
                    returns[step * rows + row] = rest as f32;
                }
            }
        }
    }
}
