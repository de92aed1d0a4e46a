//! The GRU cell.

use super::native::linear_gradient;
use crate::nn::kernels::{self, Start};
use crate::train::memory::Buffer;

/// What a GRU cell keeps for the way back; its state starts at zero.
#[derive(Clone, Debug, Default)]
pub(super) struct Gru {
    rows: usize,
    /// The size of the state of a row.
    h: usize,
    /// Products with the input, then gates, then derivatives, `[steps, rows, 3 h]`.
    gates: Buffer,
    /// Products with the state, then derivatives, `[steps, rows, 3 h]`.
    recurrent: Buffer,
    /// The state before the first step and after every step, `[steps + 1, rows, h]`.
    hidden: Buffer,
}

impl Gru {
    /// The states `[steps, rows, h]` that follow on the inputs `x` `[steps, rows, inputs]`.
    pub(super) fn forward(&mut self, weights: [&[f32]; 4], steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        let [w_ih, w_hh, b_ih, b_hh] = weights;
        (self.rows, self.h) = (rows, b_hh.len() / 3);
        let size = rows * self.h;
        kernels::linear(steps * rows, x, w_ih, Start::Bias(b_ih), self.gates.resize(3 * steps * size));
        self.recurrent.resize(3 * steps * size);
        self.hidden.resize((steps + 1) * size)[..size].fill(0.0);

        for step in 0..steps {
            let (past, after) = self.hidden.split_at_mut((step + 1) * size);
            let (before, after) = (&past[step * size..], &mut after[..size]);
            let gates = &mut self.gates[3 * step * size..][..3 * size];
            let recurrent = &mut self.recurrent[3 * step * size..][..3 * size];
            kernels::linear(rows, before, w_hh, Start::Bias(b_hh), recurrent);
            kernels::gru_forward(rows, gates, recurrent, before, after);
        }
        self.out()
    }

    /// The states after every step.
    pub(super) fn out(&self) -> &[f32] {
        &self.hidden[self.rows * self.h..]
    }

    /// Back through time, from the derivative `d` by the states, which it uses up, to that by the products with the
    /// input, `[steps, rows, 3 h]`. `gradients` become those of the state's weight and bias; `transposed` is memory.
    pub(super) fn backward(
        &mut self,
        w_hh: &[f32],
        d: &mut [f32],
        gradients: [&mut [f32]; 2],
        transposed: &mut Buffer,
    ) -> &[f32] {
        let (rows, h, size) = (self.rows, self.h, self.rows * self.h);
        let steps = d.len() / size;
        // The state's weight is transposed once for all steps.
        let transposed = transposed.resize(w_hh.len());
        kernels::transpose(h, 3 * h, w_hh, transposed);
        for step in (0..steps).rev() {
            let (earlier, now) = d.split_at_mut(step * size);
            let now = &mut now[..size];
            let gates = &mut self.gates[3 * step * size..][..3 * size];
            let recurrent = &mut self.recurrent[3 * step * size..][..3 * size];
            kernels::gru_backward(rows, gates, recurrent, &self.hidden[step * size..][..size], now);
            if step > 0 {
                kernels::linear(rows, recurrent, transposed, Start::Output, now);
                kernels::add(now, &mut earlier[(step - 1) * size..]);
            }
        }
        linear_gradient(steps * rows, &self.hidden[..steps * size], &self.recurrent, gradients);
        &self.gates
    }
}
