//! What imputers that know the dynamics share: who is moved on, and what of it counts.

use super::hold::Hold;
use super::predictor::Prediction;
use super::registry::best_predictor;
use super::{Imputer, JointLayout, Setup};
use crate::agent::Inbox;
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::dynamics::{Bodies, Dynamics};
use crate::usage;

/// What the dynamics in the policy file expect of agents, in each world.
#[derive(Debug)]
pub(super) struct Motion {
    pub dynamics: Dynamics,
    bodies: Bodies,
    layout: JointLayout,
    agent: usize,
    /// `[worlds, predicted]`. Dims that nobody has moved mean nothing.
    expected: Vec<f32>,
    /// Whether a step has been made in this episode, so that something is expected.
    expects: bool,
}

impl Motion {
    /// By the dynamics of the policy.
    ///
    /// # Errors
    /// `Usage` if it has none, or not of this environment.
    pub(super) fn new(setup: &Setup) -> Result<Motion> {
        let dynamics = setup.policy.dynamics().filter(|dynamics| dynamics.fits(setup.spec));
        let dynamics = dynamics.ok_or_else(|| {
            usage!(
                "this policy holds no dynamics of {}; `vamaro-swarm fit POLICY --out FILE` fits them and writes a \
                 policy file that does",
                setup.spec.id
            )
        })?;
        let layout = JointLayout::of(setup.spec);
        Ok(Motion {
            dynamics: dynamics.clone(),
            bodies: Bodies::of(setup.spec)?,
            layout,
            agent: setup.agent,
            expected: vec![0.0; setup.worlds * layout.predicted()],
            expects: false,
        })
    }

    /// Nothing is expected: an episode starts.
    pub(super) fn begin_episodes(&mut self) {
        self.expects = false;
    }

    /// Moves agents on by a step that begins as the joint estimate of this world says, each pushed as it says. Landmarks stay.
    pub(super) fn advance(
        &mut self,
        world: usize,
        estimates: &[f32],
        pushed: impl Iterator<Item = (usize, [f64; 2])>,
    ) {
        let Motion { dynamics, bodies, layout, expected, expects, .. } = self;
        let estimate = &estimates[world * layout.joint()..][..layout.joint()];
        let expected = &mut expected[world * layout.predicted()..][..layout.predicted()];
        pushed.for_each(|(agent, push)| dynamics.advance(bodies, agent, push, estimate, expected));
        bodies.constants().iter().for_each(|&dim| expected[dim] = estimate[dim]);
        *expects = true;
    }

    /// Writes what is expected of these agents, and of landmarks, into the estimate of a world, where nothing better is
    /// known. What was observed at this step is true. What arrives late of the own state is older than what is known; of
    /// others it is news.
    pub(super) fn correct(
        &self,
        world: usize,
        agents: impl Iterator<Item = usize>,
        inbox: &Inbox,
        estimate: &mut [f32],
    ) {
        if !self.expects {
            return;
        }
        let expected = &self.expected[world * self.layout.predicted()..][..self.layout.predicted()];
        let imputed = |dim: usize| Some(inbox.age(dim / self.layout.unique)).filter(|_| !self.observes(dim));
        for agent in agents {
            let is_older = |age| if agent == self.agent { age != 0 } else { age == NOT_ARRIVED };
            for dim in self.bodies.dims(agent).filter(|dim| imputed(*dim).is_some_and(is_older)) {
                estimate[dim] = expected[dim];
            }
        }
        for &dim in self.bodies.constants() {
            if imputed(dim) == Some(NOT_ARRIVED) {
                estimate[dim] = expected[dim];
            }
        }
    }

    /// Whether a dim is part of what the agent observes itself.
    fn observes(&self, dim: usize) -> bool {
        dim / self.layout.unique == self.agent
    }
}

/// For everything that is not moved: the policy's best predictor, or what was received last if it has none.
pub(super) fn remaining(setup: &Setup) -> Box<dyn Imputer> {
    match best_predictor(setup.policy).and_then(|name| Prediction::new(name, setup)) {
        Some(prediction) => Box::new(prediction),
        None => Box::new(Hold::new(setup)),
    }
}
