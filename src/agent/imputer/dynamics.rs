//! An agent knows what it did: its own state follows from that, wherever it is observed.

use super::motion::{Known, Motion};
use super::{Imputer, Setup, Step};
use crate::agent::Inbox;
use crate::base::error::Result;
use crate::dynamics::Dynamics;

/// What tells of the agent itself is moved on by dynamics, with the action that was carried out, also where only a teammate
/// observes it. Landmarks stay where they are. Another imputer says everything else. Contacts follow from where the agent
/// believes the others to be.
#[derive(Debug)]
pub(super) struct OwnDynamics {
    others: Box<dyn Imputer>,
    motion: Motion,
}

impl OwnDynamics {
    /// With dynamics that are known in this way.
    ///
    /// # Errors
    /// `Usage` if they are not known, or not those of this environment.
    pub(super) fn new(setup: &Setup, others: Box<dyn Imputer>, known: Known) -> Result<OwnDynamics> {
        let motion = Motion::of(setup, known, vec![setup.agent], 1)?;
        Ok(OwnDynamics { others: motion.rest(setup, others), motion })
    }

    /// The mean of a Kalman filter whose model is a constant velocity, with the own action as the control input. Places
    /// and velocities are observed together and without noise, so its gain is one, whatever the noise of the process:
    /// what was observed holds, and everything else moves on from there.
    ///
    /// # Errors
    /// `Usage` if the policy has no dynamics, or not of this environment.
    pub(super) fn constant_velocity(setup: &Setup, others: Box<dyn Imputer>) -> Result<OwnDynamics> {
        let model = Dynamics { keep: 1.0, contact: None, ..Known::Fitted.dynamics(setup)? };
        let everybody = (0..setup.spec.n_agents()).collect();
        let motion = Motion::new(setup, model, everybody, 1)?;
        Ok(OwnDynamics { others: motion.rest(setup, others), motion })
    }
}

impl Imputer for OwnDynamics {
    fn begin_episodes(&mut self, worlds: usize) {
        self.others.begin_episodes(worlds);
        self.motion.begin_episodes();
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.others.fuse(world, own, inbox, estimate);
        self.motion.correct(world, inbox, estimate, &[1.0], |_, _| [0.0; 2]);
    }

    fn predict(&mut self, step: &Step) {
        self.others.predict(step);
        self.motion.keep(step);
        self.motion.advance(step.actions);
    }

    fn revise(&mut self, step: &Step) {
        self.others.revise(step);
        self.motion.revise(step.actions);
    }

    fn renew(&mut self, weights: &[f32]) {
        self.others.renew(weights);
    }

    fn multiply_adds(&self) -> usize {
        self.others.multiply_adds()
    }
}

#[cfg(test)]
mod tests {
    use super::super::hold::Hold;
    use super::*;
    use crate::agent::PolicySource;
    use crate::environment::Task;

    /// What agent 0 of spread-xy-2, which receives nothing, believes of its other axis after it has done these things, if it
    /// sees itself keep so much of its velocity; what it was mistaken about is put right afterwards.
    fn believes(done: &[u32], mistaken: &[u32], keep: f64) -> [f32; 2] {
        let task = Task::parse("spread-xy-2").unwrap();
        let policy = PolicySource::Builtin.load(task.spec()).unwrap();
        let setup = Setup::of(task.spec(), &policy, 0);
        let mut imputer = OwnDynamics::new(&setup, Box::new(Hold::new(&setup)), Known::Fitted).unwrap();
        imputer.begin_episodes(1);
        let (mut estimate, mut velocity) = (vec![0.0; task.spec().joint_dim()], 0.0f32);
        // Its place along x, far from its teammate's, so that they do not touch, and its velocity.
        let own = |velocity| [0.0, 5.0, velocity, 0.0, 0.0, 0.0, 0.0, 0.0];
        for (step, (done, mistaken)) in (0..).zip(done.iter().zip(mistaken)) {
            imputer.fuse(0, &own(velocity), &Inbox::of(2, |_| None), &mut estimate);
            let told = |action| Step {
                episode: 0,
                step,
                estimates: &estimate,
                actions: std::slice::from_ref(action),
            };
            imputer.predict(&told(mistaken));
            if mistaken != done {
                imputer.revise(&told(done));
            }
            let push = policy.dynamics().unwrap().push(0, *done as usize)[0];
            velocity = (keep * f64::from(velocity) + push) as f32;
        }
        imputer.fuse(0, &own(velocity), &Inbox::of(2, |_| None), &mut estimate);
        // In the observation of agent 1: its own place and that of agent 0 along y come first, then the velocities.
        [estimate[4], estimate[6]]
    }

    #[test]
    fn the_own_state_follows_from_the_own_actions_where_only_a_teammate_sees_it() {
        // Up, up, nothing: v = 0.5, 0.875, 0.65625; y is the sum of these, a tenth of a second each.
        let [place, velocity] = believes(&[3, 3, 0], &[3, 3, 0], 0.75);
        assert!((place - 0.203_125).abs() < 1e-6 && (velocity - 0.656_25).abs() < 1e-6, "{place} {velocity}");
    }

    #[test]
    fn a_mistake_about_the_own_action_leaves_nothing_behind() {
        let right = believes(&[3, 1, 0], &[3, 1, 0], 0.75);
        assert_eq!(believes(&[3, 1, 0], &[4, 3, 0], 0.75), right);
        assert_ne!(right, believes(&[4, 1, 0], &[4, 1, 0], 0.75));
    }

    #[test]
    fn a_mistake_leaves_nothing_behind_when_another_law_is_found_afterwards() {
        let done = [1, 3, 2, 3, 1, 0];
        let [place, velocity] = believes(&done, &done, 0.6);
        assert_eq!(believes(&done, &[1, 4, 2, 3, 1, 0], 0.6), [place, velocity]);
        // Up twice, in the second and the fourth step, with the damping that its other axis shows.
        let truth = 0.5 * (0.6f32.powi(4) + 0.6f32.powi(2));
        assert!((velocity - truth).abs() < 0.02, "{velocity} {truth}");
    }
}
