//! The summary of `spawn`, for people and for programs.

mod hosts;

use serde_json::{Value, json};

use self::hosts::{host_json, host_lines};
use crate::agent::{AgentSettings, PolicySource};
use crate::base::distribution::Distribution;
use crate::base::scheduling::Grants;
use crate::base::table::{counted, thousands, wrapped};
use crate::bus::Wait;
use crate::environment::PhysicsSpec;
use crate::link::{CommunicationMatrix, LinkSpec, complement};
use crate::nn::Meta;
use crate::supervisor::{
    AgentCommand, Audit, ChaosSpec, Faults, HostReport, Injected, Punctuality, Statistics, Steered,
};

/// What was asked for. With what came of it, it makes a summary.
pub(super) struct Summary<'a> {
    pub(super) physics: &'a PhysicsSpec,
    pub(super) links: &'a LinkSpec,
    pub(super) comm_at_t0: bool,
    pub(super) settings: &'a AgentSettings,
    pub(super) policy: &'a Meta,
    /// `None` in-process, where nobody waits.
    pub(super) wait: Option<Wait>,
    /// `None` in lockstep.
    pub(super) rate: Option<f64>,
    /// What the processes were granted, if they asked for anything.
    pub(super) scheduling: Option<Grants>,
    /// Which agents are other programs, and which.
    pub(super) others: &'a [(usize, AgentCommand)],
    /// What hosts the environment, if that is not here.
    pub(super) environment: Option<&'a AgentCommand>,
    /// Kills and stops on purpose.
    pub(super) chaos: Option<ChaosSpec>,
    pub(super) episodes: u64,
}

/// What came of it.
pub(super) struct Outcome<'a> {
    pub(super) statistics: &'a Statistics,
    pub(super) audit: Option<&'a Audit>,
    /// `None` in lockstep.
    pub(super) punctuality: Option<&'a Punctuality>,
    /// `None` in-process.
    pub(super) faults: Option<&'a Faults>,
    /// The other machines.
    pub(super) hosts: &'a [HostReport],
    /// `None` without chaos.
    pub(super) injected: Option<Injected>,
    /// `None` where nobody could change anything.
    pub(super) steered: Option<&'a Steered>,
}

impl Summary<'_> {
    /// Says what runs; both p and the drop probability, which are so easily confused.
    pub(super) fn first_lines(&self) -> String {
        let place = match (self.wait, self.settings.spec.n_agents()) {
            (None, _) => "in-process",
            (_, 1) => "as a process",
            _ => "as processes",
        };
        let what = format!(
            "{}{}: {} {place}, {}{}",
            self.settings.spec.id,
            self.physics.if_other(),
            counted(self.settings.spec.n_agents() as u64, "agent"),
            counted(self.episodes, "episode"),
            self.rate.map(|rate| self.clock_words(rate)).unwrap_or_default()
        );
        let at_t0 = if self.comm_at_t0 { "" } else { ", also at t = 0" };
        let relayed = if self.settings.relay { "; relayed" } else { "" };
        format!("{}\n{}", wrapped(&what, INDENT), line("links", &(self.link_words() + at_t0 + relayed)))
    }

    /// Says how long it will take, if all goes well.
    fn clock_words(&self, rate: f64) -> String {
        let batches = self.episodes.div_ceil(self.settings.worlds as u64);
        let seconds = batches as f64 * self.settings.spec.episode_steps as f64 / rate;
        format!(", at {rate} Hz: {seconds:.1} s")
    }

    fn link_words(&self) -> String {
        match self.links.p() {
            Some(p) => format!("p = {p} (probability of delivery), drop = {}", complement(p)),
            None => self.links.about(),
        }
    }

    /// The rest, for people.
    pub(super) fn text(&self, outcome: &Outcome) -> String {
        let Outcome { statistics, audit, punctuality, faults, injected, steered, .. } = *outcome;
        let actions = if self.settings.greedy { "greedy" } else { "sampled" };
        let returned = match statistics.return_ci95() {
            Some(ci) => format!("{:.1} +- {ci:.1} (mean, 95 % interval)", statistics.return_mean()),
            None => format!("{:.1} (one episode)", statistics.return_mean()),
        };
        let hosted = self.environment.map(|command| ("env", command.to_string()));
        let mut lines: Vec<_> = hosted.into_iter().collect();
        lines.extend([
            ("policy", self.policy_words()),
            ("imputer", format!("{}, actions {actions}", self.settings.imputer)),
        ]);
        let others =
            self.others.iter().map(|(agent, command)| ("by others", format!("agent-{agent}: {command}")));
        lines.extend(others);
        lines.push(("return", returned));
        if let Some(rate) = statistics.delivery_rate() {
            let to = if punctuality.is_some() { " to agents that decided in time" } else { "" };
            lines
                .push(("delivered", format!("{:.2} % of the observations sent at t >= 1{to}", 100.0 * rate)));
            lines.extend(self.delay_words(statistics).map(|words| ("delayed", words)));
            lines.extend(self.relay_words(statistics).map(|words| ("relayed", words)));
            let error = statistics.imputation_rmse();
            let error = error.map_or("nothing was imputed".to_owned(), |rmse| format!("{rmse:.4} RMSE"));
            lines.push(("imputation", error));
        }
        match punctuality {
            None => lines.push(("tick", self.tick_words(statistics))),
            Some(punctuality) => lines.extend(clock_lines(statistics, punctuality)),
        }
        lines.extend(host_lines(outcome));
        lines.extend(self.chaos.zip(injected).map(|(chaos, Injected { kills, stops })| {
            let (kills, stops) = (counted(kills, "kill"), counted(stops, "stop"));
            ("chaos", format!("{chaos}: {kills}, {stops}"))
        }));
        lines.extend(faults.map(fault_lines).into_iter().flatten());
        if statistics.absent() > 0 {
            let (_, due) = statistics.missed_of_due();
            lines.push(("absent", format!("in {} of {due} agent ticks", statistics.absent())));
        }
        lines.extend(
            steered.and_then(|steered| self.hand_words(steered, statistics)).map(|words| ("by hand", words)),
        );
        lines.extend(self.scheduling.as_ref().map(|grants| ("scheduling", grants.to_string())));
        lines.extend(audit.map(|audit| ("audit", audit.to_string())));
        lines.into_iter().map(|(name, words)| line(name, &words)).collect()
    }

    /// The shares of all observations sent that links delayed, if they can delay.
    fn delay_words(&self, statistics: &Statistics) -> Option<String> {
        let (delayed, outdated) = statistics.delayed_rate().zip(statistics.outdated_rate())?;
        (self.settings.longest_delay > 0).then(|| {
            format!(
                "{:.2} % of the observations sent arrived later, {:.2} % arrived outdated: after a newer one",
                100.0 * delayed,
                100.0 * outdated
            )
        })
    }

    /// What came through others than its sender, if agents relay.
    fn relay_words(&self, statistics: &Statistics) -> Option<String> {
        let rate = statistics.relayed_rate().filter(|_| self.settings.relay)?;
        Some(format!("{:.2} % as many arrived through others, a tick or more later", 100.0 * rate))
    }

    /// What somebody changed while it ran, if anything: the same command gives another run.
    fn hand_words(&self, steered: &Steered, statistics: &Statistics) -> Option<String> {
        let Steered { level, levels, kills, stops, ended } = *steered;
        let set = level.map(|p| format!("p set {}, last to {p}", counted(levels, "time")));
        let killed = (kills > 0).then(|| counted(kills, "kill"));
        let stopped = (stops > 0).then(|| counted(stops, "stop"));
        let ended = ended.then(|| {
            format!("ended after {} of {}", statistics.finished(), counted(self.episodes, "episode"))
        });
        let words: Vec<String> = [set, killed, stopped, ended].into_iter().flatten().collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    fn policy_words(&self) -> String {
        match &self.settings.policy {
            PolicySource::Untrained(_) => self.settings.policy.to_string(),
            PolicySource::Nobody => "none: every agent is another program".to_owned(),
            // Of a policy that was imported nobody may have said for how long it was trained.
            source if self.policy.steps == 0 => format!("{source}: {}", self.policy.origin),
            source => {
                format!("{source}: {}, {} env steps", self.policy.origin, thousands(self.policy.steps))
            }
        }
    }

    fn tick_words(&self, statistics: &Statistics) -> String {
        let seconds = statistics.elapsed().as_secs_f64();
        format!(
            "p50 {:.0} us, p99 {:.0} us; {:.0} ticks/s over {seconds:.2} s, {} a tick",
            tick_us(statistics, 0.5),
            tick_us(statistics, 0.99),
            statistics.ticks() as f64 / seconds,
            counted(self.settings.worlds as u64, "world")
        )
    }

    /// The same for programs, see `docs/formats.md`.
    pub(super) fn json(&self, outcome: &Outcome) -> Value {
        let Outcome { statistics, audit, punctuality, faults, injected, steered, .. } = *outcome;
        let Summary { physics, settings, .. } = self;
        let p = self.links.p();
        let mut summary = json!({
            "version": env!("CARGO_PKG_VERSION"),
            "task": settings.spec.id,
            "agents": settings.spec.n_agents(),
            "in_process": self.wait.is_none(),
            "wait": self.wait,
            "scheduling": self.scheduling,
            "links": self.links.recorded_name(),
            "p": p,
            "drop": p.map(complement),
            "matrix": self.links.matrix().map(CommunicationMatrix::to_rows),
            "comm_at_t0": self.comm_at_t0,
            "policy": settings.policy.to_string(),
            "policy_origin": self.policy.origin,
            "policy_steps": self.policy.steps,
            "imputer": settings.imputer.to_string(),
            "greedy": settings.greedy,
            "seed": settings.seed,
            "worlds": settings.worlds,
            "episodes": statistics.finished(),
            "return_mean": statistics.return_mean(),
            "return_ci95": statistics.return_ci95(),
            "delivery_rate": statistics.delivery_rate(),
            "delayed_rate": statistics.delayed_rate(),
            "outdated_rate": statistics.outdated_rate(),
            "imputation_rmse": statistics.imputation_rmse(),
            "ticks": statistics.ticks(),
            // By the clock a tick is a period.
            "tick_p50_us": punctuality.is_none().then(|| tick_us(statistics, 0.5)),
            "tick_p99_us": punctuality.is_none().then(|| tick_us(statistics, 0.99)),
            "elapsed_s": statistics.elapsed().as_secs_f64(),
            "audit": audit,
            "absent": statistics.absent(),
            "faults": faults.map(fault_json),
            "real_time": punctuality.map(|punctuality| clock_json(statistics, punctuality)),
        });
        if !physics.is_default() {
            summary["physics"] = json!(physics);
        }
        if let Some(command) = self.environment {
            summary["environment"] = json!(command.to_string());
        }
        if settings.relay {
            summary["relay"] = json!(true);
            summary["relayed_rate"] = json!(statistics.relayed_rate());
        }
        if !outcome.hosts.is_empty() {
            summary["hosts"] = json!(host_json(outcome));
        }
        if !self.others.is_empty() {
            let command = |(agent, command): &(usize, AgentCommand)| {
                (format!("agent-{agent}"), json!(command.to_string()))
            };
            summary["commands"] = self.others.iter().map(command).collect();
        }
        if let Some((chaos, injected)) = self.chaos.zip(injected) {
            summary["chaos"] = json!({"spec": chaos, "kills": injected.kills, "stops": injected.stops});
        }
        if let Some(steered) = steered.filter(|steered| **steered != Steered::default()) {
            summary["steered"] = json!(steered);
        }
        summary
    }
}

/// The width of what a line is about.
const INDENT: usize = 12;

/// A line of the summary, or as many as it takes.
fn line(about: &str, words: &str) -> String {
    wrapped(&format!("{about:<INDENT$}{words}"), INDENT) + "\n"
}

/// What befell the agents, for people: nothing if nothing did.
fn fault_lines(faults: &Faults) -> Vec<(&'static str, String)> {
    /// Of a run in which much went wrong, the first losses are enough to know why.
    const SHOWN: usize = 3;
    if faults.is_empty() {
        return Vec::new();
    }
    let Faults { deaths, hangs, restarts, rejoin, told } = faults;
    let back = if *restarts > 0 {
        let [p50, max] = [0.5, 1.0].map(|quantile| rejoin.quantile_us(quantile) / 1e3);
        format!(", back after p50 {p50:.0} ms, max {max:.0} ms")
    } else {
        String::new()
    };
    let counts = [counted(*deaths, "death"), counted(*hangs, "hang"), counted(*restarts, "restart")];
    let shown = told.iter().take(SHOWN).map(|loss| ("", loss.clone()));
    [("faults", format!("{}{back}", counts.join(", ")))].into_iter().chain(shown).collect()
}

/// What befell the agents, for programs.
fn fault_json(faults: &Faults) -> Value {
    let Faults { deaths, hangs, restarts, rejoin, told } = faults;
    json!({
        "deaths": deaths,
        "hangs": hangs,
        "restarts": restarts,
        "rejoin": rejoin.times_json(),
        "told": told,
    })
}

/// What the clock did, for programs.
fn clock_json(statistics: &Statistics, punctuality: &Punctuality) -> Value {
    json!({
        "rate": punctuality.rate,
        "achieved_rate": punctuality.achieved_rate(),
        "skipped_periods": punctuality.skipped,
        "dropped_rate": statistics.dropped_rate(),
        "late_rate": statistics.late_rate(),
        "missed_decisions": statistics.missed_of_due().0,
        "missed_rate": statistics.missed_rate(),
        "missed_ticks": punctuality.missed,
        "begins_late": punctuality.begins.times_json(),
        "acts_after_deadline": punctuality.acts.times_json(),
    })
}

/// What the clock did, for people.
fn clock_lines(statistics: &Statistics, punctuality: &Punctuality) -> Vec<(&'static str, String)> {
    let ((missed, due), missed_rate) = (statistics.missed_of_due(), statistics.missed_rate());
    let Punctuality { rate, skipped, begins, acts, .. } = punctuality;
    let losses = statistics.dropped_rate().zip(statistics.late_rate()).map(|(dropped, late)| {
        ("lost", format!("{:.2} % dropped by the links, {:.2} % late", 100.0 * dropped, 100.0 * late))
    });
    let slowest = punctuality.slowest().map(|(agent, ticks)| {
        format!(", most by agent-{agent}, in {}; the last action was repeated", counted(ticks, "tick"))
    });
    let slowest = slowest.unwrap_or_default();
    let clock = [
        ("missed", format!("{missed} of {due} decisions ({:.2} %){slowest}", 100.0 * missed_rate)),
        (
            "rate",
            format!(
                "{:.2} Hz of {rate}, {} left out",
                punctuality.achieved_rate(),
                counted(*skipped, "period")
            ),
        ),
        ("jitter", format!("periods begin late by {}", times(begins))),
        ("", format!("actions are out after the deadline by {}", times(acts))),
    ];
    losses.into_iter().chain(clock).collect()
}

/// A quantile of the tick time in microseconds, to the nanosecond it is known to.
fn tick_us(statistics: &Statistics, quantile: f64) -> f64 {
    statistics.tick_times().quantile_us(quantile)
}

/// Quantiles, for people.
fn times(of: &Distribution) -> String {
    if of.count() == 0 {
        return "none was in time".to_owned();
    }
    let [p50, p99, max] = [0.5, 0.99, 1.0].map(|quantile| of.quantile_us(quantile));
    format!("p50 {p50:.0} us, p99 {p99:.0} us, max {max:.0} us")
}
