//! What networks are made of: linear layers, recurrent cells, and the scratch memory of a forward pass.

use super::kernels::{self, Start};
use super::weights::{Line, Tensor};

/// `y = x @ weight + bias`: weight `[inputs, outputs]`, bias `[outputs]`.
#[derive(Clone, Debug)]
pub(super) struct Linear {
    pub weight: Tensor,
    pub bias: Tensor,
}

impl Linear {
    pub(super) fn forward(&self, rows: usize, x: &[f32], y: &mut [f32]) {
        kernels::linear(rows, x, self.weight.values(), Start::Bias(self.bias.values()), y);
    }

    /// The same where each row of the input is a part of `x` and behind it a one-hot: `ones` says where its one is.
    /// The one multiplies one row of the weight and zeros all others, so adding that row last gives the very bits of the
    /// whole product.
    pub(super) fn forward_with_ones(&self, rows: usize, x: &[f32], ones: &[usize], y: &mut [f32]) {
        assert_eq!(ones.len(), rows, "every row has its one");
        let outputs = self.bias.values().len();
        let (weight, of_ones) = self.weight.values().split_at(x.len() / rows * outputs);
        kernels::linear(rows, x, weight, Start::Bias(self.bias.values()), y);
        for (y, one) in y.chunks_exact_mut(outputs).zip(ones) {
            kernels::add(&of_ones[one * outputs..][..outputs], y);
        }
    }

    /// Takes its new values from the front of `values`.
    pub(super) fn renew(&mut self, values: &mut &[f32]) {
        [&mut self.weight, &mut self.bias].into_iter().for_each(|tensor| tensor.renew(values));
    }
}

/// The weights of a GRU or LSTM cell with hidden size h and g gates (3 or 4): `weight_ih` `[inputs, g h]`,
/// `weight_hh` `[h, g h]`, both biases `[g h]`.
#[derive(Clone, Debug)]
pub(super) struct Recurrent {
    pub weight_ih: Tensor,
    pub weight_hh: Tensor,
    pub bias_ih: Tensor,
    pub bias_hh: Tensor,
}

impl Recurrent {
    /// One GRU step: `hidden` `[rows, h]` becomes that after `x`. `recurrent` `[rows, 3 h]` is what
    /// [`Recurrent::recurrent`] made of it, `input` `[rows, 3 h]` is scratch.
    pub(super) fn gru(
        &self,
        rows: usize,
        x: &[f32],
        hidden: &mut [f32],
        recurrent: &[f32],
        input: &mut [f32],
    ) {
        kernels::linear(rows, x, self.weight_ih.values(), Start::Bias(self.bias_ih.values()), input);
        kernels::gru_gates(rows, input, recurrent, hidden);
    }

    /// What the `hidden` state `[rows, h]` of a GRU alone contributes to the gates of its next step, `[rows, 3 h]`.
    pub(super) fn recurrent(&self, rows: usize, hidden: &[f32], recurrent: &mut [f32]) {
        kernels::linear(rows, hidden, self.weight_hh.values(), Start::Bias(self.bias_hh.values()), recurrent);
    }

    /// One LSTM step: `hidden` and `cell` `[rows, h]` become those after `x`. `gates` `[rows, 4 h]` is
    /// scratch.
    pub(super) fn lstm(
        &self,
        rows: usize,
        x: &[f32],
        hidden: &mut [f32],
        cell: &mut [f32],
        gates: &mut [f32],
    ) {
        kernels::linear(rows, x, self.weight_ih.values(), Start::Bias(self.bias_ih.values()), gates);
        kernels::linear(rows, hidden, self.weight_hh.values(), Start::Output, gates);
        kernels::lstm_gates(rows, gates, self.bias_hh.values(), hidden, cell);
    }

    /// Takes its new values from the front of `values`.
    pub(super) fn renew(&mut self, values: &mut &[f32]) {
        let Recurrent { weight_ih, weight_hh, bias_ih, bias_hh } = self;
        [weight_ih, weight_hh, bias_ih, bias_hh].into_iter().for_each(|tensor| tensor.renew(values));
    }
}

/// Memory for what lies between the layers of a forward pass.
///
/// It grows to the largest pass that it sees; from then on a pass allocates nothing. Any network can use any
/// scratch: nothing in it outlives a pass.
#[derive(Clone, Debug, Default)]
pub struct Scratch(Vec<Line>);

impl Scratch {
    /// Parts of these lengths, each on a cache line, with arbitrary content.
    pub(super) fn split<const N: usize>(&mut self, lengths: [usize; N]) -> [&mut [f32]; N] {
        let lines = lengths.map(|length| length.div_ceil(Line::VALUES));
        let total = lines.iter().sum();
        if self.0.len() < total {
            self.0.resize(total, Line::ZERO);
        }
        let mut rest = &mut self.0[..];
        std::array::from_fn(|part| {
            let (front, back) = std::mem::take(&mut rest).split_at_mut(lines[part]);
            rest = back;
            &mut bytemuck::cast_slice_mut(front)[..lengths[part]]
        })
    }
}
