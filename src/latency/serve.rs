//! What a peer does when it is started.

use rustix::process::Signal;

use super::peer::{PeerSettings, Role};
use super::{bare, hop};
use crate::agent::process::leave_with;
use crate::base::error::Result;

/// Runs a peer until it is told to leave.
pub fn run(settings: &PeerSettings) -> Result<()> {
    leave_with(settings.parent, Signal::KILL)?;
    match &settings.role {
        Role::Echo(echo) => hop::answer(echo, settings.wait),
        Role::Bare(agent) => bare::tick(agent, settings.wait),
    }
}
