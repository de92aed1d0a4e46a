//! The clock of a swarm in real time.

use super::Punctuality;
use crate::bus::now_ns;

/// Periods one after the other. Each begins a whole number of periods after the first one, so that lateness never adds
/// up: a period that could not begin in time is left out.
#[derive(Debug)]
pub(super) struct Clock {
    rate: f64,
    /// When the first period began; `None` before.
    first_ns: Option<u64>,
    /// The present one, counted from 0.
    period: u64,
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
    /// A clock with so many periods a second.
    pub(super) fn new(rate: f64) -> Clock {
        Clock { rate, first_ns: None, period: 0, punctuality: Punctuality::new(rate) }
    }

    /// Begins the next period that is not over yet.
    pub(super) fn begin_period(&mut self) -> Period {
        self.begin_period_at(now_ns())
    }

    fn begin_period_at(&mut self, now: u64) -> Period {
        if let Some(first) = self.first_ns {
            let present = ((now - first) as f64 * self.rate / 1e9) as u64;
            let next = self.period + 1;
            self.period = present.max(next);
            self.punctuality.skipped += self.period - next;
        }
        self.first_ns.get_or_insert(now);
        let period = Period {
            begins_ns: self.moment(self.period as f64),
            deadline_ns: self.moment(self.period as f64 + 0.5),
            ends_ns: self.moment(self.period as f64 + 1.0),
        };
        self.punctuality.begun(period.begins_ns, now, period.ends_ns);
        period
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
        let mut clock = Clock::new(3e6);
        assert_eq!(clock.begin_period_at(FIRST).ends_ns, FIRST + 333);
        for period in 1..=3_000_000 {
            let begins = FIRST + (period as f64 / 3e-3).round() as u64;
            let late = period % 300;
            assert_eq!(clock.begin_period_at(begins + late).begins_ns, begins);
        }
        assert_eq!(clock.begin_period_at(FIRST + 1_000_000_400).begins_ns, FIRST + 1_000_000_333);
        assert_eq!(clock.punctuality.skipped, 0);
    }

    #[test]
    fn a_period_that_is_over_is_left_out() {
        let mut clock = Clock::new(1e6);
        let period = |periods: u64| {
            let begins_ns = FIRST + 1000 * periods;
            Period { begins_ns, deadline_ns: begins_ns + 500, ends_ns: begins_ns + 1000 }
        };
        assert_eq!(clock.begin_period_at(FIRST), period(0));
        assert_eq!(clock.begin_period_at(FIRST + 1999), period(1));
        // Too early is the same as in time.
        assert_eq!(clock.begin_period_at(FIRST + 1999), period(2));
        assert_eq!(clock.begin_period_at(FIRST + 7001), period(7));
        assert_eq!(clock.punctuality.skipped, 4);
    }
}
