//! The actors of teammates, run on what another agent believes.

use std::ops::Range;

use super::Setup;
use super::imagined::Guess;
use crate::nn::{Actor, ActorState, Scratch};

/// The actors of an agent's teammates, with the states they have on its beliefs.
///
/// Teammates that share an actor are rows of one pass: its weights, which are what a pass takes most time to read, are
/// read once for all of them.
#[derive(Debug)]
pub(super) struct Actors {
    passes: Vec<Pass>,
    /// How many rows the beliefs are.
    rows: usize,
    n_actions: usize,
    scratch: Scratch,
}

/// One actor and who acts by it.
#[derive(Debug)]
struct Pass {
    agents: Vec<usize>,
    actor: Actor,
    /// Where its weights are in those of the policy.
    weights: Range<usize>,
    /// Of each of its agents, the rows of all beliefs.
    state: ActorState,
    /// `[agents, rows, joint]`.
    inputs: Vec<f32>,
    /// Whose each row is, `[agents, rows]`.
    ids: Vec<usize>,
    /// `[agents, rows, n_actions]`.
    logits: Vec<f32>,
}

impl Actors {
    /// Those of `agents`, for up to `rows` beliefs, as the guess needs them.
    pub(super) fn new(setup: &Setup, agents: &[usize], rows: usize, guess: Guess) -> Actors {
        let mut passes: Vec<Pass> = Vec::new();
        for &agent in agents {
            let weights = setup.policy.actor_range(agent);
            // ONNX actors have no weights of ours: each is a pass of its own.
            let is_same = |pass: &&mut Pass| !weights.is_empty() && pass.weights == weights;
            match passes.iter_mut().find(is_same) {
                Some(pass) => pass.agents.push(agent),
                None => {
                    let actor = guess.actor(&setup.policy.actor(agent).by_row());
                    passes.push(Pass {
                        agents: vec![agent],
                        state: actor.state(0),
                        actor,
                        weights,
                        inputs: Vec::new(),
                        ids: Vec::new(),
                        logits: Vec::new(),
                    });
                }
            }
        }
        let mut actors =
            Actors { passes, rows: 0, n_actions: setup.spec.n_actions(), scratch: Scratch::default() };
        // Room for the most rows, so that no episode allocates.
        actors.begin_episodes(rows);
        actors
    }

    pub(super) fn begin_episodes(&mut self, rows: usize) {
        self.rows = rows;
        for Pass { agents, actor, state, inputs, ids, logits, .. } in &mut self.passes {
            let all = rows * agents.len();
            state.start(all);
            inputs.resize(all * actor.n_inputs(), 0.0);
            logits.resize(all * self.n_actions, 0.0);
            ids.clear();
            ids.extend(agents.iter().flat_map(|agent| std::iter::repeat_n(*agent, rows)));
        }
    }

    /// Lets them see what is believed, `[rows, joint]`.
    pub(super) fn consider(&mut self, beliefs: &[f32]) {
        for Pass { agents, actor, state, inputs, ids, logits, .. } in &mut self.passes {
            assert_eq!(beliefs.len(), self.rows * actor.n_inputs(), "beliefs are [rows, joint]");
            inputs.chunks_exact_mut(beliefs.len()).for_each(|inputs| inputs.copy_from_slice(beliefs));
            let rows = self.rows * agents.len();
            if actor.step(rows, inputs, ids, state, &mut self.scratch, logits).is_err() {
                // An ONNX actor that cannot say what it would do might do anything. If the teammate is as lost, it says so.
                logits.fill(0.0);
            }
        }
    }

    /// What the actor of an agent made of a row when it last saw the beliefs.
    pub(super) fn logits(&self, agent: usize, row: usize) -> &[f32] {
        let (pass, at) = self.find(agent);
        &self.passes[pass].logits[(at * self.rows + row) * self.n_actions..][..self.n_actions]
    }

    /// All are in the row `to` what they are in the row `from`.
    pub(super) fn copy(&mut self, from: usize, to: usize) {
        for Pass { agents, state, .. } in &mut self.passes {
            for first in (0..agents.len()).map(|at| at * self.rows) {
                state.copy_row(first + from, first + to);
            }
        }
    }

    /// Takes new weights, of all those of the policy.
    pub(super) fn renew(&mut self, weights: &[f32]) {
        for pass in &mut self.passes {
            pass.actor.renew(&weights[pass.weights.clone()]);
        }
    }

    /// How many they take for one belief.
    pub(super) fn multiply_adds(&self) -> usize {
        self.passes.iter().map(|pass| pass.agents.len() * pass.weights.len()).sum()
    }

    /// The pass of an agent, and which of its agents that is.
    fn find(&self, agent: usize) -> (usize, usize) {
        let at = |pass: &Pass| pass.agents.iter().position(|other| *other == agent);
        let found = self.passes.iter().enumerate().find_map(|(number, pass)| Some((number, at(pass)?)));
        found.expect("the agent is a teammate")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::dims;
    use crate::environment::Task;
    use crate::nn::{ActorKind, Networks, Policy, Sharing};

    #[test]
    fn each_teammate_acts_as_its_own_actor_would_whether_it_is_shared_or_not() {
        let task = Task::parse("spread-xy-4").unwrap();
        let joint = task.spec().joint_dim();
        let guesses = [Guess::Mean, Guess::SharedDice];
        let sharings = [(Sharing::Shared, 1), (Sharing::Separate, 3)];
        for ((sharing, passes), guess) in sharings.into_iter().flat_map(|of| guesses.map(|guess| (of, guess)))
        {
            let networks = Networks { sharing, hidden: 20, ..Networks::paper(ActorKind::Gru) };
            let policy = Policy::untrained(&dims(task.spec()), 3, networks).unwrap();
            let mut actors = Actors::new(&Setup::of(task.spec(), &policy, 1), &[0, 2, 3], 5, guess);
            actors.begin_episodes(2);
            assert_eq!(actors.passes.len(), passes);
            let alone = |agent: usize, beliefs: &[&[f32]]| {
                let (actor, mut logits) = (guess.actor(policy.actor(agent)), vec![0.0; 5]);
                let (mut state, mut scratch) = (actor.state(1), Scratch::default());
                beliefs.iter().for_each(|seen| {
                    actor.step(1, seen, &[], &mut state, &mut scratch, &mut logits).unwrap()
                });
                logits
            };
            let beliefs: Vec<f32> = (0..2 * joint).map(|value| (value as f32).sin()).collect();
            let (first, second) = beliefs.split_at(joint);
            actors.consider(&beliefs);
            // The first belief is the second from now on.
            actors.copy(1, 0);
            actors.consider(&beliefs);
            for agent in [0, 2, 3] {
                let [mixed, same] = [[second, first], [second, second]].map(|seen| alone(agent, &seen));
                assert_eq!(actors.logits(agent, 0), mixed, "{sharing} {guess:?} {agent}");
                assert_eq!(actors.logits(agent, 1), same, "{sharing} {guess:?} {agent}");
            }
        }
    }
}
