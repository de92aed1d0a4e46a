//! `tasks`: what there is to play.

use clap::Args;
use serde_json::json;

use super::{print, print_json, table};
use crate::agent::BUILTIN;
use crate::base::error::Result;
use crate::base::table::wrapped;
use crate::environment::Task;

/// List the tasks: ids, aliases, team sizes, dimensions
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm tasks
  vamaro-swarm tasks --json")]
pub struct Tasks {
    /// Print a JSON array
    #[arg(long)]
    json: bool,
}

impl Tasks {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let tasks = Task::all();
        if self.json {
            return print_json(&tasks.iter().map(as_json).collect());
        }
        let header = ["task", "agents", "observation", "joint", "predicted", "policy"];
        let rows = tasks.iter().map(|task| {
            vec![
                task.id().to_owned(),
                task.spec().n_agents().to_string(),
                task.spec().padded_obs_dim().to_string(),
                task.spec().joint_dim().to_string(),
                task.spec().predicted_dim().to_string(),
                if has_policy(task) { "builtin" } else { "-" }.to_owned(),
            ]
        });
        let about = |id: &str, words: &str| wrapped(&format!("{id:<28}{words}"), 28) + "\n";
        let aliased = tasks.iter().filter(|task| !task.aliases().is_empty());
        let aliases: String = aliased.map(|task| about(task.id(), &task.aliases().join(", "))).collect();
        // Teams of several sizes do the same.
        let mut families = tasks.clone();
        families.dedup_by_key(|task| task.summary());
        let summaries: String = families.iter().map(|task| about(task.id(), task.summary())).collect();
        let sizes = wrapped(&format!("Teams of other sizes: {}.", Task::other_sizes()), 2);
        print(&format!(
            "{}\n{summaries}\nalso called\n{aliases}\n{sizes}\nDimensions are numbers of values; `predicted` are those an \
             imputer completes.\n",
            table(&header, rows)
        ))
    }
}

fn has_policy(task: &Task) -> bool {
    BUILTIN.iter().any(|(id, _)| *id == task.id())
}

fn as_json(task: &Task) -> serde_json::Value {
    json!({
        "task": task.id(),
        "aliases": task.aliases(),
        "agents": task.spec().n_agents(),
        "landmarks": task.spec().landmarks,
        "targets": task.spec().targets,
        "observation_dim": task.spec().padded_obs_dim(),
        "joint_dim": task.spec().joint_dim(),
        "predicted_dim": task.spec().predicted_dim(),
        "builtin_policy": has_policy(task),
        "summary": task.summary(),
    })
}
