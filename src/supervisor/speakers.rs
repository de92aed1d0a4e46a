//! Whose process sent a message, whatever its header says.

use super::Children;
use crate::bus::{Sample, SharedSample};

/// The nodes of iceoryx2 by which agents speak. A process has one, so the kernel is asked about each only once, when the
/// agent gets ready.
#[derive(Debug)]
pub(super) struct Speakers {
    /// Of each agent.
    nodes: Vec<Option<u128>>,
}

impl Speakers {
    /// None of so many agents has spoken.
    pub(super) fn new(agents: usize) -> Speakers {
        Speakers { nodes: vec![None; agents] }
    }

    /// An agent's process is gone.
    pub(super) fn forget(&mut self, agent: usize) {
        self.nodes[agent] = None;
    }

    /// The agent whose process sent this; `None` if that has ended, or has left the agent's process group.
    pub(super) fn of(&mut self, sample: &SharedSample, agents: &Children) -> Option<usize> {
        let (node, sender) = (Some(sample.node()), sample.header().sender as usize);
        if self.nodes.get(sender) == Some(&node) {
            return Some(sender);
        }
        let known = self.nodes.iter().position(|known| *known == node);
        let agent = known.or_else(|| agents.whose(sample.process()?))?;
        self.nodes[agent] = node;
        Some(agent)
    }
}
