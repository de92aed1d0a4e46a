//! The layers of a network in our own kernels, forward and backward.

use super::gru::Gru;
use super::lstm::Lstm;
use crate::nn::kernels::{self, Start};
use crate::nn::{Layer, Network};
use crate::train::memory::{Buffer, Flat};

/// A network, and what lies between its layers.
#[derive(Clone, Debug)]
pub struct Native {
    /// The number of rows of all steps.
    all: usize,
    /// Each layer's pass, and the number of its first tensor.
    passes: Vec<(usize, Pass)>,
    /// Derivatives by the output and by the input of the layer that is taken back.
    d_output: Buffer,
    d_input: Buffer,
    transposed: Buffer,
    /// Whether somebody asks for the derivative by what the network itself sees.
    to_input: bool,
}

/// What a layer keeps for the way back.
#[derive(Clone, Debug)]
enum Pass {
    Linear { relu: bool, out: Buffer },
    Gru(Gru),
    Lstm(Lstm),
    Skip { out: Buffer },
}

impl Native {
    /// A network of these layers.
    pub fn new(network: &Network) -> Native {
        let mut tensors = 0;
        let passes = network.layers.iter().map(|layer| {
            let first = tensors;
            tensors += layer.n_tensors();
            let pass = match *layer {
                Layer::Linear { relu, .. } => Pass::Linear { relu, out: Buffer::default() },
                Layer::Gru(_) => Pass::Gru(Gru::default()),
                Layer::Lstm(_) => Pass::Lstm(Lstm::default()),
                Layer::Skip { .. } => Pass::Skip { out: Buffer::default() },
            };
            (first, pass)
        });
        let passes = passes.collect();
        let [d_output, d_input, transposed] = Default::default();
        Native { all: 0, passes, d_output, d_input, transposed, to_input: false }
    }

    /// The same, and its backward pass goes on to the derivative by what the network itself sees. It has no skip.
    pub fn to_input(network: &Network) -> Native {
        Native { to_input: true, ..Native::new(network) }
    }

    /// See [`Passes::forward`](super::Passes::forward).
    pub fn forward<'a>(
        &'a mut self,
        weights: &Flat,
        steps: usize,
        rows: usize,
        seen: &'a [f32],
    ) -> &'a [f32] {
        self.all = steps * rows;
        let mut x = seen;
        for (first, pass) in &mut self.passes {
            x = match pass {
                Pass::Linear { relu, out } => {
                    let [weight, bias] = weights.tensors(*first);
                    let out = out.resize(self.all * bias.len());
                    kernels::linear(self.all, x, weight, Start::Bias(bias), out);
                    if *relu {
                        kernels::relu(out);
                    }
                    out
                }
                Pass::Gru(gru) => gru.forward(weights.tensors(*first), steps, rows, x),
                Pass::Lstm(lstm) => lstm.forward(weights.tensors(*first), steps, rows, x),
                Pass::Skip { out } => {
                    let [weight] = weights.tensors(*first);
                    out.resize(x.len()).copy_from_slice(x);
                    kernels::linear(self.all, seen, weight, Start::Output, out);
                    out
                }
            };
        }
        x
    }

    /// See [`Passes::backward`](super::Passes::backward). Returns the derivative by what the network itself sees, if
    /// somebody asks for it.
    pub fn backward(&mut self, weights: &Flat, seen: &[f32], d: &[f32], gradient: &mut Flat) -> &[f32] {
        let Native { all, passes, d_output, d_input, transposed, to_input } = self;
        let all = *all;
        d_output.resize(d.len()).copy_from_slice(d);
        for at in (0..passes.len()).rev() {
            let (before, now) = passes.split_at_mut(at);
            let (first, pass) = &mut now[0];
            let x = before.last().map_or(seen, |(_, before)| before.out());
            d_input.resize(if at == 0 && !*to_input { 0 } else { x.len() });
            match pass {
                Pass::Linear { relu, out } => {
                    let [weight, _] = weights.tensors(*first);
                    if *relu {
                        kernels::relu_backward(out, d_output);
                    }
                    linear_gradient(all, x, d_output, gradient.tensors_mut(*first));
                    linear_backward(all, d_output, weight, transposed, d_input);
                }
                Pass::Gru(gru) => {
                    let [w_ih, w_hh, _, _] = weights.tensors(*first);
                    let [g_w_ih, g_w_hh, g_b_ih, g_b_hh] = gradient.tensors_mut(*first);
                    let d = gru.backward(w_hh, d_output, [g_w_hh, g_b_hh], transposed);
                    linear_gradient(all, x, d, [g_w_ih, g_b_ih]);
                    linear_backward(all, d, w_ih, transposed, d_input);
                }
                Pass::Lstm(lstm) => {
                    let [w_ih, w_hh, _, _] = weights.tensors(*first);
                    let [g_w_ih, g_w_hh, g_b_ih, g_b_hh] = gradient.tensors_mut(*first);
                    let d = lstm.backward(w_hh, d_output, g_w_hh, transposed);
                    linear_gradient(all, x, d, [g_w_ih, &mut *g_b_ih]);
                    g_b_hh.copy_from_slice(g_b_ih);
                    linear_backward(all, d, w_ih, transposed, d_input);
                }
                Pass::Skip { .. } => {
                    let [g_weight] = gradient.tensors_mut(*first);
                    kernels::gradient(all, seen, d_output, g_weight);
                    d_input.copy_from_slice(d_output);
                }
            }
            std::mem::swap(d_output, d_input);
        }
        d_output
    }
}

impl Pass {
    /// What the next layer sees.
    fn out(&self) -> &[f32] {
        match self {
            Pass::Linear { out, .. } | Pass::Skip { out } => out,
            Pass::Gru(gru) => gru.out(),
            Pass::Lstm(lstm) => lstm.out(),
        }
    }
}

/// The gradients of weight and bias of a linear layer with input `x` and derivative `d` by its output.
pub(super) fn linear_gradient(all: usize, x: &[f32], d: &[f32], [weight, bias]: [&mut [f32]; 2]) {
    kernels::gradient(all, x, d, weight);
    kernels::sum_rows(d, bias);
}

/// `d_input = d @ weight^T`, unless nobody wants it. `transposed` is memory for the weight.
fn linear_backward(all: usize, d: &[f32], weight: &[f32], transposed: &mut Buffer, d_input: &mut [f32]) {
    if !d_input.is_empty() {
        let transposed = transposed.resize(weight.len());
        kernels::transpose(d_input.len() / all, d.len() / all, weight, transposed);
        kernels::linear(all, d, transposed, Start::Zero, d_input);
    }
}
