//! What agents here have answered, gathered until it is sent: those that answer at about the same time share a frame.

use std::time::{Duration, Instant};

use super::outbox::Outbox;
use crate::bus::Header;

/// How long what some agents have answered waits for the others: who is slower has a frame of its own.
const PATIENCE: Duration = Duration::from_millis(20);

/// The same against the clock, where nobody waits for who is slower. A frame costs a tenth of that.
const SHORT_PATIENCE: Duration = Duration::from_millis(1);

/// What is to be sent, and who is waited for.
pub(super) struct Outgoing {
    patience: Duration,
    pub(super) outbox: Outbox,
    /// When the first message came in.
    since: Option<Instant>,
    /// Whether it cannot wait for others.
    pub(super) is_urgent: bool,
    /// Whether there are decisions in it.
    pub(super) has_decisions: bool,
    /// Agents that have yet to publish at this tick, bit by bit, and to decide.
    pub(super) silent: u64,
    pub(super) undecided: u64,
    /// Whether no agent that is elsewhere is waited for.
    pub(super) is_alone: bool,
}

impl Outgoing {
    /// Nothing is to be sent by a swarm in lockstep, or `real_time`; the network may be the link there.
    pub(super) fn new(real_time: bool, network_is_link: bool) -> Outgoing {
        Outgoing {
            patience: if real_time { SHORT_PATIENCE } else { PATIENCE },
            outbox: Outbox::new(real_time, network_is_link),
            since: None,
            is_urgent: false,
            has_decisions: false,
            silent: 0,
            undecided: 0,
            is_alone: false,
        }
    }

    /// Adds a message.
    pub(super) fn push(&mut self, header: &Header, words: &[u32]) {
        self.outbox.push(header, words);
        self.since.get_or_insert_with(Instant::now);
    }

    /// How much longer what is there may wait, if something is.
    pub(super) fn longest_wait(&self) -> Option<Duration> {
        self.since.map(|since| self.patience.saturating_sub(since.elapsed()))
    }

    /// Whether what there is shall be sent now: it is complete, or has waited for long enough. `running` are the agents that
    /// can still answer.
    pub(super) fn take_due(&mut self, running: u64) -> bool {
        let Some(waits) = self.longest_wait() else { return false };
        let is_complete =
            self.silent & running == 0 && !(self.has_decisions && self.undecided & running != 0);
        if !is_complete && !self.is_urgent && !waits.is_zero() {
            return false;
        }
        (self.since, self.is_urgent, self.has_decisions) = (None, false, false);
        true
    }

    /// Whether all have published and some are to decide, with nothing to come from elsewhere.
    pub(super) fn must_wake(&self, running: u64) -> bool {
        self.is_alone && self.silent & running == 0 && self.undecided & running != 0
    }
}
