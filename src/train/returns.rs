//! From rewards and values to returns.

use super::ends::Ends;
use super::settings::Estimator;

/// Shifts and scales the rewards `[T, E]` of the steps played to mean 0 and (unbiased) standard deviation 1.
pub(super) fn standardise(rewards: &mut [f32], ends: &Ends) {
    let n = ends.steps_played() as f64;
    let played = || ends.of_played(rewards.iter()).map(|&r| f64::from(r));
    let mean = played().sum::<f64>() / n;
    let variance = played().map(|r| (r - mean).powi(2)).sum::<f64>() / (n - 1.0);
    // A single reward has no deviation from its mean, and is 0.
    let deviation = if n > 1.0 { variance.sqrt() } else { 0.0 };
    rewards.iter_mut().for_each(|r| *r = ((f64::from(*r) - mean) / (deviation + 1e-5)) as f32);
}

/// The returns `[T, rows]` that follow from `rewards` `[T, rows / agents]` and the values `[T + 1, rows]` of the
/// target critic, with rows ordered by episode and then agent. Those behind an episode's end are left as they are.
///
/// Beyond the end of a truncated episode stands a value, never a zero: something was left to earn. Beyond that of a
/// terminated one stands nothing.
pub(super) fn returns(
    estimator: Estimator,
    gamma: f64,
    rewards: &[f32],
    values: &[f32],
    ends: &Ends,
    agents: usize,
    returns: &mut [f32],
) {
    let rows = values.len() - returns.len();
    let reward = |step: usize, row: usize| f64::from(rewards[(step * rows + row) / agents]);
    for row in 0..rows {
        let (steps, valued) = (ends.lengths()[row / agents], ends.valued(row / agents));
        let value = |step: usize| if step < valued { f64::from(values[step * rows + row]) } else { 0.0 };
        match estimator {
            Estimator::Steps(n) => {
                // The paper's code takes the value of the last step itself and drops that step's reward, where time is
                // up. Where the world ends, the last reward is all that there is.
                let last = if valued > steps { steps - 1 } else { steps };
                for step in 0..steps {
                    let end = (step + n).min(last);
                    let sum = (step..end).rev().fold(value(end), |rest, at| reward(at, row) + gamma * rest);
                    returns[step * rows + row] = sum as f32;
                }
            }
            Estimator::Gae(lambda) => {
                let mut rest = value(steps);
                for step in (0..steps).rev() {
                    rest = reward(step, row) + gamma * ((1.0 - lambda) * value(step + 1) + lambda * rest);
                    returns[step * rows + row] = rest as f32;
                }
            }
        }
    }
}
