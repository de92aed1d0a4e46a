//! More than one machine: a swarm whose agents run on several hosts.
//!
//! ```text
//!   machine of `spawn`                                    host: `vamaro-swarm host`
//!   supervisor --- bus --- agents that run here           steward --- bus --- agents that run there
//!       |           |                                        |         |
//!     Hosts ---- stands in on the bus for those there        +---- stands in for all others
//!       |                                                    |
//!       +------------------------- engine -------------------+
//!          messages of all its agents in one frame, and orders
//! ```
//!
//! Each machine has a bus of its own in shared memory, with a place for every agent of the team. Where an agent does not
//! run, somebody stands in for it ([`StandIns`](crate::bus::StandIns)), so neither agents nor supervisor know who is where. What the supervisor
//! sends to the agents of a host at a time travels in one frame, and so does what they answer. Observations between two
//! hosts pass through the machine of the supervisor.
//!
//! Times in messages are of the clock of the machine that they are on: the supervisor translates, in both directions, by
//! what `clock.rs` knows of each host's clock.
//!
//! Only `engine.rs` and `threads.rs` name Zenoh, which carries the bytes, and `plain.rs`, which ours is compared with, does.

mod abroad;
mod clock;
mod echo;
mod engine;
mod frame;
mod host;
mod key;
mod listen;
mod offset;
mod orders;
mod outbox;
mod outgoing;
mod patience;
mod plain;
mod plan;
mod steward;
mod tally;
mod threads;

pub(crate) use abroad::Hosts;
pub(crate) use echo::{Answering, Over, Partner};
pub(crate) use listen::serve;
pub(crate) use patience::Patience;
pub(crate) use plan::Plan;
pub use threads::share_engine_threads;
