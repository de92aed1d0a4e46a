//! Which networks a policy is made of, and what each of them is made of.

use super::Dims;
use super::network::{Layer, Network, TensorSpec};
use super::proximity::Proximity;
use crate::base::rng::MAX_AGENTS;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The imputers of this library that are no predictors: none can be called like one.
pub(crate) const NAMED_OTHERWISE: [&str; 10] = [
    "dynamics",
    "given-dynamics",
    "given-teammates",
    "hold",
    "kalman",
    "particles",
    "shared-dice",
    "teammates",
    "velocity",
    "zero",
];

/// The networks of a policy: the actors of all agents and any number of predictors.
#[derive(Clone, Debug, PartialEq)]
pub struct Networks {
    /// The kind of actor.
    pub actor: ActorKind,
    /// One actor per agent, or one for all.
    pub sharing: Sharing,
    /// The hidden size of the actors.
    pub hidden: usize,
    /// What the actors see, in this order: the estimate, and perhaps what arrived and how old that is.
    pub actor_inputs: Vec<Input>,
    /// The predictors.
    pub predictors: Vec<PredictorSpec>,
}

/// What lies between the first and the last layer of an actor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ActorKind {
    /// A linear layer and a ReLU.
    Mlp,
    /// A GRU cell, whose state starts an episode at zero.
    Gru,
    /// Whatever ONNX files hold: these actors are no networks of ours. Nothing but such files says so, no setting of a
    /// training run in particular.
    #[serde(skip_deserializing)]
    Onnx,
}

/// Who runs which actor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sharing {
    /// Each agent has a network of its own.
    Separate,
    /// All agents run one network, which sees the agent's id as a one-hot behind the joint estimate.
    Shared,
}

impl fmt::Display for ActorKind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            ActorKind::Mlp => "mlp",
            ActorKind::Gru => "gru",
            ActorKind::Onnx => "onnx",
        })
    }
}

impl fmt::Display for Sharing {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Sharing::Separate => "separate",
            Sharing::Shared => "shared",
        })
    }
}

/// What a predictor is called, sees and says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictorSpec {
    /// Its name: lower-case letters, digits and dashes.
    pub name: String,
    /// What it sees, in this order.
    #[serde(with = "one_or_list")]
    pub inputs: Vec<Input>,
    /// How its raw log-std is to be read.
    pub sigma: Sigma,
    /// Dims that it never predicts: they keep their last known value.
    pub held: Vec<usize>,
    /// The hidden size of its layers.
    pub hidden: usize,
    /// Whether a linear map of what it sees is added to what it says.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub skip: bool,
}

/// A part of what a predictor sees, or an actor. They stand in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Input {
    /// The agent's estimate of the joint observation.
    Estimate,
    /// The same as an actor sees it from its own agent on: first the part of this agent, then, divided by the number of agents,
    /// of those after it and of those before it; the common part likewise, if its length is a multiple of their number.
    /// Where agents are alike only by twos or more, it begins with the agent's group; where none are alike, it is the estimate.
    Egocentric,
    /// Of each agent, whether something it observed arrived in the step: 1 or 0. Of itself an agent always hears.
    Delivered,
    /// Of each agent, how many steps ago it observed what arrived last, in units of 25; before anything arrived, how many
    /// steps there have been.
    Age,
    /// Of each predicted dim, the estimate less what the predictor expected it to be: zero where nothing arrived, and in the
    /// first step.
    Innovation,
    /// For each agent whose place is told and each of four reaches, along x and y: the sum, over the other agents within reach, of
    /// the direction away from them times `1 - distance / reach`. Bodies that touch push each other in this direction.
    Proximity,
    /// What the agent itself does in the step, and which agent it is: a one-hot over all actions of all agents, since
    /// agents share predictors.
    OwnAction,
}

/// From a predictor's raw log-std to its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sigma {
    /// `sigma = exp(raw)`.
    Exp,
    /// `sigma = exp(m + h tanh((raw - m) / h))` with m = -3 and h = 4: between `exp(-7)` and `exp(1)`, so that no likelihood
    /// is without bound, and near the middle as `exp`.
    SoftBounded,
}

impl Sigma {
    const MIDDLE: f32 = -3.0;
    const HALF: f32 = 4.0;

    /// The log-std, from what the network says.
    pub fn log_std(self, raw: f32) -> f32 {
        match self {
            Sigma::Exp => raw,
            Sigma::SoftBounded => Self::MIDDLE + Self::HALF * ((raw - Self::MIDDLE) / Self::HALF).tanh(),
        }
    }

    /// The derivative of the log-std by what the network says.
    pub(crate) fn slope(self, raw: f32) -> f32 {
        match self {
            Sigma::Exp => 1.0,
            Sigma::SoftBounded => 1.0 - ((raw - Self::MIDDLE) / Self::HALF).tanh().powi(2),
        }
    }
}

/// A list of inputs in JSON: one of them stands by itself, as it does in files that were written when there was only one.
mod one_or_list {
    use super::Input;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Deserialize)]
    #[serde(untagged, expecting = "expected `estimate` or a list of inputs")]
    enum Inputs {
        One(String),
        List(Vec<String>),
    }

    pub(super) fn serialize<S: Serializer>(inputs: &[Input], serializer: S) -> Result<S::Ok, S::Error> {
        match inputs {
            [one] => one.serialize(serializer),
            list => list.serialize(serializer),
        }
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Input>, D::Error> {
        let names = match Inputs::deserialize(deserializer)? {
            Inputs::One(name) => vec![name],
            Inputs::List(names) => names,
        };
        let input = |name: &String| Input::deserialize(serde::de::value::StrDeserializer::new(name));
        names.iter().map(input).collect()
    }
}

/// No hidden layer of a policy is larger than this.
pub(crate) const MAX_HIDDEN: usize = 1 << 14;

impl Networks {
    /// The networks of the paper: hidden size 256, one actor per agent, and one predictor of hidden size 128
    /// called `value-aware`.
    pub fn paper(actor: ActorKind) -> Networks {
        let predictors = vec![PredictorSpec::paper("value-aware")];
        let (sharing, actor_inputs) = (Sharing::Separate, vec![Input::Estimate]);
        Networks { actor, sharing, hidden: 256, actor_inputs, predictors }
    }

    /// Whether the actors do not just see estimates as they are.
    pub(crate) fn actors_have_senses(&self) -> bool {
        self.actor_inputs != [Input::Estimate]
    }

    /// Whether the actors see what arrived, or how old it is.
    pub(crate) fn actors_hear(&self) -> bool {
        self.actor_inputs.iter().any(|input| matches!(input, Input::Delivered | Input::Age))
    }

    /// Every tensor of a policy for `dims`: actors by agent, then predictors, each from input to output.
    pub fn tensors(&self, dims: &Dims) -> Vec<TensorSpec> {
        let actors = (0..self.n_actors(dims)).map(|agent| self.actor(agent, dims));
        let predictors = self.predictors.iter().map(|predictor| predictor.network(dims));
        actors.chain(predictors).flat_map(|network| network.tensors()).collect()
    }

    /// What the ONNX files that they need are called in a policy file.
    pub(super) fn graph_names(&self, dims: &Dims) -> Vec<String> {
        match (self.actor, self.sharing) {
            (ActorKind::Mlp | ActorKind::Gru, _) => Vec::new(),
            (ActorKind::Onnx, Sharing::Shared) => vec!["actors.shared.onnx".to_owned()],
            (ActorKind::Onnx, Sharing::Separate) => {
                (0..dims.n_agents).map(|agent| format!("actors.{agent}.onnx")).collect()
            }
        }
    }

    /// How many networks of ours act.
    fn n_actors(&self, dims: &Dims) -> usize {
        match (self.actor, self.sharing) {
            (ActorKind::Onnx, _) => 0,
            (ActorKind::Mlp | ActorKind::Gru, Sharing::Shared) => 1,
            (ActorKind::Mlp | ActorKind::Gru, Sharing::Separate) => dims.n_agents,
        }
    }

    /// The actor of this agent, from the joint estimate, what it hears if it sees that, and an id where all share it, to
    /// logits: `fc1 -> { fc2 | gru } -> out`.
    pub fn actor(&self, agent: usize, dims: &Dims) -> Network {
        let (hidden, ones) = (self.hidden, self.sharing.id_len(dims));
        let inputs = self.actor_inputs.iter().map(|input| input.width(dims)).sum();
        let (name, number) = match self.sharing {
            Sharing::Separate => (format!("actors.{agent}"), agent),
            Sharing::Shared => ("actors.shared".to_string(), 0),
        };
        let middle = match self.actor {
            ActorKind::Mlp => Layer::relu("fc2", hidden, hidden),
            ActorKind::Gru => Layer::Gru(hidden),
            ActorKind::Onnx => unreachable!("an ONNX file describes itself"),
        };
        let first = Layer::relu("fc1", inputs + ones, hidden);
        let layers = vec![first, middle, Layer::linear("out", hidden, dims.n_actions)];
        Network { name, number, inputs, ones, layers }
    }

    /// Says what is wrong with this description by itself.
    pub(crate) fn check(&self) -> Result<(), String> {
        let hidden = |what: &str, size: usize| match size {
            1..=MAX_HIDDEN => Ok(()),
            _ => Err(format!("the hidden size of {what} is {size}, expected 1 to {MAX_HIDDEN}")),
        };
        match self.actor {
            ActorKind::Mlp | ActorKind::Gru => {
                hidden("the actors", self.hidden)?;
                check_actor_inputs(&self.actor_inputs)?;
            }
            ActorKind::Onnx if self.actors_have_senses() => {
                return Err(
                    "actors of ONNX files see what their description says, and no `actor_inputs`".to_string()
                );
            }
            ActorKind::Onnx => {}
        }
        for (at, predictor) in self.predictors.iter().enumerate() {
            let name = &predictor.name;
            let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            if name.is_empty() || !name.chars().all(allowed) {
                return Err(format!(
                    "a predictor is called {name:?}, expected lower-case letters, digits and dashes"
                ));
            }
            if NAMED_OTHERWISE.contains(&&name[..]) {
                return Err(format!("a predictor is called {name:?}, which names another imputer"));
            }
            if self.predictors[..at].iter().any(|other| other.name == *name) {
                return Err(format!("two predictors are called {name:?}"));
            }
            check_inputs(&predictor.inputs).map_err(|error| format!("predictor {name:?} {error}"))?;
            hidden(&format!("predictor {name:?}"), predictor.hidden)?;
        }
        Ok(())
    }

    /// Says what of this description does not fit `dims`.
    pub(crate) fn check_fit(&self, dims: &Dims) -> Result<(), String> {
        for PredictorSpec { name, held, inputs, .. } in &self.predictors {
            if inputs.contains(&Input::Proximity) && Proximity::of(dims).is_none() {
                let task = &dims.task;
                return Err(format!(
                    "predictor {name:?} sees `proximity`, and {task} does not tell where two agents or more are; leave it out"
                ));
            }
            if let Some(dim) = held.iter().find(|&&dim| dim >= dims.predicted) {
                let predicted = dims.predicted;
                return Err(format!(
                    "predictor {name:?} holds dim {dim}, but only dims below {predicted} are predicted"
                ));
            }
        }
        Ok(())
    }
}

impl PredictorSpec {
    /// A predictor as in the paper: hidden size 128, sees the estimate, holds no dim.
    pub fn paper(name: &str) -> PredictorSpec {
        let (inputs, sigma) = (vec![Input::Estimate], Sigma::Exp);
        PredictorSpec { name: name.to_string(), inputs, sigma, held: Vec::new(), hidden: 128, skip: false }
    }

    /// Ours: as in the paper, but it also sees the own action and, where places are told, who is near whom. It has a skip, by
    /// which what follows linearly from what it sees need not pass through the LSTM.
    pub fn acting(name: &str, dims: &Dims) -> PredictorSpec {
        let proximity = Proximity::of(dims).map(|_| Input::Proximity);
        let inputs =
            [Some(Input::Estimate), proximity, Some(Input::OwnAction)].into_iter().flatten().collect();
        PredictorSpec { inputs, skip: true, ..PredictorSpec::paper(name) }
    }

    /// Whether the agent's own action is part of what it sees.
    pub fn sees_own_action(&self) -> bool {
        self.inputs.contains(&Input::OwnAction)
    }

    /// What it sees of who is near whom.
    pub(crate) fn proximity(&self, dims: &Dims) -> Option<Proximity> {
        self.inputs.contains(&Input::Proximity).then(|| Proximity::of(dims)).flatten()
    }

    /// Whether it sees more than estimates and actions.
    pub(super) fn has_senses(&self) -> bool {
        self.inputs.iter().any(|input| ![Input::Estimate, Input::OwnAction].contains(input))
    }

    /// Whether it sees what arrived, or what it expected itself: what does not follow from estimates and actions of the step.
    pub(crate) fn hears(&self) -> bool {
        self.inputs.iter().any(|input| matches!(input, Input::Delivered | Input::Age | Input::Innovation))
    }

    /// Its network, from the joint estimate, and what the agent does if it sees that, to mean and raw log-std of every
    /// predicted dim: `fc1 -> lstm -> out`, and a skip if it has one.
    pub fn network(&self, dims: &Dims) -> Network {
        let (hidden, outputs) = (self.hidden, 2 * dims.predicted);
        let inputs: usize = self.inputs.iter().map(|input| input.width(dims)).sum();
        let ones = if self.sees_own_action() { dims.n_agents * dims.n_actions } else { 0 };
        let first = Layer::relu("fc1", inputs + ones, hidden);
        let mut layers = vec![first, Layer::Lstm(hidden), Layer::linear("out", hidden, outputs)];
        layers.extend(self.skip.then_some(Layer::Skip { inputs: inputs + ones, outputs }));
        Network { name: format!("predictors.{}", self.name), number: MAX_AGENTS, inputs, ones, layers }
    }
}

impl Input {
    /// How many values it has. The own action is a one-hot behind all values, and has none.
    fn width(self, dims: &Dims) -> usize {
        match self {
            Input::Estimate | Input::Egocentric => dims.joint,
            Input::Delivered | Input::Age => dims.n_agents,
            Input::Innovation => dims.predicted,
            Input::Proximity => Proximity::of(dims).map_or(0, |proximity| proximity.width()),
            Input::OwnAction => 0,
        }
    }
}

/// Says what is wrong with what actors see.
fn check_actor_inputs(inputs: &[Input]) -> Result<(), String> {
    use Input::{Age, Delivered, Egocentric, Estimate};
    match inputs {
        [Estimate | Egocentric]
        | [Estimate | Egocentric, Delivered | Age]
        | [Estimate | Egocentric, Delivered, Age] => Ok(()),
        _ => Err("the actors see `estimate` or `egocentric` first, and may see `delivered` and `age` behind it, in this order; \
                  set `actor_inputs`"
            .to_string()),
    }
}

/// Says what is wrong with what a predictor sees.
fn check_inputs(inputs: &[Input]) -> Result<(), String> {
    match inputs {
        [Input::Estimate, rest @ ..]
            if inputs.is_sorted_by(|before, after| before < after) && !rest.contains(&Input::Egocentric) =>
        {
            Ok(())
        }
        _ => Err("sees `estimate` first, and may see `delivered`, `age`, `innovation`, `proximity` and `own-action` \
                  behind it, in this order, each once"
            .to_string()),
    }
}

/// The critic of an agent, or of all, from `inputs` values to one: `fc1 -> fc2 -> out`. No policy has one.
pub fn critic(sharing: Sharing, agent: usize, inputs: usize, hidden: usize) -> Network {
    let first = MAX_AGENTS + 1;
    let (name, number) = match sharing {
        Sharing::Separate => (format!("critics.{agent}"), first + agent),
        Sharing::Shared => ("critics.shared".to_string(), first),
    };
    let hidden_layers = [Layer::relu("fc1", inputs, hidden), Layer::relu("fc2", hidden, hidden)];
    let layers = hidden_layers.into_iter().chain([Layer::linear("out", hidden, 1)]).collect();
    Network { name, number, inputs, ones: 0, layers }
}

impl Sharing {
    /// The length of the id that a network sees behind its other inputs.
    pub(crate) fn id_len(self, dims: &Dims) -> usize {
        match self {
            Sharing::Separate => 0,
            Sharing::Shared => dims.n_agents,
        }
    }
}
