//! The tests of the real binary and of the library's public side, in one binary, so that they link once.
//!
//! They run as threads of one process. A test with an allocator, a trace of system calls or a clock of its own has no
//! place here: those are the binaries beside this folder.

#[path = "../common/mod.rs"]
mod common;

mod bad_input;
mod bench;
mod compact;
mod delays;
mod dependencies;
mod documents;
mod dynamics;
mod early_ends;
mod evaluate;
mod foreign;
mod help;
mod hosted;
mod imputers;
mod links;
mod lost_is_lost;
mod mcap;
mod onnx;
mod parity;
mod physics;
mod plot;
mod policies;
mod processes;
mod relay;
mod replay;
mod resume;
mod rollouts;
mod rooms;
mod substitute;
#[cfg(feature = "view")]
mod top;
mod train;
mod verify;
#[cfg(feature = "view")]
mod view;
mod worlds;

/// Not a test: what the agents of swarms run that are of this binary.
#[test]
fn agent() {
    vamaro_swarm::run_if_agent(&imputers::registry());
}
