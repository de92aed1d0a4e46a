//! The same networks built from candle-nn's layers: the forward pass that ours is checked against and compared with.

use candle_core::{DType, Device, Tensor};
use candle_nn::rnn::{GRU, GRUState, LSTM, LSTMState, RNN};
use candle_nn::{Linear, Module, VarBuilder};

use super::{ActorKind, Policy, Sharing};

/// Shapes follow from the policy, and nothing else can fail on a CPU.
const SHAPES_FIT: &str = "inputs and weights are those of one network";

/// An actor of candle's layers, with the hidden state of a GRU inside.
#[derive(Debug)]
pub struct CandleActor {
    fc1: Linear,
    middle: Middle,
    out: Linear,
    id: Option<Vec<f32>>,
}

#[derive(Debug)]
enum Middle {
    Linear(Linear),
    Gru(GRU, GRUState),
}

impl CandleActor {
    /// The actor of an agent, for `rows` rows that begin an episode.
    pub fn new(policy: &Policy, agent: usize, rows: usize) -> CandleActor {
        let prefix = policy.networks().actor_prefix(agent);
        let layer = |name| format!("{prefix}.{name}");
        let middle = match policy.networks().actor {
            ActorKind::Mlp => Middle::Linear(linear(policy, &layer("fc2"))),
            ActorKind::Gru => {
                let (hidden, weights) = cell(policy, &layer("gru"));
                let gru = candle_nn::gru(hidden, hidden, Default::default(), weights).expect(SHAPES_FIT);
                let state = gru.zero_state(rows).expect(SHAPES_FIT);
                Middle::Gru(gru, state)
            }
        };
        let id = (policy.networks().sharing == Sharing::Shared).then(|| {
            let ids = policy.dims().n_agents;
            (0..ids * rows).map(|at| if at % ids == agent { 1.0 } else { 0.0 }).collect()
        });
        CandleActor { fc1: linear(policy, &layer("fc1")), middle, out: linear(policy, &layer("out")), id }
    }

    /// The logits `[rows, n_actions]` of the inputs `[rows, joint]`.
    pub fn forward(&mut self, rows: usize, inputs: &[f32]) -> Vec<f32> {
        let inputs = match &self.id {
            Some(id) => Tensor::cat(&[input(rows, inputs), input(rows, id)], 1).expect(SHAPES_FIT),
            None => input(rows, inputs),
        };
        let first = self.fc1.forward(&inputs).expect(SHAPES_FIT).relu().expect(SHAPES_FIT);
        let second = match &mut self.middle {
            Middle::Linear(fc2) => fc2.forward(&first).expect(SHAPES_FIT).relu().expect(SHAPES_FIT),
            Middle::Gru(gru, state) => {
                *state = gru.step(&first, state).expect(SHAPES_FIT);
                state.h().clone()
            }
        };
        output(&self.out.forward(&second).expect(SHAPES_FIT))
    }
}

/// A predictor of candle's layers, with its state inside. It knows no held dims.
#[derive(Debug)]
pub struct CandlePredictor {
    fc1: Linear,
    lstm: LSTM,
    state: LSTMState,
    out: Linear,
    /// The number of acts, if it sees the own one.
    acts: usize,
}

impl CandlePredictor {
    /// The predictor of this name, which the policy must have, for `rows` rows that begin an episode.
    pub fn new(policy: &Policy, name: &str, rows: usize) -> CandlePredictor {
        let layer = |layer| format!("predictors.{name}.{layer}");
        let (hidden, weights) = cell(policy, &layer("lstm"));
        let lstm = candle_nn::lstm(hidden, hidden, Default::default(), weights).expect(SHAPES_FIT);
        let state = lstm.zero_state(rows).expect(SHAPES_FIT);
        let spec = policy.predictor(name).expect("the policy has this predictor").spec();
        let acts = spec.width(policy.dims()) - policy.dims().joint;
        CandlePredictor {
            fc1: linear(policy, &layer("fc1")),
            lstm,
            state,
            out: linear(policy, &layer("out")),
            acts,
        }
    }

    /// One step of the estimates `[rows, joint]` and acts `[rows]`, which only who sees them looks at: mean and raw
    /// log-std, `[rows, 2 * predicted]`.
    pub fn step(&mut self, rows: usize, estimates: &[f32], acts: &[usize]) -> Vec<f32> {
        let seen = match self.acts {
            0 => input(rows, estimates),
            width => {
                let one = |at: usize| if acts[at / width] == at % width { 1.0 } else { 0.0 };
                let acts: Vec<f32> = (0..rows * width).map(one).collect();
                Tensor::cat(&[input(rows, estimates), input(rows, &acts)], 1).expect(SHAPES_FIT)
            }
        };
        let first = self.fc1.forward(&seen).expect(SHAPES_FIT).relu().expect(SHAPES_FIT);
        self.state = self.lstm.step(&first, &self.state).expect(SHAPES_FIT);
        output(&self.out.forward(self.state.h()).expect(SHAPES_FIT))
    }
}

/// A tensor of the policy as candle has it: `[outputs, inputs]`.
fn tensor(policy: &Policy, name: &str) -> Tensor {
    let (spec, tensor) =
        policy.tensors().find(|(spec, _)| spec.name == name).expect("a policy has all tensors");
    let tensor = Tensor::from_slice(tensor.values(), &spec.shape[..], &Device::Cpu).expect(SHAPES_FIT);
    match spec.shape.len() {
        2 => tensor.t().expect(SHAPES_FIT).contiguous().expect(SHAPES_FIT),
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
    let hidden = tensors[0].1.dim(1).expect(SHAPES_FIT);
    (hidden, VarBuilder::from_tensors(tensors.into(), DType::F32, &Device::Cpu))
}

fn input(rows: usize, values: &[f32]) -> Tensor {
    Tensor::from_slice(values, (rows, values.len() / rows), &Device::Cpu).expect(SHAPES_FIT)
}

fn output(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().expect(SHAPES_FIT).to_vec1().expect(SHAPES_FIT)
}
