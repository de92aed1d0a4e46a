//! Which networks a policy is made of, and the tensors that follow from it.

use super::Dims;
use crate::base::rng::{Draws, MAX_AGENTS, Purpose};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The imputers of this library that need no network: no predictor can be called like one.
pub(crate) const NAMED_OTHERWISE: [&str; 3] = ["hold", "velocity", "zero"];

/// The networks of a policy: the actors of all agents and any number of predictors.
#[derive(Clone, Debug, PartialEq)]
pub struct Networks {
    /// The kind of actor.
    pub actor: ActorKind,
    /// One actor per agent, or one for all.
    pub sharing: Sharing,
    /// The hidden size of the actors.
    pub hidden: usize,
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
}

/// A part of what a predictor sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Input {
    /// The agent's estimate of the joint observation.
    Estimate,
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

/// A tensor that a policy must have.
#[derive(Clone, Debug, PartialEq)]
pub struct TensorSpec {
    /// Its name, such as `actors.0.fc1.weight`.
    pub name: String,
    /// Its shape; a weight is `[inputs, outputs]`, a bias `[outputs]`.
    pub shape: Vec<usize>,
    /// Untrained values are uniform between minus and plus this (PyTorch's defaults).
    pub bound: f64,
    /// The address of its untrained values. It counts inside a network: adding an agent or a predictor
    /// changes no other network's weights, and all predictors start from the same ones, so that what they
    /// come to is compared like with like.
    pub number: u64,
}

/// No hidden layer of a policy is larger than this.
const MAX_HIDDEN: usize = 1 << 14;

impl Networks {
    /// The networks of the paper: hidden size 256, one actor per agent, and one predictor of hidden size 128
    /// called `value-aware`.
    pub fn paper(actor: ActorKind) -> Networks {
        let predictors = vec![PredictorSpec::paper("value-aware")];
        Networks { actor, sharing: Sharing::Separate, hidden: 256, predictors }
    }

    /// Every tensor of a policy for `dims`: actors by agent, then predictors, each from input to output.
    pub fn tensors(&self, dims: &Dims) -> Vec<TensorSpec> {
        let copies = match self.sharing {
            Sharing::Separate => dims.n_agents,
            Sharing::Shared => 1,
        };
        let actors = (0..copies).flat_map(|agent| self.actor_tensors(agent, dims));
        actors.chain(self.predictors.iter().flat_map(|predictor| predictor.tensors(dims))).collect()
    }

    /// The tensors of this agent's actor: `fc1`, then `fc2` or `gru`, then `out`, each weight before its bias.
    pub fn actor_tensors(&self, agent: usize, dims: &Dims) -> Vec<TensorSpec> {
        let mut list = match self.sharing {
            Sharing::Separate => List::of(self.actor_prefix(agent), agent),
            Sharing::Shared => List::of(self.actor_prefix(agent), 0),
        };
        list.linear("fc1", dims.joint + self.sharing.id_len(dims), self.hidden);
        match self.actor {
            ActorKind::Mlp => list.linear("fc2", self.hidden, self.hidden),
            ActorKind::Gru => list.cell("gru", 3, self.hidden),
        }
        list.linear("out", self.hidden, dims.n_actions);
        list.tensors
    }

    /// The first part of the tensor names of this agent's actor.
    pub(super) fn actor_prefix(&self, agent: usize) -> String {
        match self.sharing {
            Sharing::Separate => format!("actors.{agent}"),
            Sharing::Shared => "actors.shared".to_string(),
        }
    }

    /// Says what is wrong with this description by itself.
    pub(crate) fn check(&self) -> Result<(), String> {
        let hidden = |what: &str, size: usize| match size {
            1..=MAX_HIDDEN => Ok(()),
            _ => Err(format!("the hidden size of {what} is {size}, expected 1 to {MAX_HIDDEN}")),
        };
        hidden("the actors", self.hidden)?;
        for (at, predictor) in self.predictors.iter().enumerate() {
            let name = &predictor.name;
            let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            if name.is_empty() || !name.chars().all(allowed) {
                return Err(format!(
                    "a predictor is called {name:?}, expected lower-case letters, digits and dashes"
                ));
            }
            if NAMED_OTHERWISE.contains(&&name[..]) {
                return Err(format!(
                    "a predictor is called {name:?}, which names an imputer without a network"
                ));
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
    pub(super) fn check_fit(&self, dims: &Dims) -> Result<(), String> {
        for PredictorSpec { name, held, .. } in &self.predictors {
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
        PredictorSpec { name: name.to_string(), inputs, sigma, held: Vec::new(), hidden: 128 }
    }

    /// Whether the agent's own action is part of what it sees.
    pub fn sees_own_action(&self) -> bool {
        self.inputs.contains(&Input::OwnAction)
    }

    /// The number of values that it sees.
    pub fn width(&self, dims: &Dims) -> usize {
        dims.joint + if self.sees_own_action() { dims.n_agents * dims.n_actions } else { 0 }
    }

    /// Its tensors: those of `fc1`, `lstm` and `out`, each weight before its bias.
    pub fn tensors(&self, dims: &Dims) -> Vec<TensorSpec> {
        let mut list = List::of(self.prefix(), MAX_AGENTS);
        list.linear("fc1", self.width(dims), self.hidden);
        list.cell("lstm", 4, self.hidden);
        list.linear("out", self.hidden, 2 * dims.predicted);
        list.tensors
    }

    /// The first part of the names of its tensors.
    pub(super) fn prefix(&self) -> String {
        format!("predictors.{}", self.name)
    }
}

/// Says what is wrong with what a predictor sees.
fn check_inputs(inputs: &[Input]) -> Result<(), String> {
    match inputs {
        [Input::Estimate] | [Input::Estimate, Input::OwnAction] => Ok(()),
        _ => Err("sees `estimate` first, and may see `own-action` behind it, each once".to_string()),
    }
}

/// The tensors of the critic of an agent, or of all, which sees `inputs` values and has two layers of
/// `hidden`: `fc1`, `fc2` and `out`, each weight before its bias. No policy has them.
pub fn critic_tensors(sharing: Sharing, agent: usize, inputs: usize, hidden: usize) -> Vec<TensorSpec> {
    let first = MAX_AGENTS + 1;
    let mut list = match sharing {
        Sharing::Separate => List::of(format!("critics.{agent}"), first + agent),
        Sharing::Shared => List::of("critics.shared".to_string(), first),
    };
    list.linear("fc1", inputs, hidden);
    list.linear("fc2", hidden, hidden);
    list.linear("out", hidden, 1);
    list.tensors
}

impl Sharing {
    /// The length of the id that a network sees behind its other inputs.
    pub fn id_len(self, dims: &Dims) -> usize {
        match self {
            Sharing::Separate => 0,
            Sharing::Shared => dims.n_agents,
        }
    }
}

impl TensorSpec {
    /// Its untrained values, drawn at the address (`seed`, [`Purpose::Weights`], [number](Self::number)).
    pub fn untrained(&self, seed: u64) -> impl Iterator<Item = f32> {
        let mut draws = Draws::new(seed, Purpose::Weights, self.number, 0);
        (0..self.n_values()).map(move |_| draws.between(-self.bound, self.bound) as f32)
    }

    /// The number of values.
    pub fn n_values(&self) -> usize {
        self.shape.iter().product()
    }
}

/// The tensors of a network so far, and what the next ones are called and numbered.
struct List {
    tensors: Vec<TensorSpec>,
    prefix: String,
    number: u64,
}

impl List {
    fn of(prefix: String, network: usize) -> List {
        const TENSORS_PER_NETWORK: u64 = 16;
        List { tensors: Vec::new(), prefix, number: network as u64 * TENSORS_PER_NETWORK }
    }

    fn linear(&mut self, layer: &str, inputs: usize, outputs: usize) {
        self.push(layer, "weight", vec![inputs, outputs], inputs);
        self.push(layer, "bias", vec![outputs], inputs);
    }

    /// A recurrent cell whose input is as wide as its hidden state, as all of them are here.
    fn cell(&mut self, layer: &str, gates: usize, hidden: usize) {
        self.push(layer, "weight_ih", vec![hidden, gates * hidden], hidden);
        self.push(layer, "weight_hh", vec![hidden, gates * hidden], hidden);
        self.push(layer, "bias_ih", vec![gates * hidden], hidden);
        self.push(layer, "bias_hh", vec![gates * hidden], hidden);
    }

    /// `fan_in` is what PyTorch's initialisation takes the inverse square root of.
    fn push(&mut self, layer: &str, tensor: &str, shape: Vec<usize>, fan_in: usize) {
        let name = format!("{}.{layer}.{tensor}", self.prefix);
        let bound = 1.0 / (fan_in as f64).sqrt();
        self.tensors.push(TensorSpec { name, shape, bound, number: self.number });
        self.number += 1;
    }
}
