//! What is not received counts as what a predictor of the policy expects.

use std::ops::Range;

use super::past::Past;
use super::{Carried, Imputer, Setup, Step};
use crate::agent::Inbox;
use crate::nn::{LstmState, Predictor, Scratch};

/// Carries the estimate on with the predictor's mean delta added.
#[derive(Debug)]
pub(super) struct Prediction {
    carried: Carried,
    predictor: Predictor,
    /// Where its weights are in those of the policy.
    weights: Range<usize>,
    /// The number of the agent's first action among those of the team.
    first_act: usize,
    state: LstmState,
    /// The state before the last step, kept if the own action is part of what the predictor sees: somebody may have
    /// been wrong about it.
    before: LstmState,
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
        self.state.start(&self.predictor, worlds);
        self.past.begin_episode();
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.carried.fuse(world, own, inbox, estimate);
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
