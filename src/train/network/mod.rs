//! The networks in training: forward, and backward to the gradient of every weight.
//!
//! Rows of an input are ordered by time first, then by row of a step: `[steps, rows, width]`. Whatever needs no
//! earlier step is one product over all steps. Sizes follow from the weights; what lies between the layers
//! stays here from the forward pass to the backward pass, which may be called once after it.

mod gru;
mod lstm;
mod mlp;
#[cfg(test)]
mod tests;

pub use gru::Gru;
pub use lstm::Lstm;
pub use mlp::Mlp;

use super::memory::{Buffer, Flat};
use crate::nn::ActorKind;
use crate::nn::kernels::{self, Start};

/// The network of an actor.
#[derive(Clone, Debug)]
pub enum ActorNetwork {
    /// Without memory.
    Mlp(Mlp),
    /// With memory.
    Gru(Gru),
}

impl ActorNetwork {
    /// A network of this kind.
    pub fn new(kind: ActorKind) -> ActorNetwork {
        match kind {
            ActorKind::Mlp => ActorNetwork::Mlp(Mlp::default()),
            ActorKind::Gru => ActorNetwork::Gru(Gru::default()),
        }
    }

    /// The logits `[steps, rows, actions]` of the inputs `x` `[steps, rows, inputs]`.
    pub fn forward(&mut self, weights: &Flat, steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        match self {
            ActorNetwork::Mlp(mlp) => mlp.forward(weights, steps * rows, x),
            ActorNetwork::Gru(gru) => gru.forward(weights, steps, rows, x),
        }
    }

    /// `gradient` becomes that of a loss whose derivative by the logits of the last forward pass is `d`.
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
            ActorNetwork::Mlp(mlp) => mlp.backward(weights, steps * rows, x, d, gradient),
            ActorNetwork::Gru(gru) => gru.backward(weights, steps, rows, x, d, gradient),
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
