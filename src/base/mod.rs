//! What everybody needs and nobody is about.

#[cfg(feature = "mcap")]
pub(crate) mod colours;
pub mod distribution;
pub mod error;
pub(crate) mod faults;
pub(crate) mod file;
pub(crate) mod hash;
pub(crate) mod nearest;
#[cfg(feature = "cli")]
pub(crate) mod page;
pub(crate) mod regular;
pub mod rng;
pub mod scheduling;
pub(crate) mod stats;
#[cfg(feature = "cli")]
pub(crate) mod table;
pub(crate) mod tasks;
pub(crate) mod threads;
