//! What your own program needs to run a swarm: its agents are that program, started again.

use std::ffi::OsString;
use std::io::Write;

use crate::agent::Registry;
use crate::agent::process::{self, ProcessSettings};
use crate::base::error::Result;
use crate::base::faults::say_what_ended;
use crate::failed;
use crate::supervisor::AgentCommand;

/// How the settings of an agent begin, in every version. A program that did not recognise them would start agents of
/// its own.
const SETTINGS: &str = "{\"address\":";

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
        settings.check()?;
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
