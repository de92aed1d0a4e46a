//! `bench`: what this machine reaches, one file per measurement.

mod agent;
mod compare;
#[cfg(feature = "hosts")]
mod hosts;
mod imputers;
mod latency;
mod rate;
mod spawn;
mod train;
mod world;

use clap::{Args, Subcommand};

use crate::base::error::Result;

/// Measure how fast this program is on this machine
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  vamaro-swarm bench latency
  vamaro-swarm bench train --json > before.json
  # what got slower since?
  vamaro-swarm bench train --compare before.json

Each has examples of its own: `vamaro-swarm bench latency --help`.")]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Training: env steps/s, where the time goes, and a comparison with candle
    Train(train::BenchTrain),
    /// Latency: hops between processes over our bus and other media, ticks, decisions
    Latency(latency::BenchLatency),
    /// Worlds: env steps/s on one core
    World(world::BenchWorld),
    /// One agent: a decision, compared with reading its weights once and with candle
    Agent(agent::BenchAgent),
    /// Imputers: the time each takes before and after the action is out
    Imputers(imputers::BenchImputers),
    /// Swarms: start-up, memory per agent, and how tick time grows
    Spawn(spawn::BenchSpawn),
    /// Real time: return, late observations and missed decisions at each rate
    Rate(rate::BenchRate),
}

impl Bench {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        match self.what {
            What::Train(command) => command.run(),
            What::Latency(command) => command.run(),
            What::World(command) => command.run(),
            What::Agent(command) => command.run(),
            What::Imputers(command) => command.run(),
            What::Spawn(command) => command.run(),
            What::Rate(command) => command.run(),
        }
    }
}

/// Too short a time measures nothing.
fn some_seconds(text: &str) -> std::result::Result<f64, String> {
    match super::train::seconds(text)? {
        seconds if seconds >= 0.1 => Ok(seconds),
        _ => Err("expected 0.1 seconds or more".to_owned()),
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    if values.len().is_multiple_of(2) { (values[middle - 1] + values[middle]) / 2.0 } else { values[middle] }
}
