//! What reached an agent. Loss is applied here and nowhere else.

use crate::base::rng::MAX_AGENTS;
use crate::bus::{Header, Kind, Sample};

/// Keeps the newest message of each peer, in place where it was received.
#[derive(Debug)]
pub struct Mailbox<S> {
    newest: Vec<Option<S>>,
    swarm: u64,
    /// Words per world.
    observation: usize,
}

/// What an agent may look at in one world: per sender the newest observation that its link delivered.
#[derive(Clone, Copy, Debug)]
pub struct Inbox<'a> {
    delivered: [Option<Received<'a>>; MAX_AGENTS],
}

/// A delivered observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received<'a> {
    /// The tick it was made at.
    pub tick: u64,
    /// Padded observation of the sender.
    pub observation: &'a [f32],
}

impl<S: Sample> Mailbox<S> {
    /// An empty mailbox for a team of `agents` that exchange padded observations of this length.
    pub fn new(agents: usize, swarm: u64, observation: usize) -> Mailbox<S> {
        Mailbox { newest: (0..agents).map(|_| None).collect(), swarm, observation }
    }

    /// Takes a message in, unless it is not an observation of this swarm.
    pub fn accept(&mut self, sample: S) {
        let Header { sender, worlds, .. } = *sample.header();
        let words = sample.words().len();
        let fits = sample.header().fits(Kind::Observation, self.swarm, words)
            && words == worlds as usize * self.observation;
        if let Some(slot) = self.newest.get_mut(sender as usize).filter(|_| fits) {
            *slot = Some(sample);
        }
    }

    /// True if the observations of this tick are in from everybody but the agent itself.
    pub fn complete(&self, agent: usize, tick: u64) -> bool {
        self.newest.iter().enumerate().all(|(sender, newest)| {
            sender == agent || newest.as_ref().is_some_and(|sample| sample.header().tick == tick)
        })
    }

    /// Applies the losses of `row` to the observations of this tick in one world.
    ///
    /// A peer's observation that is not in yet is lost as well, and so is one that was sent after the deadline, should
    /// this agent be later still: what is late stays outside.
    pub fn deliver(&self, world: usize, row: u64, tick: u64) -> Inbox<'_> {
        Inbox::of(self.newest.len(), |sender| {
            if row >> sender & 1 == 0 {
                return None;
            }
            let in_time = |header: &Header| {
                header.tick == tick && (header.deadline_ns == 0 || header.sent_ns <= header.deadline_ns)
            };
            let sample = self.newest[sender].as_ref().filter(|sample| in_time(sample.header()))?;
            let words = sample.words().chunks_exact(self.observation).nth(world)?;
            Some(Received { tick, observation: bytemuck::cast_slice(words) })
        })
    }
}

impl<'a> Inbox<'a> {
    /// The inbox of a team of `agents` that holds what `from` says of each sender.
    pub fn of(agents: usize, from: impl Fn(usize) -> Option<Received<'a>>) -> Inbox<'a> {
        let mut delivered = [None; MAX_AGENTS];
        for (sender, slot) in delivered[..agents].iter_mut().enumerate() {
            *slot = from(sender);
        }
        Inbox { delivered }
    }

    /// The newest delivered observation of `sender`.
    pub fn from(&self, sender: usize) -> Option<Received<'a>> {
        self.delivered[sender]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::{LocalSample, PROTOCOL};

    fn observation(sender: u32, tick: u64, values: &[f32]) -> LocalSample {
        let header = Header {
            protocol: PROTOCOL,
            kind: Kind::Observation as u32,
            swarm: 1,
            sender,
            tick,
            worlds: values.len() as u32 / 2,
            length: values.len() as u64,
            ..Header::default()
        };
        LocalSample::new(header, |words| words.copy_from_slice(bytemuck::cast_slice(values)))
    }

    #[test]
    fn only_what_the_links_delivered_gets_in() {
        let mut mailbox = Mailbox::new(3, 1, 2);
        mailbox.accept(observation(1, 7, &[1.0, 2.0, 3.0, 4.0]));
        assert!(!mailbox.complete(0, 7));
        mailbox.accept(observation(2, 7, &[5.0, 6.0, 7.0, 8.0]));
        assert!(mailbox.complete(0, 7) && !mailbox.complete(0, 8));
        let inbox = mailbox.deliver(1, 0b011, 7);
        assert_eq!(inbox.from(1), Some(Received { tick: 7, observation: &[3.0, 4.0] }));
        assert_eq!(inbox.from(2), None);
    }

    #[test]
    fn what_was_sent_after_the_deadline_stays_outside_even_if_it_is_in() {
        let mut mailbox = Mailbox::new(3, 1, 2);
        for (sender, sent_ns) in [(1, 500), (2, 501)] {
            let header = *observation(sender, 7, &[1.0, 2.0]).header();
            mailbox.accept(LocalSample::new(Header { sent_ns, deadline_ns: 500, ..header }, |_| {}));
        }
        let inbox = mailbox.deliver(0, 0b111, 7);
        assert!(inbox.from(1).is_some() && inbox.from(2).is_none());
    }

    #[test]
    fn what_is_late_or_foreign_stays_outside() {
        let mut mailbox = Mailbox::new(2, 1, 2);
        mailbox.accept(observation(1, 6, &[1.0, 2.0]));
        assert_eq!(mailbox.deliver(0, 0b11, 7).from(1), None);
        mailbox.accept(observation(9, 7, &[1.0, 2.0]));
        mailbox.accept(observation(1, 7, &[1.0, 2.0, 3.0]));
        assert!(!mailbox.complete(0, 7));
        // A world that the message does not speak for.
        mailbox.accept(observation(1, 7, &[1.0, 2.0]));
        assert_eq!(mailbox.deliver(1, 0b11, 7).from(1), None);
    }
}
