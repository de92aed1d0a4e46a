//! Agents that run on other machines: what their supervisor needs of whoever looks after them.

use std::fmt;
use std::time::Duration;

use rustix::process::Signal;

use crate::agent::process::ProcessSettings;
use crate::base::error::Result;

/// Looks after the agents of a swarm that run on other machines. On the bus of this machine it stands in for them, so
/// nobody there can tell them from the others. It does nothing by itself: the supervisor has it carry what there is
/// whenever it looks at the bus, or wakes the agents.
pub(crate) trait Elsewhere: fmt::Debug {
    /// The agents it looks after, bit by bit.
    fn agents(&self) -> u64;

    /// Gets everything ready to start them. The services of the swarm are there, and so is its policy; `example` has the
    /// settings of any agent.
    fn prepare(&mut self, example: &ProcessSettings) -> Result<()>;

    /// Starts one of its agents, which has been started so often before.
    fn start(&mut self, agent: usize, incarnation: u32);

    /// Sends one a signal, if it is its agent and not gone.
    fn signal(&mut self, agent: usize, signal: Signal);

    /// Ends one, if it is its agent and not gone already.
    fn end(&mut self, agent: usize);

    /// Those that have ended, which and how.
    fn take_dead(&mut self) -> Vec<(usize, String)>;

    /// Puts on the bus what they have sent.
    fn bring(&mut self) -> Result<()>;

    /// Sends them what is on the bus for them.
    fn send(&mut self) -> Result<()>;

    /// What there is to say of the machines they run on.
    fn report(&self) -> Vec<HostReport>;

    /// Waits until those that were told to leave have done so and nothing of them is left, for `longest` or a little
    /// longer.
    fn reap(&mut self, longest: Duration);
}

/// What there is to say of a machine on which agents of a swarm run.
#[derive(Clone, Debug)]
pub struct HostReport {
    /// What it is called.
    pub name: String,
    /// Where it listens.
    pub at: String,
    /// Its agents, bit by bit.
    pub agents: u64,
    /// What its monotonic clock was ahead of the supervisor's, ns.
    pub ahead_ns: i64,
    /// By how much that may be wrong, ns.
    pub error_ns: u64,
    /// Observations that its agents were sent by others or sent themselves, as often as they went by the network.
    pub observations: u64,
    /// Those that the network lost.
    pub lost: u64,
    /// Those that it brought after their deadlines.
    pub delayed: u64,
    /// How often that clock moved by more than errors and drift explain.
    pub clock_jumps: u64,
}

/// All agents run here.
#[derive(Debug)]
pub(super) struct Nowhere;

impl Elsewhere for Nowhere {
    fn agents(&self) -> u64 {
        0
    }

    fn prepare(&mut self, _example: &ProcessSettings) -> Result<()> {
        Ok(())
    }

    fn start(&mut self, _agent: usize, _incarnation: u32) {}

    fn signal(&mut self, _agent: usize, _signal: Signal) {}

    fn end(&mut self, _agent: usize) {}

    fn take_dead(&mut self) -> Vec<(usize, String)> {
        Vec::new()
    }

    fn bring(&mut self) -> Result<()> {
        Ok(())
    }

    fn send(&mut self) -> Result<()> {
        Ok(())
    }

    fn report(&self) -> Vec<HostReport> {
        Vec::new()
    }

    fn reap(&mut self, _longest: Duration) {}
}
