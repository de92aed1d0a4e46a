//! The same networks built from candle-nn's layers: the forward pass that ours is checked against and compared with.

use candle_core::{DType, Device, Result, Tensor};
use candle_nn::rnn::{GRU, GRUState, LSTM, LSTMState, RNN};
use candle_nn::{Linear, Module, VarBuilder};

use super::network::{Layer, Network};
use super::{Policy, Sharing};

/// Shapes follow from the policy, and nothing else can fail on a CPU.
const SHAPES_FIT: &str = "inputs and weights are those of one network";

/// A network of candle's layers, with the states of its cells inside.
#[derive(Debug)]
pub struct CandleNetwork {
    layers: Vec<CandleLayer>,
    /// The length of the one-hots behind the inputs.
    ones: usize,
    /// Where their one is, if it is always there.
    id: Option<usize>,
}

#[derive(Debug)]
enum CandleLayer {
    Linear { linear: Linear, relu: bool },
    Gru(GRU, GRUState),
    Lstm(LSTM, LSTMState),
    Skip(Linear),
}

impl CandleNetwork {
    /// The actor of an agent, for `rows` rows that begin an episode.
    pub fn actor(policy: &Policy, agent: usize, rows: usize) -> CandleNetwork {
        let network = policy.networks().actor(agent, policy.dims());
        let id = (policy.networks().sharing == Sharing::Shared).then_some(agent);
        CandleNetwork::new(policy, &network, id, rows).expect(SHAPES_FIT)
    }

    /// The predictor of this name, which the policy must have, likewise. It knows no held dims.
    pub fn predictor(policy: &Policy, name: &str, rows: usize) -> CandleNetwork {
        let spec = policy.predictor(name).expect("the policy has this predictor").spec();
        CandleNetwork::new(policy, &spec.network(policy.dims()), None, rows).expect(SHAPES_FIT)
    }

    fn new(policy: &Policy, network: &Network, id: Option<usize>, rows: usize) -> Result<CandleNetwork> {
        let tensors = policy.tensors().filter(|(spec, _)| network.owns(&spec.name));
        // candle has weights as `[outputs, inputs]`.
        let tensors = tensors.map(|(spec, tensor)| {
            let tensor = Tensor::from_slice(tensor.values(), &spec.shape[..], &Device::Cpu)?;
            if tensor.rank() == 2 { tensor.t()?.contiguous() } else { Ok(tensor) }
        });
        let tensors = tensors.collect::<Result<Vec<_>>>()?;
        let mut tensors = tensors.into_iter();
        let layers = network.layers.iter().map(|layer| {
            let mut next = || tensors.next().expect("every layer has its tensors");
            Ok(match *layer {
                Layer::Linear { relu, .. } => {
                    CandleLayer::Linear { linear: Linear::new(next(), Some(next())), relu }
                }
                Layer::Skip { .. } => CandleLayer::Skip(Linear::new(next(), None)),
                Layer::Gru(size) => {
                    let gru = candle_nn::gru(size, size, Default::default(), cell(next))?;
                    let state = gru.zero_state(rows)?;
                    CandleLayer::Gru(gru, state)
                }
                Layer::Lstm(size) => {
                    let lstm = candle_nn::lstm(size, size, Default::default(), cell(next))?;
                    let state = lstm.zero_state(rows)?;
                    CandleLayer::Lstm(lstm, state)
                }
            })
        });
        Ok(CandleNetwork { layers: layers.collect::<Result<_>>()?, ones: network.ones, id })
    }

    /// One step of the inputs `[rows, inputs]`, with the numbers of actions `[rows]` if the network sees them: the
    /// outputs `[rows, outputs]`.
    pub fn step(&mut self, rows: usize, inputs: &[f32], acts: &[usize]) -> Vec<f32> {
        self.advance(rows, inputs, acts).and_then(|out| out.flatten_all()?.to_vec1()).expect(SHAPES_FIT)
    }

    fn advance(&mut self, rows: usize, inputs: &[f32], acts: &[usize]) -> Result<Tensor> {
        let mut x = matrix(rows, inputs)?;
        if self.ones > 0 {
            let mut one_hots = vec![0.0; rows * self.ones];
            for (row, one_hot) in one_hots.chunks_exact_mut(self.ones).enumerate() {
                one_hot[self.id.unwrap_or_else(|| acts[row])] = 1.0;
            }
            x = Tensor::cat(&[x, matrix(rows, &one_hots)?], 1)?;
        }
        let seen = x.clone();
        for layer in &mut self.layers {
            x = match layer {
                CandleLayer::Linear { linear, relu: true } => linear.forward(&x)?.relu()?,
                CandleLayer::Linear { linear, relu: false } => linear.forward(&x)?,
                CandleLayer::Skip(linear) => (x + linear.forward(&seen)?)?,
                CandleLayer::Gru(gru, state) => {
                    *state = gru.step(&x, state)?;
                    state.h().clone()
                }
                CandleLayer::Lstm(lstm, state) => {
                    *state = lstm.step(&x, state)?;
                    state.h().clone()
                }
            };
        }
        Ok(x)
    }
}

/// The tensors of a cell by the names that candle has for them.
fn cell(mut next: impl FnMut() -> Tensor) -> VarBuilder<'static> {
    let names = ["weight_ih_l0", "weight_hh_l0", "bias_ih_l0", "bias_hh_l0"];
    let tensors = names.map(|name| (name.to_owned(), next()));
    VarBuilder::from_tensors(tensors.into(), DType::F32, &Device::Cpu)
}

fn matrix(rows: usize, values: &[f32]) -> Result<Tensor> {
    Tensor::from_slice(values, (rows, values.len() / rows), &Device::Cpu)
}
