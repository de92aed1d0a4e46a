//! Choosing among actions by logits.

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
    fn greedy_takes_the_first_of_the_largest() {
        assert_eq!(most_probable(&[0.0, 2.0, -1.0, 2.0]), 1);
    }
}
