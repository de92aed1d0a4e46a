//! `verify`: recompute what was recorded.

use std::path::PathBuf;

use clap::Args;

use super::{policy_source, print, table};
use crate::base::error::Result;
use crate::failed;
use crate::verify::{Comparison, verify};

/// Recompute recordings, traces and updates, and compare
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm verify recordings/
  vamaro-swarm verify trace.json --policy runs/hs-0/policy.safetensors

The exit code is 0 only if something was compared and all of it agrees.")]
pub struct Verify {
    /// Recordings, traces, the config.json of updates, or folders that hold some
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,

    /// Policy to run traces with [default: the one beside the trace, or the one it names]
    #[arg(long, value_name = "FILE|DIR|builtin")]
    policy: Option<String>,
}

impl Verify {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let policy = self.policy.as_deref().map(|name| policy_source(name, 0)).transpose()?;
        let mut report = verify(&self.paths, policy.as_ref())?;
        if report.comparisons.is_empty() && report.failed.len() == 1 {
            // Nothing else to tell.
            return Err(report.failed.remove(0).1);
        }
        let rows = report.comparisons.iter().map(|comparison| {
            let Comparison { file, what, values, deviation, tolerance, worst } = comparison;
            let place = worst.filter(|_| !comparison.holds());
            vec![
                if comparison.holds() { "ok" } else { "FAIL" }.to_owned(),
                file.display().to_string(),
                (*what).to_owned(),
                values.to_string(),
                format!("{deviation:.1e}"),
                format!("{tolerance:.0e}"),
                place.map_or(String::new(), |(episode, step)| {
                    format!("worst in episode {episode}, step {step}")
                }),
            ]
        });
        let rows = table(&["", "file", "compared", "values", "deviation", "tolerance", ""], rows);
        let skipped = report.skipped.iter();
        let skipped: String =
            skipped.map(|(file, what)| format!("skipped {}: {what}\n", file.display())).collect();
        let rows = if report.comparisons.is_empty() { String::new() } else { rows };
        print(&format!("{rows}{skipped}"))?;
        for (_, error) in &report.failed {
            print(&format!("FAIL {error}\n"))?;
        }
        let total = report.comparisons.len() + report.failed.len();
        let held = report.comparisons.iter().filter(|comparison| comparison.holds()).count();
        match report.holds() {
            true => print(&format!("all {total} comparisons hold\n")),
            false if total == 0 => Err(failed!("nothing was compared: no recording, trace or update found")),
            false => Err(failed!("{} of {total} comparisons do not hold", total - held)),
        }
    }
}
