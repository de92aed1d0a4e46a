//! What an agent holds of others: the newest that has reached it, which it passes on.

use super::Inbox;
use crate::bus::{Layout, NOT_ARRIVED};
use crate::link::LONGEST_DELAY;

/// The newest observation of each other agent that has reached an agent, as it was made. What the agent imputes is not
/// among them.
///
/// What is older than [`LONGEST_DELAY`] ticks is no longer held. An agent that was away for a tick holds nothing of before:
/// nobody knows what it remembers.
#[derive(Debug)]
pub(crate) struct Holdings {
    layout: Layout,
    agent: usize,
    /// The tick.
    now: u64,
    /// At which tick it was made, `[worlds, agents]`.
    made: Vec<Option<u64>>,
    /// `[worlds, agents, observation]`. There is room for the own one, which goes out with the others.
    observations: Vec<f32>,
    /// How old it is, for a message, `[worlds, agents]`.
    ages: Vec<u8>,
}

impl Holdings {
    /// Those of an agent that holds nothing, in at most so many worlds.
    pub(crate) fn new(layout: Layout, agent: usize, worlds: usize) -> Holdings {
        let rows = worlds * layout.agents;
        Holdings {
            layout,
            agent,
            now: 0,
            made: vec![None; rows],
            observations: vec![0.0; rows * layout.observation],
            ages: vec![NOT_ARRIVED; rows],
        }
    }

    /// Whose these are.
    pub(crate) fn agent(&self) -> usize {
        self.agent
    }

    /// A tick begins: what is held grows older.
    pub(crate) fn begin_tick(&mut self, tick: u64) {
        if tick > self.now + 1 {
            self.forget();
        }
        self.now = tick;
    }

    /// Nothing is held any more: an episode begins.
    pub(crate) fn forget(&mut self) {
        self.made.fill(None);
    }

    /// How old what is held of an agent is, or [`NOT_ARRIVED`].
    pub(crate) fn age(&self, world: usize, origin: usize) -> u8 {
        let age = self.made[world * self.layout.agents + origin].map(|made| self.now - made);
        age.filter(|age| *age <= LONGEST_DELAY.into()).map_or(NOT_ARRIVED, |age| age as u8)
    }

    /// Writes the observation message of an agent that observes this, `[worlds, observation]`.
    pub(crate) fn write(&mut self, own: &[f32], words: &mut [u32]) {
        let Layout { agents, observation, .. } = self.layout;
        let worlds = own.len() / observation;
        for (world, own) in own.chunks_exact(observation).enumerate() {
            for origin in 0..agents {
                let (at, age) = (world * agents + origin, self.age(world, origin));
                self.ages[at] = if origin == self.agent { 0 } else { age };
                let held = &mut self.observations[at * observation..][..observation];
                match self.ages[at] {
                    0 => held.copy_from_slice(own),
                    NOT_ARRIVED => held.fill(0.0),
                    _ => {}
                }
            }
        }
        let (rows, values) = (worlds * agents, worlds * agents * observation);
        self.layout.write_relayed(words, &self.ages[..rows], &self.observations[..values]);
    }

    /// Takes in what arrives in one world.
    pub(crate) fn take(&mut self, world: usize, inbox: &Inbox) {
        let Layout { agents, observation, .. } = self.layout;
        for origin in (0..agents).filter(|origin| *origin != self.agent) {
            if let Some(received) = inbox.from(origin) {
                let at = world * agents + origin;
                self.made[at] = self.now.checked_sub(received.age.into());
                self.observations[at * observation..][..observation].copy_from_slice(received.observation);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Received;
    use super::*;

    const LAYOUT: Layout = Layout { agents: 3, observation: 1, action: 1, joint: 3, logits: 0, relay: true };

    /// What agent 1 tells of agent 0, if that observed 7.0 at tick 5, after these ticks.
    fn told(ticks: &[u64]) -> Option<(u8, f32)> {
        let mut holdings = Holdings::new(LAYOUT, 1, 1);
        for tick in [4, 5] {
            holdings.begin_tick(tick);
        }
        let received = Received { age: 0, observation: &[7.0] };
        holdings.take(0, &Inbox::of(3, |sender| (sender == 0).then_some(received)));
        ticks.iter().for_each(|tick| holdings.begin_tick(*tick));
        let mut words = vec![0; LAYOUT.observation_words(1)];
        holdings.write(&[9.0], &mut words);
        let told = LAYOUT.told(&words, 1, 1);
        assert_eq!((told.of(0, 1), told.of(0, 2)), (Some((0, &[9.0][..])), None));
        assert!(told.is_possible());
        told.of(0, 0).map(|(age, observation)| (age, observation[0]))
    }

    #[test]
    fn what_is_held_grows_old_and_is_forgotten_in_the_end() {
        assert_eq!(told(&[6]), Some((1, 7.0)));
        assert_eq!(told(&[6, 6, 7]), Some((2, 7.0)));
        let ticks: Vec<u64> = (6..=105).collect();
        assert_eq!(told(&ticks), Some((100, 7.0)));
        assert_eq!(told(&[&ticks[..], &[106]].concat()), None);
    }

    #[test]
    fn who_was_away_holds_nothing() {
        assert_eq!(told(&[7]), None);
    }
}
