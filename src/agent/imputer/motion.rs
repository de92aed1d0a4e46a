//! What imputers that know the dynamics share: who is moved on, and what of it counts.

use super::hold::Hold;
use super::past::Past;
use super::predictor::Prediction;
use super::registry::best_predictor;
use super::{Imputer, JointLayout, Setup};
use crate::agent::{Inbox, Received};
use crate::base::error::Result;
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
    past: Past,
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
            past: Past::new(layout, setup.worlds, setup.longest_delay),
            expects: false,
        })
    }

    /// Nothing is expected: an episode starts.
    pub(super) fn begin_episodes(&mut self) {
        self.expects = false;
        self.past.begin_episode();
    }

    /// Keeps the joint estimates of a step, `[worlds, joint]`: what arrives late is held against them.
    pub(super) fn keep(&mut self, estimates: &[f32]) {
        self.past.keep(estimates);
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
    /// known. What was observed at this step is true. What arrives late says how wrong the estimate of that step was.
    pub(super) fn correct(
        &mut self,
        world: usize,
        agents: impl Iterator<Item = usize>,
        inbox: &Inbox,
        estimate: &mut [f32],
    ) {
        if !self.expects {
            return;
        }
        let Motion { bodies, layout, agent, expected, past, .. } = self;
        let expected = &expected[world * layout.predicted()..][..layout.predicted()];
        let moved = agents.flat_map(|agent| bodies.dims(agent)).chain(bodies.constants().iter().copied());
        for dim in moved.filter(|dim| dim / layout.unique != *agent) {
            let sender = dim / layout.unique;
            match inbox.from(sender) {
                None => estimate[dim] = expected[dim],
                Some(Received { age: 0, .. }) => {}
                Some(Received { age, observation }) => {
                    let wrong = past.put_right(world, dim, age, observation[dim % layout.unique]);
                    estimate[dim] = wrong.map_or(estimate[dim], |wrong| expected[dim] + wrong);
                }
            }
        }
    }
}

/// For everything that is not moved: the policy's best predictor, or what was received last if it has none.
pub(super) fn remaining(setup: &Setup) -> Box<dyn Imputer> {
    match best_predictor(setup.policy).and_then(|name| Prediction::new(name, setup)) {
        Some(prediction) => Box::new(prediction),
        None => Box::new(Hold::new(setup)),
    }
}
