//! vamaro-swarm: a swarm simulator whose agents are processes.
//!
//! ```text
//!              supervisor (worlds, clock, seeds, links)
//!               |  own observation, ages               ^ action
//!               v                                      |
//!   sensor -> bus (publish) -> bus (receive) -> link (delivered, late or lost)
//!          -> imputer (joint estimate) -> policy -> action -> world -> reward
//! ```
//!
//! # A swarm in 20 lines
//!
//! A team of four plays a hundred episodes over links that lose most of what is sent:
//!
//! ```
//! use vamaro_swarm::agent::Registry;
//! use vamaro_swarm::base::error::Result;
//! use vamaro_swarm::{Swarm, run_if_agent};
//!
//! fn main() -> Result<()> {
//!     // First thing: agents are processes of this very program.
//!     let registry = Registry::default();
//!     run_if_agent(&registry);
//!
//!     let builder = Swarm::builder()
//!         .environment("spread-xy-4")
//!         .links("gilbert(0.6, 0.2) + level(0.9)")
//!         .imputer("hold")
//!         .registry(&registry)
//!         .seed(1);
//!     // Without this line, each agent is a process. The results are the same, bit for bit.
//!     let builder = builder.in_process();
//!     let mut swarm = builder.build()?;
//!     let statistics = swarm.play(100)?;
//!     println!("return {:.1} +- {:.1}", statistics.return_mean(), statistics.return_ci95().unwrap_or(0.0));
//!     # assert_eq!(statistics.episodes().len(), 100);
//!     Ok(())
//! }
//! ```
//!
//! You can bring your own [`Environment`](environment::Environment) (or a [`World`](environment::World), which the
//! library plays in batches), your own [`Link`](link::Link), and your own [`Imputer`](agent::Imputer) in the registry.
//! `examples/` has a program for each. An [`Observer`](supervisor::Observer) looks on while episodes are played
//! ([`Swarm::play_before`]). If you need other parts, put them together as [`Swarm`] does: a
//! [`Session`](supervisor::Session) plays with a [`Team`](supervisor::Team).
//!
//! A swarm ends when it is dropped, and its agents end with the program whatever happens. Call
//! [`signals::install`](supervisor::signals::install) if SIGINT, SIGTERM and SIGHUP should end a play cleanly; nothing
//! else needs it.
//!
//! # Rooms
//!
//! The rooms follow the way of one observation; each depends only on those above it. Those without a link are internal to
//! the commands.
//!
//! | room | what is in it |
//! |---|---|
//! | [`base`] | errors, files that appear whole, addressed draws, statistics, tables, threads, real-time hygiene |
//! | [`environment`] | physics and tasks |
//! | [`dynamics`] | laws of motion that are fitted to play |
//! | [`link`] | which observations reach whom, and when: a trait, a file per model, a registry |
//! | [`nn`] | actor, predictor, kernels, policy file |
//! | [`bus`] | messages in shared memory, and their in-process twin |
//! | [`agent`] | the agent's side: inbox, imputer, policy, process |
//! | [`recording`] | recorded episodes |
//! | [`supervisor`] | launches agents, plays episodes in lockstep or by the clock, watches and reaps |
//! | `hosts` | a swarm on several machines |
//! | `metrics` | what a training run writes down as it goes |
//! | `plot` | charts as SVG |
//! | [`train`] | how a team learns: actors, critics, predictors, one update |
//! | `evaluate` | how robust frozen policies are: sweeps, statistics, a report |
//! | `latency` | how long hops, ticks and decisions take, beside what others do |
//! | `verify` | recomputes recorded episodes and updates |
//! | `view` | a swarm seen live in a terminal |
//! | [`cli`] | one file per command |
//! | `python` | the wheel: the library for Python |

#![warn(clippy::match_bool, clippy::unwrap_used)]
// Rooms keep for the commands what nobody else calls.
#![cfg_attr(not(feature = "cli"), allow(dead_code, unused_imports))]

mod embed;
mod swarm;

#[cfg(fuzzing)]
#[doc(hidden)]
pub mod fuzzing;

pub mod agent;
pub mod base;
pub mod bus;
#[cfg(feature = "cli")]
pub mod cli;
pub mod dynamics;
pub mod environment;
#[cfg(feature = "cli")]
pub(crate) mod evaluate;
#[cfg(feature = "hosts")]
pub(crate) mod hosts;
#[cfg(feature = "cli")]
pub(crate) mod latency;
pub mod link;
pub(crate) mod metrics;
pub mod nn;
pub(crate) mod plot;
#[cfg(feature = "python")]
mod python;
pub mod recording;
pub mod supervisor;
pub mod train;
#[cfg(feature = "cli")]
pub(crate) mod verify;
#[cfg(feature = "cli")]
pub(crate) mod view;

pub use embed::run_if_agent;
pub use swarm::{EnvironmentChoice, LinkChoice, Swarm, SwarmBuilder};
