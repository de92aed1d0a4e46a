//! The worlds the swarm lives in: point-mass agents on a plane, one shared goal, 25 steps an episode.
//!
//! A [`Task`] says who lives in a world and what they are paid for, [`Physics`] how bodies move, and a
//! [`World`] is one episode under way. Lengths are metres, times seconds, masses kilograms; the state is
//! `f64`, what agents observe is `f32`. The rules are those of the reference environments the paper trains
//! on, down to the last bits: `tests/verify.rs` replays episodes recorded from them.

mod hear_see;
mod names;
mod observed;
mod physics;
mod speaker_listener;
mod spread;
mod task;

use glam::{DVec2, dvec2};

use crate::base::rng::{Draws, Purpose};
pub use observed::{Observed, Unit};
pub use physics::{Body, Physics};
use task::Family;
pub use task::Task;

/// The steps of an episode. The time limit cuts the episode off; nothing in the world ends there.
pub const EPISODE_STEPS: usize = 25;

/// The actions of an agent: 0 nothing, 1 `+x`, 2 `-x`, 3 `+y`, 4 `-y`. For the speaker 0 to 2 are messages.
pub const N_ACTIONS: usize = 5;

/// One world and the state of its episode.
///
/// After [`World::new`] everything lies at the origin: an episode begins with [`World::reset`] or
/// [`World::set_state`]. Stepping and observing allocate nothing.
#[derive(Clone, Debug)]
pub struct World {
    task: Task,
    positions: Vec<DVec2>,
    velocities: Vec<DVec2>,
    landmarks: Vec<DVec2>,
    /// The landmark all go to; 0 where the task has no goal.
    goal: usize,
    message: Option<u8>,
    forces: Vec<DVec2>,
    rewards: Vec<f64>,
}

impl World {
    /// A world for `task`, before its first episode.
    pub fn new(task: &Task) -> World {
        let n = task.n_agents();
        World {
            task: task.clone(),
            positions: vec![DVec2::ZERO; n],
            velocities: vec![DVec2::ZERO; n],
            landmarks: vec![DVec2::ZERO; task.n_landmarks()],
            goal: 0,
            message: None,
            forces: vec![DVec2::ZERO; n],
            rewards: vec![0.0; n],
        }
    }

    /// The task of this world.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// Starts the episode of this address: all at rest, everything uniform in `[-1, 1]^2`.
    ///
    /// The draws are those of ([`Purpose::Reset`], episode, step 0) in a fixed order: x and y of each
    /// agent, x and y of each landmark, then the goal where one is drawn.
    pub fn reset(&mut self, seed: u64, episode: u64) {
        let mut draws = Draws::new(seed, Purpose::Reset, episode, 0);
        for place in self.positions.iter_mut().chain(&mut self.landmarks) {
            *place = dvec2(draws.between(-1.0, 1.0), draws.between(-1.0, 1.0));
        }
        if self.task.family == Family::SpeakerListener {
            self.goal = draws.below(self.landmarks.len());
        }
        self.velocities.fill(DVec2::ZERO);
        self.message = None;
        self.rewards.fill(0.0);
    }

    /// One step of 0.1 s: agents act, collide and move, and are paid for where they end up.
    ///
    /// An action that its agent does not have (see [`Task::available_actions`]) does nothing: a body gets
    /// no force and the speaker stays silent. Whoever receives actions from outside reports them first.
    ///
    /// # Panics
    /// If there is not one action per agent.
    pub fn step(&mut self, actions: &[u8]) {
        assert_eq!(actions.len(), self.task.n_agents(), "one action per agent");
        self.act(actions);
        self.collide();
        self.integrate();
        self.reward();
    }

    fn act(&mut self, actions: &[u8]) {
        for (force, &action) in self.forces.iter_mut().zip(actions) {
            *force = self.task.physics.action_force(action);
        }
        self.message = self.task.message(actions);
    }

    fn collide(&mut self) {
        self.task.physics.add_contact_forces(&self.positions, &mut self.forces);
    }

    fn integrate(&mut self) {
        self.task.physics.integrate(&self.forces, &mut self.velocities, &mut self.positions);
    }

    fn reward(&mut self) {
        match self.task.family {
            Family::HearSee => hear_see::reward(self),
            Family::SpeakerListener => speaker_listener::reward(self),
            Family::SpreadXy | Family::SpreadBlindfold => spread::reward(self),
        }
    }

    /// What each agent earned in the last step; zeros before the first.
    pub fn agent_rewards(&self) -> &[f64] {
        &self.rewards
    }

    /// What the team earned in the last step: the sum over agents, times their number.
    ///
    /// In the reference environments every agent is paid the sum, and the trainer adds up the n copies.
    /// The return of an episode is the plain sum of these, the unit of the paper's tables.
    pub fn team_reward(&self) -> f64 {
        self.rewards.len() as f64 * self.rewards.iter().sum::<f64>()
    }

    /// Writes what `agent` observes now into `out`, zero-padded behind its own [`Task::obs_dim`].
    ///
    /// # Panics
    /// If there is no such agent or `out` is not [`Task::padded_obs_dim`] long.
    pub fn observe(&self, agent: usize, out: &mut [f32]) {
        assert!(agent < self.task.n_agents(), "the agents are counted from 0");
        assert_eq!(out.len(), self.task.padded_obs_dim(), "an observation is written padded");
        match self.task.family {
            Family::HearSee => hear_see::observe(self, agent, out),
            Family::SpeakerListener => speaker_listener::observe(self, agent, out),
            Family::SpreadXy => spread::observe_axis(self, agent, out),
            Family::SpreadBlindfold => spread::observe_self(self, agent, out),
        }
    }

    /// Where the agents are, m.
    pub fn positions(&self) -> &[DVec2] {
        &self.positions
    }

    /// How fast the agents move, m/s.
    pub fn velocities(&self) -> &[DVec2] {
        &self.velocities
    }

    /// Where the landmarks are, m.
    pub fn landmarks(&self) -> &[DVec2] {
        &self.landmarks
    }

    /// The landmark that is the goal; `None` in the spread tasks, where all of them are.
    pub fn goal(&self) -> Option<usize> {
        self.task.has_goal().then_some(self.goal)
    }

    /// What the speaker said in the last step; `None` before the first step and in every other task.
    pub fn message(&self) -> Option<u8> {
        self.message
    }

    /// Puts the world into a given state, as if just reset there: rewards are zero. What is still heard of
    /// the step before follows from its actions, if there was one.
    ///
    /// # Panics
    /// If the state is none of this task's: wrong numbers of agents, landmarks or actions, or a goal where
    /// the task has none or the other way round.
    pub fn set_state(
        &mut self,
        positions: &[DVec2],
        velocities: &[DVec2],
        landmarks: &[DVec2],
        goal: Option<usize>,
        last_actions: Option<&[u8]>,
    ) {
        assert_eq!(goal.is_some(), self.task.has_goal(), "a goal exactly where the task has one");
        assert!(goal.is_none_or(|goal| goal < self.landmarks.len()), "the goal is a landmark");
        assert!(last_actions.is_none_or(|last| last.len() == self.rewards.len()), "one action per agent");
        self.positions.copy_from_slice(positions);
        self.velocities.copy_from_slice(velocities);
        self.landmarks.copy_from_slice(landmarks);
        self.goal = goal.unwrap_or(0);
        self.message = last_actions.and_then(|last| self.task.message(last));
        self.rewards.fill(0.0);
    }
}

/// Writes `vectors` as consecutive x, y to the front of `out`.
fn write(vectors: &[DVec2], out: &mut [f32]) {
    let (pairs, _) = out.as_chunks_mut();
    for (pair, vector) in pairs.iter_mut().zip(vectors) {
        *pair = vector.as_vec2().to_array();
    }
}

#[cfg(test)]
mod tests;
