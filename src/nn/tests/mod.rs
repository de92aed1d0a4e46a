//! The nn room against its references: candle's networks, and every way in which a file can be wrong.

mod files;
#[cfg(feature = "candle")]
mod imports;
mod inference;
mod policy;

use super::*;
use crate::base::rng::{Draws, Purpose};

/// A small task.
fn dims() -> Dims {
    Dims { task: "toy".to_string(), n_agents: 3, joint: 7, predicted: 6, n_actions: 5, agents: Vec::new() }
}

/// Small networks with every kind of tensor in them.
fn networks(actor: ActorKind, sharing: Sharing) -> Networks {
    let held = vec![1, 4];
    let predictors = vec![
        PredictorSpec { hidden: 5, ..PredictorSpec::paper("maro") },
        PredictorSpec { hidden: 6, held, ..PredictorSpec::paper("value-aware") },
    ];
    Networks { sharing, hidden: 8, predictors, ..Networks::paper(actor) }
}

fn policy(actor: ActorKind, sharing: Sharing) -> Policy {
    Policy::untrained(&dims(), 11, networks(actor, sharing)).unwrap()
}

fn numbers(seed: u64, n: usize) -> Vec<f32> {
    let mut draws = Draws::new(seed, Purpose::Reset, 0, 0);
    (0..n).map(|_| draws.between(-2.0, 2.0) as f32).collect()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn values(policy: &Policy) -> Vec<f32> {
    let mut values = vec![0.0; policy.n_values()];
    policy.copy_values(&mut values);
    values
}
