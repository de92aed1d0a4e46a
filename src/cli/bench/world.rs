//! `bench world`: how fast worlds are.

use std::hint::black_box;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::json;

use super::compare::Output;
use super::{median, some_seconds};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::cli::{table, tell};
use crate::environment::{Environment, Outcome, Spec, Task};
use crate::supervisor::signals;

/// Worlds: env steps/s on one core
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench world
  vamaro-swarm bench world --tasks spread-xy-4,spread-xy-32 --json

Whole episodes in one world on one thread: a reset, and 25 steps with random
actions, the rewards and the f32 observations of all agents, before the first
step and after each. Each figure is the median over the rounds; each round
measures all tasks in turn.")]
pub struct BenchWorld {
    /// Tasks to play [default: all that `vamaro-swarm tasks` lists]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    tasks: Vec<String>,

    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = some_seconds)]
    seconds: f64,

    /// Rounds of measurements
    #[arg(long, value_name = "R", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    rounds: u32,

    #[command(flatten)]
    output: Output,
}

impl BenchWorld {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let tasks = if self.tasks.is_empty() {
            Task::all()
        } else {
            self.tasks.iter().map(|name| Task::parse(name)).collect::<Result<_>>()?
        };
        let mut rates = vec![Vec::new(); tasks.len()];
        for round in 1..=self.rounds {
            tell(&format!("round {round} of {}", self.rounds));
            for (task, rates) in tasks.iter().zip(&mut rates) {
                rates.push(env_steps_per_second(task, Duration::from_secs_f64(self.seconds))?);
            }
        }
        let measured: Vec<_> = tasks.iter().zip(rates.into_iter().map(median)).collect();
        let tasks = measured.iter().map(|(task, rate)| {
            json!({ "task": task.id(), "agents": task.spec().n_agents(), "env_steps_per_s": rate, "step_us": 1e6 / rate })
        });
        self.output.print(json!({ "tasks": tasks.collect::<Vec<_>>() }), || {
            let rows = measured.iter().map(|(task, rate)| {
                vec![
                    task.id().to_owned(),
                    task.spec().n_agents().to_string(),
                    format!("{:.2} M", rate / 1e6),
                    format!("{:.0}", 1e9 / rate),
                ]
            });
            let table = table(&["task", "agents", "env steps/s", "ns a step"], rows);
            format!("one thread; median of {} rounds of {} s\n\n{table}", self.rounds, self.seconds)
        })
    }
}

/// Plays for so long, after a tenth of it to warm up.
fn env_steps_per_second(task: &Task, longest: Duration) -> Result<f64> {
    let spec = task.spec();
    let mut world = World {
        environment: task.environment(1),
        spec: spec.clone(),
        observations: vec![0.0; spec.n_agents() * spec.padded_obs_dim()],
        actions: vec![0; spec.n_agents() * spec.action_width()],
        outcome: Outcome::of(1, spec.n_agents()),
    };
    let mut rate = 0.0;
    for longest in [longest / 10, longest] {
        let (began, mut episodes) = (Instant::now(), 0);
        while began.elapsed() < longest {
            signals::check_stop()?;
            // Looking at the clock costs as much as some steps.
            for _ in 0..16 {
                black_box(world.play(episodes)?);
                episodes += 1;
            }
        }
        rate = (episodes * spec.episode_steps as u64) as f64 / began.elapsed().as_secs_f64();
    }
    Ok(rate)
}

/// One world, with all that is needed to play in it.
struct World {
    environment: Box<dyn Environment>,
    spec: Spec,
    observations: Vec<f32>,
    actions: Vec<u32>,
    outcome: Outcome,
}

impl World {
    /// Plays an episode at random; its return.
    fn play(&mut self, episode: u64) -> Result<f64> {
        let mut draws = Draws::new(0, Purpose::Action, episode, 0);
        let (mut episode_return, width) = (0.0, self.spec.action_width());
        self.environment.reset(0, 0, episode)?;
        self.observe()?;
        for _ in 0..self.spec.episode_steps {
            let actions = self.actions.chunks_exact_mut(width);
            for (agent, action) in self.spec.agents.iter().zip(actions) {
                agent.actions.draw(&mut draws, action);
            }
            self.environment.step(&self.actions, &[true], &mut self.outcome)?;
            episode_return += self.spec.team_reward(&self.outcome.rewards);
            self.observe()?;
        }
        Ok(episode_return)
    }

    fn observe(&mut self) -> Result<()> {
        self.environment.observe(1, &mut self.observations)?;
        black_box(&self.observations);
        Ok(())
    }
}
