//! A tick of a swarm, what its agents do in it, and the same tick with nothing in it.

use std::time::Duration;

use super::{BareTeam, Played, Setup};
use crate::base::distribution::Distribution;
use crate::base::error::Result;
use crate::bus::Wait;
use crate::supervisor::AgentTimes;

/// How long the ticks of a team took, and the parts of them.
#[derive(Clone, Debug)]
pub struct Tick {
    /// Size of the team.
    pub agents: usize,
    /// Parallel worlds.
    pub worlds: usize,
    /// Bytes of an observation message.
    pub payload: usize,
    /// How processes waited for each other.
    pub wait: Wait,
    /// From the first sensor message sent to the last decision received.
    pub tick: Distribution,
    /// The same for agents without networks over plain iceoryx2.
    pub bare: Distribution,
    /// An agent's decision: from having received everything to publishing the action.
    pub decision: Distribution,
    /// The imputer's part of it.
    pub imputer: Distribution,
    /// The policy's part of it.
    pub policy: Distribution,
    /// The age of each peer's observation at the moment that a policy uses it.
    pub age: Distribution,
}

impl Tick {
    /// Plays for so long with agents and for so long with bare ones. The payload is what comes closest with a whole
    /// number of worlds.
    pub fn measure(setup: &Setup, payload: usize, wait: Wait, longest: Duration) -> Result<Tick> {
        let (agents, worlds) = (setup.task().spec().n_agents(), setup.worlds(payload));
        let payload = setup.payload(worlds);
        let mut measured = Tick {
            agents,
            worlds,
            payload,
            wait,
            tick: Distribution::default(),
            bare: Distribution::default(),
            decision: Distribution::default(),
            imputer: Distribution::default(),
            policy: Distribution::default(),
            age: Distribution::default(),
        };
        Played::start(setup, worlds, wait)?.play(longest, |times, elapsed| {
            measured.tick.record(elapsed.as_nanos() as u64);
            measured.record(times);
        })?;
        let mut bare = BareTeam::start(agents, payload, wait)?;
        bare.play(longest, |elapsed| measured.bare.record(elapsed.as_nanos() as u64))?;
        Ok(measured)
    }

    /// What a tick cannot do without on so many cores: a bare tick, and the decisions of all agents, in microseconds.
    pub fn needed_us(&self, cores: usize) -> f64 {
        let turns = (self.agents as f64 / cores as f64).max(1.0);
        self.bare.quantile_us(0.5) + turns * self.decision.quantile_us(0.5)
    }

    /// Takes in what the agents say of a tick.
    fn record(&mut self, times: &[AgentTimes]) {
        for (agent, AgentTimes { decision, decided_ns, .. }) in times.iter().enumerate() {
            self.decision.record(decided_ns - decision.received_ns);
            self.imputer.record(decision.fused_ns - decision.received_ns);
            self.policy.record(decided_ns - decision.fused_ns);
            let peers = times.iter().enumerate().filter(|(peer, _)| *peer != agent);
            peers.for_each(|(_, peer)| self.age.record(decision.fused_ns - peer.published_ns));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::DecisionTimes;

    #[test]
    fn parts_and_ages_are_differences_of_times() {
        let times = |published_ns, received_ns, fused_ns, decided_ns| {
            let decision = DecisionTimes { received_ns, fused_ns };
            AgentTimes { published_ns, decision, decided_ns }
        };
        let empty = Distribution::default;
        let mut tick = Tick {
            agents: 2,
            worlds: 1,
            payload: 64,
            wait: Wait::Block,
            tick: empty(),
            bare: empty(),
            decision: empty(),
            imputer: empty(),
            policy: empty(),
            age: empty(),
        };
        tick.record(&[times(1000, 1100, 1110, 1150), times(1050, 1120, 1150, 1200)]);
        let ends =
            |distribution: &Distribution| [0.0, 1.0].map(|q| (distribution.quantile_us(q) * 1e3).round());
        assert_eq!(ends(&tick.decision), [50.0, 80.0]);
        assert_eq!(ends(&tick.imputer), [10.0, 30.0]);
        assert_eq!(ends(&tick.policy), [40.0, 50.0]);
        // 1110 - 1050 and 1150 - 1000.
        assert_eq!(ends(&tick.age), [60.0, 150.0]);
        tick.bare.record(1000);
        assert!((tick.needed_us(1) - 1.1).abs() < 1e-9, "two decisions of 50 ns each on one core");
        assert!((tick.needed_us(8) - 1.05).abs() < 1e-9);
    }
}
