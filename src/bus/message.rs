//! Everything that is sent: one header and four layouts of 32-bit words.
//!
//! A message is a [`Header`] and a payload of words, written in place in a loaned sample and read in
//! place by its receivers. Floats travel as their bits. A message speaks for all parallel worlds of the
//! swarm at once, so every part below has one entry per world. Weights alone are for all worlds the same.
//!
//! `docs/protocol.md` says the same for agents in other languages, byte by byte. Whoever changes one changes the other, and
//! counts up [`PROTOCOL`].

use iceoryx2::prelude::ZeroCopySend;
use serde::{Deserialize, Serialize};

/// Version of the header and the layouts; a receiver refuses any other.
pub const PROTOCOL: u32 = 8;

/// The age of an observation that has not arrived. Every other age says how many ticks ago the observation that arrives
/// now was made: 0 if at this tick.
pub const NOT_ARRIVED: u8 = u8::MAX;

/// What a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Agent to supervisor: every port is open. One word: what it was [granted](crate::base::scheduling::Granted), in bits.
    Ready = 1,
    /// Supervisor to one agent: its own observation, and what arrives from its peers.
    Sensor = 2,
    /// Agent to its peers: its observation.
    Observation = 3,
    /// Agent to supervisor: its actions.
    Decision = 4,
    /// Supervisor to one agent: leave.
    Shutdown = 5,
    /// Supervisor to all agents: new values of the policy.
    Weights = 6,
    /// Environment to supervisor: its [`Description`](crate::environment::Description), as JSON.
    Describe = 7,
    /// Supervisor to environment: begin an episode in a world.
    Reset = 8,
    /// Supervisor to environment: one step of all worlds.
    Step = 9,
    /// Environment to supervisor: where that led.
    Outcome = 10,
}

/// Stands before every payload. Its name is the one by which other languages open the services.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend, bytemuck::Pod, bytemuck::Zeroable)]
#[type_name("VamaroSwarmHeader")]
pub struct Header {
    /// [`PROTOCOL`].
    pub protocol: u32,
    /// A [`Kind`].
    pub kind: u32,
    /// Which swarm this belongs to.
    pub swarm: u64,
    /// How often the sender has been started in this swarm, from 0. Of a sensor message: whether it is sent once more for the
    /// same tick, because somebody was lost who need not be waited for any longer.
    pub incarnation: u32,
    /// Index of the sending agent; the supervisor counts as the agent it speaks to.
    pub sender: u32,
    /// Episode of world 0; world w plays episode + w.
    pub episode: u64,
    /// Ticks since the swarm started. Tells two messages apart that agree on episode and step.
    pub tick: u64,
    /// Step within the episode, from 0.
    pub step: u32,
    /// Worlds in this message.
    pub worlds: u32,
    /// Payload length in words.
    pub length: u64,
    /// Which weights are meant: 0 for those that agents start with, then counted up with each renewal. A
    /// [`Kind::Weights`] brings them; from the first step of an episode on they are in force.
    pub weights: u64,
    /// When it was sent, nanoseconds of the monotonic clock of the machine that the message is on.
    pub sent_ns: u64,
    /// When agents decide with the observations that have arrived, by the same clock; 0 in lockstep, where they wait for
    /// all of them.
    pub deadline_ns: u64,
    /// The agents that are not there at this tick, bit by bit: nobody waits for them.
    pub absent: u64,
}

impl Header {
    /// True if the header is one of ours, for this swarm and of this kind and payload length.
    pub fn fits(&self, kind: Kind, swarm: u64, words: usize) -> bool {
        self.protocol == PROTOCOL
            && self.kind == kind as u32
            && self.swarm == swarm
            && self.length == words as u64
    }
}

/// Sizes of the parts of a message for one world, in words.
///
/// | message | parts, each `[worlds, ..]` |
/// |---|---|
/// | sensor | action carried out at the step before (`action`), ages of what arrives (a byte for each of `agents`), [draw](Sensor::draws) (2), own observation (`observation`) |
/// | observation | observation (`observation`); where agents relay, ages of what the sender holds (a byte for each of `agents`), and what it holds (`agents` times `observation`), its own included |
/// | decision | action (`action`), ages used (a byte for each of `agents`), joint estimate (`joint`), logits (`logits`) |
///
/// The bytes of all worlds stand behind each other, and zeros fill their last word. Behind the parts of a decision message
/// stand the [`DecisionTimes`]. A weights message is all values of a policy, in the order of its tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// Size of the team.
    pub agents: usize,
    /// Padded observation.
    pub observation: usize,
    /// Action.
    pub action: usize,
    /// Joint observation.
    pub joint: usize,
    /// Actions an agent chooses from; 0 where nobody records by which logits.
    pub logits: usize,
    /// Whether an observation message also holds the newest that its sender has of others.
    pub relay: bool,
}

/// Words of the [`DecisionTimes`].
const TIMES: usize = 4;

/// Words of a draw.
const DRAW: usize = 2;

/// An agent's reading of its own sensor, and what its links bring.
#[derive(Clone, Copy, Debug)]
pub struct Sensor<'a> {
    /// What was carried out of the agent at the step before, zeros at the first of an episode, `[worlds, action]`. It is
    /// what the agent decided then, unless its decision came too late.
    pub carried_out: &'a [u32],
    /// How old what arrives from each sender is, or [`NOT_ARRIVED`], `[worlds, agents]`.
    pub ages: &'a [u8],
    /// The uniform draw in [0, 1) that samples the agent's action, `[worlds]`: the halves of an f64, the low one first. Zeros
    /// where the most probable action is taken.
    pub draws: &'a [[u32; 2]],
    /// The agent's own observations, `[worlds, observation]`.
    pub observations: &'a [f32],
}

/// What an agent tells its peers: what it observes, and where agents relay, the newest that it holds of others.
#[derive(Clone, Copy, Debug)]
pub struct Told<'a> {
    agents: usize,
    observation: usize,
    sender: usize,
    /// Of what is told of each agent, `[worlds, agents]`; empty where nobody relays.
    ages: &'a [u8],
    /// All values: `[worlds, observation]`, or `[worlds, agents, observation]` where agents relay.
    pub observations: &'a [f32],
}

impl<'a> Told<'a> {
    /// What is told of an agent in one world, and how old that was when it was sent; `None` if nothing is.
    pub fn of(&self, world: usize, origin: usize) -> Option<(u8, &'a [f32])> {
        let (age, row) = match self.ages.get(world * self.agents + origin) {
            Some(age) => (*age, world * self.agents + origin),
            None if origin == self.sender => (0, world),
            None => return None,
        };
        let told = self.observations.get(row * self.observation..(row + 1) * self.observation)?;
        (age != NOT_ARRIVED).then_some((age, told))
    }

    /// Whether it can be: an agent tells of itself what is new, and of others what is older.
    pub(crate) fn is_possible(&self) -> bool {
        let mut ages = self.ages.iter().enumerate();
        ages.all(|(at, age)| (*age == 0) == (at % self.agents == self.sender))
    }
}

/// When an agent did what it does for a decision, which is sent last: nanoseconds of the monotonic clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecisionTimes {
    /// It had received all it waits for.
    pub received_ns: u64,
    /// Its joint estimates were complete.
    pub fused_ns: u64,
}

/// What an agent decided, and on what ground.
#[derive(Clone, Copy, Debug)]
pub struct Decision<'a> {
    /// The action in each world, `[worlds, action]`.
    pub actions: &'a [u32],
    /// How old what had reached the agent from each sender was, or [`NOT_ARRIVED`], `[worlds, agents]`.
    pub ages: &'a [u8],
    /// The policy's input, `[worlds, joint]`.
    pub estimates: &'a [f32],
    /// `[worlds, logits]`.
    pub logits: &'a [f32],
    /// When.
    pub times: DecisionTimes,
}

impl Layout {
    /// Words of a sensor message.
    pub fn sensor_words(&self, worlds: usize) -> usize {
        self.age_words(worlds) + worlds * (self.action + DRAW + self.observation)
    }

    /// Words of an observation message.
    pub fn observation_words(&self, worlds: usize) -> usize {
        if self.relay {
            self.age_words(worlds) + worlds * self.agents * self.observation
        } else {
            worlds * self.observation
        }
    }

    /// Bytes of an observation message that are about one world, as far as they are sent by radio.
    pub(crate) fn radio_bytes(agents: usize, observation: usize, relay: bool) -> usize {
        let each = observation * size_of::<f32>();
        if relay { agents * (each + size_of::<u8>()) } else { each }
    }

    /// Writes an observation message of an agent that relays: the ages of what it holds of each agent, and that,
    /// both `[worlds, agents, ..]`.
    pub(crate) fn write_relayed(&self, words: &mut [u32], ages: &[u8], observations: &[f32]) {
        let (age_words, values) = words.split_at_mut(ages.len().div_ceil(size_of::<u32>()));
        write_ages(age_words, ages);
        values.copy_from_slice(bytemuck::cast_slice(observations));
    }

    /// Reads an observation message of [`Layout::observation_words`] words, which `sender` has sent.
    pub fn told<'a>(&self, words: &'a [u32], worlds: usize, sender: usize) -> Told<'a> {
        let (agents, observation) = (self.agents, self.observation);
        if !self.relay {
            return Told {
                agents,
                observation,
                sender,
                ages: &[],
                observations: bytemuck::cast_slice(words),
            };
        }
        let (ages, observations) = words.split_at(self.age_words(worlds));
        let (ages, observations) = (self.ages(ages, worlds), bytemuck::cast_slice(observations));
        Told { agents, observation, sender, ages, observations }
    }

    /// Words of a decision message.
    pub fn decision_words(&self, worlds: usize) -> usize {
        self.age_words(worlds) + worlds * (self.action + self.joint + self.logits) + TIMES
    }

    /// Words of the ages in a message.
    fn age_words(&self, worlds: usize) -> usize {
        (worlds * self.agents).div_ceil(size_of::<u32>())
    }

    /// Writes a sensor message from its parts, each `[worlds, ..]`.
    pub fn write_sensor(&self, words: &mut [u32], sensor: &Sensor) {
        let Sensor { carried_out, ages, draws, observations } = *sensor;
        let (action_words, rest) = words.split_at_mut(carried_out.len());
        action_words.copy_from_slice(carried_out);
        let (age_words, rest) = rest.split_at_mut(ages.len().div_ceil(size_of::<u32>()));
        write_ages(age_words, ages);
        let (draw_words, values) = rest.split_at_mut(DRAW * draws.len());
        draw_words.copy_from_slice(draws.as_flattened());
        values.copy_from_slice(bytemuck::cast_slice(observations));
    }

    /// Reads a sensor message of [`Layout::sensor_words`] words.
    pub fn sensor<'a>(&self, words: &'a [u32], worlds: usize) -> Sensor<'a> {
        let (carried_out, rest) = words.split_at(self.action * worlds);
        let (ages, rest) = rest.split_at(self.age_words(worlds));
        let (draws, observations) = rest.split_at(DRAW * worlds);
        Sensor {
            carried_out,
            ages: self.ages(ages, worlds),
            draws: bytemuck::cast_slice(draws),
            observations: bytemuck::cast_slice(observations),
        }
    }

    /// Writes a decision message from its parts, each `[worlds, ..]`, and its times.
    pub(crate) fn write_decision(
        &self,
        words: &mut [u32],
        actions: &[u32],
        ages: &[u8],
        estimates: &[f32],
        logits: &[f32],
        times: DecisionTimes,
    ) {
        let (action_words, rest) = words.split_at_mut(actions.len());
        action_words.copy_from_slice(actions);
        let (age_words, rest) = rest.split_at_mut(ages.len().div_ceil(size_of::<u32>()));
        write_ages(age_words, ages);
        let (estimate_words, logit_words) = rest.split_at_mut(estimates.len());
        estimate_words.copy_from_slice(bytemuck::cast_slice(estimates));
        let (logit_words, time_words) = logit_words.split_at_mut(logits.len());
        logit_words.copy_from_slice(bytemuck::cast_slice(logits));
        write_times(time_words, [times.received_ns, times.fused_ns]);
    }

    /// Has a decision message give its times by another clock.
    #[cfg(feature = "hosts")]
    pub(crate) fn translate_times(words: &mut [u32], translate: impl Fn(u64) -> u64) {
        let times = words.len() - TIMES;
        for pair in words[times..].chunks_exact_mut(2) {
            pair.copy_from_slice(&halves(translate(join([pair[0], pair[1]]))));
        }
    }

    /// Reads a decision message of [`Layout::decision_words`] words.
    pub fn decision<'a>(&self, words: &'a [u32], worlds: usize) -> Decision<'a> {
        let (actions, rest) = words.split_at(self.action * worlds);
        let (ages, rest) = rest.split_at(self.age_words(worlds));
        let (estimates, rest) = rest.split_at(self.joint * worlds);
        let (logits, times) = rest.split_at(self.logits * worlds);
        Decision {
            actions,
            ages: self.ages(ages, worlds),
            estimates: bytemuck::cast_slice(estimates),
            logits: bytemuck::cast_slice(logits),
            times: DecisionTimes {
                received_ns: join([times[0], times[1]]),
                fused_ns: join([times[2], times[3]]),
            },
        }
    }

    fn ages<'a>(&self, words: &'a [u32], worlds: usize) -> &'a [u8] {
        &bytemuck::cast_slice(words)[..worlds * self.agents]
    }
}

fn write_ages(words: &mut [u32], ages: &[u8]) {
    if let Some(last) = words.last_mut() {
        *last = 0;
    }
    bytemuck::cast_slice_mut(words)[..ages.len()].copy_from_slice(ages);
}

/// The halves of 64 bits, the low one first: words are all there is to a payload, which is aligned to them.
pub(crate) fn halves(bits: u64) -> [u32; 2] {
    [bits as u32, (bits >> 32) as u32]
}

/// What these are the halves of.
pub(crate) fn join([low, high]: [u32; 2]) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

fn write_times(words: &mut [u32], times: [u64; TIMES / 2]) {
    for (pair, time) in words.chunks_exact_mut(2).zip(times) {
        pair.copy_from_slice(&halves(time));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: Layout = Layout { agents: 3, observation: 3, action: 2, joint: 5, logits: 2, relay: false };

    #[test]
    fn a_sensor_message_comes_back() {
        let ages = [0, NOT_ARRIVED, 3, 100, 0, 1];
        let observations = [0.5, -1.0, f32::MIN_POSITIVE, 2.0, 3.0, 4.0];
        // Where an older message was before.
        let mut words = vec![u32::MAX; LAYOUT.sensor_words(2)];
        let (carried_out, draws) = (&[4, 0, 7, 1], [0.25f64, 0.75].map(|draw| halves(draw.to_bits())));
        let sent = Sensor { carried_out, ages: &ages, draws: &draws, observations: &observations };
        LAYOUT.write_sensor(&mut words, &sent);
        let sensor = LAYOUT.sensor(&words, 2);
        assert_eq!(sensor.draws.iter().map(|draw| f64::from_bits(join(*draw))).sum::<f64>(), 1.0);
        assert_eq!(sensor.carried_out, carried_out);
        assert_eq!((sensor.ages, sensor.observations), (&ages[..], &observations[..]));
        assert_eq!(words[5] >> 16, 0, "zeros fill the last word of the ages");
    }

    #[test]
    fn a_decision_comes_back() {
        let (actions, ages) = ([4, 0, 7, 1], [0, 2, NOT_ARRIVED, 0, 0, 254]);
        let (estimates, logits) = ([0.25; 10], [1.0, 2.0, 3.0, 4.0]);
        let times = DecisionTimes { received_ns: u64::MAX - 1, fused_ns: 1 << 40 };
        let mut words = vec![0; LAYOUT.decision_words(2)];
        LAYOUT.write_decision(&mut words, &actions, &ages, &estimates, &logits, times);
        let decision = LAYOUT.decision(&words, 2);
        assert_eq!(decision.actions, actions);
        assert_eq!(decision.ages, ages);
        assert_eq!((decision.estimates, decision.logits), (&estimates[..], &logits[..]));
        assert_eq!(decision.times, times);
        #[cfg(feature = "hosts")]
        {
            Layout::translate_times(&mut words, |ns| ns - 7);
            let times = DecisionTimes { received_ns: u64::MAX - 8, fused_ns: (1 << 40) - 7 };
            assert_eq!(LAYOUT.decision(&words, 2).times, times);
            assert_eq!(LAYOUT.decision(&words, 2).logits, logits);
        }
    }

    #[test]
    fn what_is_relayed_comes_back() {
        let layout = Layout { relay: true, ..LAYOUT };
        let ages = [3, 0, NOT_ARRIVED, NOT_ARRIVED, 0, 100];
        let observations: Vec<f32> = (0..18u8).map(f32::from).collect();
        let mut words = vec![u32::MAX; layout.observation_words(2)];
        assert_eq!(words.len(), 2 + 18);
        layout.write_relayed(&mut words, &ages, &observations);
        let told = layout.told(&words, 2, 1);
        assert_eq!(told.of(0, 0), Some((3, &[0.0, 1.0, 2.0][..])));
        assert_eq!(told.of(1, 1), Some((0, &[12.0, 13.0, 14.0][..])));
        assert_eq!((told.of(0, 2), told.of(1, 0), told.of(2, 0)), (None, None, None));
        assert!(told.is_possible() && !layout.told(&words, 2, 0).is_possible());
        // Where nobody relays, a message is about its sender alone.
        let told = LAYOUT.told(&words[2..8], 2, 1);
        assert_eq!((told.of(1, 1), told.of(1, 0)), (Some((0, &[3.0, 4.0, 5.0][..])), None));
        assert!(told.is_possible());
    }

    #[test]
    fn headers_of_others_do_not_fit() {
        let ours = Header {
            protocol: PROTOCOL,
            kind: Kind::Sensor as u32,
            swarm: 9,
            length: 4,
            ..Header::default()
        };
        assert!(ours.fits(Kind::Sensor, 9, 4));
        assert!(!ours.fits(Kind::Decision, 9, 4));
        assert!(!ours.fits(Kind::Sensor, 8, 4));
        assert!(!ours.fits(Kind::Sensor, 9, 5));
        assert!(!Header { protocol: 0, ..ours }.fits(Kind::Sensor, 9, 4));
    }
}
