//! How the joint observation is put together.

use std::ops::Range;

use crate::environment::Spec;

/// Where the parts of the joint observation are: `unique_1 .. unique_n, common`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JointLayout {
    /// Size of the team.
    pub agents: usize,
    /// Values that are an agent's own.
    pub unique: usize,
    /// Values behind them in each observation that are the same for all, and always known.
    pub common: usize,
}

impl JointLayout {
    /// That of an environment.
    pub fn of(spec: &Spec) -> JointLayout {
        JointLayout { agents: spec.n_agents(), unique: spec.unique_dim(), common: spec.common_dim() }
    }

    /// Length of the joint observation.
    pub fn joint(&self) -> usize {
        self.predicted() + self.common
    }

    /// Length of its predicted part.
    pub fn predicted(&self) -> usize {
        self.agents * self.unique
    }

    /// Where the unique part of an agent is.
    pub fn part(&self, agent: usize) -> Range<usize> {
        agent * self.unique..(agent + 1) * self.unique
    }

    /// Puts `joint` together: the unique part of each agent from the front of what `known` knows of it, and the
    /// common part from `observation`, which may be anybody's.
    pub fn join<'a>(
        &self,
        mut known: impl FnMut(usize) -> &'a [f32],
        observation: &[f32],
        joint: &mut [f32],
    ) {
        let (parts, common) = joint.split_at_mut(self.predicted());
        for (agent, part) in parts.chunks_exact_mut(self.unique).enumerate() {
            part.copy_from_slice(&known(agent)[..self.unique]);
        }
        common.copy_from_slice(&observation[self.unique..self.unique + self.common]);
    }
}
