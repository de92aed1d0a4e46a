//! `import`: state dicts of PyTorch become a policy file.

use std::path::PathBuf;

use clap::Args;

use super::print;
use crate::agent::{PREFERRED, dims};
use crate::base::error::Result;
use crate::environment::Task;
use crate::nn::{Meta, import};
use crate::usage;

/// Convert PyTorch state dicts, with the names and shapes of the paper's published code, to a policy file
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm import results/hs-0 --task hear-see --out hs-0.safetensors
  vamaro-swarm import agent.th --task SXY-4 --algorithm mappo --steps 5000000 \\
      --predictor value-aware=network.th --predictor maro=maro.th")]
pub struct Import {
    /// State dict of the actors, or a folder with agent.th and network.th
    #[arg(value_name = "FILE|DIR")]
    actors: PathBuf,

    /// Task the policy is for
    #[arg(long, value_name = "T")]
    task: String,

    /// A predictor and the state dict it is in [default: value-aware=network.th beside the actors]
    #[arg(long = "predictor", value_name = "NAME=FILE", value_parser = named_file)]
    predictors: Vec<(String, PathBuf)>,

    /// Policy file to write
    #[arg(long, short, value_name = "FILE", default_value = "policy.safetensors")]
    out: PathBuf,

    /// Algorithm that trained it, which the files do not say
    #[arg(long, value_name = "NAME", default_value = "unknown")]
    algorithm: String,

    /// Env steps it was trained for
    #[arg(long, value_name = "N", default_value_t = 0)]
    steps: u64,

    /// Seed it was trained with
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,

    /// Where it comes from, in words
    #[arg(long, value_name = "TEXT", default_value = "imported from a PyTorch state dict")]
    origin: String,
}

impl Import {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let task = Task::parse(&self.task)?;
        let actors = if self.actors.is_dir() { self.actors.join("agent.th") } else { self.actors };
        if !actors.exists() {
            return Err(usage!("there is no state dict {}", actors.display()));
        }
        let mut predictors = self.predictors;
        let beside = actors.with_file_name("network.th");
        if predictors.is_empty() && beside.exists() {
            predictors.push((PREFERRED.to_owned(), beside));
        }
        let meta = Meta {
            algorithm: self.algorithm,
            steps: self.steps,
            origin: self.origin,
            ..Meta::new(task.id(), self.seed)
        };
        let policy = import(&actors, &predictors, &dims(task.spec()), meta)?;
        policy.save(&self.out)?;
        let names: Vec<&str> = policy.predictor_names().collect();
        print(&format!(
            "{}: {} for {}, {} parameters, predictors: {}\n",
            self.out.display(),
            policy.networks().actor,
            task.id(),
            policy.n_values(),
            if names.is_empty() { "none".to_owned() } else { names.join(", ") }
        ))
    }
}

fn named_file(text: &str) -> std::result::Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.is_empty() && !file.is_empty() => Ok((name.to_owned(), file.into())),
        _ => Err("expected NAME=FILE, such as value-aware=network.th".to_owned()),
    }
}
