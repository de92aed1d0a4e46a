//! Teammates act by the same policy file: what they will do can be asked of their actors.

use super::actors::Actors;
use super::imagined::{Dice, Guess, Teammate};
use super::motion::{Known, Motion};
use super::particles::Weights;
use super::{Imputer, Setup, Step};
use crate::agent::Inbox;
use crate::base::error::Result;
use crate::usage;

/// Everybody is moved on by dynamics: the agent itself by the action that was carried out,
/// each teammate by what its actor, which sees what *this* agent believes, makes probable, in the light of what is seen of
/// its motion afterwards. What the dynamics do not move another imputer says.
#[derive(Debug)]
pub(super) struct Teammates {
    others: Box<dyn Imputer>,
    motion: Motion,
    agent: usize,
    /// All but the agent itself.
    teammates: Vec<Teammate>,
    actors: Actors,
    /// Beliefs about each world.
    n_beliefs: usize,
    weights: Weights,
    dice: Dice,
}

impl Teammates {
    /// With the actors of the policy, and dynamics that are known in this way.
    ///
    /// # Errors
    /// `Usage` if they are not known, or not those of this environment, or teammates do not choose actions.
    pub(super) fn new(
        setup: &Setup,
        others: Box<dyn Imputer>,
        guess: Guess,
        known: Known,
    ) -> Result<Teammates> {
        let (dynamics, n_beliefs) = (known.dynamics(setup)?, guess.n_beliefs());
        if setup.spec.n_actions() == 0 {
            return Err(usage!(
                "teammates are imagined to choose actions; those of {} act by values",
                setup.spec.id
            ));
        }
        let everybody = 0..setup.spec.n_agents();
        let teammates: Vec<usize> = everybody.clone().filter(|agent| *agent != setup.agent).collect();
        let motion = Motion::of(setup, known, everybody.collect(), n_beliefs)?;
        Ok(Teammates {
            others: motion.rest(setup, others),
            agent: setup.agent,
            actors: Actors::new(setup, &teammates, setup.worlds * n_beliefs, guess),
            teammates: teammates
                .into_iter()
                .map(|agent| Teammate::new(setup, &dynamics, agent, guess))
                .collect(),
            motion,
            n_beliefs,
            weights: Weights::new(setup.worlds, n_beliefs),
            dice: Dice { guess, seed: setup.seed, agent: setup.agent },
        })
    }
}

impl Imputer for Teammates {
    fn begin_episodes(&mut self, worlds: usize) {
        self.others.begin_episodes(worlds);
        self.motion.begin_episodes();
        self.weights.begin_episodes();
        self.actors.begin_episodes(worlds * self.n_beliefs);
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.others.fuse(world, own, inbox, estimate);
        let Teammates { motion, agent, teammates, actors, n_beliefs, weights, .. } = self;
        for teammate in teammates.iter_mut() {
            for row in world * *n_beliefs..(world + 1) * *n_beliefs {
                let seen = motion.seen_push(row, teammate.agent, inbox, estimate);
                let logits = actors.logits(teammate.agent, row);
                weights.weigh(row, teammate.act(row, logits, seen));
            }
        }
        let at = |other: usize| other - usize::from(other > *agent);
        let shares = weights.shares(world);
        motion.correct(world, inbox, estimate, shares, |row, other| teammates[at(other)].push(row));
        for (from, to) in weights.resample(world) {
            motion.copy(from, to);
            actors.copy(from, to);
        }
    }

    fn predict(&mut self, step: &Step) {
        self.others.predict(step);
        let Teammates { motion, teammates, actors, n_beliefs, weights, dice, .. } = self;
        motion.keep(step);
        for world in 0..step.actions.len() {
            weights.set_start(world, dice.of(dice.agent, world, 0, step));
        }
        let worlds = step.actions.len();
        actors.consider(motion.beliefs(worlds));
        for teammate in teammates {
            let agent = teammate.agent;
            let die = |row| dice.of(agent, row / *n_beliefs, row % *n_beliefs, step);
            teammate.throw(worlds * *n_beliefs, die);
        }
        motion.advance(step.actions);
    }

    fn revise(&mut self, step: &Step) {
        self.others.revise(step);
        self.motion.revise(step.actions);
    }

    fn renew(&mut self, weights: &[f32]) {
        self.others.renew(weights);
        self.actors.renew(weights);
    }

    fn multiply_adds(&self) -> usize {
        self.others.multiply_adds() + self.n_beliefs * self.actors.multiply_adds()
    }
}
