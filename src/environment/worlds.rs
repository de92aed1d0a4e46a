//! A batch of worlds, each of which is one value.

use glam::DVec2;

use super::{End, Environment, Outcome, Spec, State};
use crate::base::error::Result;

/// One world of an environment. [`Worlds`] makes a batch of them; no dynamic call is left within.
pub trait World: Send {
    /// Starts the episode of this address.
    fn reset(&mut self, seed: u64, episode: u64) -> Result<()>;

    /// Writes what `agent` observes now into `out`, zero-padded.
    fn observe(&self, agent: usize, out: &mut [f32]);

    /// One step with the agents' actions, `[agents, width]`: writes what each agent earned.
    fn step(&mut self, actions: &[u32], rewards: &mut [f64]) -> Result<End>;

    /// What can be said of its state.
    fn state(&self) -> State {
        State::default()
    }

    /// Puts it into a given state, as if just reset there. What is still heard of the step before follows from
    /// its actions, `[agents, width]`, if there was one.
    fn set_state(&mut self, state: &State, last_actions: Option<&[u32]>) -> Result<()>;

    /// Where the agents are, m; none where they have no places.
    fn positions(&self) -> &[DVec2] {
        &[]
    }
}

/// A batch of worlds.
pub struct Worlds<W> {
    spec: Spec,
    worlds: Vec<W>,
    /// Of one world, `[agents, width]`.
    actions: Vec<u32>,
}

impl<W: World> Worlds<W> {
    /// So many worlds of the environment that `spec` describes, each made by `make`.
    pub fn new(spec: Spec, worlds: usize, make: impl Fn(&Spec) -> W) -> Worlds<W> {
        let worlds = (0..worlds).map(|_| make(&spec)).collect();
        Worlds { actions: vec![0; spec.n_agents() * spec.action_width()], spec, worlds }
    }
}

impl<W: World> Environment for Worlds<W> {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn worlds(&self) -> usize {
        self.worlds.len()
    }

    fn reset(&mut self, world: usize, seed: u64, episode: u64) -> Result<()> {
        self.worlds[world].reset(seed, episode)
    }

    fn observe(&mut self, worlds: usize, out: &mut [f32]) -> Result<()> {
        let observations = out.chunks_exact_mut(self.spec.padded_obs_dim());
        for (row, observation) in observations.enumerate() {
            self.worlds[row % worlds].observe(row / worlds, observation);
        }
        Ok(())
    }

    fn step(&mut self, actions: &[u32], playing: &[bool], outcome: &mut Outcome) -> Result<()> {
        let (agents, width) = (self.spec.n_agents(), self.spec.action_width());
        let rewards = outcome.rewards.chunks_exact_mut(agents).zip(&mut outcome.ends);
        for (at, (rewards, end)) in rewards.enumerate().filter(|(world, _)| playing[*world]) {
            for (agent, own) in self.actions.chunks_exact_mut(width).enumerate() {
                own.copy_from_slice(&actions[(agent * playing.len() + at) * width..][..width]);
            }
            *end = self.worlds[at].step(&self.actions, rewards)?;
        }
        Ok(())
    }

    fn state(&self, world: usize) -> State {
        self.worlds[world].state()
    }

    fn set_state(&mut self, world: usize, state: &State, last_actions: Option<&[u32]>) -> Result<()> {
        self.worlds[world].set_state(state, last_actions)
    }

    fn positions(&self, world: usize) -> &[DVec2] {
        self.worlds[world].positions()
    }
}
