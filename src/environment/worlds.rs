//! A batch of worlds, each of which is one value.

use glam::DVec2;

use super::{End, Environment, Outcome, Spec, State};
use crate::base::error::Result;

/// One world of an environment. [`Worlds`] makes a batch of them, without dynamic calls inside it.
pub trait World: Send {
    /// Starts an episode. Its seed and number alone decide how it begins, and what is random in its steps.
    fn reset(&mut self, seed: u64, episode: u64) -> Result<()>;

    /// Writes what `agent` observes now into `out`, zero-padded.
    fn observe(&self, agent: usize, out: &mut [f32]);

    /// One step with the agents' actions: writes what each agent earned.
    fn step(&mut self, actions: Actions, rewards: &mut [f64]) -> Result<End>;

    /// Its state, for recordings.
    fn state(&self) -> State {
        State::default()
    }

    /// Puts it into a given state, as if just reset there. If there was a step before, these are its actions: agents
    /// may still hear what was said in it.
    fn set_state(&mut self, state: &State, last_actions: Option<Actions>) -> Result<()>;

    /// Where the agents are, m; empty if they have no places.
    fn positions(&self) -> &[DVec2] {
        &[]
    }
}

/// A batch of worlds.
pub struct Worlds<W> {
    spec: Spec,
    worlds: Vec<W>,
    /// Words of an action.
    width: usize,
}

/// What the agents of one world do.
#[derive(Clone, Copy, Debug)]
pub struct Actions<'a> {
    /// Those of agent 0 in front; those of other worlds lie between the agents'.
    words: &'a [u32],
    /// Words from an agent to the next.
    stride: usize,
    /// Words of an action.
    width: usize,
}

impl<'a> Actions<'a> {
    /// Those of a single world, `[agents, width]`.
    pub(crate) fn of_one_world(words: &'a [u32], width: usize) -> Actions<'a> {
        Actions { words, stride: width, width }
    }

    /// The words of what an agent does.
    pub fn of(&self, agent: usize) -> &'a [u32] {
        &self.words[agent * self.stride..][..self.width]
    }

    /// The number of its discrete action.
    pub fn choice(&self, agent: usize) -> u32 {
        self.words[agent * self.stride]
    }
}

impl<W: World> Worlds<W> {
    /// This many worlds of the environment that `spec` describes, each made by `make`.
    pub fn new(spec: Spec, worlds: usize, make: impl Fn(&Spec) -> W) -> Worlds<W> {
        let worlds = (0..worlds).map(|_| make(&spec)).collect();
        Worlds { width: spec.action_width(), spec, worlds }
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
        let length = self.spec.padded_obs_dim();
        let mut rest = out;
        for agent in 0..self.spec.n_agents() {
            for world in &self.worlds[..worlds] {
                let observation;
                (observation, rest) = rest.split_at_mut(length);
                world.observe(agent, observation);
            }
        }
        Ok(())
    }

    fn step(&mut self, actions: &[u32], playing: &[bool], outcome: &mut Outcome) -> Result<()> {
        let (agents, width) = (self.spec.n_agents(), self.width);
        let stride = playing.len() * width;
        let (mut words, mut rest) = (actions, &mut outcome.rewards[..]);
        let worlds = self.worlds[..playing.len()].iter_mut().zip(playing);
        for ((world, &plays), end) in worlds.zip(&mut outcome.ends) {
            let rewards;
            (rewards, rest) = rest.split_at_mut(agents);
            if plays {
                *end = world.step(Actions { words, stride, width }, rewards)?;
            }
            words = &words[width..];
        }
        Ok(())
    }

    fn state(&self, world: usize) -> State {
        self.worlds[world].state()
    }

    fn set_state(&mut self, world: usize, state: &State, last_actions: Option<&[u32]>) -> Result<()> {
        let last_actions = last_actions.map(|words| Actions::of_one_world(words, self.width));
        self.worlds[world].set_state(state, last_actions)
    }

    fn positions(&self, world: usize) -> &[DVec2] {
        self.worlds[world].positions()
    }
}
