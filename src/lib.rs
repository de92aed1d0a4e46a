//! vamaro-swarm
pub mod error;
pub mod rng;
pub mod world;
