//! What everybody needs and nobody is about.

pub mod distribution;
pub mod error;
pub mod file;
pub mod nearest;
pub mod rng;
pub mod scheduling;
pub mod stats;
pub mod table;
pub mod threads;
