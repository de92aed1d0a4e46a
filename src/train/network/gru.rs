//! The actor with memory.

use super::{linear_backward, linear_gradient, linear_relu};
use crate::nn::kernels::{self, Start};
use crate::train::memory::{Buffer, Flat};

/// `Linear -> ReLU -> GRU cell -> Linear`; the state of the cell starts at zero.
#[derive(Clone, Debug, Default)]
pub struct Gru {
    first: Buffer,
    /// Products with the input, then gates, then derivatives, `[steps, rows, 3 h]`.
    gates: Buffer,
    /// Products with the state, then derivatives, `[steps, rows, 3 h]`.
    recurrent: Buffer,
    /// The state before the first step and after every step, `[steps + 1, rows, h]`.
    hidden: Buffer,
    out: Buffer,
    d_first: Buffer,
    d_hidden: Buffer,
    transposed: Buffer,
}

impl Gru {
    /// The outputs `[steps, rows, outputs]` of the inputs `x` `[steps, rows, inputs]`.
    pub fn forward(&mut self, weights: &Flat, steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        let [w1, b1, w_ih, w_hh, b_ih, b_hh, w3, b3] = weights.tensors();
        let (all, h) = (steps * rows, b1.len());
        linear_relu(all, x, w1, b1, self.first.resize(all * h));
        kernels::linear(all, &self.first, w_ih, Start::Bias(b_ih), self.gates.resize(3 * all * h));
        self.recurrent.resize(3 * all * h);
        self.hidden.resize((all + rows) * h)[..rows * h].fill(0.0);

        let size = rows * h;
        for step in 0..steps {
            let (past, after) = self.hidden.split_at_mut((step + 1) * size);
            let (before, after) = (&past[step * size..], &mut after[..size]);
            let gates = &mut self.gates[3 * step * size..][..3 * size];
            let recurrent = &mut self.recurrent[3 * step * size..][..3 * size];
            kernels::linear(rows, before, w_hh, Start::Bias(b_hh), recurrent);
            kernels::gru_forward(rows, gates, recurrent, before, after);
        }
        kernels::linear(all, &self.hidden[size..], w3, Start::Bias(b3), self.out.resize(all * b3.len()));
        &self.out
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
        let [_, b1, w_ih, w_hh, _, _, w3, _] = weights.tensors();
        let [g_w1, g_b1, g_w_ih, g_w_hh, g_b_ih, g_b_hh, g_w3, g_b3] = gradient.tensors_mut();
        let (all, size) = (steps * rows, rows * b1.len());

        linear_gradient(all, &self.hidden[size..], d, g_w3, g_b3);
        let d_hidden = self.d_hidden.resize(steps * size);
        linear_backward(all, d, w3, &mut self.transposed, d_hidden);

        // Back through time. The state's weight is transposed once for all steps.
        let transposed = self.transposed.resize(w_hh.len());
        kernels::transpose(b1.len(), 3 * b1.len(), w_hh, transposed);
        for step in (0..steps).rev() {
            let (earlier, now) = d_hidden.split_at_mut(step * size);
            let now = &mut now[..size];
            let gates = &mut self.gates[3 * step * size..][..3 * size];
            let recurrent = &mut self.recurrent[3 * step * size..][..3 * size];
            kernels::gru_backward(rows, gates, recurrent, &self.hidden[step * size..][..size], now);
            if step > 0 {
                kernels::linear(rows, recurrent, transposed, Start::Output, now);
                kernels::add(now, &mut earlier[(step - 1) * size..]);
            }
        }
        linear_gradient(all, &self.hidden[..steps * size], &self.recurrent, g_w_hh, g_b_hh);

        linear_gradient(all, &self.first, &self.gates, g_w_ih, g_b_ih);
        let d_first = self.d_first.resize(steps * size);
        linear_backward(all, &self.gates, w_ih, &mut self.transposed, d_first);
        kernels::relu_backward(&self.first, d_first);
        linear_gradient(all, x, d_first, g_w1, g_b1);
    }
}
