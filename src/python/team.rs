//! `Team`: the actors of a policy file.

use std::sync::Mutex;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::buffers::take;
use super::elsewhere::{Observer, described};
use super::errors::raised;
use super::play::check_worlds;
use crate::agent::{PolicySource, most_probable, sample};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::cli::policy_source;
use crate::environment::{ActionSpace, Spec, Task};
use crate::nn::{self, ActorState, Policy, PolicyFile, Scratch};
use crate::usage;

/// The actors of a policy, with their state in each world.
#[pyclass(frozen, module = "vamaro_swarm._native")]
pub(super) struct Team(Mutex<Actors>);

struct Actors {
    spec: Spec,
    actors: Vec<Actor>,
    scratch: Scratch,
    greedy: bool,
    seed: u64,
    episode: u64,
    worlds: usize,
}

struct Actor {
    network: nn::Actor,
    state: ActorState,
    /// Steps of the episode that it has decided.
    step: u64,
    /// `[worlds, joint]` and `[worlds, n_actions]`.
    estimates: Vec<f32>,
    logits: Vec<f32>,
}

#[pymethods]
impl Team {
    /// That of a policy file, or `builtin` with its task.
    #[new]
    #[pyo3(signature = (name, task, greedy))]
    fn new(py: Python, name: &str, task: Option<&str>, greedy: bool) -> PyResult<Team> {
        let loaded = load(name, task).and_then(|(spec, policy)| Team::of(name, spec, &policy, greedy));
        loaded.map_err(|error| raised(py, error))
    }

    /// That of a policy file or a description of ONNX files, for an environment that lives in Python: its agents, with how many
    /// actions each has.
    #[staticmethod]
    fn elsewhere(
        py: Python,
        name: &str,
        environment: &str,
        agents: Vec<(Observer, usize)>,
        greedy: bool,
    ) -> PyResult<Team> {
        let loaded = || {
            let (observers, choices): (Vec<Observer>, Vec<usize>) = agents.into_iter().unzip();
            let mut spec = described(environment, &observers, None, None)?.spec;
            for (agent, choices) in spec.agents.iter_mut().zip(choices) {
                agent.actions = ActionSpace::Discrete(choices);
            }
            let policy = policy_source(name, 0)?.load(&spec)?;
            Team::of(name, spec, &policy, greedy)
        };
        loaded().map_err(|error| raised(py, error))
    }

    /// Its task.
    #[getter]
    fn task(&self) -> PyResult<String> {
        self.with(|actors| Ok(actors.spec.id.clone()))
    }

    /// What its agents are called.
    #[getter]
    fn agents(&self) -> PyResult<Vec<String>> {
        self.with(|actors| Ok(actors.spec.agents.iter().map(|agent| agent.name.clone()).collect()))
    }

    /// An episode begins in each of `worlds` worlds, the first of this number. Their actions are drawn by it, as `spawn`
    /// draws them.
    fn begin(&self, py: Python, seed: u64, episode: u64, worlds: usize) -> PyResult<()> {
        self.with(|actors| {
            check_worlds(&actors.spec, worlds).map_err(|error| raised(py, error))?;
            (actors.seed, actors.episode, actors.worlds) = (seed, episode, worlds);
            let (joint, choices) = (actors.spec.joint_dim(), actors.spec.n_actions());
            for actor in &mut actors.actors {
                actor.state.start(worlds);
                actor.step = 0;
                actor.estimates.resize(worlds * joint, 0.0);
                actor.logits.resize(worlds * choices, 0.0);
            }
            Ok(())
        })
    }

    /// What an agent does in each world, given its joint estimates, `f32 [worlds, joint]`.
    fn act(&self, py: Python, agent: usize, estimates: &Bound<PyAny>) -> PyResult<Vec<u32>> {
        self.with(|actors| {
            let known = actors.actors.get_mut(agent);
            let actor = known.ok_or_else(|| PyValueError::new_err(format!("there is no agent {agent}")))?;
            take(estimates, &mut actor.estimates)?;
            py.detach(|| actors.act(agent)).map_err(|error| raised(py, error))
        })
    }
}

impl Team {
    fn of(name: &str, spec: Spec, policy: &Policy, greedy: bool) -> Result<Team> {
        if policy.networks().actors_hear() {
            return Err(usage!(
                "{name}: its actors see more than joint estimates: what arrived, and how old it is. Nothing here tells them; \
                 play it with `vamaro-swarm spawn` or `evaluate`"
            ));
        }
        let actor = |agent| {
            let network = policy.actor(agent).clone();
            Actor { state: network.state(1), network, step: 0, estimates: Vec::new(), logits: Vec::new() }
        };
        let greedy = greedy || policy.is_greedy();
        let actors = (0..spec.n_agents()).map(actor).collect();
        let scratch = Scratch::default();
        Ok(Team(Mutex::new(Actors { spec, actors, scratch, greedy, seed: 0, episode: 0, worlds: 0 })))
    }

    /// One thread at a time acts.
    fn with<T>(&self, act: impl FnOnce(&mut Actors) -> PyResult<T>) -> PyResult<T> {
        let actors = self.0.try_lock();
        let mut actors = actors.map_err(|_| {
            PyValueError::new_err(
                "this policy is in use by another thread, or broken by a panic; load one for each thread",
            )
        })?;
        act(&mut actors)
    }
}

impl Actors {
    fn act(&mut self, agent: usize) -> Result<Vec<u32>> {
        let Actors { spec, actors, scratch, greedy, seed, episode, worlds } = self;
        let Actor { network, state, step, estimates, logits } = &mut actors[agent];
        network.step(*worlds, estimates, &[], state, scratch, logits)?;
        network.prepare(*worlds, state);
        let available = spec.available_actions(agent);
        let choose = |(logits, episode): (&[f32], u64)| {
            let logits = &logits[..available];
            let chosen = if *greedy {
                most_probable(logits)
            } else {
                sample(logits, Draws::new(*seed, Purpose::Action, episode, *step).at(agent, 0).uniform())
            };
            chosen as u32
        };
        let actions = logits.chunks_exact(spec.n_actions()).zip(*episode..).map(choose).collect();
        *step += 1;
        Ok(actions)
    }
}

/// The policy of this name, and what its task is.
fn load(name: &str, task: Option<&str>) -> Result<(Spec, Policy)> {
    let source = policy_source(name, 0)?;
    let task = match (&source, task) {
        (_, Some(task)) => Task::parse(task)?,
        (PolicySource::File(path), None) => Task::parse(&PolicyFile::read(path)?.meta.task)?,
        _ => return Err(usage!("{name}: for which task? Name it with task=")),
    };
    let policy = source.load(task.spec())?;
    if task.spec().n_actions() == 0 {
        return Err(usage!(
            "{name}: agents of {} act by values; only policies that choose actions can be loaded",
            task.id()
        ));
    }
    Ok((task.spec().clone(), policy))
}
