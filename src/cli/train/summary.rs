//! What `train` prints: what a run would take, and what came of it.

use std::path::Path;
use std::time::Duration;

use indicatif::HumanDuration;
use serde_json::json;

use super::{Train, threads};
use crate::base::error::Result;
use crate::base::table::counted;
use crate::cli::{print, print_json, table};
use crate::train::{Checkpoint, Config, Run, RunFolder, Trial, estimate};

impl Train {
    /// What a run would take.
    pub(super) fn print_plan(&self, config: &Config, out: &Path) -> Result<()> {
        let from = if self.resume {
            Checkpoint::open(&RunFolder::checkpoint_in(out))?.progress.timestep()
        } else {
            0
        };
        let threads = threads(self.threads);
        let plan = estimate(config, threads, from)?;
        if self.json {
            return print_json(&json!({
                "out": out,
                "from": from,
                "steps": config.steps,
                "updates": plan.updates,
                "rows": plan.rows,
                "env_steps_per_s": plan.steps_per_second,
                "duration_s": plan.duration.as_secs_f64(),
                "disk_bytes": plan.disk,
                "memory_bytes": plan.memory,
                "config": config,
            }));
        }
        let goes_on = if from > 0 { format!("continues from {from}; ") } else { String::new() };
        print(&format!(
            "# {}: {goes_on}up to {} MB of disk, {} MB of memory\n# {} env steps to go, {} updates, {} rows of \
             metrics.csv\n# about {} at {:.0} env steps/s, tests included (measured now, in-process, {threads} \
             threads)\n{}",
            out.display(),
            plan.disk.div_ceil(1_000_000),
            plan.memory.div_ceil(1_000_000),
            config.steps.saturating_sub(from),
            plan.updates,
            plan.rows,
            HumanDuration(plan.duration),
            plan.steps_per_second,
            config.to_toml(),
        ))
    }

    /// What came of a run.
    pub(super) fn summarise(&self, run: &Run, from: u64, elapsed: Duration) -> Result<()> {
        let (config, steps) = (run.config(), run.timestep());
        let per_second = (steps - from) as f64 / elapsed.as_secs_f64();
        if self.json {
            let tests = run.trials().iter().map(|trial| {
                json!({
                    "imputer": trial.imputer,
                    "p": trial.level,
                    "episodes": config.test_episodes,
                    "return_mean": trial.return_mean,
                    "return_std": trial.return_std,
                    "imputation_rmse": trial.imputation_rmse,
                })
            });
            return print_json(&json!({
                "task": config.task,
                "seed": config.seed,
                "out": run.folder(),
                "timesteps": steps,
                "env_steps_per_s": per_second,
                "elapsed_s": elapsed.as_secs_f64(),
                "trained_s": run.seconds(),
                "tests": tests.collect::<Vec<_>>(),
            }));
        }
        let (name, folder) = (format!("{}, seed {}", config.task, config.seed), run.folder().display());
        if steps == from {
            return print(&format!(
                "{name}: {folder} has already been trained for its {steps} env steps; ask for more with --steps\n"
            ));
        }
        let curves = if config.test_episodes > 0 { "curves.svg, " } else { "" };
        let since = if from > 0 { format!(" from {from} on") } else { String::new() };
        print(&format!(
            "{name}: {steps} env steps{since} in {:.1} s ({per_second:.0}/s)\n{}wrote {folder}: policy.safetensors, \
             metrics.csv, {curves}..\n",
            elapsed.as_secs_f64(),
            returns_table(run.trials(), config.test_episodes),
        ))
    }
}

/// Mean returns of the last test, a row per imputer and a column per level.
fn returns_table(trials: &[Trial], episodes: u64) -> String {
    let Some(first) = trials.first() else { return String::new() };
    let of_first = trials.iter().take_while(|trial| trial.imputer == first.imputer);
    let mut header = vec![format!("return ({})", counted(episodes, "episode"))];
    header.extend(of_first.map(|trial| format!("p = {}", trial.level)));
    let rows = trials.chunk_by(|a, b| a.imputer == b.imputer).map(|trials| {
        let returns = trials.iter().map(|trial| format!("{:.1}", trial.return_mean));
        std::iter::once(trials[0].imputer.clone()).chain(returns).collect()
    });
    table(&header.iter().map(String::as_str).collect::<Vec<_>>(), rows)
}
