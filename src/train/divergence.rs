//! What imputed inputs do to a policy that does not change: how far its probabilities of actions move.

use super::actor::softmax;
use super::batch::Trajectories;
use super::memory::{Buffer, Flat};
use super::network::Native;
use crate::nn::{Dims, Policy};

/// KL(true, imputed): the divergence of each agent's probabilities of actions on what a predictor imputes for the next
/// step from those on the truth, and its derivative by what is imputed.
///
/// An agent that remembers sees imputed inputs from the second step of an episode on. Its own part is true, as it is when
/// agents act.
#[derive(Clone, Debug)]
pub(super) struct Divergence {
    dims: Dims,
    actors: Vec<Frozen>,
}

/// An actor that does not change.
#[derive(Clone, Debug)]
struct Frozen {
    passes: Native,
    weights: Flat,
    /// Nobody asks for it.
    gradient: Flat,
    /// How many actions the agent has.
    available: usize,
    /// The length of the id behind the joint observation.
    ids: usize,
    /// What it sees, `[steps + 1, rows, joint and id]`: the truth, then what is imputed.
    x: Buffer,
    /// Probabilities on the truth, then the derivative by the logits, `[steps + 1, rows, n_actions]`.
    d: Buffer,
}

impl Divergence {
    /// That of the actors of `policy`, of whose agents each has so many actions.
    pub(super) fn new(policy: &Policy, available: &[usize]) -> Divergence {
        let (networks, dims) = (policy.networks(), policy.dims());
        let frozen = |(agent, &available): (usize, &usize)| {
            let network = networks.actor(agent, dims);
            let tensors: Vec<_> = policy.tensors().filter(|(spec, _)| network.owns(&spec.name)).collect();
            let zeros = Flat::zeros(&network.tensors());
            let mut weights = zeros.clone();
            weights.each_mut().zip(tensors).for_each(|(to, (_, from))| to.copy_from_slice(from.values()));
            let passes = Native::to_input(&network);
            let [x, d] = Default::default();
            Frozen { passes, weights, gradient: zeros, available, ids: network.ones, x, d }
        };
        Divergence { dims: dims.clone(), actors: available.iter().enumerate().map(frozen).collect() }
    }

    /// The divergence in the mean over transitions and agents. `out` `[steps, rows, views, 2 predicted]` is what the
    /// predictor says, and `d` becomes the derivative by it; dims that are `held` stay as they are.
    pub(super) fn differentiate(
        &mut self,
        trajectories: &Trajectories,
        held: &[usize],
        out: &[f32],
        d: &mut [f32],
    ) -> f64 {
        let Trajectories { rows, observations, joint, estimates, .. } = *trajectories;
        let Dims { joint: length, predicted, n_agents, n_actions, .. } = self.dims;
        let views = out.len() / ((observations - 1) * rows * 2 * predicted);
        let transitions = (0..(observations - 1) * rows).filter(|&at| trajectories.has_transition(at));
        let share = 1.0 / (transitions.clone().count() * n_agents) as f64;
        let imputes = |agent: usize| {
            let own = agent * (predicted / n_agents)..(agent + 1) * (predicted / n_agents);
            (0..predicted).filter(move |dim| !own.contains(dim) && !held.contains(dim))
        };
        d.fill(0.0);
        let mut sum = 0.0;
        for (agent, Frozen { passes, weights, gradient, available, ids, x, d: d_logits }) in
            self.actors.iter_mut().enumerate()
        {
            let width = length + *ids;
            let x = x.resize(observations * rows * width);
            x.fill(0.0);
            for (x, joint) in x.chunks_exact_mut(width).zip(joint.chunks_exact(length)) {
                x[..length].copy_from_slice(joint);
                if *ids > 0 {
                    x[length + agent] = 1.0;
                }
            }
            let d_logits = d_logits.resize(observations * rows * n_actions);
            let logits = passes.forward(weights, observations, rows, x);
            for (logits, pi) in logits.chunks_exact(n_actions).zip(d_logits.chunks_exact_mut(n_actions)) {
                softmax(&logits[..*available], &mut pi[..*available]);
            }

            let seen_by = |at: usize| match estimates {
                [] => &joint[at * length..][..length],
                estimates => &estimates[(at * n_agents + agent) * length..][..length],
            };
            let said_at = |at: usize| (at * views + agent.min(views - 1)) * 2 * predicted;
            for at in transitions.clone() {
                let (x, seen, said) = (&mut x[(at + rows) * width..], seen_by(at), &out[said_at(at)..]);
                imputes(agent).for_each(|dim| x[dim] = seen[dim] + said[dim]);
            }
            let logits = passes.forward(weights, observations, rows, x);
            let mut imputed = vec![0.0; *available];
            for (at, (logits, d)) in
                logits.chunks_exact(n_actions).zip(d_logits.chunks_exact_mut(n_actions)).enumerate()
            {
                if at < rows || !trajectories.has_transition(at - rows) {
                    d.fill(0.0);
                    continue;
                }
                softmax(&logits[..*available], &mut imputed);
                let (pi, missing) = d.split_at_mut(*available);
                missing.fill(0.0);
                for (pi, imputed) in pi.iter_mut().zip(&imputed) {
                    sum += share * f64::from(*pi * ((*pi + TINY).ln() - (imputed + TINY).ln()));
                    *pi = share as f32 * (imputed - *pi);
                }
            }
            let d_x = passes.backward(weights, x, d_logits, gradient);
            for at in transitions.clone() {
                let (d_x, d) = (&d_x[(at + rows) * width..], &mut d[said_at(at)..]);
                imputes(agent).for_each(|dim| d[dim] += d_x[dim]);
            }
        }
        sum
    }
}

/// Keeps the logarithm of a probability finite.
const TINY: f32 = 1e-10;
