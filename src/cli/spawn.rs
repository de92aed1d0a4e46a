//! `spawn`: start a swarm, play episodes, say how the team did.

mod choices;

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
#[cfg(feature = "view")]
use indicatif::ProgressDrawTarget;
use indicatif::{ProgressBar, ProgressStyle};

use super::requirement::{self, Requirement};
use super::summary::{Outcome, Summary};
use super::{PHYSICS_HELP, imputer_help, print, print_json, probability, rate, tell};
use crate::agent::AgentSettings;
use crate::base::error::{Error, Result};
use crate::base::scheduling::{Grants, Scheduling};
use crate::base::threads::cores;
#[cfg(feature = "view")]
use crate::bus::SwarmDirectory;
use crate::bus::Wait;
use crate::environment::{Environment, PhysicsSpec};
use crate::failed;
#[cfg(feature = "hosts")]
use crate::hosts::{Hosts, Plan};
use crate::link;
use crate::nn::Policy;
#[cfg(feature = "view")]
use crate::supervisor::Control;
use crate::supervisor::{
    AgentCommand, Audit, ChaosSpec, Conduct, Deadlines, InProcess, Injected, Ledger, Observer, OnFailure,
    Processes, Recorder, Session, Statistics, Steered, Team, parse_duration, signals,
};
#[cfg(feature = "view")]
use crate::view::{Camera, Facts, Film, Live, Window};

/// Start a swarm, play episodes, and report how the team did
#[derive(Debug, Args)]
#[command(after_help = after_help())]
pub struct Spawn {
    /// Task: an id or alias from `vamaro-swarm tasks` [default: that of --policy or
    /// --agents, else hear-see]
    #[arg(long, value_name = "T")]
    task: Option<String>,

    /// Play in an environment that this command hosts in a process of its own, such as
    /// 'python3 -m vamaro_swarm.serve mpe2.simple_spread_v3' for one of PettingZoo's (docs/python.md)
    #[arg(long = "env", value_name = "COMMAND", value_parser = command_line,
        conflicts_with_all = ["task", "agents", "physics", "record"])]
    environment: Option<AgentCommand>,

    /// Size of the team; alone, it picks the task of that size
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    agents: Option<usize>,

    /// Probability that an observation is delivered, the same as --links 'level(P)' [default: 1, without --links]
    #[arg(long, value_name = "P", value_parser = probability, allow_negative_numbers = true,
        conflicts_with = "drop")]
    p: Option<f64>,

    /// Probability that an observation is lost: 1 - p
    #[arg(long, value_name = "D", value_parser = probability, allow_negative_numbers = true)]
    drop: Option<f64>,

    /// Link models, listed below, or a file with a communication matrix, one row per receiver. --p or --drop puts a
    /// `level` in front of them. With --hosts and --rate also `network`: nothing is emulated, and what the network
    /// between the hosts loses or delays is lost
    #[arg(long, value_name = "LINKS|FILE")]
    links: Option<String>,

    /// Agents pass on the newest observation that they hold of each other agent, with its age: what one link loses may
    /// arrive through another agent, a tick later for each hop
    #[arg(long)]
    relay: bool,

    /// Lose observations at t = 0 too; by default everything is delivered when an episode starts
    #[arg(long)]
    no_comm_at_t0: bool,

    #[arg(long, value_name = "PHYSICS", help = PHYSICS_HELP, default_value_t)]
    physics: PhysicsSpec,

    /// Policy: a file, a folder with policy.safetensors, in a checkout the name of a pretrained one (such as
    /// hear-see/seed-1), builtin, or untrained (random weights)
    #[arg(long, value_name = "FILE|DIR|NAME", default_value = "builtin")]
    policy: String,

    #[arg(long, value_name = "NAME", help = imputer_help("dynamics if fitted to the policy, else its best predictor: one that sees \
          its agent's own action, or value-aware"))]
    imputer: Option<String>,

    /// Start this command in place of agent I, such as '2=python3 agents/python/hold.py'; may be repeated. The program may
    /// be in any language: docs/protocol.md says what it must do. Quotes work as in a shell, variables do not
    #[arg(long = "agent", value_name = "I=COMMAND", value_parser = other_agent, conflicts_with = "in_process")]
    other_agents: Vec<(usize, AgentCommand)>,

    /// Run agents on other machines: this file says on which, and which agents where. Each of them runs
    /// `vamaro-swarm host`; docs/hosts.md says more. The default of --deadline then allows for a silent host, too
    #[cfg(feature = "hosts")]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["in_process", "other_agents"])]
    hosts: Option<PathBuf>,

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

    /// Run the same agents in this process; the results are bit-identical
    #[arg(long)]
    in_process: bool,

    /// How processes wait: block (sleep until woken) or spin (poll; needs a core per process)
    #[arg(long, value_enum, default_value_t, conflicts_with = "in_process")]
    wait: Wait,

    /// Ticks per second: run in real time instead of in lockstep. Agents decide halfway through each period, on what
    /// has arrived; later observations are lost. An agent that has not decided when the period ends repeats its last
    /// action. Not with --in-process
    #[arg(long, value_name = "HZ", value_parser = rate, allow_negative_numbers = true,
        conflicts_with = "in_process", help_heading = REAL_TIME)]
    rate: Option<f64>,

    /// Pin each process to one core, in turn if there are fewer cores than processes
    #[arg(long, conflicts_with = "in_process", help_heading = REAL_TIME)]
    pin: bool,

    /// Keep all memory of all processes in RAM (mlockall)
    #[arg(long, conflicts_with = "in_process", help_heading = REAL_TIME)]
    lock_memory: bool,

    /// Run with real-time scheduling (SCHED_FIFO), ahead of all ordinary processes, at a priority of 1 to 99 [10 if
    /// none is given]; not with --wait spin
    #[arg(long, value_name = "PRIORITY", num_args = 0..=1, default_missing_value = "10",
        value_parser = clap::value_parser!(u8).range(1..=99), allow_negative_numbers = true,
        conflicts_with = "in_process", help_heading = REAL_TIME)]
    fifo: Option<u8>,

    /// What to do when an agent dies or hangs: abort the run, continue without the agent, or restart it. While it is
    /// absent its peers impute what it would have sent, and it does nothing, or with --rate repeats its last action
    /// [default: restart; with --audit or --record: abort]
    #[arg(long, value_enum, value_name = "WHAT", conflicts_with = "in_process", help_heading = FAULTS)]
    on_failure: Option<OnFailure>,

    /// How long an agent may take for a tick before it counts as hung and is killed; its observation must be published
    /// within four fifths of that. With --rate: how long it may miss ticks [default: 1s, and 1ms for each agent in each
    /// world]. With --env: also how long the environment may take for a step [default: 10s]. Not with --in-process alone
    #[arg(long, value_name = "TIME", value_parser = duration, help_heading = FAULTS)]
    deadline: Option<Duration>,

    /// Kill and stop agents on purpose, each with a probability per tick and for a time, such as
    /// 'kill=0.01:500ms, stop=0.005:200ms'. A killed agent returns without its memory, a stopped one continues. In
    /// lockstep the time is rounded to ticks and ends with the episode, and the same seed gives the same run. Needs --worlds 1
    #[arg(long, value_name = "CHAOS", help_heading = FAULTS)]
    chaos: Option<ChaosSpec>,

    /// Exit with code 3 unless the run meets this bound on return, delivered, late, missed, absent, deaths, hangs or
    /// rate, such as 'missed<=0.001' or 'rate>=99'; may be repeated
    #[arg(long, value_name = "REQUIREMENT", help_heading = FAULTS)]
    require: Vec<Requirement>,

    /// Show the swarm in the terminal as it plays: 10 ticks per second in the built-in tasks, or --rate. The last line
    /// lists the keys (pause, step, speed, p, kill, ..); docs/viewing.md explains the rest
    #[cfg(feature = "view")]
    #[arg(long)]
    view: bool,

    /// Count each part of each policy input as own, received or imputed, and compare it with what was
    /// sent
    #[arg(long)]
    audit: bool,

    /// Write a trace of all episodes, for `vamaro-swarm replay` and `verify`: JSON if the name ends in .json, MCAP for
    /// Foxglove and others if it ends in .mcap, else a compact file, for long runs
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Print the summary as one JSON object
    #[arg(long)]
    json: bool,
}

const REAL_TIME: &str = "Real time (the summary says what the kernel refused; the run continues)";

const FAULTS: &str = "Faults";

const EXAMPLES: &str = "\
Examples:
  vamaro-swarm spawn --agents 4 --p 0.2
  vamaro-swarm spawn --task hear-see --drop 0.8 --imputer hold --worlds 10
  vamaro-swarm spawn --agents 4 --links 'gilbert(0.1, 0.3) + delay(1, 1)'
  # messages also carry what their senders have received
  vamaro-swarm spawn --agents 4 --p 0.2 --relay
  vamaro-swarm spawn --agents 4 --p 0 --physics motor_noise=0.3,mass=1.2
  # where did each input of the policies come from?
  vamaro-swarm spawn --agents 6 --links dynamic --audit
  # agent 2 is your own program
  vamaro-swarm spawn --agents 4 --imputer hold \\
    --agent '2=python3 agents/python/hold.py'
  # a PettingZoo environment, and agents by policies of your own
  vamaro-swarm spawn --p 0.5 \\
    --env 'python3 -m vamaro_swarm.serve mpe2.simple_reference_v3' \\
    --agent '0=python3 agents/python/hold.py my_team:policy' \\
    --agent '1=python3 agents/python/hold.py my_team:policy'
  # in real time, 100 Hz
  vamaro-swarm spawn --agents 4 --p 0.2 --rate 100
  # agents are killed; exit code 3 if the team falls short
  vamaro-swarm spawn --agents 4 --chaos kill=0.01 --require 'return>=-900'
  vamaro-swarm spawn --agents 4 --p 0.6 --record trace.json
  vamaro-swarm verify trace.json";

fn after_help() -> String {
    format!("{}\n\n{EXAMPLES}", link::help())
}

impl Spawn {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        self.check()?;
        let scheduling = self.scheduling()?;
        let scene = self.find_scene()?;
        let source = self.find_policy(&scene.spec)?;
        let links = self.find_links(&scene)?;
        let policy = self.load(&source, &scene)?;
        let settings = self.settings(&scene, &links, source, &policy)?;
        #[cfg_attr(not(feature = "view"), expect(unused_mut))]
        let mut onlookers = Onlookers {
            #[cfg(feature = "view")]
            live: self.view.then(|| Live::prepare("leave out --view")).transpose()?,
            #[cfg(feature = "view")]
            films: Vec::new(),
            #[cfg(feature = "view")]
            window: if self.in_process { None } else { Window::prepare().ok() },
            recorder: match &self.record {
                Some(path) => Some(self.start_recording(path, &links, &settings, &policy)?),
                None => None,
            },
        };
        let mut summary = Summary {
            physics: &self.physics,
            links: &links,
            comm_at_t0: !self.no_comm_at_t0,
            settings: &settings,
            policy: policy.meta(),
            wait: (!self.in_process).then_some(self.wait),
            rate: self.rate,
            scheduling: None,
            others: &self.other_agents,
            environment: self.environment.as_ref(),
            chaos: self.chaos,
            episodes: self.episodes,
        };
        let (mut punctuality, mut faults, mut hosts) = (None, None, Vec::new());
        let played = if self.in_process {
            self.play(&mut InProcess::new(&settings, &policy)?, scene.environment, &summary, onlookers)?
        } else {
            let mut team = self.start(&settings, &policy, scheduling)?;
            summary.scheduling = team.grants().cloned();
            if self.wait == Wait::Spin && scene.spec.n_agents() >= cores() {
                tell(&format!(
                    "note: {} processes spin on {} cores and take turns; --wait block may be faster",
                    scene.spec.n_agents() + 1,
                    cores()
                ));
            }
            if let Some(refused) = team.grants().and_then(Grants::refused) {
                tell(&format!("note: {refused}"));
            }
            #[cfg(feature = "view")]
            onlookers.open_window(team.directory(), &self.facts(&summary));
            let played = self.play(&mut team, scene.environment, &summary, onlookers)?;
            (punctuality, faults) = (team.punctuality().cloned(), Some(team.faults().clone()));
            hosts = team.hosts();
            played
        };
        let outcome = Outcome {
            statistics: &played.statistics,
            audit: played.audit.as_ref(),
            punctuality: punctuality.as_ref(),
            faults: faults.as_ref(),
            hosts: &hosts,
            injected: played.injected,
            steered: played.steered.as_ref(),
        };
        if self.json {
            print_json(&summary.json(&outcome))?;
        } else {
            print(&summary.text(&outcome))?;
        }
        match played.audit {
            Some(audit) if !audit.holds() => Err(failed!("the audit failed: {audit}")),
            _ => played.ended.and_then(|()| requirement::check(&self.require, &outcome)),
        }
    }

    /// Starts the processes, here or where --hosts says.
    fn start(&self, settings: &AgentSettings, policy: &Policy, scheduling: Scheduling) -> Result<Processes> {
        #[cfg(feature = "hosts")]
        if let Some(path) = &self.hosts {
            let plan = Plan::read(path)?;
            // That a host is gone shall be noticed before its agents count as hung.
            let conduct = self.conduct(settings, scheduling, plan.patience.silence())?;
            let hosts = Hosts::connect(&plan, settings.spec.n_agents(), self.network_is_link())?;
            return Processes::start_also(Box::new(hosts), settings, policy, conduct);
        }
        Processes::start(settings, policy, self.conduct(settings, scheduling, Duration::ZERO)?)
    }

    /// How it runs if somebody may be silent for so long before it is gone.
    fn conduct(
        &self,
        settings: &AgentSettings,
        scheduling: Scheduling,
        silence: Duration,
    ) -> Result<Conduct> {
        // Where every tick is looked at, none may be without an agent unnoticed.
        let exact = self.audit || self.record.is_some();
        let usual = if exact { OnFailure::Abort } else { OnFailure::Restart };
        let on_failure = self.on_failure.unwrap_or(usual);
        // Ten times what an agent computes in a world, on one core for all of them.
        let rows = settings.spec.n_agents() * settings.worlds;
        // Of which an agent has four fifths to publish.
        let answer = self.deadline.unwrap_or(Duration::from_millis(1000 + rows as u64) + silence * 5 / 4);
        let deadlines = Deadlines::default();
        Ok(Conduct {
            wait: self.wait,
            rate: self.rate,
            scheduling,
            on_failure,
            deadlines: Deadlines { answer, ready: deadlines.ready + silence, ..deadlines },
            command: None,
            others: self.other_agents.clone(),
        })
    }

    /// Plays all episodes, or those before an interruption or a failure.
    fn play(
        &self,
        team: &mut impl Team,
        environment: Box<dyn Environment>,
        summary: &Summary,
        mut onlookers: Onlookers,
    ) -> Result<Played> {
        if !self.json {
            print(&summary.first_lines())?;
        }
        let links = summary.links.build().sharing_at_start(summary.comm_at_t0);
        let mut session = Session::new(environment, links, self.seed).relaying(self.relay);
        if let Some(chaos) = self.chaos {
            session =
                session.with_chaos(chaos, Duration::from_secs_f64(self.tick(&summary.settings.spec)))?;
        }
        let bar = progress_bar(self.episodes);
        #[cfg(feature = "view")]
        if let Some(live) = &mut onlookers.live {
            bar.set_draw_target(ProgressDrawTarget::hidden());
            let (commands, control) = Control::new();
            onlookers.films.push(live.begin(self.facts(summary), commands)?);
            session = session.steered_by(control);
        }
        let mut ledger = Ledger::telling(|statistics| {
            if !bar.is_hidden() {
                bar.set_message(progress_words(statistics));
            }
            bar.set_position(statistics.finished());
        });
        let mut audit = self.audit.then(Audit::default);
        let ended = {
            #[cfg(feature = "view")]
            let mut camera;
            #[cfg(feature = "view")]
            let mut observers: Vec<&mut dyn Observer> = match onlookers.films {
                films if films.is_empty() => vec![&mut ledger],
                films => {
                    camera = Camera::new(&summary.settings.spec, &mut ledger, films);
                    vec![&mut camera]
                }
            };
            #[cfg(not(feature = "view"))]
            let mut observers: Vec<&mut dyn Observer> = vec![&mut ledger];
            observers.extend(audit.as_mut().map(|audit| audit as &mut dyn Observer));
            observers.extend(onlookers.recorder.as_mut().map(|recorder| recorder as &mut dyn Observer));
            session.play(team, self.episodes, &mut observers)
        };
        let statistics = ledger.into_statistics();
        bar.finish_and_clear();
        // The terminal is given back, and guests leave.
        #[cfg(feature = "view")]
        drop((onlookers.live, onlookers.window));
        let played = statistics.finished();
        let steered = session.steered().cloned();
        let ended = match ended {
            Ok(()) if played == 0 => {
                return Err(Error::Interrupted("ended before any episode had finished".to_owned()));
            }
            Ok(()) => onlookers.recorder.map_or(Ok(()), Recorder::finish),
            // What is finished is worth reporting; half a recording is worth nothing.
            Err(e) if played == 0 => return Err(e),
            Err(Error::Interrupted(_)) => {
                Err(Error::Interrupted(format!("interrupted after {played} of {} episodes", self.episodes)))
            }
            Err(e) => Err(e.and(format!("{played} of {} episodes were finished", self.episodes))),
        };
        Ok(Played { statistics, audit, injected: session.injected(), steered, ended })
    }

    /// What the view shows of the run as a whole.
    #[cfg(feature = "view")]
    fn facts(&self, summary: &Summary) -> Facts {
        let settings = summary.settings;
        let facts = Facts::of(&settings.spec);
        Facts {
            episodes: self.episodes,
            worlds: settings.worlds,
            imputer: settings.imputer.clone(),
            links: summary.links.p().map_or(summary.links.to_string(), |_| String::new()),
            pace: facts.pace.filter(|_| self.rate.is_none()),
            level: summary.links.build().dial().copied(),
            recorded: self.record.is_some(),
            ..facts
        }
    }
}

/// What came of the episodes.
struct Played {
    /// Of those that were finished.
    statistics: Statistics,
    audit: Option<Audit>,
    injected: Option<Injected>,
    /// What was changed by hand, if somebody could.
    steered: Option<Steered>,
    /// Why some were not, if so.
    ended: Result<()>,
}

/// Who looks on, apart from those who count.
struct Onlookers {
    #[cfg(feature = "view")]
    live: Option<Live>,
    /// What there is to take pictures on. A window closes when nobody can take any more, so these go first.
    #[cfg(feature = "view")]
    films: Vec<Film>,
    /// Through which guests look.
    #[cfg(feature = "view")]
    window: Option<Window>,
    recorder: Option<Recorder>,
}

#[cfg(feature = "view")]
impl Onlookers {
    /// Lets guests look on, if that can be.
    fn open_window(&mut self, swarm: &SwarmDirectory, facts: &Facts) {
        match self.window.as_mut().map(|window| window.open(swarm, facts)) {
            Some(Ok(film)) => self.films.push(film),
            Some(Err(e)) => tell(&format!("note: nobody can watch this swarm with `top`: {e}")),
            None => {}
        }
    }
}

/// Reads a time such as `1s` or `500ms`.
fn duration(text: &str) -> std::result::Result<Duration, String> {
    parse_duration(text)
        .filter(|time| !time.is_zero())
        .ok_or_else(|| "expected a time, such as 1s or 500ms".to_owned())
}

/// Reads which agent is to be started by what command, such as `2=python3 agent.py`.
fn other_agent(text: &str) -> std::result::Result<(usize, AgentCommand), String> {
    let (agent, command) =
        text.split_once('=').ok_or("expected an agent and a command, such as '2=python3 agent.py'")?;
    let agent =
        agent.trim().parse().map_err(|_| format!("`{agent}` is not an agent: agents are counted from 0"))?;
    Ok((agent, command_line(command)?))
}

/// Reads a command, such as `python3 agent.py`.
fn command_line(text: &str) -> std::result::Result<AgentCommand, String> {
    AgentCommand::parse(text).map_err(|e| e.to_string())
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
