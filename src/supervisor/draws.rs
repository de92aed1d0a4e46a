//! The draws by which agents sample their actions.

use super::Tick;
use crate::agent::AgentSettings;
use crate::base::rng::{Draws, Purpose};
use crate::bus::halves;

/// The uniform draws of a tick. They travel to the agents, so that those in other languages sample as ours do.
#[derive(Debug)]
pub(super) struct ActionDraws {
    /// `None` where the most probable actions are taken.
    seed: Option<u64>,
    /// `[agents, worlds]`, see [`Sensor::draws`](crate::bus::Sensor::draws).
    draws: Vec<[u32; 2]>,
}

impl ActionDraws {
    /// Those of a team with these settings.
    pub(super) fn of(settings: &AgentSettings) -> ActionDraws {
        ActionDraws { seed: (!settings.greedy).then_some(settings.seed), draws: Vec::new() }
    }

    /// Draws for all agents at this tick.
    pub(super) fn draw(&mut self, tick: &Tick) {
        self.draws.resize(tick.agents * tick.worlds, [0; 2]);
        let Some(seed) = self.seed else { return };
        for world in 0..tick.worlds {
            let episode = tick.episode + world as u64;
            let mut draws = Draws::new(seed, Purpose::Action, episode, tick.step.into());
            for agent in 0..tick.agents {
                let draw = draws.at(agent, 0).uniform();
                self.draws[agent * tick.worlds + world] = halves(draw.to_bits());
            }
        }
    }

    /// Those of the last tick drawn for, `[agents, worlds]`.
    pub(super) fn all(&self) -> &[[u32; 2]] {
        &self.draws
    }
}
