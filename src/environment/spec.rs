//! The description of an environment: plain data, which travels to agents.

use serde::{Deserialize, Serialize};

use crate::base::rng::Draws;

/// An environment's description of itself, and with it the shape of everything that depends on it.
///
/// The joint observation is the unique parts of all agents in order, then the common part once. The unique
/// parts are what a predictor predicts; the common part is known to all. Dims count `f32` values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spec {
    /// The name that is used in everything written down, such as `spread-xy-4`.
    pub id: String,
    /// The agents, in order.
    pub agents: Vec<AgentSpec>,
    /// Dims at the start of a padded observation that differ between agents.
    pub unique: usize,
    /// The values behind them, which are the same for all agents.
    pub common: Vec<Value>,
    /// Landmarks in a world.
    pub landmarks: usize,
    /// Bodies in a world that move and are not of the team: what it looks for, or hunts.
    #[serde(default)]
    pub targets: usize,
    /// Steps of the longest episode: a time limit, which is no end of the world.
    pub episode_steps: usize,
    /// Length of a step, s.
    pub dt: f64,
    /// How agents' rewards become the team's.
    pub team_reward: TeamReward,
    /// Which of the paper's settings is the default in training.
    pub paper: PaperSetting,
    /// Whether the agents have places on the plane, so that links can depend on them.
    pub positions: bool,
}

/// An agent of a team.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AgentSpec {
    /// What it is called.
    pub name: String,
    /// The values at the start of its observation that differ between agents. If they are fewer than [`Spec::unique`],
    /// the rest is padding, which is zero.
    pub observation: Vec<Value>,
    /// What it can do.
    pub actions: ActionSpace,
}

/// What an agent can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ActionSpace {
    /// One of so many actions, counted from 0.
    Discrete(usize),
    /// As many values as there are bounds.
    Box {
        /// The least of each value.
        low: Vec<f32>,
        /// The most of each value.
        high: Vec<f32>,
    },
}

/// What one value of an observation is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Value {
    /// What it is measured in.
    pub unit: Unit,
    /// Whose state it is about, whoever observes it.
    pub about: About,
    /// The axis it lies along, if it does.
    pub axis: Option<Axis>,
    /// The dim of the same observation that holds its rate of change, and the sign with which it does: the
    /// place of something seen from an agent falls as the agent moves towards it.
    pub rate: Option<(usize, f32)>,
}

/// Whose state a value tells of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum About {
    /// An agent's: it changes as that agent moves.
    Agent(usize),
    /// That of a body with this number that is not of the team, and moves by itself.
    Target(usize),
    /// A landmark's, which stays as it is for an episode.
    Landmark,
    /// What somebody said.
    Message,
}

/// An axis of the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Left to right.
    X,
    /// Down to up.
    Y,
}

/// What a value is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unit {
    /// Places, m.
    #[serde(rename = "m")]
    Metre,
    /// Velocities, m/s.
    #[serde(rename = "m/s")]
    MetrePerSecond,
    /// Colours and words.
    #[serde(rename = "1")]
    One,
}

/// How agents' rewards become the team's, whose plain sum over an episode is the return.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TeamReward {
    /// The sum over agents.
    Sum,
    /// The sum over agents, times their number. In the reference environments every agent is paid the sum, and the
    /// trainer adds up the n copies: the unit of the paper's tables.
    SumForEach,
}

/// The settings of the paper's experiments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PaperSetting {
    /// Setting 1: feed-forward actors.
    One,
    /// Setting 2: recurrent actors.
    Two,
}

impl Spec {
    /// An environment of these agents, all of whose values are theirs: episodes of 25 steps of 0.1 s, whose return is
    /// the sum of what agents earn, without landmarks and places.
    pub fn of(id: &str, agents: Vec<AgentSpec>) -> Spec {
        Spec {
            id: id.to_owned(),
            unique: agents.iter().map(|agent| agent.observation.len()).max().unwrap_or(0),
            agents,
            common: Vec::new(),
            landmarks: 0,
            targets: 0,
            episode_steps: 25,
            dt: 0.1,
            team_reward: TeamReward::Sum,
            paper: PaperSetting::One,
            positions: false,
        }
    }

    /// The id.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// How many agents the team has.
    pub fn n_agents(&self) -> usize {
        self.agents.len()
    }

    /// How long `agent`'s own observation is, without padding.
    pub fn obs_dim(&self, agent: usize) -> usize {
        self.agents[agent].observation.len() + self.common.len()
    }

    /// How long every observation is once padded: as long as the longest in the team.
    pub fn padded_obs_dim(&self) -> usize {
        self.unique + self.common.len()
    }

    /// The dims at the start of a padded observation that differ between agents.
    pub fn unique_dim(&self) -> usize {
        self.unique
    }

    /// The dims behind them, the same for all agents.
    pub fn common_dim(&self) -> usize {
        self.common.len()
    }

    /// How long the joint observation is: all unique parts and the common part.
    pub fn joint_dim(&self) -> usize {
        self.predicted_dim() + self.common_dim()
    }

    /// How long the predicted part of the joint observation is: all unique parts.
    pub fn predicted_dim(&self) -> usize {
        self.n_agents() * self.unique
    }

    /// How many discrete actions `agent` has; 0 if it has a [`ActionSpace::Box`].
    pub fn available_actions(&self, agent: usize) -> usize {
        match self.agents[agent].actions {
            ActionSpace::Discrete(n) => n,
            ActionSpace::Box { .. } => 0,
        }
    }

    /// How many actions a policy for the whole team chooses from: the most that an agent has.
    pub fn n_actions(&self) -> usize {
        (0..self.n_agents()).map(|agent| self.available_actions(agent)).max().unwrap_or(0)
    }

    /// How many words an action takes, the same for all agents.
    pub fn action_width(&self) -> usize {
        self.agents.iter().map(|agent| agent.actions.width()).max().unwrap_or(1)
    }

    /// What a team earns whose agents earn `rewards`.
    pub fn team_reward(&self, rewards: &[f64]) -> f64 {
        let sum: f64 = rewards.iter().sum();
        match self.team_reward {
            TeamReward::Sum => sum,
            TeamReward::SumForEach => rewards.len() as f64 * sum,
        }
    }
}

impl ActionSpace {
    /// How many words an action takes: the number of a discrete one, the bits of each f32 otherwise.
    pub fn width(&self) -> usize {
        match self {
            ActionSpace::Discrete(_) => 1,
            ActionSpace::Box { low, .. } => low.len(),
        }
    }

    /// Writes an action drawn uniformly from the space.
    pub fn draw(&self, draws: &mut Draws, words: &mut [u32]) {
        match self {
            ActionSpace::Discrete(n) => words[0] = draws.below(*n) as u32,
            ActionSpace::Box { low, high } => {
                for (word, (low, high)) in words.iter_mut().zip(low.iter().zip(high)) {
                    *word = (draws.between((*low).into(), (*high).into()) as f32).to_bits();
                }
            }
        }
    }

    /// Whether these words are an action of this space.
    pub fn contains(&self, words: &[u32]) -> bool {
        match self {
            ActionSpace::Discrete(n) => words.first().is_some_and(|action| (*action as usize) < *n),
            ActionSpace::Box { low, high } => {
                let within = |((word, low), high): ((&u32, &f32), &f32)| {
                    (*low..=*high).contains(&f32::from_bits(*word))
                };
                words.len() >= low.len() && words.iter().zip(low).zip(high).all(within)
            }
        }
    }
}

impl Unit {
    /// All of them.
    pub(crate) const ALL: [Unit; 3] = [Unit::Metre, Unit::MetrePerSecond, Unit::One];

    /// Its symbol.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::Metre => "m",
            Unit::MetrePerSecond => "m/s",
            Unit::One => "1",
        }
    }
}

impl Axis {
    /// Both, in the order of coordinates.
    pub(crate) const BOTH: [Axis; 2] = [Axis::X, Axis::Y];
}

impl Value {
    /// A number without unit: a colour, or a part of a message.
    pub fn word(about: About) -> Value {
        Value { unit: Unit::One, about, axis: None, rate: None }
    }

    /// A velocity along an axis.
    pub fn velocity(about: About, axis: Axis) -> Value {
        Value { unit: Unit::MetrePerSecond, about, axis: Some(axis), rate: None }
    }

    /// A place along an axis, whose rate of change is not observed.
    pub fn place(about: About, axis: Axis) -> Value {
        Value { unit: Unit::Metre, about, axis: Some(axis), rate: None }
    }

    /// A place along an axis whose rate of change is dim `velocity`, times `sign`.
    pub fn moving(about: About, axis: Axis, velocity: usize, sign: f32) -> Value {
        Value { rate: Some((velocity, sign)), ..Value::place(about, axis) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_told_from_other_words() {
        let discrete = ActionSpace::Discrete(3);
        assert!(discrete.contains(&[2]) && !discrete.contains(&[3]) && !discrete.contains(&[]));
        let space = ActionSpace::Box { low: vec![0.0, -1.0], high: vec![1.0, 1.0] };
        let words = |values: [f32; 2]| values.map(f32::to_bits);
        assert!(space.contains(&words([1.0, -1.0])) && !space.contains(&words([0.5, 1.5])));
        assert!(!space.contains(&words([f32::NAN, 0.0])) && !space.contains(&[0]));
        assert_eq!((discrete.width(), space.width()), (1, 2));
    }
}
