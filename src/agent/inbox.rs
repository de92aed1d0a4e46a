//! What reached an agent. Loss is applied here and nowhere else; only an [oracle](super::Truth) is told more.

use super::Holdings;
use crate::base::rng::MAX_AGENTS;
use crate::bus::{Header, Kind, Layout, NOT_ARRIVED, Sample};
use crate::link::LONGEST_DELAY;

/// Keeps the last messages of each peer, in place where they were received.
#[derive(Debug)]
pub struct Mailbox<S> {
    layout: Layout,
    /// How often each peer has been started before, as far as is known.
    incarnations: [u32; MAX_AGENTS],
    /// `[agents, kept]`: a message stands where its tick says, in place of the one so many ticks before it.
    messages: Vec<Option<S>>,
    /// Messages of a peer that are kept: as many as can be under way, and one.
    kept: usize,
    swarm: u64,
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
    /// An empty mailbox for a team with such messages, which are under way for `longest_delay` ticks at most.
    pub fn new(layout: Layout, swarm: u64, longest_delay: u8) -> Mailbox<S> {
        let kept = usize::from(longest_delay) + 1;
        let messages = (0..layout.agents * kept).map(|_| None).collect();
        Mailbox { layout, incarnations: [0; MAX_AGENTS], messages, kept, swarm }
    }

    /// Takes a message in, unless it is not an observation of this swarm, or one of a process that has been replaced, or
    /// holds what no observation can be. What is refused is as good as lost.
    pub fn accept(&mut self, sample: S) {
        let Header { sender, worlds, tick, incarnation, .. } = *sample.header();
        let (sender, words) = (sender as usize, sample.words().len());
        let fits = sample.header().fits(Kind::Observation, self.swarm, words)
            && words == self.layout.observation_words(worlds as usize)
            && sender < self.layout.agents
            && incarnation >= self.incarnations[sender];
        if !fits {
            return;
        }
        let told = self.layout.told(sample.words(), worlds as usize, sender);
        if told.is_possible() && is_observable(told.observations) {
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
        (0..self.layout.agents).all(|sender| but >> sender & 1 == 1 || self.made_at(sender, tick).is_some())
    }

    /// What arrives in one world at the tick whose sensor message has this header, by `ages` of each sender.
    ///
    /// A peer's observation that is not in yet is lost, and so is one that was sent after the deadline, should this agent
    /// be later still: what is late stays outside.
    pub fn deliver(&self, world: usize, ages: &[u8], now: &Header) -> Inbox<'_> {
        Inbox::of(self.layout.agents, |sender| self.received(sender, sender, world, ages[sender], now))
    }

    /// The same where agents relay: of each agent the newest that is told in any of the messages that arrive, if it is newer
    /// than what is `held`.
    pub fn deliver_relayed(&self, world: usize, ages: &[u8], now: &Header, held: &Holdings) -> Inbox<'_> {
        let agents = self.layout.agents;
        let own = held.agent();
        Inbox::of(agents, |origin| {
            // What comes back of the agent's own is nothing new.
            let senders = (0..agents).filter(|sender| origin != own || *sender == own);
            let all = senders.filter_map(|sender| self.received(sender, origin, world, ages[sender], now));
            all.min_by_key(|received| received.age).filter(|received| received.age < held.age(world, origin))
        })
    }

    /// What the message that arrives from a sender, which is so old, tells of an agent.
    fn received(
        &self,
        sender: usize,
        origin: usize,
        world: usize,
        age: u8,
        now: &Header,
    ) -> Option<Received<'_>> {
        if age == NOT_ARRIVED {
            return None;
        }
        let in_time = |sample: &&S| now.deadline_ns == 0 || sample.header().sent_ns <= now.deadline_ns;
        let sample = self.made_at(sender, now.tick.checked_sub(age.into())?).filter(in_time)?;
        let told = self.layout.told(sample.words(), sample.header().worlds as usize, sender);
        let (when_sent, observation) = told.of(world, origin)?;
        let age = age.checked_add(when_sent).filter(|age| *age <= LONGEST_DELAY)?;
        Some(Received { age, observation })
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

    /// For observations of two values.
    fn mailbox(agents: usize, longest_delay: u8) -> Mailbox<LocalSample> {
        let layout = Layout { agents, observation: 2, action: 1, joint: 2 * agents, logits: 0, relay: false };
        Mailbox::new(layout, 1, longest_delay)
    }

    /// That of the sensor message at a tick.
    fn at(tick: u64) -> Header {
        Header { tick, ..Header::default() }
    }

    #[test]
    fn only_what_the_links_delivered_gets_in() {
        let mut mailbox = mailbox(3, 0);
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
        let mut mailbox = mailbox(2, 3);
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
        let mut mailbox = mailbox(3, 1);
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
        let mut mailbox = mailbox(2, 0);
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
        let mut mailbox = mailbox(2, 0);
        mailbox.accept(observation(1, 7, &[1.0, 2.0]));
        mailbox.accept(observation(1, 7, &[3.0, 4.0]));
        let inbox = mailbox.deliver(0, &[0; 2], &at(7));
        assert_eq!(inbox.from(1), Some(Received { age: 0, observation: &[1.0, 2.0] }));
    }

    #[test]
    fn what_is_late_or_foreign_stays_outside() {
        let mut mailbox = mailbox(2, 0);
        mailbox.accept(observation(1, 6, &[1.0, 2.0]));
        assert_eq!(mailbox.deliver(0, &[0; 2], &at(7)).from(1), None);
        mailbox.accept(observation(9, 7, &[1.0, 2.0]));
        mailbox.accept(observation(1, 7, &[1.0, 2.0, 3.0]));
        assert!(!mailbox.complete(7, 1));
        // A world that the message does not speak for.
        mailbox.accept(observation(1, 7, &[1.0, 2.0]));
        assert_eq!(mailbox.deliver(1, &[0; 2], &at(7)).from(1), None);
    }

    #[test]
    fn of_what_is_relayed_the_newest_counts_unless_it_is_held() {
        let layout = Layout { agents: 3, observation: 1, action: 1, joint: 3, logits: 0, relay: true };
        let mut mailbox = Mailbox::new(layout, 1, 2);
        let message = |sender: usize, tick, ages: [u8; 3], observations: [f32; 3]| {
            let header =
                Header { worlds: 1, length: 4, ..*observation(sender as u32, tick, &[0.0; 4]).header() };
            LocalSample::new(header, |words| layout.write_relayed(words, &ages, &observations))
        };
        mailbox.accept(message(1, 7, [2, 0, 3], [0.5, 1.7, 2.4]));
        mailbox.accept(message(2, 8, [1, 4, 0], [0.7, 1.4, 2.8]));
        // An agent says of itself only what is new, and of others only what is older.
        mailbox.accept(message(1, 8, [1, 1, 3], [0.0; 3]));
        mailbox.accept(message(1, 9, [0, 0, 3], [0.0; 3]));
        let mut holdings = Holdings::new(layout, 0, 1);
        let at = |tick, ages: [u8; 3], holdings: &mut Holdings| {
            holdings.begin_tick(tick);
            let inbox = mailbox.deliver_relayed(0, &ages, &at(tick), holdings);
            holdings.take(0, &inbox);
            [1, 2].map(|origin| inbox.from(origin).map(|received| (received.age, received.observation[0])))
        };
        // Of agent 2 by agent 1, a tick late: 3 when it was sent, 4 now.
        assert_eq!(at(8, [0, 1, NOT_ARRIVED], &mut holdings), [Some((1, 1.7)), Some((4, 2.4))]);
        // Of agent 1 there is something older: what it observed at 4.
        assert_eq!(at(9, [0, NOT_ARRIVED, 1], &mut holdings), [None, Some((1, 2.8))]);
        assert_eq!(mailbox.deliver(0, &[0, 0, 0], &self::at(9)).from(1), None);
    }
}
