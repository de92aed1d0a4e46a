//! `verify`: recompute what was recorded.

use std::path::PathBuf;

use clap::Args;

use super::{policy_source, print, table};
use crate::error::Result;
use crate::failed;
use crate::verify::{Comparison, verify};

/// Recompute recordings, traces and updates and compare
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm verify recordings/
  vamaro-swarm verify trace.json --policy runs/hs-0/policy.safetensors

Exit code 0 only if something was compared and all of it agrees.")]
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
        let report = verify(&self.paths, policy.as_ref())?;
        let mut rows = table(&["", "file", "compared", "values", "deviation", "tolerance"]);
        for Comparison { file, what, values, deviation, tolerance } in &report.comparisons {
            let holds = if *values > 0 && deviation <= tolerance { "ok" } else { "FAIL" };
            rows.add_row([
                holds.to_owned(),
                file.display().to_string(),
                (*what).to_owned(),
                values.to_string(),
                format!("{deviation:.1e}"),
                format!("{tolerance:.0e}"),
            ]);
        }
        let skipped = report.skipped.iter();
        let skipped: String =
            skipped.map(|(file, what)| format!("skipped {}: {what}\n", file.display())).collect();
        print(&format!("{rows}\n{skipped}"))?;
        let (total, failed) =
            (report.comparisons.len(), report.comparisons.iter().filter(|c| !c.holds()).count());
        match (total, failed) {
            (0, _) => Err(failed!("nothing was compared: no recording, trace or update found")),
            (_, 0) => print(&format!("all {total} comparisons hold\n")),
            _ => Err(failed!("{failed} of {total} comparisons do not hold")),
        }
    }
}
