//! The bus: how observations travel. The only room that names iceoryx2.
//!
//! ```text
//!                 sensor-i (one service an agent)          wake: supervisor -> agents
//!               +----------------------------+             wake: agents -> supervisor
//!               |                            v
//!   supervisor -+--- weights (training) ---> agent i       weights: one sample that all agents copy from
//!        ^  ^                                 |    |
//!        |  +------ observations (read along) +    |       observations: n publishers, everybody subscribed
//!        +----------------- decisions -------------+
//! ```
//!
//! An environment in another process has a line of its own (`line.rs`) to the supervisor.
//!
//! The supervisor reads observations along only to know when all of a tick are published. Swarms that play a
//! frozen policy have no service for weights. Guests who watch a swarm have a service of their own, apart from these.

#[cfg(feature = "hosts")]
mod bell;
mod clock;
mod directory;
#[cfg(feature = "view")]
mod guests;
mod line;
#[cfg(feature = "view")]
mod living;
mod local;
mod memory;
mod message;
mod place;
mod services;
mod shared;
#[cfg(feature = "hosts")]
mod stand_ins;
mod wait;

#[cfg(feature = "hosts")]
pub(crate) use bell::Bell;
pub(crate) use clock::{now_ns, wait_for_moment, wake_on_time};
pub use directory::SwarmDirectory;
pub(crate) use directory::{check_writable, is_tag, leftovers, place};
#[cfg(feature = "view")]
pub(crate) use guests::{Guest, Host, guests_memory_needed};
pub(crate) use line::{Line, LineEnd, LineLayout, LineSettings, line_memory_needed, wake_supervisor_of_line};
#[cfg(feature = "view")]
pub(crate) use living::{Living, have_others_swarms, living};
pub(crate) use local::LocalHub;
pub use local::{LocalPort, LocalSample};
pub(crate) use memory::SharedMemory;
pub use message::{Decision, DecisionTimes, Header, Kind, Layout, NOT_ARRIVED, PROTOCOL, Sensor, Told};
pub(crate) use message::{halves, join};
pub(crate) use services::{Role, bus_error, node, open_files_needed, service_name, shared_memory_needed};
pub use services::{SwarmAddress, Wire};
pub(crate) use shared::wake_supervisor;
pub use shared::{AgentSharedPort, SharedSample, SupervisorPort};
#[cfg(feature = "hosts")]
pub(crate) use stand_ins::StandIns;
pub use wait::Wait;
pub(crate) use wait::wait_until;

use crate::base::error::Result;

/// A received message, read in place for as long as it is held.
pub trait Sample {
    /// What it is and where it is from.
    fn header(&self) -> &Header;
    /// The payload, see [`Layout`].
    fn words(&self) -> &[u32];
}

/// An agent's side of the bus: over shared memory ([`AgentSharedPort`]) or in-process ([`LocalPort`]).
///
/// Receiving never waits; `None` means nothing new has arrived.
pub trait AgentPort {
    /// A received message.
    type Sample: Sample;

    /// The next message of the supervisor to this agent.
    fn receive_sensor(&mut self) -> Result<Option<Self::Sample>>;

    /// The next observation of a peer.
    fn receive_observation(&mut self) -> Result<Option<Self::Sample>>;

    /// The next weights. They are to be copied and dropped: no others can be published meanwhile.
    fn receive_weights(&mut self) -> Result<Option<Self::Sample>>;

    /// Publishes to the peers a payload of `header.length` words that `write` fills in place.
    fn publish_observation(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()>;

    /// Publishes to the supervisor a payload of `header.length` words that `write` fills in place.
    fn publish_decision(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()>;
}
