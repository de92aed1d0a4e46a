//! Training: how a team learns from a batch of episodes.
//!
//! ```text
//!     Batch -> LearningCritic -> returns - values = advantages -> LearningActor      (MAPPO, IPPO)
//!                                           advantages -> LearningPredictor          (value-aware)
//!     replayed episodes ------------------------------>  LearningPredictor          (MARO)
//! ```
//!
//! Read [`Learner::update`] first: it is one update of everything. Networks learn side by side on as many threads
//! as they are given, and the result is the same to the last bit for any number of them.
//!
//! Around it is the run:
//!
//! ```text
//!     Layer, Preset -> Config -> Trainer: Rollout -> Batch, Replay -> Learner -> weights for the agents
//!                                Run:     a row of metrics with its test (trial), a checkpoint, the folder
//! ```
//!
//! `Run::train` is the loop; `estimate` and `Throughput` run it without a folder.

mod actor;
mod batch;
mod checkpoint;
mod config;
mod config_check;
mod critic;
mod divergence;
mod ends;
mod fit;
mod fit_state;
mod folder;
mod layer;
mod learner;
mod learner_state;
#[cfg(feature = "python")]
mod lessons;
mod memory;
mod memory_needed;
pub mod network;
mod parameters;
mod plan;
mod predictor;
mod preset;
mod replay;
mod returns;
mod rollout;
mod rows;
mod run;
mod settings;
#[cfg(test)]
mod tests;
mod throughput;
mod trainer;
mod trial;

pub use actor::ActorLosses;
pub use batch::{Batch, Trajectories};
pub(crate) use checkpoint::{Checkpoint, Progress};
pub use config::{AdvantageKind, Algorithm, Config, Preset, TrainP};
pub use critic::CriticLosses;
pub use ends::Ends;
pub use fit::{Feed, FitSettings, PredictorFit, fit_predictor};
pub(crate) use folder::RunFolder;
pub use layer::Layer;
pub(crate) use learner::Busy;
pub use learner::{Learner, Losses};
#[cfg(feature = "python")]
pub(crate) use lessons::Lessons;
pub use memory::Flat;
pub use parameters::Parameters;
pub(crate) use plan::estimate;
pub use predictor::PredictorLosses;
pub use replay::Replay;
pub use rollout::Rollout;
pub(crate) use rows::Averages;
pub(crate) use run::{Pace, Run};
pub use settings::{Backend, CriticInput, Estimator, Loss, Objective, PredictorSettings, Settings};
pub(crate) use throughput::{Throughput, matmul_rate, test_duration};
pub use trainer::{Diverged, Trainer};
pub(crate) use trial::Trial;
