//! Gradients against candle's autograd.

use super::*;
use crate::nn::{ActorKind, Dims, Networks, PredictorSpec, Sharing, TensorSpec, critic_tensors};
use crate::rng::{Draws, Purpose};
use crate::train::parameters::Parameters;
use candle_core::{DType, Device, Tensor, Var};
use candle_nn::rnn::{RNN, gru, lstm};
use candle_nn::{Linear, Module, VarBuilder};
use proptest::prelude::*;
use std::collections::HashMap;

fn numbers(seed: u64, n: usize) -> Vec<f32> {
    let mut draws = Draws::new(seed, Purpose::Reset, 0, 0);
    (0..n).map(|_| draws.between(-2.0, 2.0) as f32).collect()
}

fn dims(joint: usize, predicted: usize, n_actions: usize) -> Dims {
    Dims { task: "toy".to_string(), n_agents: 2, joint, predicted, n_actions }
}

/// The weights of a network as candle's variables, `[outputs, inputs]`, by layer and tensor.
struct Oracle(Vec<(String, Var)>);

impl Oracle {
    fn new(parameters: &Parameters) -> Oracle {
        let variables = parameters.tensors().map(|(spec, values)| {
            let tensor = Tensor::from_slice(values, &spec.shape[..], &Device::Cpu).unwrap();
            let tensor =
                if spec.shape.len() == 2 { tensor.t().unwrap().contiguous().unwrap() } else { tensor };
            let name = spec.name.rsplitn(3, '.').take(2).collect::<Vec<_>>();
            (format!("{}.{}", name[1], name[0]), Var::from_tensor(&tensor).unwrap())
        });
        Oracle(variables.collect())
    }

    fn get(&self, name: &str) -> Tensor {
        self.0.iter().find(|(of, _)| of == name).unwrap().1.as_tensor().clone()
    }

    fn linear(&self, layer: &str) -> Linear {
        Linear::new(self.get(&format!("{layer}.weight")), Some(self.get(&format!("{layer}.bias"))))
    }

    fn cell(&self, layer: &str) -> (usize, VarBuilder<'static>) {
        let names = ["weight_ih", "weight_hh", "bias_ih", "bias_hh"];
        let tensors: HashMap<_, _> =
            names.map(|name| (format!("{name}_l0"), self.get(&format!("{layer}.{name}")))).into();
        let hidden = tensors["weight_hh_l0"].dim(1).unwrap();
        (hidden, VarBuilder::from_tensors(tensors, DType::F32, &Device::Cpu))
    }

    /// The outputs `[steps, rows, outputs]` of `x` `[steps, rows, inputs]`.
    fn forward(&self, x: &Tensor) -> Tensor {
        let first = self.linear("fc1").forward(x).unwrap().relu().unwrap();
        let second = match self.0[2].0.split('.').next().unwrap() {
            "fc2" => self.linear("fc2").forward(&first).unwrap().relu().unwrap(),
            "gru" => {
                let (hidden, weights) = self.cell("gru");
                let cell = gru(hidden, hidden, Default::default(), weights).unwrap();
                over_time(&cell, &first, |state| state.h().clone())
            }
            _ => {
                let (hidden, weights) = self.cell("lstm");
                let cell = lstm(hidden, hidden, Default::default(), weights).unwrap();
                over_time(&cell, &first, |state| state.h().clone())
            }
        };
        self.linear("out").forward(&second).unwrap()
    }
}

fn over_time<C: RNN>(cell: &C, x: &Tensor, hidden: impl Fn(&C::State) -> Tensor) -> Tensor {
    let (steps, rows, _) = x.dims3().unwrap();
    let mut state = cell.zero_state(rows).unwrap();
    let states = (0..steps).map(|step| {
        state = cell.step(&x.get(step).unwrap(), &state).unwrap();
        hidden(&state)
    });
    Tensor::stack(&states.collect::<Vec<_>>(), 0).unwrap()
}

/// Compares outputs and gradients of the loss `sum(d * outputs)` for random `d`.
fn agrees(
    specs: Vec<TensorSpec>,
    (steps, rows): (usize, usize),
    seed: u64,
    forward: impl FnOnce(&Flat, &[f32], &dyn Fn(usize) -> Vec<f32>, &mut Flat) -> Vec<f32>,
) -> Result<(), TestCaseError> {
    let mut parameters = Parameters::untrained(specs, seed);
    let inputs = parameters.specs[0].shape[0];
    let x = numbers(seed, steps * rows * inputs);
    let derivative = |len: usize| numbers(seed ^ 1, len);
    let Parameters { values, gradient, .. } = &mut parameters;
    let out = forward(values, &x, &derivative, gradient);

    let oracle = Oracle::new(&parameters);
    let x = Tensor::from_slice(&x, (steps, rows, inputs), &Device::Cpu).unwrap();
    let expected = oracle.forward(&x);
    let d = Tensor::from_vec(derivative(out.len()), expected.dims(), &Device::Cpu).unwrap();
    close("outputs", &out, &expected)?;
    let gradients = (expected * d).unwrap().sum_all().unwrap().backward().unwrap();
    for (at, (name, variable)) in oracle.0.iter().enumerate() {
        let expected = gradients.get(variable.as_tensor()).unwrap();
        let expected = if expected.rank() == 2 { expected.t().unwrap() } else { expected.clone() };
        close(name, parameters.gradient.tensor(at), &expected)?;
    }
    Ok(())
}

/// Agreement to 1e-4 of the norm.
fn close(what: &str, found: &[f32], expected: &Tensor) -> Result<(), TestCaseError> {
    let expected: Vec<f32> = expected.flatten_all().unwrap().to_vec1().unwrap();
    prop_assert_eq!(found.len(), expected.len(), "{}", what);
    let norm = |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>().sqrt();
    let error = norm(&mut found.iter().zip(&expected).map(|(a, b)| a - b));
    let size = norm(&mut expected.iter().copied());
    prop_assert!(error <= 1e-4 * size + 1e-6, "{}: error {} of {}", what, error, size);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn critics(rows in 1usize..40, inputs in 1usize..40, hidden in 1usize..70, seed in any::<u64>()) {
        let specs = critic_tensors(Sharing::Separate, 0, inputs, hidden);
        agrees(specs, (1, rows), seed, |weights, x, d, gradient| {
            let mut network = Mlp::default();
            let out = network.forward(weights, rows, x).to_vec();
            network.backward(weights, rows, x, &d(out.len()), gradient);
            out
        })?;
    }

    #[test]
    fn actors(
        gru in any::<bool>(),
        steps in 1usize..8,
        rows in 1usize..13,
        joint in 1usize..30,
        hidden in 1usize..50,
        n_actions in 1usize..8,
        seed in any::<u64>(),
    ) {
        let kind = if gru { ActorKind::Gru } else { ActorKind::Mlp };
        let networks = Networks { hidden, ..Networks::paper(kind) };
        let specs = networks.actor_tensors(1, &dims(joint, 1, n_actions));
        agrees(specs, (steps, rows), seed, |weights, x, d, gradient| {
            let mut network = ActorNetwork::new(kind);
            let out = network.forward(weights, steps, rows, x).to_vec();
            network.backward(weights, steps, rows, x, &d(out.len()), gradient);
            out
        })?;
    }

    #[test]
    fn predictors(
        steps in 1usize..8,
        rows in 1usize..13,
        joint in 1usize..30,
        hidden in 1usize..50,
        predicted in 1usize..20,
        seed in any::<u64>(),
    ) {
        let spec = PredictorSpec { hidden, ..PredictorSpec::paper("maro") };
        agrees(spec.tensors(&dims(joint, predicted, 1)), (steps, rows), seed, |weights, x, d, gradient| {
            let mut network = Lstm::default();
            let out = network.forward(weights, steps, rows, x).to_vec();
            network.backward(weights, steps, rows, x, &d(out.len()), gradient);
            out
        })?;
    }
}
