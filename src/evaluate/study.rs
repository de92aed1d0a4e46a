//! A group of an evaluation and the statistics of it.

use super::axis::Axis;
use super::bootstrap::{Bootstrap, Stratum};
use super::curve::{lowest_p, mean_height};
use super::evaluation::UnitErrors;
use super::grouping::{Alike, Played, distinct};
use super::sample::{Sample, Sampler};
use super::summary::{CellSummary, Comparison, Explained, Group, ImputerSummary, Interval, Loss};
use super::weighted::relative;
use crate::agent::Truth;
use crate::base::error::Result;
use crate::base::stats::{mean, std};

/// A group and its samples.
pub(super) struct Study<'a> {
    /// The group.
    pub group: Alike<'a>,
    /// The imputer that others are compared with, if the group was played with it.
    baseline: Option<&'a str>,
    /// What was seen in them.
    pub bootstrap: Bootstrap<Sample>,
}

impl<'a> Study<'a> {
    /// Its samples, in so many threads.
    pub(super) fn new(
        group: Alike<'a>,
        baselines: &[&'a str],
        seed: u64,
        episodes: Stratum,
        threads: usize,
    ) -> Result<Study<'a>> {
        let played = |name: &&str| {
            let mut of = group.cells.iter().filter(|cell| cell.imputer == *name).peekable();
            of.peek().is_some() && of.all(|cell| cell.outcomes.iter().all(Option::is_some))
        };
        let baseline = baselines.iter().copied().find(played);
        let sampler = Sampler::new(&group, baseline);
        let bootstrap = Bootstrap::new(seed, &[episodes], threads, |counts| sampler.sample(counts))?;
        Ok(Study { group, baseline, bootstrap })
    }

    /// Scores of the contenders in a cell; `None` unless every resample has them.
    pub fn scores(&self, cell: usize) -> Option<Vec<f64>> {
        let lossless = self.lossless(cell)?;
        self.score(cell)?;
        self.bootstrap.estimate.scores(cell, lossless)
    }

    /// What is said of it, where conditions are on these axes.
    pub(super) fn summary(&self, axes: &[Axis]) -> Group {
        let Alike { task, label, contenders, cells, .. } = &self.group;
        let imputers = distinct(cells.iter().map(|cell| cell.imputer));
        Group {
            task: task.to_string(),
            label: label.clone(),
            contenders: contenders.clone(),
            random: self.bootstrap.interval(Sample::random),
            baseline: self.baseline.map(str::to_owned),
            imputers: imputers.into_iter().map(|imputer| self.imputer(imputer)).collect(),
            losses: (0..cells.len()).filter_map(|cell| self.losses(cell)).collect(),
            profiles: self.profiles(axes),
        }
    }

    fn imputer(&self, imputer: &str) -> ImputerSummary {
        let cells: Vec<usize> =
            (0..self.group.cells.len()).filter(|at| self.group.cells[*at].imputer == imputer).collect();
        let level = |at: &usize| self.group.cells[*at].condition.p().map(|p| (p, *at));
        let mut levels: Vec<(f64, usize)> = cells.iter().filter_map(level).collect();
        levels.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let returns = |sample: &Sample| -> Vec<(f64, f64)> {
            levels.iter().map(|(p, cell)| (*p, mean(&sample.means(*cell)))).collect()
        };
        let scores = |sample: &Sample| -> Option<Vec<(f64, f64)>> {
            let score = |cell| Some(mean(&sample.scores(cell, self.lossless(cell)?)?));
            levels.iter().map(|(p, cell)| Some((*p, score(*cell)?))).collect()
        };
        let bootstrap = &self.bootstrap;
        ImputerSummary {
            imputer: imputer.to_owned(),
            cells: cells.iter().map(|cell| self.cell(*cell)).collect(),
            return_area: bootstrap.interval_if(|sample| mean_height(&returns(sample))),
            score_area: bootstrap.interval_if(|sample| mean_height(&scores(sample)?)),
            p_for_90: bootstrap.interval_if(|sample| lowest_p(&scores(sample)?, 0.9)),
            errors: self.errors(&levels),
        }
    }

    fn cell(&self, cell: usize) -> CellSummary {
        let seed_means = self.bootstrap.estimate.means(cell);
        CellSummary {
            condition: self.group.cells[cell].condition.clone(),
            seed_std: std(&seed_means),
            mean: self.bootstrap.interval(|sample| mean(&sample.means(cell))),
            iqm: self.bootstrap.interval(|sample| sample.iqm(cell)),
            score: self.score(cell),
            comparison: self.comparison(cell),
            seed_means,
        }
    }

    fn score(&self, cell: usize) -> Option<Interval> {
        let lossless = self.lossless(cell)?;
        self.bootstrap.interval_if(|sample| sample.scores(cell, lossless).map(|scores| mean(&scores)))
    }

    /// What the imputer of a cell loses there, and what oracles that take it for the rest have to say of that.
    fn losses(&self, cell: usize) -> Option<Loss> {
        let Played { imputer, condition, .. } = self.group.cells[cell];
        let oracles =
            self.group.cells.iter().enumerate().filter_map(|(at, other)| match Truth::split(other.imputer) {
                (base, Some(truth)) if base == imputer && other.condition == condition => Some((truth, at)),
                _ => None,
            });
        let oracles: Vec<(Truth, usize)> = oracles.collect();
        let lossless = self.lossless(cell).filter(|_| !oracles.is_empty() && !condition.is_lossless())?;
        let score = |sample: &Sample, cell| sample.scores(cell, lossless).map(|scores| mean(&scores));
        let loss = |sample: &Sample| Some(1.0 - score(sample, cell)?);
        let explained = |(truth, oracle): (Truth, usize)| {
            let gain = |sample: &Sample| Some(score(sample, oracle)? - score(sample, cell)?);
            let share = |sample: &Sample| {
                let loss = loss(sample).filter(|loss| *loss > 0.0)?;
                Some(gain(sample)? / loss)
            };
            let bootstrap = &self.bootstrap;
            Some(Explained { truth, gain: bootstrap.interval_if(gain)?, share: bootstrap.interval_if(share) })
        };
        Some(Loss {
            imputer: imputer.to_owned(),
            condition: condition.clone(),
            loss: self.bootstrap.interval_if(loss)?,
            explained: oracles.into_iter().filter_map(explained).collect(),
        })
    }

    fn comparison(&self, cell: usize) -> Option<Comparison> {
        let probability_of_improvement = self.bootstrap.interval_if(|sample| sample.improvement(cell))?;
        let baseline = self.group.find(self.baseline?, self.group.cells[cell].condition)?;
        let difference = self.bootstrap.interval(|sample| {
            let (own, others) = sample.paired_means(cell, baseline);
            mean(&own) - mean(&others)
        });
        let (own, others) = self.bootstrap.estimate.paired_means(cell, baseline);
        let ratio = |(own, others): (f64, f64)| (others > 0.0).then(|| own / others);
        Some(Comparison {
            difference,
            relative: relative(difference.value, mean(&others)),
            probability_of_improvement,
            std_ratio: std(&own).zip(std(&others)).and_then(ratio),
        })
    }

    /// Errors in these cells, of all contenders, where anything can be lost.
    fn errors(&self, levels: &[(f64, usize)]) -> Vec<UnitErrors> {
        let mut pooled: Vec<UnitErrors> = Vec::new();
        let lossy = levels
            .iter()
            .map(|(_, cell)| &self.group.cells[*cell])
            .filter(|cell| !cell.condition.is_lossless());
        for errors in lossy.flat_map(|cell| &cell.outcomes).flatten().flat_map(|outcome| &outcome.errors) {
            let Some(own) = pooled.iter_mut().find(|own| own.unit == errors.unit) else {
                pooled.push(errors.clone());
                continue;
            };
            own.ages.resize_with(own.ages.len().max(errors.ages.len()), Default::default);
            own.ages.iter_mut().zip(&errors.ages).for_each(|(own, errors)| own.add(errors));
        }
        pooled
    }

    /// The cell of the same imputer where everything is delivered.
    pub(super) fn lossless(&self, cell: usize) -> Option<usize> {
        let imputer = self.group.cells[cell].imputer;
        self.group.cells.iter().position(|cell| cell.imputer == imputer && cell.condition.is_lossless())
    }
}
