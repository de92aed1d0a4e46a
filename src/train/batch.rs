//! What a team learns from: whole episodes.

use std::ops::Range;

use super::memory::Buffer;
use crate::environment::Spec;

/// Episodes of equal length, played side by side. Everything is ordered by time, then episode, then agent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// The number of episodes, E.
    pub episodes: usize,
    /// The number of steps of each, T.
    pub steps: usize,
    /// Padded observations, `[T + 1, E, agents, observation]`; the last ones follow on the last actions.
    pub observations: Vec<f32>,
    /// True joint observations, `[T + 1, E, joint]`.
    pub joint: Vec<f32>,
    /// What each actor saw in their place, with imputed parts, `[T + 1, E, agents, joint]`; empty if everything was delivered.
    pub estimates: Vec<f32>,
    /// What the agents did, `[T, E, agents]`.
    pub actions: Vec<u8>,
    /// The team's reward, `[T, E]`.
    pub rewards: Vec<f32>,
}

/// Trajectories that a predictor learns from, ordered by time.
#[derive(Clone, Copy, Debug)]
pub struct Trajectories<'a> {
    /// The number of trajectories.
    pub rows: usize,
    /// The number of joint observations of each that count. Episodes end with one that does not: that after
    /// the last action.
    pub observations: usize,
    /// Joint observations, `[observations or more, rows, joint]`.
    pub joint: &'a [f32],
}

impl Batch {
    /// The episodes as trajectories.
    pub fn trajectories(&self) -> Trajectories<'_> {
        Trajectories { rows: self.episodes, observations: self.steps, joint: &self.joint }
    }

    /// What actors saw, and how many parts a row of it has: one per agent, or one for all.
    pub(super) fn seen(&self, n_agents: usize) -> (&[f32], usize) {
        match self.estimates.is_empty() {
            true => (&self.joint, 1),
            false => (&self.estimates, n_agents),
        }
    }

    /// Checks that all lengths belong together.
    pub(super) fn check(&self, n_agents: usize, joint: usize) {
        let rows = self.steps * self.episodes;
        assert!(rows > 0, "a batch has episodes with steps");
        assert_eq!(self.actions.len(), rows * n_agents, "actions are not [T, E, agents]");
        assert_eq!(self.rewards.len(), rows, "rewards are not [T, E]");
        let rows = rows + self.episodes;
        assert_eq!(self.joint.len(), rows * joint, "joint observations are not [T + 1, E, joint]");
        assert!(
            self.estimates.is_empty() || self.estimates.len() == rows * n_agents * joint,
            "estimates are not [T + 1, E, agents, joint]"
        );
        assert_eq!(
            self.observations.len() % (rows * n_agents),
            0,
            "observations are not [T + 1, E, agents, _]"
        );
    }

    /// Room for so many episodes, all zero, with or without estimates.
    pub fn zeros(spec: &Spec, episodes: usize, estimates: bool) -> Batch {
        let steps = spec.episode_steps;
        let (n_agents, rows) = (spec.n_agents(), steps * episodes);
        let seen = if estimates { rows + episodes } else { 0 };
        Batch {
            episodes,
            steps,
            observations: vec![0.0; (rows + episodes) * n_agents * spec.padded_obs_dim()],
            joint: vec![0.0; (rows + episodes) * spec.joint_dim()],
            estimates: vec![0.0; seen * n_agents * spec.joint_dim()],
            actions: vec![0; rows * n_agents],
            rewards: vec![0.0; rows],
        }
    }
}

/// Writes the inputs of a network that serves `agents`, `[.., agents, width]`, behind each other to `x`: for
/// every row of `inputs` `[.., sources, width]` the part of each agent, or the one part there is, and behind it
/// the agent's id as a one-hot of length `ids`.
pub(super) fn gather(
    inputs: &[f32],
    sources: usize,
    width: usize,
    agents: &Range<usize>,
    ids: usize,
    x: &mut Buffer,
) {
    let rows = inputs.len() / (sources * width);
    let parts = inputs.chunks_exact(sources * width).flat_map(|row| {
        agents.clone().map(move |agent| (agent, &row[agent.min(sources - 1) * width..][..width]))
    });
    let x = x.resize(rows * agents.len() * (width + ids));
    for ((agent, part), x) in parts.zip(x.chunks_exact_mut(width + ids)) {
        let (values, id) = x.split_at_mut(width);
        values.copy_from_slice(part);
        id.fill(0.0);
        if let Some(one) = id.get_mut(agent) {
            *one = 1.0;
        }
    }
}
