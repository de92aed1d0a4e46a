//! What a view knows of a swarm before its first tick.

use serde::{Deserialize, Serialize};

use crate::environment::Spec;
use crate::environment::places::Places;

/// What stays as it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Facts {
    /// The task.
    pub(crate) task: String,
    /// Size of the team.
    pub(crate) agents: usize,
    /// Steps of the longest episode.
    pub(crate) steps: usize,
    /// Whether the agents have places.
    pub(crate) places: bool,
    /// Whether observations tell where agents are.
    pub(crate) told: bool,
    /// Episodes to play.
    pub(crate) episodes: u64,
    /// Parallel worlds; the view shows the first.
    pub(crate) worlds: usize,
    /// The imputer.
    pub(crate) imputer: String,
    /// The links, in words, unless they are nothing but a level.
    pub(crate) links: String,
    /// Ticks a second as fast as the world's own time; `None` if the swarm keeps to a clock, so that it can be neither
    /// paused nor paced.
    pub(crate) pace: Option<f64>,
    /// The probability of delivery, if links have one that can be set.
    pub(crate) level: Option<f64>,
    /// Whether the run is recorded: a trace cannot say that links change.
    pub(crate) recorded: bool,
    /// Whether whoever looks is a guest, who can change nothing.
    pub(crate) guest: bool,
}

impl Facts {
    /// What an environment says of itself. The rest is for whoever starts the swarm to say.
    pub(crate) fn of(spec: &Spec) -> Facts {
        let places = Places::of(spec);
        Facts {
            task: spec.id.clone(),
            agents: spec.n_agents(),
            steps: spec.episode_steps,
            places: spec.positions,
            told: (0..spec.n_agents()).any(|agent| places.tell(agent)),
            episodes: 1,
            worlds: 1,
            imputer: String::new(),
            links: String::new(),
            pace: Some(1.0 / spec.dt),
            level: None,
            recorded: false,
            guest: false,
        }
    }
}
