//! What a supervisor and a host tell each other besides the messages of agents, as JSON.

use std::fmt::Write;

use serde::{Deserialize, Deserializer, Serialize, de::DeserializeOwned};

use super::echo::Echo;
use super::patience::Patience;
use super::tally::Tally;
use crate::agent::process::ProcessSettings;
use crate::base::error::Result;
use crate::bus::PROTOCOL;
use crate::failed;
use crate::nn::kernels;

/// The bytes of the largest policy file that is sent.
pub(super) const LARGEST_POLICY: u64 = 256 << 20;

/// The digits of a line's secret: 128 bits.
const SECRET_DIGITS: usize = 32;

/// What a supervisor asks a host.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Question {
    /// Who are you?
    Who,
    /// Will you look after some agents of a swarm? A policy file comes with it.
    Join(Box<Invitation>),
    /// Will you answer messages, so that it can be measured how long they take?
    Echo(Echo),
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
    /// Whether the network is the link: then observations may be lost on the way.
    pub(super) network_is_link: bool,
    /// The secret in the names of the line, from [`secret`].
    pub(super) line: String,
}

/// A secret that nobody can guess, in hex digits.
pub(super) fn secret() -> Result<String> {
    let mut bytes = [0; SECRET_DIGITS / 2];
    getrandom::fill(&mut bytes).map_err(|e| failed!("the kernel gives no random numbers: {e}"))?;
    Ok(format!("{:032x}", u128::from_ne_bytes(bytes)))
}

/// Whether a text is such a secret: names that are made of it say nothing else.
pub(super) fn is_secret(text: &str) -> bool {
    text.len() == SECRET_DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// What a host answers.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Answer {
    /// This is who I am.
    I(Identity),
    /// I will.
    Yes,
    /// I will, at this port if they are datagrams.
    At(u16),
    /// I will not, and why.
    No(#[serde(deserialize_with = "printable")] String),
}

/// What has to be the same on all machines of a swarm.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Identity {
    /// The version of the program.
    #[serde(deserialize_with = "printable")]
    pub(super) program: String,
    /// That of the protocol between agents and their supervisor.
    pub(super) protocol: u32,
    /// The instructions that networks are computed with. On others, results differ in their last bits.
    #[serde(deserialize_with = "printable")]
    pub(super) instructions: String,
    /// How long it waits.
    pub(super) patience: Patience,
}

impl Identity {
    /// That of this program on this machine.
    pub(super) fn own(patience: Patience) -> Identity {
        Identity {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            protocol: PROTOCOL,
            instructions: kernels::instruction_set().to_owned(),
            patience,
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
    /// Tell the time. This is when the supervisor asks, by its own clock: the answer has it, too.
    Tell { asked_ns: u64 },
    /// End all, and leave nothing behind.
    Leave,
}

/// What happens on a host.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum Event {
    /// An agent has ended: which, how often it had been started before, and how.
    Ended {
        agent: usize,
        incarnation: u32,
        #[serde(deserialize_with = "printable")]
        how: String,
    },
    /// The time, by this host's clock: when it was asked, and now.
    /// What has come from the supervisor is counted, too.
    Told { asked_ns: u64, heard_ns: u64, said_ns: u64, tally: Tally },
    /// An agent has written a line to stderr.
    Said {
        agent: usize,
        #[serde(deserialize_with = "printable")]
        line: String,
    },
    /// The host cannot go on, and has ended all its agents.
    Failed(#[serde(deserialize_with = "printable")] String),
    /// Nothing of the swarm is left.
    Left,
}

/// The bit of an agent that the other side names, if it is among these, bit by bit.
pub(super) fn bit_among(agents: u64, agent: usize) -> Option<u64> {
    let bit = u32::try_from(agent).ok().and_then(|agent| 1u64.checked_shl(agent));
    bit.filter(|bit| agents & bit != 0)
}

/// What something is, said as JSON.
pub(super) fn say(something: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(something).expect("paths in settings are a swarm's own, which are text")
}

/// What was said.
pub(super) fn understand<T: DeserializeOwned>(said: &[u8]) -> Result<T> {
    serde_json::from_slice(said).map_err(|e| failed!("what it says cannot be understood: {e}"))
}

/// Reads a text that will be printed, as [`plain`] makes it.
fn printable<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<String, D::Error> {
    String::deserialize(from).map(|text| plain(&text))
}

/// A text of somebody else, as it may be printed: not too long, and without characters that move the cursor or do
/// something else to a terminal.
pub(super) fn plain(text: &str) -> String {
    /// The most characters that are kept.
    const LONGEST: usize = 2000;
    let mut plain = String::new();
    for c in text.chars().take(LONGEST) {
        let written = match c {
            '\t' => write!(plain, "{c}"),
            c if c.is_control() => write!(plain, "{}", c.escape_default()),
            c => write!(plain, "{c}"),
        };
        written.expect("memory can be written to");
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_say_cannot_do_anything_to_a_terminal() {
        let event = |words: &str| understand::<Event>(words.as_bytes()).unwrap();
        let Event::Said { line, .. } = event(r#"{"Said":{"agent":0,"line":"a\u001b[2Jb\r\u009bc\td"}}"#)
        else {
            panic!("it is a line");
        };
        assert_eq!(line, "a\\u{1b}[2Jb\\r\\u{9b}c\td");
        let long = format!(r#"{{"Failed":"{}"}}"#, "x".repeat(1 << 20));
        assert!(matches!(event(&long), Event::Failed(how) if how.len() == 2000));
    }

    #[test]
    fn whoever_is_named_must_be_there() {
        assert_eq!(bit_among(1 << 63 | 1, 63), Some(1 << 63));
        for nobody in [1, 64, 65, 1 << 32, usize::MAX] {
            assert_eq!(bit_among(1 << 63 | 1, nobody), None, "{nobody}");
        }
    }

    #[test]
    fn secrets_differ_and_are_names() {
        let (one, other) = (secret().unwrap(), secret().unwrap());
        assert!(is_secret(&one) && is_secret(&other) && one != other);
        assert!(!is_secret("**") && !is_secret(&"*".repeat(32)));
    }
}
