//! The networks in training: forward, and backward to the gradient of every weight.
//!
//! Rows of an input are ordered by time first, then by row of a step: `[steps, rows, width]`. Whatever needs no
//! earlier step is one product over all steps. Sizes follow from the weights; what lies between the layers
//! stays here from the forward pass to the backward pass, which may be called once after it.

mod candle;
mod gru;
mod lstm;
mod mlp;
#[cfg(test)]
mod tests;

pub use candle::Candle;
pub use gru::Gru;
pub use lstm::Lstm;
pub use mlp::Mlp;

use super::memory::{Buffer, Flat};
use super::settings::Backend;
use crate::nn::kernels::{self, Start};
use crate::nn::{ActorKind, TensorSpec};

/// A network in training.
#[derive(Clone, Debug)]
pub enum Network {
    /// Without memory: a critic, or an actor.
    Mlp(Mlp),
    /// An actor with memory.
    Gru(Gru),
    /// A predictor.
    Lstm(Lstm),
    /// Any of them, in candle.
    Candle(Candle),
}

/// What lies between the first and the last layer of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A linear layer and a ReLU.
    Mlp,
    /// A GRU cell.
    Gru,
    /// An LSTM.
    Lstm,
}

impl From<ActorKind> for Kind {
    fn from(kind: ActorKind) -> Kind {
        match kind {
            ActorKind::Mlp => Kind::Mlp,
            ActorKind::Gru => Kind::Gru,
        }
    }
}

impl Network {
    /// A network of this kind with these tensors.
    pub fn new(backend: Backend, kind: Kind, specs: &[TensorSpec]) -> Network {
        match (backend, kind) {
            (Backend::Native, Kind::Mlp) => Network::Mlp(Mlp::default()),
            (Backend::Native, Kind::Gru) => Network::Gru(Gru::default()),
            (Backend::Native, Kind::Lstm) => Network::Lstm(Lstm::default()),
            (Backend::Candle, _) => Network::Candle(Candle::new(kind, specs)),
        }
    }

    /// The outputs `[steps, rows, outputs]` of the inputs `x` `[steps, rows, inputs]`.
    pub fn forward(&mut self, weights: &Flat, steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        match self {
            Network::Mlp(mlp) => mlp.forward(weights, steps * rows, x),
            Network::Gru(gru) => gru.forward(weights, steps, rows, x),
            Network::Lstm(lstm) => lstm.forward(weights, steps, rows, x),
            Network::Candle(candle) => candle.forward(weights, steps, rows, x),
        }
    }

    /// `gradient` becomes that of a loss whose derivative by the outputs of the last forward pass is `d`.
    pub fn backward(
        &mut self,
        weights: &Flat,
        steps: usize,
        rows: usize,
        x: &[f32],
        d: &[f32],
        gradient: &mut Flat,
    ) {
        match self {
            Network::Mlp(mlp) => mlp.backward(weights, steps * rows, x, d, gradient),
            Network::Gru(gru) => gru.backward(weights, steps, rows, x, d, gradient),
            Network::Lstm(lstm) => lstm.backward(weights, steps, rows, x, d, gradient),
            Network::Candle(candle) => candle.backward(d, gradient),
        }
    }
}

/// `y = relu(x @ weight + bias)`.
fn linear_relu(rows: usize, x: &[f32], weight: &[f32], bias: &[f32], y: &mut [f32]) {
    kernels::linear(rows, x, weight, Start::Bias(bias), y);
    kernels::relu(y);
}

/// The gradients of a linear layer with input `x` and derivative `d` by its output.
fn linear_gradient(rows: usize, x: &[f32], d: &[f32], weight: &mut [f32], bias: &mut [f32]) {
    kernels::gradient(rows, x, d, weight);
    kernels::sum_rows(d, bias);
}

/// `d_input = d @ weight^T`. `transposed` is memory for the weight.
fn linear_backward(rows: usize, d: &[f32], weight: &[f32], transposed: &mut Buffer, d_input: &mut [f32]) {
    let transposed = transposed.resize(weight.len());
    kernels::transpose(d_input.len() / rows, d.len() / rows, weight, transposed);
    kernels::linear(rows, d, transposed, Start::Zero, d_input);
}
