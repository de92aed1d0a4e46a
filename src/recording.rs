//! Recorded episodes: the JSON format of recordings and traces.
//!
//! A *recording* holds what a world did. A *trace* also holds what the agents saw and thought: who
//! received whom, joint estimates and logits. `docs/formats.md` describes every field.

use std::io::Write;
use std::path::Path;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::base::regular;
use crate::environment::{ActionSpace, PhysicsSpec, State};
use crate::link::LONGEST_DELAY;

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
    /// Version of the program that wrote it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
}

/// One episode: T steps, T + 1 states; fewer states where the environment tells none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Episode {
    /// Number of the episode, part of the address of its draws (traces of this program).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub episode: Option<u64>,
    /// The level all links shared; absent or null where they did not.
    #[serde(default)]
    pub p: Option<f64>,
    /// Index of the goal landmark, if there is one.
    pub goal_landmark: Option<usize>,
    /// `[landmark]`.
    pub landmark_pos: Vec<DVec2>,
    /// `[T + 1][agent]`.
    pub agent_pos: Vec<Vec<DVec2>>,
    /// `[T + 1][agent]`.
    pub agent_vel: Vec<Vec<DVec2>>,
    /// `[T][agent]`.
    pub actions: Vec<Vec<Action>>,
    /// `[T or T + 1][agent]`, each an observation, padded or not.
    pub obs: Vec<Vec<Vec<f32>>>,
    /// `[T][agent]` (recordings).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub agent_reward: Vec<Vec<f64>>,
    /// `[T]`.
    pub team_reward: Vec<f64>,
    /// Undiscounted sum of the team rewards.
    #[serde(rename = "return")]
    pub episode_return: f64,
    /// Whether the episode ended because nothing was left to earn, and not because time was up.
    #[serde(default, skip_serializing_if = "is_false")]
    pub terminated: bool,
    /// `[T][receiver][sender]`, 1 if delivered at once (traces).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub delivered: Vec<Vec<Vec<u8>>>,
    /// `[T][receiver][sender]`, how many ticks ago what was delivered had been sent, null if nothing was (traces of links
    /// that can postpone).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ages: Vec<Vec<Vec<Option<u8>>>>,
    /// `[T][receiver][sender]`, 1 if the links delivered it and it came too late (traces against the clock in which
    /// something did).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub late: Vec<Vec<Vec<u8>>>,
    /// `[T][agent]`, whether it decided (traces in which somebody did not).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub presence: Vec<Vec<Presence>>,
    /// `[T][agent][joint]`, the policy's input; empty where the agent did not decide (traces).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_estimate: Vec<Vec<Vec<f32>>>,
    /// `[T][agent][available action]`; empty where the agent did not decide (traces).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub logits: Vec<Vec<Vec<f32>>>,
}

/// What an agent did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Action {
    /// The number of a discrete action.
    Discrete(u32),
    /// Values.
    Box(Vec<f32>),
}

/// Whether an agent decided at a step. In files it is a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub enum Presence {
    /// It decided.
    #[default]
    Decided,
    /// It was there, but did not decide in time.
    Missed,
    /// It was not there, or was lost before it decided.
    Absent,
    /// It decided, for the first time since it was started anew within the episode: it remembers nothing.
    Anew,
}

impl Presence {
    const ALL: [Presence; 4] = [Presence::Decided, Presence::Missed, Presence::Absent, Presence::Anew];

    /// Whether it decided.
    pub fn decided(self) -> bool {
        matches!(self, Presence::Decided | Presence::Anew)
    }
}

impl TryFrom<u8> for Presence {
    type Error = String;

    fn try_from(number: u8) -> std::result::Result<Presence, String> {
        let known = Presence::ALL.get(usize::from(number));
        known.copied().ok_or_else(|| format!("a presence is 0 to {}, not {number}", Presence::ALL.len() - 1))
    }
}

impl From<Presence> for u8 {
    fn from(presence: Presence) -> u8 {
        presence as u8
    }
}

impl std::fmt::Display for Action {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Action::Discrete(action) => write!(f, "{action}"),
            Action::Box(values) => write!(f, "{values:?}"),
        }
    }
}

impl Action {
    /// What these words mean as an action of `space`.
    pub fn of(space: &ActionSpace, words: &[u32]) -> Action {
        match space {
            ActionSpace::Discrete(_) => Action::Discrete(words[0]),
            ActionSpace::Box { low, .. } => {
                Action::Box(words[..low.len()].iter().map(|word| f32::from_bits(*word)).collect())
            }
        }
    }

    /// The words that mean it, zero-padded to `width`.
    pub fn words(&self, width: usize) -> Vec<u32> {
        let mut words = match self {
            Action::Discrete(action) => vec![*action],
            Action::Box(values) => values.iter().map(|value| value.to_bits()).collect(),
        };
        words.resize(width.max(words.len()), 0);
        words
    }
}

fn is_false(flag: &bool) -> bool {
    !flag
}

impl Recording {
    /// Reads a recording or a trace.
    pub fn read(path: &Path) -> Result<Recording> {
        let text = regular::read(path, LARGEST)?;
        let recording: Recording = serde_json::from_slice(&text)
            .map_err(|e| Error::io("read", path, format!("it is not a recording or trace: {e}")))?;
        recording.check().map_err(|what| Error::io("read", path, what))?;
        Ok(recording)
    }

    /// Whether the agents' side is recorded as well.
    pub(crate) fn is_trace(&self) -> bool {
        self.episodes.iter().any(|episode| !episode.joint_estimate.is_empty())
    }

    /// Checks that every array has the length that the header and the actions promise.
    fn check(&self) -> std::result::Result<(), String> {
        let RecordingHeader { n_agents, n_landmarks, episode_steps, .. } = self.header;
        let is_trace = self.is_trace();
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

impl Episode {
    /// An episode that begins in this state of a world.
    pub fn begin(state: State) -> Episode {
        let (goal_landmark, landmark_pos) = (state.goal, state.landmarks.clone());
        let mut episode = Episode { goal_landmark, landmark_pos, ..Episode::default() };
        episode.push_state(state);
        episode
    }

    /// Appends the state of its world.
    pub(crate) fn push_state(&mut self, state: State) {
        self.agent_pos.push(state.positions);
        self.agent_vel.push(state.velocities);
    }

    /// How many ticks ago what reaches `receiver` from `sender` at a step was sent; `None` if nothing does.
    pub fn age(&self, step: usize, receiver: usize, sender: usize) -> Option<u8> {
        let at_once = || (self.delivered[step][receiver][sender] == 1).then_some(0);
        self.ages.get(step).map_or_else(at_once, |ages| ages[receiver][sender])
    }

    /// Whether an agent decided at a step.
    pub fn presence(&self, step: usize, agent: usize) -> Presence {
        self.presence.get(step).map_or(Presence::Decided, |agents| agents[agent])
    }

    /// Whether what reaches `receiver` from `sender` at a step came too late.
    pub fn is_late(&self, step: usize, receiver: usize, sender: usize) -> bool {
        self.late.get(step).is_some_and(|rows| rows[receiver][sender] == 1)
    }

    /// The most ticks that anything was under way.
    pub fn longest_delay(&self) -> u8 {
        self.ages.iter().flatten().flatten().flatten().copied().max().unwrap_or_default()
    }

    /// Checks that `ages` has so many steps, and holds nothing from before the episode or after what links can do.
    fn check_ages(&self, agents: usize, steps: usize) -> std::result::Result<(), String> {
        let rows = self.ages.iter().flatten();
        if shape(&self.ages) != Some((steps, agents)) || rows.clone().any(|row| row.len() != agents) {
            return Err(format!("`ages` is not {steps} steps of {agents} rows of {agents}"));
        }
        let too_old = |(step, rows): (usize, &Vec<Vec<Option<u8>>>)| {
            let oldest = step.min(LONGEST_DELAY.into());
            let age = rows.iter().flatten().flatten().find(|age| usize::from(**age) > oldest);
            age.map(|age| format!("`ages` of step {step} has {age}, and {oldest} is the most there can be"))
        };
        self.ages.iter().enumerate().find_map(too_old).map_or(Ok(()), Err)
    }

    /// The state before step `step`, and the words of the actions of the step before, `[agents, width]`, if there was one.
    pub fn at(&self, step: usize, width: usize) -> (State, Option<Vec<u32>>) {
        let state = State {
            positions: self.agent_pos[step].clone(),
            velocities: self.agent_vel[step].clone(),
            landmarks: self.landmark_pos.clone(),
            goal: self.goal_landmark,
        };
        (state, step.checked_sub(1).map(|last| self.words(last, width)))
    }

    /// The words of the actions of a step, `[agents, width]`.
    pub fn words(&self, step: usize, width: usize) -> Vec<u32> {
        self.actions[step].iter().flat_map(|action| action.words(width)).collect()
    }
}

/// Writes a recording, episode by episode. The file appears when it is finished.
#[derive(Debug)]
pub(crate) struct RecordingFile {
    file: AtomicFile,
    episodes: usize,
}

impl RecordingFile {
    /// Starts a recording at `path`.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<RecordingFile> {
        let mut recorder = RecordingFile { file: AtomicFile::create(path)?, episodes: 0 };
        let header = serde_json::to_string(header).expect("a header is plain data");
        let open = header.strip_suffix('}').expect("a struct is a JSON object");
        recorder.write(|file| write!(file, "{open},\"episodes\":["))?;
        Ok(recorder)
    }

    /// Appends an episode.
    pub fn push(&mut self, episode: &Episode) -> Result<()> {
        let separator = if self.episodes == 0 { "" } else { "," };
        self.episodes += 1;
        self.write(|file| {
            writeln!(file, "{separator}")?;
            serde_json::to_writer(file, episode).map_err(std::io::Error::from)
        })
    }

    /// Puts the recording in its place.
    pub fn finish(mut self) -> Result<()> {
        self.write(|file| writeln!(file, "\n]}}"))?;
        self.file.commit()
    }

    fn write(&mut self, write: impl FnOnce(&mut AtomicFile) -> std::io::Result<()>) -> Result<()> {
        let path = self.file.path().to_owned();
        write(&mut self.file).map_err(|e| Error::io("write", &path, e))
    }
}
