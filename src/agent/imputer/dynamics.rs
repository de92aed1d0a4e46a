//! An agent knows what it did: its own state follows from that, wherever it is observed.

use super::motion::{Motion, remaining};
use super::{Imputer, Setup, Step};
use crate::agent::Inbox;
use crate::base::error::Result;

/// What tells of the agent itself is moved on by the dynamics that the policy file holds, with the action that was carried
/// out, also where only a teammate observes it. Landmarks stay where they are. Everything else is what the policy's best
/// predictor says, or held if it has none. Contacts follow from where it believes the others to be.
#[derive(Debug)]
pub(super) struct OwnDynamics {
    others: Box<dyn Imputer>,
    motion: Motion,
    agent: usize,
}

impl OwnDynamics {
    /// With the dynamics and the preferred predictor of the policy.
    ///
    /// # Errors
    /// `Usage` if the policy has no dynamics, or not of this environment.
    pub(super) fn new(setup: &Setup) -> Result<OwnDynamics> {
        Ok(OwnDynamics { motion: Motion::new(setup)?, others: remaining(setup), agent: setup.agent })
    }

    fn advance(&mut self, step: &Step) {
        for (world, &action) in step.actions.iter().enumerate() {
            let push = self.motion.dynamics.push(self.agent, action as usize);
            self.motion.advance(world, self.agent, push, step.estimates);
        }
    }
}

impl Imputer for OwnDynamics {
    fn begin_episodes(&mut self, worlds: usize) {
        self.others.begin_episodes(worlds);
        self.motion.expects = false;
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.others.fuse(world, own, inbox, estimate);
        self.motion.correct(world, self.agent, inbox, estimate);
    }

    fn predict(&mut self, step: &Step) {
        self.others.predict(step);
        self.advance(step);
    }

    fn revise(&mut self, step: &Step) {
        self.others.revise(step);
        self.advance(step);
    }

    fn renew(&mut self, weights: &[f32]) {
        self.others.renew(weights);
    }
}
