//! The gates of recurrent cells in training: a step that keeps what its derivative needs, and the derivative.
//!
//! One pass over memory each. Gates replace their sums, and derivatives replace gates, in place.

use super::elementwise::{sigmoid_of, tanh_of};
use super::{load, store};
use pulp::{Simd, WithSimd};

/// [`gru_forward`](super::gru_forward).
pub(super) struct GruForward<'a> {
    pub h: usize,
    pub gates: &'a mut [f32],
    pub recurrent: &'a [f32],
    pub before: &'a [f32],
    pub after: &'a mut [f32],
}

/// [`gru_backward`](super::gru_backward).
pub(super) struct GruBackward<'a> {
    pub h: usize,
    pub gates: &'a mut [f32],
    pub recurrent: &'a mut [f32],
    pub before: &'a [f32],
    pub d: &'a mut [f32],
}

/// [`lstm_forward`](super::lstm_forward).
pub(super) struct LstmForward<'a> {
    pub h: usize,
    pub gates: &'a mut [f32],
    pub bias: &'a [f32],
    pub cell_before: &'a [f32],
    pub cell: &'a mut [f32],
    pub hidden: &'a mut [f32],
}

/// [`lstm_backward`](super::lstm_backward).
pub(super) struct LstmBackward<'a> {
    pub h: usize,
    pub gates: &'a mut [f32],
    pub cell_before: &'a [f32],
    pub cell: &'a [f32],
    pub d: &'a [f32],
    pub d_cell: &'a mut [f32],
}

impl WithSimd for GruForward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let GruForward { h, gates, recurrent, before, after } = self;
        let states = before.chunks_exact(h).zip(after.chunks_exact_mut(h));
        for ((before, after), (gates, recurrent)) in
            states.zip(gates.chunks_exact_mut(3 * h).zip(recurrent.chunks_exact(3 * h)))
        {
            let (r_row, rest) = gates.split_at_mut(h);
            let (z_row, n_row) = rest.split_at_mut(h);
            for from in (0..h).step_by(S::F32_LANES) {
                let to = h.min(from + S::F32_LANES);
                let recurrent = |gate: usize| load(simd, &recurrent[gate * h..][from..to]);
                let (r_row, z_row) = (&mut r_row[from..to], &mut z_row[from..to]);
                let n_row = &mut n_row[from..to];
                let r = sigmoid_of(simd, simd.add_f32s(load(simd, r_row), recurrent(0)));
                let z = sigmoid_of(simd, simd.add_f32s(load(simd, z_row), recurrent(1)));
                let n = tanh_of(simd, simd.mul_add_e_f32s(r, recurrent(2), load(simd, n_row)));
                let change = simd.sub_f32s(load(simd, &before[from..to]), n);
                store(simd, &mut after[from..to], simd.mul_add_e_f32s(z, change, n));
                store(simd, r_row, r);
                store(simd, z_row, z);
                store(simd, n_row, n);
            }
        }
    }
}

impl WithSimd for GruBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let GruBackward { h, gates, recurrent, before, d } = self;
        let one = simd.splat_f32s(1.0);
        let states = before.chunks_exact(h).zip(d.chunks_exact_mut(h));
        for ((before, d), (gates, recurrent)) in
            states.zip(gates.chunks_exact_mut(3 * h).zip(recurrent.chunks_exact_mut(3 * h)))
        {
            let (gate_r, rest) = gates.split_at_mut(h);
            let (gate_z, gate_n) = rest.split_at_mut(h);
            let (recurrent_r, rest) = recurrent.split_at_mut(h);
            let (recurrent_z, recurrent_n) = rest.split_at_mut(h);
            for from in (0..h).step_by(S::F32_LANES) {
                let range = from..h.min(from + S::F32_LANES);
                let r = load(simd, &gate_r[range.clone()]);
                let z = load(simd, &gate_z[range.clone()]);
                let n = load(simd, &gate_n[range.clone()]);
                let inner = load(simd, &recurrent_n[range.clone()]);
                let before = load(simd, &before[range.clone()]);
                let d_after = load(simd, &d[range.clone()]);

                // h' = n + z (h - n), n = tanh(a_n + r b_n); a sigmoid s has slope s (1 - s), a tanh 1 - t^2.
                let d_n = simd.mul_f32s(simd.mul_f32s(d_after, simd.sub_f32s(one, z)), {
                    simd.sub_f32s(one, simd.mul_f32s(n, n))
                });
                let slope_z = simd.mul_f32s(z, simd.sub_f32s(one, z));
                let d_z = simd.mul_f32s(simd.mul_f32s(d_after, simd.sub_f32s(before, n)), slope_z);
                let slope_r = simd.mul_f32s(r, simd.sub_f32s(one, r));
                let d_r = simd.mul_f32s(simd.mul_f32s(d_n, inner), slope_r);

                store(simd, &mut gate_r[range.clone()], d_r);
                store(simd, &mut gate_z[range.clone()], d_z);
                store(simd, &mut gate_n[range.clone()], d_n);
                store(simd, &mut recurrent_r[range.clone()], d_r);
                store(simd, &mut recurrent_z[range.clone()], d_z);
                store(simd, &mut recurrent_n[range.clone()], simd.mul_f32s(d_n, r));
                store(simd, &mut d[range], simd.mul_f32s(d_after, z));
            }
        }
    }
}

impl WithSimd for LstmForward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let LstmForward { h, gates, bias, cell_before, cell, hidden } = self;
        let states = cell.chunks_exact_mut(h).zip(hidden.chunks_exact_mut(h));
        for ((cell, hidden), (gates, cell_before)) in
            states.zip(gates.chunks_exact_mut(4 * h).zip(cell_before.chunks_exact(h)))
        {
            for from in (0..h).step_by(S::F32_LANES) {
                let to = h.min(from + S::F32_LANES);
                let gate = |gates: &[f32], gate: usize| {
                    let bias = load(simd, &bias[gate * h..][from..to]);
                    simd.add_f32s(load(simd, &gates[gate * h..][from..to]), bias)
                };
                let i = sigmoid_of(simd, gate(gates, 0));
                let f = sigmoid_of(simd, gate(gates, 1));
                let g = tanh_of(simd, gate(gates, 2));
                let o = sigmoid_of(simd, gate(gates, 3));
                let kept = simd.mul_f32s(f, load(simd, &cell_before[from..to]));
                let after = simd.mul_add_e_f32s(i, g, kept);
                store(simd, &mut cell[from..to], after);
                store(simd, &mut hidden[from..to], simd.mul_f32s(o, tanh_of(simd, after)));
                for (at, value) in [i, f, g, o].into_iter().enumerate() {
                    store(simd, &mut gates[at * h..][from..to], value);
                }
            }
        }
    }
}

impl WithSimd for LstmBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let LstmBackward { h, gates, cell_before, cell, d, d_cell } = self;
        let one = simd.splat_f32s(1.0);
        let slope = |s: S::f32s| simd.mul_f32s(s, simd.sub_f32s(one, s));
        let cells = cell_before.chunks_exact(h).zip(cell.chunks_exact(h));
        let derivatives = d.chunks_exact(h).zip(d_cell.chunks_exact_mut(h));
        for ((gates, (cell_before, cell)), (d, d_cell)) in
            gates.chunks_exact_mut(4 * h).zip(cells).zip(derivatives)
        {
            for from in (0..h).step_by(S::F32_LANES) {
                let to = h.min(from + S::F32_LANES);
                // Not by `map` over an array, which the compiler may leave a call that passes vectors by memory.
                let gate = |gate: usize| load(simd, &gates[gate * h..][from..to]);
                let (i, f, g, o) = (gate(0), gate(1), gate(2), gate(3));
                let squashed = tanh_of(simd, load(simd, &cell[from..to]));
                let d = load(simd, &d[from..to]);

                // h = o tanh(c), c = f c_before + i g.
                let inner = simd.sub_f32s(one, simd.mul_f32s(squashed, squashed));
                let later = load(simd, &d_cell[from..to]);
                let d_c = simd.mul_add_e_f32s(simd.mul_f32s(d, o), inner, later);
                let d_i = simd.mul_f32s(simd.mul_f32s(d_c, g), slope(i));
                let d_f = simd.mul_f32s(simd.mul_f32s(d_c, load(simd, &cell_before[from..to])), slope(f));
                let d_g = simd.mul_f32s(simd.mul_f32s(d_c, i), simd.sub_f32s(one, simd.mul_f32s(g, g)));
                let d_o = simd.mul_f32s(simd.mul_f32s(d, squashed), slope(o));

                store(simd, &mut d_cell[from..to], simd.mul_f32s(d_c, f));
                for (at, value) in [d_i, d_f, d_g, d_o].into_iter().enumerate() {
                    store(simd, &mut gates[at * h..][from..to], value);
                }
            }
        }
    }
}
