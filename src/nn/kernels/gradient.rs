//! The product of a weight's gradient, `x^T @ d`, blocked for registers like the one of the forward pass.

use super::{load, store};
use pulp::{Simd, WithSimd};

/// [`gradient`](super::gradient()).
pub(super) struct Gradient<'a> {
    /// Inputs of a row of `x`, which are rows of `gradient`.
    k: usize,
    /// Outputs of a row of `d`.
    n: usize,
    x: &'a [f32],
    d: &'a [f32],
    gradient: &'a mut [f32],
}

/// Columns are taken in panels of this many vectors, so that a panel of `d` stays in the core's own cache.
const PANEL: usize = 16;

impl<'a> Gradient<'a> {
    /// Checks the shapes; `None` when there is nothing to compute.
    pub(super) fn new(
        rows: usize,
        x: &'a [f32],
        d: &'a [f32],
        gradient: &'a mut [f32],
    ) -> Option<Gradient<'a>> {
        if gradient.is_empty() {
            return None;
        }
        if rows == 0 {
            gradient.fill(0.0);
            return None;
        }
        let (k, n) = (x.len() / rows, d.len() / rows);
        assert_eq!(x.len(), rows * k, "gradient: x is not [rows, k]");
        assert_eq!(d.len(), rows * n, "gradient: d is not [rows, n]");
        assert_eq!(gradient.len(), k * n, "gradient: it is not [k, n] = [{k}, {n}]");
        Some(Gradient { k, n, x, d, gradient })
    }

    /// The gradients of `R` inputs from `input` and the columns of one panel. Returns `R`.
    #[inline(always)]
    fn panel<S: Simd, const R: usize, const V: usize>(
        &mut self,
        simd: S,
        input: usize,
        from: usize,
        to: usize,
    ) -> usize {
        let mut column = from;
        while column + V * S::F32_LANES <= to {
            self.tile::<S, R, V>(simd, input, column);
            column += V * S::F32_LANES;
        }
        while column < to {
            let end = to.min(column + S::F32_LANES);
            self.tail::<S, R>(simd, input, column, end);
            column = end;
        }
        R
    }

    /// `R` inputs by `V` vectors, with all `R * V` sums in registers.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize>(&mut self, simd: S, input: usize, column: usize) {
        let (k, n, width) = (self.k, self.n, V * S::F32_LANES);
        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        for (x, d) in self.x.chunks_exact(k).zip(self.d.chunks_exact(n)) {
            let x: &[f32; R] = x[input..][..R].try_into().expect("the slice is R inputs long");
            let d = S::as_simd_f32s(&d[column..][..width]).0;
            let d: &[S::f32s; V] = d.try_into().expect("the slice is V vectors wide");
            for (&x, sums) in x.iter().zip(&mut sums) {
                let x = simd.splat_f32s(x);
                for (sum, &d) in sums.iter_mut().zip(d) {
                    *sum = simd.mul_add_e_f32s(x, d, *sum);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            let row = &mut self.gradient[(input + r) * n + column..][..width];
            S::as_mut_simd_f32s(row).0.copy_from_slice(sums);
        }
    }

    /// `R` inputs by at most one vector.
    #[inline(always)]
    fn tail<S: Simd, const R: usize>(&mut self, simd: S, input: usize, column: usize, to: usize) {
        let (k, n) = (self.k, self.n);
        let mut sums = [simd.splat_f32s(0.0); R];
        for (row, x) in self.x.chunks_exact(k).enumerate() {
            let x: &[f32; R] = x[input..][..R].try_into().expect("the slice is R inputs long");
            // What lies behind the row ends up in lanes that are not stored.
            let d = load(simd, &self.d[row * n + column..]);
            for (&x, sum) in x.iter().zip(&mut sums) {
                *sum = simd.mul_add_e_f32s(simd.splat_f32s(x), d, *sum);
            }
        }
        for (r, &sum) in sums.iter().enumerate() {
            store(simd, &mut self.gradient[(input + r) * n..][column..to], sum);
        }
    }
}

impl WithSimd for Gradient<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let wide = S::REGISTER_COUNT >= 32;
        for from in (0..self.n).step_by(PANEL * S::F32_LANES) {
            let to = self.n.min(from + PANEL * S::F32_LANES);
            let mut input = 0;
            while input < self.k {
                input += match self.k - input {
                    6.. if wide => self.panel::<S, 6, 4>(simd, input, from, to),
                    6.. => self.panel::<S, 6, 2>(simd, input, from, to),
                    4.. if wide => self.panel::<S, 4, 4>(simd, input, from, to),
                    4.. => self.panel::<S, 4, 2>(simd, input, from, to),
                    2.. => self.panel::<S, 2, 4>(simd, input, from, to),
                    _ => self.panel::<S, 1, 4>(simd, input, from, to),
                };
            }
        }
    }
}
