//! What is not received counts as what was received last.

use super::{Carried, Imputer, Setup, Step};
use crate::agent::Inbox;

/// Carries the estimate on as it is.
#[derive(Debug)]
pub(super) struct Hold(Carried);

impl Hold {
    pub(super) fn new(setup: &Setup) -> Hold {
        Hold(Carried::new(setup))
    }
}

impl Imputer for Hold {
    fn begin_episodes(&mut self, _worlds: usize) {
        self.0.forget();
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.0.fuse(world, own, inbox, estimate);
    }

    fn predict(&mut self, step: &Step) {
        for (carried, estimate) in self.0.follow(step.estimates) {
            carried.copy_from_slice(&estimate[..carried.len()]);
        }
    }
}
