//! An environment that lives in Python.

use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec2;

use crate::base::error::Result;
use crate::environment::{
    About, ActionSpace, AgentSpec, Description, Environment, Outcome, Spec, State, Value,
};
use crate::{failed, usage};

/// What the agents of one world observe is told from outside; all else happens there.
pub(super) struct Elsewhere {
    spec: Spec,
    told: Told,
}

/// What an agent is called, and how much it observes.
pub(super) type Observer = (String, usize);

/// What is known of such an environment.
pub(super) struct Described {
    pub spec: Spec,
    /// Whether it says which values move at which rates.
    pub moves: bool,
    /// How long a step is, s, if it says that.
    pub tick: Option<f64>,
}

/// The description of such an environment. `values` are what each agent observes, as JSON, and `dt` is how long a step is,
/// s, if that is known.
///
/// # Errors
/// `Usage` if there are too many agents, that is no such JSON, or it tells of agents and values that are not there.
pub(super) fn described(
    name: &str,
    agents: &[Observer],
    values: Option<&str>,
    dt: Option<f64>,
) -> Result<Described> {
    let values = values.map(serde_json::from_str::<Vec<Vec<Value>>>).transpose();
    let values = values.map_err(|error| usage!("{name} describes its observations wrongly: {error}"))?;
    let agent = |(agent, (called, length)): (usize, &Observer)| AgentSpec {
        name: called.clone(),
        observation: match &values {
            Some(values) => values[agent].clone(),
            None => vec![Value::word(About::Message); *length],
        },
        // What agents do is known where they live, and nowhere else.
        actions: ActionSpace::Discrete(1),
    };
    let agents = agents.iter().enumerate().map(agent).collect();
    let description = Description { id: name.to_owned(), agents, episode_steps: u32::MAX as usize, dt };
    let spec = description.spec()?;
    Ok(Described { spec, moves: values.is_some(), tick: dt })
}

/// What agents observe now, `[agents, observation]`, zero-padded.
#[derive(Clone)]
pub(super) struct Told(Arc<Mutex<Vec<f32>>>);

impl Told {
    /// Tells it.
    pub(super) fn tell(&self, write: impl FnOnce(&mut [f32])) {
        write(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Elsewhere {
    /// The environment, and what it is told by.
    pub(super) fn new(spec: Spec) -> (Elsewhere, Told) {
        let told = Told(Arc::new(Mutex::new(vec![0.0; spec.n_agents() * spec.padded_obs_dim()])));
        (Elsewhere { spec, told: told.clone() }, told)
    }
}

impl Environment for Elsewhere {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn worlds(&self) -> usize {
        1
    }

    fn reset(&mut self, _world: usize, _seed: u64, _episode: u64) -> Result<()> {
        Ok(())
    }

    fn observe(&mut self, _worlds: usize, out: &mut [f32]) -> Result<()> {
        self.told.tell(|told| out.copy_from_slice(told));
        Ok(())
    }

    fn step(&mut self, _actions: &[u32], _playing: &[bool], _outcome: &mut Outcome) -> Result<()> {
        Ok(())
    }

    fn state(&self, _world: usize) -> State {
        State::default()
    }

    fn set_state(&mut self, _world: usize, _state: &State, _last_actions: Option<&[u32]>) -> Result<()> {
        Err(failed!("{} lives in Python: its state can be set only there", self.spec.id))
    }

    fn positions(&self, _world: usize) -> &[DVec2] {
        &[]
    }
}
