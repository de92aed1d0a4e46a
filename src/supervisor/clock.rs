//! The clock of a swarm in real time.

use super::Punctuality;
use crate::bus::now_ns;

/// Periods one after the other. Each begins a whole number of periods after the first one, so that lateness never adds
/// up: a period is left out if its deadline has passed before it could begin.
#[derive(Debug)]
pub(super) struct Clock {
    rate: f64,
    /// When the first period began; `None` before.
    first_ns: Option<u64>,
    /// The period to come, counted from 0.
    next: u64,
    pub(super) punctuality: Punctuality,
}

/// A period, in nanoseconds of the monotonic clock. Its first half is for observations, the second for decisions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Period {
    pub(super) begins_ns: u64,
    /// Agents decide now, with the observations that have arrived.
    pub(super) deadline_ns: u64,
    /// The decisions that have arrived are carried out now.
    pub(super) ends_ns: u64,
}

impl Clock {
    /// A clock with so many periods a second, for so many agents.
    pub(super) fn new(rate: f64, agents: usize) -> Clock {
        Clock { rate, first_ns: None, next: 0, punctuality: Punctuality::new(rate, agents) }
    }

    /// The next period whose deadline is still ahead. It may be yet to begin.
    pub(super) fn begin_period(&mut self) -> Period {
        self.begin_period_at(now_ns())
    }

    fn begin_period_at(&mut self, now: u64) -> Period {
        let first = *self.first_ns.get_or_insert(now);
        let periods = (now - first) as f64 * self.rate / 1e9;
        // That of half a period ago has its deadline now.
        let period = self.next.max((periods + 0.5) as u64);
        self.punctuality.late(now.saturating_sub(self.moment(self.next as f64)), period - self.next);
        self.next = period + 1;
        let [begins_ns, deadline_ns, ends_ns] = [0.0, 0.5, 1.0].map(|part| self.moment(period as f64 + part));
        self.punctuality.played(begins_ns, ends_ns);
        Period { begins_ns, deadline_ns, ends_ns }
    }

    /// When so many periods have passed.
    fn moment(&self, periods: f64) -> u64 {
        self.first_ns.unwrap_or_default() + (periods * 1e9 / self.rate).round() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: u64 = 1_000_000;

    #[test]
    fn lateness_does_not_add_up() {
        // A period that is no whole number of nanoseconds.
        let mut clock = Clock::new(3e6, 1);
        assert_eq!(clock.begin_period_at(FIRST).ends_ns, FIRST + 333);
        for period in 1..=3_000_000 {
            let begins = FIRST + (period as f64 / 3e-3).round() as u64;
            let late = period % 150;
            assert_eq!(clock.begin_period_at(begins + late).begins_ns, begins);
        }
        assert_eq!(clock.begin_period_at(FIRST + 1_000_000_334).begins_ns, FIRST + 1_000_000_333);
        assert_eq!(clock.punctuality.skipped, 0);
    }

    #[test]
    fn a_period_whose_deadline_has_passed_is_left_out() {
        let mut clock = Clock::new(1e6, 1);
        let period = |periods: u64| {
            let begins_ns = FIRST + 1000 * periods;
            Period { begins_ns, deadline_ns: begins_ns + 500, ends_ns: begins_ns + 1000 }
        };
        assert_eq!(clock.begin_period_at(FIRST), period(0));
        assert_eq!(clock.begin_period_at(FIRST + 1499), period(1), "half a period is left");
        assert_eq!(clock.begin_period_at(FIRST + 2500), period(3), "it is not");
        assert_eq!(clock.begin_period_at(FIRST + 3990), period(4), "a little early");
        assert_eq!(clock.punctuality.skipped, 1);
        assert_eq!(clock.begin_period_at(FIRST + 12_499), period(12));
        assert_eq!(clock.punctuality.skipped, 8);
        // What was left out was late too: 12.5 us instead of 5.
        assert_eq!(clock.punctuality.begins.quantile_us(1.0).round(), 7.0);
    }
}
