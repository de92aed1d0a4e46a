//! Recorded episodes as pictures: what there is to see in them, and the pages, films and frames that show it.

mod font;
mod gif;
mod page;
mod raster;
mod scene;
mod svg;

use glam::DVec2;

pub(crate) use gif::gif;
pub(crate) use page::page;
pub(crate) use scene::Moment;
pub(crate) use svg::svg;

use super::places::{Ghost, Places};
use crate::base::error::Result;
use crate::environment::{Spec, Task};
use crate::recording::{Episode, Presence, RecordingHeader};
use crate::usage;

/// How far from the origin anything may be, m: as far as what agents can observe.
const FARTHEST: f64 = 1e9;

/// What there is to see in a recording.
#[derive(Debug)]
pub(crate) struct Film {
    /// What it is called where there are several.
    pub name: String,
    pub header: RecordingHeader,
    pub spec: Spec,
    pub takes: Vec<Take>,
    places: Places,
}

/// An episode of it.
#[derive(Debug)]
pub(crate) struct Take {
    pub number: u64,
    /// The level all links shared, if they did.
    pub p: Option<f64>,
    pub landmarks: Vec<DVec2>,
    /// The landmark that is the goal of all.
    pub goal: Option<usize>,
    /// `[T + 1][agent]`, m.
    pub positions: Vec<Vec<DVec2>>,
    /// What the team had earned before each step, and in the end, `[T + 1]`.
    pub returns: Vec<f64>,
    /// `[T + 1][target]`, m: those who move and are not of the team; empty if there are none.
    pub targets: Vec<Vec<DVec2>>,
    /// `[T]`; empty if the agents' side is not recorded.
    pub steps: Vec<Step>,
}

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

impl Film {
    /// A film without episodes.
    ///
    /// # Errors
    /// `Usage` if there is no such task, or the recording is of a team of another size.
    pub(crate) fn of(name: String, header: RecordingHeader) -> Result<Film> {
        let spec = Task::parse(&header.task)?.spec().clone();
        if header.n_agents != spec.n_agents() {
            return Err(usage!("{name} has {} agents, {} has {}", header.n_agents, spec.id, spec.n_agents()));
        }
        Ok(Film { name, header, places: Places::of(&spec), spec, takes: Vec::new() })
    }

    /// Takes an episode in, whose number is `number` unless it says another.
    ///
    /// # Errors
    /// `Usage` if it has no places, or other values than its task.
    pub(crate) fn push(&mut self, number: u64, episode: &Episode) -> Result<()> {
        let number = episode.episode.unwrap_or(number);
        if !episode.agent_pos.iter().all(|places| places.len() == self.spec.n_agents()) {
            return Err(usage!(
                "episode {number} of {} tells no places of its agents: there is nothing to see",
                self.name
            ));
        }
        let moving = episode.agent_pos.iter().chain(&episode.target_pos).flatten();
        let places = moving.chain(&episode.landmark_pos);
        if let Some(place) =
            places.copied().find(|place| !place.is_finite() || place.abs().max_element() > FARTHEST)
        {
            return Err(usage!(
                "episode {number} of {} has something at {place}: places must be numbers up to {FARTHEST:e} m",
                self.name
            ));
        }
        let mut returns = vec![0.0];
        returns.extend(episode.team_reward.iter().scan(0.0, |sum, reward| {
            *sum += reward;
            Some(*sum)
        }));
        let steps = 0..episode.joint_estimate.len();
        self.takes.push(Take {
            number,
            p: episode.p,
            landmarks: episode.landmark_pos.clone(),
            goal: episode.goal_landmark,
            positions: episode.agent_pos.clone(),
            targets: episode.target_pos.clone(),
            returns,
            steps: steps.map(|step| self.step(episode, step)).collect::<Option<_>>().ok_or_else(|| {
                usage!(
                    "episode {number} of {} has observations or estimates of another length than {} has",
                    self.name,
                    self.spec.id
                )
            })?,
        });
        Ok(())
    }

    /// What there is to see at a step; `None` if its values are not those of the task.
    fn step(&self, episode: &Episode, step: usize) -> Option<Step> {
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

    /// Whether the agents' side is recorded as well.
    pub(crate) fn is_of_a_trace(&self) -> bool {
        self.takes.iter().any(|take| !take.steps.is_empty())
    }

    /// What was played, in a few words: `dynamics, p = 0.2`.
    pub(crate) fn conditions(&self, take: &Take) -> String {
        let links = take.p.map(|p| format!("p = {p}")).or_else(|| self.header.links.clone());
        let words = self.header.imputer.iter().cloned().chain(links);
        words.collect::<Vec<_>>().join(", ")
    }
}

impl Take {
    /// Where anything is at any step.
    fn places(&self) -> impl Iterator<Item = &DVec2> {
        self.positions.iter().chain(&self.targets).flatten().chain(&self.landmarks)
    }

    /// How many steps it has.
    pub(crate) fn steps_taken(&self) -> usize {
        self.positions.len() - 1
    }
}
