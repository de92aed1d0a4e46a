//! The same networks in candle, which derives their gradients itself.

use candle_core::{D, Device, Result, Tensor, Var};
use candle_nn::ops::sigmoid;

use crate::nn::{Layer, Network};
use crate::train::memory::Flat;

/// A network that candle computes and takes back. Products with the inputs of all time steps are one here too.
#[derive(Clone, Debug)]
pub struct Candle {
    layers: Vec<Layer>,
    shapes: Vec<Vec<usize>>,
    out: Vec<f32>,
    pass: Option<Pass>,
}

/// A forward pass, as far as the backward pass needs it.
#[derive(Clone, Debug)]
struct Pass {
    weights: Vec<Var>,
    /// What each cell takes of the inputs of all steps, and each step's part of it as the cell's own variable. A part
    /// that candle itself has cut out has a derivative as large as the whole, in every step.
    cells: Vec<(Tensor, Vec<Var>)>,
    out: Tensor,
}

/// Shapes follow from the weights, and nothing else can fail on a CPU.
const SHAPES_FIT: &str = "inputs and weights are those of one network";

impl Candle {
    /// A network of these layers.
    pub fn new(network: &Network) -> Candle {
        let shapes = network.tensors().into_iter().map(|spec| spec.shape).collect();
        Candle { layers: network.layers.clone(), shapes, out: Vec::new(), pass: None }
    }

    /// See [`Passes::forward`](super::Passes::forward).
    pub fn forward(&mut self, weights: &Flat, steps: usize, rows: usize, x: &[f32]) -> &[f32] {
        let weights = self.shapes.iter().enumerate().map(|(at, shape)| {
            Var::from_tensor(&Tensor::from_slice(weights.tensor(at), &shape[..], &Device::Cpu)?)
        });
        let weights = weights.collect::<Result<_>>().expect(SHAPES_FIT);
        let pass = Pass::forward(&self.layers, weights, steps, rows, x).expect(SHAPES_FIT);
        self.out = values(&pass.out).expect(SHAPES_FIT);
        self.pass = Some(pass);
        &self.out
    }

    /// See [`Passes::backward`](super::Passes::backward).
    pub fn backward(&mut self, d: &[f32], gradient: &mut Flat) {
        let pass = self.pass.take().expect("a backward pass follows on a forward pass");
        pass.backward(d, gradient).expect(SHAPES_FIT);
    }
}

impl Pass {
    fn forward(layers: &[Layer], weights: Vec<Var>, steps: usize, rows: usize, x: &[f32]) -> Result<Pass> {
        let mut x = Tensor::from_slice(x, (steps * rows, x.len() / (steps * rows)), &Device::Cpu)?;
        let seen = x.clone();
        let (mut rest, mut cells) = (&weights[..], Vec::new());
        for layer in layers {
            let own = rest.split_off(..layer.n_tensors()).expect("every layer has its tensors");
            x = match layer {
                Layer::Linear { relu: false, .. } => linear(&x, &own[0], &own[1])?,
                Layer::Linear { relu: true, .. } => linear(&x, &own[0], &own[1])?.relu()?,
                Layer::Skip { .. } => (x + seen.matmul(&own[0])?)?,
                Layer::Gru(_) | Layer::Lstm(_) => {
                    let input = linear(&x, &own[0], &own[2])?;
                    let parts =
                        (0..steps).map(|step| Var::from_tensor(&input.narrow(0, step * rows, rows)?));
                    let parts = parts.collect::<Result<Vec<Var>>>()?;
                    let bias = own[3].broadcast_as((rows, input.dim(1)?))?;
                    let states = match layer {
                        Layer::Gru(_) => gru(&parts, &own[1], &bias)?,
                        _ => lstm(&parts, &own[1], &bias)?,
                    };
                    cells.push((input, parts));
                    Tensor::cat(&states, 0)?
                }
            };
        }
        Ok(Pass { cells, out: x, weights })
    }

    fn backward(&self, d: &[f32], gradient: &mut Flat) -> Result<()> {
        let d = Tensor::from_slice(d, self.out.dims(), &Device::Cpu)?;
        let mut gradients = (&self.out * d)?.sum_all()?.backward()?;
        for (input, parts) in self.cells.iter().rev() {
            let d = parts.iter().map(|part| gradients.get(part).expect("every step counts"));
            let d = Tensor::cat(&d.collect::<Vec<_>>(), 0)?;
            gradients.extend((input * d)?.sum_all()?.backward()?)?;
        }
        for (to, weight) in gradient.each_mut().zip(&self.weights) {
            to.copy_from_slice(&values(gradients.get(weight).expect("every weight counts"))?);
        }
        Ok(())
    }
}

/// The states after each step of a GRU cell, `[rows, h]`, from the products with the input.
fn gru(inputs: &[Var], weight: &Tensor, bias: &Tensor) -> Result<Vec<Tensor>> {
    let h = weight.dim(0)?;
    let mut states: Vec<Tensor> = Vec::with_capacity(inputs.len());
    let mut state = Tensor::zeros((bias.dim(0)?, h), bias.dtype(), bias.device())?;
    for input in inputs {
        let recurrent = (state.matmul(weight)? + bias)?;
        let gates =
            sigmoid(&(input.narrow(1, 0, 2 * h)? + recurrent.narrow(1, 0, 2 * h)?)?)?.chunk(2, D::Minus1)?;
        let new = (input.narrow(1, 2 * h, h)? + (&gates[0] * recurrent.narrow(1, 2 * h, h)?)?)?.tanh()?;
        state = (&new + (&gates[1] * (state - &new)?)?)?;
        states.push(state.clone());
    }
    Ok(states)
}

/// The hidden states after each step of an LSTM, `[rows, h]`, from the products with the input.
fn lstm(inputs: &[Var], weight: &Tensor, bias: &Tensor) -> Result<Vec<Tensor>> {
    let h = weight.dim(0)?;
    let zeros = Tensor::zeros((bias.dim(0)?, h), bias.dtype(), bias.device())?;
    let (mut state, mut cell) = (zeros.clone(), zeros);
    let mut states = Vec::with_capacity(inputs.len());
    for input in inputs {
        let gates = ((input.as_tensor() + state.matmul(weight)?)? + bias)?.chunk(4, D::Minus1)?;
        let kept = (sigmoid(&gates[1])? * cell)?;
        cell = (kept + (sigmoid(&gates[0])? * gates[2].tanh()?)?)?;
        state = (sigmoid(&gates[3])? * cell.tanh()?)?;
        states.push(state.clone());
    }
    Ok(states)
}

fn linear(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Result<Tensor> {
    x.matmul(weight)?.broadcast_add(bias)
}

fn values(tensor: &Tensor) -> Result<Vec<f32>> {
    tensor.flatten_all()?.to_vec1()
}
