//! Swarms with deadlines of their own and real-time scheduling: a binary of its own, because Cargo runs one binary after
//! the other, and what trains in `suite` would make these late.

#[path = "../common/mod.rs"]
mod common;

mod children;
mod faults;
mod real_time;
mod scheduling;
mod soak;

/// Not a test: what the agents of swarms run that are of this binary.
#[test]
fn agent() {
    vamaro_swarm::run_if_agent(&vamaro_swarm::agent::Registry::default());
}
