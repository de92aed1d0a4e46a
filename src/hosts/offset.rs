//! How far the clock of a host is from ours.
//!
//! The monotonic clocks of two machines have nothing in common but that they run at nearly the same speed. As NTP does, one
//! side asks the other for the time and notes when it did and when the answer came; the other says when the question came
//! and when it answered. The offset is then right to half of what the way there and back took, whichever way took longer:
//! so waiting in a queue makes an exchange worthless, not wrong. Of the last exchanges the one with the smallest error
//! counts, and the error grows with age, because clocks drift.

use std::collections::VecDeque;

/// How much faster or slower than ours the clock of a host may run: a quartz is right to 50 in a million, and whoever sets it
/// by others corrects it by about as much. Twice that for two of them.
const DRIFT: f64 = 200e-6;

/// The exchanges that count.
const RECENT: usize = 16;

/// A question for the time, and its answer: nanoseconds of the monotonic clocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exchange {
    /// By our clock.
    pub(super) asked_ns: u64,
    /// By that of the host.
    pub(super) heard_ns: u64,
    /// By that of the host.
    pub(super) said_ns: u64,
    /// By our clock.
    pub(super) answered_ns: u64,
}

/// What the last exchanges say of the clock of a host.
#[derive(Debug, Default)]
pub(super) struct Offset {
    recent: VecDeque<Reading>,
    /// How often it moved by more than an error can explain.
    jumps: u64,
}

/// What one exchange says.
#[derive(Clone, Copy, Debug)]
struct Reading {
    /// When the answer came, by our clock.
    at_ns: u64,
    /// What the host's clock was ahead of ours.
    ahead_ns: i64,
    /// By how much that may be wrong.
    error_ns: u64,
}

/// What a clock is ahead of ours, and by how much that may be wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Estimate {
    pub(super) ahead_ns: i64,
    pub(super) error_ns: u64,
}

/// A clock that moved by more than errors and drift explain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Jump {
    pub(super) by_ns: i64,
    /// As much could be explained.
    pub(super) allowed_ns: u64,
    /// Which one it is of that clock, counted from 1.
    pub(super) number: u64,
}

impl Exchange {
    /// `None` if the answer came before the question, or was given before it was asked.
    fn reading(&self) -> Option<Reading> {
        let Exchange { asked_ns, heard_ns, said_ns, answered_ns } = *self;
        let (here, there) = (answered_ns.checked_sub(asked_ns)?, said_ns.checked_sub(heard_ns)?);
        let ahead = |its: u64, ours: u64| its.wrapping_sub(ours) as i64;
        let (before, after) = (ahead(heard_ns, asked_ns), ahead(said_ns, answered_ns));
        // Its clock may have run faster than ours while it did something else.
        let error_ns = (here.saturating_sub(there) / 2).saturating_add(drift(here));
        Some(Reading { at_ns: answered_ns, ahead_ns: before.midpoint(after), error_ns })
    }
}

impl Reading {
    /// By how much it may be wrong at a moment of our clock.
    fn error_at(&self, now_ns: u64) -> u64 {
        self.error_ns.saturating_add(drift(now_ns.saturating_sub(self.at_ns)))
    }
}

impl Offset {
    /// Takes note of an exchange. If one of those before cannot be right as well, none of them counts any longer.
    pub(super) fn note(&mut self, exchange: &Exchange) -> Option<Jump> {
        let (reading, number) = (exchange.reading()?, self.jumps + 1);
        let jump = |before: &Reading| {
            let by_ns = reading.ahead_ns.saturating_sub(before.ahead_ns);
            let allowed_ns = reading.error_ns.saturating_add(before.error_at(reading.at_ns));
            (by_ns.unsigned_abs() > allowed_ns).then_some(Jump { by_ns, allowed_ns, number })
        };
        // Drift shows best against the oldest.
        let jump = self.recent.iter().rev().find_map(jump);
        if jump.is_some() {
            self.recent.clear();
            self.jumps += 1;
        }
        self.recent.truncate(RECENT - 1);
        self.recent.push_front(reading);
        jump
    }

    /// What is known at a moment of our clock; `None` before the first exchange.
    pub(super) fn at(&self, now_ns: u64) -> Option<Estimate> {
        let best = self.recent.iter().min_by_key(|reading| reading.error_at(now_ns))?;
        Some(Estimate { ahead_ns: best.ahead_ns, error_ns: best.error_at(now_ns) })
    }

    /// How often the clock moved by more than errors and drift explain.
    pub(super) fn jumps(&self) -> u64 {
        self.jumps
    }
}

impl Estimate {
    /// A moment of our clock by that of the host.
    pub(super) fn theirs(&self, ours_ns: u64) -> u64 {
        ours_ns.saturating_add_signed(self.ahead_ns)
    }

    /// A moment of the host's clock by ours.
    pub(super) fn ours(&self, theirs_ns: u64) -> u64 {
        theirs_ns.saturating_add_signed(self.ahead_ns.saturating_neg())
    }
}

/// How far two clocks may drift apart in some time.
fn drift(ns: u64) -> u64 {
    (ns as f64 * DRIFT) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// An exchange at a moment of our clock, with a host whose clock is ahead by so much, over ways that take so long.
    fn exchange(at_ns: u64, ahead_ns: i64, [there, back]: [u64; 2]) -> Exchange {
        let heard_ns = (at_ns + there).saturating_add_signed(ahead_ns);
        // It does something else first.
        let said_ns = heard_ns + 3 * MS;
        Exchange { asked_ns: at_ns, heard_ns, said_ns, answered_ns: at_ns + there + 3 * MS + back }
    }

    #[test]
    fn queues_on_one_way_do_not_move_the_offset() {
        let (mut offset, ahead) = (Offset::default(), -7_000_000_000i64);
        assert_eq!(offset.at(0), None);
        let start = 10_000 * MS;
        let mut worst = 0;
        for turn in 0..200 {
            // Every fourth finds no queue; the others wait on the way there, by up to 49 ms.
            let queue = if turn % 4 == 0 { 0 } else { turn * 7 % 50 * MS };
            let exchange = exchange(start + turn * 200 * MS, ahead, [MS / 10 + queue, MS / 10]);
            assert_eq!(offset.note(&exchange), None, "turn {turn}");
            let Estimate { ahead_ns, error_ns } = offset.at(exchange.answered_ns).unwrap();
            assert!(ahead_ns.abs_diff(ahead) <= error_ns, "turn {turn}: {ahead_ns} +- {error_ns}");
            worst = worst.max(error_ns);
        }
        // Half of what the way there and back takes, and what clocks may drift until the next without a queue.
        assert!(worst < MS / 10 + drift(1000 * MS), "{worst}");
        assert_eq!(offset.jumps(), 0);
    }

    #[test]
    fn the_error_is_half_the_round_trip_and_grows_with_age() {
        let mut offset = Offset::default();
        // All of it on the way back: the worst there can be.
        let exchange = exchange(0, 500, [0, 2 * MS]);
        offset.note(&exchange);
        let now = exchange.answered_ns;
        let Estimate { ahead_ns, error_ns } = offset.at(now).unwrap();
        assert_eq!((ahead_ns, error_ns), (500 - MS as i64, MS + drift(5 * MS)));
        assert_eq!(offset.at(now + 1000 * MS).unwrap().error_ns, error_ns + MS / 5);
        // One that is worse than the old one is by now does not count.
        offset.note(&self::exchange(now + 100 * MS, 500, [4 * MS, 0]));
        assert_eq!(offset.at(now + 107 * MS).unwrap().ahead_ns, ahead_ns);
    }

    #[test]
    fn a_clock_that_jumps_or_drifts_too_much_is_found_out() {
        let mut offset = Offset::default();
        let ways = [MS / 10; 2];
        assert_eq!(offset.note(&exchange(0, 0, ways)), None);
        assert_eq!(offset.note(&exchange(200 * MS, 150_000, ways)), None, "errors explain it");
        let jump = offset.note(&exchange(400 * MS, 5_000_000, ways)).expect("nothing explains it");
        assert!(jump.by_ns > 4_000_000 && jump.allowed_ns < MS && jump.number == 1, "{jump:?}");
        // What was known before does not count.
        assert_eq!(offset.at(404 * MS).unwrap().ahead_ns, 5_000_000);
        // One part in a thousand.
        let drifting = |turn: u64| exchange((400 + turn * 200) * MS, 5_000_000 + turn as i64 * 200_000, ways);
        let found = (1..20).filter_map(|turn| offset.note(&drifting(turn))).count();
        assert!(found > 1 && offset.jumps() == 1 + found as u64, "{found}");
    }

    #[test]
    fn what_cannot_have_been_is_no_exchange() {
        let mut offset = Offset::default();
        for [asked_ns, heard_ns, said_ns, answered_ns] in [[2, 0, 1, 1], [1, 2, 1, 2]] {
            offset.note(&Exchange { asked_ns, heard_ns, said_ns, answered_ns });
        }
        assert_eq!(offset.at(9), None);
        let far = Exchange { asked_ns: 0, heard_ns: u64::MAX, said_ns: u64::MAX, answered_ns: u64::MAX };
        offset.note(&far);
        assert!(offset.at(u64::MAX).is_some(), "nothing overflows");
    }

    #[test]
    fn moments_are_translated_there_and_back() {
        for ahead_ns in [0, 5, -5, i64::from(u32::MAX)] {
            let estimate = Estimate { ahead_ns, error_ns: 0 };
            assert_eq!(estimate.ours(estimate.theirs(1 << 40)), 1 << 40);
            assert_eq!(estimate.theirs(1 << 40), (1u64 << 40).wrapping_add_signed(ahead_ns));
        }
    }
}
