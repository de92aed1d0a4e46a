//! The summary of `spawn`, for people and for programs.

use serde_json::{Value, json};

use crate::agents::{AgentSettings, PolicySource};
use crate::bus::Wait;
use crate::link::{Links, complement};
use crate::nn::Meta;
use crate::scheduling::Grants;
use crate::supervisor::{Audit, Statistics};
use crate::table::thousands;
use crate::world::Task;

/// What was asked for. With what came of it, it makes a summary.
pub(super) struct Summary<'a> {
    pub(super) task: &'a Task,
    pub(super) links: &'a Links,
    pub(super) comm_at_t0: bool,
    pub(super) settings: &'a AgentSettings,
    pub(super) policy: &'a Meta,
    /// `None` in-process, where nobody waits.
    pub(super) wait: Option<Wait>,
    /// What the processes were granted, if they asked for anything.
    pub(super) scheduling: Option<Grants>,
    pub(super) episodes: u64,
}

impl Summary<'_> {
    /// Says what runs; both p and the drop probability, which are so easily confused.
    pub(super) fn first_line(&self) -> String {
        let place = match (self.wait, self.task.n_agents()) {
            (None, _) => "in-process",
            (_, 1) => "as a process",
            _ => "as processes",
        };
        format!(
            "{}: {} {place}, {}{}, {}\n",
            self.task.id(),
            counted(self.task.n_agents() as u64, "agent"),
            self.link_words(),
            if self.comm_at_t0 { "" } else { " also at t = 0" },
            counted(self.episodes, "episode")
        )
    }

    fn link_words(&self) -> String {
        match self.links {
            Links::Level(p) => {
                format!("p = {} (probability of delivery), drop = {}", p, complement(*p))
            }
            Links::Matrix(_) => "links by a communication matrix (p = C[i][j], drop = 1 - p)".to_owned(),
            Links::Uniform => "p ~ U(0, 1) per episode, drop = 1 - p".to_owned(),
            Links::Asymmetric => "p ~ U(0, 1) per link and episode, drop = 1 - p".to_owned(),
            Links::Dynamic => "p ~ U(0, 1) per link and 5 steps, drop = 1 - p".to_owned(),
        }
    }

    /// The rest, for people.
    pub(super) fn text(&self, statistics: &Statistics, audit: Option<&Audit>) -> String {
        let actions = if self.settings.greedy { "greedy" } else { "sampled" };
        let returned = match statistics.return_ci95() {
            Some(ci) => format!("{:.1} +- {ci:.1} (mean, 95 % interval)", statistics.return_mean()),
            None => format!("{:.1} (one episode)", statistics.return_mean()),
        };
        let mut lines = vec![
            ("policy", self.policy_words()),
            ("imputer", format!("{}, actions {actions}", self.settings.imputer)),
            ("return", returned),
        ];
        if let Some(rate) = statistics.delivery_rate() {
            lines.push(("delivered", format!("{:.2} % of the observations sent at t >= 1", 100.0 * rate)));
            let error = statistics.imputation_rmse();
            let error = error.map_or("nothing was imputed".to_owned(), |rmse| format!("{rmse:.4} RMSE"));
            lines.push(("imputation", error));
        }
        lines.push(("tick", self.tick_words(statistics)));
        lines.extend(self.scheduling.as_ref().map(|grants| ("scheduling", grants.to_string())));
        lines.extend(audit.map(|audit| ("audit", audit.to_string())));
        lines.into_iter().map(|(name, words)| format!("{name:<12}{words}\n")).collect()
    }

    fn policy_words(&self) -> String {
        match &self.settings.policy {
            PolicySource::Untrained(_) => self.settings.policy.to_string(),
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
    pub(super) fn json(&self, statistics: &Statistics, audit: Option<&Audit>) -> Value {
        let Summary { task, settings, .. } = self;
        let p = if let Links::Level(p) = self.links { Some(*p) } else { None };
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "task": task.id(),
            "agents": task.n_agents(),
            "in_process": self.wait.is_none(),
            "wait": self.wait,
            "scheduling": self.scheduling,
            "links": self.links.name(),
            "p": p,
            "drop": p.map(complement),
            "matrix": self.links.matrix(),
            "comm_at_t0": self.comm_at_t0,
            "policy": settings.policy.to_string(),
            "policy_origin": self.policy.origin,
            "policy_steps": self.policy.steps,
            "imputer": settings.imputer.to_string(),
            "greedy": settings.greedy,
            "seed": settings.seed,
            "worlds": settings.worlds,
            "episodes": statistics.episodes().len(),
            "return_mean": statistics.return_mean(),
            "return_ci95": statistics.return_ci95(),
            "delivery_rate": statistics.delivery_rate(),
            "imputation_rmse": statistics.imputation_rmse(),
            "ticks": statistics.ticks(),
            "tick_p50_us": tick_us(statistics, 0.5),
            "tick_p99_us": tick_us(statistics, 0.99),
            "elapsed_s": statistics.elapsed().as_secs_f64(),
            "audit": audit,
        })
    }
}

/// A quantile of the tick time in microseconds, to the nanosecond it is known to.
fn tick_us(statistics: &Statistics, quantile: f64) -> f64 {
    statistics.tick_time(quantile).as_nanos() as f64 / 1e3
}

fn counted(n: u64, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}
