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
//! | [`distribution`], [`error`], [`file`](mod@file), [`machine`], [`rng`], [`scheduling`], [`stats`], [`table`], [`threads`] | distributions of times, errors with exit codes, files that appear whole, what results were made on, addressed draws, real-time hygiene, statistics, tables for terminals, work side by side |
//! | [`world`] | physics and tasks |
//! | [`link`] | who receives whom |
//! | [`nn`] | actor, predictor, kernels, policy file |
//! | [`bus`] | messages in shared memory, and their in-process twin |
//! | [`agents`] | the agent's side: inbox, imputer, policy, process |
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

#[path = "../agents/mod.rs"]
pub mod agents;
pub mod bus;
pub mod cli;
pub mod distribution;
pub mod error;
pub mod evaluate;
pub mod file;
pub mod latency;
pub mod link;
pub mod machine;
pub mod metrics;
pub mod nn;
pub mod plot;
pub mod recording;
pub mod rng;
pub mod scheduling;
pub mod stats;
pub mod supervisor;
pub mod table;
pub mod threads;
pub mod train;
pub mod verify;
pub mod world;
