//! Ports in the places of agents that are not on this machine: what comes from them is published here, and what is for
//! them is received.

use iceoryx2::node::Node;
use iceoryx2::prelude::ipc;

use super::services::{Role, WordPublisher, WordSubscriber, subscriber};
use super::shared::{publish, receive};
use super::{Header, Layout, SharedSample, SwarmAddress};
use crate::base::error::Result;

/// Stands in for some agents of a swarm. Opens what the supervisor of this machine has created.
#[derive(Debug)]
pub(crate) struct StandIns {
    /// By agent; `None` for those that are here.
    ports: Vec<Option<Ports>>,
    observations: WordSubscriber,
    // Declared last: ports go before the node they belong to.
    _node: Node<ipc::Service>,
}

/// Those of one agent.
#[derive(Debug)]
struct Ports {
    sensor: WordSubscriber,
    observations: WordPublisher,
    decisions: WordPublisher,
}

impl StandIns {
    /// Takes the places of these agents, bit by bit, of the swarm at `address`. One of them at least: it is their room that
    /// is taken.
    pub(crate) fn open(address: &SwarmAddress, layout: &Layout, agents: u64) -> Result<StandIns> {
        let node = address.node(Role::Agent)?;
        let services = address.services(&node, Role::Agent)?;
        let ports = |agent: usize| {
            Ok(Ports {
                sensor: subscriber(&address.sensor(&node, agent, Role::Agent)?)?,
                observations: address
                    .publisher(&services.observations, layout.observation_words(address.worlds))?,
                decisions: address.publisher(&services.decisions, layout.decision_words(address.worlds))?,
            })
        };
        let ports = |agent| (agents >> agent & 1 == 1).then(|| ports(agent)).transpose();
        Ok(StandIns {
            ports: (0..address.agents).map(ports).collect::<Result<_>>()?,
            observations: subscriber(&services.observations)?,
            _node: node,
        })
    }

    /// The next message of the supervisor to one of the agents.
    pub(crate) fn receive_sensor(&self, agent: usize) -> Result<Option<SharedSample>> {
        self.ports[agent].as_ref().map_or(Ok(None), |ports| receive(&ports.sensor))
    }

    /// The next observation that any agent has published, those that are stood in for included.
    pub(crate) fn receive_observation(&self) -> Result<Option<SharedSample>> {
        receive(&self.observations)
    }

    /// Publishes an observation of one of the agents, which the header names.
    pub(crate) fn publish_observation(&self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let ports = self.ports[header.sender as usize].as_ref();
        ports.map_or(Ok(()), |ports| publish(&ports.observations, header, write))
    }

    /// Publishes to the supervisor a decision of one of the agents, or that it is ready.
    pub(crate) fn publish_decision(&self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let ports = self.ports[header.sender as usize].as_ref();
        ports.map_or(Ok(()), |ports| publish(&ports.decisions, header, write))
    }
}
