//! `bench rate`: how a team does against the clock.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use super::compare::Output;
use crate::agent::{AgentSettings, Registry};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::base::stats::{ci95, mean};
use crate::bus::Wait;
use crate::cli::{probability, rate, table, tell};
use crate::environment::Task;
use crate::link::Links;
use crate::nn::Policy;
use crate::plot::{Figure, Panel, Point, Series};
use crate::supervisor::{
    Conduct, InProcess, Ledger, Processes, Punctuality, Session, Statistics, Team, signals,
};

/// Real time: return, late observations and missed decisions at each rate
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench rate --svg rate.svg
  vamaro-swarm bench rate --tasks hear-see --p 0.2 --rates 50,100,200

The built-in policies play the same episodes with the same links in lockstep and
at each rate. Lost: how much lower the return is than in lockstep, mean over the
episodes with its 95 % interval. Late: share of observations that links
delivered but agents did not have at the deadline, among those sent to agents
that decided in time. Missed: share of decisions that were not out when the
period ended; the last action was repeated. Left out: share of periods whose
deadline passed before they could begin; the worlds stand still in them, so the
rate reached is below the rate asked for. Acts: how long after the deadline
actions were out, for those in time.")]
pub struct BenchRate {
    /// Tasks, by id or alias
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "hear-see,spread-xy-4")]
    tasks: Vec<String>,

    /// Probabilities that an observation is delivered
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "1,0.2", value_parser = probability)]
    p: Vec<f64>,

    /// Ticks per second to ask for
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "100,300,1000,2000,3000,5000,10000,20000",
        value_parser = rate)]
    rates: Vec<f64>,

    /// Episodes at each rate
    #[arg(long, value_name = "E", default_value_t = 100, value_parser = clap::value_parser!(u64).range(2..=100_000))]
    episodes: u64,

    /// How processes wait
    #[arg(long, value_enum, default_value_t)]
    wait: Wait,

    /// Draw the figures into this file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,

    #[command(flatten)]
    output: Output,
}

/// A team over links of one level.
struct Measured {
    task: Task,
    p: f64,
    lockstep: Statistics,
    /// In the order of the rates that were reached.
    at_rates: Vec<(Statistics, Punctuality)>,
}

impl BenchRate {
    /// Runs the command.
    pub fn run(mut self) -> Result<()> {
        signals::install()?;
        self.rates.sort_by(f64::total_cmp);
        let svg = self.svg.as_deref().map(AtomicFile::create).transpose()?;
        let tasks = self.tasks.iter().map(|name| Task::parse(name)).collect::<Result<Vec<Task>>>()?;
        let cases = tasks.iter().flat_map(|task| self.p.iter().map(move |p| (task, *p)));
        let measured = cases.map(|(task, p)| self.measure(task, p)).collect::<Result<Vec<Measured>>>()?;
        if let Some(mut file) = svg {
            let path = file.path().to_owned();
            let drawing = figure(&tasks, &measured).to_semilog_svg();
            file.write_all(drawing.as_bytes()).map_err(|e| Error::io("write", &path, e))?;
            file.commit()?;
        }
        let cases = measured.iter().map(Measured::json).collect::<Vec<Value>>();
        let result = json!({ "episodes": self.episodes, "wait": self.wait, "cases": cases });
        self.output.print(result, || {
            const HEADER: [&str; 12] = [
                "task",
                "p",
                "Hz",
                "reached",
                "return",
                "+-",
                "return lost",
                "+-",
                "late %",
                "missed %",
                "left out %",
                "acts p50, p99 us",
            ];
            table(&HEADER, measured.iter().flat_map(Measured::rows))
        })
    }

    fn measure(&self, task: &Task, p: f64) -> Result<Measured> {
        let settings = AgentSettings::of(task.spec());
        let policy = settings.policy.load(task.spec())?;
        let settings = AgentSettings { imputer: Registry::default().choose(None, &policy)?, ..settings };
        let lockstep = self.play(task, p, &mut InProcess::new(&settings, &policy)?)?;
        let at_rate = |rate: &f64| self.play_at(*rate, task, p, &settings, &policy);
        let mut at_rates = self.rates.iter().map(at_rate).collect::<Result<Vec<_>>>()?;
        at_rates.sort_by(|(_, a), (_, b)| a.achieved_rate().total_cmp(&b.achieved_rate()));
        Ok(Measured { task: task.clone(), p, lockstep, at_rates })
    }

    fn play_at(
        &self,
        rate: f64,
        task: &Task,
        p: f64,
        settings: &AgentSettings,
        policy: &Policy,
    ) -> Result<(Statistics, Punctuality)> {
        tell(&format!("{}, p = {p}, {rate} Hz", task.id()));
        let mut team =
            Processes::start(settings, policy, Conduct { rate: Some(rate), ..Conduct::from(self.wait) })?;
        let statistics = self.play(task, p, &mut team)?;
        let punctuality = team.punctuality().expect("a team with a rate has a clock");
        Ok((statistics, punctuality.clone()))
    }

    fn play(&self, task: &Task, p: f64, team: &mut impl Team) -> Result<Statistics> {
        const SEED: u64 = 0;
        let mut session = Session::new(task.environment(1), Links::level(p), SEED);
        let mut ledger = Ledger::default();
        session.play(team, self.episodes, &mut [&mut ledger])?;
        Ok(ledger.into_statistics())
    }
}

impl Measured {
    /// How much less the return is than in lockstep, over the same episodes: mean, and half its 95 % interval.
    fn lost(&self, statistics: &Statistics) -> (f64, f64) {
        let pairs = self.lockstep.episodes().iter().zip(statistics.episodes());
        let lost: Vec<f64> = pairs.map(|(all, some)| all.episode_return - some.episode_return).collect();
        (mean(&lost), ci95(&lost).expect("there are two episodes or more"))
    }

    fn json(&self) -> Value {
        let at_rates = self.at_rates.iter().map(|(statistics, punctuality)| {
            let (lost, lost_ci95) = self.lost(statistics);
            json!({
                "rate": punctuality.rate,
                "achieved_rate": punctuality.achieved_rate(),
                "skipped_rate": punctuality.skipped_rate(),
                "return_mean": statistics.return_mean(),
                "return_ci95": statistics.return_ci95(),
                "lost_mean": lost,
                "lost_ci95": lost_ci95,
                "delivery_rate": statistics.delivery_rate(),
                "dropped_rate": statistics.dropped_rate(),
                "late_rate": statistics.late_rate(),
                "missed_rate": statistics.missed_rate(),
                "begins_late": punctuality.begins.times_json(),
                "acts_after_deadline": punctuality.acts.times_json(),
            })
        });
        json!({
            "task": self.task.id(),
            "agents": self.task.spec().n_agents(),
            "p": self.p,
            "lockstep": {
                "return_mean": self.lockstep.return_mean(),
                "return_ci95": self.lockstep.return_ci95(),
                "delivery_rate": self.lockstep.delivery_rate(),
            },
            "at_rates": at_rates.collect::<Vec<Value>>(),
        })
    }

    fn rows(&self) -> Vec<Vec<String>> {
        let case = [self.task.id().to_owned(), self.p.to_string()];
        let returned = |statistics: &Statistics| {
            let ci95 = statistics.return_ci95().expect("there are two episodes or more");
            [statistics.return_mean(), ci95].map(|value| format!("{value:.1}"))
        };
        let lockstep =
            [&case[..], &["lockstep".to_owned(), String::new()], &returned(&self.lockstep)].concat();
        let at_rates = self.at_rates.iter().map(|(statistics, punctuality)| {
            let (lost, lost_ci95) = self.lost(statistics);
            let clock = [punctuality.rate.to_string(), format!("{:.1}", punctuality.achieved_rate())];
            let [p50, p99] = [0.5, 0.99].map(|quantile| punctuality.acts.quantile_us(quantile));
            let percent = |share: f64| format!("{:.2}", 100.0 * share);
            let rest = [
                format!("{lost:.1}"),
                format!("{lost_ci95:.1}"),
                statistics.late_rate().map(percent).unwrap_or_default(),
                percent(statistics.missed_rate()),
                percent(punctuality.skipped_rate()),
                if punctuality.acts.count() > 0 { format!("{p50:.0}, {p99:.0}") } else { String::new() },
            ];
            [&case[..], &clock, &returned(statistics), &rest].concat()
        });
        std::iter::once(lockstep).chain(at_rates).collect()
    }

    fn returns(&self) -> Vec<Series> {
        let lockstep = self.lockstep.return_mean();
        vec![
            self.series("in lockstep", |_| (lockstep, None)),
            self.series("by the clock", |statistics| (statistics.return_mean(), statistics.return_ci95())),
        ]
    }

    fn late_percent(&self) -> Vec<Series> {
        vec![
            self.series("by the clock", |statistics| {
                (100.0 * statistics.late_rate().unwrap_or(f64::NAN), None)
            }),
        ]
    }

    fn missed_percent(&self) -> Vec<Series> {
        vec![self.series("by the clock", |statistics| (100.0 * statistics.missed_rate(), None))]
    }

    /// A value, NaN if there is none, and half its 95 % interval against the rate that was reached.
    fn series(&self, of: &str, value: impl Fn(&Statistics) -> (f64, Option<f64>)) -> Series {
        let points = self.at_rates.iter().map(|(statistics, punctuality)| {
            let (y, ci95) = value(statistics);
            Point { x: punctuality.achieved_rate(), y, band: ci95.map(|ci95| (y - ci95, y + ci95)) }
        });
        Series { name: format!("p = {}, {of}", self.p), points: points.collect() }
    }
}

/// Returns, what is late and what is missed, against the rate that was reached: a column for each task.
fn figure(tasks: &[Task], measured: &[Measured]) -> Figure {
    type What = fn(&Measured) -> Vec<Series>;
    let rows: [(&str, What); 3] = [
        ("return", Measured::returns),
        ("late, % of observations", Measured::late_percent),
        ("missed, % of decisions", Measured::missed_percent),
    ];
    let panels = rows.iter().flat_map(|(what, series)| {
        tasks.iter().map(move |task| Panel {
            title: task.id().to_owned(),
            x_label: "ticks/s reached".to_owned(),
            // Returns of different tasks have nothing in common.
            y_label: if *what == "return" { format!("return, {}", task.id()) } else { (*what).to_owned() },
            series: measured
                .iter()
                .filter(|measured| measured.task.id() == task.id())
                .flat_map(series)
                .collect(),
            ..Panel::default()
        })
    });
    Figure { title: "Teams against the clock".to_owned(), panels: panels.collect() }
}
