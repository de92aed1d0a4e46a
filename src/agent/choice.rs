//! Choosing an action by what an actor says.

use crate::base::rng::{Draws, Purpose};
use crate::environment::ActionSpace;

/// Writes the action that an agent with this `space` chooses, to as many words as there are: by logits, or by the means and
/// log-stds of its values. It follows from the `draw` from [0, 1), unless the most probable one is taken.
pub(crate) fn choose(space: &ActionSpace, said: &[f32], draw: f64, greedy: bool, words: &mut [u32]) {
    match space {
        ActionSpace::Discrete(available) => {
            let logits = &said[..*available];
            words[0] = if greedy { most_probable(logits) } else { sample(logits, draw) } as u32;
        }
        ActionSpace::Box { low, high } => {
            let (means, log_stds) = said.split_at(low.len());
            let mut draws = Draws::new(draw.to_bits(), Purpose::Action, 0, 0);
            let values = means.iter().zip(log_stds).zip(low.iter().zip(high));
            for (word, ((mean, log_std), (low, high))) in words.iter_mut().zip(values) {
                let off = if greedy { 0.0 } else { draws.normal().x * f64::from(*log_std).exp() };
                *word = ((f64::from(*mean) + off) as f32).clamp(*low, *high).to_bits();
            }
        }
    }
}

/// The first of the largest logits.
pub(crate) fn most_probable(logits: &[f32]) -> usize {
    (1..logits.len()).fold(0, |best, i| if logits[i] > logits[best] { i } else { best })
}

/// Samples from softmax(logits) by inversion: the action whose share of [0, 1) u falls into.
pub(crate) fn sample(logits: &[f32], u: f64) -> usize {
    let largest = f64::from(logits[most_probable(logits)]);
    let weight = |logit: &f32| (f64::from(*logit) - largest).exp();
    let mut left = u * logits.iter().map(weight).sum::<f64>();
    for (action, logit) in logits.iter().enumerate() {
        left -= weight(logit);
        if left < 0.0 {
            return action;
        }
    }
    // Only rounding leads here.
    most_probable(logits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_sampled_by_their_probability() {
        let probabilities = [0.5f64, 0.0, 0.3, 0.2];
        let logits = probabilities.map(|p| p.ln() as f32);
        let n = 10_000;
        let mut counts = [0; 4];
        (0..n).for_each(|i| counts[sample(&logits, (i as f64 + 0.5) / n as f64)] += 1);
        for (count, p) in counts.into_iter().zip(probabilities) {
            assert!((f64::from(count) / n as f64 - p).abs() < 1e-3, "{counts:?}");
        }
    }

    #[test]
    fn values_are_drawn_around_their_means_and_stay_within_bounds() {
        let space = ActionSpace::Box { low: vec![-1.0, -1.0], high: vec![1.0, 1.0] };
        let said = [0.25, 5.0, -3.0, 0.0];
        let chosen = |draw, greedy| {
            let mut words = [0; 2];
            choose(&space, &said, draw, greedy, &mut words);
            assert!(space.contains(&words));
            words.map(f32::from_bits)
        };
        assert_eq!(chosen(0.5, true), [0.25, 1.0]);
        let n = 2000;
        let off: Vec<f64> =
            (0..n).map(|at| f64::from(chosen(f64::from(at) / f64::from(n), false)[0]) - 0.25).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let std = (off.iter().map(|off| off * off).sum::<f64>() / off.len() as f64).sqrt();
        assert!(mean.abs() < 0.005 && (std / (-3.0_f64).exp() - 1.0).abs() < 0.1, "{mean}, {std}");
    }

    #[test]
    fn greedy_takes_the_first_of_the_largest() {
        assert_eq!(most_probable(&[0.0, 2.0, -1.0, 2.0]), 1);
    }
}
