//! How much of what is believed is due to the law of motion.

use crate::dynamics::Law;

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
    /// Both as they were before the last step: somebody may have been wrong about it.
    before: [Vec<f32>; 2],
}

impl Slopes {
    pub(super) fn new(rows: usize, predicted: usize) -> Slopes {
        let zeros = || vec![0.0; rows * predicted];
        Slopes { predicted, keep: zeros(), gain: zeros(), before: [zeros(), zeros()] }
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

    /// A step is about to be made.
    pub(super) fn remember(&mut self) {
        let [keep, gain] = &mut self.before;
        keep.copy_from_slice(&self.keep);
        gain.copy_from_slice(&self.gain);
    }

    /// The last step has not been made.
    pub(super) fn take_back(&mut self) {
        let [keep, gain] = &self.before;
        self.keep.copy_from_slice(keep);
        self.gain.copy_from_slice(gain);
    }

    /// Those in what a body keeps and in the gain, of all dims in a row.
    pub(super) fn of(&mut self, row: usize) -> [&mut [f32]; 2] {
        let row = row * self.predicted..(row + 1) * self.predicted;
        [&mut self.keep[row.clone()], &mut self.gain[row]]
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
