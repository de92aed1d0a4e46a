//! Where an episode has come to: the address of all that is random in its steps.

use crate::base::rng::{Draws, Purpose};

/// A step of an episode.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Moment {
    seed: u64,
    episode: u64,
    step: u64,
}

impl Moment {
    /// The first step of an episode.
    pub(super) fn first(seed: u64, episode: u64) -> Moment {
        Moment { seed, episode, step: 0 }
    }

    /// What is drawn for a purpose in this step.
    pub(super) fn draws(self, purpose: Purpose) -> Draws {
        Draws::new(self.seed, purpose, self.episode, self.step)
    }

    /// Goes on to the next step.
    pub(super) fn pass(&mut self) {
        self.step += 1;
    }
}
