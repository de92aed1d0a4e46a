//! How well a swarm in real time keeps to its clock.

use crate::base::distribution::Distribution;

/// How punctual the periods of a swarm were, and its agents in them.
#[derive(Clone, Debug)]
pub struct Punctuality {
    /// Periods a second that were asked for.
    pub rate: f64,
    /// Periods left out because their deadlines passed before they could begin: the supervisor was late. The worlds
    /// stand still in them.
    pub skipped: u64,
    /// How late the supervisor was for the next period, which it left out if that was more than half of one.
    pub begins: Distribution,
    /// When the agents' actions were out, after the deadline of the observations; only of those in time.
    pub acts: Distribution,
    /// Ticks in which each agent did not decide in time.
    pub missed: Vec<u64>,
    /// The beginning of the first period, and the end of the last.
    span_ns: Option<(u64, u64)>,
}

impl Punctuality {
    pub(super) fn new(rate: f64, agents: usize) -> Punctuality {
        let (begins, acts) = (Distribution::default(), Distribution::default());
        Punctuality { rate, skipped: 0, begins, acts, missed: vec![0; agents], span_ns: None }
    }

    /// Notes by how many nanoseconds the supervisor was late for a period, and how many periods it left out for that.
    pub(super) fn late(&mut self, late_ns: u64, skipped: u64) {
        self.begins.record(late_ns);
        self.skipped += skipped;
    }

    /// Notes the period that is played next, in nanoseconds of the monotonic clock.
    pub(super) fn played(&mut self, begins_ns: u64, ends_ns: u64) {
        let (first, _) = self.span_ns.unwrap_or((begins_ns, ends_ns));
        self.span_ns = Some((first, ends_ns));
    }

    /// The agent that missed most ticks, and how many; `None` if nobody missed any.
    pub fn slowest(&self) -> Option<(usize, u64)> {
        let missed = self.missed.iter().copied().enumerate();
        // The first of several.
        missed.rev().max_by_key(|(_, missed)| *missed).filter(|(_, missed)| *missed > 0)
    }

    /// The share of periods that were left out; NaN before the first.
    pub fn skipped_rate(&self) -> f64 {
        self.skipped as f64 / (self.skipped + self.begins.count()) as f64
    }

    /// Periods a second that were played; NaN before the first.
    pub fn achieved_rate(&self) -> f64 {
        let span = self.span_ns.map_or(f64::NAN, |(first, last)| (last - first) as f64 / 1e9);
        self.begins.count() as f64 / span
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_periods_played() {
        let mut punctuality = Punctuality::new(1000.0, 3);
        assert!(punctuality.achieved_rate().is_nan());
        punctuality.late(100, 0);
        punctuality.played(5_000_000, 6_000_000);
        assert_eq!(punctuality.achieved_rate(), 1000.0);
        punctuality.late(2_000_000, 2);
        punctuality.played(8_000_000, 9_000_000);
        assert_eq!(punctuality.achieved_rate(), 500.0);
        assert_eq!(punctuality.slowest(), None);
        punctuality.missed = vec![1, 4, 4];
        assert_eq!(punctuality.slowest(), Some((1, 4)));
        assert_eq!((punctuality.begins.quantile_us(0.5), punctuality.skipped_rate()), (0.1, 0.5));
    }
}
