//! The predictor: what the joint observation will change by, step after step.

use super::kernels;
use super::layers::{Linear, Recurrent, Scratch};
use super::networks::PredictorSpec;

/// `Linear -> ReLU -> LSTM -> Linear`: from the joint estimate of one step to the distribution of the change
/// of its predicted dims until the next step.
#[derive(Clone, Debug)]
pub struct Predictor {
    pub(super) spec: PredictorSpec,
    pub(super) fc1: Linear,
    pub(super) lstm: Recurrent,
    pub(super) out: Linear,
    /// Length of the joint estimate.
    pub(super) joint: usize,
}

/// What a predictor remembers of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct LstmState {
    /// The hidden state, `[rows, hidden size]`.
    pub hidden: Vec<f32>,
    /// The cell state, `[rows, hidden size]`.
    pub cell: Vec<f32>,
}

impl Predictor {
    /// What kind of predictor this is.
    pub fn spec(&self) -> &PredictorSpec {
        &self.spec
    }

    /// The state in which `rows` episodes start: zero.
    pub fn state(&self, rows: usize) -> LstmState {
        let zeros = vec![0.0; rows * self.spec.hidden];
        LstmState { hidden: zeros.clone(), cell: zeros }
    }

    /// One step of `rows` episodes: `state` advances, and `out` becomes the prediction.
    ///
    /// `estimates` is `[rows, joint]`; `acts` `[rows]` what the agent does, as [`Dims::act`](super::Dims::act) counts,
    /// and ignored by a predictor that does not see it; `out` `[rows, 2 * predicted]`: first the mean of the change of each
    /// predicted dim, zero where the dim is held; then its raw log-std, to be read by the
    /// [sigma rule](super::Sigma).
    pub fn step(
        &self,
        rows: usize,
        estimates: &[f32],
        acts: &[usize],
        state: &mut LstmState,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        let h = rows * self.spec.hidden;
        let [first, gates] = scratch.split([h, 4 * h]);
        assert_eq!(estimates.len(), rows * self.joint, "predictor: estimates are not [rows, joint]");
        if self.spec.sees_own_action() {
            self.fc1.forward_with_ones(rows, estimates, acts, first)
        } else {
            self.fc1.forward(rows, estimates, first)
        }
        kernels::relu(first);
        self.lstm.lstm(rows, first, &mut state.hidden, &mut state.cell, gates);
        self.out.forward(rows, &state.hidden, out);
        for row in out.chunks_exact_mut(self.out.bias.values().len()) {
            self.spec.held.iter().for_each(|&dim| row[dim] = 0.0);
        }
    }

    /// Takes new values, those of [`PredictorSpec::tensors`], one tensor after the other. It allocates only
    /// while it shares its memory with other networks.
    ///
    /// # Panics
    /// If there are too few values or too many.
    pub fn renew(&mut self, mut values: &[f32]) {
        self.fc1.renew(&mut values);
        self.lstm.renew(&mut values);
        self.out.renew(&mut values);
        assert!(values.is_empty(), "predictor: more values than weights");
    }
}

impl LstmState {
    /// Becomes what `other` is. Allocates only for more rows than ever before.
    pub fn copy_from(&mut self, other: &LstmState) {
        self.hidden.clone_from(&other.hidden);
        self.cell.clone_from(&other.cell);
    }

    /// Forgets everything: `rows` episodes start. Allocates only for more rows than ever before.
    pub fn start(&mut self, predictor: &Predictor, rows: usize) {
        for part in [&mut self.hidden, &mut self.cell] {
            part.clear();
            part.resize(rows * predictor.spec.hidden, 0.0);
        }
    }
}
