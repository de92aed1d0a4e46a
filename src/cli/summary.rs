//! The summary of `spawn`, for people and for programs.

use serde_json::{Value, json};

use crate::agents::{AgentSettings, PolicySource};
use crate::link::Links;
use crate::nn::Policy;
use crate::supervisor::{Audit, Statistics};
use crate::world::Task;

/// What was asked for and what came of it.
pub(super) struct Summary {
    task: Task,
    links: Links,
    settings: AgentSettings,
    origin: String,
    steps: u64,
    in_process: bool,
    episodes: u64,
    statistics: Statistics,
    audit: Option<Audit>,
}

impl Summary {
    pub(super) fn new(
        task: &Task,
        links: &Links,
        settings: &AgentSettings,
        policy: &Policy,
        in_process: bool,
        episodes: u64,
    ) -> Summary {
        Summary {
            task: task.clone(),
            links: links.clone(),
            settings: settings.clone(),
            origin: policy.meta().origin.clone(),
            steps: policy.meta().steps,
            in_process,
            episodes,
            statistics: Statistics::default(),
            audit: None,
        }
    }

    pub(super) fn set_results(&mut self, statistics: Statistics, audit: Option<Audit>) {
        (self.statistics, self.audit) = (statistics, audit);
    }

    /// Says what is about to run; both p and the drop probability, which are so easily confused.
    pub(super) fn first_line(&self) -> String {
        let agents = self.task.n_agents();
        format!(
            "{}: {agents} {}{}, {}, {} episodes\n",
            self.task.id(),
            if agents == 1 { "agent" } else { "agents" },
            if self.in_process { " in-process" } else { " as processes" },
            self.link_words(),
            self.episodes
        )
    }

    fn link_words(&self) -> String {
        match &self.links {
            Links::Level(p) => {
                format!("p = {} (probability of delivery), drop = {}", short(*p), short(1.0 - p))
            }
            Links::Matrix(_) => "links by a communication matrix (p = C[i][j], drop = 1 - p)".to_owned(),
            Links::Uniform => "p ~ U(0, 1) per episode, drop = 1 - p".to_owned(),
            Links::Asymmetric => "p ~ U(0, 1) per link and episode, drop = 1 - p".to_owned(),
            Links::Dynamic => "p ~ U(0, 1) per link and 5 steps, drop = 1 - p".to_owned(),
        }
    }

    pub(super) fn text(&self) -> String {
        let Summary { settings, statistics, .. } = self;
        let interval = statistics.return_ci95().map_or(String::new(), |ci| format!(" +- {ci:.1}"));
        let mut lines = vec![
            ("policy", self.policy_words()),
            (
                "imputer",
                format!(
                    "{}, actions {}",
                    settings.imputer,
                    if settings.greedy { "greedy" } else { "sampled" }
                ),
            ),
            ("return", format!("{:.1}{interval} (mean, 95 % interval)", statistics.return_mean())),
        ];
        if let Some(rate) = statistics.delivery_rate() {
            lines.push(("delivered", format!("{:.2} % of the observations sent at t >= 1", 100.0 * rate)));
            let error = statistics.imputation_rmse();
            let error = error.map_or("nothing was imputed".to_owned(), |rmse| format!("{rmse:.4} RMSE"));
            lines.push(("imputation", error));
        }
        let us = |quantile| statistics.tick_time(quantile).as_secs_f64() * 1e6;
        let seconds = statistics.elapsed().as_secs_f64();
        lines.push((
            "tick",
            format!(
                "p50 {:.0} us, p99 {:.0} us; {:.0} ticks/s over {:.2} s, {} {} a tick",
                us(0.5),
                us(0.99),
                statistics.ticks() as f64 / seconds,
                seconds,
                settings.worlds,
                if settings.worlds == 1 { "world" } else { "worlds" }
            ),
        ));
        lines.extend(self.audit.map(|audit| ("audit", audit.to_string())));
        lines.into_iter().map(|(name, words)| format!("{name:<12}{words}\n")).collect()
    }

    fn policy_words(&self) -> String {
        match &self.settings.policy {
            PolicySource::Untrained(_) => self.settings.policy.to_string(),
            source => format!("{source}: {}, {} M env steps", self.origin, self.steps as f64 / 1e6),
        }
    }

    /// The same for programs, see `docs/formats.md`.
    pub(super) fn json(&self) -> Value {
        let Summary { task, settings, statistics, .. } = self;
        let (p, mode) = match &self.links {
            Links::Level(p) => (Some(*p), "level"),
            Links::Matrix(_) => (None, "matrix"),
            Links::Uniform => (None, "uniform"),
            Links::Asymmetric => (None, "asymmetric"),
            Links::Dynamic => (None, "dynamic"),
        };
        let us = |quantile| statistics.tick_time(quantile).as_secs_f64() * 1e6;
        json!({
            "version": env!("CARGO_PKG_VERSION"),
            "task": task.id(),
            "agents": task.n_agents(),
            "in_process": self.in_process,
            "links": mode,
            "p": p,
            "drop": p.map(|p| 1.0 - p),
            "policy": settings.policy.to_string(),
            "policy_origin": self.origin,
            "policy_steps": self.steps,
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
            "tick_p50_us": us(0.5),
            "tick_p99_us": us(0.99),
            "elapsed_s": statistics.elapsed().as_secs_f64(),
            "audit": self.audit,
        })
    }
}

/// A probability without the noise of 1 - 0.8.
fn short(p: f64) -> f64 {
    (p * 1e12).round() / 1e12
}
