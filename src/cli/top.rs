//! `top`: watch a swarm that is running.

use std::os::unix::fs::MetadataExt;

use clap::Args;

use super::print;
use crate::base::error::{Error, Result};
use crate::base::table::table;
use crate::bus::{Living, have_others_swarms, living};
use crate::supervisor::signals;
use crate::usage;
use crate::view::{Facts, Farewell, Sign, visit};

/// Watch a swarm that is running, in the terminal
///
/// This shows what `spawn --view` shows, of a swarm that was started with `spawn` by the same user, in another terminal, in
/// the background or by a script. It only watches: the swarm plays as if nobody looked. Up to four can watch a swarm.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm top
  vamaro-swarm top 4711

Keys:
  tab, n, right    the next agent; shift-tab, N, left: the one before
  space            hold the picture, and let it go on
  Ctrl-L           redraw the screen
  q, Ctrl-C        leave; the swarm plays on

docs/viewing.md explains the rest.")]
pub struct Top {
    /// The process of `spawn`, if several swarms are running
    #[arg(value_name = "PID", allow_negative_numbers = true)]
    process: Option<u32>,
}

impl Top {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let alive = living()?;
        let shown = alive.iter().filter_map(|swarm| Some((swarm, Sign::of(swarm)?)));
        let shown: Vec<(&Living, Sign)> = shown.collect();
        let (swarm, sign) = self.choose(&shown, alive.len())?;
        match visit(swarm, sign.facts()?)? {
            Farewell::SeenEnough => Ok(()),
            Farewell::Over => print(&format!("The swarm of process {} has ended.\n", sign.process)),
        }
    }

    /// The one that is meant, of those that can be watched; `alive` are all of this user.
    fn choose<'a>(&self, shown: &'a [(&'a Living, Sign)], alive: usize) -> Result<&'a (&'a Living, Sign)> {
        match (self.process, shown) {
            (Some(process), _) => {
                let meant = shown.iter().find(|(_, sign)| sign.process == process);
                meant.ok_or_else(|| is_no_swarm(process, shown))
            }
            (None, [swarm]) => Ok(swarm),
            (None, []) => Err(none_is_running(alive)),
            (None, several) => {
                let process = several[0].1.process;
                Err(usage!(
                    "{} swarms are running; name the process of one, such as `vamaro-swarm top {process}`:\n{}",
                    several.len(),
                    listed(several)
                ))
            }
        }
    }
}

/// What tells swarms apart.
fn listed(swarms: &[(&Living, Sign)]) -> String {
    let row = |(_, sign): &(&Living, Sign)| {
        let facts = sign.facts();
        let told = |tell: &dyn Fn(&Facts) -> String| facts.as_ref().map_or("?".to_owned(), tell);
        let seconds = sign.age().as_secs();
        let age = match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
            (0, 0, s) => format!("{s} s"),
            (0, m, s) => format!("{m} min {s} s"),
            (h, m, _) => format!("{h} h {m} min"),
        };
        vec![
            sign.process.to_string(),
            told(&|facts| facts.task.clone()),
            told(&|facts| facts.agents.to_string()),
            age,
        ]
    };
    table(&["process", "task", "agents", "running for"], swarms.iter().map(row)).trim_end().to_owned()
}

fn none_is_running(alive: usize) -> Error {
    if alive > 0 {
        return usage!(
            "no swarm is running that can be watched: only `spawn` shows its swarm, once all agents are ready, and without \
             --in-process"
        );
    }
    let others = if have_others_swarms() { "; those of other users are for them alone" } else { "" };
    usage!(
        "no swarm of yours is running{others}; start one in another terminal, such as `vamaro-swarm spawn`"
    )
}

/// Why nothing can be seen of this process.
fn is_no_swarm(process: u32, shown: &[(&Living, Sign)]) -> Error {
    let own = rustix::process::geteuid().as_raw();
    match std::fs::metadata(format!("/proc/{process}")).map(|about| about.uid()) {
        Err(_) => usage!("there is no process {process}{}", instead(shown)),
        Ok(user) if user != own => usage!(
            "process {process} belongs to user {user}, and you are user {own}: a swarm can be watched by its own user only"
        ),
        Ok(_) => usage!("process {process} runs no swarm that can be watched, or not yet{}", instead(shown)),
    }
}

fn instead(shown: &[(&Living, Sign)]) -> String {
    match shown {
        [] => "; nor does any other of yours".to_owned(),
        shown => format!("; these do:\n{}", listed(shown)),
    }
}
