//! `fit`: what a frozen policy's imputers need to know.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;

use super::{PHYSICS_HELP, policy_source, print, tell};
use crate::agent::PolicySource;
use crate::base::error::{Error, Result};
use crate::base::table::counted;
use crate::dynamics::{Dynamics, Fitted, fit};
use crate::environment::{PhysicsSpec, Task};
use crate::nn::{Networks, Policy, PolicyFile, Precision, PredictorSpec};
use crate::supervisor::signals;
use crate::train::{FitSettings, PredictorLosses, fit_predictor};
use crate::usage;

/// Fit imputers to a frozen policy, and write them to its file
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm fit hear-see/seed-0 --out hs.safetensors
  vamaro-swarm evaluate hs.safetensors --imputers value-aware,dynamics
  vamaro-swarm fit runs/hs-0 --imputers dynamics,acting --updates 3000
  vamaro-swarm fit runs/hs-0 --physics damping=0.3 --out hs-damped.safetensors

For `dynamics`, agents act at random, everything is observed, and the law of
motion is fitted to that: the share of its velocity that a body keeps, what each
action adds, how far a step moves, and how agents push each other. --physics
fits it to other physics than those the policy was trained with.
Any other name makes a new predictor: an LSTM that also sees its agent's own
action and, where places are told, who is near whom. It learns in closed loop:
it imputes for the policy's agents while links deliver with a probability drawn
for each episode. From then on `dynamics` leaves to it what it does not move
itself, unless the policy already had such a predictor. The policy's own weights
stay as they are. The same command continues a fit that was interrupted or
killed; the result is bit-identical.")]
pub struct Fit {
    /// A policy file, or the folder of a training run
    #[arg(value_name = "FILE|DIR")]
    policy: String,

    /// What to fit: `dynamics`, or names of new predictors
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = DYNAMICS)]
    imputers: Vec<String>,

    /// Where to write the policy with them [default: where it was read]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    #[arg(long, value_name = "PHYSICS", help = PHYSICS_HELP, default_value_t)]
    physics: PhysicsSpec,

    /// How many episodes to fit dynamics to
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    episodes: u64,

    /// Updates of a new predictor, on 32 episodes each
    #[arg(long, value_name = "N", default_value_t = FitSettings::default().updates,
          value_parser = clap::value_parser!(u64).range(1..))]
    updates: u64,

    /// Seed of all draws
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    seed: u64,
}

/// What is fitted without a network.
const DYNAMICS: &str = "dynamics";

/// Time between lines about a predictor that learns.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

impl Fit {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let source = policy_source(&self.policy, 0)?;
        let PolicySource::File(path) = &source else {
            return Err(usage!("{} is not a file; give a policy file, or the folder of a run", self.policy));
        };
        let file = PolicyFile::read(path)?;
        let task = Task::parse(&file.meta.task)?.with_physics(self.physics)?;
        let mut policy = source.load(task.spec())?;
        if self.out.is_none() && !self.physics.is_default() {
            return Err(usage!(
                "--physics needs --out: dynamics of other physics do not belong in {}",
                path.display()
            ));
        }
        if self.out.is_none() && file.is_description() {
            return Err(usage!(
                "{} names ONNX files, and cannot hold what is fitted; say with --out which policy file shall hold all",
                path.display()
            ));
        }
        let out = self.out.as_ref().unwrap_or(path);
        if out.exists() && PolicyFile::read(out).is_err() {
            return Err(usage!(
                "--out: {} already exists and is not a policy file; choose another",
                out.display()
            ));
        }
        let mut unfinished = Vec::new();
        for name in &self.imputers {
            policy = match &name[..] {
                DYNAMICS => self.fit_dynamics(policy, &task)?,
                name => {
                    let predictors = vec![PredictorSpec::acting(name, policy.dims())];
                    let networks = Networks { predictors, ..policy.networks().clone() };
                    networks.check().map_err(|error| usage!("--imputers: {error}"))?;
                    unfinished.push(PathBuf::from(format!("{}.{name}.unfinished", out.display())));
                    self.teach(&policy, &task, name, &unfinished[unfinished.len() - 1])?
                }
            };
        }
        // As precise as it was: values that have been rounded to f16 stay what they are.
        if !file.tensors.is_empty() && file.tensors.iter().all(|tensor| tensor.precision == Precision::Half) {
            policy.save_half(out)?;
        } else {
            policy.save(out)?;
        }
        for path in unfinished {
            std::fs::remove_file(&path).map_err(|error| Error::io("remove", &path, error))?;
        }
        print(&format!("wrote {}\n", out.display()))
    }

    fn fit_dynamics(&self, policy: Policy, task: &Task) -> Result<Policy> {
        let fitted = fit(task, self.seed, self.episodes, signals::check_stop)?;
        let physics = self.physics.if_other();
        print(&format!(
            "{}: dynamics from {}{physics}\n{}",
            task.id(),
            counted(self.episodes, "episode"),
            words(&fitted)
        ))?;
        Ok(policy.with_dynamics(fitted.dynamics))
    }

    fn teach(&self, policy: &Policy, task: &Task, name: &str, unfinished: &Path) -> Result<Policy> {
        if policy.predictor(name).is_some() {
            return Err(usage!(
                "--imputers: the policy already has a predictor `{name}`; choose another name"
            ));
        }
        let settings = FitSettings { updates: self.updates, seed: self.seed, ..FitSettings::default() };
        let (began, mut told) = (Instant::now(), Instant::now());
        let mut loss = None;
        let progress = |updates, losses: &PredictorLosses| {
            loss = Some(losses.loss);
            if told.elapsed() >= BETWEEN_LINES {
                told = Instant::now();
                tell(&format!("{name}: {updates} of {} updates, loss {:.4}", self.updates, losses.loss));
            }
            signals::check_stop()
        };
        let spec = PredictorSpec::acting(name, policy.dims());
        let left =
            || format!("{} holds what has been learned; the same command continues", unfinished.display());
        let taught = fit_predictor(policy, task, &spec, &settings, unfinished, progress);
        let taught = taught.map_err(|error| if unfinished.exists() { error.and(left()) } else { error })?;
        let seconds = began.elapsed().as_secs_f64();
        let loss =
            loss.map_or("finished before".to_owned(), |loss| format!("{seconds:.1} s, loss {loss:.4}"));
        print(&format!("{}: predictor {name}, {} updates, {loss}\n", task.id(), self.updates))?;
        Ok(taught)
    }
}

fn words(fitted: &Fitted) -> String {
    let Fitted { dynamics, velocity_error, place_error, contacts } = fitted;
    let Dynamics { keep, before, after, contact, .. } = dynamics;
    let contact = match contact {
        Some(contact) => format!(
            "{:.4} m/s in a step for each metre nearer than {:.4} m, from {contacts} touches",
            contact.stiffness, contact.distance
        ),
        None => format!("none fitted ({contacts} touches were seen); the imputer ignores contacts"),
    };
    format!(
        "velocity    {keep:.4} of it stays after a step; median error {velocity_error:.1e} m/s\n\
         place       {before:.4} s of the velocity before a step and {after:.4} s of that after it; median error \
         {place_error:.1e} m\ncontact     {contact}\n"
    )
}
