//! The predictor: what the joint observation will change by, step after step.

use super::inference::{Inference, NetworkState, Scratch};
use super::networks::PredictorSpec;

/// From the joint estimate of one step to the distribution of the change of its predicted dims until the next
/// step, see [`PredictorSpec::network`].
#[derive(Clone, Debug)]
pub struct Predictor {
    pub(super) spec: PredictorSpec,
    pub(super) network: Inference,
}

impl Predictor {
    /// What kind of predictor this is.
    pub fn spec(&self) -> &PredictorSpec {
        &self.spec
    }

    /// The state in which `rows` episodes start: zero.
    pub fn state(&self, rows: usize) -> NetworkState {
        self.network.state(rows)
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
        state: &mut NetworkState,
        scratch: &mut Scratch,
        out: &mut [f32],
    ) {
        self.network.step(rows, estimates, acts, state, scratch, out);
        for row in out.chunks_exact_mut(out.len() / rows) {
            self.spec.held.iter().for_each(|&dim| row[dim] = 0.0);
        }
    }

    /// Takes new values, those of its tensors, one after the other. It allocates only while it shares its memory
    /// with other networks.
    ///
    /// # Panics
    /// If there are too few values or too many.
    pub fn renew(&mut self, values: &[f32]) {
        self.network.renew(values);
    }
}
