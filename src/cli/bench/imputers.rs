//! `bench imputers`: what each imputer takes of an agent's tick.

use std::time::Duration;

use clap::Args;
use serde_json::json;

use super::compare::Output;
use super::some_seconds;
use crate::agent::imputer::Setup;
use crate::agent::{Agent, AgentSettings, Inbox, PolicySource, Registry};
use crate::base::distribution::Distribution;
use crate::base::error::Result;
use crate::bus::now_ns;
use crate::cli::{table, tell};
use crate::environment::Task;
use crate::latency::repeat;
use crate::nn::Policy;
use crate::supervisor::signals;

/// Imputers: the time each takes before and after the action is out
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench imputers
  vamaro-swarm bench imputers --task hear-see --imputers maro,dynamics --json

One agent of the built-in policy, on one thread in one world, receives nothing.
A decision is fuse (the imputer) and the actor; predict comes after the action
is out. The multiply-adds are those of the networks that the imputer runs in a
tick. Each figure is the median of all calls; everything is measured in turn,
three times.")]
pub struct BenchImputers {
    /// The task
    #[arg(long, value_name = "T", default_value = "spread-xy-4")]
    task: String,

    /// The imputers [default: all that the policy supports, except particles, shared-dice, given-dynamics and
    /// given-teammates]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    imputers: Vec<String>,

    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 0.3, value_parser = some_seconds)]
    seconds: f64,

    #[command(flatten)]
    output: Output,
}

/// How often everything is measured in turn.
const ROUNDS: u32 = 3;

/// What is measured of an imputer.
#[derive(Default)]
struct Measured {
    multiply_adds: usize,
    fuse: Distribution,
    decision: Distribution,
    predict: Distribution,
}

impl BenchImputers {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let task = Task::parse(&self.task)?;
        let policy = PolicySource::Builtin.load(task.spec())?;
        let registry = Registry::default();
        let imputers: Vec<String> = if self.imputers.is_empty() {
            registry.names(&policy).map(str::to_owned).collect()
        } else {
            self.imputers.iter().map(|name| registry.choose(Some(name), &policy)).collect::<Result<_>>()?
        };
        let mut measured: Vec<_> = imputers.into_iter().map(|name| (name, Measured::default())).collect();
        for round in 1..=ROUNDS {
            tell(&format!("round {round} of {ROUNDS}"));
            for (name, measured) in &mut measured {
                measured.play(
                    &task,
                    &policy,
                    name,
                    Duration::from_secs_f64(self.seconds / f64::from(ROUNDS)),
                )?;
            }
        }
        let imputers = measured.iter().map(|(name, measured)| {
            let [fuse, decision, predict] = measured.medians();
            json!({ "imputer": name, "multiply_adds": measured.multiply_adds, "fuse_us": fuse,
                    "decision_us": decision, "predict_us": predict })
        });
        self.output.print(json!({ "task": task.id(), "imputers": imputers.collect::<Vec<_>>() }), || {
            let rows = measured.iter().map(|(name, measured)| {
                let times = measured.medians().map(|us| format!("{us:.2}"));
                let work = format!("{:.2}", measured.multiply_adds as f64 / 1e6);
                std::iter::once(name.clone()).chain(times).chain([work]).collect()
            });
            let header = ["imputer", "fuse", "decision", "predict", "million multiply-adds"];
            let table = table(&header, rows);
            format!("{}, one thread; medians of {} s, microseconds\n\n{table}", task.id(), self.seconds)
        })
    }
}

impl Measured {
    /// Fuse, decision, predict, us.
    fn medians(&self) -> [f64; 3] {
        [&self.fuse, &self.decision, &self.predict].map(|times| times.quantile_us(0.5))
    }

    fn play(&mut self, task: &Task, policy: &Policy, name: &str, longest: Duration) -> Result<()> {
        let settings = AgentSettings { imputer: name.to_owned(), ..AgentSettings::of(task.spec()) };
        let setup = Setup {
            spec: task.spec(),
            policy,
            agent: 0,
            worlds: 1,
            longest_delay: 0,
            seed: 0,
            greedy: false,
        };
        self.multiply_adds = settings.registry.make(name, &setup)?.multiply_adds();
        let mut agent = Agent::with_policy(&settings, policy, 0)?;
        let (n_agents, horizon) = (task.spec().n_agents(), task.spec().episode_steps as u32);
        let observation = vec![0.1; task.spec().padded_obs_dim()];
        let mut step = 0;
        repeat(longest, |counts| {
            if step % horizon == 0 {
                agent.begin_episode(1);
            }
            let began = now_ns();
            agent.fuse(0, &observation, &Inbox::of(n_agents, |_| None));
            let fused = now_ns();
            agent.act(u64::from(step / horizon), step % horizon, &[0.5])?;
            let acted = now_ns();
            agent.predict();
            if counts {
                self.fuse.record(fused - began);
                self.decision.record(acted - began);
                self.predict.record(now_ns() - acted);
            }
            step += 1;
            Ok(())
        })
    }
}
