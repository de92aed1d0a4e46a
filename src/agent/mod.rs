//! The agent's side: decentralised execution.
//!
//! ```text
//! own sensor --+
//!              +--> fuse --> joint estimate --> act --> action      on the critical path
//! inbox -------+      ^            |             |
//!                     |            v             |
//!                     +------- predict <---------+                  after the action is out
//! ```
//!
//! [`Agent`] is these three calls. [`Member`] ties an agent to its port on the bus, phase by phase, and
//! `process` runs a member as a process of its own.

mod choice;
mod decision;
mod holdings;
pub mod imputer;
mod inbox;
mod member;
mod oracle;
pub(crate) mod process;
mod source;

#[cfg(feature = "python")]
pub(crate) use choice::{most_probable, sample};
pub use decision::{Agent, AgentSettings};
pub(crate) use holdings::Holdings;
pub use imputer::{Imputer, JointLayout, PREFERRED, Registry};
pub use inbox::{Inbox, Received};
pub(crate) use inbox::{Mailbox, is_observable};
pub use member::{Member, Sensed};
pub use oracle::Truth;
pub(crate) use source::BUILTIN;
pub use source::{PolicySource, dims, paper_actor};
