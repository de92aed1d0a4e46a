//! What a supervisor and a host tell each other besides the messages of agents, as JSON.

use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::agent::process::ProcessSettings;
use crate::base::error::Result;
use crate::bus::PROTOCOL;
use crate::failed;
use crate::nn::kernels;

/// What a supervisor asks a host.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Question {
    /// Who are you?
    Who,
    /// Will you look after some agents of a swarm? A policy file follows.
    Join(Box<Invitation>),
}

impl Question {
    /// Its words, and a policy file behind them.
    pub(super) fn with(&self, policy: &[u8]) -> Vec<u8> {
        let words = say(self);
        [&(words.len() as u64).to_le_bytes(), words.as_slice(), policy].concat()
    }

    /// The question and the policy file in some bytes.
    pub(super) fn parse(bytes: &[u8]) -> Result<(Question, &[u8])> {
        let cut = || failed!("a question is cut off");
        let (length, rest) = bytes.split_first_chunk().ok_or_else(cut)?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok();
        let (words, policy) = length.and_then(|length| rest.split_at_checked(length)).ok_or_else(cut)?;
        Ok((understand(words)?, policy))
    }
}

/// A swarm, to a host that is to be part of it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Invitation {
    /// The settings of any agent.
    pub(super) example: ProcessSettings,
    /// The agents that the host is to have, bit by bit.
    pub(super) agents: u64,
    /// The hash of the policy file.
    pub(super) policy: u64,
}

/// What a host answers.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Answer {
    /// This is who I am.
    I(Identity),
    /// I will.
    Yes,
    /// I will not, and why.
    No(String),
}

/// What has to be the same on all machines of a swarm.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Identity {
    /// The version of the program.
    pub(super) program: String,
    /// That of the protocol between agents and their supervisor.
    pub(super) protocol: u32,
    /// The instructions that networks are computed with. On others, results differ in their last bits.
    pub(super) instructions: String,
}

impl Identity {
    /// That of this program on this machine.
    pub(super) fn own() -> Identity {
        Identity {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            protocol: PROTOCOL,
            instructions: kernels::instruction_set().to_owned(),
        }
    }
}

/// What a host does for a swarm that it is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Order {
    /// Start an agent, which has been started so often before.
    Start { agent: usize, incarnation: u32 },
    /// Send it a signal, by number.
    Signal { agent: usize, signal: i32 },
    /// End it.
    End { agent: usize },
    /// End all, and leave nothing behind.
    Leave,
}

/// What happens on a host.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Event {
    /// An agent has ended: which, how often it had been started before, and how.
    Ended { agent: usize, incarnation: u32, how: String },
    /// An agent has written a line to stderr.
    Said { agent: usize, line: String },
    /// The host cannot go on, and has ended all its agents.
    Failed(String),
    /// Nothing of the swarm is left.
    Left,
}

/// What something is, said as JSON.
pub(super) fn say(something: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(something).expect("paths in settings are a swarm's own, which are text")
}

/// What was said.
pub(super) fn understand<T: DeserializeOwned>(said: &[u8]) -> Result<T> {
    serde_json::from_slice(said).map_err(|e| failed!("what it says cannot be understood: {e}"))
}
