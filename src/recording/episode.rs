//! An episode as it was recorded: what the world did, and what the agents received and thought.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::{is_false, shape};
use crate::base::error::Result;
use crate::environment::{ActionSpace, Environment, State, Target};
use crate::link::LONGEST_DELAY;

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
    /// `[T + 1][target]`: who moves and is not of the team.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub target_pos: Vec<Vec<DVec2>>,
    /// `[T + 1][target]`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub target_vel: Vec<Vec<DVec2>>,
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
        if !state.targets.is_empty() {
            self.target_pos.push(state.targets.iter().map(|target| target.position).collect());
            self.target_vel.push(state.targets.iter().map(|target| target.velocity).collect());
        }
    }

    /// How many ticks ago what reaches `receiver` from `sender` at a step was sent; `None` if nothing does.
    pub fn age(&self, step: usize, receiver: usize, sender: usize) -> Option<u8> {
        let at_once = || (self.delivered[step][receiver][sender] == 1).then_some(0);
        self.ages.get(step).map_or_else(at_once, |ages| ages[receiver][sender])
    }

    /// Sees again what the agents observed before each step, in a world of the task.
    pub(crate) fn observe(&mut self, environment: &mut dyn Environment) -> Result<()> {
        let (agents, each) = (environment.spec().n_agents(), environment.spec().padded_obs_dim());
        let (width, mut observations) = (environment.spec().action_width(), vec![0.0; agents * each]);
        for step in 0..self.actions.len() {
            let (state, last_actions) = self.at(step, width);
            environment.set_state(0, &state, last_actions.as_deref())?;
            environment.observe(1, &mut observations)?;
            self.obs.push(observations.chunks_exact(each).map(<[f32]>::to_vec).collect());
        }
        Ok(())
    }

    /// Appends who decided at a step, unless everybody always did.
    pub(crate) fn push_presence(&mut self, step: usize, presence: Vec<Presence>) {
        if !self.presence.is_empty() || presence.iter().any(|it| *it != Presence::Decided) {
            self.presence.resize(step, vec![Presence::Decided; presence.len()]);
            self.presence.push(presence);
        }
    }

    /// Appends what was late at a step, unless nothing ever was.
    pub(crate) fn push_late(&mut self, step: usize, late: Vec<Vec<u8>>) {
        if !self.late.is_empty() || late.iter().flatten().any(|it| *it == 1) {
            self.late.resize(step, vec![vec![0; late.len()]; late.len()]);
            self.late.push(late);
        }
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
    pub(super) fn check_ages(&self, agents: usize, steps: usize) -> std::result::Result<(), String> {
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

    /// Those who move and are not of the team, before step `step`.
    fn targets(&self, step: usize) -> Vec<Target> {
        let [positions, velocities] =
            [&self.target_pos, &self.target_vel].map(|of| of.get(step).into_iter().flatten());
        positions.zip(velocities).map(|(&position, &velocity)| Target { position, velocity }).collect()
    }

    /// The state before step `step`, and the words of the actions of the step before, `[agents, width]`, if there was one.
    pub fn at(&self, step: usize, width: usize) -> (State, Option<Vec<u32>>) {
        let state = State {
            positions: self.agent_pos[step].clone(),
            velocities: self.agent_vel[step].clone(),
            landmarks: self.landmark_pos.clone(),
            targets: self.targets(step),
            goal: self.goal_landmark,
        };
        (state, step.checked_sub(1).map(|last| self.words(last, width)))
    }

    /// The words of the actions of a step, `[agents, width]`.
    pub fn words(&self, step: usize, width: usize) -> Vec<u32> {
        self.actions[step].iter().flat_map(|action| action.words(width)).collect()
    }
}
