//! Functions of one element. The polynomials are those of the Cephes library (`expf`, `tanhf`).

use super::{fetch, load, store};
use pulp::{Simd, WithSimd};

/// [`relu`](super::relu).
pub(super) struct Relu<'a>(pub &'a mut [f32]);
/// [`sigmoid`](super::sigmoid).
pub(super) struct Sigmoid<'a>(pub &'a mut [f32]);
/// [`tanh`](super::tanh).
pub(super) struct Tanh<'a>(pub &'a mut [f32]);
/// [`relu_backward`](super::relu_backward).
pub(super) struct ReluBackward<'a>(pub &'a [f32], pub &'a mut [f32]);
/// [`add`](super::add).
pub(super) struct Add<'a>(pub &'a [f32], pub &'a mut [f32]);
/// [`sum`](super::sum).
pub(super) struct Sum<'a>(pub &'a [f32]);

impl WithSimd for Relu<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        map(simd, self.0, relu_of);
    }
}

impl WithSimd for Sigmoid<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        map(simd, self.0, sigmoid_of);
    }
}

impl WithSimd for Tanh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        map(simd, self.0, tanh_of);
    }
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Add(row, y) = self;
        for (y, row) in y.chunks_mut(S::F32_LANES).zip(row.chunks(S::F32_LANES)) {
            let sum = simd.add_f32s(load(simd, y), load(simd, row));
            store(simd, y, sum);
        }
    }
}

impl WithSimd for Sum<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        // As many sums as it takes to have loads under way all the time.
        const SUMS: usize = 8;
        let mut sums = [simd.splat_f32s(0.0); SUMS];
        let (vectors, rest) = S::as_simd_f32s(self.0);
        let (groups, others) = vectors.as_chunks::<SUMS>();
        for group in groups {
            for (sum, vector) in sums.iter_mut().zip(group) {
                // The line 2 KiB behind. From the L3 cache a core reads an eighth faster for it than with what the CPU fetches
                // ahead by itself.
                fetch(std::ptr::from_ref(vector).wrapping_byte_add(2048));
                *sum = simd.add_f32s(*sum, *vector);
            }
        }
        sums.iter_mut().zip(others).for_each(|(sum, vector)| *sum = simd.add_f32s(*sum, *vector));
        let sums = sums.into_iter().map(|sum| simd.reduce_sum_f32s(sum));
        sums.chain(rest.iter().copied()).sum()
    }
}

impl WithSimd for ReluBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let ReluBackward(y, d) = self;
        let zero = simd.splat_f32s(0.0);
        for (y, d) in y.chunks(S::F32_LANES).zip(d.chunks_mut(S::F32_LANES)) {
            let positive = simd.less_than_f32s(zero, load(simd, y));
            let passed = simd.select_f32s(positive, load(simd, d), zero);
            store(simd, d, passed);
        }
    }
}

#[inline(always)]
fn map<S: Simd>(simd: S, values: &mut [f32], function: impl Fn(S, S::f32s) -> S::f32s) {
    for chunk in values.chunks_mut(S::F32_LANES) {
        let value = function(simd, load(simd, chunk));
        store(simd, chunk, value);
    }
}

// Clamps are a comparison and a selection and not `min` and `max`, which drop a NaN on some machines: a NaN
// in an observation must come out as one, so that it is seen.

#[inline(always)]
fn relu_of<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let zero = simd.splat_f32s(0.0);
    simd.select_f32s(simd.less_than_f32s(x, zero), zero, x)
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
pub(super) fn sigmoid_of<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let one = simd.splat_f32s(1.0);
    simd.div_f32s(one, simd.add_f32s(one, exp_of(simd, simd.neg_f32s(x))))
}

/// `tanh(x)`: an odd polynomial near zero, where `1 - 2 / (exp(2 x) + 1)` cancels, and the latter elsewhere.
#[inline(always)]
pub(super) fn tanh_of<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let one = simd.splat_f32s(1.0);
    let exponential = simd.add_f32s(exp_of(simd, simd.add_f32s(x, x)), one);
    let far = simd.sub_f32s(one, simd.div_f32s(simd.splat_f32s(2.0), exponential));

    let square = simd.mul_f32s(x, x);
    let coefficients = [-5.704_988_7e-3, 2.063_909e-2, -5.373_971_6e-2, 1.333_144_2e-1, -3.333_328e-1];
    let cubic = simd.mul_f32s(polynomial(simd, square, coefficients), square);
    let near = simd.mul_add_e_f32s(cubic, x, x);

    simd.select_f32s(simd.less_than_f32s(simd.abs_f32s(x), simd.splat_f32s(0.625)), near, far)
}

/// `exp(x)` for `x` in -87 to 88; what lies beyond gets the value at that end, near 1e-38 or 1e38.
///
/// `x = n ln 2 + r` with whole `n`: `exp(x) = 2^n exp(r)`, a polynomial in `r`.
#[inline(always)]
fn exp_of<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let low = simd.splat_f32s(-87.0);
    let high = simd.splat_f32s(88.0);
    let x = simd.select_f32s(simd.less_than_f32s(x, low), low, x);
    let x = simd.select_f32s(simd.less_than_f32s(high, x), high, x);

    // Adding 1.5 * 2^23 leaves no bits for a fraction: the sum ends in the whole number nearest to
    // x / ln 2, here plus 127, the bias of an exponent.
    let magic = simd.splat_f32s(12_582_912.0 + 127.0);
    let sum = simd.mul_add_e_f32s(x, simd.splat_f32s(std::f32::consts::LOG2_E), magic);
    let n = simd.sub_f32s(sum, magic);
    let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(sum), simd.splat_u32s(23));
    let power = simd.transmute_f32s_u32s(exponent);

    // ln 2 in two parts, the first with so few bits that its product with n is exact.
    let r = simd.mul_add_e_f32s(n, simd.splat_f32s(-0.693_359_4), x);
    let r = simd.mul_add_e_f32s(n, simd.splat_f32s(2.121_944_4e-4), r);
    let coefficients =
        [1.987_569_1e-4, 1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5, 1.0, 1.0];
    simd.mul_f32s(polynomial(simd, r, coefficients), power)
}

/// The polynomial with these coefficients, highest power first.
#[inline(always)]
fn polynomial<S: Simd, const N: usize>(simd: S, x: S::f32s, coefficients: [f32; N]) -> S::f32s {
    let mut value = simd.splat_f32s(coefficients[0]);
    for &coefficient in &coefficients[1..] {
        value = simd.mul_add_e_f32s(value, x, simd.splat_f32s(coefficient));
    }
    value
}
