//! How much of what is believed is due to the law of motion.

use crate::dynamics::{Bodies, Dynamics, Law};

/// The slopes of all beliefs in the two parameters of a [`Law`], with which they are put right once another law is found:
/// the derivatives of each dim since it was last observed. Linear in the gain; in what a body keeps, the error is of second
/// order.
#[derive(Debug)]
pub(super) struct Slopes {
    predicted: usize,
    /// In what a body keeps, `[rows, predicted]`.
    keep: Vec<f32>,
    /// In the gain, `[rows, predicted]`.
    gain: Vec<f32>,
}

impl Slopes {
    pub(super) fn new(rows: usize, predicted: usize) -> Slopes {
        Slopes { predicted, keep: vec![0.0; rows * predicted], gain: vec![0.0; rows * predicted] }
    }

    /// Nothing depends on the law: an episode starts.
    pub(super) fn begin_episodes(&mut self) {
        self.keep.fill(0.0);
        self.gain.fill(0.0);
    }

    /// A dim has been observed in this row.
    pub(super) fn forget(&mut self, row: usize, dim: usize) {
        self.keep[row * self.predicted + dim] = 0.0;
        self.gain[row * self.predicted + dim] = 0.0;
    }

    /// The row `to` becomes the row `from`.
    pub(super) fn copy(&mut self, from: usize, to: usize) {
        for slopes in [&mut self.keep, &mut self.gain] {
            slopes.copy_within(from * self.predicted..(from + 1) * self.predicted, to * self.predicted);
        }
    }

    /// Moves those of an agent on by a step that begins as `belief` says and in which it is pushed like this, by itself and
    /// others.
    pub(super) fn advance(
        &mut self,
        row: usize,
        (dynamics, bodies): (&Dynamics, &Bodies),
        law: Law,
        agent: usize,
        pushed: [f64; 2],
        belief: &[f32],
    ) {
        let row = row * self.predicted..(row + 1) * self.predicted;
        let velocity = |dim: usize, _| f64::from(belief[dim]);
        dynamics.advance_slopes(law, bodies, agent, velocity, &mut self.keep[row.clone()]);
        dynamics.advance_slopes(law, bodies, agent, |_, axis| pushed[axis], &mut self.gain[row]);
    }

    /// A push has added this to a dim.
    pub(super) fn push(&mut self, row: usize, dim: usize, added: f64) {
        self.gain[row * self.predicted + dim] += added as f32;
    }

    /// What a dim changes by if one law takes the place of another.
    pub(super) fn change(&self, row: usize, dim: usize, from: Law, to: Law) -> f32 {
        let at = row * self.predicted + dim;
        let (keep, gain) = (to.keep - from.keep, to.gain - from.gain);
        (keep * f64::from(self.keep[at]) + gain * f64::from(self.gain[at])) as f32
    }
}
