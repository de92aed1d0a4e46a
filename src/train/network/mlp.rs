//! The network without memory: a critic, or an actor.

use super::{linear_backward, linear_gradient, linear_relu};
use crate::nn::kernels::{self, Start};
use crate::train::memory::{Buffer, Flat};

/// `Linear -> ReLU -> Linear -> ReLU -> Linear`.
#[derive(Clone, Debug, Default)]
pub struct Mlp {
    first: Buffer,
    second: Buffer,
    out: Buffer,
    d_first: Buffer,
    d_second: Buffer,
    transposed: Buffer,
}

impl Mlp {
    /// The outputs `[rows, outputs]` of the inputs `x` `[rows, inputs]`.
    pub fn forward(&mut self, weights: &Flat, rows: usize, x: &[f32]) -> &[f32] {
        let [w1, b1, w2, b2, w3, b3] = weights.tensors();
        linear_relu(rows, x, w1, b1, self.first.resize(rows * b1.len()));
        linear_relu(rows, &self.first, w2, b2, self.second.resize(rows * b2.len()));
        kernels::linear(rows, &self.second, w3, Start::Bias(b3), self.out.resize(rows * b3.len()));
        &self.out
    }

    /// `gradient` becomes that of a loss whose derivative by the outputs of the last forward pass is `d`.
    pub fn backward(&mut self, weights: &Flat, rows: usize, x: &[f32], d: &[f32], gradient: &mut Flat) {
        let [_, _, w2, _, w3, _] = weights.tensors();
        let [g_w1, g_b1, g_w2, g_b2, g_w3, g_b3] = gradient.tensors_mut();

        linear_gradient(rows, &self.second, d, g_w3, g_b3);
        let d_second = self.d_second.resize(self.second.len());
        linear_backward(rows, d, w3, &mut self.transposed, d_second);
        kernels::relu_backward(&self.second, d_second);

        linear_gradient(rows, &self.first, d_second, g_w2, g_b2);
        let d_first = self.d_first.resize(self.first.len());
        linear_backward(rows, d_second, w2, &mut self.transposed, d_first);
        kernels::relu_backward(&self.first, d_first);

        linear_gradient(rows, x, d_first, g_w1, g_b1);
    }
}
