//! The networks: what an agent decides and imputes with, and the file they are kept in.
//!
//! ```text
//!     joint estimate -> actor     -> logits            (what to do)
//!     joint estimate -> predictor -> mean of the delta (what the others will observe next)
//! ```
//!
//! A [`Policy`] holds the actors of all agents and any number of named predictors. It is [read](Policy::open)
//! from a policy file, which is mapped and not copied, [imported](import()) from the paper's published code,
//! or [untrained](Policy::untrained). An actor may also be an [ONNX file](OnnxSpec). Networks run on flat f32 weights with state and scratch of the caller:
//! no allocation, no threads, and every row independent of the rows computed with it.

mod actor;
mod egocentric;
mod file;
#[cfg(feature = "candle")]
mod import;
mod inference;
pub mod kernels;
mod meta;
mod network;
mod networks;
mod onnx;
mod pickle;
mod policy;
mod predictor;
mod proximity;
#[cfg(feature = "candle")]
pub mod reference;
mod senses;
#[cfg(feature = "candle")]
mod state_dict;
#[cfg(test)]
mod tests;
mod weights;

pub use actor::{Actor, ActorState};
pub use file::PolicyFile;
pub(crate) use file::{Precision, map, write_tensors};
#[cfg(feature = "candle")]
pub use import::import;
#[cfg(feature = "candle")]
pub(crate) use import::key;
pub use inference::{Inference, NetworkState, Scratch};
pub use meta::Meta;
pub use network::{Layer, Network, TensorSpec};
pub(crate) use networks::MAX_HIDDEN;
#[cfg(test)]
pub(crate) use networks::NAMED_OTHERWISE;
pub use networks::{ActorKind, Input, Networks, PredictorSpec, Sharing, Sigma, critic};
pub use onnx::{Choice, Normalisation, OnnxSpec, Said, Seen};
pub(crate) use onnx::{Description, Files};
pub use policy::Policy;
pub use predictor::{Predictor, PredictorState};
pub(crate) use proximity::Proximity;
pub(crate) use senses::Senses;
pub use weights::Tensor;
pub(crate) use weights::{Aligned, Line};

use crate::environment::{ActionSpace, AgentSpec};

/// The sizes a policy must fit: those of a task.
#[derive(Clone, Debug, PartialEq)]
pub struct Dims {
    /// The task's id, such as `hear-see`.
    pub task: String,
    /// The number of agents.
    pub n_agents: usize,
    /// The length of the joint observation.
    pub joint: usize,
    /// How many dims of the joint observation, counted from the front, are predicted.
    pub predicted: usize,
    /// The number of actions of an agent.
    pub n_actions: usize,
    /// What each agent observes and does. Networks of ours need no more than the sizes above, except for egocentric actors, which
    /// depend on which agents are alike, and predictors that see who is near, which depend on what is a place.
    pub agents: Vec<AgentSpec>,
}

impl Dims {
    /// How many values an actor may say: a logit for each action, or, where agents act by values, of each the mean and the
    /// log-std.
    pub fn said(&self) -> usize {
        let of_values = self.agents.iter().map(|agent| match &agent.actions {
            ActionSpace::Discrete(_) => 0,
            ActionSpace::Box { low, .. } => 2 * low.len(),
        });
        of_values.max().unwrap_or(0).max(self.n_actions)
    }

    /// The number of an agent's action among all actions of all agents, of which the input `own-action` is a one-hot.
    pub fn act(&self, agent: usize, action: usize) -> usize {
        agent * self.n_actions + action
    }
}
