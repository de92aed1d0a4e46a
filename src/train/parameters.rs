//! The weights of a network in training: values, gradient and the moments of Adam.

use super::memory::Flat;
use crate::nn::kernels::{self, AdamStep};
use crate::nn::{Network, TensorSpec};

/// The weights of one network, the gradient of its loss, and the moments of Adam, all of one layout.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// What the network is called, such as `actors.0`.
    pub(super) name: String,
    /// What the tensors are called, and their shapes.
    pub specs: Vec<TensorSpec>,
    /// The weights.
    pub values: Flat,
    /// The gradient by the weights.
    pub gradient: Flat,
    /// The running mean of the gradient.
    pub(super) mean: Flat,
    /// The running mean of its square.
    pub(super) square: Flat,
    /// Steps of Adam so far.
    pub(super) steps: u64,
}

impl Parameters {
    /// Untrained weights: PyTorch's default initialisation, see [`TensorSpec::untrained`].
    pub fn untrained(network: &Network, seed: u64) -> Parameters {
        let specs = network.tensors();
        let zeros = Flat::zeros(&specs);
        let mut values = zeros.clone();
        for (at, spec) in specs.iter().enumerate() {
            let tensor = values.tensor_mut(at).iter_mut();
            tensor.zip(spec.untrained(seed)).for_each(|(value, drawn)| *value = drawn);
        }
        let [gradient, mean, square] = [zeros.clone(), zeros.clone(), zeros];
        Parameters { name: network.name.clone(), specs, values, gradient, mean, square, steps: 0 }
    }

    /// The tensors with their names and shapes.
    pub fn tensors(&self) -> impl Iterator<Item = (&TensorSpec, &[f32])> {
        self.specs.iter().enumerate().map(|(at, spec)| (spec, self.values.tensor(at)))
    }

    /// Floating-point operations of the products with all weights for one row (of one step) forward and
    /// backward: a multiply-add is two, and each is needed for the output, for the weight's gradient and, but where the
    /// input is the network's own, for the derivative by the input.
    pub(super) fn flop_both_ways(&self) -> f64 {
        let on_input = |(at, spec): &(usize, &TensorSpec)| *at == 0 || spec.name.ends_with(".skip.weight");
        let on_input = self.specs.iter().enumerate().filter(on_input);
        3.0 * self.flop_forward() - on_input.map(|(_, spec)| 2.0 * spec.n_values() as f64).sum::<f64>()
    }

    /// Those of the output alone.
    pub(super) fn flop_forward(&self) -> f64 {
        let weights = self.specs.iter().filter(|spec| spec.shape.len() == 2);
        weights.map(|spec| 2.0 * spec.n_values() as f64).sum()
    }

    /// All weights, one tensor after the other.
    pub(super) fn all_values(&self) -> Vec<f32> {
        self.tensors().flat_map(|(_, values)| values).copied().collect()
    }

    /// What outlives an update: the weights and Adam's moments.
    pub(super) fn state_mut(&mut self) -> [&mut Flat; 3] {
        [&mut self.values, &mut self.mean, &mut self.square]
    }

    /// The square of the gradient's norm.
    pub(crate) fn squared_norm(&self) -> f64 {
        kernels::sum_of_squares(self.gradient.all())
    }

    /// One step of Adam against the gradient times `scale`.
    pub fn step(&mut self, learning_rate: f64, scale: f64) {
        self.steps += 1;
        kernels::adam(
            AdamStep::new(self.steps, learning_rate, scale),
            self.gradient.all(),
            self.mean.all_mut(),
            self.square.all_mut(),
            self.values.all_mut(),
        );
    }
}

/// What to multiply gradients with of this norm so that it is at most `largest`, as PyTorch's
/// `clip_grad_norm_` does.
pub(super) fn clip_scale(norm: f64, largest: f64) -> f64 {
    (largest / (norm + 1e-6)).min(1.0)
}
