//! `export`: keep the policy of a training run.

use std::path::PathBuf;

use clap::Args;

use super::{policy_source, print};
use crate::agent::PolicySource;
use crate::base::error::Result;
use crate::environment::Task;
use crate::nn::PolicyFile;
use crate::usage;

/// Write a policy in half precision, to archive it in half the size
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm export runs/hs-0 --out policies/hear-see.safetensors

Weights are rounded to f16; networks still calculate in f32, and `spawn` shows
no difference in the returns. Every command that reads policies reads such a
file.")]
pub struct Export {
    /// A policy file, or the folder of a training run
    #[arg(value_name = "FILE|DIR")]
    policy: String,

    /// Where to write it
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

impl Export {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let source = policy_source(&self.policy, 0)?;
        let PolicySource::File(path) = &source else {
            return Err(usage!("{} is not a file; give a policy file, or the folder of a run", self.policy));
        };
        let task = Task::parse(&PolicyFile::read(path)?.meta.task)?;
        let policy = source.load(task.spec())?;
        policy.save_half(&self.out)?;
        let size = std::fs::metadata(&self.out).map_or(0, |about| about.len());
        print(&format!("wrote {}: {}, {:.2} MB\n", self.out.display(), task.id(), size as f64 / 1e6))
    }
}
