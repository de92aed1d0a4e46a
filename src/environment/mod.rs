//! The worlds the swarm lives in.
//!
//! An [`Environment`] is a batch of worlds that a [`Session`](crate::supervisor::Session) plays. A [`Spec`] describes
//! it, as data. If you have a single world, write a [`World`] and let [`Worlds`] make a batch of it. A [`Task`] is an
//! environment with a name: one line of the registry and one file per family.
//!
//! Most tasks are point-mass agents on a plane. Lengths are metres, times seconds, masses kilograms; the state is
//! `f64`, what agents observe is `f32`. The rules are those of the reference environments, down to the last
//! bits: `tests/suite/verify.rs` replays episodes recorded from them.

mod description;
mod family;
mod hear_see;
mod moment;
mod motor;
mod physics;
mod physics_spec;
pub(crate) mod places;
mod point_mass;
mod predator_prey;
mod registry;
mod rendezvous;
mod scout;
mod simple_spread;
mod speaker_listener;
mod spec;
mod spread;
mod target;
mod task;
mod wind;
mod worlds;

pub use description::Description;
pub use physics::{Body, Physics};
pub use physics_spec::PhysicsSpec;
pub use spec::{About, ActionSpace, AgentSpec, Axis, PaperSetting, Spec, TeamReward, Unit, Value};
pub use target::Target;
pub use task::Task;
pub use worlds::{Actions, World, Worlds};

use glam::DVec2;

use crate::base::error::Result;

/// A batch of worlds that play side by side, each its own episode.
///
/// The built-in ones allocate nothing in a step. An error of any method ends the play.
pub trait Environment: Send {
    /// What it is.
    fn spec(&self) -> &Spec;

    /// How many worlds there are.
    fn worlds(&self) -> usize;

    /// Starts an episode in a world. Its seed and number alone decide how it begins, and what is random in its steps.
    fn reset(&mut self, world: usize, seed: u64, episode: u64) -> Result<()>;

    /// Writes what the agents of the first `worlds` worlds observe now, `[agents, worlds, observation]`, each
    /// observation zero-padded behind its own [`Spec::obs_dim`]. A world whose episode is over goes on showing its last
    /// observations: training needs them if the episode was cut off.
    fn observe(&mut self, worlds: usize, out: &mut [f32]) -> Result<()>;

    /// One step of the worlds that play, with the actions `[agents, worlds, width]` of all worlds. Leaves the `outcome`
    /// of the other worlds as it is.
    ///
    /// Every action is one that its agent has.
    fn step(&mut self, actions: &[u32], playing: &[bool], outcome: &mut Outcome) -> Result<()>;

    /// The state of a world, for recordings.
    fn state(&self, world: usize) -> State;

    /// Puts a world into a given state, as if just reset there. If there was a step before, `last_actions` are its
    /// actions, `[agents, width]`: agents may still hear what was said in it. What is random in the steps of the episode
    /// goes on as if nothing had happened.
    fn set_state(&mut self, world: usize, state: &State, last_actions: Option<&[u32]>) -> Result<()>;

    /// Where the agents of a world are, m; empty if the environment has no places.
    fn positions(&self, world: usize) -> &[DVec2];
}

/// Where a step led.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// What each agent earned, `[worlds, agents]`.
    pub rewards: Vec<f64>,
    /// Whether each episode goes on, `[worlds]`.
    pub ends: Vec<End>,
}

/// Whether an episode goes on after a step. After [`Spec::episode_steps`] steps an open episode is truncated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// It goes on.
    #[default]
    Open,
    /// It is over, and nothing is left to earn.
    Terminated,
    /// It is cut off: something would be left to earn.
    Truncated,
}

/// The state of a world. What a world does not have stays empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Where the agents are, m.
    pub positions: Vec<DVec2>,
    /// How fast the agents move, m/s.
    pub velocities: Vec<DVec2>,
    /// Where the landmarks are, m.
    pub landmarks: Vec<DVec2>,
    /// Who else moves, and is not of the team.
    pub targets: Vec<Target>,
    /// The landmark that is the goal of all.
    pub goal: Option<usize>,
}

impl Outcome {
    /// Room for so many worlds of so many agents.
    pub fn of(worlds: usize, agents: usize) -> Outcome {
        Outcome { rewards: vec![0.0; worlds * agents], ends: vec![End::Open; worlds] }
    }
}

#[cfg(test)]
mod physics_tests;
#[cfg(test)]
mod tests;
