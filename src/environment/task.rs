//! A task: who lives in a world, what they observe and what they can do.

use super::physics::Physics;
use super::{N_ACTIONS, hear_see, names, speaker_listener, spread};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::usage;

/// A task, and with it the shape of everything that depends on it.
///
/// The joint observation is the unique parts of all agents in order, then the common part once. The unique
/// parts are what a predictor predicts; the common part is known to all. Dims count `f32` values.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub(super) family: Family,
    pub(super) physics: Physics,
    id: String,
    aliases: &'static [&'static str],
}

/// The rules a task plays by, for any team size they allow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    HearSee,
    SpeakerListener,
    SpreadXy,
    SpreadBlindfold,
}

impl Task {
    /// The task called `name`, in upper or lower case: an id, a paper name or a reference id, or
    /// `spread-xy-N` (N even) or `spread-blindfold-N` for a team of N.
    ///
    /// # Errors
    /// [`Usage`](crate::base::error::Error::Usage) if there is none, with the names or team sizes there are.
    pub fn parse(name: &str) -> Result<Task> {
        names::find(name).map(|(family, n_agents)| Task::new(family, n_agents))
    }

    /// The tasks of the reference environments, smallest team of each family first.
    pub fn all() -> Vec<Task> {
        names::TABLE.iter().map(|named| Task::new(named.family, named.n_agents)).collect()
    }

    /// The task for a team of `n` where none is named.
    ///
    /// # Errors
    /// [`Usage`](crate::base::error::Error::Usage) if there is none, with the team sizes that have one.
    pub fn by_team_size(n: usize) -> Result<Task> {
        match n {
            2 => Ok(Task::new(Family::HearSee, n)),
            4 | 8 => Ok(Task::new(Family::SpreadXy, n)),
            3 | 6 | 12 => Ok(Task::new(Family::SpreadBlindfold, n)),
            1..=MAX_AGENTS => Err(usage!(
                "there is no default task for a team of {n}, only for 2, 3, 4, 6, 8 and 12 agents; \
                 name one, such as `--task spread-blindfold-{n}`"
            )),
            _ => Err(usage!("a team has 1 to {MAX_AGENTS} agents, not {n}")),
        }
    }

    fn new(family: Family, n_agents: usize) -> Task {
        let bodies = match family {
            Family::HearSee => hear_see::bodies(),
            Family::SpeakerListener => speaker_listener::bodies(),
            Family::SpreadXy => spread::bodies(&spread::SIZES_XY, n_agents),
            Family::SpreadBlindfold => spread::bodies(&spread::SIZES_BLINDFOLD, n_agents),
        };
        let (id, aliases) = names::of(family, n_agents);
        Task { family, physics: Physics::of(bodies), id, aliases }
    }

    /// The one name everything that is written down uses, such as `spread-xy-4`.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The other names [`Task::parse`] knows it by: paper name and reference id, where it has them.
    pub fn aliases(&self) -> Vec<&str> {
        self.aliases.to_vec()
    }

    /// What the team does, in one line.
    pub fn summary(&self) -> &'static str {
        match self.family {
            Family::HearSee => hear_see::SUMMARY,
            Family::SpeakerListener => speaker_listener::SUMMARY,
            Family::SpreadXy => spread::SUMMARY_XY,
            Family::SpreadBlindfold => spread::SUMMARY_BLINDFOLD,
        }
    }

    /// How many agents the team has.
    pub fn n_agents(&self) -> usize {
        self.physics.bodies.len()
    }

    /// How many landmarks the world has.
    pub fn n_landmarks(&self) -> usize {
        match self.family {
            Family::HearSee => hear_see::N_LANDMARKS,
            Family::SpeakerListener => speaker_listener::N_LANDMARKS,
            Family::SpreadXy | Family::SpreadBlindfold => self.n_agents(),
        }
    }

    /// How long `agent`'s own observation is, without padding.
    pub fn obs_dim(&self, agent: usize) -> usize {
        match self.family {
            Family::HearSee => hear_see::OBS_DIMS[agent],
            Family::SpeakerListener => speaker_listener::OBS_DIMS[agent],
            Family::SpreadXy | Family::SpreadBlindfold => self.unique_dim() + self.common_dim(),
        }
    }

    /// How long every observation is once padded: as long as the longest in the team.
    pub fn padded_obs_dim(&self) -> usize {
        self.unique_dim() + self.common_dim()
    }

    /// The dims at the start of a padded observation that differ between agents.
    pub fn unique_dim(&self) -> usize {
        match self.family {
            Family::HearSee => hear_see::PADDED_OBS_DIM,
            Family::SpeakerListener => speaker_listener::PADDED_OBS_DIM,
            Family::SpreadXy | Family::SpreadBlindfold => spread::UNIQUE_DIM,
        }
    }

    /// The dims behind them, the same for all agents: the landmarks in spread, none elsewhere.
    pub fn common_dim(&self) -> usize {
        match self.family {
            Family::HearSee | Family::SpeakerListener => 0,
            Family::SpreadXy | Family::SpreadBlindfold => 2 * self.n_landmarks(),
        }
    }

    /// How long the joint observation is: all unique parts and the common part.
    pub fn joint_dim(&self) -> usize {
        self.predicted_dim() + self.common_dim()
    }

    /// How long the predicted part of the joint observation is: all unique parts.
    pub fn predicted_dim(&self) -> usize {
        self.n_agents() * self.unique_dim()
    }

    /// How many of the [`N_ACTIONS`] actions `agent` has: the first so many.
    pub fn available_actions(&self, agent: usize) -> usize {
        match self.family {
            Family::SpeakerListener if agent == speaker_listener::SPEAKER => speaker_listener::N_MESSAGES,
            _ => N_ACTIONS,
        }
    }

    /// How bodies move in this task.
    pub fn physics(&self) -> &Physics {
        &self.physics
    }

    /// Whether one landmark is the goal of all.
    pub fn has_goal(&self) -> bool {
        matches!(self.family, Family::HearSee | Family::SpeakerListener)
    }

    /// What is said with these actions, where somebody speaks.
    pub(super) fn message(&self, actions: &[u8]) -> Option<u8> {
        match self.family {
            Family::SpeakerListener => speaker_listener::message(actions),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_those_of_the_reference_environments() {
        // id, agents, landmarks, size, obs dims, padded, unique, common, joint, predicted
        type Shape<'a> = (&'a str, usize, usize, f64, Vec<usize>, [usize; 5]);
        let expected: [Shape; 8] = [
            ("hear-see", 2, 1, 0.075, vec![2, 8], [8, 8, 0, 16, 16]),
            ("speaker-listener", 2, 3, 0.075, vec![3, 11], [11, 11, 0, 22, 22]),
            ("spread-xy-2", 2, 2, 0.15, vec![8; 2], [8, 4, 4, 12, 8]),
            ("spread-xy-4", 4, 4, 0.1, vec![12; 4], [12, 4, 8, 24, 16]),
            ("spread-xy-8", 8, 8, 0.07, vec![20; 8], [20, 4, 16, 48, 32]),
            ("spread-blindfold", 3, 3, 0.15, vec![10; 3], [10, 4, 6, 18, 12]),
            ("spread-blindfold-6", 6, 6, 0.1, vec![16; 6], [16, 4, 12, 36, 24]),
            ("spread-blindfold-12", 12, 12, 0.05, vec![28; 12], [28, 4, 24, 72, 48]),
        ];
        for (task, (id, n_agents, n_landmarks, size, obs_dims, dims)) in Task::all().iter().zip(expected) {
            assert_eq!((task.id(), task.n_agents(), task.n_landmarks()), (id, n_agents, n_landmarks));
            assert_eq!((0..n_agents).map(|agent| task.obs_dim(agent)).collect::<Vec<_>>(), obs_dims, "{id}");
            let found = [
                task.padded_obs_dim(),
                task.unique_dim(),
                task.common_dim(),
                task.joint_dim(),
                task.predicted_dim(),
            ];
            assert_eq!(found, dims, "{id}");
            let spread = id.starts_with("spread");
            for (agent, body) in task.physics().bodies.iter().enumerate() {
                let speaker = id == "speaker-listener" && agent == 0;
                assert_eq!((body.size, body.mass), (size, 1.0), "{id}");
                assert_eq!((body.collides, body.movable), (spread, !speaker), "{id}");
                assert_eq!(task.available_actions(agent), if speaker { 3 } else { 5 }, "{id}");
            }
            assert!(!task.summary().contains('\n'));
        }
    }

    #[test]
    fn a_team_size_has_one_task_or_an_error_that_helps() {
        let expected = [
            (2, "hear-see"),
            (3, "spread-blindfold"),
            (4, "spread-xy-4"),
            (6, "spread-blindfold-6"),
            (8, "spread-xy-8"),
            (12, "spread-blindfold-12"),
        ];
        for (n, id) in expected {
            let task = Task::by_team_size(n).unwrap();
            assert_eq!((task.id(), task.n_agents()), (id, n));
        }
        for (n, says) in
            [(0, "1 to 64"), (1, "spread-blindfold-1`"), (5, "2, 3, 4, 6, 8 and 12"), (65, "1 to 64")]
        {
            let error = Task::by_team_size(n).unwrap_err();
            assert_eq!(error.exit_code(), 2);
            assert!(error.to_string().contains(says), "{error}");
        }
    }
}
