//! An observation on our bus: published by one agent, received by another.

use std::time::Duration;

use super::transport::Transport;
use crate::base::error::Result;
use crate::bus::{
    AgentPort, AgentSharedPort, Header, Kind, Layout, PROTOCOL, Sample, SupervisorPort, SwarmAddress, Wait,
};

/// One of two agents of a swarm, with the ports that agents have.
///
/// As in any swarm an observation goes to all agents and the supervisor. The first agent also holds the supervisor's
/// ports, so that each is woken as in a swarm.
pub(super) struct BusEnd {
    port: AgentSharedPort,
    supervisor: Option<SupervisorPort>,
    header: Header,
    wait: Wait,
}

impl BusEnd {
    /// The first agent. Creates the services in the directory of the swarm with this tag.
    pub(super) fn create(tag: &str, payload: usize, wait: Wait) -> Result<BusEnd> {
        let (address, layout) = swarm(tag, payload);
        let supervisor = SupervisorPort::create(&address, &layout)?;
        BusEnd::of(0, &address, &layout, Some(supervisor), wait)
    }

    /// The second agent.
    pub(super) fn open(tag: &str, payload: usize, wait: Wait) -> Result<BusEnd> {
        let (address, layout) = swarm(tag, payload);
        BusEnd::of(1, &address, &layout, None, wait)
    }

    fn of(
        agent: usize,
        address: &SwarmAddress,
        layout: &Layout,
        supervisor: Option<SupervisorPort>,
        wait: Wait,
    ) -> Result<BusEnd> {
        let header = Header {
            protocol: PROTOCOL,
            kind: Kind::Observation as u32,
            swarm: address.id(),
            sender: agent as u32,
            worlds: 1,
            length: layout.observation as u64,
            ..Header::default()
        };
        Ok(BusEnd { port: AgentSharedPort::open(address, layout, agent, 0)?, supervisor, header, wait })
    }
}

impl Transport for BusEnd {
    fn send(&mut self, fill: impl FnOnce(&mut [u8])) -> Result<()> {
        self.port.publish_observation(self.header, |words| fill(bytemuck::cast_slice_mut(words)))?;
        match (self.wait, &self.supervisor) {
            (Wait::Spin, _) => Ok(()),
            (Wait::Block, Some(supervisor)) => supervisor.wake_agents(),
            (Wait::Block, None) => self.port.wake_supervisor(),
        }
    }

    fn receive(&mut self, read: impl FnOnce(&[u8])) -> Result<bool> {
        while let Some(sample) = self.port.receive_observation()? {
            // Everybody gets his own as well.
            if sample.header().sender != self.header.sender {
                read(bytemuck::cast_slice(sample.words()));
                // The supervisor reads along.
                while self
                    .supervisor
                    .as_ref()
                    .map_or(Ok(None), SupervisorPort::receive_observation)?
                    .is_some()
                {}
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn sleep(&self, longest: Duration) -> Result<()> {
        match &self.supervisor {
            Some(supervisor) => supervisor.sleep(longest),
            None => self.port.sleep(longest),
        }
    }
}

fn swarm(tag: &str, payload: usize) -> (SwarmAddress, Layout) {
    let address = SwarmAddress { agents: 2, ..SwarmAddress::of(tag) };
    (address, Layout { agents: 2, observation: payload / 4, action: 1, joint: 1, logits: 1, relay: false })
}
