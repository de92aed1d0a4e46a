//! Means of values that count so often each, as many in all as there are values.

/// Mean of values with their counts. Eight sums at a time: here and in [`Ordered::iqm`] is where the time goes.
pub(super) fn weighted_mean(values: &[f64], counts: &[f64]) -> f64 {
    assert_eq!(values.len(), counts.len(), "every cell has as many episodes");
    let (values_by_8, values_left) = values.as_chunks::<8>();
    let (counts_by_8, counts_left) = counts.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (values, counts) in values_by_8.iter().zip(counts_by_8) {
        for ((sum, value), count) in sums.iter_mut().zip(values).zip(counts) {
            *sum += value * count;
        }
    }
    let left: f64 = values_left.iter().zip(counts_left).map(|(value, count)| value * count).sum();
    (sums.iter().sum::<f64>() + left) / values.len() as f64
}

/// Values in order, each of which counts as often as the unit it comes from.
pub(super) struct Ordered {
    values: Vec<f64>,
    /// The unit of each.
    units: Vec<usize>,
}

impl Ordered {
    /// Values with their units.
    pub fn new(values: impl Iterator<Item = (usize, f64)>) -> Ordered {
        let mut values: Vec<_> = values.collect();
        values.sort_by(|(_, a), (_, b)| a.total_cmp(b));
        let (units, values) = values.into_iter().unzip();
        Ordered { values, units }
    }

    /// Mean without the lowest and the highest `floor(n / 4)` of the n values, as rliable computes it
    /// (`scipy.stats.trim_mean` at 0.25).
    pub fn iqm(&self, counts: &[f64]) -> f64 {
        let cut = (self.values.len() / 4) as f64;
        let (low, high) = (cut, self.values.len() as f64 - cut);
        let (mut rank, mut inside, mut sum) = (0.0, low, 0.0);
        for (value, unit) in self.values.iter().zip(&self.units) {
            rank += counts[*unit];
            let reached = f64::clamp(rank, low, high);
            sum += value * (reached - inside);
            inside = reached;
        }
        sum / (high - low)
    }
}

/// A difference as a share of the baseline's return without its sign: infinite if that is zero and the difference
/// is not.
pub(super) fn relative(difference: f64, baseline: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / baseline.abs() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn iqm(values: &[f64]) -> f64 {
        Ordered::new(values.iter().copied().enumerate()).iqm(&vec![1.0; values.len()])
    }

    #[test]
    fn a_quarter_is_cut_off_at_each_end_rounded_down() {
        // floor(8 / 4) = 2: the mean of 3, 4, 5, 6.
        assert_eq!(iqm(&[100.0, 5.0, 3.0, 4.0, -100.0, 6.0, 2.0, 7.0]), 4.5);
        // floor(7 / 4) = 1, floor(3 / 4) = 0.
        assert_eq!(iqm(&[100.0, 1.0, 2.0, 3.0, 4.0, 5.0, -100.0]), 3.0);
        assert_eq!(iqm(&[1.0, 2.0, 6.0]), 3.0);
        assert_eq!(iqm(&[7.0]), 7.0);
    }

    #[test]
    fn means_of_any_number_of_values() {
        // 0 + 1 + .. + (n - 1) over n; with the first twice and the last never, (n - 1) less.
        for n in [1, 2, 7, 8, 9, 16, 29] {
            let values: Vec<f64> = (0..n).map(f64::from).collect();
            let mut counts = vec![1.0; values.len()];
            assert_eq!(weighted_mean(&values, &counts), f64::from(n - 1) / 2.0);
            counts[0] += 1.0;
            counts[values.len() - 1] -= 1.0;
            let expected = f64::from((n - 1) * (n - 2)) / 2.0 / f64::from(n);
            assert!((weighted_mean(&values, &counts) - expected).abs() < 1e-12, "{n} values");
        }
    }

    #[test]
    fn counts_are_repetitions() {
        // 1, 2, 2, 2, 9, 9, 9, 9 without two at each end: 2, 2, 9, 9. The units are not in order.
        let ordered = Ordered::new([(4, 9.0), (0, 0.0), (3, 2.0), (1, 1.0), (2, 1.5)].into_iter().chain([
            (5, 3.0),
            (6, 4.0),
            (7, 5.0),
        ]));
        assert_eq!(ordered.iqm(&[0.0, 1.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0]), 22.0 / 4.0);
    }
}
