//! The arithmetic of the networks: hand-written f32 kernels, and the only place with SIMD in it.
//!
//! | kernel | computes |
//! |---|---|
//! | [`linear()`] | `y = x @ w + bias`, or `y += x @ w` |
//! | [`relu`], [`sigmoid`], [`tanh`] | in place, element by element |
//! | [`gru_gates`], [`lstm_gates`] | everything of a recurrent step that is not a matrix product |
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
//! The instruction set is chosen at run time, once. No kernel allocates, starts threads or is unsafe. Shapes
//! are the caller's responsibility: a wrong one is a bug, and panics.

mod elementwise;
mod gates;
mod linear;
#[cfg(test)]
mod tests;

pub use linear::Start;

use pulp::{Arch, Simd};
use std::sync::LazyLock;

/// The instruction set of this machine.
static ARCH: LazyLock<Arch> = LazyLock::new(Arch::new);

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
