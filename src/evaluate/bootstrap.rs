//! Bootstrap: how far an estimate would have been off with other episodes.

use super::summary::Interval;
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::base::stats::quantile;
use crate::base::threads::side_by_side;
use crate::supervisor::signals;

/// Resamples behind every interval.
pub(super) const RESAMPLES: usize = 2000;

/// What was seen in the sample itself, and in each resample.
pub(super) struct Bootstrap<S> {
    /// In the sample as it is.
    pub estimate: S,
    resamples: Vec<S>,
}

/// Units that are drawn from among themselves, with replacement.
#[derive(Clone, Copy)]
pub(super) struct Stratum {
    /// Part of the address of its draws.
    pub number: u64,
    /// Its units.
    pub len: usize,
}

impl Stratum {
    /// The episodes of an evaluation. All cells of all tasks get the same resamples of them.
    pub fn episodes(len: usize) -> Stratum {
        Stratum { number: 0, len }
    }

    /// The runs of a task, which is the `task`-th of the evaluation.
    pub fn runs(task: usize, len: usize) -> Stratum {
        Stratum { number: 1 + task as u64, len }
    }

    /// How often each unit is in a resample.
    fn counts(self, seed: u64, resample: usize) -> Vec<f64> {
        let mut draws = Draws::new(seed, Purpose::Bootstrap, self.number, resample as u64);
        let mut counts = vec![0.0; self.len];
        (0..self.len).for_each(|_| counts[draws.below(self.len)] += 1.0);
        counts
    }
}

impl<S: Send> Bootstrap<S> {
    /// Has `look` reduce the sample and every resample to what matters of it. It is told how often each unit
    /// counts, stratum by stratum: once in the sample.
    ///
    /// # Errors
    /// `Interrupted` if the program was asked to stop.
    pub fn new(
        seed: u64,
        strata: &[Stratum],
        threads: usize,
        look: impl Fn(&[f64]) -> S + Sync,
    ) -> Result<Bootstrap<S>> {
        let units = strata.iter().map(|stratum| stratum.len).sum();
        let mut resamples: Vec<Option<S>> = (0..RESAMPLES).map(|_| None).collect();
        side_by_side(threads, resamples.iter_mut().enumerate(), |(resample, seen)| {
            if signals::check_stop().is_err() {
                return;
            }
            let counts: Vec<f64> = strata.iter().flat_map(|stratum| stratum.counts(seed, resample)).collect();
            *seen = Some(look(&counts));
        });
        signals::check_stop()?;
        let resamples = resamples.into_iter().map(|seen| seen.expect("every resample was looked at"));
        Ok(Bootstrap { estimate: look(&vec![1.0; units]), resamples: resamples.collect() })
    }

    /// A statistic with its 95 % percentile interval.
    pub fn interval(&self, statistic: impl Fn(&S) -> f64) -> Interval {
        self.interval_if(|seen| Some(statistic(seen))).expect("the statistic is always defined")
    }

    /// The same of a statistic that may be undefined; `None` if it is in the sample or in any resample.
    pub fn interval_if(&self, statistic: impl Fn(&S) -> Option<f64>) -> Option<Interval> {
        let value = statistic(&self.estimate)?;
        let mut values = self.resamples.iter().map(statistic).collect::<Option<Vec<f64>>>()?;
        values.sort_unstable_by(f64::total_cmp);
        Some(Interval { value, low: quantile(&values, 0.025), high: quantile(&values, 0.975) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resample_is_as_large_as_the_sample_stratum_by_stratum() {
        let strata = [Stratum::episodes(5), Stratum::runs(0, 3)];
        let bootstrap = Bootstrap::new(7, &strata, 1, <[f64]>::to_vec).unwrap();
        assert_eq!(bootstrap.estimate, [1.0; 8]);
        assert_eq!(bootstrap.resamples.len(), RESAMPLES);
        let mut totals = [0.0; 8];
        for counts in &bootstrap.resamples {
            assert_eq!(counts[..5].iter().sum::<f64>(), 5.0);
            assert_eq!(counts[5..].iter().sum::<f64>(), 3.0);
            totals.iter_mut().zip(counts).for_each(|(total, count)| *total += count);
        }
        // Every unit is expected once per resample; the variance of a count is 1 - 1 / 5 at most.
        assert!(totals.iter().all(|total| (total / RESAMPLES as f64 - 1.0).abs() < 0.08), "{totals:?}");
    }

    #[test]
    fn resamples_do_not_depend_on_threads() {
        let resamples =
            |threads| Bootstrap::new(3, &[Stratum::episodes(9)], threads, <[f64]>::to_vec).unwrap().resamples;
        assert_eq!(resamples(1), resamples(4));
    }

    #[test]
    fn an_interval_of_one_of_two_values() {
        // Of two episodes, 0 and 1, a resample has mean 0, 1/2 or 1 with probability 1/4, 1/2, 1/4.
        let bootstrap = Bootstrap::new(1, &[Stratum::episodes(2)], 1, |counts| counts[1] / 2.0).unwrap();
        assert_eq!(bootstrap.interval(|mean| *mean), Interval { value: 0.5, low: 0.0, high: 1.0 });
        assert_eq!(bootstrap.interval_if(|mean| (*mean > 0.0).then_some(1.0)), None);
        assert_eq!(bootstrap.interval_if(|_| None), None);
    }
}
