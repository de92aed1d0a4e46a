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
use crate::environment::{EPISODE_STEPS, Task, World};
use crate::supervisor::signals;

/// Worlds: env steps/s on one core
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench world
  vamaro-swarm bench world --tasks spread-xy-4,spread-blindfold-32 --rounds 5 --json

Whole episodes in one world on one thread: a reset, and 25 steps with random actions, the rewards
and the f32 observations of all agents, before the first step and after each. Each figure is the
median of the rounds, in each of which all tasks are measured in turn.")]
pub struct BenchWorld {
    /// Tasks to play [default: all that `vamaro-swarm tasks` lists]
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    tasks: Vec<String>,

    /// Seconds of each measurement
    #[arg(long, value_name = "S", default_value_t = 0.5, value_parser = some_seconds)]
    seconds: f64,

    /// Rounds
    #[arg(long, value_name = "R", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    rounds: u32,

    #[command(flatten)]
    output: Output,
}

impl BenchWorld {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        signals::install()?;
        let tasks = match self.tasks.is_empty() {
            true => Task::all(),
            false => self.tasks.iter().map(|name| Task::parse(name)).collect::<Result<_>>()?,
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
            json!({ "task": task.id(), "agents": task.n_agents(), "env_steps_per_s": rate, "step_us": 1e6 / rate })
        });
        self.output.print(json!({ "tasks": tasks.collect::<Vec<_>>() }), || {
            let rows = measured.iter().map(|(task, rate)| {
                vec![
                    task.id().to_owned(),
                    task.n_agents().to_string(),
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
    let mut world = World::new(task);
    let mut observations = vec![0.0; task.n_agents() * task.padded_obs_dim()];
    let mut rate = 0.0;
    for longest in [longest / 10, longest] {
        let (began, mut episodes) = (Instant::now(), 0);
        while began.elapsed() < longest {
            signals::check_stop()?;
            // Looking at the clock costs as much as some steps.
            for _ in 0..16 {
                black_box(play(&mut world, episodes, &mut observations));
                episodes += 1;
            }
        }
        rate = (episodes * EPISODE_STEPS as u64) as f64 / began.elapsed().as_secs_f64();
    }
    Ok(rate)
}

/// Plays an episode at random; its return.
fn play(world: &mut World, episode: u64, observations: &mut [f32]) -> f64 {
    let mut draws = Draws::new(0, Purpose::Action, episode, 0);
    let mut actions = vec![0; world.task().n_agents()];
    let mut episode_return = 0.0;
    world.reset(0, episode);
    observe(world, observations);
    for _ in 0..EPISODE_STEPS {
        for (agent, action) in actions.iter_mut().enumerate() {
            *action = draws.below(world.task().available_actions(agent)) as u8;
        }
        world.step(&actions);
        episode_return += world.team_reward();
        observe(world, observations);
    }
    episode_return
}

/// Writes what all agents observe, `[agents, observation]`.
fn observe(world: &World, observations: &mut [f32]) {
    let all = observations.chunks_exact_mut(world.task().padded_obs_dim());
    all.enumerate().for_each(|(agent, observation)| world.observe(agent, observation));
    black_box(observations);
}
