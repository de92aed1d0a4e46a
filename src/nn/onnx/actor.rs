//! The actor of one agent, run by an ONNX graph.

use std::ops::Range;
use std::sync::Arc;

use super::spec::{OnnxSpec, Said};
use super::{Graph, Port};
use crate::base::error::Result;
use crate::environment::ActionSpace;
use crate::nn::Dims;
use crate::{failed, usage};

/// The actor of one agent, run by an ONNX graph.
#[derive(Clone, Debug)]
pub(in crate::nn) struct OnnxActor {
    graph: Arc<Graph>,
    agent: usize,
    /// How long a joint estimate is.
    joint: usize,
    /// Which values of it the graph sees.
    view: Vec<Range<usize>>,
    /// Mean and std of each of them, if they are normalised.
    normal: Option<(Vec<f32>, Vec<f32>)>,
    /// The length of the one-hot behind them.
    id: usize,
    /// What each input is given.
    roles: Vec<Role>,
    /// For each state, the output that it is taken from, and its length.
    states: Vec<(usize, usize)>,
    /// The outputs that say what to do, and how many values they have.
    said: (Vec<usize>, usize),
}

/// What an input of a graph is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    /// What the agent sees.
    Seen,
    /// A state, by number.
    State(usize),
    /// Whether an episode begins.
    Begins,
}

/// What an actor remembers of an episode, and what it is about to see.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::nn) struct OnnxState {
    /// Of each input `[rows, values]`.
    inputs: Vec<Vec<f32>>,
    /// How many values of each input a row has, and whether they are a state.
    widths: Vec<(usize, bool)>,
    /// Where the flags are that say that an episode begins.
    begins: Option<usize>,
}

/// What TorchRL calls the flag that says that an episode begins.
const BEGINS: &str = "is_init";

impl OnnxActor {
    /// Of this agent, by this graph.
    ///
    /// # Errors
    /// `Usage` if the graph does not see or say what `spec` and `dims` ask for.
    pub fn new(graph: Arc<Graph>, spec: &OnnxSpec, agent: usize, dims: &Dims) -> Result<OnnxActor> {
        let (inputs, outputs) = (graph.runtime.inputs(), graph.runtime.outputs());
        let output = |name: &str| outputs.iter().position(|port| port.name == name);
        let (mut roles, mut states, mut width) = (Vec::new(), Vec::new(), None);
        for port in inputs {
            let next = spec.states.get(&port.name).cloned().unwrap_or_else(|| format!("next_{}", port.name));
            let values = port.values().ok_or_else(|| usage!("its input `{}` is too large", port.name))?;
            roles.push(match output(&next) {
                Some(at) => {
                    states.push((at, values));
                    Role::State(states.len() - 1)
                }
                None if port.name == BEGINS => Role::Begins,
                None if width.is_none() => {
                    width = Some(values);
                    Role::Seen
                }
                None => {
                    return Err(usage!(
                        "what is its input `{}`? One that carries a state has an output `{next}`, or the description names \
                         another under `states`",
                        port.name
                    ));
                }
            });
        }
        let width = width.ok_or_else(|| usage!("it has no input that sees anything"))?;
        let view = spec.view(agent, dims, width)?;
        let carries = |at: &usize| states.iter().any(|(output, _)| output == at);
        let free: Vec<usize> = (0..outputs.len()).filter(|at| !carries(at)).collect();
        let said = said(spec.output, &free, outputs)?;
        let actor = OnnxActor {
            agent,
            joint: dims.joint,
            view,
            normal: spec.normalise.as_ref().map(|normal| (normal.mean.clone(), normal.std.clone())),
            id: if spec.agent_id { dims.n_agents } else { 0 },
            roles,
            states,
            said: (said, 0),
            graph,
        };
        actor.tried(spec.output, dims)
    }

    /// This actor, once its graph has shown in a step how much it says.
    fn tried(mut self, said: Said, dims: &Dims) -> Result<OnnxActor> {
        let mut state = self.state(1);
        self.look(1, &vec![0.0; self.joint], &mut state);
        let mut lengths = Vec::new();
        let take = |_: usize, outputs: &[Vec<f32>]| {
            lengths = outputs.iter().map(Vec::len).collect();
            let finite = outputs.iter().flatten().all(|value| value.is_finite());
            if finite { Ok(()) } else { Err("of zeros it makes what is not finite".to_owned()) }
        };
        self.graph
            .runtime
            .run(1, &state.inputs, take)
            .map_err(|error| usage!("it cannot be run: {error}"))?;
        for (name, at, length) in
            self.roles.iter().zip(self.graph.runtime.inputs()).filter_map(|(role, port)| match role {
                Role::State(state) => Some((&port.name, self.states[*state].0, self.states[*state].1)),
                _ => None,
            })
        {
            if lengths[at] != length {
                return Err(usage!(
                    "its state `{name}` has {length} values, but {} after a step",
                    lengths[at]
                ));
            }
        }
        self.said.1 = self.said.0.iter().map(|at| lengths[*at]).sum();
        let actions = dims.agents.get(self.agent).map(|agent| &agent.actions);
        let (expected, what) = match (said, actions) {
            (Said::Logits, Some(ActionSpace::Discrete(own))) if self.said.1 == *own => (*own, "logits"),
            (Said::Logits, Some(ActionSpace::Box { low, .. })) => {
                return Err(usage!(
                    "agent {} of {} acts by {} values, and not by logits; say `output = \"mean-log-std\"`",
                    self.agent,
                    dims.task,
                    low.len()
                ));
            }
            (Said::Logits, _) => (dims.n_actions, "logits"),
            (Said::MeanLogStd, Some(ActionSpace::Box { low, .. })) => (2 * low.len(), "means and log-stds"),
            (Said::MeanLogStd, _) => {
                return Err(usage!(
                    "agent {} of {} chooses among discrete actions; say `output = \"logits\"`",
                    self.agent,
                    dims.task
                ));
            }
        };
        if self.said.1 != expected {
            return Err(usage!("it says {} values, expected {expected} {what}", self.said.1));
        }
        Ok(self)
    }

    /// The state in which `rows` episodes start.
    pub fn state(&self, rows: usize) -> OnnxState {
        let widths = self.roles.iter().map(|role| match role {
            Role::Seen => (self.view.iter().map(Range::len).sum::<usize>() + self.id, false),
            Role::State(state) => (self.states[*state].1, true),
            Role::Begins => (self.begins_width(), false),
        });
        let widths: Vec<_> = widths.collect();
        let begins = self.roles.iter().position(|role| *role == Role::Begins);
        let mut state = OnnxState { inputs: vec![Vec::new(); widths.len()], widths, begins };
        state.start(rows);
        state
    }

    /// One step of `rows` episodes, from the joint estimates `[rows, joint]` to `out`, `[rows, choices]`. Choices that the
    /// graph does not know of get none of the probability.
    ///
    /// # Errors
    /// `Failed` if the graph cannot be run, or says something that is not finite.
    pub fn step(&self, rows: usize, estimates: &[f32], state: &mut OnnxState, out: &mut [f32]) -> Result<()> {
        self.look(rows, estimates, state);
        let choices = out.len() / rows;
        let mut next: Vec<Vec<f32>> =
            self.states.iter().map(|(_, length)| Vec::with_capacity(rows * length)).collect();
        let take = |row: usize, outputs: &[Vec<f32>]| {
            let out = &mut out[row * choices..(row + 1) * choices];
            let (known, unknown) = out.split_at_mut(self.said.1);
            let length: usize = self.said.0.iter().map(|at| outputs[*at].len()).sum();
            if length != self.said.1 {
                return Err(format!("it says {length} values, not {}", self.said.1));
            }
            let said = self.said.0.iter().flat_map(|at| &outputs[*at]);
            known.iter_mut().zip(said).for_each(|(out, said)| *out = *said);
            unknown.fill(f32::MIN);
            if let Some(at) = known.iter().position(|value| !value.is_finite()) {
                return Err(format!("it says {} at {at}", known[at]));
            }
            for ((output, length), next) in self.states.iter().zip(&mut next) {
                let values = &outputs[*output];
                match values.iter().find(|value| !value.is_finite()) {
                    _ if values.len() != *length => {
                        return Err(format!("a state has {} values, not {length}", values.len()));
                    }
                    Some(value) => return Err(format!("a value of its state is {value}")),
                    None => next.extend(values),
                }
            }
            Ok(())
        };
        let ran = self.graph.runtime.run(rows, &state.inputs, take);
        ran.map_err(|error| failed!("the ONNX actor of agent-{}: {error}", self.agent))?;
        for (input, role) in state.inputs.iter_mut().zip(&self.roles) {
            match role {
                Role::Seen => {}
                Role::State(state) => std::mem::swap(input, &mut next[*state]),
                Role::Begins => input.fill(0.0),
            }
        }
        Ok(())
    }

    /// How long a joint estimate is.
    pub fn n_inputs(&self) -> usize {
        self.joint
    }

    /// Puts before the graph what it sees.
    fn look(&self, rows: usize, estimates: &[f32], state: &mut OnnxState) {
        let at = self.roles.iter().position(|role| *role == Role::Seen).expect("a graph sees something");
        let seen = &mut state.inputs[at];
        seen.clear();
        for estimate in estimates.chunks_exact(self.joint).take(rows) {
            let start = seen.len();
            self.view.iter().for_each(|range| seen.extend_from_slice(&estimate[range.clone()]));
            if let Some((means, stds)) = &self.normal {
                let values = seen[start..].iter_mut().zip(means.iter().zip(stds));
                values.for_each(|(value, (mean, std))| *value = (*value - mean) / std);
            }
            seen.extend((0..self.id).map(|agent| f32::from(u8::from(agent == self.agent))));
        }
    }

    fn begins_width(&self) -> usize {
        let port = self.graph.runtime.inputs().iter().find(|port| port.name == BEGINS);
        port.and_then(Port::values).unwrap_or(1)
    }
}

impl OnnxState {
    /// Forgets everything: `rows` episodes start.
    pub fn start(&mut self, rows: usize) {
        for (values, (width, _)) in self.inputs.iter_mut().zip(&self.widths) {
            values.clear();
            values.resize(rows * width, 0.0);
        }
        if let Some(begins) = self.begins {
            self.inputs[begins].fill(1.0);
        }
    }

    /// Remembers in the row `to` what it does in the row `from`.
    pub fn copy_row(&mut self, from: usize, to: usize) {
        for (values, (width, _)) in
            self.inputs.iter_mut().zip(&self.widths).filter(|(_, (_, is_state))| *is_state)
        {
            values.copy_within(from * width..(from + 1) * width, to * width);
        }
    }
}

impl Port {
    /// How many values it has, if that is a number that can be.
    fn values(&self) -> Option<usize> {
        const MOST: usize = 1 << 20;
        let values = self.shape.iter().try_fold(1usize, |values, size| values.checked_mul(*size));
        values.filter(|values| *values <= MOST)
    }
}

/// The outputs that say what to do: of those that carry no state the one called `logits`, or the first; or both, if they are two
/// that say means and log-stds.
fn said(said: Said, free: &[usize], outputs: &[Port]) -> Result<Vec<usize>> {
    let Some(first) = free.first() else {
        return Err(usage!("it has no output that says what to do"));
    };
    Ok(match (said, free) {
        (Said::MeanLogStd, [mean, log_std]) => vec![*mean, *log_std],
        _ => vec![*free.iter().find(|at| outputs[**at].name == "logits").unwrap_or(first)],
    })
}
