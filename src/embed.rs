//! What your own program needs to run a swarm: its agents are that program, started again.

use std::ffi::OsString;
use std::io::Write;

use crate::agent::Registry;
use crate::agent::process::{self, ProcessSettings};
use crate::base::error::Result;
use crate::base::faults::say_what_ended;
use crate::base::rng::MAX_AGENTS;
use crate::bus::{PROTOCOL, is_tag};
use crate::failed;
use crate::link::LONGEST_DELAY;
use crate::supervisor::AgentCommand;

/// How the settings of an agent begin, in every version. A program that did not recognise them would start agents of
/// its own.
const SETTINGS: &str = "{\"address\":";

/// The most 32-bit words that a supervisor puts into a message.
const MOST_WORDS: usize = 1 << 26;

/// If this process was started as an agent, runs the agent and exits. Otherwise notes that this program can run as an
/// agent, and returns. Without that note a [`Swarm`](crate::Swarm) starts no processes of this program.
///
/// Call it first in `main`: code before it runs in every agent too. An agent looks up its imputer in `registry`, so
/// pass the one that the [`Swarm`](crate::Swarm) is built with.
pub fn run_if_agent(registry: &Registry) {
    AgentCommand::allow_this_program();
    run_if_told(&std::env::args_os().collect::<Vec<_>>(), registry);
}

/// The same if these are the words that this process was started with.
pub(crate) fn run_if_told(words: &[OsString], registry: &Registry) {
    let [.., what, settings] = words else { return };
    let settings = settings.to_str().filter(|settings| what == "agent" && settings.starts_with(SETTINGS));
    let Some(settings) = settings else { return };
    let settings: Result<ProcessSettings> = serde_json::from_str(settings).map_err(|e| {
        failed!(
            "the program that started this agent is another version; build both from the same source: {e}"
        )
    });
    let run = |mut settings: ProcessSettings| {
        check(&settings)?;
        say_what_ended()?;
        settings.settings.registry = registry.clone();
        process::run(&settings)
    };
    std::process::exit(match settings.and_then(run) {
        Ok(()) => 0,
        Err(error) => {
            // Where stderr cannot be written nobody can be told.
            let _ = writeln!(std::io::stderr(), "error: {error}");
            1
        }
    })
}

/// An error if no supervisor of this version can have written these settings. Sizes follow from them.
fn check(process: &ProcessSettings) -> Result<()> {
    let ProcessSettings { address, agent, settings, wire, .. } = process;
    if wire.protocol != PROTOCOL {
        return Err(failed!(
            "the program that started this agent speaks version {} of the protocol, and this one {PROTOCOL}; build both \
             from the same source",
            wire.protocol
        ));
    }
    let team = settings.spec.n_agents();
    // With --relay, a message has an observation and an age of everybody.
    let relayed = team.saturating_mul(settings.spec.padded_obs_dim().saturating_add(1));
    let relayed = if settings.relay { relayed } else { 0 };
    let widest = settings.spec.joint_dim().max(settings.spec.n_actions()).max(relayed);
    let sound = (1..=MAX_AGENTS).contains(&team)
        && address.agents == team
        && *agent < team
        && settings.worlds > 0
        && address.worlds == settings.worlds
        && settings.worlds.saturating_mul(widest) <= MOST_WORDS
        && address.longest_delay == settings.longest_delay
        && address.longest_delay <= LONGEST_DELAY
        && is_tag(&address.tag);
    if sound {
        return Ok(());
    }
    Err(failed!(
        "these are no settings of an agent: agent {agent} of {} in a team of {team}, {} worlds in messages of {}, delays of \
         up to {} and {} ticks, in the swarm `{}`",
        address.agents,
        settings.worlds,
        address.worlds,
        settings.longest_delay,
        address.longest_delay,
        address.tag
    ))
}
