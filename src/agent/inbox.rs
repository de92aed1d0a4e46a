//! What reached an agent. Loss is applied here and nowhere else; only an [oracle](super::Truth) is told more.

use crate::base::rng::MAX_AGENTS;
use crate::bus::{Header, Kind, NOT_ARRIVED, Sample};

/// Keeps the last messages of each peer, in place where they were received.
#[derive(Debug)]
pub struct Mailbox<S> {
    agents: usize,
    /// How often each peer has been started before, as far as is known.
    incarnations: [u32; MAX_AGENTS],
    /// `[agents, kept]`: a message stands where its tick says, in place of the one so many ticks before it.
    messages: Vec<Option<S>>,
    /// Messages of a peer that are kept: as many as can be under way, and one.
    kept: usize,
    swarm: u64,
    /// Words per world.
    observation: usize,
}

/// What an agent may look at in one world: per sender the observation that its link delivers now.
#[derive(Clone, Copy, Debug)]
pub struct Inbox<'a> {
    delivered: [Option<Received<'a>>; MAX_AGENTS],
}

/// A delivered observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received<'a> {
    /// How many ticks ago it was made: 0 if at this one.
    pub age: u8,
    /// Padded observation of the sender.
    pub observation: &'a [f32],
}

impl<S: Sample> Mailbox<S> {
    /// An empty mailbox for a team of `agents` that exchange padded observations of this length, which are under way for
    /// `longest_delay` ticks at most.
    pub fn new(agents: usize, swarm: u64, observation: usize, longest_delay: u8) -> Mailbox<S> {
        let kept = usize::from(longest_delay) + 1;
        let messages = (0..agents * kept).map(|_| None).collect();
        Mailbox { agents, incarnations: [0; MAX_AGENTS], messages, kept, swarm, observation }
    }

    /// Takes a message in, unless it is not an observation of this swarm, or one of a process that has been replaced, or
    /// holds what no observation can be. What is refused is as good as lost.
    pub fn accept(&mut self, sample: S) {
        let Header { sender, worlds, tick, incarnation, .. } = *sample.header();
        let (sender, words) = (sender as usize, sample.words().len());
        let fits = sample.header().fits(Kind::Observation, self.swarm, words)
            && words == worlds as usize * self.observation
            && sender < self.agents
            && incarnation >= self.incarnations[sender];
        if fits && is_observable(bytemuck::cast_slice(sample.words())) {
            self.incarnations[sender] = incarnation;
            // What was said of a tick stands.
            if self.made_at(sender, tick).is_none() {
                let place = self.place(sender, tick);
                self.messages[place] = Some(sample);
            }
        }
    }

    /// True if the observations of this tick are in from everybody but those who are left out, bit by bit: the agent itself,
    /// and who is not there.
    pub fn complete(&self, tick: u64, but: u64) -> bool {
        (0..self.agents).all(|sender| but >> sender & 1 == 1 || self.made_at(sender, tick).is_some())
    }

    /// What arrives in one world at the tick whose sensor message has this header, by `ages` of each sender.
    ///
    /// A peer's observation that is not in yet is lost, and so is one that was sent after the deadline, should this agent
    /// be later still: what is late stays outside.
    pub fn deliver(&self, world: usize, ages: &[u8], now: &Header) -> Inbox<'_> {
        Inbox::of(self.agents, |sender| {
            let age = Some(ages[sender]).filter(|age| *age != NOT_ARRIVED)?;
            let in_time = |sample: &&S| now.deadline_ns == 0 || sample.header().sent_ns <= now.deadline_ns;
            let sample = self.made_at(sender, now.tick.checked_sub(age.into())?).filter(in_time)?;
            let words = sample.words().chunks_exact(self.observation).nth(world)?;
            Some(Received { age, observation: bytemuck::cast_slice(words) })
        })
    }

    /// What a peer observed at a tick, if it is kept.
    fn made_at(&self, sender: usize, tick: u64) -> Option<&S> {
        let message = self.messages[self.place(sender, tick)].as_ref();
        message.filter(|sample| sample.header().tick == tick)
    }

    fn place(&self, sender: usize, tick: u64) -> usize {
        sender * self.kept + (tick % self.kept as u64) as usize
    }
}

/// Whether an observation can be one: all its values are numbers, and none is larger than 1e9, which is beyond what
/// positions, velocities and forces of any world come to.
pub(crate) fn is_observable(observation: &[f32]) -> bool {
    const LARGEST: f32 = 1e9;
    observation.iter().all(|value| value.abs() <= LARGEST)
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

    /// The observation of `sender` that is delivered now.
    pub fn from(&self, sender: usize) -> Option<Received<'a>> {
        self.delivered[sender]
    }

    /// How old that is, or [`NOT_ARRIVED`].
    pub fn age(&self, sender: usize) -> u8 {
        self.delivered[sender].map_or(NOT_ARRIVED, |received| received.age)
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

    /// That of the sensor message at a tick.
    fn at(tick: u64) -> Header {
        Header { tick, ..Header::default() }
    }

    #[test]
    fn only_what_the_links_delivered_gets_in() {
        let mut mailbox = Mailbox::new(3, 1, 2, 0);
        mailbox.accept(observation(1, 7, &[1.0, 2.0, 3.0, 4.0]));
        assert!(!mailbox.complete(7, 1));
        mailbox.accept(observation(2, 7, &[5.0, 6.0, 7.0, 8.0]));
        assert!(mailbox.complete(7, 1) && !mailbox.complete(8, 1));
        let inbox = mailbox.deliver(1, &[0, 0, NOT_ARRIVED], &at(7));
        assert_eq!(inbox.from(1), Some(Received { age: 0, observation: &[3.0, 4.0] }));
        assert_eq!(inbox.from(2), None);
        assert_eq!([inbox.age(1), inbox.age(2)], [0, NOT_ARRIVED]);
    }

    #[test]
    fn what_was_delayed_arrives_as_it_was_sent() {
        let mut mailbox = Mailbox::new(2, 1, 2, 3);
        for tick in 7..=12 {
            mailbox.accept(observation(1, tick, &[tick as f32, 0.0]));
        }
        for age in 0..=3 {
            let inbox = mailbox.deliver(0, &[0, age], &at(12));
            assert_eq!(inbox.from(1), Some(Received { age, observation: &[f32::from(12 - age), 0.0] }));
        }
        assert!(mailbox.complete(12, 1));
        // What has been replaced, and what has not been made.
        assert_eq!(mailbox.deliver(0, &[0, 4], &at(12)).from(1), None);
        assert_eq!(mailbox.deliver(0, &[0, 0], &at(13)).from(1), None);
        assert_eq!(mailbox.deliver(0, &[0, 5], &at(3)).from(1), None);
    }

    #[test]
    fn what_was_sent_after_the_deadline_stays_outside_even_if_it_is_in() {
        let mut mailbox = Mailbox::new(3, 1, 2, 1);
        for (sender, sent_ns) in [(1, 500), (2, 501)] {
            let header = *observation(sender, 7, &[1.0, 2.0]).header();
            mailbox.accept(LocalSample::new(Header { sent_ns, deadline_ns: 500, ..header }, |_| {}));
        }
        let now = Header { deadline_ns: 500, ..at(7) };
        let inbox = mailbox.deliver(0, &[0; 3], &now);
        assert!(inbox.from(1).is_some() && inbox.from(2).is_none());
        // A tick later it is in time for a link that takes so long.
        let inbox = mailbox.deliver(0, &[0, 1, 1], &Header { deadline_ns: 600, ..at(8) });
        assert_eq!([inbox.age(1), inbox.age(2)], [1, 1]);
    }

    #[test]
    fn what_no_sensor_says_and_who_was_replaced_stay_outside() {
        let mut mailbox = Mailbox::new(2, 1, 2, 0);
        for wrong in [f32::NAN, f32::INFINITY, -1e30] {
            mailbox.accept(observation(1, 7, &[1.0, wrong]));
            assert!(!mailbox.complete(7, 1), "{wrong}");
        }
        let of = |incarnation, tick| {
            let header = *observation(1, tick, &[1.0, 2.0]).header();
            LocalSample::new(Header { incarnation, ..header }, |_| {})
        };
        mailbox.accept(of(2, 7));
        assert!(mailbox.complete(7, 1));
        mailbox.accept(of(1, 8));
        assert!(!mailbox.complete(8, 1));
    }

    #[test]
    fn what_was_said_of_a_tick_stands() {
        let mut mailbox = Mailbox::new(2, 1, 2, 0);
        mailbox.accept(observation(1, 7, &[1.0, 2.0]));
        mailbox.accept(observation(1, 7, &[3.0, 4.0]));
        let inbox = mailbox.deliver(0, &[0; 2], &at(7));
        assert_eq!(inbox.from(1), Some(Received { age: 0, observation: &[1.0, 2.0] }));
    }

    #[test]
    fn what_is_late_or_foreign_stays_outside() {
        let mut mailbox = Mailbox::new(2, 1, 2, 0);
        mailbox.accept(observation(1, 6, &[1.0, 2.0]));
        assert_eq!(mailbox.deliver(0, &[0; 2], &at(7)).from(1), None);
        mailbox.accept(observation(9, 7, &[1.0, 2.0]));
        mailbox.accept(observation(1, 7, &[1.0, 2.0, 3.0]));
        assert!(!mailbox.complete(7, 1));
        // A world that the message does not speak for.
        mailbox.accept(observation(1, 7, &[1.0, 2.0]));
        assert_eq!(mailbox.deliver(1, &[0; 2], &at(7)).from(1), None);
    }
}
