//! The gates of recurrent cells, fused: one pass over memory per step.

use super::elementwise::{sigmoid_of, tanh_of};
use super::{load, store};
use pulp::{Simd, WithSimd};

/// [`gru_gates`](super::gru_gates); `h` is the hidden size.
pub(super) struct Gru<'a> {
    pub h: usize,
    pub input: &'a [f32],
    pub recurrent: &'a [f32],
    pub hidden: &'a mut [f32],
}

/// [`lstm_gates`](super::lstm_gates); `h` is the hidden size.
pub(super) struct Lstm<'a> {
    pub h: usize,
    pub gates: &'a [f32],
    pub bias: &'a [f32],
    pub hidden: &'a mut [f32],
    pub cell: &'a mut [f32],
}

impl WithSimd for Gru<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Gru { h, input, recurrent, hidden } = self;
        let rows =
            hidden.chunks_exact_mut(h).zip(input.chunks_exact(3 * h)).zip(recurrent.chunks_exact(3 * h));
        for ((hidden, input), recurrent) in rows {
            for from in (0..h).step_by(S::F32_LANES) {
                let to = h.min(from + S::F32_LANES);
                let input = |gate: usize| load(simd, &input[gate * h..][from..to]);
                let recurrent = |gate: usize| load(simd, &recurrent[gate * h..][from..to]);
                let r = sigmoid_of(simd, simd.add_f32s(input(0), recurrent(0)));
                let z = sigmoid_of(simd, simd.add_f32s(input(1), recurrent(1)));
                let n = tanh_of(simd, simd.mul_add_e_f32s(r, recurrent(2), input(2)));
                // (1 - z) n + z h = n + z (h - n)
                let before = load(simd, &hidden[from..to]);
                let after = simd.mul_add_e_f32s(z, simd.sub_f32s(before, n), n);
                store(simd, &mut hidden[from..to], after);
            }
        }
    }
}

impl WithSimd for Lstm<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Lstm { h, gates, bias, hidden, cell } = self;
        let rows = hidden.chunks_exact_mut(h).zip(cell.chunks_exact_mut(h)).zip(gates.chunks_exact(4 * h));
        for ((hidden, cell), gates) in rows {
            for from in (0..h).step_by(S::F32_LANES) {
                let to = h.min(from + S::F32_LANES);
                let gate = |gate: usize| {
                    let bias = load(simd, &bias[gate * h..][from..to]);
                    simd.add_f32s(load(simd, &gates[gate * h..][from..to]), bias)
                };
                let i = sigmoid_of(simd, gate(0));
                let f = sigmoid_of(simd, gate(1));
                let g = tanh_of(simd, gate(2));
                let o = sigmoid_of(simd, gate(3));
                let kept = simd.mul_f32s(f, load(simd, &cell[from..to]));
                let after = simd.mul_add_e_f32s(i, g, kept);
                store(simd, &mut cell[from..to], after);
                store(simd, &mut hidden[from..to], simd.mul_f32s(o, tanh_of(simd, after)));
            }
        }
    }
}
