//! Recorded episodes: as JSON, in a compact format, and as MCAP.
//!
//! A *recording* holds what a world did. A *trace* also holds what the agents saw and thought: who
//! received whom, joint estimates and logits. `docs/formats.md` describes every field.

mod compact;
mod episode;
mod file;
mod layout;
#[cfg(feature = "mcap")]
mod mcap;
mod reader;
#[cfg(feature = "cli")]
mod rerun;
mod step;

use std::path::Path;

use serde::{Deserialize, Serialize};

pub use episode::{Action, Episode, Presence};
pub(crate) use file::{Format, RecordingFile};
pub(crate) use reader::{Reader, has_magic};
#[cfg(feature = "cli")]
pub(crate) use rerun::Rerun;
pub(crate) use step::{Arrived, Step, Steps};

use crate::base::error::Result;
use crate::environment::PhysicsSpec;

/// The version of all formats, which a reader of this version knows.
pub const FORMAT_VERSION: u32 = 1;

/// The most bytes a recording, or another file of JSON, may have.
pub(crate) const LARGEST: u64 = 1 << 31;

/// A file of recorded episodes.
#[derive(Clone, Debug, Deserialize)]
pub struct Recording {
    /// What all episodes share.
    #[serde(flatten)]
    pub header: RecordingHeader,
    /// The episodes.
    pub episodes: Vec<Episode>,
}

/// What all episodes of a recording share.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RecordingHeader {
    /// Id of the task.
    pub task: String,
    /// Size of the team.
    pub n_agents: usize,
    /// Landmarks in the world.
    pub n_landmarks: usize,
    /// Steps of the longest episode.
    pub episode_steps: usize,
    /// Kind of the actor network, `mlp` or `gru` (traces).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub actor: Option<String>,
    /// Imputer that made the joint estimates (traces; the policy's preferred one if absent).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub imputer: Option<String>,
    /// Where the policy came from (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// Seed of all draws (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Whether the most probable actions were taken, not sampled ones (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub greedy: Option<bool>,
    /// Mode of the links (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<String>,
    /// The communication matrix, where it is fixed (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<Vec<Vec<f64>>>,
    /// How bodies moved, if otherwise than by default.
    #[serde(default, skip_serializing_if = "PhysicsSpec::is_default")]
    pub physics: PhysicsSpec,
    /// Whether everything was delivered at t = 0 (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub comm_at_t0: Option<bool>,
    /// Ticks a second, if it was played against the clock (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// The most ticks by which links postpone what is sent, if they do (traces of this program).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub longest_delay: u8,
    /// Whether messages also carried the newest that their senders held of others (traces of this program).
    #[serde(default, skip_serializing_if = "is_false")]
    pub relay: bool,
    /// Fingerprints of the logs that `links` names, in their order (traces of this program).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub logs: Vec<String>,
    /// Version of the program that wrote it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
    /// Version of the format, [`FORMAT_VERSION`] at most; absent where it was written before there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format_version: Option<u32>,
}

/// The versions that a file says it has, whatever else it says.
#[derive(Default, Deserialize)]
struct Versions {
    format_version: Option<u32>,
    version: Option<String>,
}

impl Versions {
    /// An error, in words, if the format is newer than this program.
    fn check(self) -> std::result::Result<(), String> {
        match self.format_version {
            Some(newer) if newer > FORMAT_VERSION => Err(format!(
                "its format has version {newer}, written by vamaro-swarm {}; this is vamaro-swarm {}, which reads versions \
                 up to {FORMAT_VERSION}; use a newer one",
                self.version.as_deref().unwrap_or("of an unknown version"),
                env!("CARGO_PKG_VERSION")
            )),
            _ => Ok(()),
        }
    }
}

impl Recording {
    /// Reads a whole recording or trace, of any format. Of what is no JSON it tells what agents observed, but not what they
    /// thought. Of an MCAP that was never finished it has the episodes that are whole.
    pub fn read(path: &Path) -> Result<Recording> {
        let reader = Reader::open(path)?;
        let header = reader.header.clone();
        Ok(Recording { header, episodes: reader.collect::<Result<_>>()? })
    }

    /// Checks that every array has the length that the header and the actions promise.
    fn check(&self) -> std::result::Result<(), String> {
        let RecordingHeader { n_agents, n_landmarks, episode_steps, .. } = self.header;
        let is_trace = self.episodes.iter().any(|episode| !episode.joint_estimate.is_empty());
        for (number, episode) in self.episodes.iter().enumerate() {
            let steps = episode.actions.len();
            if !(1..=episode_steps).contains(&steps) {
                return Err(format!("episode {number} has {steps} steps, not 1 to {episode_steps}"));
            }
            let trace = if is_trace { steps } else { 0 };
            let team = |rows: usize| Some((rows, n_agents));
            for (name, expected, found) in [
                ("landmark_pos", Some((n_landmarks, 0)), Some((episode.landmark_pos.len(), 0))),
                ("agent_pos", team(steps + 1), shape(&episode.agent_pos)),
                ("agent_vel", team(steps + 1), shape(&episode.agent_vel)),
                ("actions", team(steps), shape(&episode.actions)),
                ("obs", team(episode.obs.len().clamp(steps, steps + 1)), shape(&episode.obs)),
                ("team_reward", Some((steps, 0)), Some((episode.team_reward.len(), 0))),
                ("delivered", team(trace), shape(&episode.delivered)),
                ("joint_estimate", team(trace), shape(&episode.joint_estimate)),
                ("logits", team(trace), shape(&episode.logits)),
            ] {
                if expected != found && (expected, found) != (team(0), Some((0, 0))) {
                    return Err(format!("episode {number}: `{name}` is {found:?}, expected {expected:?}"));
                }
            }
            let targets = shape(&episode.target_pos);
            let is_there = targets.is_some_and(|(rows, _)| [0, steps + 1].contains(&rows));
            if !is_there || targets != shape(&episode.target_vel) {
                return Err(format!(
                    "episode {number}: `target_pos` and `target_vel` are not {} rows of as many targets each",
                    steps + 1
                ));
            }
            let rewards = shape(&episode.agent_reward);
            if rewards != team(steps) && rewards != Some((0, 0)) {
                return Err(format!("episode {number}: `agent_reward` is {rewards:?}"));
            }
            if episode.delivered.iter().flatten().any(|row| row.len() != n_agents) {
                return Err(format!("episode {number}: a row of `delivered` is not {n_agents} long"));
            }
            if ![team(0), team(steps)].contains(&shape_or_none(&episode.presence, n_agents)) {
                return Err(format!(
                    "episode {number}: `presence` is not {steps} steps of {n_agents} agents"
                ));
            }
            let late = shape_or_none(&episode.late, n_agents);
            if ![team(0), team(steps)].contains(&late)
                || episode.late.iter().flatten().any(|row| row.len() != n_agents)
            {
                return Err(format!(
                    "episode {number}: `late` is not {steps} steps of {n_agents} rows of {n_agents}"
                ));
            }
            if !episode.ages.is_empty() {
                episode.check_ages(n_agents, trace).map_err(|what| format!("episode {number}: {what}"))?;
            }
        }
        Ok(())
    }
}

/// Rows and columns; `None` if the rows differ in length.
fn shape<T>(rows: &[Vec<T>]) -> Option<(usize, usize)> {
    let columns = rows.first().map_or(0, Vec::len);
    rows.iter().all(|row| row.len() == columns).then_some((rows.len(), columns))
}

/// The same of what may be left out, which has no rows then but would have so many columns.
fn shape_or_none<T>(rows: &[Vec<T>], columns: usize) -> Option<(usize, usize)> {
    if rows.is_empty() { Some((0, columns)) } else { shape(rows) }
}

fn is_false(flag: &bool) -> bool {
    !flag
}

fn is_zero(number: &u8) -> bool {
    *number == 0
}
