//! What is not received counts as what a predictor of the policy expects.

use std::ops::Range;

use super::past::Past;
use super::{Carried, Imputer, Setup, Step};
use crate::agent::Inbox;
use crate::nn::{Predictor, PredictorState, Scratch};

/// Carries the estimate on with the predictor's mean delta added.
#[derive(Debug)]
pub(super) struct Prediction {
    carried: Carried,
    predictor: Predictor,
    /// Where its weights are in those of the policy.
    weights: Range<usize>,
    agent: usize,
    /// The number of the agent's first action among those of the team.
    first_act: usize,
    state: PredictorState,
    /// The state before the last step, kept if the own action is part of what the predictor sees: somebody may have
    /// been wrong about it.
    before: PredictorState,
    /// The number of what the agent does in each world.
    acts: Vec<usize>,
    past: Past,
    scratch: Scratch,
    /// What the predictor says, `[worlds, 2, predicted]`: mean delta and raw log-std.
    out: Vec<f32>,
}

impl Prediction {
    /// With the policy's predictor of this name, if it has one.
    pub(super) fn new(name: &str, setup: &Setup) -> Option<Prediction> {
        let (predictor, carried) = (setup.policy.predictor(name)?.clone(), Carried::new(setup));
        let out = vec![0.0; setup.worlds * 2 * carried.layout().predicted()];
        Some(Prediction {
            state: predictor.state(setup.worlds),
            before: predictor.state(setup.worlds),
            weights: setup.policy.predictor_range(name)?,
            agent: setup.agent,
            first_act: setup.policy.dims().act(setup.agent, 0),
            acts: Vec::with_capacity(setup.worlds),
            past: Past::new(carried.layout(), setup.worlds, setup.longest_delay),
            scratch: Scratch::default(),
            carried,
            predictor,
            out,
        })
    }
}

impl Imputer for Prediction {
    fn begin_episodes(&mut self, worlds: usize) {
        self.carried.forget();
        self.state.start(worlds);
        self.past.begin_episode();
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.carried.fuse(world, own, inbox, estimate);
        for sender in 0..self.carried.layout().agents {
            let age = inbox.from(sender).map(|received| received.age);
            self.state.hear(world, sender, if sender == self.agent { Some(0) } else { age });
        }
        for (sender, age) in self.carried.late(inbox) {
            let part = &mut estimate[self.carried.layout().part(sender)];
            self.past.correct(world, sender, age, self.carried.of(world, sender), part);
        }
    }

    fn predict(&mut self, step: &Step) {
        self.past.keep(step.estimates);
        self.advance(step);
    }

    fn revise(&mut self, step: &Step) {
        if self.predictor.spec().sees_own_action() {
            std::mem::swap(&mut self.state, &mut self.before);
            self.advance(step);
        }
    }

    fn renew(&mut self, weights: &[f32]) {
        self.predictor.renew(&weights[self.weights.clone()]);
    }

    fn multiply_adds(&self) -> usize {
        self.weights.len()
    }
}

impl Prediction {
    /// Lets the predictor see a step, and carries on what it says.
    fn advance(&mut self, step: &Step) {
        let Prediction { carried, predictor, first_act, state, before, acts, scratch, out, .. } = self;
        let (worlds, predicted) = (step.actions.len(), carried.layout().predicted());
        if predictor.spec().sees_own_action() {
            before.copy_from(state);
            acts.clear();
            acts.extend(step.actions.iter().map(|&action| *first_act + action as usize));
        }
        let out = &mut out[..worlds * 2 * predicted];
        predictor.step(worlds, step.estimates, acts, state, scratch, out);
        let deltas = out.chunks_exact(2 * predicted);
        for ((carried, estimate), delta) in carried.follow(step.estimates).zip(deltas) {
            for ((carried, value), delta) in carried.iter_mut().zip(estimate).zip(delta) {
                *carried = value + delta;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::dims;
    use crate::environment::Task;
    use crate::nn::{ActorKind, Input, Networks, Policy, PredictorSpec};

    /// What an agent that receives nothing believes after it has done these things; what it was mistaken about is
    /// put right afterwards.
    fn believes(agent: usize, done: &[u32], mistaken: &[u32]) -> Vec<u32> {
        let task = Task::parse("spread-xy-2").unwrap();
        let spec = PredictorSpec { hidden: 6, ..PredictorSpec::paper("one") };
        let spec = PredictorSpec { inputs: vec![Input::Estimate, Input::OwnAction], ..spec };
        let networks = Networks { predictors: vec![spec], ..Networks::paper(ActorKind::Mlp) };
        let policy = Policy::untrained(&dims(task.spec()), 3, networks).unwrap();
        let setup = Setup::of(task.spec(), &policy, agent);
        let mut imputer = Prediction::new("one", &setup).unwrap();
        imputer.begin_episodes(1);
        let (own, mut estimate) = (vec![0.5; 8], vec![0.0; task.spec().joint_dim()]);
        for (step, (done, mistaken)) in (0..).zip(done.iter().zip(mistaken)) {
            imputer.fuse(0, &own, &Inbox::of(2, |_| None), &mut estimate);
            let told = |action| Step { episode: 0, step, estimates: &estimate, actions: action };
            imputer.predict(&told(std::slice::from_ref(mistaken)));
            if mistaken != done {
                imputer.revise(&told(std::slice::from_ref(done)));
            }
        }
        imputer.fuse(0, &own, &Inbox::of(2, |_| None), &mut estimate);
        estimate.iter().map(|value| value.to_bits()).collect()
    }

    #[test]
    fn what_an_agent_did_counts_and_whose_it_was() {
        let actions = [1, 4, 2, 0];
        assert_ne!(believes(0, &actions, &actions), believes(0, &[1, 4, 3, 0], &[1, 4, 3, 0]));
        assert_ne!(believes(0, &actions, &actions)[4..8], believes(1, &actions, &actions)[..4]);
    }

    #[test]
    fn a_mistake_about_the_own_action_leaves_nothing_behind() {
        let actions = [1, 4, 2, 0];
        assert_eq!(believes(0, &actions, &[1, 3, 2, 2]), believes(0, &actions, &actions));
    }
}
