//! The command line, one file per command.

mod bench;
mod campaign;
mod doctor;
pub(crate) mod evaluate;
mod export;
mod fit;
#[cfg(feature = "hosts")]
mod host;
mod import;
mod inspect;
pub(crate) mod machine;
mod man;
mod plot;
mod progress;
mod replay;
mod reporter;
mod requirement;
mod spawn;
mod summary;
mod tasks;
#[cfg(feature = "view")]
mod top;
mod train;
mod verify;

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;

use crate::agent::{PolicySource, Registry};
use crate::base::error::{Error, Result};
use crate::base::faults::say_what_ended;
use crate::base::table::table;
#[cfg(feature = "hosts")]
pub use crate::hosts::share_engine_threads;
use crate::latency::peer::PeerSettings;
use crate::latency::serve;
use crate::supervisor::AgentCommand;
use crate::usage;

/// Swarms of agents: every agent is a process, observations travel through shared memory, and links fail
#[derive(Debug, Parser)]
#[command(name = "vamaro-swarm", version, arg_required_else_help = true, after_help = AFTER_HELP)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "\
Examples:
  # a trained team of four whose links deliver 20 %
  vamaro-swarm spawn --agents 4 --p 0.2
  vamaro-swarm spawn --task hear-see --links dynamic --json
  # train a team of your own; how robust is it to failing links?
  vamaro-swarm train --task hear-see --steps 1M --out runs/hs-0
  vamaro-swarm evaluate runs/hs-0
  # list the tasks; is this machine ready?
  vamaro-swarm tasks
  vamaro-swarm doctor

Exit codes: 0 success, 1 something failed, 2 the request makes no sense, 3 a
requirement is not met, 130 interrupted.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Start a swarm, play episodes, and report how the team did
    Spawn(spawn::Spawn),
    /// Run agents of swarms that `spawn --hosts` starts on another machine
    #[cfg(feature = "hosts")]
    Host(host::Host),
    /// Watch a running swarm in the terminal
    #[cfg(feature = "view")]
    Top(top::Top),
    /// Train a team with MAPPO or IPPO, and predictors alongside it
    Train(Box<train::Train>),
    /// Measure how robust frozen policies are to failing links
    Evaluate(evaluate::Evaluate),
    /// List the tasks: ids, aliases, team sizes, dimensions
    Tasks(tasks::Tasks),
    /// Convert ONNX files, or PyTorch state dicts, to a policy file
    Import(import::Import),
    /// Write a policy in half precision, to archive it
    Export(export::Export),
    /// Fit imputers to a frozen policy
    Fit(fit::Fit),
    /// Show what a policy, checkpoint, trace or recording holds
    Inspect(inspect::Inspect),
    /// Play recorded episodes in a browser, or draw them as an animation or a frame
    Replay(replay::Replay),
    /// Recompute recordings, traces and updates, and compare
    Verify(verify::Verify),
    /// Draw the learning curves of training runs, or what links do
    Plot(plot::Plot),
    /// Measure how fast this program is on this machine
    Bench(bench::Bench),
    /// Check whether this machine is ready, and clean up after dead swarms
    Doctor(doctor::Doctor),
    /// Print completions for a shell
    #[command(after_help = "\
Examples:
  vamaro-swarm completions bash > vamaro-swarm.bash
  vamaro-swarm completions zsh > ~/.zfunc/_vamaro-swarm

docs/installing.md says where each shell looks for them.")]
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Write man pages, one for each command
    Man(man::Man),
    /// Run one agent (started by the supervisor)
    #[command(hide = true)]
    Agent {
        /// Settings as JSON
        settings: String,
    },
    /// Be the other side of a measurement (started by `bench latency`)
    #[command(hide = true)]
    Peer {
        /// Settings as JSON
        settings: String,
    },
}

/// What this program was told, without its name.
static ARGUMENTS: OnceLock<Vec<OsString>> = OnceLock::new();

/// Runs the command line, without the name of the program: parses, dispatches, and prints an error in this one place.
/// Returns the exit code; help, and what cannot be parsed, end the program. A process runs one command line.
pub fn run(arguments: Vec<OsString>) -> u8 {
    let words = std::iter::once(OsString::from("vamaro-swarm")).chain(arguments.clone());
    let result = match ARGUMENTS.set(arguments) {
        Ok(()) => Cli::parse_from(words).run(),
        Err(_) => Err(usage!("this process has run a command line already; start a process for each")),
    };
    match result {
        Ok(()) => 0,
        Err(error) => {
            // Where stderr cannot be written the exit code says it all.
            let _ = writeln!(std::io::stderr(), "error: {error}");
            exit_code(&error)
        }
    }
}

/// What this program was told, without its name.
fn arguments() -> &'static [OsString] {
    ARGUMENTS.get().map_or(&[], |arguments| arguments)
}

impl Cli {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        say_what_ended()?;
        match self.command {
            Command::Spawn(command) => command.run(),
            #[cfg(feature = "hosts")]
            Command::Host(command) => command.run(),
            #[cfg(feature = "view")]
            Command::Top(command) => command.run(),
            Command::Train(command) => command.run(),
            Command::Evaluate(command) => command.run(),
            Command::Tasks(command) => command.run(),
            Command::Import(command) => command.run(),
            Command::Export(command) => command.run(),
            Command::Fit(command) => command.run(),
            Command::Inspect(command) => command.run(),
            Command::Replay(command) => command.run(),
            Command::Verify(command) => command.run(),
            Command::Plot(command) => command.run(),
            Command::Bench(command) => command.run(),
            Command::Doctor(command) => command.run(),
            Command::Completions { shell } => {
                let mut script = Vec::new();
                clap_complete::generate(shell, &mut visible_commands(), "vamaro-swarm", &mut script);
                print_bytes(&script)
            }
            Command::Man(command) => command.run(),
            Command::Agent { settings } => {
                // Who was started for it has not come here.
                Err(usage!(
                    "`agent` is for the supervisor, not for the command line: {settings} are no settings"
                ))
            }
            Command::Peer { settings } => {
                let settings: PeerSettings = serde_json::from_str(&settings)
                    .map_err(|e| usage!("`peer` is for `bench latency`, not for the command line: {e}"))?;
                serve(&settings)
            }
        }
    }
}

/// The exit code the program ends with on this error.
pub fn exit_code(error: &Error) -> u8 {
    match error {
        Error::Usage(_) => 2,
        Error::Unmet(_) => 3,
        Error::Interrupted(_) => 130,
        Error::Remarked { source, .. } => exit_code(source),
        Error::File { .. }
        | Error::Lost { .. }
        | Error::Bus { .. }
        | Error::Outside(_)
        | Error::Failed(_) => 1,
    }
}

/// The command line without what is not for it.
fn visible_commands() -> clap::Command {
    let all = Cli::command();
    let visible = all.get_subcommands().filter(|command| !command.is_hide_set()).cloned();
    clap::Command::new("vamaro-swarm").args(all.get_arguments()).subcommands(visible)
}

/// Writes to stdout. A reader that has heard enough (`| head`) is not an error.
fn print(text: &str) -> Result<()> {
    print_bytes(text.as_bytes())
}

/// The same of what need not be text.
fn print_bytes(bytes: &[u8]) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(Error::Failed(format!("cannot write to stdout: {e}")))
        }
        _ => Ok(()),
    }
}

/// Writes a line of progress to stderr. Where that cannot be written there is nobody to tell.
fn tell(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Starts this command over with candle's own threads turned off, unless somebody has set their number: we
/// run networks side by side already, and products this small are slower on several threads. candle reads the
/// variable from the environment the process began with.
fn keep_candle_to_its_thread() -> Result<()> {
    const THREADS: &str = "RAYON_NUM_THREADS";
    if std::env::var_os(THREADS).is_some() {
        return Ok(());
    }
    let mut command = AgentCommand::this_program()?.start();
    let e = command.args(arguments()).env(THREADS, "1").exec();
    Err(Error::Failed(format!("cannot start over with {THREADS}=1: {e}; set it yourself")))
}

/// Writes a value to stdout as one JSON object.
fn print_json(value: &serde_json::Value) -> Result<()> {
    print(&format!("{value:#}\n"))
}

/// Reads `--policy`: a file, a folder that holds `policy.safetensors`, the name of a pretrained policy in the
/// checkout that is the working directory, `builtin` or `untrained`.
pub(crate) fn policy_source(name: &str, seed: u64) -> Result<PolicySource> {
    match name {
        "builtin" => return Ok(PolicySource::Builtin),
        "untrained" => return Ok(PolicySource::Untrained(seed)),
        _ => {}
    }
    let (path, file) = (Path::new(name), policy_file(Path::new(name)));
    if file.exists() {
        // Agents are told the path, whatever folder they run in.
        return file.canonicalize().map(PolicySource::File).map_err(|e| Error::io("open", &file, e));
    }
    Err(if path.join("agent.th").exists() {
        usage!("{name} holds a PyTorch state dict, agent.th; run `vamaro-swarm import {name}` first")
    } else {
        usage!(
            "there is no policy {}; give a file, a folder, `builtin`, `untrained`, or, in a checkout, the name of one \
             in agents/pretrained, such as hear-see/seed-1",
            file.display()
        )
    })
}

/// The file that is meant by `path`: that in the folder of a run, or, in a checkout, one of `agents/pretrained`.
pub(crate) fn policy_file(path: &Path) -> PathBuf {
    let pretrained = Path::new("agents/pretrained").join(format!("{}.safetensors", path.display()));
    match path {
        _ if path.is_dir() => path.join("policy.safetensors"),
        _ if !path.exists() && pretrained.exists() => pretrained,
        _ => path.to_owned(),
    }
}

/// Reads a probability of delivery or loss.
fn probability(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(p) if (0.0..=1.0).contains(&p) => Ok(p),
        _ => Err("expected a probability between 0 and 1, such as 0.2".to_owned()),
    }
}

/// Reads `--rate`: ticks a second.
fn rate(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(hz) if (0.01..=100_000.0).contains(&hz) => Ok(hz),
        _ => Err("expected ticks per second from 0.01 to 100000, such as 100".to_owned()),
    }
}

/// What the help says of `--physics`.
const PHYSICS_HELP: &str = "How bodies move: any of motor_noise (std of the error of a push, in pushes, 0 to 10), damping \
    (share of its velocity that a body loses per step, 0 to 1), mass (of each agent, kg, 0.01 to 100) and wind (std of a force \
    on all agents alike, in pushes, 0 to 10)";

/// What the help says of an option that names imputers.
fn imputer_help(default: &str) -> String {
    format!(
        "How lost observations are imputed: a predictor of the policy by its name, or {} [default: {default}]",
        Registry::default().help()
    )
}
