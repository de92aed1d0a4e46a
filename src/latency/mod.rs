//! How long things take: the measurements behind `bench latency`, `bench agent` and `bench spawn`.
//!
//! A hop is measured over our bus and over what others use ([`Hop`]); a tick with the agents of a swarm and without
//! anything in it ([`Tick`]). The other side is always a process of its own.

mod bare;
mod bus;
mod futex;
mod growth;
mod hop;
#[cfg(feature = "hosts")]
mod hosts;
mod kernel;
mod memory;
mod message;
pub mod peer;
mod pin;
mod plain;
mod played;
mod serve;
mod tick;
mod transport;

pub use bare::BareTeam;
pub use growth::exponent;
pub use hop::{Hop, PAYLOADS};
#[cfg(feature = "hosts")]
pub(crate) use hosts::{HostHop, HostTick, frame_of_observations};
pub use memory::Memory;
pub use played::{Played, Setup};
pub use serve::run as serve;
pub use tick::Tick;
pub use transport::Medium;

use std::time::{Duration, Instant};

use crate::base::error::Result;
use crate::supervisor::signals;

/// Calls `once` for so long, at least ten times, after a tenth of it to warm up. It is told whether the call counts.
pub fn repeat(longest: Duration, mut once: impl FnMut(bool) -> Result<()>) -> Result<()> {
    for (longest, least, counts) in [(longest / 10, 5, false), (longest, 10, true)] {
        let (began, mut calls) = (Instant::now(), 0);
        while calls < least || began.elapsed() < longest {
            signals::check_stop()?;
            once(counts)?;
            calls += 1;
        }
    }
    Ok(())
}
