//! How long a swarm waits for whom: nobody waits without a bound.

use std::time::Duration;

/// How long the processes of a swarm may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deadlines {
    /// For all agents to start.
    pub ready: Duration,
    /// For an agent to do its part of a tick in lockstep, before it counts as hung.
    pub answer: Duration,
    /// For agents that were told to leave to do so, before they are killed.
    pub leave: Duration,
    /// For an agent's peers to publish in lockstep, before it decides without them. Longer than `answer`: the supervisor
    /// ends the swarm before that, and refuses a decision made without them.
    pub peers: Duration,
}

impl Default for Deadlines {
    fn default() -> Deadlines {
        let [ready, answer, leave, peers] = [30, 10, 2, 60].map(Duration::from_secs);
        Deadlines { ready, answer, leave, peers }
    }
}
