//! `train`: teach a team, alone or seed by seed.

mod summary;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use rustix::process::Signal;

use super::campaign::{Campaign, Seeds, out_of_seed};
use super::reporter::Reporter;
use super::{PHYSICS_HELP, keep_candle_to_its_thread, tell};
use crate::agent::process::leave_with;
use crate::base::error::Result;
use crate::base::threads::cores;
use crate::bus::Wait;
use crate::environment::PhysicsSpec;
use crate::supervisor::{InProcess, OnFailure, Processes, signals};
use crate::train::{Algorithm, Backend, Config, Layer, Pace, Preset, Run, RunFolder};
use crate::usage;

/// Train a team with MAPPO or IPPO, and predictors alongside it
#[derive(Clone, Debug, Args)]
#[command(after_help = AFTER_HELP)]
pub struct Train {
    /// Task: an id or alias from `vamaro-swarm tasks` [default: hear-see]
    #[arg(long, value_name = "T")]
    task: Option<String>,

    /// Seed of every random draw [default: 0]
    #[arg(long, value_name = "S", conflicts_with = "seeds", allow_negative_numbers = true)]
    seed: Option<u64>,

    /// Folder of the run [default: runs/TASK-SEED]; with --seeds, -SEED is added to it
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Env steps to train for, such as 1000000, 1e6 or 1M [default: 5M]
    #[arg(long, value_name = "N", value_parser = timesteps, allow_negative_numbers = true)]
    steps: Option<u64>,

    /// Critics that see all observations (mappo), or what actors see (ippo) [default: mappo]
    #[arg(long, value_enum)]
    algorithm: Option<Algorithm>,

    /// Predictors that learn alongside the policy: value-aware, maro, lambda0, maro-carry
    /// or none [default: value-aware,maro]
    #[arg(long, value_name = "LIST")]
    predictors: Option<String>,

    /// Probability of delivery while the policy trains, or links as for `spawn --links`, such as `uniform`, which draws one
    /// probability per episode [default: 1]
    #[arg(long, value_name = "P|LINKS", allow_negative_numbers = true)]
    train_p: Option<String>,

    /// Agents pass on the newest observation that they hold of each other agent, in training and in its tests
    #[arg(long)]
    relay: bool,

    #[arg(long, value_name = "PHYSICS", help = PHYSICS_HELP)]
    physics: Option<PhysicsSpec>,

    /// Defaults for all other settings of a new run [default: paper]
    #[arg(long, value_enum)]
    preset: Option<Preset>,

    /// A TOML file with settings, as in the config.toml of a run
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// Any setting, such as learning_rate=3e-4; docs/training.md lists them, --dry-run shows them
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = key_value)]
    settings: Vec<(String, String)>,

    /// What computes gradients: native, or candle, for comparison [default: native]
    #[arg(long, value_enum)]
    backend: Option<Backend>,

    /// Continue the run in --out; --steps may ask for more
    #[arg(long)]
    resume: bool,

    /// A run for each seed: 0..3 (0, 1, 2), 0..=3 or 0,5,7
    #[arg(long, value_name = "SEEDS")]
    seeds: Option<Seeds>,

    /// With --seeds, how many runs train at the same time; they share the threads
    #[arg(long, value_name = "J", default_value_t = 1, requires = "seeds",
        value_parser = clap::value_parser!(u32).range(1..))]
    jobs: u32,

    /// Threads that learn [default: one per core]; their number does not affect the result
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    threads: Option<u32>,

    /// Collect experience without agent processes; the results are bit-identical
    #[arg(long)]
    in_process: bool,

    /// How processes wait: block (sleep until woken) or spin (poll; needs a core per process)
    #[arg(long, value_enum, default_value_t, conflicts_with = "in_process")]
    wait: Wait,

    /// What to do when an agent dies or hangs: abort, or restart the team and repeat the episodes it was playing; the result
    /// is bit-identical to an undisturbed run
    #[arg(
        long,
        value_enum,
        value_name = "WHAT",
        default_value_t,
        hide_possible_values = true,
        conflicts_with = "in_process"
    )]
    on_failure: OnFailure,

    /// The longest time between checkpoints, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = seconds,
        allow_negative_numbers = true)]
    checkpoint_every: f64,

    /// Write nothing; show all settings, and the time (measured in a few seconds), disk and memory that the run would take
    #[arg(long)]
    dry_run: bool,

    /// Print the summary as one JSON object
    #[arg(long)]
    json: bool,

    /// The campaign that this run is part of, and ends with
    #[arg(long, value_name = "PROCESS", hide = true)]
    campaign: Option<i32>,
}

const AFTER_HELP: &str = "\
Examples:
  vamaro-swarm train --task hear-see --steps 1M --out runs/hs-0
  vamaro-swarm train --resume --out runs/hs-0 --steps 5M
  vamaro-swarm train --task SXY-4 --seeds 0..3 --jobs 2 --out runs/sxy4
  vamaro-swarm train --task SXY-2 --physics motor_noise=0.1 --out runs/noisy
  vamaro-swarm train --algorithm ippo --set learning_rate=3e-4 --dry-run
  vamaro-swarm spawn --task hear-see --policy runs/hs-0 --p 0.2

A run may be interrupted or killed: with --resume it is bit-identical to an
uninterrupted run. A job that a script puts in the background ignores SIGINT
(Ctrl-C); stop it with SIGTERM.";

impl Train {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        match self.seeds.clone() {
            Some(seeds) => {
                let arguments = |seed, jobs| self.arguments_for(seed, jobs);
                Campaign::new(seeds, self.jobs as usize, arguments)?.run()
            }
            None => self.run_one(),
        }
    }

    fn run_one(self) -> Result<()> {
        signals::install()?;
        if let Some(process) = self.campaign {
            leave_with(process, Signal::TERM)?;
        }
        if self.on_failure == OnFailure::Continue {
            return Err(usage!(
                "--on-failure continue is for frozen policies; training takes abort or restart"
            ));
        }
        let config = self.resolve()?;
        if config.backend == Backend::Candle {
            keep_candle_to_its_thread()?;
        }
        let out = self.out.clone().unwrap_or_else(|| default_out(&config));
        if self.dry_run {
            if !self.resume {
                RunFolder::check_free(&out)?;
            }
            return self.print_plan(&config, &out);
        }
        let mut run = if self.resume {
            Run::resume(RunFolder::open(&out)?, config.clone(), self.pace())?
        } else {
            Run::create(RunFolder::open(&out)?, config.clone(), self.pace())?
        };
        let (began, from) = (Instant::now(), run.timestep());
        // Of the run so far, when an agent was lost last.
        let mut lost_at = None;
        loop {
            let mut reporter = Reporter::new(&run);
            let trained = self.train(&mut run, &mut reporter);
            reporter.finish();
            let again = self.on_failure == OnFailure::Restart && lost_at != Some(run.timestep());
            match trained {
                Err(error) if again && error.is_loss() => {
                    tell(&format!("note: {error}; restarting the team"));
                    lost_at = Some(run.timestep());
                    // The folder is locked as long as the run is there.
                    drop(run);
                    run = Run::resume(RunFolder::open(&out)?, config.clone(), self.pace())?;
                }
                trained => {
                    trained?;
                    return self.summarise(&run, from, began.elapsed());
                }
            }
        }
    }

    /// Trains until the end of the run, or until an agent is lost.
    fn train(&self, run: &mut Run, reporter: &mut Reporter) -> Result<()> {
        let (agents, policy) = (run.trainer().agents(), run.trainer().policy()?);
        if self.in_process {
            run.train(&mut InProcess::new(&agents, &policy)?, |run| reporter.note(run))
        } else {
            run.train(&mut Processes::start(&agents, &policy, self.wait)?, |run| reporter.note(run))
        }
    }

    /// Every setting, from the preset, the file and the command line.
    fn resolve(&self) -> Result<Config> {
        let mut layers = Vec::new();
        if self.resume {
            if self.preset.is_some() {
                return Err(usage!("--preset is for a new run; --resume keeps the settings of the run"));
            }
            layers.push(RunFolder::settings(self.folder_of_run()?)?);
        }
        if let Some(path) = &self.config {
            layers.push(Layer::read(path)?);
        }
        let mut line = Layer::new("--set");
        self.settings.iter().for_each(|(key, value)| line.set(key, value));
        layers.push(line);
        layers.push(self.layer_of_options());
        Config::resolve(self.preset.unwrap_or_default(), &layers)
    }

    /// The folder of the run to go on with.
    fn folder_of_run(&self) -> Result<&Path> {
        let out =
            self.out.as_deref().ok_or_else(|| usage!("--resume needs the folder of the run: --out DIR"))?;
        RunFolder::check_run(out)?;
        Ok(out)
    }

    /// The options that are settings.
    fn layer_of_options(&self) -> Layer {
        let mut layer = Layer::new("command line");
        let text = |value: Option<String>| value.map(|value| format!("{value:?}"));
        for (key, value) in [
            ("task", text(self.task.clone())),
            ("seed", self.seed.map(|seed| seed.to_string())),
            ("steps", self.steps.map(|steps| steps.to_string())),
            ("algorithm", name(self.algorithm.as_ref())),
            ("backend", name(self.backend.as_ref())),
            ("predictors", text(self.predictors.clone())),
            ("train_p", self.train_p.clone()),
            ("physics", text(self.physics.map(String::from))),
            ("relay", self.relay.then(|| "true".to_owned())),
        ] {
            value.into_iter().for_each(|value| layer.set(key, &value));
        }
        layer
    }

    /// The command line that runs one seed of a campaign, in which `jobs` runs go on at the same time.
    fn arguments_for(&self, seed: u64, jobs: usize) -> Result<Vec<OsString>> {
        // A run that has begun knows its task.
        let out = match &self.out {
            Some(out) => out_of_seed(out, seed),
            None => default_out(&Train { resume: false, seed: Some(seed), ..self.clone() }.resolve()?),
        };
        let goes_on = self.resume && RunFolder::has_run(&out);
        if !goes_on {
            // What cannot be is said before anything has begun.
            Train { resume: false, ..self.clone() }.resolve()?;
        }
        let mut arguments: Vec<OsString> = ["train", "--seed"].map(OsString::from).to_vec();
        arguments.push(seed.to_string().into());
        let threads = (self.pace().threads / jobs).max(1);
        for (option, value) in [
            ("--out", Some(out.into())),
            ("--task", self.task.clone().map(OsString::from)),
            ("--steps", self.steps.map(|steps| steps.to_string().into())),
            ("--algorithm", name(self.algorithm.as_ref()).map(OsString::from)),
            ("--predictors", self.predictors.clone().map(OsString::from)),
            ("--train-p", self.train_p.clone().map(OsString::from)),
            ("--physics", self.physics.map(|physics| String::from(physics).into())),
            ("--preset", name(self.preset.as_ref()).filter(|_| !goes_on).map(OsString::from)),
            ("--config", self.config.clone().map(OsString::from)),
            ("--backend", name(self.backend.as_ref()).map(OsString::from)),
            ("--threads", Some(threads.to_string().into())),
            ("--wait", name(Some(&self.wait)).filter(|_| !self.in_process).map(OsString::from)),
            ("--on-failure", name(Some(&self.on_failure)).filter(|_| !self.in_process).map(OsString::from)),
            ("--campaign", Some(std::process::id().to_string().into())),
            ("--checkpoint-every", Some(self.checkpoint_every.to_string().into())),
        ] {
            if let Some(value) = value {
                arguments.extend([option.into(), value]);
            }
        }
        for (key, value) in &self.settings {
            arguments.extend(["--set".into(), format!("{key}={value}").into()]);
        }
        let flags = [
            ("--resume", goes_on),
            ("--relay", self.relay),
            ("--in-process", self.in_process),
            ("--dry-run", self.dry_run),
            ("--json", self.json),
        ];
        arguments.extend(flags.iter().filter(|(_, given)| *given).map(|(flag, _)| flag.into()));
        Ok(arguments)
    }

    fn pace(&self) -> Pace {
        Pace {
            threads: threads(self.threads),
            checkpoint_every: Duration::from_secs_f64(self.checkpoint_every),
        }
    }
}

/// The threads that were asked for, or one per core.
pub(super) fn threads(wanted: Option<u32>) -> usize {
    wanted.map_or_else(cores, |threads| threads as usize)
}

/// How a value is written on the command line.
fn name(value: Option<&impl ValueEnum>) -> Option<String> {
    let value = value.and_then(ValueEnum::to_possible_value);
    value.map(|value| value.get_name().to_owned())
}

/// Where a run goes if nobody says so.
fn default_out(config: &Config) -> PathBuf {
    PathBuf::from("runs").join(format!("{}-{}", config.task, config.seed))
}

/// Reads `1000000`, `1e6`, `5M` or `250k`.
fn timesteps(text: &str) -> std::result::Result<u64, String> {
    let (digits, scale) = match text.to_ascii_lowercase() {
        t if t.ends_with('k') => (t[..t.len() - 1].to_owned(), 1e3),
        t if t.ends_with('m') => (t[..t.len() - 1].to_owned(), 1e6),
        t => (t, 1.0),
    };
    match digits.parse::<f64>().map(|x| x * scale) {
        Ok(steps) if (1.0..9e15).contains(&steps) && steps.fract() == 0.0 => Ok(steps as u64),
        _ => Err("expected a number of timesteps, such as 1000000, 1e6 or 1M".to_owned()),
    }
}

fn key_value(text: &str) -> std::result::Result<(String, String), String> {
    let (key, value) = text.split_once('=').ok_or("expected KEY=VALUE")?;
    Ok((key.trim().to_owned(), value.trim().to_owned()))
}

pub(super) fn seconds(text: &str) -> std::result::Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=1e6).contains(&seconds) => Ok(seconds),
        _ => Err("expected a number of seconds".to_owned()),
    }
}
