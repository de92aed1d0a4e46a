//! How much each of several beliefs about a world counts.

/// The weights of beliefs: how well each explained what was seen.
///
/// Once few of them carry most of the weight, the others are replaced by copies of these: systematic resampling, as in a
/// particle filter.
#[derive(Debug)]
pub(super) struct Weights {
    n_beliefs: usize,
    /// The logarithms of the weights, `[worlds, n_beliefs]`.
    logs: Vec<f64>,
    /// Where each world's resampling starts, on `[0, 1)`, `[worlds]`.
    starts: Vec<f64>,
    /// The weights in one world; their sum is one.
    shares: Vec<f64>,
    /// How many there will be of each belief about one world.
    counts: Vec<usize>,
}

impl Weights {
    pub(super) fn new(worlds: usize, n_beliefs: usize) -> Weights {
        Weights {
            n_beliefs,
            logs: vec![0.0; worlds * n_beliefs],
            starts: vec![0.0; worlds],
            shares: vec![0.0; n_beliefs],
            counts: vec![0; n_beliefs],
        }
    }

    /// All beliefs count alike.
    pub(super) fn begin_episodes(&mut self) {
        self.logs.fill(0.0);
    }

    /// The draw on `[0, 1)` by which beliefs about a world are resampled next.
    pub(super) fn set_start(&mut self, world: usize, start: f64) {
        self.starts[world] = start;
    }

    /// Takes in how likely a belief, by its row, took what was seen: the logarithm.
    pub(super) fn weigh(&mut self, row: usize, log_likelihood: f64) {
        self.logs[row] += log_likelihood;
    }

    /// The weight of each belief about a world.
    pub(super) fn shares(&mut self, world: usize) -> &[f64] {
        let logs = &mut self.logs[world * self.n_beliefs..][..self.n_beliefs];
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        logs.iter_mut().for_each(|log| *log -= largest);
        self.shares.iter_mut().zip(logs.iter()).for_each(|(share, log)| *share = log.exp());
        let sum: f64 = self.shares.iter().sum();
        self.shares.iter_mut().for_each(|share| *share /= sum);
        &self.shares
    }

    /// Which rows of a world to copy where, from and to, so that all beliefs count alike again. Nothing as long as no few
    /// carry most of the weight.
    pub(super) fn resample(&mut self, world: usize) -> impl Iterator<Item = (usize, usize)> {
        self.shares(world);
        let Weights { n_beliefs, logs, starts, shares, counts } = self;
        let effective = 1.0 / shares.iter().map(|share| share * share).sum::<f64>();
        counts.fill(1);
        if effective < *n_beliefs as f64 / 2.0 {
            let (mut before, mut sum) = (0, 0.0);
            for (share, count) in shares.iter().zip(counts.iter_mut()) {
                sum += share;
                let until = (sum * *n_beliefs as f64 - starts[world]).ceil().clamp(0.0, *n_beliefs as f64);
                *count = until as usize - before;
                before = until as usize;
            }
            // Only rounding leaves one over.
            *counts.last_mut().expect("there is a belief") += *n_beliefs - before;
            logs[world * *n_beliefs..][..*n_beliefs].fill(0.0);
        }
        let first = world * *n_beliefs;
        let free = (0..*n_beliefs).filter(|at| counts[*at] == 0);
        let copied = counts
            .iter()
            .enumerate()
            .flat_map(|(at, count)| std::iter::repeat_n(at, count.saturating_sub(1)));
        copied.zip(free).map(move |(from, to)| (first + from, first + to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beliefs_that_explain_nothing_give_way_to_those_that_do() {
        let mut weights = Weights::new(2, 4);
        weights.begin_episodes();
        assert_eq!(weights.shares(1), [0.25; 4]);
        assert_eq!(weights.resample(1).count(), 0);
        for (row, likelihood) in [(4, 0.5f64), (5, 0.02), (6, 0.46), (7, 0.02)] {
            weights.weigh(row, likelihood.ln());
        }
        let shares = weights.shares(1).to_vec();
        assert!((shares[0] - 0.5).abs() < 1e-12 && (shares[3] - 0.02).abs() < 1e-12, "{shares:?}");
        // 1 / (0.25 + 0.21) = 2.2 beliefs count: enough.
        assert_eq!(weights.resample(1).count(), 0);
        weights.weigh(6, 1.0);
        weights.set_start(1, 0.5);
        let copies: Vec<_> = weights.resample(1).collect();
        assert_eq!(copies, [(6, 5), (6, 7)]);
        assert_eq!(weights.shares(1), [0.25; 4]);
        assert_eq!(weights.shares(0), [0.25; 4], "another world");
    }
}
