//! What is not received counts as zero.

use super::{Carried, Imputer, Setup, Step};
use crate::agent::Inbox;

/// Carries nothing from one step to the next.
#[derive(Debug)]
pub(super) struct Zero(Carried);

impl Zero {
    pub(super) fn new(setup: &Setup) -> Zero {
        Zero(Carried::new(setup))
    }
}

impl Imputer for Zero {
    fn begin_episodes(&mut self, _worlds: usize) {}

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.0.fuse(world, own, inbox, estimate);
        // What is now was not received.
        self.0.late(inbox).for_each(|(sender, _)| estimate[self.0.layout().part(sender)].fill(0.0));
    }

    fn predict(&mut self, _step: &Step) {}
}
