//! The actor's part of an update: PPO's clipped surrogate and entropy.

use std::ops::{AddAssign, Range};
use std::time::Duration;

use super::batch::{Batch, gather};
use super::ends::blank;
use super::memory::Buffer;
use super::network::Passes;
use super::parameters::Parameters;
use super::settings::Settings;
use crate::nn::{Dims, Senses};

/// An actor in training, and the agents it serves.
#[derive(Clone, Debug)]
pub struct LearningActor {
    /// Its weights.
    pub parameters: Parameters,
    pub(super) agents: Range<usize>,
    ids: usize,
    passes: Passes,
    /// What it sees more than estimates, if it does.
    senses: Option<Senses>,
    /// With them, `[T, E, its agents, inputs]`.
    seen: Vec<f32>,
    pub(super) x: Buffer,
    /// Logarithms of the probabilities of what was done, before this update, `[T, E, its agents]`.
    old: Buffer,
    d: Buffer,
    /// Its share of the means over all agents.
    pub(super) losses: ActorLosses,
    /// The square of the norm of its gradient.
    pub(super) squared_norm: f64,
    /// Time it took since it was made.
    pub(super) busy: Duration,
}

/// What the actors say of an epoch: means over steps played, episodes and agents.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ActorLosses {
    /// What is minimised: the loss of the policy, minus weighed entropy.
    pub loss: f64,
    /// The loss of the policy: minus the clipped surrogate.
    pub policy: f64,
    /// The entropy of the policies, nat.
    pub entropy: f64,
    /// The probability of the likeliest action.
    pub pi_max: f64,
    /// The share of ratios outside of 1 +- clip.
    pub clip_fraction: f64,
    /// How far the policies have moved in this update: `(ratio - 1) - ln ratio`, an estimate of KL(old || new).
    pub approx_kl: f64,
}

/// Keeps the logarithm of a probability finite.
const TINY: f32 = 1e-10;

impl LearningActor {
    /// An untrained actor of `agents`.
    pub(super) fn new(settings: &Settings, dims: &Dims, agents: Range<usize>, seed: u64) -> LearningActor {
        let networks = &settings.networks;
        let network = networks.actor(agents.start, dims);
        LearningActor {
            passes: Passes::new(settings.backend, &network),
            parameters: Parameters::untrained(&network, seed),
            senses: Senses::of(&networks.actor_inputs, agents.start, dims),
            agents,
            ids: networks.sharing.id_len(dims),
            seen: Vec::new(),
            x: Buffer::default(),
            old: Buffer::default(),
            d: Buffer::default(),
            losses: ActorLosses::default(),
            squared_norm: 0.0,
            busy: Duration::ZERO,
        }
    }

    /// Once per update: takes the inputs from the batch.
    pub(super) fn begin(&mut self, n_agents: usize, batch: &Batch) {
        let (mut seen, mut sources) = batch.seen(n_agents);
        seen = &seen[..seen.len() / (batch.steps + 1) * batch.steps];
        if let Some(senses) = &mut self.senses {
            batch.see(n_agents, &self.agents, senses, &mut self.seen);
            (seen, sources) = (&self.seen, self.agents.len());
        }
        let width = seen.len() / (batch.steps * batch.episodes * sources);
        gather(seen, sources, width, &self.agents, self.ids, &mut self.x);
        blank(&mut self.x, batch.steps, batch.episodes, |episode| batch.ends.lengths()[episode]);
    }

    /// One epoch: the gradient of the loss, a mean over the batch's steps played, episodes and agents. `advantages` is
    /// `[T, E, agents]` as the actions are; `available` says how many actions each agent has. In the `first`
    /// epoch the policy is still the old one.
    pub(super) fn differentiate(
        &mut self,
        settings: &Settings,
        batch: &Batch,
        available: &[usize],
        advantages: &[f32],
        first: bool,
    ) {
        let rows = batch.episodes * self.agents.len();
        let Parameters { values, gradient, .. } = &mut self.parameters;
        let logits = self.passes.forward(values, batch.steps, rows, &self.x);
        let n_actions = logits.len() / (batch.steps * rows);
        let (old, d) = (self.old.resize(batch.steps * rows), self.d.resize(logits.len()));
        let n_agents = available.len();
        let (clip, entropy_coefficient) = (settings.clip as f32, settings.entropy_coefficient as f32);
        let entries = batch.entries(n_agents) as f32;

        let (mut losses, share) = (ActorLosses::default(), 1.0 / f64::from(entries));
        for (at, (logits, d)) in logits.chunks_exact(n_actions).zip(d.chunks_exact_mut(n_actions)).enumerate()
        {
            let agent = self.agents.start + at % self.agents.len();
            let row = at / self.agents.len();
            if !batch.ends.played(row / batch.episodes, row % batch.episodes) {
                d.fill(0.0);
                continue;
            }
            let entry = row * n_agents + agent;
            let (action, advantage) = (usize::from(batch.actions[entry]), advantages[entry]);

            // Actions that the agent does not have have probability zero, and so has their derivative.
            let (pi, missing) = d.split_at_mut(available[agent]);
            softmax(&logits[..pi.len()], pi);
            missing.fill(0.0);

            let log_pi = (pi[action] + TINY).ln();
            if first {
                old[at] = log_pi;
            }
            let log_ratio = log_pi - old[at];
            let ratio = log_ratio.exp();
            let clipped = ratio.clamp(1.0 - clip, 1.0 + clip);
            // The gradient flows where the surrogate is the ratio's own, not the bound's.
            let surrogate = (ratio * advantage).min(clipped * advantage);
            let d_log_pi = if surrogate < ratio * advantage { 0.0 } else { ratio * advantage };

            let entropy = -pi.iter().map(|&p| p * (p + TINY).ln()).sum::<f32>();
            let likeliest = pi.iter().copied().fold(0.0, f32::max);
            losses.loss -= share * f64::from(surrogate + entropy_coefficient * entropy);
            losses.policy -= share * f64::from(surrogate);
            losses.entropy += share * f64::from(entropy);
            losses.pi_max += share * f64::from(likeliest);
            losses.clip_fraction += if ratio == clipped { 0.0 } else { share };
            losses.approx_kl += share * f64::from(ratio - 1.0 - log_ratio);
            let d_taken = -d_log_pi / (pi[action] + TINY) / entries;
            let d_entropy = -entropy_coefficient / entries;
            softmax_backward(pi, action, d_taken, d_entropy);
        }
        self.losses = losses;
        self.passes.backward(values, &self.x, &self.d, gradient);
        self.squared_norm = self.parameters.squared_norm();
    }
}

impl AddAssign for ActorLosses {
    fn add_assign(&mut self, other: ActorLosses) {
        self.loss += other.loss;
        self.policy += other.policy;
        self.entropy += other.entropy;
        self.pi_max += other.pi_max;
        self.clip_fraction += other.clip_fraction;
        self.approx_kl += other.approx_kl;
    }
}

/// Probabilities from logits.
pub(super) fn softmax(logits: &[f32], pi: &mut [f32]) {
    let largest = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let mut sum = 0.0;
    for (pi, logit) in pi.iter_mut().zip(logits) {
        *pi = (logit - largest).exp();
        sum += *pi;
    }
    pi.iter_mut().for_each(|pi| *pi /= sum);
}

/// From probabilities to the derivative by their logits, in place, of a loss that changes by `d_taken` with the
/// probability of `action`, and by `d_entropy` with the entropy.
fn softmax_backward(pi: &mut [f32], action: usize, d_taken: f32, d_entropy: f32) {
    let d_pi = |at: usize, p: f32| {
        let of_entropy = -(p + TINY).ln() - p / (p + TINY);
        d_entropy * of_entropy + if at == action { d_taken } else { 0.0 }
    };
    let mean: f32 = pi.iter().enumerate().map(|(at, &p)| p * d_pi(at, p)).sum();
    pi.iter_mut().enumerate().for_each(|(at, p)| *p *= d_pi(at, *p) - mean);
}
