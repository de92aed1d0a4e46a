//! A scene: all that a view shows of a swarm at one tick.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::environment::places::Ghost;

/// One world of a swarm at the moment when its agents have decided, and what was counted until then.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Scene {
    /// The number of the episode.
    pub(crate) episode: u64,
    /// The step within it.
    pub(crate) step: u32,
    /// Ticks since the swarm started.
    pub(crate) tick: u64,
    /// Where the agents are, m; empty if the environment has no places.
    pub(crate) positions: Vec<DVec2>,
    /// Where they were at the steps before, `[steps, agents]`, the latest last.
    pub(crate) trail: Vec<DVec2>,
    /// Where the landmarks are, m.
    pub(crate) landmarks: Vec<DVec2>,
    /// Where those are who move and are not of the team, m.
    pub(crate) targets: Vec<DVec2>,
    /// The landmark that is the goal of all.
    pub(crate) goal: Option<usize>,
    /// What each agent did.
    pub(crate) parts: Vec<Part>,
    /// What became of each observation, `[receiver, sender]`.
    pub(crate) fates: Vec<Fate>,
    /// Where each agent thinks the others are, as far as it does not know it.
    pub(crate) ghosts: Vec<Vec<AgedGhost>>,
    /// How wrong what each agent imputed was, over some hundred ticks: a root mean square, in units of the observation.
    pub(crate) errors: Vec<Option<f64>>,
    /// What the team has earned in this episode.
    pub(crate) episode_return: f64,
    /// What it earned in the episodes before, the latest last.
    pub(crate) returns: Vec<f64>,
    /// The probability of delivery, if links have but one.
    pub(crate) level: Option<f64>,
    /// What was counted.
    pub(crate) totals: Totals,
}

impl Scene {
    /// Whether its parts fit together, for so many agents: drawing relies on that.
    pub(super) fn fits(&self, agents: usize) -> bool {
        let places = self.positions.len();
        let ghosts = |ghosts: &Vec<AgedGhost>| {
            ghosts.iter().all(|aged| aged.ghost.agent < agents && aged.ghost.agent < places)
        };
        (places == agents || places == 0)
            && (self.trail.is_empty() || places > 0 && self.trail.len().is_multiple_of(places))
            && self.parts.len() == agents
            && self.fates.len() == agents * agents
            && self.ghosts.len() == agents
            && self.ghosts.iter().all(ghosts)
            && self.errors.len() == agents
    }
}

/// What an agent did at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Part {
    /// It decided.
    #[default]
    Decided,
    /// It was there, but did not decide in time.
    Missed,
    /// It was not there.
    Absent,
}

/// What became of an observation at the tick at which it was to arrive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum Fate {
    /// It is the agent's own, or its sender or its receiver took no part.
    #[default]
    None,
    /// It was there when its receiver decided.
    Delivered,
    /// What arrived instead was so many ticks old.
    Delayed(u8),
    /// The links delivered it, but its receiver did not have it when it decided.
    Late,
    /// Nothing arrived.
    Lost,
}

/// Where an agent thinks another is, and since when it has to guess.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct AgedGhost {
    /// Who is thought to be where.
    pub(crate) ghost: Ghost,
    /// Ticks since all was known.
    pub(crate) age: u32,
}

/// What was counted of all that was played.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Totals {
    /// Episodes.
    pub(crate) finished: u64,
    /// Their mean return, and half its 95 % interval.
    pub(crate) return_mean: f64,
    pub(crate) return_ci95: Option<f64>,
    /// The share of observations that were delivered, and that were late; of finished episodes.
    pub(crate) delivery_rate: Option<f64>,
    pub(crate) late_rate: Option<f64>,
    /// The error of what was imputed in finished episodes.
    pub(crate) imputation_rmse: Option<f64>,
    /// Decisions that were not made in time, that were not made because nobody was there, and that were due, in finished
    /// episodes.
    pub(crate) missed: u64,
    pub(crate) absent: u64,
    pub(crate) due: u64,
    /// Tick times, us.
    pub(crate) tick_p50_us: f64,
    pub(crate) tick_p99_us: f64,
    /// Time spent playing, s.
    pub(crate) elapsed_s: f64,
}
