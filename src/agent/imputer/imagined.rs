//! A teammate as another agent imagines it.

use super::{Setup, Step};
use crate::agent::choice::{most_probable, sample};
use crate::base::rng::{Draws, Purpose};
use crate::dynamics::Dynamics;
use crate::nn::Actor;

/// A teammate that acts on what the agent which imagines it believes.
///
/// Its rows are the beliefs of all worlds, one world after the other.
#[derive(Debug)]
pub(super) struct Teammate {
    pub agent: usize,
    /// The draws that decide, `[rows]`.
    dice: Vec<f64>,
    /// What it is taken to have added to its velocity, m/s, `[rows]`.
    pushes: Vec<[f64; 2]>,
    /// What each action adds to its velocity, m/s.
    of_actions: Vec<[f64; 2]>,
    guess: Guess,
    greedy: bool,
    /// Logits of its actions in the light of what is seen.
    informed: Vec<f32>,
}

/// What a teammate is taken to have done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Guess {
    /// The mean of what its actions do, by their probabilities.
    Mean,
    /// An action drawn by their probabilities, in each of so many beliefs.
    Drawn(usize),
    /// The action that it drew itself: all throw their dice by the same seed.
    SharedDice,
}

/// The draws that decide what teammates do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dice {
    pub guess: Guess,
    pub seed: u64,
    /// Who imagines.
    pub agent: usize,
}

impl Guess {
    /// How many beliefs about a world it needs.
    pub(super) fn n_beliefs(self) -> usize {
        match self {
            Guess::Drawn(beliefs) => beliefs,
            Guess::Mean | Guess::SharedDice => 1,
        }
    }

    /// The actor that a teammate is taken to act by. Nearly its own will do, and is much less to read, unless the action has
    /// to be the very one.
    pub(super) fn actor(self, own: &Actor) -> Actor {
        match self {
            Guess::Mean | Guess::Drawn(_) => own.roughly(),
            Guess::SharedDice => own.clone(),
        }
    }
}

impl Dice {
    /// The draw for a teammate at a step, in one of the beliefs about a world.
    pub(super) fn of(self, teammate: usize, world: usize, belief: usize, step: &Step) -> f64 {
        let (episode, moment) = (step.episode + world as u64, u64::from(step.step));
        match self.guess {
            Guess::Mean => 0.0,
            Guess::Drawn(_) => {
                let purpose = Purpose::Imagination;
                let mut draws = Draws::of_part(belief as u64, self.seed, purpose, episode, moment);
                draws.at(self.agent, teammate).uniform()
            }
            Guess::SharedDice => {
                Draws::new(self.seed, Purpose::Action, episode, moment).at(teammate, 0).uniform()
            }
        }
    }
}

impl Teammate {
    pub(super) fn new(setup: &Setup, dynamics: &Dynamics, agent: usize, guess: Guess) -> Teammate {
        let rows = setup.worlds * guess.n_beliefs();
        Teammate {
            agent,
            dice: vec![0.0; rows],
            pushes: vec![[0.0; 2]; rows],
            of_actions: dynamics.pushes[agent].clone(),
            guess,
            greedy: setup.greedy,
            informed: Vec::with_capacity(dynamics.pushes[agent].len()),
        }
    }

    /// What is drawn at this step is `die` of each row.
    pub(super) fn throw(&mut self, rows: usize, die: impl Fn(usize) -> f64) {
        self.dice[..rows].iter_mut().enumerate().for_each(|(row, dice)| *dice = die(row));
    }

    /// Takes it to have acted in a row, by the `logits` of its actor and in the light of what is seen of its push along each
    /// axis. How likely that was: the logarithm, or zero where it is not looked at.
    pub(super) fn act(&mut self, row: usize, logits: &[f32], seen: [Option<f64>; 2]) -> f64 {
        let Teammate { informed, of_actions, .. } = self;
        informed.clear();
        informed.extend_from_slice(&logits[..of_actions.len()]);
        let mut log_likelihood = 0.0;
        if self.guess != Guess::SharedDice {
            let before = log_sum(informed);
            weigh(informed, of_actions, seen);
            log_likelihood = log_sum(informed) - before;
        }
        self.pushes[row] = match self.guess {
            _ if self.greedy => of_actions[most_probable(informed)],
            Guess::Mean => expectation(informed, of_actions),
            Guess::Drawn(_) | Guess::SharedDice => of_actions[sample(informed, self.dice[row])],
        };
        log_likelihood
    }

    /// What it is taken to have added to its velocity in a row, m/s.
    pub(super) fn push(&self, row: usize) -> [f64; 2] {
        self.pushes[row]
    }
}

/// Makes actions less probable the less they do what is seen. A standard deviation of a quarter of the largest push tells them
/// apart, and forgives contacts that were not foreseen.
fn weigh(logits: &mut [f32], of_actions: &[[f64; 2]], seen: [Option<f64>; 2]) {
    let sizes = of_actions.iter().flatten().map(|push| push.abs());
    let sigma = sizes.fold(0.0, f64::max) / 4.0;
    for (logit, push) in logits.iter_mut().zip(of_actions).filter(|_| sigma > 0.0) {
        for (seen, push) in seen.iter().zip(push).filter_map(|(seen, push)| Some((((*seen)?), push))) {
            *logit -= (((seen - push) / sigma).powi(2) / 2.0) as f32;
        }
    }
}

/// The logarithm of the sum of what these are the logarithms of.
fn log_sum(logits: &[f32]) -> f64 {
    let largest = logits[most_probable(logits)];
    let sum: f64 = logits.iter().map(|logit| f64::from(logit - largest).exp()).sum();
    f64::from(largest) + sum.ln()
}

/// The mean of what actions do, by the softmax of their logits.
fn expectation(logits: &[f32], of_actions: &[[f64; 2]]) -> [f64; 2] {
    let largest = logits[most_probable(logits)];
    let (mut sum, mut mean) = (0.0, [0.0; 2]);
    for (logit, push) in logits.iter().zip(of_actions) {
        let weight = f64::from(logit - largest).exp();
        sum += weight;
        mean = [mean[0] + weight * push[0], mean[1] + weight * push[1]];
    }
    mean.map(|part| part / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUSHES: [[f64; 2]; 3] = [[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]];

    fn logits() -> [f32; 3] {
        [0.5, 0.25, 0.25].map(f32::ln)
    }

    #[test]
    fn what_a_teammate_will_do_is_weighed_by_its_actor() {
        let [x, y] = expectation(&logits(), &PUSHES);
        assert!((x - 0.25).abs() < 1e-6 && (y + 0.25).abs() < 1e-6, "{x} {y}");
    }

    #[test]
    fn what_is_seen_of_a_teammate_tells_what_it_did_along_the_other_axis() {
        let of = |seen| {
            let mut logits = logits();
            weigh(&mut logits, &PUSHES, seen);
            (expectation(&logits, &PUSHES), log_sum(&logits))
        };
        assert_eq!(of([None, None]), (expectation(&logits(), &PUSHES), log_sum(&logits())));
        // It has moved to the right, so it did nothing along y; it has not, so it is the more likely to have.
        let (([x, y], likely), ([_, other], likelier)) = (of([Some(1.0), None]), of([Some(0.0), None]));
        assert!((x - 1.0).abs() < 1e-2 && y.abs() < 1e-2, "{x} {y}");
        assert!((other + 1.0 / 3.0).abs() < 1e-2, "{other}");
        // The share of those actions that do that.
        assert!((likely.exp() - 0.25).abs() < 1e-2 && (likelier.exp() - 0.75).abs() < 1e-2);
    }
}
