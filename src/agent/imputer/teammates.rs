//! Teammates act by the same policy file: what they will do can be asked of their actors.

use std::ops::Range;

use super::motion::{Motion, remaining};
use super::{Imputer, Setup, Step};
use crate::agent::Inbox;
use crate::base::error::Result;
use crate::nn::{Inference, NetworkState, Scratch};

/// Everybody is moved on by the dynamics that the policy file holds: the agent itself by the action that was carried out,
/// each teammate by the mean of what its actions do, with the probabilities that its actor gives them on what *this* agent
/// believes. What the dynamics do not move is what the policy's best predictor says, or held if it has none.
#[derive(Debug)]
pub(super) struct Teammates {
    others: Box<dyn Imputer>,
    motion: Motion,
    agent: usize,
    teammates: Vec<Teammate>,
    scratch: Scratch,
    logits: Vec<f32>,
    n_actions: usize,
}

/// A teammate, as this agent imagines it.
#[derive(Debug)]
struct Teammate {
    agent: usize,
    actor: Inference,
    /// Where its weights are in those of the policy.
    weights: Range<usize>,
    state: NetworkState,
    /// What its actions are expected to add to its velocity, m/s, `[worlds]`.
    pushes: Vec<[f64; 2]>,
}

impl Teammates {
    /// With the dynamics, the actors and the preferred predictor of the policy.
    ///
    /// # Errors
    /// `Usage` if the policy has no dynamics, or not of this environment.
    pub(super) fn new(setup: &Setup) -> Result<Teammates> {
        let (policy, n_actions) = (setup.policy, setup.spec.n_actions());
        let teammate = |agent: usize| Teammate {
            agent,
            state: policy.actor(agent).state(setup.worlds),
            actor: policy.actor(agent).clone(),
            weights: policy.actor_range(agent),
            pushes: Vec::with_capacity(setup.worlds),
        };
        Ok(Teammates {
            others: remaining(setup),
            motion: Motion::new(setup)?,
            agent: setup.agent,
            teammates: (0..setup.spec.n_agents())
                .filter(|agent| *agent != setup.agent)
                .map(teammate)
                .collect(),
            scratch: Scratch::default(),
            logits: vec![0.0; setup.worlds * n_actions],
            n_actions,
        })
    }

    fn advance(&mut self, step: &Step) {
        let Teammates { motion, agent, teammates, .. } = self;
        for (world, &action) in step.actions.iter().enumerate() {
            let own = (*agent, motion.dynamics.push(*agent, action as usize));
            let others = teammates.iter().map(|teammate| (teammate.agent, teammate.pushes[world]));
            motion.advance(world, step.estimates, others.chain([own]));
        }
    }
}

impl Imputer for Teammates {
    fn begin_episodes(&mut self, worlds: usize) {
        self.others.begin_episodes(worlds);
        self.motion.begin_episodes();
        self.teammates.iter_mut().for_each(|teammate| teammate.state.start(worlds));
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.others.fuse(world, own, inbox, estimate);
        let teammates = self.teammates.iter().map(|teammate| teammate.agent);
        self.motion.correct(world, teammates.chain([self.agent]), inbox, estimate);
    }

    fn predict(&mut self, step: &Step) {
        self.others.predict(step);
        self.motion.keep(step.estimates);
        let Teammates { motion, teammates, scratch, logits, n_actions, .. } = self;
        let worlds = step.actions.len();
        for Teammate { agent, actor, state, pushes, .. } in teammates {
            let logits = &mut logits[..worlds * *n_actions];
            actor.step(worlds, step.estimates, &[], state, scratch, logits);
            pushes.clear();
            let of_actions = &motion.dynamics.pushes[*agent];
            pushes.extend(logits.chunks_exact(*n_actions).map(|logits| expectation(logits, of_actions)));
        }
        self.advance(step);
    }

    fn revise(&mut self, step: &Step) {
        self.others.revise(step);
        self.advance(step);
    }

    fn renew(&mut self, weights: &[f32]) {
        self.others.renew(weights);
        for Teammate { actor, weights: range, .. } in &mut self.teammates {
            actor.renew(&weights[range.clone()]);
        }
    }
}

/// The mean of what actions do, by the softmax of the logits of those that there are.
fn expectation(logits: &[f32], pushes: &[[f64; 2]]) -> [f64; 2] {
    let largest = logits[..pushes.len()].iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let (mut sum, mut mean) = (0.0, [0.0; 2]);
    for (logit, push) in logits.iter().zip(pushes) {
        let weight = f64::from(logit - largest).exp();
        sum += weight;
        mean = [mean[0] + weight * push[0], mean[1] + weight * push[1]];
    }
    mean.map(|part| part / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_teammate_will_do_is_weighed_by_its_actor() {
        let pushes = [[0.0, 0.0], [1.0, 0.0], [0.0, -2.0]];
        let logits = [0.5f32, 0.25, 0.25, 7.0].map(f32::ln);
        let [x, y] = expectation(&logits, &pushes);
        assert!(
            (x - 0.25).abs() < 1e-6 && (y + 0.5).abs() < 1e-6,
            "{x} {y}: the fourth action is none of its own"
        );
    }
}
