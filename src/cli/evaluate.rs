//! `evaluate`: how robust frozen policies are to links that fail.

mod plan;

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::machine;
use super::progress::Progress;
use super::train::threads;
use super::{PHYSICS_HELP, imputer_help, print, tell};
use crate::agent::Truth;
use crate::base::error::{Error, Result};
use crate::bus::Wait;
use crate::environment::PhysicsSpec;
#[cfg(feature = "python")]
use crate::evaluate::Evaluation;
use crate::evaluate::report::{self, Provenance};
use crate::evaluate::{Record, Requirement, Summary, Sweep, Verdict};
use crate::link;
use crate::supervisor::signals;
#[cfg(feature = "python")]
use crate::usage;
use crate::view::film;

/// Measure how robust frozen policies are to failing links
#[derive(Debug, Args)]
#[command(after_help = after_help())]
pub struct Evaluate {
    /// Policies: files, folders with policy.safetensors, in a checkout names of pretrained ones (such as
    /// hear-see/seed-1), or builtin. Policies of one task that were trained alike count as seeds
    #[arg(required = true, value_name = "POLICY")]
    policies: Vec<String>,

    /// The task of all policies; needed for builtin
    #[arg(long, value_name = "T")]
    task: Option<String>,

    /// Probabilities of delivery, p; '' for none, if other conditions are given
    #[arg(
        long,
        value_name = "LIST",
        value_delimiter = ',',
        default_value = "1,0.8,0.6,0.4,0.2,0",
        allow_negative_numbers = true
    )]
    levels: Vec<String>,

    /// Links without one fixed p: uniform (one p per episode), asymmetric (a matrix per episode), dynamic (a matrix
    /// per 5 steps) [default: none]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    modes: Vec<String>,

    /// Links, listed below, as an additional condition; may be repeated. One parameter may be a list of
    /// values, such as 'gilbert(loss=0.8, burst=[5,10,20])': each value is a condition, and the report compares them
    #[arg(long, value_name = "LINKS|FILE")]
    links: Vec<String>,

    /// Kill and stop agents on purpose, as `spawn --chaos` does, as an additional condition. Everything is delivered
    /// unless links follow after ` at `, such as 'kill=0.01 at p=0.2'; may be repeated
    #[arg(long, value_name = "CHAOS[ at LINKS]")]
    chaos: Vec<String>,

    #[arg(long, value_name = "LIST", value_delimiter = ',', help = imputer_help("all that each policy supports, except particles and shared-dice"))]
    imputers: Vec<String>,

    /// Also play each imputer with an oracle that knows a part of the truth, to see how much of the loss is due to not
    /// knowing it: the state of the agent itself (own), of everybody else who moves (others), of those among them who are
    /// not of the team (targets), of agent K (agent:K), or what does not move (constants: landmarks, colours, messages); may
    /// be repeated
    #[arg(long, value_name = "own|others|targets|constants|agent:K")]
    substitute: Vec<Truth>,

    /// The imputer that the others are compared with [default: maro if played, else hold]
    #[arg(long, value_name = "NAME")]
    baseline: Option<String>,

    /// Episodes per cell; a cell is one policy under one condition with one imputer [default: 1000]
    #[arg(long, value_name = "E", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    episodes: Option<u64>,

    /// Take the most probable action instead of sampling
    #[arg(long)]
    greedy: bool,

    /// `paper`: 100 episodes, sampled actions
    #[arg(long, value_enum, conflicts_with_all = ["episodes", "greedy"])]
    protocol: Option<Protocol>,

    /// Lose observations at t = 0 too; by default everything is delivered when an episode starts
    #[arg(long)]
    no_comm_at_t0: bool,

    /// Agents pass on the newest observation that they hold of each other agent, with its age. The same command without
    /// --relay plays the same episodes with the same losses
    #[arg(long)]
    relay: bool,

    #[arg(long, value_name = "PHYSICS", help = PHYSICS_HELP, default_value_t)]
    physics: PhysicsSpec,

    /// Seed of every random draw, the same for all cells
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Folder for report.html, replays, figures, results.json, CSV and the finished cells; after an interruption the same
    /// command continues from these
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,

    /// With --report: figures also as PDF, sized for a column of a paper (252 pt wide, text of 8 pt in Helvetica)
    #[arg(long, requires = "report")]
    paper: bool,

    /// Exit with code 3 unless the low end of the 95 % interval of score, return or iqm reaches this, such as
    /// 'p=0.2 score>=0.9' or 'dynamic imputer=maro return>=-40'; without `imputer=` it means the imputer that
    /// `spawn` uses by default; may be repeated
    #[arg(long, value_name = "REQUIREMENT")]
    require: Vec<String>,

    /// Print the results as one JSON object
    #[arg(long)]
    json: bool,

    /// Episodes played in parallel; one message carries the observations of all of them
    #[arg(long, value_name = "W", default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=4096))]
    worlds: u32,

    /// Run the same agents in this process, several cells at once; the results are bit-identical
    #[arg(long)]
    in_process: bool,

    /// Threads, for cells in-process and for statistics [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,

    /// How processes wait: block (sleep until woken) or spin (poll; needs a core per process)
    #[arg(long, value_enum, default_value_t, conflicts_with = "in_process")]
    wait: Wait,
}

/// How others evaluate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Protocol {
    /// 100 episodes, sampled actions
    Paper,
}

const EXAMPLES: &str = "\
Examples:
  vamaro-swarm evaluate runs/hs-0
  vamaro-swarm evaluate runs/hs-*/policy.safetensors --report report/
  # figures also as PDF
  vamaro-swarm evaluate runs/hs-0 --report report/ --paper
  vamaro-swarm evaluate builtin --task hear-see --levels 1,0.5,0 --modes dynamic
  vamaro-swarm evaluate runs/hs-0 --physics motor_noise=0.3,damping=0.3
  vamaro-swarm evaluate runs/hs-0 --levels 1 \\
      --links 'gilbert(0.1, 0.3) + delay(1, 1)'
  # losses in bursts, compared with independent losses, 80 % each
  vamaro-swarm evaluate runs/hs-0 --levels 1 \\
      --links 'gilbert(loss=0.8, burst=[5,10,20,40])'
  vamaro-swarm evaluate runs/hs-0 --levels 1,0.2 \\
      --chaos kill=0.01 --chaos 'kill=0.01 at p=0.2'
  vamaro-swarm evaluate runs/hs-0 --levels 1,0 --substitute own
  # messages also carry what their senders have received
  vamaro-swarm evaluate runs/hs-0 --relay
  # exit code 3 if the default imputer does not keep 90 % of the score
  vamaro-swarm evaluate runs/hs-0 --require 'p=0.2 score>=0.9'

All cells start from the same initial states, with the same draws of actions
and links: imputers are compared on equal terms. docs/metrics.md defines the
numbers.";

fn after_help() -> String {
    format!("{}\n\n{EXAMPLES}", link::help())
}

impl Evaluate {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let sweep = self.sweep()?;
        let baselines = self.baselines(&sweep)?;
        let requirements = self.requirements(&sweep)?;
        let mut record = match &self.report {
            Some(folder) => Some(Record::open(folder, &sweep.settings)?),
            None => None,
        };
        let summary = self.evaluate(&sweep, &baselines, record.as_mut());
        let summary = summary.map_err(|error| self.where_it_stands(error))?;
        check(&requirements, &summary)
    }

    /// Plays, and says what came of it.
    fn evaluate(&self, sweep: &Sweep, baselines: &[&str], record: Option<&mut Record>) -> Result<Summary> {
        let progress = Progress::new();
        let played = sweep.run(record, |done, of| progress.note(done, of));
        progress.finish();
        let evaluation = played?;
        let summary = Summary::of(&evaluation, baselines, threads(self.threads))?;
        let provenance = provenance();
        if let Some(folder) = &self.report {
            let with_page = |replay| film::evaluated(&replay).map(|page| (replay, page));
            let replays = sweep.replays(&evaluation);
            let replays = replays.and_then(|replays| replays.into_iter().map(with_page).collect());
            // What was measured stands without them.
            let replays: Vec<_> = replays.unwrap_or_else(|error| {
                tell(&format!("note: the report has no replays: {error}"));
                Vec::new()
            });
            report::write(folder, &evaluation, &summary, &replays, &provenance, self.paper)?;
        }
        if self.json {
            print(&report::results(&summary, &provenance))?;
        } else {
            print(&report::text(&summary))?;
        }
        if let Some(folder) = &self.report {
            tell(&format!("wrote {}, and the same as JSON and CSV", folder.join("report.html").display()));
        }
        Ok(summary)
    }

    /// Plays without a word, and keeps nothing of it on disk.
    ///
    /// # Errors
    /// `Usage` if the arguments make no sense; whatever a team fails with; `Interrupted` if the program was asked to stop.
    #[cfg(feature = "python")]
    pub(crate) fn quietly(arguments: Vec<String>) -> Result<(Evaluation, Summary)> {
        #[derive(clap::Parser)]
        struct Quiet {
            #[command(flatten)]
            evaluate: Evaluate,
        }
        let arguments = std::iter::once("evaluate".to_owned()).chain(arguments);
        let parsed = <Quiet as clap::Parser>::try_parse_from(arguments);
        let command = parsed.map_err(|error| usage!("{error}"))?.evaluate;
        let sweep = command.sweep()?;
        let baselines = command.baselines(&sweep)?;
        let evaluation = sweep.run(None, |_, _| ())?;
        let summary = Summary::of(&evaluation, &baselines, threads(command.threads))?;
        Ok((evaluation, summary))
    }

    /// Says what is kept of a sweep that did not come to its end.
    fn where_it_stands(&self, error: Error) -> Error {
        match (&error, &self.report) {
            (Error::Interrupted(_), Some(folder)) => error
                .and(format!("finished cells are kept in {}; the same command continues", folder.display())),
            (Error::Interrupted(_), None) => {
                error.and("with --report DIR, finished cells would be kept".to_owned())
            }
            (_, Some(folder)) => error.and(format!("finished cells are kept in {}", folder.display())),
            (_, None) => error,
        }
    }
}

/// Says what came of the requirements.
fn check(requirements: &[Requirement], summary: &Summary) -> Result<()> {
    let verdicts = requirements.iter().flat_map(|requirement| requirement.check(summary));
    let (met, unmet): (Vec<_>, Vec<_>) = verdicts.partition(Verdict::is_met);
    met.iter().for_each(|verdict| tell(&verdict.to_string()));
    let words: Vec<String> = unmet.iter().map(Verdict::to_string).collect();
    if words.is_empty() { Ok(()) } else { Err(Error::Unmet(words.join("\n       "))) }
}

/// What an evaluation is made with.
fn provenance() -> Provenance {
    let arguments = super::arguments().iter().map(|word| quoted(&word.to_string_lossy()));
    Provenance {
        program: format!("vamaro-swarm {}", env!("CARGO_PKG_VERSION")),
        command: std::iter::once("vamaro-swarm".to_owned()).chain(arguments).collect::<Vec<_>>().join(" "),
        cpu: machine::cpu(),
        date: machine::today(),
    }
}

/// A word as a shell takes it for one.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,=:+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_can_be_pasted_into_a_shell() {
        let words = ["p=0.2 score>=0.9", "runs/hs-0", "it's", ""];
        assert_eq!(words.map(quoted), ["'p=0.2 score>=0.9'", "runs/hs-0", "'it'\\''s'", "''"]);
    }
}
