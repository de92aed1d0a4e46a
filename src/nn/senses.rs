//! What networks see of estimates, and beside them: of whom something arrived, and how old that is.

use super::Dims;
use super::egocentric::Egocentric;
use super::networks::Input;

/// What was heard of each agent, in each of several episodes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Hearing {
    agents: usize,
    /// `[rows, agents]`.
    heard: Vec<Heard>,
}

/// What was heard of an agent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Heard {
    /// Whether something arrived in this step.
    now: bool,
    /// How many steps ago what arrived last was made; before anything has, how many there have been.
    age: u32,
}

/// An age of so many steps is seen as 1: the episodes of the paper's tasks are as long.
const AGE_UNIT: f32 = 25.0;

impl Hearing {
    /// Of so many agents, in no episode yet.
    pub fn of(agents: usize) -> Hearing {
        Hearing { agents, heard: Vec::new() }
    }

    /// Forgets everything: `rows` episodes start. Allocates only for more rows than ever before.
    pub fn start(&mut self, rows: usize) {
        self.heard.clear();
        self.heard.resize(rows * self.agents, Heard::default());
    }

    /// What arrives in this step, in a row, of what an agent observed: how many steps ago, if anything does.
    pub fn hear(&mut self, row: usize, agent: usize, age: Option<u8>) {
        let heard = &mut self.heard[row * self.agents + agent];
        *heard = Heard { now: age.is_some(), age: age.map_or(heard.age + 1, u32::from) };
    }

    /// Appends what an input shows of what was heard in a row; of other inputs nothing.
    pub fn show(&self, row: usize, input: Input, seen: &mut Vec<f32>) {
        let heard = self.heard[row * self.agents..][..self.agents].iter();
        match input {
            Input::Delivered => seen.extend(heard.map(|heard| f32::from(u8::from(heard.now)))),
            Input::Age => seen.extend(heard.map(|heard| heard.age as f32 / AGE_UNIT)),
            Input::Estimate | Input::Egocentric | Input::Innovation | Input::Proximity | Input::OwnAction => {
            }
        }
    }

    /// Has heard in the row `to` what it has in the row `from`.
    pub fn copy_row(&mut self, from: usize, to: usize) {
        self.heard.copy_within(from * self.agents..(from + 1) * self.agents, to * self.agents);
    }

    /// Becomes what `other` is. Allocates only for more rows than ever before.
    pub fn copy_from(&mut self, other: &Hearing) {
        self.agents = other.agents;
        self.heard.clone_from(&other.heard);
    }
}

/// What an actor sees if that is not just the estimate, and what it has heard in each of several episodes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Senses {
    /// What it sees, in this order.
    inputs: Vec<Input>,
    /// Whose it is, unless each row says that.
    agent: Option<usize>,
    /// If it sees that.
    egocentric: Option<Egocentric>,
    hearing: Hearing,
    /// What all rows saw last, `[rows, inputs]`.
    seen: Vec<f32>,
}

impl Senses {
    /// Those of the actor of an agent with these `inputs`; `None` if it sees estimates as they are, and nothing else.
    pub fn of(inputs: &[Input], agent: usize, dims: &Dims) -> Option<Senses> {
        (inputs != [Input::Estimate]).then(|| Senses {
            inputs: inputs.to_vec(),
            agent: Some(agent),
            egocentric: inputs.contains(&Input::Egocentric).then(|| Egocentric::of(dims)),
            hearing: Hearing::of(dims.n_agents),
            seen: Vec::new(),
        })
    }

    /// The same where each row says whose it is.
    pub fn by_row(&self) -> Senses {
        Senses { agent: None, ..self.clone() }
    }

    /// How many values they have in a row, beside the estimate.
    pub fn width(&self) -> usize {
        (self.inputs.len() - 1) * self.hearing.agents
    }

    /// Forgets everything: `rows` episodes start. Allocates only for more rows than ever before.
    pub fn start(&mut self, rows: usize) {
        self.hearing.start(rows);
    }

    /// What arrives in this step, in a row, of what an agent observed: how many steps ago, if anything does. Of itself an
    /// agent hears in every step.
    pub fn hear(&mut self, row: usize, agent: usize, age: Option<u8>) {
        self.hearing.hear(row, agent, age);
    }

    /// Appends what `agent` sees in a row: the estimate, and behind it what was heard.
    pub fn show(&self, row: usize, agent: usize, estimate: &[f32], seen: &mut Vec<f32>) {
        for input in &self.inputs {
            match input {
                Input::Estimate => seen.extend_from_slice(estimate),
                Input::Egocentric => {
                    let egocentric = self.egocentric.as_ref().expect("it is there for this input");
                    egocentric.show(agent, estimate, seen);
                }
                _ => self.hearing.show(row, *input, seen),
            }
        }
    }

    /// What is seen in all of so many rows with these estimates, `[rows, joint]`. Where each row says whose it is, `ids`
    /// `[rows]` has that.
    pub fn see(&mut self, rows: usize, estimates: &[f32], ids: &[usize]) -> &[f32] {
        let mut seen = std::mem::take(&mut self.seen);
        seen.clear();
        let joint = estimates.len().checked_div(rows).unwrap_or(0);
        for row in 0..rows {
            let agent = self.agent.unwrap_or_else(|| ids[row]);
            self.show(row, agent, &estimates[row * joint..][..joint], &mut seen);
        }
        self.seen = seen;
        &self.seen
    }

    /// Has heard in the row `to` what it has in the row `from`.
    pub fn copy_row(&mut self, from: usize, to: usize) {
        self.hearing.copy_row(from, to);
    }
}
