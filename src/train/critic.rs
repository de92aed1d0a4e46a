//! The critic: what the rest of an episode is worth.

use std::ops::{AddAssign, Range};
use std::time::Duration;

use super::batch::{Batch, gather};
use super::ends::blank;
use super::memory::{Buffer, Flat};
use super::network::Passes;
use super::parameters::Parameters;
use super::returns::returns;
use super::settings::{CriticInput, Settings};
use crate::nn::{Dims, critic};

/// A critic in training, and the agents it serves.
#[derive(Clone, Debug)]
pub struct LearningCritic {
    /// Its weights.
    pub parameters: Parameters,
    pub(super) agents: Range<usize>,
    /// Whose values it says: each of its agents', or one for the team.
    pub(super) valued: Range<usize>,
    /// The weights that returns are estimated with.
    pub target: Flat,
    ids: usize,
    passes: Passes,
    pub(super) x: Buffer,
    returns: Buffer,
    /// Return minus value, `[T, E, values]`; zero behind an episode's end.
    pub(super) advantages: Buffer,
    d: Buffer,
    /// Its share of the means over all agents.
    pub(super) losses: CriticLosses,
    /// The square of the norm of its gradient.
    pub(super) squared_norm: f64,
    /// Time it took since it was made.
    pub(super) busy: Duration,
}

/// What the critics say of an epoch: means over steps played, episodes and agents.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CriticLosses {
    /// What is minimised: the square of return minus value.
    pub loss: f64,
    /// The absolute value of return minus value.
    pub td_error_abs: f64,
    /// The value.
    pub value: f64,
    /// The return that the value should have been.
    pub target: f64,
    /// Return minus value: what the actors learn from.
    pub advantage: f64,
}

impl LearningCritic {
    /// An untrained critic of `agents`.
    pub(super) fn new(
        settings: &Settings,
        dims: &Dims,
        observation: usize,
        agents: Range<usize>,
        seed: u64,
    ) -> LearningCritic {
        let team = settings.critic_input == CriticInput::Team;
        let ids = if team { 0 } else { settings.critic_sharing.id_len(dims) };
        let inputs = match settings.critic_input {
            CriticInput::Team => dims.n_agents * observation + 1,
            CriticInput::AllObservations => dims.n_agents * observation,
            CriticInput::Joint => dims.joint,
            CriticInput::OwnObservation => observation,
        };
        let network = critic(settings.critic_sharing, agents.start, inputs + ids, settings.critic_hidden);
        let parameters = Parameters::untrained(&network, seed);
        LearningCritic {
            target: parameters.values.clone(),
            parameters,
            valued: if team { 0..1 } else { agents.clone() },
            agents,
            ids,
            passes: Passes::new(settings.backend, &network),
            x: Buffer::default(),
            returns: Buffer::default(),
            advantages: Buffer::default(),
            d: Buffer::default(),
            losses: CriticLosses::default(),
            squared_norm: 0.0,
            busy: Duration::ZERO,
        }
    }

    /// Once per update: takes the inputs from the batch, and the returns from the target's values.
    pub(super) fn begin(&mut self, settings: &Settings, n_agents: usize, batch: &Batch, rewards: &[f32]) {
        let (inputs, sources) = match settings.critic_input {
            CriticInput::Team | CriticInput::AllObservations => (&batch.observations[..], 1),
            CriticInput::Joint => batch.seen(n_agents),
            CriticInput::OwnObservation => (&batch.observations[..], n_agents),
        };
        let width = inputs.len() / ((batch.steps + 1) * batch.episodes * sources);
        if settings.critic_input == CriticInput::Team {
            see_as_team(inputs, width, batch.episodes, rewards, &mut self.x);
        } else {
            gather(inputs, sources, width, &self.agents, self.ids, &mut self.x);
        }
        let rows = batch.episodes * self.valued.len();
        blank(&mut self.x, batch.steps + 1, batch.episodes, |episode| batch.ends.valued(episode));
        let values = self.passes.forward(&self.target, batch.steps + 1, rows, &self.x);
        let to = self.returns.resize(batch.steps * rows);
        returns(settings.estimator, settings.gamma, rewards, values, &batch.ends, self.valued.len(), to);
        // What follows on the last action is for the target alone.
        blank(&mut self.x, batch.steps + 1, batch.episodes, |episode| batch.ends.lengths()[episode]);
    }

    /// One epoch: the advantages, and the gradient of the mean of `(return - value)^2` over all entries (steps played,
    /// episodes and agents) of the batch.
    pub(super) fn differentiate(&mut self, n_agents: usize, batch: &Batch) {
        // One value of the team's critic stands for all its agents.
        let entries = batch.entries(n_agents) * self.valued.len() / self.agents.len();
        let rows = self.returns.len();
        let inputs = self.parameters.specs[0].shape[0];
        let x = &self.x[..rows * inputs];
        let values = self.passes.forward(&self.parameters.values, 1, rows, x);
        let (advantages, d) = (self.advantages.resize(rows), self.d.resize(rows));
        let (mut losses, share) = (CriticLosses::default(), 1.0 / entries as f64);
        for (at, (advantage, d)) in advantages.iter_mut().zip(d.iter_mut()).enumerate() {
            let row = at / self.valued.len();
            if !batch.ends.played(row / batch.episodes, row % batch.episodes) {
                (*advantage, *d) = (0.0, 0.0);
                continue;
            }
            *advantage = self.returns[at] - values[at];
            *d = -2.0 * *advantage / entries as f32;
            let error = f64::from(*advantage);
            losses.loss += share * error.powi(2);
            losses.td_error_abs += share * error.abs();
            losses.value += share * f64::from(values[at]);
            losses.target += share * f64::from(self.returns[at]);
            losses.advantage += share * error;
        }
        self.losses = losses;
        let Parameters { values, gradient, .. } = &mut self.parameters;
        self.passes.backward(values, x, &self.d, gradient);
        self.squared_norm = self.parameters.squared_norm();
    }

    /// The target becomes the critic.
    pub(super) fn renew_target(&mut self) {
        self.target.all_mut().copy_from_slice(self.parameters.values.all());
    }
}

/// Writes what the team's critic sees, `[T + 1, E, width + 1]`, to `x`: all observations `[T + 1, E, width]`, and the reward of
/// the step before, 0 at first.
fn see_as_team(observations: &[f32], width: usize, episodes: usize, rewards: &[f32], x: &mut Buffer) {
    let rows = observations.chunks_exact(width);
    let x = x.resize(rows.len() * (width + 1));
    for (row, (observations, x)) in rows.zip(x.chunks_exact_mut(width + 1)).enumerate() {
        x[..width].copy_from_slice(observations);
        x[width] = row.checked_sub(episodes).map_or(0.0, |before| rewards[before]);
    }
}

impl AddAssign for CriticLosses {
    fn add_assign(&mut self, other: CriticLosses) {
        self.loss += other.loss;
        self.td_error_abs += other.td_error_abs;
        self.value += other.value;
        self.target += other.target;
        self.advantage += other.advantage;
    }
}
