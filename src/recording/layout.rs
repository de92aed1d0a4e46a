//! How an episode is laid out in bytes: states, actions and arrivals as they stand in memory. What agents observed and
//! thought follows from them. `docs/formats.md` describes it byte by byte.

use std::path::Path;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::step::{LATE, LOST};
use super::{Action, Episode, Presence, RecordingHeader, Versions};
use crate::base::error::{Error, Result};
use crate::environment::{ActionSpace, Environment, Spec, Task};

/// Bytes of an episode before its arrays.
const HEAD: usize = 32;

/// No goal.
const NONE: u32 = u32::MAX;

/// What all episodes share, and how they are laid out.
#[derive(Serialize, Deserialize)]
struct CompactHeader {
    #[serde(flatten)]
    about: RecordingHeader,
    arrays: Vec<Array>,
}

/// An array of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Array {
    name: String,
    /// `f64`, `u32` or `u8`, little-endian.
    #[serde(rename = "type")]
    kind: String,
    /// The last index runs fastest. `T` is the number of steps.
    shape: Vec<Length>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum Length {
    Fixed(usize),
    Of(String),
}

/// How the episodes of a task are laid out.
#[derive(Debug)]
pub(crate) struct Layout {
    spec: Spec,
    /// Whether every action fits a byte.
    small: bool,
}

impl Layout {
    /// The layout for the task of this name.
    pub(super) fn of(task: &Task) -> Layout {
        let spec = task.spec().clone();
        let is_small = |space: &ActionSpace| matches!(space, ActionSpace::Discrete(n) if *n <= 256);
        Layout { small: spec.agents.iter().all(|agent| is_small(&agent.actions)), spec }
    }

    /// The arrays of an episode, in order.
    fn arrays(&self) -> Vec<Array> {
        let (agents, width) = (self.spec.n_agents(), self.spec.action_width());
        let array = |name: &str, kind: &str, first: Option<&str>, rest: &[usize]| {
            let first = first.map(|of| Length::Of(of.to_owned()));
            let shape = first.into_iter().chain(rest.iter().map(|length| Length::Fixed(*length))).collect();
            Array { name: name.to_owned(), kind: kind.to_owned(), shape }
        };
        let targets = [self.spec.targets, 2];
        let mut arrays = vec![
            array("landmark_pos", "f64", None, &[self.spec.landmarks, 2]),
            array("agent_pos", "f64", Some("T + 1"), &[agents, 2]),
            array("agent_vel", "f64", Some("T + 1"), &[agents, 2]),
            array("team_reward", "f64", Some("T"), &[]),
            array("actions", if self.small { "u8" } else { "u32" }, Some("T"), &[agents, width]),
            array("arrived", "u8", Some("T"), &[agents, agents]),
            array("presence", "u8", Some("T"), &[agents]),
        ];
        if self.spec.targets > 0 {
            let places = ["target_pos", "target_vel"].map(|name| array(name, "f64", Some("T + 1"), &targets));
            arrays.splice(3..3, places);
        }
        arrays
    }

    /// What all episodes share, and how they are laid out, as JSON.
    pub(super) fn header(&self, header: &RecordingHeader) -> Vec<u8> {
        let header = CompactHeader { about: header.clone(), arrays: self.arrays() };
        serde_json::to_vec(&header).expect("a header is plain data")
    }

    /// An episode.
    pub(super) fn encode(&self, episode: &Episode, bytes: &mut Vec<u8>) {
        bytes.clear();
        let (steps, agents) = (episode.actions.len(), self.spec.n_agents());
        bytes.extend((steps as u32).to_le_bytes());
        bytes.extend(u32::from(episode.terminated).to_le_bytes());
        bytes.extend(episode.episode.unwrap_or_default().to_le_bytes());
        bytes.extend(episode.p.unwrap_or(f64::NAN).to_le_bytes());
        bytes.extend(episode.goal_landmark.map_or(NONE, |goal| goal as u32).to_le_bytes());
        bytes.extend([0; 4]);
        let places = episode.landmark_pos.iter().chain(episode.agent_pos.iter().flatten());
        let moving = [&episode.agent_vel, &episode.target_pos, &episode.target_vel];
        for DVec2 { x, y } in places.chain(moving.into_iter().flatten().flatten()) {
            bytes.extend(x.to_le_bytes());
            bytes.extend(y.to_le_bytes());
        }
        episode.team_reward.iter().for_each(|reward| bytes.extend(reward.to_le_bytes()));
        for step in 0..steps {
            for word in episode.words(step, self.spec.action_width()) {
                bytes.extend(&word.to_le_bytes()[..if self.small { 1 } else { 4 }]);
            }
        }
        for (step, receiver) in (0..steps).flat_map(|step| (0..agents).map(move |receiver| (step, receiver)))
        {
            bytes.extend((0..agents).map(|sender| match episode.age(step, receiver, sender) {
                Some(age) => age,
                None if episode.is_late(step, receiver, sender) => LATE,
                None => LOST,
            }));
        }
        for step in 0..steps {
            bytes.extend((0..agents).map(|agent| u8::from(episode.presence(step, agent))));
        }
    }

    /// The bytes of an episode of so many steps.
    fn length(&self, steps: usize) -> usize {
        let (agents, width) = (self.spec.n_agents(), self.spec.action_width());
        let action = if self.small { 1 } else { 4 };
        HEAD + 16 * self.spec.landmarks
            + 32 * (steps + 1) * (agents + self.spec.targets)
            + steps * (8 + action * agents * width + agents * agents + agents)
    }

    /// The episode with these bytes, as many as one of its steps has; an error in words if it cannot be one.
    fn decode(&self, bytes: &[u8], delays: bool) -> std::result::Result<Episode, String> {
        let (agents, width) = (self.spec.n_agents(), self.spec.action_width());
        let targets = Some(self.spec.targets).filter(|targets| *targets > 0);
        let mut bytes = Bytes(bytes);
        let (steps, terminated) = (bytes.u32() as usize, bytes.u32());
        let (number, p, goal) = (bytes.u64(), bytes.f64(), bytes.u32());
        bytes.take(4);
        let mut episode = Episode {
            episode: Some(number),
            p: (!p.is_nan()).then_some(p),
            goal_landmark: (goal != NONE).then_some(goal as usize),
            terminated: terminated & 1 == 1,
            landmark_pos: bytes.places(self.spec.landmarks),
            agent_pos: (0..=steps).map(|_| bytes.places(agents)).collect(),
            agent_vel: (0..=steps).map(|_| bytes.places(agents)).collect(),
            target_pos: targets.map_or(vec![], |n| (0..=steps).map(|_| bytes.places(n)).collect()),
            target_vel: targets.map_or(vec![], |n| (0..=steps).map(|_| bytes.places(n)).collect()),
            team_reward: (0..steps).map(|_| bytes.f64()).collect(),
            ..Episode::default()
        };
        let vectors = [&episode.agent_pos, &episode.agent_vel, &episode.target_pos, &episode.target_vel]
            .into_iter()
            .flatten()
            .flatten()
            .chain(&episode.landmark_pos);
        if !vectors.copied().all(DVec2::is_finite)
            || !episode.team_reward.iter().all(|reward| reward.is_finite())
        {
            return Err("it holds a place, velocity or reward that is no number".to_owned());
        }
        episode.episode_return = episode.team_reward.iter().fold(0.0, |sum, reward| sum + reward);
        for _ in 0..steps {
            let mut of_team = Vec::with_capacity(agents);
            for agent in &self.spec.agents {
                let words: Vec<u32> =
                    (0..width).map(|_| if self.small { bytes.u8().into() } else { bytes.u32() }).collect();
                let action = Action::of(&agent.actions, &words);
                if !agent.actions.contains(&words) {
                    return Err(format!("{} has no action {action}", agent.name));
                }
                of_team.push(action);
            }
            episode.actions.push(of_team);
        }
        for step in 0..steps {
            let arrived: Vec<&[u8]> = (0..agents).map(|_| bytes.take(agents)).collect();
            let each = |of: &dyn Fn(u8) -> u8| -> Vec<Vec<u8>> {
                arrived.iter().map(|row| row.iter().map(|code| of(*code)).collect()).collect()
            };
            episode.delivered.push(each(&|code| u8::from(code == 0)));
            episode.push_late(step, each(&|code| u8::from(code == LATE)));
            let age = |code: &u8| Some(*code).filter(|code| *code < LATE);
            if delays {
                episode.ages.push(arrived.iter().map(|row| row.iter().map(age).collect()).collect());
            } else if let Some(age) =
                arrived.iter().flat_map(|row| row.iter()).filter_map(age).find(|age| *age > 0)
            {
                return Err(format!("something is {age} ticks old, and these links do not delay"));
            }
        }
        if delays {
            episode.check_ages(agents, steps)?;
        }
        for step in 0..steps {
            let presence = bytes.take(agents).iter().map(|number| Presence::try_from(*number));
            episode.push_presence(step, presence.collect::<std::result::Result<_, _>>()?);
        }
        Ok(episode)
    }
}

/// Reads the episodes of a header.
pub(super) struct Decoder {
    layout: Layout,
    /// What agents observed is seen here again.
    environment: Box<dyn Environment>,
    /// The most steps, and whether links delay.
    episode_steps: usize,
    delays: bool,
}

impl Decoder {
    /// What all episodes share, and who reads them, by the header of the file at `path`. It is of this version, if not of
    /// the one that it says.
    pub(super) fn of(header: &[u8], version: Option<u32>, path: &Path) -> Result<(RecordingHeader, Decoder)> {
        let failed = |what: String| Error::io("read", path, what);
        let mut versions: Versions = serde_json::from_slice(header).unwrap_or_default();
        versions.format_version = version.or(versions.format_version);
        versions.check().map_err(failed)?;
        let header: CompactHeader = serde_json::from_slice(header)
            .map_err(|e| failed(format!("its header is not that of a recording or trace: {e}")))?;
        let task = Task::parse(&header.about.task)?.with_physics(header.about.physics)?;
        let (layout, about, spec) = (Layout::of(&task), header.about, task.spec());
        let sizes = (about.n_agents, about.n_landmarks, about.episode_steps);
        let expected = (spec.n_agents(), spec.landmarks, spec.episode_steps);
        if sizes != expected || header.arrays != layout.arrays() {
            return Err(failed(format!("its episodes are laid out otherwise than those of {} are", spec.id)));
        }
        let decoder = Decoder {
            layout,
            environment: task.environment(1),
            episode_steps: about.episode_steps,
            delays: about.longest_delay > 0 || about.relay,
        };
        Ok((about, decoder))
    }

    /// The bytes of an episode that has so many steps; an error in words if none can.
    pub(super) fn length(&self, steps: usize) -> std::result::Result<usize, String> {
        if (1..=self.episode_steps).contains(&steps) {
            return Ok(self.layout.length(steps));
        }
        Err(format!("it has {steps} steps, and {} is the most there can be", self.episode_steps))
    }

    /// The episode with these bytes; an error in words if it cannot be one.
    pub(super) fn decode(&mut self, bytes: &[u8]) -> std::result::Result<Episode, String> {
        let steps = bytes.first_chunk().map_or(0, |steps| u32::from_le_bytes(*steps) as usize);
        let length = self.length(steps)?;
        if bytes.len() != length {
            return Err(format!("it has {} bytes, and {steps} steps have {length}", bytes.len()));
        }
        let mut episode = self.layout.decode(bytes, self.delays)?;
        episode.observe(&mut *self.environment).map_err(|e| e.to_string())?;
        Ok(episode)
    }
}

/// Numbers one after the other. There are as many as are taken.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, length: usize) -> &'a [u8] {
        let (taken, rest) = self.0.split_at(length);
        self.0 = rest;
        taken
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        self.take(N).try_into().expect("as many were taken")
    }

    fn u8(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.array())
    }

    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.array())
    }

    fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.array())
    }

    fn places(&mut self, number: usize) -> Vec<DVec2> {
        (0..number).map(|_| DVec2::new(self.f64(), self.f64())).collect()
    }
}
