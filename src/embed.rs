//! What a program of one's own needs to run a swarm: its agents are that program, started again.

use std::io::Write;

use crate::agent::Registry;
use crate::agent::process::{self, ProcessSettings};
use crate::base::error::Result;
use crate::failed;
use crate::supervisor::AgentCommand;

/// How the settings of an agent begin, of whatever version: a program that took them for something else would start agents
/// in its turn.
const SETTINGS: &str = "{\"address\":";

/// Runs an agent if this process was started for that, and never returns then. Otherwise notes that this program can be
/// an agent, without which it starts no swarm of processes.
///
/// The agent finds its imputer in `registry`, by name: it is the one that the supervisor's settings have.
///
/// This comes first in `main`: what stands before it each agent does too.
pub fn run_if_agent(registry: &Registry) {
    AgentCommand::allow_this_program();
    let words: Vec<_> = std::env::args_os().rev().take(2).collect();
    let [settings, what] = words.as_slice() else { return };
    let settings = settings.to_str().filter(|settings| what == "agent" && settings.starts_with(SETTINGS));
    let Some(settings) = settings else { return };
    let settings: Result<ProcessSettings> = serde_json::from_str(settings).map_err(|e| {
        failed!("this program is no agent for the one that started it, which is another version: {e}")
    });
    let run = |mut process: ProcessSettings| {
        process.settings.registry = registry.clone();
        process::run(&process)
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
