//! `fit`: what a frozen policy's imputers need to know.

use std::path::PathBuf;

use clap::Args;

use super::{policy_source, print};
use crate::agent::PolicySource;
use crate::base::error::Result;
use crate::dynamics::{Dynamics, Fitted, fit};
use crate::environment::Task;
use crate::nn::{PolicyFile, Precision};
use crate::usage;

/// Fit the dynamics of a policy's environment, for the imputer `dynamics`
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm fit hear-see/seed-0 --out hs.safetensors
  vamaro-swarm evaluate hs.safetensors --imputers value-aware,dynamics

Agents act at random in the first episodes of the seed, everything is seen, and how bodies move
is fitted to that: what of its velocity a body keeps, what each action adds, how far a step
moves, and how agents push each other. The weights of the policy stay as they are.")]
pub struct Fit {
    /// A policy file, or the folder of a training run
    #[arg(value_name = "FILE|DIR")]
    policy: String,

    /// Where to write the policy with its dynamics [default: where it was read]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    /// How many episodes to look at
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    episodes: u64,

    /// Seed of the episodes
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    seed: u64,
}

impl Fit {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let source = policy_source(&self.policy, 0)?;
        let PolicySource::File(path) = &source else {
            return Err(usage!("{} is no file; fit a policy file, or the folder of a run", self.policy));
        };
        let file = PolicyFile::read(path)?;
        let task = Task::parse(&file.meta.task)?;
        let policy = source.load(task.spec())?;
        let fitted = fit(&task, self.seed, self.episodes)?;
        let out = self.out.as_ref().unwrap_or(path);
        let words = words(&fitted);
        let policy = policy.with_dynamics(fitted.dynamics);
        // As precise as it was: values that have been rounded to f16 stay what they are.
        if file.tensors.iter().all(|tensor| tensor.precision == Precision::Half) {
            policy.save_half(out)?;
        } else {
            policy.save(out)?;
        }
        print(&format!(
            "{}: dynamics from {} episodes\n{words}wrote {}\n",
            task.id(),
            self.episodes,
            out.display()
        ))
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
        None => format!("none fitted: {contacts} touches were seen; the imputer does without"),
    };
    format!(
        "velocity    {keep:.4} of it stays after a step; median error {velocity_error:.1e} m/s\n\
         place       {before:.4} s of the velocity before a step and {after:.4} s of that after it; median error \
         {place_error:.1e} m\ncontact     {contact}\n"
    )
}
