//! `bench agent`: what a decision takes.

use std::hint::black_box;
use std::time::Duration;

use clap::Args;
use serde_json::json;

use super::compare::Output;
use super::some_seconds;
use crate::agent::{Agent, AgentSettings, Inbox, PREFERRED, Received, dims};
use crate::base::distribution::Distribution;
use crate::base::error::Result;
use crate::bus::now_ns;
use crate::cli::{keep_candle_to_its_thread, policy_source, table, tell};
use crate::environment::Task;
use crate::latency::repeat;
use crate::nn::reference::CandleNetwork;
use crate::nn::{ActorKind, Networks, Policy, kernels};
use crate::supervisor::signals;

/// One agent: a decision, compared with reading its weights once and with candle
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench agent
  vamaro-swarm bench agent --task hear-see --seconds 2 --json
  vamaro-swarm bench agent --policy team.toml

An agent with the paper's networks, with an MLP and with a GRU as actor, on one
thread, in one world and in ten. A decision is fuse and act; predict comes after
it: the predictor, and the part of a GRU's next step that depends on its state
alone. All observations are delivered. For comparison the weights of each are
read once, and candle computes the same networks, with the whole actor in one
piece. Each figure is the median of all calls; everything is measured in turn,
three times. --policy adds an agent with a policy of yours, which holds the last
value received.")]
pub struct BenchAgent {
    /// The task
    #[arg(long, value_name = "T", default_value = "spread-xy-4")]
    task: String,

    /// Also measure this policy of the task, such as one of ONNX files
    #[arg(long, value_name = "POLICY")]
    policy: Option<String>,

    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 0.3, value_parser = some_seconds)]
    seconds: f64,

    #[command(flatten)]
    output: Output,
}

/// How often everything is measured in turn.
const ROUNDS: u32 = 3;

/// What is measured of an agent with one kind of actor in so many worlds.
#[derive(Default)]
struct Measured {
    imputer: Distribution,
    policy: Distribution,
    decision: Distribution,
    predict: Distribution,
    /// The weights that a decision takes, read once.
    stream_decision: Distribution,
    /// Those of what follows it.
    stream_predict: Distribution,
    candle_actor: Distribution,
    candle_predictor: Distribution,
}

impl BenchAgent {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        keep_candle_to_its_thread()?;
        signals::install()?;
        let task = Task::parse(&self.task)?;
        let untrained = |kind| Policy::untrained(&dims(task.spec()), 0, Networks::paper(kind));
        let mut policies = vec![untrained(ActorKind::Mlp)?, untrained(ActorKind::Gru)?];
        let given =
            self.policy.as_deref().map(|name| policy_source(name, 0)?.load(task.spec())).transpose()?;
        let ours = policies.len();
        policies.extend(given);
        let cases = (0..policies.len()).flat_map(|policy| [1, 10].map(|rows| (policy, rows)));
        let mut measured: Vec<_> = cases.map(|case| (case, Measured::default())).collect();
        for round in 1..=ROUNDS {
            tell(&format!("round {round} of {ROUNDS}"));
            for ((at, rows), measured) in &mut measured {
                let policy = &policies[*at];
                let longest = Duration::from_secs_f64(self.seconds / f64::from(ROUNDS));
                if *at < ours {
                    measured.agent(&task, policy, PREFERRED, *rows, longest)?;
                    measured.weights(policy, longest)?;
                    measured.candle(&task, policy, *rows, longest)?;
                } else {
                    measured.agent(&task, policy, "hold", *rows, longest)?;
                }
            }
        }
        let name = |at: usize| {
            let kind = policies[at].networks().actor.to_string();
            if at < ours { kind } else { format!("{kind} of --policy") }
        };
        let cases: Vec<_> =
            measured.iter().map(|((at, rows), measured)| measured.json(&name(*at), *rows)).collect();
        self.output.print(json!({ "task": task.id(), "cases": cases }), || {
            let columns: Vec<_> = measured.iter().map(|(_, measured)| measured.values()).collect();
            let rows = FIGURES.iter().enumerate().map(|(at, (_, name))| {
                let words = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
                let values = columns.iter().map(|column| words(column[at]));
                std::iter::once((*name).to_owned()).chain(values).collect()
            });
            let names = measured.iter().map(|((at, rows), _)| format!("{}, {rows}", name(*at)));
            let header: Vec<String> = std::iter::once("actor, worlds".to_owned()).chain(names).collect();
            let header: Vec<&str> = header.iter().map(String::as_str).collect();
            let table = table(&header, rows);
            format!("{}, one thread; medians of {} s, microseconds\n\n{table}", task.id(), self.seconds)
        })
    }
}

/// What is said of a case: the name for programs, and the line for people.
const FIGURES: [(&str, &str); 13] = [
    ("decision_us", "decision"),
    ("imputer_us", "  imputer (fuse)"),
    ("policy_us", "  policy (act)"),
    ("stream_us", "its weights read once"),
    ("ratio_to_stream", "  ratio of the decision to that"),
    ("candle_us", "candle's actor"),
    ("ratio_to_candle", "  ratio of the decision to that"),
    ("predict_us", "predict, after the decision"),
    ("predict_stream_us", "its weights read once"),
    ("predict_ratio_to_stream", "  ratio of predict to that"),
    ("predict_candle_us", "candle's predictor"),
    ("both_us", "decision and predict"),
    ("both_ratio_to_candle", "  ratio to candle's actor and predictor"),
];

impl Measured {
    /// In the order of [`FIGURES`]; `None` of what was not measured.
    fn values(&self) -> [Option<f64>; FIGURES.len()] {
        let us = |times: &Distribution| if times.count() > 0 { times.quantile_us(0.5) } else { f64::NAN };
        let (decision, predict) = (us(&self.decision), us(&self.predict));
        let (stream, candle) = (us(&self.stream_decision), us(&self.candle_actor));
        let predict_stream = us(&self.stream_predict);
        [
            decision,
            us(&self.imputer),
            us(&self.policy),
            stream,
            decision / stream,
            candle,
            decision / candle,
            predict,
            predict_stream,
            predict / predict_stream,
            us(&self.candle_predictor),
            decision + predict,
            (decision + predict) / (candle + us(&self.candle_predictor)),
        ]
        .map(|value| value.is_finite().then_some(value))
    }

    fn json(&self, actor: &str, worlds: usize) -> serde_json::Value {
        let values = FIGURES.iter().zip(self.values());
        let values = values.map(|((key, _), value)| ((*key).to_owned(), json!(value)));
        let case = [("actor".to_owned(), json!(actor)), ("worlds".to_owned(), json!(worlds))];
        case.into_iter().chain(values).collect::<serde_json::Map<_, _>>().into()
    }

    /// The agent's own tick.
    fn agent(
        &mut self,
        task: &Task,
        policy: &Policy,
        imputer: &str,
        worlds: usize,
        longest: Duration,
    ) -> Result<()> {
        let imputer = imputer.to_owned();
        let settings = AgentSettings { imputer, worlds, ..AgentSettings::of(task.spec()) };
        let mut agent = Agent::with_policy(&settings, policy, 0)?;
        let observation: Vec<f32> = numbers(task.spec().padded_obs_dim());
        let received = Some(Received { age: 0, observation: &observation });
        agent.begin_episode(worlds);
        let draws = vec![0.5; worlds];
        let mut step = 0;
        repeat(longest, |counts| {
            step += 1;
            let began = now_ns();
            for world in 0..worlds {
                agent.fuse(world, &observation, &Inbox::of(task.spec().n_agents(), |_| received));
            }
            let fused = now_ns();
            agent.act(0, step, &draws)?;
            let acted = now_ns();
            agent.predict();
            if counts {
                self.imputer.record(fused - began);
                self.policy.record(acted - fused);
                self.decision.record(acted - began);
                self.predict.record(now_ns() - acted);
            }
            Ok(())
        })
    }

    /// The least that one row takes: each weight is read.
    fn weights(&mut self, policy: &Policy, longest: Duration) -> Result<()> {
        let weights = |is_read: fn(&str) -> bool| -> Vec<&[f32]> {
            let tensors = policy.tensors().filter(|(spec, _)| is_read(&spec.name));
            tensors.map(|(_, tensor)| tensor.values()).collect()
        };
        let decision = weights(|name| name.starts_with("actors.0.") && !is_prepared(name));
        let predict = weights(|name| {
            name.starts_with("predictors.") || name.starts_with("actors.0.") && is_prepared(name)
        });
        let read = |weights: &[&[f32]]| {
            let began = now_ns();
            weights.iter().for_each(|values| _ = black_box(kernels::sum(values)));
            now_ns() - began
        };
        repeat(longest, |counts| {
            let (decision, predict) = (read(&decision), read(&predict));
            if counts {
                self.stream_decision.record(decision);
                self.stream_predict.record(predict);
            }
            Ok(())
        })
    }

    /// The same networks in candle.
    fn candle(&mut self, task: &Task, policy: &Policy, rows: usize, longest: Duration) -> Result<()> {
        let mut actor = CandleNetwork::actor(policy, 0, rows);
        let mut predictor = CandleNetwork::predictor(policy, PREFERRED, rows);
        let inputs = numbers(rows * task.spec().joint_dim());
        repeat(longest, |counts| {
            let began = now_ns();
            black_box(actor.step(rows, &inputs, &[]));
            let acted = now_ns();
            black_box(predictor.step(rows, &inputs, &[]));
            if counts {
                self.candle_actor.record(acted - began);
                self.candle_predictor.record(now_ns() - acted);
            }
            Ok(())
        })
    }
}

/// Numbers in [-1, 1] without a pattern that matters.
fn numbers(len: usize) -> Vec<f32> {
    (0..len).map(|at| (at as f32 * 0.37).sin()).collect()
}

/// Whether the weights of this name are applied to the state of an actor after a decision, for the next one.
fn is_prepared(name: &str) -> bool {
    ["gru.weight_hh", "gru.bias_hh"].iter().any(|end| name.ends_with(end))
}
