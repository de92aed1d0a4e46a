//! The actor: from the joint estimate to the logits of the actions.

use super::kernels::{self, Start};
use super::layers::{Cell, Linear, Scratch};

/// The policy network of one agent:
/// `Linear -> ReLU -> { Linear -> ReLU | GRU cell } -> Linear`.
///
/// Of a network that all agents share, each agent's actor is the same weights and its own id, which the
/// network sees as a one-hot vector behind the joint estimate.
#[derive(Clone, Debug)]
pub struct Actor {
    pub(super) fc1: Linear,
    pub(super) middle: Middle,
    pub(super) out: Linear,
    /// This agent's id, where the network is shared.
    pub(super) id: Option<usize>,
    /// Length of the joint estimate, without the id.
    pub(super) joint: usize,
}

/// The layer between the first and the last.
#[derive(Clone, Debug)]
pub(super) enum Middle {
    Linear(Linear),
    Gru(Cell),
}

impl Actor {
    /// Length of a row of hidden state: the hidden size of a GRU, 0 for an MLP.
    pub fn state_len(&self) -> usize {
        match self.middle {
            Middle::Linear(_) => 0,
            Middle::Gru(_) => self.hidden(),
        }
    }

    /// The logits of `rows` inputs.
    ///
    /// `inputs` is `[rows, joint]`, `logits` `[rows, n_actions]`. `hidden` is `[rows, state_len]` and goes
    /// from one step to the next; it starts an episode at zero.
    pub fn forward(
        &self,
        rows: usize,
        inputs: &[f32],
        hidden: &mut [f32],
        scratch: &mut Scratch,
        logits: &mut [f32],
    ) {
        assert_eq!(inputs.len(), rows * self.joint, "actor: inputs are not [rows, joint]");
        assert_eq!(hidden.len(), rows * self.state_len(), "actor: hidden is not [rows, state_len]");
        let h = rows * self.hidden();
        match &self.middle {
            Middle::Linear(fc2) => {
                let [first, second] = scratch.split([h, h]);
                self.first(rows, inputs, first);
                fc2.forward(rows, first, second);
                kernels::relu(second);
                self.out.forward(rows, second, logits);
            }
            Middle::Gru(cell) => {
                let [first, input, recurrent] = scratch.split([h, 3 * h, 3 * h]);
                self.first(rows, inputs, first);
                cell.gru(rows, first, hidden, input, recurrent);
                self.out.forward(rows, hidden, logits);
            }
        }
    }

    /// Takes new values, those of [`Networks::actor_tensors`](super::Networks::actor_tensors), one tensor after
    /// the other. It allocates only while it shares its memory with other networks.
    ///
    /// # Panics
    /// If there are too few values or too many.
    pub fn renew(&mut self, mut values: &[f32]) {
        self.fc1.renew(&mut values);
        match &mut self.middle {
            Middle::Linear(fc2) => fc2.renew(&mut values),
            Middle::Gru(cell) => cell.renew(&mut values),
        }
        self.out.renew(&mut values);
        assert!(values.is_empty(), "actor: more values than weights");
    }

    /// The first layer. The one-hot id multiplies one row of the weight by one and all others by zero, so
    /// adding that row last gives the very bits of the whole product.
    fn first(&self, rows: usize, inputs: &[f32], y: &mut [f32]) {
        let h = self.hidden();
        let (joint, ids) = self.fc1.weight.values().split_at(self.joint * h);
        kernels::linear(rows, inputs, joint, Start::Bias(self.fc1.bias.values()), y);
        if let Some(id) = self.id {
            y.chunks_exact_mut(h).for_each(|row| kernels::add(&ids[id * h..][..h], row));
        }
        kernels::relu(y);
    }

    fn hidden(&self) -> usize {
        self.fc1.bias.values().len()
    }
}
