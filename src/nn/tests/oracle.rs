//! The same networks built from candle-nn's layers: the reference forward pass.

use super::*;
use candle_core::{DType, Device, Tensor};
use candle_nn::rnn::{GRU, GRUState, LSTM, LSTMState, RNN};
use candle_nn::{Linear, Module, VarBuilder};

/// A tensor of the policy as candle has it: `[outputs, inputs]`.
fn tensor(policy: &Policy, name: &str) -> Tensor {
    let (spec, tensor) = policy.tensors().find(|(spec, _)| spec.name == name).unwrap();
    let tensor = Tensor::from_slice(tensor.values(), &spec.shape[..], &Device::Cpu).unwrap();
    match spec.shape.len() {
        2 => tensor.t().unwrap().contiguous().unwrap(),
        _ => tensor,
    }
}

fn linear(policy: &Policy, layer: &str) -> Linear {
    let tensor = |name| tensor(policy, &format!("{layer}.{name}"));
    Linear::new(tensor("weight"), Some(tensor("bias")))
}

fn cell(policy: &Policy, layer: &str) -> (usize, VarBuilder<'static>) {
    let names = ["weight_ih", "weight_hh", "bias_ih", "bias_hh"];
    let tensors = names.map(|name| (format!("{name}_l0"), tensor(policy, &format!("{layer}.{name}"))));
    let hidden = tensors[0].1.dim(1).unwrap();
    (hidden, VarBuilder::from_tensors(tensors.into(), DType::F32, &Device::Cpu))
}

pub fn input(rows: usize, values: &[f32]) -> Tensor {
    Tensor::from_slice(values, (rows, values.len() / rows), &Device::Cpu).unwrap()
}

pub fn output(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

/// An actor of candle's layers, with the hidden state of a GRU inside.
pub struct Actor {
    fc1: Linear,
    middle: Middle,
    out: Linear,
    id: Option<Vec<f32>>,
}

enum Middle {
    Linear(Linear),
    Gru(GRU, GRUState),
}

impl Actor {
    pub fn new(policy: &Policy, agent: usize, rows: usize) -> Actor {
        let prefix = policy.networks().actor_prefix(agent);
        let layer = |name| format!("{prefix}.{name}");
        let middle = match policy.networks().actor {
            ActorKind::Mlp => Middle::Linear(linear(policy, &layer("fc2"))),
            ActorKind::Gru => {
                let (hidden, weights) = cell(policy, &layer("gru"));
                let gru = candle_nn::gru(hidden, hidden, Default::default(), weights).unwrap();
                let state = gru.zero_state(rows).unwrap();
                Middle::Gru(gru, state)
            }
        };
        let id = (policy.networks().sharing == Sharing::Shared).then(|| {
            let ids = policy.dims().n_agents;
            (0..ids * rows).map(|at| if at % ids == agent { 1.0 } else { 0.0 }).collect()
        });
        Actor { fc1: linear(policy, &layer("fc1")), middle, out: linear(policy, &layer("out")), id }
    }

    pub fn forward(&mut self, rows: usize, inputs: &[f32]) -> Vec<f32> {
        let inputs = match &self.id {
            Some(id) => Tensor::cat(&[input(rows, inputs), input(rows, id)], 1).unwrap(),
            None => input(rows, inputs),
        };
        let first = self.fc1.forward(&inputs).unwrap().relu().unwrap();
        let second = match &mut self.middle {
            Middle::Linear(fc2) => fc2.forward(&first).unwrap().relu().unwrap(),
            Middle::Gru(gru, state) => {
                *state = gru.step(&first, state).unwrap();
                state.h().clone()
            }
        };
        output(&self.out.forward(&second).unwrap())
    }
}

/// A predictor of candle's layers, with its state inside. It knows no held dims.
pub struct Predictor {
    fc1: Linear,
    lstm: LSTM,
    state: LSTMState,
    out: Linear,
}

impl Predictor {
    pub fn new(policy: &Policy, name: &str, rows: usize) -> Predictor {
        let layer = |layer| format!("predictors.{name}.{layer}");
        let (hidden, weights) = cell(policy, &layer("lstm"));
        let lstm = candle_nn::lstm(hidden, hidden, Default::default(), weights).unwrap();
        let state = lstm.zero_state(rows).unwrap();
        Predictor { fc1: linear(policy, &layer("fc1")), lstm, state, out: linear(policy, &layer("out")) }
    }

    pub fn step(&mut self, rows: usize, inputs: &[f32]) -> Vec<f32> {
        let first = self.fc1.forward(&input(rows, inputs)).unwrap().relu().unwrap();
        self.state = self.lstm.step(&first, &self.state).unwrap();
        output(&self.out.forward(self.state.h()).unwrap())
    }
}
