//! The other processes of a measurement: started, waited for with a bound, and told to leave.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::Medium;
use crate::base::error::Result;
use crate::bus::{Wait, wait_until};
use crate::failed;

/// How long the other side may take for anything before it counts as hung.
const ANSWER_DEADLINE: Duration = Duration::from_secs(10);

/// How long a peer that was told to leave may take.
pub(super) const LEAVE_DEADLINE: Duration = Duration::from_secs(2);

/// How often a waiting process looks whether waiting still makes sense.
const LOOK: Duration = Duration::from_millis(100);

/// What a peer is told at its start.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PeerSettings {
    /// Process id of the one that measures.
    pub(super) parent: i32,
    /// How it waits.
    pub(super) wait: Wait,
    /// What it does.
    pub(super) role: Role,
}

/// What a peer does.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Role {
    /// Answers every message.
    Echo(Echo),
    /// Ticks as an agent without networks.
    Bare(BareAgent),
}

/// How messages are answered.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Echo {
    pub(super) medium: Medium,
    /// Bytes.
    pub(super) payload: usize,
    /// The tag of the directory that iceoryx2 works in, for those who use it.
    pub(super) tag: String,
}

/// Which agent without networks it is.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct BareAgent {
    pub(super) tag: String,
    pub(super) agent: usize,
    pub(super) agents: usize,
    /// Bytes of an observation.
    pub(super) payload: usize,
}

impl PeerSettings {
    /// Those of a peer of this process.
    pub(super) fn new(wait: Wait, role: Role) -> PeerSettings {
        PeerSettings { parent: std::process::id() as i32, wait, role }
    }
}

/// Waits until `ready` holds, as everybody waits on the bus. Now and then `check` may find a reason not to wait any
/// longer; the bound is one.
pub(super) fn await_state<T>(
    target: &mut T,
    wait: Wait,
    sleep: impl Fn(&T, Duration) -> Result<()>,
    mut ready: impl FnMut(&mut T) -> Result<bool>,
    mut check: impl FnMut(&mut T) -> Result<()>,
) -> Result<()> {
    let deadline = Instant::now() + ANSWER_DEADLINE;
    while !wait_until(target, wait, Instant::now() + LOOK, &sleep, &mut ready)? {
        check(target)?;
        if Instant::now() > deadline {
            return Err(failed!("nothing arrived for {ANSWER_DEADLINE:?}; giving up"));
        }
    }
    Ok(())
}
