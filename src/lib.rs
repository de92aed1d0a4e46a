//! vamaro-swarm: a swarm simulator whose agents are processes.
//!
//! ```text
//!              supervisor (worlds, clock, seeds)
//!               |  own observation, link rows          ^ action
//!               v                                      |
//!   sensor -> bus (publish) -> bus (receive) -> link (delivered or lost)
//!          -> imputer (joint estimate) -> policy -> action -> world -> reward
//! ```
//!
//! The rooms follow the way of one observation; each depends only on those above it.
//!
//! | room | what is in it |
//! |---|---|
//! | [`base`] | errors, files that appear whole, addressed draws, statistics, tables, threads, real-time hygiene |
//! | [`environment`] | physics and tasks |
//! | [`link`] | which observations reach whom: a trait, a file per model, a registry |
//! | [`nn`] | actor, predictor, kernels, policy file |
//! | [`bus`] | messages in shared memory, and their in-process twin |
//! | [`agent`] | the agent's side: inbox, imputer, policy, process |
//! | [`recording`] | recorded episodes |
//! | [`supervisor`] | launches agents, plays episodes in lockstep or by the clock, watches and reaps |
//! | [`train`] | how a team learns: actors, critics, predictors, one update |
//! | [`metrics`] | what a training run writes down as it goes |
//! | [`plot`] | charts as SVG |
//! | [`evaluate`] | how robust frozen policies are: sweeps, statistics, a report |
//! | [`latency`] | how long hops, ticks and decisions take, beside what others do |
//! | [`verify`] | recomputes recorded episodes and updates |
//! | [`cli`] | one file per command |

#![warn(clippy::unwrap_used)]

mod embed;

pub mod agent;
pub mod base;
pub mod bus;
pub mod cli;
pub mod environment;
pub mod evaluate;
pub mod latency;
pub mod link;
pub mod metrics;
pub mod nn;
pub mod plot;
pub mod recording;
pub mod supervisor;
pub mod train;
pub mod verify;

pub use embed::run_if_agent;
