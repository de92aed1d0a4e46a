//! What wakes the supervisor of a swarm from any thread of its process: whoever hears of something that is not on the bus.

use iceoryx2::node::Node;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::ipc_threadsafe::Service;

use super::SwarmAddress;
use super::directory::{prefix_of, root_of};
use super::services::{Role, bus_error, node_at};
use crate::base::error::Result;

/// Wakes the supervisor of one swarm.
#[derive(Debug)]
pub(crate) struct Bell {
    wake: Notifier<Service>,
    // Declared last: ports go before the node they belong to.
    _node: Node<Service>,
}

impl Bell {
    /// That of the swarm at `address`, which must have been created.
    pub(crate) fn of(address: &SwarmAddress) -> Result<Bell> {
        let node = node_at(&root_of(&address.tag), &prefix_of(&address.tag), "bell")?;
        let service = address.supervisors_event(&node, Role::Agent)?;
        let wake = service.notifier_builder().create().map_err(bus_error("create a bell"))?;
        Ok(Bell { wake, _node: node })
    }

    /// Wakes it. A wake-up that fails is one that is late.
    pub(crate) fn ring(&self) {
        let _ = self.wake.notify();
    }
}
