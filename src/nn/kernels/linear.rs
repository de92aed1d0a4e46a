//! The matrix product, blocked for registers.

use super::halves::Load;
use super::store;
use pulp::{Simd, WithSimd};

/// Where the sum of an output starts.
#[derive(Clone, Copy, Debug)]
pub enum Start<'a> {
    /// At the bias of that output, `[n]`.
    Bias(&'a [f32]),
    /// At what the output holds.
    Output,
    /// At zero.
    Zero,
}

/// `y = x @ weight + start`, see [`linear`](super::linear()). `W` is f32, or the bits of f16.
pub(super) struct Linear<'a, W> {
    rows: usize,
    /// Inputs of a row.
    k: usize,
    /// Outputs of a row.
    n: usize,
    x: &'a [f32],
    weight: &'a [W],
    start: Start<'a>,
    y: &'a mut [f32],
}

/// Columns are taken in panels of this many vectors, and all rows are taken through one panel before the
/// next: a panel of weights stays in the core's own cache (256 KiB at k = 256 and 16 lanes).
const PANEL: usize = 16;

/// So many inputs of a single row are looked at together.
const BLOCK: usize = 512;

impl<'a, W> Linear<'a, W> {
    /// Checks the shapes; `None` when there is nothing to compute.
    pub(super) fn new(
        rows: usize,
        x: &'a [f32],
        weight: &'a [W],
        start: Start<'a>,
        y: &'a mut [f32],
    ) -> Option<Linear<'a, W>> {
        if y.is_empty() {
            return None;
        }
        let (k, n) = (x.len() / rows, y.len() / rows);
        assert_eq!(x.len(), rows * k, "linear: x is not [rows, k]");
        assert_eq!(y.len(), rows * n, "linear: y is not [rows, n]");
        assert_eq!(weight.len(), k * n, "linear: the weight is not [k, n] = [{k}, {n}]");
        if let Start::Bias(bias) = start {
            assert_eq!(bias.len(), n, "linear: the bias is not [n]");
        }
        Some(Linear { rows, k, n, x, weight, start, y })
    }

    /// One row: the outputs of all whole tiles of `V` vectors. Returns the first column that is not among them.
    ///
    /// Inputs that are zero, half of what a ReLU says, add nothing, and their weights are not read. As no sum starts at -0,
    /// that is bit-identical to adding what they make.
    #[inline(always)]
    fn one_row<S: Load<W>, const V: usize>(&mut self, simd: S) -> usize {
        let (n, width) = (self.n, V * S::F32_LANES);
        let end = n - n % width;
        if self.rows > 1 || end == 0 {
            return 0;
        }
        let y = &mut self.y[..end];
        match self.start {
            Start::Bias(bias) => y.copy_from_slice(&bias[..end]),
            Start::Output => {}
            Start::Zero => y.fill(0.0),
        }
        y.iter_mut().for_each(|y| *y += 0.0);
        for (x, weight) in self.x.chunks(BLOCK).zip(self.weight.chunks(BLOCK * n)) {
            let (mut live, mut len) = ([0; BLOCK], 0);
            for (at, x) in x.iter().enumerate() {
                live[len] = at as u16;
                len += usize::from(*x != 0.0);
            }
            let row = |at: u16| (simd.splat_f32s(x[usize::from(at)]), &weight[usize::from(at) * n..][..n]);
            let live = &live[..len];
            if end == width {
                add_rows::<W, S, V>(simd, live.iter().map(|at| row(*at)), 0, y);
                continue;
            }
            // Two inputs at a time: the weights are read in two runs side by side, and sums wait in `y` for the next inputs.
            // Out of the L3 cache that is quicker than panels, which read a part of each row and skip the rest.
            let (pairs, odd) = live.as_chunks::<2>();
            for pair in pairs {
                let rows = pair.map(row);
                for (tile, y) in y.chunks_exact_mut(width).enumerate() {
                    add_rows::<W, S, V>(simd, rows.iter().copied(), tile, y);
                }
            }
            for (tile, y) in y.chunks_exact_mut(width).enumerate() {
                add_rows::<W, S, V>(simd, odd.iter().map(|at| row(*at)), tile, y);
            }
        }
        end
    }

    /// The outputs of `R` rows from `row` and the columns of one panel: tiles of `V` vectors, then of one,
    /// then the last columns that fill no vector. Returns `R`.
    #[inline(always)]
    fn panel<S: Load<W>, const R: usize, const V: usize>(
        &mut self,
        simd: S,
        row: usize,
        from: usize,
        to: usize,
    ) -> usize {
        let mut column = from;
        while column + V * S::F32_LANES <= to {
            self.tile::<S, R, V>(simd, row, column);
            column += V * S::F32_LANES;
        }
        while column + S::F32_LANES <= to {
            self.tile::<S, R, 1>(simd, row, column);
            column += S::F32_LANES;
        }
        if column < to {
            self.tail::<S, R>(simd, row, column, to);
        }
        R
    }

    /// `R` rows by `V` vectors, with all `R * V` sums in registers.
    #[inline(always)]
    fn tile<S: Load<W>, const R: usize, const V: usize>(&mut self, simd: S, row: usize, column: usize) {
        let (k, n, width) = (self.k, self.n, V * S::F32_LANES);
        let x: [&[f32]; R] = std::array::from_fn(|r| &self.x[(row + r) * k..][..k]);
        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        for (r, sums) in sums.iter_mut().enumerate() {
            let start = match self.start {
                Start::Bias(bias) => &bias[column..][..width],
                Start::Output => &self.y[(row + r) * n + column..][..width],
                Start::Zero => continue,
            };
            sums.copy_from_slice(S::as_simd_f32s(start).0);
            sums.iter_mut().for_each(|sum| *sum = simd.add_f32s(*sum, simd.splat_f32s(0.0)));
        }
        for (i, weights) in self.weight.chunks_exact(n).enumerate() {
            let mut weights = weights[column..][..width].chunks_exact(S::F32_LANES);
            let weights: [S::f32s; V] =
                std::array::from_fn(|_| simd.load(weights.next().expect("the slice is V vectors wide")));
            for (x, sums) in x.iter().zip(&mut sums) {
                let x = simd.splat_f32s(x[i]);
                for (sum, &weight) in sums.iter_mut().zip(&weights) {
                    *sum = simd.mul_add_e_f32s(x, weight, *sum);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            let y = &mut self.y[(row + r) * n + column..][..width];
            S::as_mut_simd_f32s(y).0.copy_from_slice(sums);
        }
    }

    /// `R` rows by the last columns of a row, fewer than a vector.
    #[inline(always)]
    fn tail<S: Load<W>, const R: usize>(&mut self, simd: S, row: usize, column: usize, to: usize) {
        let (k, n) = (self.k, self.n);
        let x: [&[f32]; R] = std::array::from_fn(|r| &self.x[(row + r) * k..][..k]);
        let mut sums: [S::f32s; R] = std::array::from_fn(|r| match self.start {
            Start::Bias(bias) => Load::<f32>::load(simd, &bias[column..to]),
            Start::Output => Load::<f32>::load(simd, &self.y[(row + r) * n..][column..to]),
            Start::Zero => simd.splat_f32s(0.0),
        });
        sums.iter_mut().for_each(|sum| *sum = simd.add_f32s(*sum, simd.splat_f32s(0.0)));
        for i in 0..k {
            // A whole vector, where there is one, is quicker to load than its part. What lies behind the row
            // ends up in lanes that are not stored.
            let weights = simd.load(&self.weight[i * n + column..]);
            for (x, sum) in x.iter().zip(&mut sums) {
                *sum = simd.mul_add_e_f32s(simd.splat_f32s(x[i]), weights, *sum);
            }
        }
        for (r, &sum) in sums.iter().enumerate() {
            store(simd, &mut self.y[(row + r) * n..][column..to], sum);
        }
    }
}

/// Adds what some inputs make of their weights, given row by row, to the outputs `y` of a tile of `V` vectors.
#[inline(always)]
fn add_rows<'a, W: 'a, S: Load<W>, const V: usize>(
    simd: S,
    rows: impl Iterator<Item = (S::f32s, &'a [W])>,
    tile: usize,
    y: &mut [f32],
) {
    let y = S::as_mut_simd_f32s(y).0;
    let y: &mut [S::f32s; V] = y.try_into().expect("the slice is V vectors wide");
    let (mut sums, width) = (*y, V * S::F32_LANES);
    for (x, weights) in rows {
        let weights = weights[tile * width..][..width].chunks_exact(S::F32_LANES);
        for (sum, weights) in sums.iter_mut().zip(weights) {
            *sum = simd.mul_add_e_f32s(x, simd.load(weights), *sum);
        }
    }
    *y = sums;
}

impl<W> Linear<'_, W> {
    /// All outputs.
    #[inline(always)]
    pub(super) fn run<S: Load<W>>(mut self, simd: S) {
        // Tiles of as many sums as there are registers for. A single row is about reading memory: its tiles
        // are as wide as they can be, so that weights are read in long runs.
        let wide = S::REGISTER_COUNT >= 32;
        let first = if wide { self.one_row::<S, 16>(simd) } else { self.one_row::<S, 8>(simd) };
        for from in (first..self.n).step_by(PANEL * S::F32_LANES) {
            let to = self.n.min(from + PANEL * S::F32_LANES);
            let mut row = 0;
            while row < self.rows {
                row += match self.rows - row {
                    6.. if wide => self.panel::<S, 6, 4>(simd, row, from, to),
                    6.. => self.panel::<S, 6, 2>(simd, row, from, to),
                    4.. if wide => self.panel::<S, 4, 4>(simd, row, from, to),
                    4.. => self.panel::<S, 4, 2>(simd, row, from, to),
                    2.. => self.panel::<S, 2, 4>(simd, row, from, to),
                    _ if wide => self.panel::<S, 1, 16>(simd, row, from, to),
                    _ => self.panel::<S, 1, 8>(simd, row, from, to),
                };
            }
        }
    }
}

impl WithSimd for Linear<'_, f32> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run(simd);
    }
}
