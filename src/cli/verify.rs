//! `verify`: recompute what was recorded.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde_json::{Value, json};

use super::{policy_source, print, print_json, table};
use crate::agent::{AgentSettings, PolicySource};
use crate::base::error::{Error, Result};
use crate::environment::Task;
use crate::failed;
use crate::link::LinkSpec;
use crate::nn::PolicyFile;
use crate::supervisor::{AgentCommand, Check, Deadlines, Examination, Session, signals};
use crate::verify::{Comparison, Report, verify};

/// Recompute recordings, traces and updates, and compare
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm verify recordings/
  vamaro-swarm verify trace.json --policy runs/hs-0/policy.safetensors
  vamaro-swarm verify trace.json --json
  vamaro-swarm verify --agent 'python3 agents/python/hold.py'

The exit code is 0 only if something was compared and all of it agrees.")]
pub struct Verify {
    /// Recordings, traces, the config.json of updates, or folders that hold some
    #[arg(required_unless_present = "agent", value_name = "PATH")]
    paths: Vec<PathBuf>,

    /// Instead, check an agent: start this command, play ticks to it, and say what it does wrong (docs/protocol.md).
    /// Quotes work as in a shell, variables do not
    #[arg(long, value_name = "COMMAND", value_parser = AgentCommand::parse, conflicts_with = "paths")]
    agent: Option<AgentCommand>,

    /// Policy to run traces, or the agent, with [default: the one beside the trace, or the one it names; for an agent,
    /// that of spread-xy-4]
    #[arg(long, value_name = "FILE|DIR|builtin")]
    policy: Option<String>,

    /// Print what was found as one JSON object
    #[arg(long)]
    json: bool,
}

/// How long an agent that is examined may take for its part of a tick.
const ANSWER: Duration = Duration::from_secs(2);

/// How many episodes are played to it: two side by side, and one alone.
const EPISODES: u64 = 3;

impl Verify {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let policy = self.policy.as_deref().map(|name| policy_source(name, 0)).transpose();
        if let Some(command) = self.agent {
            return examine(command, policy?.unwrap_or(PolicySource::Builtin), self.json);
        }
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

/// Plays ticks to an agent of another program, which holds what it heard last.
fn examine(command: AgentCommand, policy: PolicySource, as_json: bool) -> Result<()> {
    signals::install()?;
    let task = match &policy {
        PolicySource::File(path) => Task::parse(&PolicyFile::read(path)?.meta.task)?,
        _ => Task::parse("spread-xy-4")?,
    };
    let links = LinkSpec::parse("level(0.5) + delay(0, 2)", task.spec().n_agents())?.build();
    let loaded = policy.load(task.spec())?;
    let settings = AgentSettings {
        policy,
        greedy: loaded.is_greedy(),
        worlds: 2,
        longest_delay: links.longest_delay(),
        tell_logits: true,
        ..AgentSettings::of(task.spec())
    };
    let deadlines = Deadlines { answer: ANSWER, ..Deadlines::default() };
    let mut examination = Examination::start(&settings, &loaded, 1, command, deadlines)?;
    let mut session = Session::new(task.environment(settings.worlds), links, settings.seed);
    let played =
        if examination.can_go_on() { session.play(&mut examination, EPISODES, &mut []) } else { Ok(()) };
    // What ended it is a finding, unless it was not the agent.
    let other = |e: &Error| matches!(e, Error::Interrupted(_)) || examination.can_go_on();
    let ended = played.err().filter(other);
    let checks = ended.map_or_else(|| examination.end(), Err)?;
    let wrong = checks.iter().filter(|check| check.fault.is_some()).count();
    let verdict = match wrong {
        0 => Ok(()),
        _ => Err(failed!(
            "the agent fails {wrong} of {} checks; docs/protocol.md says what it must do",
            checks.len()
        )),
    };
    if as_json {
        let each = checks
            .iter()
            .map(|check| json!({"what": check.what, "looked": check.looked, "fault": check.fault}));
        print_json(
            &json!({"checks": each.collect::<Vec<_>>(), "holds": wrong == 0, "error": verdict.as_ref().err().map(ToString::to_string)}),
        )?;
    } else {
        let rows = checks.iter().map(|Check { what, looked, fault }| {
            let verdict = fault.as_ref().map_or(if *looked > 0 { "ok" } else { "-" }, |_| "FAIL");
            vec![
                verdict.to_owned(),
                (*what).to_owned(),
                looked.to_string(),
                fault.clone().unwrap_or_default(),
            ]
        });
        print(&table(&["", "checked", "times", ""], rows))?;
    }
    verdict
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
