//! `verify`: recompute what was recorded.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::{policy_source, print, print_json, table};
use crate::base::error::Result;
use crate::failed;
use crate::verify::{Comparison, Report, verify};

/// Recompute recordings, traces and updates, and compare
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm verify recordings/
  vamaro-swarm verify trace.json --policy runs/hs-0/policy.safetensors
  vamaro-swarm verify trace.json --json

The exit code is 0 only if something was compared and all of it agrees.")]
pub struct Verify {
    /// Recordings, traces, the config.json of updates, or folders that hold some
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,

    /// Policy to run traces with [default: the one beside the trace, or the one it names]
    #[arg(long, value_name = "FILE|DIR|builtin")]
    policy: Option<String>,

    /// Print what was found as one JSON object
    #[arg(long)]
    json: bool,
}

impl Verify {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let policy = self.policy.as_deref().map(|name| policy_source(name, 0)).transpose();
        let (report, ended) = match policy.and_then(|policy| verify(&self.paths, policy.as_ref())) {
            Ok(report) => (report, None),
            Err(error) => (Report::default(), Some(error)),
        };
        let mut json = as_json(&report);
        // With one failure and nothing else the error says it all.
        let text = if report.comparisons.is_empty() && report.failed.len() == 1 {
            String::new()
        } else {
            as_text(&report)
        };
        let verdict = ended.map_or_else(|| verdict(report), Err);
        if self.json {
            json["holds"] = json!(verdict.is_ok());
            json["error"] = json!(verdict.as_ref().err().map(ToString::to_string));
            print_json(&json)?;
            return verdict.map(drop);
        }
        print(&text)?;
        print(&format!("all {} comparisons hold\n", verdict?))
    }
}

/// How many comparisons hold, if all do.
fn verdict(mut report: Report) -> Result<usize> {
    let total = report.comparisons.len() + report.failed.len();
    let held = report.comparisons.iter().filter(|comparison| comparison.holds()).count();
    match total {
        _ if report.holds() => Ok(total),
        0 => Err(failed!("nothing was compared: no recording, trace or update found")),
        1 if held == 0 && !report.failed.is_empty() => Err(report.failed.remove(0).1),
        _ => Err(failed!("{} of {total} comparisons do not hold", total - held)),
    }
}

fn as_text(report: &Report) -> String {
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
            place.map_or(String::new(), |(episode, step)| format!("worst in episode {episode}, step {step}")),
        ]
    });
    let rows = table(&["", "file", "compared", "values", "deviation", "tolerance", ""], rows);
    let rows = if report.comparisons.is_empty() { String::new() } else { rows };
    let skipped = report.skipped.iter().map(|(file, what)| format!("skipped {}: {what}\n", file.display()));
    let failed = report.failed.iter().map(|(_, error)| format!("FAIL {error}\n"));
    std::iter::once(rows).chain(skipped).chain(failed).collect()
}

/// The same for programs, see `docs/formats.md`.
fn as_json(report: &Report) -> Value {
    let comparisons = report.comparisons.iter().map(|comparison| {
        let Comparison { file, what, values, deviation, tolerance, worst } = comparison;
        json!({
            "file": file,
            "compared": what,
            "values": values,
            "deviation": deviation,
            "tolerance": tolerance,
            "worst": worst.map(|(episode, step)| json!({"episode": episode, "step": step})),
            "holds": comparison.holds(),
        })
    });
    let skipped = report.skipped.iter().map(|(file, what)| json!({"file": file, "what": what}));
    let failed = report.failed.iter().map(|(file, error)| json!({"file": file, "error": error.to_string()}));
    json!({
        "comparisons": comparisons.collect::<Vec<_>>(),
        "skipped": skipped.collect::<Vec<_>>(),
        "failed": failed.collect::<Vec<_>>(),
    })
}
