//! What a team learns from: whole episodes.

use std::ops::Range;

use super::ends::Ends;
use super::memory::Buffer;
use crate::bus::NOT_ARRIVED;
use crate::environment::Spec;
use crate::nn::Senses;

/// Episodes played side by side. Everything is ordered by time, then episode, then agent. What stands behind the
/// end of an episode may be anything, and changes nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// The number of episodes, E.
    pub episodes: usize,
    /// The number of steps of the longest, T.
    pub steps: usize,
    /// Padded observations, `[T + 1, E, agents, observation]`; the last ones follow on the last actions.
    pub observations: Vec<f32>,
    /// True joint observations, `[T + 1, E, joint]`.
    pub joint: Vec<f32>,
    /// What each actor saw in their place, with imputed parts, `[T + 1, E, agents, joint]`; empty if everything was delivered.
    pub estimates: Vec<f32>,
    /// How old what arrived at each agent was, by sender, `[T + 1, E, agents, agents]`, 255 for nothing; empty if nobody
    /// asks.
    pub ages: Vec<u8>,
    /// What the agents did, `[T, E, agents]`.
    pub actions: Vec<u8>,
    /// The team's reward, `[T, E]`.
    pub rewards: Vec<f32>,
    /// How each episode ended.
    pub ends: Ends,
}

/// Trajectories that a predictor learns from, ordered by time.
#[derive(Clone, Copy, Debug)]
pub struct Trajectories<'a> {
    /// The number of trajectories.
    pub rows: usize,
    /// The number of joint observations of the longest that count. Episodes end with one that does not: that after
    /// the last action.
    pub observations: usize,
    /// The number of those of each.
    pub lengths: &'a [usize],
    /// Joint observations, `[observations or more, rows, joint]`.
    pub joint: &'a [f32],
    /// What the agents made of them, `[observations or more, rows, agents, joint]`; empty where predictors are to see the
    /// truth.
    pub estimates: &'a [f32],
    /// How old what arrived at each agent was, `[observations or more, rows, agents, agents]`; empty where nobody sees that,
    /// or everything arrived.
    pub ages: &'a [u8],
    /// What the agents did at each of them, `[observations or more, rows, agents]`; empty where nobody sees that.
    pub actions: &'a [u8],
}

impl Trajectories<'_> {
    /// How many transitions of a trajectory there are to learn from: both of their observations count.
    pub(super) fn transitions(&self, row: usize) -> usize {
        self.lengths[row].saturating_sub(1)
    }

    /// Whether row `at` of `[observations, rows]` begins one of them.
    pub(super) fn has_transition(&self, at: usize) -> bool {
        at / self.rows < self.transitions(at % self.rows)
    }
}

impl Batch {
    /// The episodes as trajectories of which predictors see the truth.
    pub fn trajectories(&self) -> Trajectories<'_> {
        Trajectories {
            rows: self.episodes,
            observations: self.steps,
            lengths: self.ends.lengths(),
            joint: &self.joint,
            estimates: &[],
            ages: &[],
            actions: &self.actions,
        }
    }

    /// The episodes as trajectories of which predictors see what the agents saw.
    pub fn trajectories_as_seen(&self) -> Trajectories<'_> {
        Trajectories { estimates: &self.estimates, ages: &self.ages, ..self.trajectories() }
    }

    /// What means are over: steps played, episodes and agents.
    pub(super) fn entries(&self, n_agents: usize) -> usize {
        self.ends.steps_played() * n_agents
    }

    /// What actors saw, and how many parts a row of it has: one per agent, or one for all.
    pub(super) fn seen(&self, n_agents: usize) -> (&[f32], usize) {
        if self.estimates.is_empty() { (&self.joint, 1) } else { (&self.estimates, n_agents) }
    }

    /// Writes what actors of these `agents` see with such `senses`, `[T, E, agents, inputs]`, to `x`.
    pub(super) fn see(&self, n_agents: usize, agents: &Range<usize>, senses: &mut Senses, x: &mut Vec<f32>) {
        let (seen, sources) = self.seen(n_agents);
        let width = seen.len() / ((self.steps + 1) * self.episodes * sources);
        senses.start(self.episodes * agents.len());
        x.clear();
        for at in 0..self.steps * self.episodes {
            for (view, agent) in agents.clone().enumerate() {
                let row = at % self.episodes * agents.len() + view;
                for sender in 0..n_agents {
                    let age =
                        self.ages.get((at * n_agents + agent) * n_agents + sender).copied().unwrap_or(0);
                    let arrived = Some(age).filter(|age| *age != NOT_ARRIVED);
                    senses.hear(row, sender, if sender == agent { Some(0) } else { arrived });
                }
                let from = (at * sources + agent.min(sources - 1)) * width;
                senses.show(row, agent, &seen[from..from + width], x);
            }
        }
    }

    /// Checks that all lengths belong together.
    pub(super) fn check(&self, n_agents: usize, joint: usize) {
        let rows = self.steps * self.episodes;
        assert!(rows > 0, "a batch has episodes with steps");
        assert_eq!(self.actions.len(), rows * n_agents, "actions are not [T, E, agents]");
        assert_eq!(self.rewards.len(), rows, "rewards are not [T, E]");
        assert_eq!(self.ends.lengths().len(), self.episodes, "ends are not [E]");
        assert!(
            self.ends.lengths().iter().all(|length| (1..=self.steps).contains(length)),
            "an episode has 1 to T steps"
        );
        let rows = rows + self.episodes;
        assert_eq!(self.joint.len(), rows * joint, "joint observations are not [T + 1, E, joint]");
        assert!(
            self.estimates.is_empty() || self.estimates.len() == rows * n_agents * joint,
            "estimates are not [T + 1, E, agents, joint]"
        );
        assert!(
            self.ages.is_empty() || self.ages.len() == rows * n_agents * n_agents,
            "ages are not [T + 1, E, agents, agents]"
        );
        assert_eq!(
            self.observations.len() % (rows * n_agents),
            0,
            "observations are not [T + 1, E, agents, _]"
        );
    }

    /// This batch with room for ages.
    pub(super) fn with_ages(self, n_agents: usize) -> Batch {
        Batch { ages: vec![NOT_ARRIVED; (self.steps + 1) * self.episodes * n_agents * n_agents], ..self }
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
            ages: Vec::new(),
            actions: vec![0; rows * n_agents],
            rewards: vec![0.0; rows],
            ends: Ends::truncated(episodes, steps),
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
