//! `evaluate`: how robust frozen policies are to links that fail.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::machine;
use super::progress::Progress;
use super::train::threads;
use super::{PHYSICS_HELP, imputer_help, policy_source, print, tell};
use crate::agent::{PolicySource, Registry, Truth};
use crate::base::error::{Error, Result};
use crate::bus::Wait;
use crate::environment::{PhysicsSpec, Task};
#[cfg(feature = "python")]
use crate::evaluate::Evaluation;
use crate::evaluate::report::{self, Provenance};
use crate::evaluate::{
    Axis, Condition, Entrant, Place, Record, Requirement, Settings, Summary, Sweep, Verdict,
};
use crate::link::{self, Site};
use crate::nn::{Policy, PolicyFile};
use crate::supervisor::signals;
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

    /// Probabilities of delivery, p; '' for none, where other conditions are given
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

    /// Links, listed below, as an additional condition; may be given several times. One parameter may be a list of
    /// values, such as 'gilbert(loss=0.8, burst=[5,10,20])': each value is a condition, and the report compares them
    #[arg(long, value_name = "LINKS|FILE")]
    links: Vec<String>,

    /// Kill and stop agents on purpose, as `spawn --chaos` does, as an additional condition. Everything is delivered
    /// unless links follow after ` at `, such as 'kill=0.01 at p=0.2'; may be given several times
    #[arg(long, value_name = "CHAOS[ at LINKS]")]
    chaos: Vec<String>,

    #[arg(long, value_name = "LIST", value_delimiter = ',', help = imputer_help("all that each policy supports, except particles and shared-dice"))]
    imputers: Vec<String>,

    /// Also play each imputer with an oracle that knows a part of the truth, to see how much of the loss is due to not
    /// knowing it: the state of the agent itself (own), of everybody else who moves (others), of those among them who are
    /// not of the team (targets), of agent K (agent:K), or what does not move (constants: landmarks, colours, messages); may
    /// be given several times
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

    /// Have messages also carry the newest that their senders hold of others, with its age; compare with the same
    /// command without --relay, which plays the same episodes with the same losses
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
    /// 'p=0.2 score>=0.9' or 'dynamic imputer=maro return>=-40'; without `imputer=` it is about the imputer that `spawn`
    /// takes by default; may be given several times
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

/// With fewer episodes a bootstrap is too sure of itself; see `docs/metrics.md`.
const FEWEST_EPISODES: u64 = 20;

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

    /// What there is to play.
    fn sweep(&self) -> Result<Sweep> {
        for (at, truth) in self.substitute.iter().enumerate() {
            if self.substitute[..at].contains(truth) {
                return Err(usage!("--substitute: {truth} is given twice"));
            }
        }
        let task = self.task.as_deref().map(Task::parse).transpose()?;
        let entrants = self.policies.iter().map(|name| self.entrant(name, task.as_ref()));
        let entrants: Vec<Entrant> = entrants.collect::<Result<_>>()?;
        for (at, entrant) in entrants.iter().enumerate() {
            let same = |other: &&Entrant| other.contender.fingerprint == entrant.contender.fingerprint;
            if let Some(other) = entrants[..at].iter().find(same) {
                return Err(usage!(
                    "{} and {} are the same policy; name it once",
                    other.contender.name,
                    entrant.contender.name
                ));
            }
        }
        let (conditions, axes) = self.conditions(&entrants)?;
        if let Some(truth) = self.substitute.first()
            && !conditions.iter().any(Condition::is_lossless)
        {
            return Err(usage!("--substitute {truth}: a loss is measured against p = 1; add 1 to --levels"));
        }
        let episodes = match self.protocol {
            Some(Protocol::Paper) => 100,
            None => self.episodes.unwrap_or(1000),
        };
        Ok(Sweep {
            settings: Settings {
                episodes,
                seed: self.seed,
                greedy: self.greedy || entrants.iter().all(|entrant| entrant.policy.is_greedy()),
                comm_at_t0: !self.no_comm_at_t0,
                physics: self.physics,
                relay: self.relay,
            },
            conditions,
            axes,
            entrants,
            worlds: self.worlds as usize,
            place: if self.in_process {
                Place::InProcess(threads(self.threads))
            } else {
                Place::Processes(self.wait)
            },
        })
    }

    /// Levels, modes, links and chaos, in this order; and the axes on which links are.
    fn conditions(&self, entrants: &[Entrant]) -> Result<(Vec<Condition>, Vec<Axis>)> {
        let level = |text: &String| {
            let p = text.trim().trim_start_matches("p=").parse().ok();
            let level = p.and_then(|p| Condition::level(p).ok());
            level.ok_or_else(|| usage!("--levels: {text:?} is not a probability between 0 and 1"))
        };
        let mode = |text: &String| match text.trim() {
            mode @ ("uniform" | "asymmetric" | "dynamic") => Condition::parse(mode, 1),
            _ => Err(usage!("--modes: {text:?} is not one of uniform, asymmetric and dynamic")),
        };
        let (mut axes, mut links) = (Vec::new(), Vec::new());
        for text in &self.links {
            match axis(text, entrants)? {
                Some(axis) => axes.push(axis),
                None => links.push(text),
            }
        }
        // A matrix is for teams of one size.
        let for_all = |text: &str, parse: fn(&str, Site) -> Result<Condition>| {
            let read = entrants.iter().map(|entrant| parse(text, entrant.task.spec().into()));
            read.reduce(|all, one| all.and(one)).expect("there are policies")
        };
        // An empty list is one empty word.
        let levels = if self.levels == [""] { &[] } else { &self.levels[..] };
        let all = levels.iter().map(|text| ("--levels", level(text)));
        let all = all.chain(self.modes.iter().map(|text| ("--modes", mode(text))));
        let all = all.chain(links.into_iter().map(|text| ("--links", for_all(text, Condition::parse))));
        let all = all.chain(self.chaos.iter().map(|text| ("--chaos", for_all(text, Condition::parse_chaos))));
        let mut conditions: Vec<Condition> = Vec::new();
        for (option, condition) in all {
            let condition = condition?;
            if conditions.contains(&condition) {
                return Err(usage!("{option}: {condition} is given twice"));
            }
            conditions.push(condition);
        }
        for point in axes.iter().flat_map(|axis| &axis.points) {
            // A level may be on an axis, too.
            if !conditions.contains(&point.condition) {
                conditions.push(point.condition.clone());
            }
        }
        if conditions.is_empty() {
            return Err(usage!("there is nothing to play: give --levels, --modes, --links or --chaos"));
        }
        Ok((conditions, axes))
    }

    fn entrant(&self, name: &str, task: Option<&Task>) -> Result<Entrant> {
        let source = policy_source(name, self.seed)?;
        let task = match (&source, task) {
            (PolicySource::File(path), expected) => {
                let of_file = Task::parse(&PolicyFile::read(path)?.meta.task)?;
                match expected {
                    Some(task) if task.id() != of_file.id() => {
                        return Err(usage!("{name} is a policy for {}, not for {}", of_file.id(), task.id()));
                    }
                    _ => of_file,
                }
            }
            (_, Some(task)) => task.clone(),
            (_, None) => return Err(usage!("{name}: for which task? Name it with --task")),
        };
        let played = task.clone().with_physics(self.physics)?;
        let names = self.imputers.iter().map(|name| name.trim());
        let policy = Registry::default().told(source.load(task.spec())?, &played, names)?;
        let imputers = self.imputers_of(&policy, &task).map_err(|error| usage!("{name}: {error}"))?;
        Ok(Entrant::new(name, source, policy, task, imputers))
    }

    /// Each imputer, and behind it the oracles that take it for what they do not know.
    fn imputers_of(&self, policy: &Policy, task: &Task) -> Result<Vec<String>> {
        let plain = self.plain_imputers_of(policy)?;
        self.substitute.iter().try_for_each(|truth| truth.check(task.spec()))?;
        let with_oracles = plain.into_iter().flat_map(|imputer| {
            let oracles: Vec<String> = self.substitute.iter().map(|truth| truth.oracle(&imputer)).collect();
            std::iter::once(imputer).chain(oracles)
        });
        Ok(with_oracles.collect())
    }

    fn plain_imputers_of(&self, policy: &Policy) -> Result<Vec<String>> {
        let registry = Registry::default();
        if self.imputers.is_empty() {
            return Ok(registry.names(policy).map(str::to_owned).collect());
        }
        let mut imputers = Vec::new();
        for name in &self.imputers {
            let imputer = registry.choose(Some(name.trim()), policy)?;
            if imputers.contains(&imputer) {
                return Err(usage!("--imputers: {name} is given twice"));
            }
            imputers.push(imputer);
        }
        Ok(imputers)
    }

    /// The imputers that others are compared with: each group with the first that it is played with.
    fn baselines(&self, sweep: &Sweep) -> Result<Vec<&str>> {
        let Some(name) = self.baseline.as_deref() else { return Ok(vec!["maro", "hold"]) };
        let played = |entrant: &Entrant| entrant.plays(name);
        if sweep.entrants.iter().any(played) {
            Ok(vec![name])
        } else {
            Err(usage!("--baseline {name}: no policy is played with this imputer; add it to --imputers"))
        }
    }

    /// The requirements, each with its imputer. An error for one that nothing of what is played can meet.
    fn requirements(&self, sweep: &Sweep) -> Result<Vec<Requirement>> {
        let site = Site::from(sweep.entrants[0].task.spec());
        let with_imputer = |text: &String| {
            let requirement = Requirement::parse(text, site).map_err(|error| usage!("--require {error}"))?;
            let wrong = |why: String| usage!("--require '{requirement}': {why}");
            if !sweep.conditions.contains(&requirement.condition) {
                return Err(wrong(format!("{} is not played", requirement.condition)));
            }
            if requirement.needs_lossless() && !sweep.conditions.iter().any(Condition::is_lossless) {
                return Err(wrong("a score needs p = 1; add 1 to --levels".to_owned()));
            }
            if sweep.settings.episodes < FEWEST_EPISODES {
                let why = "intervals over so few episodes are too narrow to rely on; play at least";
                return Err(wrong(format!("{why} {FEWEST_EPISODES}")));
            }
            let by_itself = |entrant: &Entrant| Registry::default().choose(None, &entrant.policy);
            let mut names = Vec::new();
            for entrant in &sweep.entrants {
                let name = match &requirement.imputer {
                    Some(name) => name.clone(),
                    None => by_itself(entrant)?,
                };
                if !entrant.plays(&name) {
                    let policy = &entrant.contender.name;
                    let default = match requirement.imputer {
                        Some(_) => ";",
                        None => ", its default imputer; name another, as in 'p=0.2 imputer=hold ..', or",
                    };
                    return Err(wrong(format!(
                        "{policy} is not played with {name}{default} add it to --imputers"
                    )));
                }
                names.push(name);
            }
            if names.iter().any(|name| *name != names[0]) {
                let why =
                    "the default imputers of these policies differ; name one, as in 'p=0.2 imputer=hold ..'";
                return Err(wrong(why.to_owned()));
            }
            Ok(Requirement { imputer: names.into_iter().next(), ..requirement })
        };
        self.require.iter().map(with_imputer).collect()
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

/// The axis that a text says for all teams; `None` for links without a list of values.
fn axis(text: &str, entrants: &[Entrant]) -> Result<Option<Axis>> {
    let mut axis = None;
    for entrant in entrants {
        let Some(own) = Axis::parse(text, entrant.task.spec())? else { return Ok(None) };
        axis = Some(match axis {
            Some(axis) => own.and(axis)?,
            None => own,
        });
    }
    Ok(axis)
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
