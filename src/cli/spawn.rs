//! `spawn`: start a swarm, play episodes, say how the team did.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::summary::{Outcome, Summary};
use super::{PHYSICS_HELP, imputer_help, policy_source, print, print_json, probability, rate, tell};
use crate::agent::{AgentSettings, PolicySource, Registry};
use crate::base::error::{Error, Result};
use crate::base::rng::MAX_AGENTS;
use crate::base::scheduling::{Grants, Scheduling};
use crate::base::threads::cores;
use crate::bus::Wait;
use crate::environment::{PhysicsSpec, Task};
use crate::link::{self, CommunicationMatrix, LinkSpec, complement};
use crate::nn::{Policy, PolicyFile};
use crate::recording::RecordingHeader;
use crate::supervisor::{
    Audit, Conduct, InProcess, Ledger, Observer, Processes, Recorder, Session, Statistics, Team, signals,
};
use crate::{failed, usage};

/// Start a swarm, play episodes, and say how the team did
#[derive(Debug, Args)]
#[command(after_help = after_help())]
pub struct Spawn {
    /// Task: an id or alias from `vamaro-swarm tasks` [default: that of --policy or
    /// --agents, else hear-see]
    #[arg(long, value_name = "T")]
    task: Option<String>,

    /// Size of the team; alone, it picks the task of that size
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    agents: Option<usize>,

    /// Probability that an observation is delivered: --links 'level(P)' [default: 1, without --links]
    #[arg(long, value_name = "P", value_parser = probability, allow_negative_numbers = true,
        conflicts_with = "drop")]
    p: Option<f64>,

    /// Probability that an observation is lost: 1 - p
    #[arg(long, value_name = "D", value_parser = probability, allow_negative_numbers = true)]
    drop: Option<f64>,

    /// Links by their model, listed below, or a file with a communication matrix, one row per receiver; behind the
    /// links of --p or --drop, if they are given too
    #[arg(long, value_name = "LINKS|FILE")]
    links: Option<String>,

    /// Lose observations at t = 0 too; by default everything is delivered once when an episode starts
    #[arg(long)]
    no_comm_at_t0: bool,

    #[arg(long, value_name = "PHYSICS", help = PHYSICS_HELP, default_value_t)]
    physics: PhysicsSpec,

    /// Policy: a file, a folder with policy.safetensors, a pretrained one by its name in a checkout (such
    /// as hear-see/seed-1), builtin, or untrained (random weights)
    #[arg(long, value_name = "FILE|DIR|NAME", default_value = "builtin")]
    policy: String,

    #[arg(long, value_name = "NAME", help = imputer_help("dynamics if fitted to the policy, else value-aware"))]
    imputer: Option<String>,

    /// Take the most probable action instead of sampling
    #[arg(long)]
    greedy: bool,

    /// Episodes to play
    #[arg(long, value_name = "E", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..))]
    episodes: u64,

    /// Parallel worlds; one message carries the observations of all of them
    #[arg(long, value_name = "W", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4096))]
    worlds: u32,

    /// Seed of every random draw
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    seed: u64,

    /// Run the same agents without processes; same results, bit for bit
    #[arg(long)]
    in_process: bool,

    /// How processes wait: block (sleep until woken) or spin (poll; needs a core per process)
    #[arg(long, value_enum, default_value_t, conflicts_with = "in_process")]
    wait: Wait,

    /// Ticks a second: run against the clock instead of in lockstep. Agents decide at half of each period, with what
    /// has arrived: what is late is lost. Who has not decided at its end repeats its last
    /// action. Not with --in-process or --record
    #[arg(long, value_name = "HZ", value_parser = rate, allow_negative_numbers = true,
        conflicts_with_all = ["in_process", "record"], help_heading = REAL_TIME)]
    rate: Option<f64>,

    /// Run each process on one core, by turns where there are fewer cores than processes
    #[arg(long, conflicts_with = "in_process", help_heading = REAL_TIME)]
    pin: bool,

    /// Keep all memory of all processes in RAM (mlockall)
    #[arg(long, conflicts_with = "in_process", help_heading = REAL_TIME)]
    lock_memory: bool,

    /// Run before all processes of the usual scheduling policy (SCHED_FIFO), with a priority of 1 to 99 [10 if
    /// none is given]; not with --wait spin
    #[arg(long, value_name = "PRIORITY", num_args = 0..=1, default_missing_value = "10",
        value_parser = clap::value_parser!(u8).range(1..=99), allow_negative_numbers = true,
        conflicts_with = "in_process", help_heading = REAL_TIME)]
    fifo: Option<u8>,

    /// Count each part of each policy input as own, received or imputed, and compare it with what was
    /// sent
    #[arg(long)]
    audit: bool,

    /// Write a trace of all episodes, which `vamaro-swarm verify` can check
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Print the summary as one JSON object
    #[arg(long)]
    json: bool,
}

const REAL_TIME: &str = "Real time (what the kernel refuses is said, and done without)";

const EXAMPLES: &str = "\
Examples:
  vamaro-swarm spawn --agents 4 --p 0.2
  vamaro-swarm spawn --task hear-see --drop 0.8 --imputer hold --episodes 1000 --worlds 10
  vamaro-swarm spawn --task spread-blindfold-6 --policy untrained --links dynamic --audit
  vamaro-swarm spawn --agents 4 --links 'gilbert(0.1, 0.3) + delay(1, 1)'
  vamaro-swarm spawn --agents 4 --p 0 --physics motor_noise=0.3,damping=0.3,mass=1.2
  vamaro-swarm spawn --agents 4 --p 0.2 --rate 100     in real time, 100 Hz
  vamaro-swarm spawn --task SXY-4 --p 0.6 --record trace.json && vamaro-swarm verify trace.json";

fn after_help() -> String {
    format!("{}\n\n{EXAMPLES}", link::help())
}

impl Spawn {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let source = policy_source(&self.policy, self.seed)?;
        let task = self.find_task(&source)?.with_physics(self.physics)?;
        let scheduling = self.scheduling()?;
        let links = self.find_links(&task)?;
        let policy = source.load(task.spec())?;
        let settings = self.settings(&task, &links, source, &policy)?;
        let recorder = match &self.record {
            Some(path) => Some(self.start_recording(path, &links, &settings, &policy)?),
            None => None,
        };
        let mut summary = Summary {
            task: &task,
            links: &links,
            comm_at_t0: !self.no_comm_at_t0,
            settings: &settings,
            policy: policy.meta(),
            wait: (!self.in_process).then_some(self.wait),
            rate: self.rate,
            scheduling: None,
            episodes: self.episodes,
        };
        let mut punctuality = None;
        let (statistics, audit) = if self.in_process {
            self.play(&mut InProcess::new(&settings, &policy)?, &summary, recorder)?
        } else {
            let conduct = Conduct { wait: self.wait, rate: self.rate, scheduling, ..Conduct::default() };
            let mut team = Processes::start(&settings, &policy, conduct)?;
            summary.scheduling = team.grants().cloned();
            if self.wait == Wait::Spin && task.spec().n_agents() >= cores() {
                tell(&format!(
                    "note: {} processes spin on {} cores and take turns; --wait block may be faster",
                    task.spec().n_agents() + 1,
                    cores()
                ));
            }
            if let Some(refused) = team.grants().and_then(Grants::refused) {
                tell(&format!("note: {refused}"));
            }
            let played = self.play(&mut team, &summary, recorder)?;
            punctuality = team.punctuality().cloned();
            played
        };
        let outcome =
            Outcome { statistics: &statistics, audit: audit.as_ref(), punctuality: punctuality.as_ref() };
        if self.json {
            print_json(&summary.json(&outcome))?;
        } else {
            print(&summary.text(&outcome))?;
        }
        let played = statistics.episodes().len() as u64;
        match audit {
            Some(audit) if !audit.holds() => Err(failed!("the audit found what must not be: {audit}")),
            _ if played < self.episodes => {
                Err(Error::Interrupted(format!("interrupted after {played} of {} episodes", self.episodes)))
            }
            _ => Ok(()),
        }
    }

    /// Plays all episodes, or those before an interruption.
    fn play(
        &self,
        team: &mut impl Team,
        summary: &Summary,
        mut recorder: Option<Recorder>,
    ) -> Result<(Statistics, Option<Audit>)> {
        if !self.json {
            print(&summary.first_line())?;
        }
        let links = summary.links.build().sharing_at_start(summary.comm_at_t0);
        let mut session = Session::new(summary.task.environment(summary.settings.worlds), links, self.seed);
        let bar = progress_bar(self.episodes);
        let mut ledger = Ledger::telling(|statistics| {
            if !bar.is_hidden() {
                bar.set_message(progress_words(statistics));
            }
            bar.set_position(statistics.episodes().len() as u64);
        });
        let mut audit = self.audit.then(Audit::default);
        let mut observers: Vec<&mut dyn Observer> = vec![&mut ledger];
        observers.extend(audit.as_mut().map(|audit| audit as &mut dyn Observer));
        observers.extend(recorder.as_mut().map(|recorder| recorder as &mut dyn Observer));
        let played = session.play(team, self.episodes, &mut observers);
        let statistics = ledger.into_statistics();
        bar.finish_and_clear();
        match played {
            Ok(()) => recorder.map_or(Ok(()), Recorder::finish)?,
            // What is finished is worth reporting; half a recording is worth nothing.
            Err(Error::Interrupted(_)) if !statistics.episodes().is_empty() => {}
            Err(e) => return Err(e),
        }
        Ok((statistics, audit))
    }

    fn find_task(&self, policy: &PolicySource) -> Result<Task> {
        let (name, agents) = match (&self.task, self.agents) {
            (None, None) => {
                return match policy {
                    PolicySource::File(path) => Task::parse(&PolicyFile::read(path)?.meta.task),
                    _ => Task::parse("hear-see"),
                };
            }
            (None, Some(agents)) => return Task::by_team_size(agents),
            (Some(name), None) => return Task::parse(name),
            (Some(name), Some(agents)) => (name, agents),
        };
        // `--task spread-xy --agents 6` names a task as well as `spread-xy-6` does.
        let of_that_size =
            |name: &str| Task::parse(name).ok().filter(|task| task.spec().n_agents() == agents);
        if let Some(task) = of_that_size(name).or_else(|| of_that_size(&format!("{name}-{agents}"))) {
            return Ok(task);
        }
        let task = Task::parse(name)?;
        let others =
            ["spread-blindfold", "spread-xy"].map(|family| of_that_size(&format!("{family}-{agents}")));
        let others: Vec<String> = others.iter().flatten().map(|task| task.id().to_owned()).collect();
        Err(if others.is_empty() {
            usage!("a team has 1 to {MAX_AGENTS} agents, not {agents}")
        } else {
            usage!(
                "{} is for {} agents, not {agents}; leave one of --task and --agents away, or take a task of that \
             size: {}",
                task.id(),
                task.spec().n_agents(),
                others.join(", ")
            )
        })
    }

    fn find_links(&self, task: &Task) -> Result<LinkSpec> {
        let (level, agents) = (self.p.or(self.drop.map(complement)), task.spec().n_agents());
        let links = self.links.as_deref().map(|text| LinkSpec::parse(text, agents)).transpose()?;
        match (level.map(LinkSpec::level).transpose()?, links) {
            (Some(level), Some(links)) => level.then(links),
            (level, links) => level.or(links).map_or_else(|| LinkSpec::level(1.0), Ok),
        }
    }

    fn scheduling(&self) -> Result<Scheduling> {
        if self.fifo.is_some() && self.wait == Wait::Spin {
            return Err(usage!(
                "--fifo with --wait spin: processes that never sleep and go before all others leave no core to the rest \
                 of the machine; use --wait block"
            ));
        }
        Ok(Scheduling { pin: self.pin, lock_memory: self.lock_memory, fifo: self.fifo })
    }

    fn settings(
        &self,
        task: &Task,
        links: &LinkSpec,
        policy: PolicySource,
        loaded: &Policy,
    ) -> Result<AgentSettings> {
        let registry = Registry::default();
        Ok(AgentSettings {
            spec: task.spec().clone(),
            policy,
            imputer: registry.choose(self.imputer.as_deref(), loaded)?,
            registry,
            greedy: self.greedy,
            seed: self.seed,
            // More worlds than episodes would have nothing to do.
            worlds: u64::from(self.worlds).min(self.episodes) as usize,
            longest_delay: links.longest_delay(),
            tell_logits: self.record.is_some(),
        })
    }

    fn start_recording(
        &self,
        path: &Path,
        links: &LinkSpec,
        settings: &AgentSettings,
        policy: &Policy,
    ) -> Result<Recorder> {
        let spec = &settings.spec;
        let header = RecordingHeader {
            task: spec.id.clone(),
            n_agents: spec.n_agents(),
            n_landmarks: spec.landmarks,
            episode_steps: spec.episode_steps,
            actor: Some(policy.networks().actor.to_string()),
            imputer: Some(settings.imputer.clone()),
            policy: Some(settings.policy.to_string()),
            seed: Some(self.seed),
            greedy: Some(self.greedy),
            links: Some(links.recorded_name()),
            matrix: links.matrix().map(CommunicationMatrix::to_rows),
            physics: self.physics,
            comm_at_t0: Some(!self.no_comm_at_t0),
            version: Some(env!("CARGO_PKG_VERSION").to_owned()),
        };
        Recorder::create(path, &header)
    }
}

/// A bar on a terminal, nothing elsewhere.
fn progress_bar(episodes: u64) -> ProgressBar {
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:20} {pos}/{len} episodes{msg}, {eta} left");
    ProgressBar::new(episodes).with_style(style.expect("the template is valid"))
}

fn progress_words(statistics: &Statistics) -> String {
    let delivered = statistics.delivery_rate().map(|rate| format!(", {:.1} % delivered", 100.0 * rate));
    format!(", return {:.1}{}", statistics.return_mean(), delivered.unwrap_or_default())
}
