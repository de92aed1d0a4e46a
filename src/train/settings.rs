//! What a team learns with. The defaults and their sources are in `docs/method.md`.

use serde::{Deserialize, Serialize};

use crate::nn::{ActorKind, Networks, Sharing};

/// How a team learns.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The actors and predictors.
    pub networks: Networks,
    /// One critic per agent, or one for all.
    pub critic_sharing: Sharing,
    /// What critics see.
    pub critic_input: CriticInput,
    /// Hidden size of the critics.
    pub critic_hidden: usize,
    /// How each predictor of `networks` learns, in their order.
    pub predictors: Vec<PredictorSettings>,
    /// Steps of each predictor in one update.
    pub predictor_updates: usize,
    /// The learning rate of actors and critics.
    pub learning_rate: f64,
    /// What entropy is worth in the actors' loss.
    pub entropy_coefficient: f64,
    /// Discount of one step.
    pub gamma: f64,
    /// The targets of the critics, and with them the advantages.
    pub estimator: Estimator,
    /// How far from 1 a ratio of probabilities still counts.
    pub clip: f64,
    /// Passes over the batch in one update.
    pub epochs: usize,
    /// Largest norm of the gradient of all actors, and of all critics.
    pub largest_gradient: f64,
    /// Whether the rewards of a batch are shifted and scaled to mean 0 and standard deviation 1.
    pub standardise_rewards: bool,
    /// Target critics become the critics every so many updates.
    pub target_interval: u64,
    /// What differentiates the networks.
    pub backend: Backend,
}

/// What computes the outputs of networks in training and the gradients of their weights. Everything else is the
/// same: advantages, clipping, Adam, threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// Backward passes written by hand, on the kernels that agents run; bit-identical on any number of threads.
    #[default]
    Native,
    /// candle's autograd: slower; the reference that `native` is checked against.
    ///
    /// candle divides large products and vectors over threads of its own, whatever the number of threads here.
    /// It can be told not to from outside alone: by `RAYON_NUM_THREADS=1` in the environment, which is right
    /// whenever more than one network learns at a time.
    #[cfg(feature = "candle")]
    Candle,
}

/// What a critic sees of a step, before the id of a shared one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CriticInput {
    /// The padded observations of all agents and the team's reward of the step before: one critic says one value for all.
    Team,
    /// The padded observations of all agents (MAPPO).
    #[serde(rename = "all")]
    AllObservations,
    /// What the agent's actor sees: the joint observation, or the agent's estimate of it (IPPO).
    Joint,
    /// The agent's own padded observation (IPPO as in the paper's text).
    #[serde(rename = "local")]
    OwnObservation,
}

/// From rewards and values to the return that a critic should have said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Estimator {
    /// So many rewards, then the value.
    Steps(usize),
    /// All numbers of steps mixed with this lambda: generalised advantage estimation.
    Gae(f64),
}

/// How a predictor learns.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictorSettings {
    /// What its loss weighs.
    pub objective: Objective,
    /// What it is told of how far off it was.
    pub loss: Loss,
    /// Its learning rate.
    pub learning_rate: f64,
    /// Largest norm of its gradient.
    pub largest_gradient: f64,
    /// Whether a step starts from the clipped gradient of the step before, as MARO was first published.
    pub carry_gradients: bool,
}

/// What the loss of a predictor weighs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Objective {
    /// Every step of replayed episodes alike (MARO).
    Maro,
    /// The steps of the update's own batch by `ReLU(1 + lambda A)`, A the advantages (Value-Aware MARO).
    /// With lambda 0 it is the ablation of the paper's code.
    ValueAware {
        /// The weight of an advantage.
        lambda: f64,
    },
}

/// What a predictor is told of how far off it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// The negative log-likelihood.
    #[default]
    Nll,
    /// The squared error of the mean; nothing is learned of sigma.
    Mse,
    /// How far the probabilities of actions of a policy that does not change are on what is imputed from those on the
    /// truth; nothing is learned of sigma.
    Kl,
}

impl PredictorSettings {
    /// Those of the paper: learning rate 1e-3, gradient norm 1, nothing carried.
    pub fn paper(objective: Objective) -> PredictorSettings {
        let loss = Loss::default();
        PredictorSettings {
            objective,
            loss,
            learning_rate: 1e-3,
            largest_gradient: 1.0,
            carry_gradients: false,
        }
    }
}

impl Settings {
    /// The paper's setting 1 for MLP actors and setting 2 for GRU actors, with MAPPO and a value-aware
    /// predictor.
    pub fn paper(actor: ActorKind) -> Settings {
        let (learning_rate, entropy_coefficient) = match actor {
            ActorKind::Mlp => (1e-4, 0.001),
            // Nothing trains the actors of ONNX files.
            ActorKind::Gru | ActorKind::Onnx => (3e-4, 0.01),
        };
        Settings {
            networks: Networks::paper(actor),
            critic_sharing: Sharing::Separate,
            critic_input: CriticInput::AllObservations,
            critic_hidden: Networks::paper(actor).hidden,
            predictors: vec![PredictorSettings::paper(Objective::ValueAware { lambda: 1.0 })],
            predictor_updates: 1,
            learning_rate,
            entropy_coefficient,
            gamma: 0.99,
            estimator: Estimator::Steps(5),
            clip: 0.2,
            epochs: 4,
            largest_gradient: 10.0,
            standardise_rewards: true,
            target_interval: 200,
            backend: Backend::Native,
        }
    }
}
