//! `import`: state dicts of PyTorch, or ONNX files, become a policy file.

use std::path::{Path, PathBuf};

use clap::Args;

use super::print;
use crate::agent::{PREFERRED, dims};
use crate::base::error::Result;
use crate::environment::Task;
use crate::nn::{Description, Files, Meta, Policy, import};
use crate::usage;

/// Convert ONNX files, or PyTorch state dicts with the names and shapes of the paper's code, to a policy file
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm import --onnx a.onnx b.onnx --task hear-see --out hs.safetensors
  vamaro-swarm import --toml team.toml --out team.safetensors
  vamaro-swarm import results/hs-0 --task hear-see --out hs-0.safetensors
  vamaro-swarm import agent.th --task SXY-4 --algorithm mappo --steps 5000000 \\
      --predictor value-aware=network.th --predictor maro=maro.th")]
pub struct Import {
    /// State dict of the actors, or a folder with agent.th and network.th
    #[arg(value_name = "FILE|DIR", required_unless_present_any = ["onnx", "toml"],
          conflicts_with_all = ["onnx", "toml"])]
    actors: Option<PathBuf>,

    /// ONNX files of the actors, one for each agent or one that all share; they take the joint estimate and return logits
    #[arg(long, value_name = "FILE", num_args = 1..)]
    onnx: Vec<PathBuf>,

    /// Description of the ONNX files: names, inputs and outputs (docs/onnx.md)
    #[arg(long, value_name = "FILE")]
    toml: Option<PathBuf>,

    /// Task the policy is for [default: that of --toml]
    #[arg(long, value_name = "T", required_unless_present = "toml")]
    task: Option<String>,

    /// A predictor and the state dict it is in [default: value-aware=network.th beside the actors]
    #[arg(long = "predictor", value_name = "NAME=FILE", value_parser = named_file, conflicts_with_all = ["onnx", "toml"])]
    predictors: Vec<(String, PathBuf)>,

    /// Policy file to write
    #[arg(long, short, value_name = "FILE", default_value = "policy.safetensors")]
    out: PathBuf,

    /// Algorithm that trained it, which the files do not say [default: unknown]
    #[arg(long, value_name = "NAME")]
    algorithm: Option<String>,

    /// Env steps it was trained for [default: 0]
    #[arg(long, value_name = "N")]
    steps: Option<u64>,

    /// Seed it was trained with [default: 0]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,

    /// Where it comes from, in words [default: what kind of files]
    #[arg(long, value_name = "TEXT")]
    origin: Option<String>,
}

impl Import {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let policy = match &self.actors {
            Some(actors) => self.state_dicts(actors)?,
            None => self.graphs()?,
        };
        policy.save(&self.out)?;
        let names: Vec<&str> = policy.predictor_names().collect();
        print(&format!(
            "{}: {} for {}, {} parameters, predictors: {}\n",
            self.out.display(),
            policy.networks().actor,
            policy.dims().task,
            policy.n_values(),
            if names.is_empty() { "none".to_owned() } else { names.join(", ") }
        ))
    }

    /// The policy in state dicts.
    fn state_dicts(&self, actors: &Path) -> Result<Policy> {
        let task = Task::parse(self.task.as_deref().expect("the task of state dicts is named"))?;
        let actors = if actors.is_dir() { &actors.join("agent.th") } else { actors };
        if !actors.exists() {
            return Err(usage!("there is no state dict {}", actors.display()));
        }
        let mut predictors = self.predictors.clone();
        let beside = actors.with_file_name("network.th");
        if predictors.is_empty() && beside.exists() {
            predictors.push((PREFERRED.to_owned(), beside));
        }
        let named = |text: &Option<String>, other: &str| text.clone().unwrap_or_else(|| other.to_owned());
        let meta = Meta {
            algorithm: named(&self.algorithm, "unknown"),
            steps: self.steps.unwrap_or_default(),
            origin: named(&self.origin, "imported from a PyTorch state dict"),
            ..Meta::new(task.id(), self.seed.unwrap_or_default())
        };
        import(actors, &predictors, &dims(task.spec()), meta)
    }

    /// The policy in ONNX files.
    fn graphs(&self) -> Result<Policy> {
        let described = self.toml.as_deref().map(Description::open).transpose()?;
        let mut description = described.unwrap_or_default();
        match &self.onnx[..] {
            [] => {}
            [one] => description.onnx = Files::Shared(one.clone()),
            files => description.onnx = Files::Separate(files.to_vec()),
        }
        // What is said here goes before what the file says.
        let task = Task::parse(self.task.as_ref().unwrap_or(&description.task))?;
        description.task = task.id().to_owned();
        description.steps = self.steps.unwrap_or(description.steps);
        description.seed = self.seed.unwrap_or(description.seed);
        description.algorithm = self.algorithm.clone().or(description.algorithm);
        description.origin = self.origin.clone().or(description.origin);
        let source = self.toml.as_ref().map_or("--onnx".to_owned(), |path| path.display().to_string());
        Policy::of_description(description, &dims(task.spec()), &source)
    }
}

fn named_file(text: &str) -> std::result::Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.is_empty() && !file.is_empty() => Ok((name.to_owned(), file.into())),
        _ => Err("expected NAME=FILE, such as value-aware=network.th".to_owned()),
    }
}
