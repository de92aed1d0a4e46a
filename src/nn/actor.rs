//! The actor: from the joint estimate to the logits of the actions.

use super::kernels::{self, Start};
use super::layers::{Linear, Recurrent, Scratch};

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

/// What an actor remembers of an episode: nothing if it is an MLP.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ActorState {
    /// The hidden state of a GRU, `[rows, hidden size]`.
    hidden: Vec<f32>,
    /// What it contributes to the next step, `[rows, 3 * hidden size]`, if that has been computed ahead.
    recurrent: Vec<f32>,
    is_ahead: bool,
}

/// The layer between the first and the last.
#[derive(Clone, Debug)]
pub(super) enum Middle {
    Linear(Linear),
    Gru(Recurrent),
}

impl Actor {
    /// The state in which `rows` episodes start.
    pub fn state(&self, rows: usize) -> ActorState {
        let mut state = ActorState::default();
        state.start(self, rows);
        state
    }

    /// One step of `rows` episodes: `state` advances, and `logits` become those of the inputs.
    ///
    /// `inputs` is `[rows, joint]`, `logits` `[rows, n_actions]`.
    pub fn forward(
        &self,
        rows: usize,
        inputs: &[f32],
        state: &mut ActorState,
        scratch: &mut Scratch,
        logits: &mut [f32],
    ) {
        assert_eq!(inputs.len(), rows * self.joint, "actor: inputs are not [rows, joint]");
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
                assert_eq!(state.hidden.len(), h, "actor: the state is not that of as many rows");
                self.prepare(rows, state);
                let ActorState { hidden, recurrent, is_ahead } = state;
                let [first, input] = scratch.split([h, 3 * h]);
                self.first(rows, inputs, first);
                cell.gru(rows, first, hidden, recurrent, input);
                *is_ahead = false;
                self.out.forward(rows, hidden, logits);
            }
        }
    }

    /// Computes what the next step takes of the state alone, half the work of a GRU. A step sees to it itself, but
    /// whoever calls this when an action is out has the next one sooner, by the same bits.
    pub fn prepare(&self, rows: usize, state: &mut ActorState) {
        if let (Middle::Gru(cell), false) = (&self.middle, state.is_ahead) {
            cell.recurrent(rows, &state.hidden, &mut state.recurrent);
            state.is_ahead = true;
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

impl ActorState {
    /// Forgets everything: `rows` episodes start. Allocates only for more rows than ever before.
    pub fn start(&mut self, actor: &Actor, rows: usize) {
        let hidden = match actor.middle {
            Middle::Linear(_) => 0,
            Middle::Gru(_) => rows * actor.hidden(),
        };
        self.hidden.clear();
        self.hidden.resize(hidden, 0.0);
        self.recurrent.resize(3 * hidden, 0.0);
        self.is_ahead = false;
    }
}
