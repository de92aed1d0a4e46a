//! Recorded episodes as pictures: what there is to see in them, and the pages, films and frames that show it.

mod evaluated;
mod font;
mod gif;
mod page;
mod raster;
mod scene;
mod svg;

use glam::DVec2;

pub(crate) use evaluated::evaluated;
pub(crate) use gif::gif;
pub(crate) use page::page;
pub(crate) use scene::Moment;
pub(crate) use svg::svg;

use crate::base::error::Result;
use crate::environment::{Spec, Task};
use crate::recording::{Episode, RecordingHeader, Step, Steps};
use crate::usage;

/// How far from the origin anything may be, m: as far as what agents can observe.
const FARTHEST: f64 = 1e9;

/// What there is to see in a recording.
#[derive(Debug)]
pub(crate) struct Film {
    /// What it is called where there are several.
    pub name: String,
    pub header: RecordingHeader,
    pub takes: Vec<Take>,
    steps: Steps,
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

impl Film {
    /// A film without episodes.
    ///
    /// # Errors
    /// `Usage` if there is no such task, or the recording is of a team of another size.
    pub(crate) fn of(name: String, header: RecordingHeader) -> Result<Film> {
        let task = Task::parse(&header.task)?;
        let spec = task.spec();
        if header.n_agents != spec.n_agents() {
            return Err(usage!("{name} has {} agents, {} has {}", header.n_agents, spec.id, spec.n_agents()));
        }
        Ok(Film { name, header, takes: Vec::new(), steps: Steps::of(&task) })
    }

    /// What it was played in.
    pub(crate) fn spec(&self) -> &Spec {
        &self.steps.spec
    }

    /// Takes an episode in, whose number is `number` unless it says another.
    ///
    /// # Errors
    /// `Usage` if it has no places, or other values than its task.
    pub(crate) fn push(&mut self, number: u64, episode: &Episode) -> Result<()> {
        let number = episode.episode.unwrap_or(number);
        if !episode.agent_pos.iter().all(|places| places.len() == self.spec().n_agents()) {
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
            steps: steps.map(|step| self.steps.at(episode, step)).collect::<Option<_>>().ok_or_else(
                || {
                    usage!(
                        "episode {number} of {} has observations or estimates of another length than {} has",
                        self.name,
                        self.spec().id
                    )
                },
            )?,
        });
        Ok(())
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
