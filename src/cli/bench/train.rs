//! `bench train`: how fast training is, and where the time goes.

use std::time::Duration;

use clap::Args;
use serde_json::json;

use super::compare::Output;
use super::{median, some_seconds};
use crate::base::error::Result;
use crate::bus::Wait;
use crate::cli::{keep_candle_to_its_thread, table, tell, train};
use crate::supervisor::{InProcess, Processes, Team, signals};
use crate::train::{Backend, Config, Layer, Preset, Throughput, Trainer, matmul_rate, test_duration};

/// Training: env steps/s, where the time goes, and a comparison with candle
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench train
  vamaro-swarm bench train --tasks spread-xy-12 --seconds 10 --json

Each figure is the median over the rounds; each round measures everything in
turn. The time includes rollouts by agent processes, and updates of the policy
and the value-aware predictor. What another predictor and the tests add is
listed separately.")]
pub struct BenchTrain {
    /// Tasks to train; by default one of each of the paper's settings
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "hear-see,spread-xy-4")]
    tasks: Vec<String>,

    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 3.0, value_parser = some_seconds)]
    seconds: f64,

    /// Rounds of measurements
    #[arg(long, value_name = "R", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    rounds: u32,

    /// Threads that learn [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    threads: Option<u32>,

    /// Collect experience without agent processes
    #[arg(long)]
    in_process: bool,

    #[command(flatten)]
    output: Output,
}

/// What is measured of a task.
struct Measured {
    config: Config,
    episode_steps: usize,
    /// Floating-point operations of the matrix products of an update.
    flop: f64,
    native: Vec<Throughput>,
    candle: Vec<Throughput>,
    /// With MARO beside the value-aware predictor.
    both: Vec<Throughput>,
    test: Vec<Duration>,
}

impl BenchTrain {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        keep_candle_to_its_thread()?;
        signals::install()?;
        let threads = train::threads(self.threads);
        let mut measured = Vec::new();
        for task in &self.tasks {
            measured.push(Measured::begin(task, threads)?);
        }
        let mut rates = Vec::new();
        for round in 1..=self.rounds {
            rates.push(matmul_rate(threads, Duration::from_secs_f64(self.seconds / 10.0)));
            for measured in &mut measured {
                tell(&format!("round {round} of {}: {}", self.rounds, measured.config.task));
                measured.measure(&self, threads)?;
            }
        }
        let rate = median(rates);
        let tasks: Vec<_> = measured.iter().map(|measured| measured.json(rate, threads)).collect();
        let result = json!({ "threads": threads, "matmul_gflop_per_s": rate / 1e9, "tasks": tasks });
        self.output.print(result, || self.text(&measured, rate, threads))
    }

    fn text(&self, measured: &[Measured], rate: f64, threads: usize) -> String {
        let columns: Vec<_> = measured.iter().map(|measured| measured.column(rate, threads)).collect();
        let rows = FIGURES.iter().enumerate().map(|(at, (_, name))| {
            std::iter::once((*name).to_owned())
                .chain(columns.iter().map(|column| column[at].clone()))
                .collect()
        });
        let header: Vec<&str> =
            std::iter::once("").chain(measured.iter().map(|measured| &measured.config.task[..])).collect();
        let table = table(&header, rows);
        let processes = if self.in_process { "in-process" } else { "agents as processes" };
        format!(
            "{threads} threads, {processes}; median of {} rounds of {} s\nmatmul 250 x 256 x 256   {:.0} GFLOP/s\n\n{table}",
            self.rounds,
            self.seconds,
            rate / 1e9
        )
    }
}

/// What is said of a task: the name for programs, and the line for people.
const FIGURES: [(&str, &str); 16] = [
    ("env_steps_per_s", "env steps/s"),
    ("candle_env_steps_per_s", "the same with --backend candle"),
    ("ratio_to_candle", "ratio to candle, rollouts included"),
    ("update_ratio_to_candle", "ratio to candle of the update alone"),
    ("update_ms", "one update and its rollout, ms"),
    ("rollout_ms", "  rollout, new weights, ms"),
    ("actors_ms", "  actors, ms"),
    ("critics_ms", "  critics, ms"),
    ("predictors_ms", "  predictors, ms"),
    ("other_ms", "  other: waiting for a thread, ms"),
    ("update_gflop", "GFLOP of an update"),
    ("gflop_per_s", "GFLOP/s, rollouts included"),
    ("share_of_matmul", "  share of the matmul rate"),
    ("update_gflop_per_s", "GFLOP/s of the update alone"),
    ("maro_ms", "maro beside value-aware, ms an update"),
    ("tests_ms", "tests every 50k env steps, ms an update"),
];

impl Measured {
    fn begin(task: &str, threads: usize) -> Result<Measured> {
        let config = config(task, "value-aware", Backend::Native)?;
        let trainer = Trainer::new(config.clone(), threads)?;
        let steps = trainer.task().spec().episode_steps;
        let flop = trainer.learner().flop_per_update(config.batch_episodes, steps, config.replay_batch);
        let (native, candle, both, test) = Default::default();
        Ok(Measured { config, episode_steps: steps, flop, native, candle, both, test })
    }

    /// One round: everything in turn.
    fn measure(&mut self, bench: &BenchTrain, threads: usize) -> Result<()> {
        let both = config(&self.config.task, "value-aware,maro", Backend::Native)?;
        let candle = config(&self.config.task, "value-aware", Backend::Candle)?;
        self.native.push(bench.measure(&self.config, threads)?);
        self.candle.push(bench.measure(&candle, threads)?);
        self.both.push(bench.measure(&both, threads)?);
        self.test.push(test_duration(&both, threads)?);
        Ok(())
    }

    /// The round with the median throughput.
    fn native(&self) -> Throughput {
        let mut rounds = self.native.clone();
        rounds.sort_by(|a, b| a.env_steps_per_second().total_cmp(&b.env_steps_per_second()));
        rounds[rounds.len() / 2]
    }

    /// In the order of [`FIGURES`].
    fn values(&self, rate: f64, threads: usize) -> [f64; FIGURES.len()] {
        let per_second =
            |rounds: &[Throughput]| median(rounds.iter().map(Throughput::env_steps_per_second).collect());
        let per_update =
            |rounds: &[Throughput]| median(rounds.iter().map(|round| ms(round.per_update())).collect());
        let learning =
            |rounds: &[Throughput]| median(rounds.iter().map(|round| ms(round.learning())).collect());
        let native = self.native();
        let updates = native.updates as f64;
        let part = |busy: Duration| ms(busy) / updates / threads as f64;
        let (whole, rollout) = (ms(native.per_update()), ms(native.rollout) / updates);
        let [actors, critics, predictors] =
            [native.busy.actors, native.busy.critics, native.busy.predictors].map(part);
        let with_rollouts = self.flop / (whole * 1e-3);
        let updates_between_tests =
            self.config.test_interval as f64 / (self.config.update_every * self.episode_steps) as f64;
        [
            per_second(&self.native),
            per_second(&self.candle),
            per_second(&self.native) / per_second(&self.candle),
            learning(&self.candle) / learning(&self.native),
            whole,
            rollout,
            actors,
            critics,
            predictors,
            whole - rollout - actors - critics - predictors,
            self.flop / 1e9,
            with_rollouts / 1e9,
            with_rollouts / rate,
            self.flop / ((whole - rollout) * 1e-3) / 1e9,
            per_update(&self.both) - per_update(&self.native),
            median(self.test.iter().map(|test| ms(*test)).collect()) / updates_between_tests,
        ]
    }

    fn column(&self, rate: f64, threads: usize) -> Vec<String> {
        let write = |((key, _), value): (&(&str, &str), f64)| match *key {
            "share_of_matmul" => format!("{:.0} %", 100.0 * value),
            key if key.ends_with("_ms") => format!("{value:.2}"),
            "ratio_to_candle" | "update_ratio_to_candle" | "update_gflop" => format!("{value:.2}"),
            _ => format!("{value:.0}"),
        };
        FIGURES.iter().zip(self.values(rate, threads)).map(write).collect()
    }

    fn json(&self, rate: f64, threads: usize) -> serde_json::Value {
        let values = FIGURES.iter().zip(self.values(rate, threads));
        let values = values.map(|((key, _), value)| ((*key).to_owned(), json!(value)));
        let task = ("task".to_owned(), json!(self.config.task));
        std::iter::once(task).chain(values).collect::<serde_json::Map<_, _>>().into()
    }
}

impl BenchTrain {
    fn measure(&self, config: &Config, threads: usize) -> Result<Throughput> {
        let mut trainer = Trainer::new(config.clone(), threads)?;
        let (agents, policy) = (trainer.agents(), trainer.policy()?);
        if self.in_process {
            self.measure_with(&mut trainer, &mut InProcess::new(&agents, &policy)?)
        } else {
            self.measure_with(&mut trainer, &mut Processes::start(&agents, &policy, Wait::Block)?)
        }
    }

    fn measure_with(&self, trainer: &mut Trainer, agents: &mut impl Team) -> Result<Throughput> {
        Throughput::measure(trainer, agents, Duration::from_secs_f64(self.seconds))
    }
}

fn config(task: &str, predictors: &str, backend: Backend) -> Result<Config> {
    let mut layer = Layer::new("--tasks");
    layer.set("task", &format!("{task:?}"));
    layer.set("predictors", predictors);
    let config = Config::resolve(Preset::Paper, &[layer])?;
    Ok(Config { backend, ..config })
}

fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}
