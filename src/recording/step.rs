//! What agents received and thought at a step of a trace, as pictures show it.

use super::{Episode, Presence};
use crate::environment::places::{Ghost, Places};
use crate::environment::{Spec, Task};

/// Arrivals that are no age, in files.
pub(super) const LATE: u8 = 254;
pub(super) const LOST: u8 = 255;

/// What the agents received and thought at a step.
#[derive(Debug)]
pub(crate) struct Step {
    /// `[receiver][sender]`.
    pub arrived: Vec<Vec<Arrived>>,
    /// `[agent]`.
    pub presence: Vec<Presence>,
    /// Where each thinks the others are that it was not told of just now, `[agent]`.
    pub ghosts: Vec<Vec<Ghost>>,
    /// Root mean squared error of what each imputed, `[agent]`; `None` if it imputed nothing.
    pub errors: Vec<Option<f64>>,
}

/// What became of an observation that an agent might have received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arrived {
    /// It is there, and was made so many ticks ago.
    After(u8),
    /// The links delivered it, but after the deadline.
    Late,
    /// Nothing arrives.
    Lost,
}

impl Arrived {
    /// The age, or a number that is none, as `docs/formats.md` has them.
    pub(crate) fn code(self) -> u8 {
        match self {
            Arrived::After(age) => age,
            Arrived::Late => LATE,
            Arrived::Lost => LOST,
        }
    }
}

/// Tells the steps of the traces of a task.
#[derive(Debug)]
pub(crate) struct Steps {
    pub(crate) spec: Spec,
    places: Places,
}

impl Steps {
    /// Those of this task.
    pub(crate) fn of(task: &Task) -> Steps {
        Steps { places: Places::of(task.spec()), spec: task.spec().clone() }
    }

    /// What there is to see at a step of an episode; `None` if its values are not those of the task.
    pub(crate) fn at(&self, episode: &Episode, step: usize) -> Option<Step> {
        let agents = || 0..self.spec.n_agents();
        let presence: Vec<Presence> = agents().map(|agent| episode.presence(step, agent)).collect();
        let arrived = |receiver, sender| match episode.age(step, receiver, sender) {
            Some(age) => Arrived::After(age),
            None if episode.is_late(step, receiver, sender) => Arrived::Late,
            None => Arrived::Lost,
        };
        let arrived: Vec<Vec<Arrived>> =
            agents().map(|receiver| agents().map(|sender| arrived(receiver, sender)).collect()).collect();
        let (mut ghosts, mut errors) = (Vec::new(), Vec::new());
        for agent in agents() {
            let estimate = &episode.joint_estimate[step][agent];
            // It did not decide, or what it thought cannot be computed again.
            if estimate.is_empty() {
                ghosts.push(Vec::new());
                errors.push(None);
                continue;
            }
            if estimate.len() != self.spec.joint_dim() {
                return None;
            }
            let knows = |sender: usize| arrived[agent][sender] == Arrived::After(0);
            let all = self.places.ghosts(agent, estimate, knows);
            ghosts.push(all.filter(|ghost| ghost.imputed).collect());
            let imputed: Vec<usize> = agents().filter(|sender| *sender != agent && !knows(*sender)).collect();
            errors.push(self.error(estimate, &episode.obs[step], &imputed)?);
        }
        Some(Step { arrived, presence, ghosts, errors })
    }

    /// The error of the imputed parts of an estimate.
    fn error(&self, estimate: &[f32], observations: &[Vec<f32>], imputed: &[usize]) -> Option<Option<f64>> {
        let unique = self.spec.unique_dim();
        let mut sum = 0.0;
        for sender in imputed {
            let truth = observations[*sender].get(..unique)?;
            let found = &estimate[sender * unique..][..unique];
            sum += found.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        }
        Some((!imputed.is_empty()).then(|| (sum / (imputed.len() * unique) as f64).sqrt()))
    }
}
