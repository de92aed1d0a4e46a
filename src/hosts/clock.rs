//! The clock of a host: when it is asked for the time, and what its answers say.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::offset::{Estimate, Exchange, Jump, Offset};
use super::orders::Order;
use crate::bus::now_ns;

/// How often a host is asked for the time.
const BETWEEN_QUESTIONS: Duration = Duration::from_millis(200);

/// How many of the questions are remembered that it has not answered yet.
const MOST_QUESTIONS: usize = 64;

/// What a host was asked about its clock, and what is known of it.
pub(super) struct HostClock {
    offset: Offset,
    /// What is known of it now.
    estimate: Estimate,
    /// When it is asked next.
    asks: Instant,
    /// When it was asked, as far as it has not answered.
    asked: VecDeque<u64>,
}

impl HostClock {
    /// Of one that has not been asked yet.
    pub(super) fn new() -> HostClock {
        HostClock {
            offset: Offset::default(),
            estimate: Estimate::default(),
            asks: Instant::now(),
            asked: VecDeque::new(),
        }
    }

    /// Whether it is to be asked again.
    pub(super) fn is_due(&self, now: Instant) -> bool {
        self.asks <= now
    }

    /// What it is to be asked, at once.
    pub(super) fn ask(&mut self) -> Order {
        let asked_ns = now_ns();
        self.asks = Instant::now() + BETWEEN_QUESTIONS;
        self.asked.truncate(MOST_QUESTIONS - 1);
        self.asked.push_front(asked_ns);
        Order::Tell { asked_ns }
    }

    /// Takes note of an answer, if it was asked. Returns the first jump of the clock: it is said once, and the summary counts
    /// how often.
    pub(super) fn note(&mut self, exchange: &Exchange) -> Option<Jump> {
        let at = self.asked.iter().position(|asked_ns| *asked_ns == exchange.asked_ns)?;
        self.asked.remove(at);
        let jump = self.offset.note(exchange);
        self.estimate = self.offset.at(now_ns()).unwrap_or_default();
        jump.filter(|jump| jump.number == 1)
    }

    /// What times are translated by.
    pub(super) fn estimate(&self) -> Estimate {
        self.estimate
    }

    /// What is known at this moment: the error has grown since the last answer.
    pub(super) fn estimate_now(&self) -> Estimate {
        self.offset.at(now_ns()).unwrap_or_default()
    }

    /// How often it moved by more than errors and drift explain.
    pub(super) fn jumps(&self) -> u64 {
        self.offset.jumps()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(clock: &mut HostClock) -> u64 {
        match clock.ask() {
            Order::Tell { asked_ns } => asked_ns,
            other => panic!("{other:?} is no question"),
        }
    }

    #[test]
    fn only_answers_to_its_own_questions_count_and_each_once() {
        let mut clock = HostClock::new();
        let now = Instant::now();
        assert!(clock.is_due(now + Duration::from_millis(1)));
        let first = asked(&mut clock);
        assert!(!clock.is_due(now));
        let answer = |asked_ns: u64, ahead_ns: u64| {
            let theirs = asked_ns + ahead_ns;
            Exchange { asked_ns, heard_ns: theirs, said_ns: theirs, answered_ns: asked_ns + 1000 }
        };
        assert_eq!(clock.note(&answer(first + 1, 7000)), None);
        assert_eq!(clock.estimate(), Estimate::default(), "nobody asked then");
        clock.note(&answer(first, 7000));
        assert_eq!(clock.estimate().ahead_ns, 6500);
        clock.note(&answer(first, 9_000_000_000));
        assert_eq!((clock.estimate().ahead_ns, clock.jumps()), (6500, 0), "it had been answered");
        // Answers may come in any order; of jumps only the first is told.
        let questions = [(); 3].map(|()| asked(&mut clock));
        let far = |times: u64| 1_000_000_000 * times;
        let jumps = [2, 0, 1].map(|at| clock.note(&answer(questions[at], far(at as u64 + 1))).is_some());
        assert_eq!((jumps, clock.jumps()), ([true, false, false], 3));
    }

    #[test]
    fn a_host_that_never_answers_is_not_remembered_for_ever() {
        let mut clock = HostClock::new();
        let first = asked(&mut clock);
        (0..MOST_QUESTIONS).for_each(|_| _ = clock.ask());
        clock.note(&Exchange { asked_ns: first, heard_ns: 5, said_ns: 5, answered_ns: first + 1 });
        assert_eq!(clock.estimate(), Estimate::default());
    }
}
