//! The predictor's network.

use super::{linear_backward, linear_gradient, linear_relu};
use crate::nn::kernels::{self, Start};
use crate::train::memory::{Buffer, Flat};

/// `Linear -> ReLU -> LSTM -> Linear`; the states of the LSTM start at zero.
#[derive(Clone, Debug, Default)]
pub struct Lstm {
    first: Buffer,
    /// Products, then gates, then derivatives, `[steps, rows, 4 h]`.
    gates: Buffer,
    /// The hidden state before the first step and after every step, `[steps + 1, rows, h]`.
    hidden: Buffer,
    /// The cell state, likewise.
    cell: Buffer,
    out: Buffer,
    d_first: Buffer,
    d_hidden: Buffer,
    d_cell: Buffer,
    transposed: Buffer,
}

impl Lstm {
    /// The outputs `[steps, rows, outputs]` of the inputs `x` `[steps, rows, inputs]`.
    pub fn forward(&mut self, weights: &Flat, steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        let [w1, b1, w_ih, w_hh, b_ih, b_hh, w3, b3] = weights.tensors();
        let (all, size) = (steps * rows, rows * b1.len());
        linear_relu(all, x, w1, b1, self.first.resize(steps * size));
        kernels::linear(all, &self.first, w_ih, Start::Bias(b_ih), self.gates.resize(4 * steps * size));
        self.hidden.resize((steps + 1) * size)[..size].fill(0.0);
        self.cell.resize((steps + 1) * size)[..size].fill(0.0);

        for step in 0..steps {
            let (past, hidden) = self.hidden.split_at_mut((step + 1) * size);
            let (past_cells, cell) = self.cell.split_at_mut((step + 1) * size);
            let gates = &mut self.gates[4 * step * size..][..4 * size];
            kernels::linear(rows, &past[step * size..], w_hh, Start::Output, gates);
            let cell_before = &past_cells[step * size..];
            kernels::lstm_forward(rows, gates, b_hh, cell_before, &mut cell[..size], &mut hidden[..size]);
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
        kernels::transpose(b1.len(), 4 * b1.len(), w_hh, transposed);
        let d_cell = self.d_cell.resize(size);
        d_cell.fill(0.0);
        for step in (0..steps).rev() {
            let (earlier, now) = d_hidden.split_at_mut(step * size);
            let gates = &mut self.gates[4 * step * size..][..4 * size];
            let (cell_before, cell) = self.cell[step * size..][..2 * size].split_at(size);
            kernels::lstm_backward(rows, gates, cell_before, cell, &now[..size], d_cell);
            if step > 0 {
                kernels::linear(rows, gates, transposed, Start::Output, &mut earlier[(step - 1) * size..]);
            }
        }
        kernels::gradient(all, &self.hidden[..steps * size], &self.gates, g_w_hh);

        linear_gradient(all, &self.first, &self.gates, g_w_ih, g_b_ih);
        g_b_hh.copy_from_slice(g_b_ih);
        let d_first = self.d_first.resize(steps * size);
        linear_backward(all, &self.gates, w_ih, &mut self.transposed, d_first);
        kernels::relu_backward(&self.first, d_first);
        linear_gradient(all, x, d_first, g_w1, g_b1);
    }
}
