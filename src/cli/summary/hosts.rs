//! What the summary says of the other machines that agents ran on.

use serde_json::{Value, json};

use super::Outcome;
use crate::base::table::counted;
use crate::supervisor::{HostReport, members_of};

/// For people: a line for each.
pub(super) fn host_lines(outcome: &Outcome) -> Vec<(&'static str, String)> {
    let about = ["hosts"].into_iter().chain(std::iter::repeat(""));
    about.zip(outcome.hosts.iter().map(|host| words(host, outcome))).collect()
}

fn words(host: &HostReport, outcome: &Outcome) -> String {
    let HostReport { name, at, ahead_ns, error_ns, observations, lost, delayed, clock_jumps, .. } = host;
    let agents: Vec<String> = members_of(host.agents).map(|agent| agent.to_string()).collect();
    let clock = format!("clock {:+.3} ms, right to {:.3} ms", *ahead_ns as f64 / 1e6, *error_ns as f64 / 1e6);
    let jumps = if *clock_jumps > 0 { format!(", {}", counted(*clock_jumps, "jump")) } else { String::new() };
    let network =
        format!("network lost {lost} and delayed {delayed} of {}", counted(*observations, "observation"));
    let losses = missed_ticks(host, outcome).map(|missed| {
        format!("; {} late at their peers, {} missed", late(host, outcome), counted(missed, "tick"))
    });
    let losses = losses.unwrap_or_default();
    format!("{name} ({at}): agents {}{losses}; {network}; {clock}{jumps}", agents.join(", "))
}

/// For programs, see `docs/formats.md`.
pub(super) fn host_json(outcome: &Outcome) -> Vec<Value> {
    let of = |host: &HostReport| {
        json!({
            "name": host.name,
            "at": host.at,
            "agents": members_of(host.agents).collect::<Vec<_>>(),
            "offset_ns": host.ahead_ns,
            "error_ns": host.error_ns,
            "clock_jumps": host.clock_jumps,
            "observations": host.observations,
            "lost": host.lost,
            "delayed": host.delayed,
            "late": outcome.punctuality.map(|_| late(host, outcome)),
            "missed_ticks": missed_ticks(host, outcome),
        })
    };
    outcome.hosts.iter().map(of).collect()
}

/// Observations that its agents sent and that came too late.
fn late(host: &HostReport, outcome: &Outcome) -> u64 {
    members_of(host.agents).map(|agent| outcome.statistics.late_from(agent)).sum()
}

/// Ticks in which its agents did not decide in time; `None` in lockstep.
fn missed_ticks(host: &HostReport, outcome: &Outcome) -> Option<u64> {
    let missed = &outcome.punctuality?.missed;
    Some(members_of(host.agents).map(|agent| missed[agent]).sum())
}
