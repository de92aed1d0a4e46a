//! Ports in the places of agents that are not on this machine: what comes from them is published here, and what is for
//! them is received.

use iceoryx2::node::Node;
use iceoryx2::prelude::ipc;

use super::services::{Role, WordPublisher, WordSubscriber, subscriber};
use super::shared::{publish, receive};
use super::{Header, Layout, SharedSample, SwarmAddress};
use crate::base::error::Result;

/// Publishes the observations of agents that are elsewhere: what their peers on this machine need of them. Opens what the
/// supervisor of this machine has created.
#[derive(Debug)]
pub(crate) struct Voices {
    /// By agent; `None` for those that are here.
    observations: Vec<Option<WordPublisher>>,
    // Declared last: ports go before the node they belong to.
    node: Node<ipc::Service>,
}

impl Voices {
    /// Those of these agents, bit by bit, of the swarm at `address`. One of them at least: it is their room that is taken.
    pub(crate) fn open(address: &SwarmAddress, layout: &Layout, agents: u64) -> Result<Voices> {
        let node = address.node(Role::Agent)?;
        let service = address.observations(&node, Role::Agent)?;
        let words = layout.observation_words(address.worlds);
        let observations = each_of(address, agents, |_| address.publisher(&service, words))?;
        Ok(Voices { observations, node })
    }

    /// Publishes an observation of one of the agents, which the header names.
    pub(crate) fn publish_observation(&self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let port = self.observations[header.sender as usize].as_ref();
        port.map_or(Ok(()), |port| publish(port, header, write))
    }
}

/// Stands in for agents on the machine of the supervisor that they have: it answers in their place, too.
#[derive(Debug)]
pub(crate) struct StandIns {
    /// By agent; `None` for those that are here.
    ports: Vec<Option<Ports>>,
    observations: WordSubscriber,
    // Declared last: the node that the ports belong to is in it.
    voices: Voices,
}

/// Those of one agent.
#[derive(Debug)]
struct Ports {
    sensor: WordSubscriber,
    decisions: WordPublisher,
}

impl StandIns {
    /// Takes the places of these agents, as [`Voices::open`] does.
    pub(crate) fn open(address: &SwarmAddress, layout: &Layout, agents: u64) -> Result<StandIns> {
        let voices = Voices::open(address, layout, agents)?;
        let observations = address.observations(&voices.node, Role::Agent)?;
        let decisions = address.decisions(&voices.node, Role::Agent)?;
        let ports = each_of(address, agents, |agent| {
            Ok(Ports {
                sensor: subscriber(&address.sensor(&voices.node, agent, Role::Agent)?)?,
                decisions: address.publisher(&decisions, layout.decision_words(address.worlds))?,
            })
        });
        Ok(StandIns { ports: ports?, observations: subscriber(&observations)?, voices })
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
        self.voices.publish_observation(header, write)
    }

    /// Publishes to the supervisor a decision of one of the agents, or that it is ready.
    pub(crate) fn publish_decision(&self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let ports = self.ports[header.sender as usize].as_ref();
        ports.map_or(Ok(()), |ports| publish(&ports.decisions, header, write))
    }
}

/// What `open` opens for each of these agents, bit by bit, by agent.
fn each_of<T>(
    address: &SwarmAddress,
    agents: u64,
    open: impl Fn(usize) -> Result<T>,
) -> Result<Vec<Option<T>>> {
    (0..address.agents).map(|agent| (agents >> agent & 1 == 1).then(|| open(agent)).transpose()).collect()
}
