//! What a network is made of: described once, for everybody who needs to know.
//!
//! The layers of a [`Network`] are read by [`Network::tensors`] for names, shapes and untrained values, by
//! [`Inference`](super::inference::Inference) in agents, by training (`train/network/`), and by candle's twins of the
//! two, which check them.

use crate::base::rng::{Draws, Purpose};

/// A network: its layers from input to output.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// The first part of the names of its tensors, such as `actors.0`.
    pub name: String,
    /// Which of all networks it is, for the addresses of its untrained values.
    pub(super) number: usize,
    /// The number of values that it sees.
    pub inputs: usize,
    /// The length of the one-hot that it sees behind them.
    pub ones: usize,
    /// Its layers, from input to output. The first and the last are linear; a skip may follow.
    pub layers: Vec<Layer>,
}

/// A layer of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// `x @ weight + bias`, and of that what is not negative if there is a `relu`.
    Linear {
        /// The middle part of the names of its tensors.
        name: &'static str,
        /// The width of a row of its input.
        inputs: usize,
        /// The width of a row of its output.
        outputs: usize,
        /// Whether a ReLU follows.
        relu: bool,
    },
    /// A GRU cell, called `gru`, with input and hidden state of this size. The state starts an episode at zero.
    Gru(usize),
    /// An LSTM cell, called `lstm`, likewise.
    Lstm(usize),
    /// A linear map of what the network sees, called `skip`, that is added to what it says. It has no bias.
    Skip {
        /// The width of a row of the network's input.
        inputs: usize,
        /// The width of a row of its output.
        outputs: usize,
    },
}

/// A tensor that a network must have.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorSpec {
    /// Its name, such as `actors.0.fc1.weight`.
    pub name: String,
    /// Its shape; a weight is `[inputs, outputs]`, a bias `[outputs]`.
    pub shape: Vec<usize>,
    /// Untrained values are uniform between minus and plus this (PyTorch's defaults).
    pub bound: f64,
    /// The address of its untrained values. It counts inside a network: adding an agent or a predictor
    /// changes no other network's weights, and all predictors start from the same ones, so that what they
    /// come to is compared like with like.
    pub number: u64,
}

impl Network {
    /// Its tensors, layer by layer; of a linear layer `weight` and `bias`, of a skip `weight`, of a cell `weight_ih`, `weight_hh`,
    /// `bias_ih` and `bias_hh`.
    pub fn tensors(&self) -> Vec<TensorSpec> {
        const TENSORS_PER_NETWORK: usize = 16;
        let tensors = self.layers.iter().flat_map(|layer| {
            // PyTorch takes the inverse square root of a linear layer's inputs, and of a cell's hidden size.
            // A skip starts at nothing: what imputes with an untrained one would amplify its own estimates.
            let bound = match layer {
                Layer::Skip { .. } => 0.0,
                layer => 1.0 / (layer.inputs() as f64).sqrt(),
            };
            layer.tensors().into_iter().map(move |(tensor, shape)| (layer.name(), tensor, shape, bound))
        });
        let tensors = tensors.enumerate().map(|(at, (layer, tensor, shape, bound))| {
            let name = format!("{}.{layer}.{tensor}", self.name);
            TensorSpec { name, shape, bound, number: (self.number * TENSORS_PER_NETWORK + at) as u64 }
        });
        tensors.collect()
    }

    /// Whether a tensor of this name is one of its own.
    pub(crate) fn owns(&self, tensor: &str) -> bool {
        tensor.strip_prefix(&self.name).is_some_and(|rest| rest.starts_with('.'))
    }
}

impl Layer {
    /// A linear layer.
    pub(super) fn linear(name: &'static str, inputs: usize, outputs: usize) -> Layer {
        Layer::Linear { name, inputs, outputs, relu: false }
    }

    /// A linear layer and a ReLU.
    pub(super) fn relu(name: &'static str, inputs: usize, outputs: usize) -> Layer {
        Layer::Linear { name, inputs, outputs, relu: true }
    }

    /// The number of its tensors.
    pub(crate) fn n_tensors(&self) -> usize {
        match self {
            Layer::Skip { .. } => 1,
            Layer::Linear { .. } => 2,
            Layer::Gru(_) | Layer::Lstm(_) => 4,
        }
    }

    fn name(&self) -> &'static str {
        match self {
            Layer::Linear { name, .. } => name,
            Layer::Gru(_) => "gru",
            Layer::Lstm(_) => "lstm",
            Layer::Skip { .. } => "skip",
        }
    }

    fn inputs(&self) -> usize {
        match *self {
            Layer::Linear { inputs, .. } | Layer::Skip { inputs, .. } => inputs,
            Layer::Gru(size) | Layer::Lstm(size) => size,
        }
    }

    fn tensors(&self) -> Vec<(&'static str, Vec<usize>)> {
        let (size, gates) = match *self {
            Layer::Linear { inputs, outputs, .. } => {
                return vec![("weight", vec![inputs, outputs]), ("bias", vec![outputs])];
            }
            Layer::Skip { inputs, outputs } => return vec![("weight", vec![inputs, outputs])],
            Layer::Gru(size) => (size, 3 * size),
            Layer::Lstm(size) => (size, 4 * size),
        };
        let weights = ["weight_ih", "weight_hh"].map(|name| (name, vec![size, gates]));
        let biases = ["bias_ih", "bias_hh"].map(|name| (name, vec![gates]));
        weights.into_iter().chain(biases).collect()
    }
}

impl TensorSpec {
    /// Its untrained values, drawn at the address (`seed`, [`Purpose::Weights`], [number](Self::number)).
    pub fn untrained(&self, seed: u64) -> impl Iterator<Item = f32> {
        let mut draws = Draws::new(seed, Purpose::Weights, self.number, 0);
        (0..self.n_values()).map(move |_| draws.between(-self.bound, self.bound) as f32)
    }

    /// The number of values.
    pub fn n_values(&self) -> usize {
        self.shape.iter().product()
    }
}
