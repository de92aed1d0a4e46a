//! What became of observations on their way between two machines: apart from what links lose and delay, which is emulated
//! where they arrive.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Counts what has come from the other side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Tally {
    /// So many have been sent, as far as is known here.
    pub(super) sent: u64,
    came: u64,
    /// Those that came after their deadlines. There are none in lockstep.
    pub(super) delayed: u64,
}

impl Tally {
    /// Notes the observations of a frame by their numbers. Frames may overtake each other.
    pub(super) fn note(&mut self, numbers: &Range<u64>) {
        self.sent = self.sent.max(numbers.end);
        self.came = self.came.saturating_add(numbers.end.saturating_sub(numbers.start));
    }

    /// Notes when an observation came that was due then: nanoseconds of one clock.
    pub(super) fn note_time(&mut self, now_ns: u64, deadline_ns: u64) {
        self.delayed += u64::from(deadline_ns > 0 && now_ns > deadline_ns);
    }

    /// Those that did not come, or have not yet.
    pub(super) fn lost(&self) -> u64 {
        self.sent.saturating_sub(self.came)
    }

    /// All that is counted here and there.
    pub(super) fn and(&self, other: &Tally) -> [u64; 3] {
        let of = |tally: &Tally| [tally.sent, tally.lost(), tally.delayed];
        let (here, there) = (of(self), of(other));
        std::array::from_fn(|at| here[at].saturating_add(there[at]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_come_is_lost_and_what_is_overtaken_is_not() {
        let mut tally = Tally::default();
        // 4 to 6 are lost, 8 and 9 are overtaken.
        for numbers in [0..4, 7..8, 10..12, 8..10] {
            tally.note(&numbers);
        }
        assert_eq!((tally.sent, tally.lost()), (12, 3));
        for (now, deadline) in [(10, 0), (10, 10), (11, 10)] {
            tally.note_time(now, deadline);
        }
        assert_eq!(tally.delayed, 1, "in lockstep nothing has a deadline");
        assert_eq!(tally.and(&tally), [24, 6, 2]);
        tally.note(&(0..u64::MAX));
        assert_eq!(tally.lost(), 0);
    }
}
