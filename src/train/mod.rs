//! Training: how a team learns from a batch of episodes.
//!
//! ```text
//!     Batch -> Critic  -> returns - values = advantages -> Actor      (MAPPO, IPPO)
//!                                            advantages -> Predictor  (value-aware)
//!     replayed episodes ------------------------------->  Predictor  (MARO)
//! ```
//!
//! Read [`Team::update`] first: it is one update of everything. Networks learn side by side on as many threads
//! as they are given, and the result is the same to the last bit for any number of them.

mod actor;
mod batch;
mod critic;
pub mod memory;
pub mod network;
mod parameters;
mod predictor;
mod returns;
mod rollout;
mod settings;
mod state;
mod team;
#[cfg(test)]
mod tests;
mod threads;

pub use actor::{Actor, ActorLosses};
pub use batch::{Batch, Trajectories};
pub use critic::{Critic, CriticLosses};
pub use parameters::Parameters;
pub use predictor::{Predictor, PredictorLosses};
pub use rollout::Rollout;
pub use settings::{Backend, CriticInput, Estimator, Objective, PredictorSettings, Settings};
pub use state::Counters;
pub use team::{Busy, Losses, Team};
