//! vamaro-swarm
pub mod error;
pub mod nn;
pub mod rng;
pub mod world;
