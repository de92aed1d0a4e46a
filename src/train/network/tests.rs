//! Gradients against candle's autograd.

use super::*;
use crate::base::rng::{Draws, Purpose};
use crate::nn::{ActorKind, Dims, Networks, PredictorSpec, Sharing, critic};
use crate::train::parameters::Parameters;
use proptest::prelude::*;

fn numbers(seed: u64, n: usize) -> Vec<f32> {
    let mut draws = Draws::new(seed, Purpose::Reset, 0, 0);
    (0..n).map(|_| draws.between(-2.0, 2.0) as f32).collect()
}

fn dims(joint: usize, predicted: usize, n_actions: usize) -> Dims {
    Dims { task: "toy".to_string(), n_agents: 2, joint, predicted, n_actions, agents: Vec::new() }
}

/// Compares outputs and gradients of the loss `sum(d * outputs)` for random `d`.
fn agrees(network: &Network, (steps, rows): (usize, usize), seed: u64) -> Result<(), TestCaseError> {
    let mut parameters = Parameters::untrained(network, seed);
    let skip = parameters.specs.iter().position(|spec| spec.name.ends_with("skip.weight"));
    if let Some(tensor) = skip {
        parameters
            .values
            .tensor_mut(tensor)
            .iter_mut()
            .zip(numbers(seed, 1 << 12))
            .for_each(|(w, new)| *w = new);
    }
    let Parameters { specs, values, gradient, .. } = &parameters;
    let x = numbers(seed, steps * rows * specs[0].shape[0]);
    let pass = |backend| {
        let (mut passes, mut gradient) = (Passes::new(backend, network), gradient.clone());
        let out = passes.forward(values, steps, rows, &x).to_vec();
        passes.backward(values, &x, &numbers(seed ^ 1, out.len()), &mut gradient);
        (out, gradient)
    };
    let ((out, gradient), (expected, expected_gradient)) = (pass(Backend::Native), pass(Backend::Candle));
    close("outputs", &out, &expected)?;
    for (at, spec) in specs.iter().enumerate() {
        close(&spec.name, gradient.tensor(at), expected_gradient.tensor(at))?;
    }
    Ok(())
}

/// Agreement to 1e-4 of the norm.
fn close(what: &str, found: &[f32], expected: &[f32]) -> Result<(), TestCaseError> {
    prop_assert_eq!(found.len(), expected.len(), "{}", what);
    let norm = |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>().sqrt();
    let error = norm(&mut found.iter().zip(expected).map(|(a, b)| a - b));
    let size = norm(&mut expected.iter().copied());
    prop_assert!(error <= 1e-4 * size + 1e-6, "{}: error {} of {}", what, error, size);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn critics(rows in 1usize..40, inputs in 1usize..40, hidden in 1usize..70, seed in any::<u64>()) {
        agrees(&critic(Sharing::Separate, 0, inputs, hidden), (1, rows), seed)?;
    }

    #[test]
    fn actors(
        gru in any::<bool>(),
        shared in any::<bool>(),
        steps in 1usize..8,
        rows in 1usize..13,
        joint in 1usize..30,
        hidden in 1usize..50,
        n_actions in 1usize..8,
        seed in any::<u64>(),
    ) {
        let kind = if gru { ActorKind::Gru } else { ActorKind::Mlp };
        let sharing = if shared { Sharing::Shared } else { Sharing::Separate };
        let networks = Networks { hidden, sharing, ..Networks::paper(kind) };
        agrees(&networks.actor(1, &dims(joint, 1, n_actions)), (steps, rows), seed)?;
    }

    #[test]
    fn predictors(
        steps in 1usize..8,
        rows in 1usize..13,
        joint in 1usize..30,
        hidden in 1usize..50,
        predicted in 1usize..20,
        skip in any::<bool>(),
        seed in any::<u64>(),
    ) {
        let spec = PredictorSpec { hidden, skip, ..PredictorSpec::paper("maro") };
        agrees(&spec.network(&dims(joint, predicted, 1)), (steps, rows), seed)?;
    }
}
