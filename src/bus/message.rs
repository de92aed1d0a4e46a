//! Everything that is sent: one header and four layouts of 32-bit words.
//!
//! A message is a [`Header`] and a payload of words, written in place in a loaned sample and read in
//! place by its receivers. Floats travel as their bits. A message speaks for all parallel worlds of the
//! swarm at once, so every part below has one entry per world. Weights alone are for all worlds the same.

use iceoryx2::prelude::ZeroCopySend;

/// Version of the header and the layouts; a receiver refuses any other.
pub const PROTOCOL: u32 = 4;

/// What a message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Kind {
    /// Agent to supervisor: every port is open. One word: what it was [granted](crate::base::scheduling::Granted), in bits.
    Ready = 1,
    /// Supervisor to one agent: its own observation and its link rows.
    Sensor = 2,
    /// Agent to its peers: its observation.
    Observation = 3,
    /// Agent to supervisor: its actions.
    Decision = 4,
    /// Supervisor to one agent: leave.
    Shutdown = 5,
    /// Supervisor to all agents: new values of the policy.
    Weights = 6,
}

/// Stands before every payload.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
pub struct Header {
    /// [`PROTOCOL`].
    pub protocol: u32,
    /// A [`Kind`].
    pub kind: u32,
    /// Which swarm this belongs to.
    pub swarm: u64,
    /// How often the sender has been started in this swarm, from 0.
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
    /// When it was sent, nanoseconds of the monotonic clock.
    pub sent_ns: u64,
    /// When agents decide with the observations that have arrived, nanoseconds of the monotonic clock; 0 in lockstep,
    /// where they wait for all of them.
    pub deadline_ns: u64,
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
/// | sensor | link row (2: low and high half), own observation (`observation`) |
/// | observation | observation (`observation`) |
/// | decision | action (`action`), row used (2), joint estimate (`joint`), logits (`logits`) |
///
/// Behind the parts of a decision message stand the [`DecisionTimes`]. A weights message is all values of a policy, in the order of its tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Padded observation.
    pub observation: usize,
    /// Action.
    pub action: usize,
    /// Joint observation.
    pub joint: usize,
    /// Actions an agent chooses from.
    pub logits: usize,
}

/// Words of the [`DecisionTimes`].
const TIMES: usize = 4;

/// An agent's reading of its own sensor, and its rows of the link masks.
#[derive(Clone, Copy, Debug)]
pub struct Sensor<'a> {
    rows: &'a [u32],
    observations: &'a [f32],
}

impl<'a> Sensor<'a> {
    /// Bit j tells whether the link from agent j is up in this world.
    pub fn row(&self, world: usize) -> u64 {
        join(&self.rows[2 * world..2 * world + 2])
    }

    /// The agent's own observations, `[worlds, observation]`.
    pub fn observations(&self) -> &'a [f32] {
        self.observations
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
    rows: &'a [u32],
    /// The policy's input, `[worlds, joint]`.
    pub estimates: &'a [f32],
    /// `[worlds, logits]`.
    pub logits: &'a [f32],
    /// When.
    pub times: DecisionTimes,
}

impl Decision<'_> {
    /// Bit j tells whether agent j's observation of this tick was used in this world.
    pub fn row(&self, world: usize) -> u64 {
        join(&self.rows[2 * world..2 * world + 2])
    }
}

impl Layout {
    /// Words of a sensor message.
    pub fn sensor_words(&self, worlds: usize) -> usize {
        worlds * (2 + self.observation)
    }

    /// Words of an observation message.
    pub fn observation_words(&self, worlds: usize) -> usize {
        worlds * self.observation
    }

    /// Words of a decision message.
    pub fn decision_words(&self, worlds: usize) -> usize {
        worlds * (self.action + 2 + self.joint + self.logits) + TIMES
    }

    /// Writes a sensor message: `rows` has one entry, `observations` `[worlds, observation]`.
    pub fn write_sensor(&self, words: &mut [u32], rows: &[u64], observations: &[f32]) {
        let (row_words, values) = words.split_at_mut(2 * rows.len());
        split_rows(row_words, rows);
        values.copy_from_slice(bytemuck::cast_slice(observations));
    }

    /// Reads a sensor message of [`Layout::sensor_words`] words.
    pub fn sensor<'a>(&self, words: &'a [u32], worlds: usize) -> Sensor<'a> {
        let (rows, values) = words.split_at(2 * worlds);
        Sensor { rows, observations: bytemuck::cast_slice(values) }
    }

    /// Writes a decision message from its parts, each `[worlds, ..]`, and its times.
    pub fn write_decision(
        &self,
        words: &mut [u32],
        actions: &[u32],
        rows: &[u64],
        estimates: &[f32],
        logits: &[f32],
        times: DecisionTimes,
    ) {
        let (action_words, rest) = words.split_at_mut(actions.len());
        action_words.copy_from_slice(actions);
        let (row_words, rest) = rest.split_at_mut(2 * rows.len());
        split_rows(row_words, rows);
        let (estimate_words, logit_words) = rest.split_at_mut(estimates.len());
        estimate_words.copy_from_slice(bytemuck::cast_slice(estimates));
        let (logit_words, time_words) = logit_words.split_at_mut(logits.len());
        logit_words.copy_from_slice(bytemuck::cast_slice(logits));
        split_rows(time_words, &[times.received_ns, times.fused_ns]);
    }

    /// Reads a decision message of [`Layout::decision_words`] words.
    pub fn decision<'a>(&self, words: &'a [u32], worlds: usize) -> Decision<'a> {
        let (actions, rest) = words.split_at(self.action * worlds);
        let (rows, rest) = rest.split_at(2 * worlds);
        let (estimates, rest) = rest.split_at(self.joint * worlds);
        let (logits, times) = rest.split_at(self.logits * worlds);
        Decision {
            actions,
            rows,
            estimates: bytemuck::cast_slice(estimates),
            logits: bytemuck::cast_slice(logits),
            times: DecisionTimes { received_ns: join(&times[..2]), fused_ns: join(&times[2..]) },
        }
    }
}

fn join(words: &[u32]) -> u64 {
    u64::from(words[0]) | u64::from(words[1]) << 32
}

fn split_rows(words: &mut [u32], rows: &[u64]) {
    for (pair, row) in words.chunks_exact_mut(2).zip(rows) {
        pair.copy_from_slice(&[*row as u32, (*row >> 32) as u32]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: Layout = Layout { observation: 3, action: 2, joint: 5, logits: 2 };

    #[test]
    fn a_sensor_message_comes_back() {
        let rows = [1 << 63 | 0b101, 0b010];
        let observations = [0.5, -1.0, f32::MIN_POSITIVE, 2.0, 3.0, 4.0];
        let mut words = vec![0; LAYOUT.sensor_words(2)];
        LAYOUT.write_sensor(&mut words, &rows, &observations);
        let sensor = LAYOUT.sensor(&words, 2);
        assert_eq!([sensor.row(0), sensor.row(1)], rows);
        assert_eq!(sensor.observations(), observations);
    }

    #[test]
    fn a_decision_comes_back() {
        let (actions, rows) = ([4, 0, 7, 1], [3, u64::MAX]);
        let (estimates, logits) = ([0.25; 10], [1.0, 2.0, 3.0, 4.0]);
        let times = DecisionTimes { received_ns: u64::MAX - 1, fused_ns: 1 << 40 };
        let mut words = vec![0; LAYOUT.decision_words(2)];
        LAYOUT.write_decision(&mut words, &actions, &rows, &estimates, &logits, times);
        let decision = LAYOUT.decision(&words, 2);
        assert_eq!(decision.actions, actions);
        assert_eq!([decision.row(0), decision.row(1)], rows);
        assert_eq!((decision.estimates, decision.logits), (&estimates[..], &logits[..]));
        assert_eq!(decision.times, times);
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
