//! The arithmetic of the networks: hand-written f32 kernels, and the only place with SIMD in it.
//!
//! | kernel | computes |
//! |---|---|
//! | [`linear()`] | `y = x @ w + bias`, or `y += x @ w` |
//! | [`linear_of_halves`] | the same, of weights stored as f16 |
//! | [`linear_of_nibbles`] | nearly the same, of weights rounded to four bits |
//! | [`relu`], [`sigmoid`], [`tanh`] | in place, element by element |
//! | [`gru_gates`], [`lstm_gates`] | everything of a recurrent step that is not a matrix product |
//! | [`sum`] | what reading weights takes, to measure by |
//!
//! Those below are for training, which happens in one process.
//!
//! | kernel | computes |
//! |---|---|
//! | [`gradient()`] | `x^T @ d`, the gradient of a weight |
//! | [`transpose`] | what turns `linear` into `d @ w^T`, the derivative of an input |
//! | [`sum_rows`], [`relu_backward`] | derivatives of a bias and of `relu` |
//! | [`gru_forward`], [`gru_backward`], [`lstm_forward`], [`lstm_backward`] | recurrent steps that can be taken back |
//! | [`sum_of_squares`], [`adam`] | the optimiser, in one pass over memory |
//! | [`all_finite`] | whether training has kept its numbers |
//!
//! Matrices are row-major; a weight is stored *input-major*, `[inputs, outputs]`, because then the weights
//! that meet one input lie side by side and a product streams them once from front to back.
//!
//! **A row's bits never depend on the rows computed with it.** Every output of `linear` is one chain of
//! fused multiply-adds that starts at the bias and takes the inputs in order, in every code path; a vector
//! lane is one output, never a part of a sum. The element-wise kernels use the same operations for full
//! vectors and for tails. So one row and a thousand rows agree to the last bit, and so do AVX2, AVX-512 and
//! NEON. A CPU without fused multiply-add rounds twice and gives other (equally exact) bits.
//!
//! The instruction set is chosen at run time, once. No kernel allocates or starts threads, and none is unsafe but one of
//! [`linear_of_nibbles`], for an instruction that is not in `pulp`. Shapes are the caller's responsibility: a wrong one is a
//! bug, and panics.

mod adam;
mod elementwise;
mod gates;
mod gradient;
mod halves;
mod linear;
mod nibbles;
mod recurrent;
#[cfg(test)]
mod tests;

pub use adam::AdamStep;
pub use halves::{linear_of_halves, take_halves};
pub use linear::Start;
pub use nibbles::{Nibbles, linear_of_nibbles};

use pulp::{Arch, Simd};
use std::sync::LazyLock;

/// The instruction set of this machine.
static ARCH: LazyLock<Arch> = LazyLock::new(Arch::new);

/// The name of the instruction set that is used. On another one sums may be grouped differently.
pub fn instruction_set() -> &'static str {
    struct Name;
    impl pulp::WithSimd for Name {
        type Output = &'static str;
        fn with_simd<S: Simd>(self, _: S) -> &'static str {
            std::any::type_name::<S>().rsplit("::").next().unwrap_or_default()
        }
    }
    ARCH.dispatch(Name)
}

/// `y = x @ weight + start`: `x` is `[rows, k]`, `weight` `[k, n]`, `y` `[rows, n]`.
///
/// With [`Start::Bias`] the bias is `[n]`; with [`Start::Output`] the products are added to what `y` holds.
/// `k` and `n` follow from the lengths of `x` and `y`.
pub fn linear(rows: usize, x: &[f32], weight: &[f32], start: Start, y: &mut [f32]) {
    if let Some(op) = linear::Linear::new(rows, x, weight, start, y) {
        ARCH.dispatch(op);
    }
}

/// `max(x, 0)` in place; NaN stays NaN.
pub fn relu(values: &mut [f32]) {
    ARCH.dispatch(elementwise::Relu(values));
}

/// `1 / (1 + exp(-x))` in place, to a few units in the last place.
pub fn sigmoid(values: &mut [f32]) {
    ARCH.dispatch(elementwise::Sigmoid(values));
}

/// `tanh(x)` in place, to a few units in the last place.
pub fn tanh(values: &mut [f32]) {
    ARCH.dispatch(elementwise::Tanh(values));
}

/// Adds the vector `row` `[n]` to `y` `[n]`.
pub fn add(row: &[f32], y: &mut [f32]) {
    assert_eq!(row.len(), y.len(), "add: lengths differ");
    ARCH.dispatch(elementwise::Add(row, y));
}

/// The sum of `values`, in an order of its own: every one is read once from front to back, which is the least that a
/// forward pass of one row does with its weights.
pub fn sum(values: &[f32]) -> f32 {
    ARCH.dispatch(elementwise::Sum(values))
}

/// The gates of a GRU step (PyTorch's order r, z, n): `hidden` `[rows, h]` goes from one step to the next.
///
/// `input` and `recurrent` are `[rows, 3 h]`: the products with the step's input and with `hidden`, each
/// with its bias. `n = tanh(input_n + r * recurrent_n)`, `hidden = (1 - z) * n + z * hidden`.
pub fn gru_gates(rows: usize, input: &[f32], recurrent: &[f32], hidden: &mut [f32]) {
    if hidden.is_empty() {
        return;
    }
    assert_eq!(hidden.len() % rows, 0, "gru: hidden is not [rows, h]");
    assert_eq!(input.len(), 3 * hidden.len(), "gru: input is not [rows, 3 h]");
    assert_eq!(recurrent.len(), 3 * hidden.len(), "gru: recurrent is not [rows, 3 h]");
    ARCH.dispatch(gates::Gru { h: hidden.len() / rows, input, recurrent, hidden });
}

/// The gates of an LSTM step (PyTorch's order i, f, g, o): `hidden` and `cell` `[rows, h]` go from one step
/// to the next.
///
/// `gates` is `[rows, 4 h]`: the products with the step's input and with `hidden` and the first bias;
/// `bias` `[4 h]` is the second one. `cell = f * cell + i * g`, `hidden = o * tanh(cell)`.
pub fn lstm_gates(rows: usize, gates: &[f32], bias: &[f32], hidden: &mut [f32], cell: &mut [f32]) {
    if hidden.is_empty() {
        return;
    }
    assert_eq!(hidden.len() % rows, 0, "lstm: hidden is not [rows, h]");
    assert_eq!(cell.len(), hidden.len(), "lstm: cell is not [rows, h]");
    assert_eq!(gates.len(), 4 * hidden.len(), "lstm: gates are not [rows, 4 h]");
    assert_eq!(bias.len(), 4 * hidden.len() / rows, "lstm: bias is not [4 h]");
    ARCH.dispatch(gates::Lstm { h: hidden.len() / rows, gates, bias, hidden, cell });
}

/// `gradient = x^T @ d`: `x` is `[rows, k]`, `d` `[rows, n]`, `gradient` `[k, n]`.
///
/// `k` and `n` follow from the lengths of `x` and `d`.
pub fn gradient(rows: usize, x: &[f32], d: &[f32], gradient: &mut [f32]) {
    if let Some(op) = gradient::Gradient::new(rows, x, d, gradient) {
        ARCH.dispatch(op);
    }
}

/// `y = x^T`: `x` is `[rows, columns]`, `y` `[columns, rows]`.
pub fn transpose(rows: usize, columns: usize, x: &[f32], y: &mut [f32]) {
    assert_eq!((x.len(), y.len()), (rows * columns, rows * columns), "transpose: lengths differ");
    // Square blocks, so that the cache lines of both matrices are used whole before they are gone.
    const BLOCK: usize = 16;
    for (row, column) in
        (0..rows).step_by(BLOCK).flat_map(|r| (0..columns).step_by(BLOCK).map(move |c| (r, c)))
    {
        let height = BLOCK.min(rows - row);
        for column in column..columns.min(column + BLOCK) {
            let y = &mut y[column * rows + row..][..height];
            y.iter_mut().enumerate().for_each(|(r, y)| *y = x[(row + r) * columns + column]);
        }
    }
}

/// `sum` `[n]` becomes the sum of the rows of `d` `[rows, n]`.
pub fn sum_rows(d: &[f32], sum: &mut [f32]) {
    sum.fill(0.0);
    d.chunks_exact(sum.len()).for_each(|row| add(row, sum));
}

/// From the derivative by `relu(x)` to the one by `x`, in place: `d` is zero where `y = relu(x)` is.
pub fn relu_backward(y: &[f32], d: &mut [f32]) {
    assert_eq!(y.len(), d.len(), "relu_backward: lengths differ");
    ARCH.dispatch(elementwise::ReluBackward(y, d));
}

/// Whether no value is infinite or NaN. It looks at all of them, several at a time, because hardly ever is
/// one to be found.
pub fn all_finite(values: &[f32]) -> bool {
    values.iter().fold(true, |finite, value| finite & value.is_finite())
}

/// [`gru_gates`] that can be taken back: `after` `[rows, h]` follows on `before`, and r, z and n replace the
/// products with the input in `gates` `[rows, 3 h]`.
pub fn gru_forward(rows: usize, gates: &mut [f32], recurrent: &[f32], before: &[f32], after: &mut [f32]) {
    let h = hidden_size(rows, after, &[(before, 1), (gates, 3), (recurrent, 3)]);
    ARCH.dispatch(recurrent::GruForward { h, gates, recurrent, before, after });
}

/// Takes [`gru_forward`] back. `d` `[rows, h]` goes from the derivative by the state after the step to that
/// by the state before it, without what comes through `recurrent`; `gates` and `recurrent` become the
/// derivatives by the products.
pub fn gru_backward(rows: usize, gates: &mut [f32], recurrent: &mut [f32], before: &[f32], d: &mut [f32]) {
    let h = hidden_size(rows, d, &[(before, 1), (gates, 3), (recurrent, 3)]);
    ARCH.dispatch(recurrent::GruBackward { h, gates, recurrent, before, d });
}

/// [`lstm_gates`] that can be taken back: `cell` and `hidden` `[rows, h]` follow on `cell_before`, and i, f,
/// g and o replace the products in `gates` `[rows, 4 h]`.
pub fn lstm_forward(
    rows: usize,
    gates: &mut [f32],
    bias: &[f32],
    cell_before: &[f32],
    cell: &mut [f32],
    hidden: &mut [f32],
) {
    let h = hidden_size(rows, hidden, &[(cell_before, 1), (cell, 1), (gates, 4)]);
    assert_eq!(bias.len(), 4 * h, "lstm: bias is not [4 h]");
    ARCH.dispatch(recurrent::LstmForward { h, gates, bias, cell_before, cell, hidden });
}

/// Takes [`lstm_forward`] back. `d` `[rows, h]` is the derivative by `hidden`; `d_cell` goes from what later
/// steps say of the derivative by `cell` to that by `cell_before`; `gates` become the derivatives by the
/// products.
pub fn lstm_backward(
    rows: usize,
    gates: &mut [f32],
    cell_before: &[f32],
    cell: &[f32],
    d: &[f32],
    d_cell: &mut [f32],
) {
    let h = hidden_size(rows, d, &[(cell_before, 1), (cell, 1), (d_cell, 1), (gates, 4)]);
    ARCH.dispatch(recurrent::LstmBackward { h, gates, cell_before, cell, d, d_cell });
}

/// The sum of the squares of `values`, in an order of its own that is always the same.
pub fn sum_of_squares(values: &[f32]) -> f64 {
    const LANES: usize = 16;
    // Short runs in f32, each in sums side by side, which the compiler makes vectors; added up in f64.
    let run = |values: &[f32]| {
        let (chunks, rest) = values.as_chunks::<LANES>();
        let mut sums = [0.0f32; LANES];
        for chunk in chunks {
            sums.iter_mut().zip(chunk).for_each(|(sum, value)| *sum += value * value);
        }
        let rest = rest.iter().map(|value| value * value);
        sums.into_iter().chain(rest).map(f64::from).sum::<f64>()
    };
    values.chunks(64 * LANES).map(run).sum()
}

/// One step of Adam: `values` follow on the `gradient`, whose running mean and mean square are `mean` and
/// `square`; all of one length.
pub fn adam(step: AdamStep, gradient: &[f32], mean: &mut [f32], square: &mut [f32], values: &mut [f32]) {
    let lengths = [gradient.len(), mean.len(), square.len()];
    assert_eq!(lengths, [values.len(); 3], "adam: lengths differ");
    ARCH.dispatch(adam::Adam { step, gradient, mean, square, values });
}

/// The hidden size h of `rows` states; checks that the others are so many times as long.
fn hidden_size(rows: usize, state: &[f32], others: &[(&[f32], usize)]) -> usize {
    let h = state.len() / rows;
    assert!(h > 0 && state.len() == rows * h, "a state is [rows, h]");
    for (values, times) in others {
        assert_eq!(values.len(), times * state.len(), "gates and states are of one size");
    }
    h
}

/// Up to one vector of values from the front of `values`; missing lanes are zero.
#[inline(always)]
fn load<S: Simd>(simd: S, values: &[f32]) -> S::f32s {
    match S::as_simd_f32s(values).0.first() {
        Some(&full) => full,
        None => simd.partial_load_f32s(values),
    }
}

/// Stores as many lanes of `vector` as `values` has room for.
#[inline(always)]
fn store<S: Simd>(simd: S, values: &mut [f32], vector: S::f32s) {
    match S::as_mut_simd_f32s(values).0.first_mut() {
        Some(full) => *full = vector,
        None => simd.partial_store_f32s(values, vector),
    }
}

/// Asks for the cache line at `place`; where there is none, nothing happens.
#[inline(always)]
fn fetch<T>(place: *const T) {
    #[cfg(target_arch = "x86_64")]
    if let Some(sse) = pulp::core_arch::x86::Sse::try_new() {
        sse._mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(place.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = place;
}
