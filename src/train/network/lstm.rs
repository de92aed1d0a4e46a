//! The LSTM cell.

use crate::nn::kernels::{self, Start};
use crate::train::memory::Buffer;

/// What an LSTM cell keeps for the way back; its states start at zero.
#[derive(Clone, Debug, Default)]
pub(super) struct Lstm {
    rows: usize,
    /// The size of the states of a row.
    h: usize,
    /// Products, then gates, then derivatives, `[steps, rows, 4 h]`.
    gates: Buffer,
    /// The hidden state before the first step and after every step, `[steps + 1, rows, h]`.
    hidden: Buffer,
    /// The cell state, likewise.
    cell: Buffer,
    d_cell: Buffer,
}

impl Lstm {
    /// The hidden states `[steps, rows, h]` that follow on the inputs `x` `[steps, rows, inputs]`.
    pub(super) fn forward(&mut self, weights: [&[f32]; 4], steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        let [w_ih, w_hh, b_ih, b_hh] = weights;
        (self.rows, self.h) = (rows, b_hh.len() / 4);
        let size = rows * self.h;
        kernels::linear(steps * rows, x, w_ih, Start::Bias(b_ih), self.gates.resize(4 * steps * size));
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
        self.out()
    }

    /// The hidden states after every step.
    pub(super) fn out(&self) -> &[f32] {
        &self.hidden[self.rows * self.h..]
    }

    /// Back through time, from the derivative `d` by the hidden states, which it uses up, to that by the products,
    /// `[steps, rows, 4 h]`. `gradient` becomes that of the state's weight; `transposed` is memory.
    pub(super) fn backward(
        &mut self,
        w_hh: &[f32],
        d: &mut [f32],
        gradient: &mut [f32],
        transposed: &mut Buffer,
    ) -> &[f32] {
        let (rows, h, size) = (self.rows, self.h, self.rows * self.h);
        let steps = d.len() / size;
        // The state's weight is transposed once for all steps.
        let transposed = transposed.resize(w_hh.len());
        kernels::transpose(h, 4 * h, w_hh, transposed);
        let d_cell = self.d_cell.resize(size);
        d_cell.fill(0.0);
        for step in (0..steps).rev() {
            let (earlier, now) = d.split_at_mut(step * size);
            let gates = &mut self.gates[4 * step * size..][..4 * size];
            let (cell_before, cell) = self.cell[step * size..][..2 * size].split_at(size);
            kernels::lstm_backward(rows, gates, cell_before, cell, &now[..size], d_cell);
            if step > 0 {
                kernels::linear(rows, gates, transposed, Start::Output, &mut earlier[(step - 1) * size..]);
            }
        }
        kernels::gradient(steps * rows, &self.hidden[..steps * size], &self.gates, gradient);
        &self.gates
    }
}
