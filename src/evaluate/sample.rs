//! What a sample of episodes says of a group: the few numbers that all its statistics are functions of.

use super::grouping::{Alike, Played};
use super::weighted::{Ordered, weighted_mean};

/// A group in one sample of episodes.
pub(super) struct Sample {
    /// Mean return of the random team; NaN if it was not played.
    random: f64,
    /// Cell by cell.
    cells: Vec<CellSample>,
}

/// One condition with one imputer.
struct CellSample {
    /// Mean return of each contender that played it.
    means: Vec<Option<f64>>,
    /// Interquartile mean of all their returns.
    iqm: f64,
    /// Share of episodes that are better than with the baseline.
    improvement: Option<f64>,
}

impl Sample {
    /// Mean return of the random team.
    pub fn random(&self) -> f64 {
        self.random
    }

    /// Mean returns of the contenders that played the cell.
    pub fn means(&self, cell: usize) -> Vec<f64> {
        self.cells[cell].means.iter().flatten().copied().collect()
    }

    /// The same of two cells, of those contenders that played both.
    pub fn paired_means(&self, cell: usize, other: usize) -> (Vec<f64>, Vec<f64>) {
        let pairs = self.cells[cell].means.iter().zip(&self.cells[other].means);
        pairs.filter_map(|(one, other)| one.zip(*other)).unzip()
    }

    /// Interquartile mean of the returns of a cell.
    pub fn iqm(&self, cell: usize) -> f64 {
        self.cells[cell].iqm
    }

    /// Share of episodes that go better than with the baseline, ties half; `None` if there is no comparison.
    pub fn improvement(&self, cell: usize) -> Option<f64> {
        self.cells[cell].improvement
    }

    /// Score of each contender that played both the cell and the one where everything is delivered. `None` if
    /// there is none, or one of them is no better than the random team when everything is delivered: then there
    /// is nothing to lose.
    pub fn scores(&self, cell: usize, lossless: usize) -> Option<Vec<f64>> {
        let (means, best) = self.paired_means(cell, lossless);
        let score = |(mean, best): (&f64, f64)| {
            (best > self.random).then(|| (mean - self.random) / (best - self.random))
        };
        let scores = means.iter().zip(best).map(score).collect::<Option<Vec<f64>>>()?;
        (!scores.is_empty()).then_some(scores)
    }
}

/// A group, arranged for looking at many samples.
pub(super) struct Sampler<'a> {
    random: &'a [f64],
    cells: Vec<CellSampler<'a>>,
}

struct CellSampler<'a> {
    returns: Vec<Option<&'a [f64]>>,
    ordered: Ordered,
    /// For each episode, the share of contenders for which it is better than with the baseline.
    better: Option<Vec<f64>>,
}

impl<'a> Sampler<'a> {
    /// Of a group that is compared with this imputer.
    pub fn new(group: &Alike<'a>, baseline: Option<&str>) -> Sampler<'a> {
        let cell = |played: &Played<'a>| {
            let others = baseline.filter(|name| *name != played.imputer && !played.condition.is_lossless());
            let baseline = others.and_then(|name| group.find(name, played.condition));
            let returns = played.returns();
            let pooled = returns.iter().flatten().flat_map(|returns| returns.iter().copied().enumerate());
            let ordered = Ordered::new(pooled);
            let better = baseline.and_then(|baseline| better(&returns, &group.cells[baseline].returns()));
            CellSampler { returns, ordered, better }
        };
        Sampler { random: group.random, cells: group.cells.iter().map(cell).collect() }
    }

    /// The sample in which each episode counts so often.
    pub fn sample(&self, counts: &[f64]) -> Sample {
        let mean = |values: &[f64]| weighted_mean(values, counts);
        let cell = |cell: &CellSampler| CellSample {
            means: cell.returns.iter().map(|returns| returns.map(mean)).collect(),
            iqm: cell.ordered.iqm(counts),
            improvement: cell.better.as_deref().map(mean),
        };
        let random = if self.random.is_empty() { f64::NAN } else { mean(self.random) };
        Sample { random, cells: self.cells.iter().map(cell).collect() }
    }
}

impl<'a> Played<'a> {
    fn returns(&self) -> Vec<Option<&'a [f64]>> {
        self.outcomes.iter().map(|outcome| outcome.map(|outcome| &outcome.returns[..])).collect()
    }
}

/// For each episode, the share of contenders for which it is better, ties half; `None` if none played both.
fn better(returns: &[Option<&[f64]>], baseline: &[Option<&[f64]>]) -> Option<Vec<f64>> {
    let pairs: Vec<_> =
        returns.iter().zip(baseline).filter_map(|(returns, baseline)| returns.zip(*baseline)).collect();
    let points = |(returns, baseline): &(&[f64], &[f64]), episode: usize| {
        let difference = returns[episode] - baseline[episode];
        if difference > 0.0 {
            1.0
        } else if difference == 0.0 {
            0.5
        } else {
            0.0
        }
    };
    let share = |episode| pairs.iter().map(|pair| points(pair, episode)).sum::<f64>() / pairs.len() as f64;
    Some((0..pairs.first()?.0.len()).map(share).collect())
}
