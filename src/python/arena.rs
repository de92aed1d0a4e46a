//! `Arena`: what a PettingZoo environment is made of.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use glam::DVec2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use super::buffers::{put, take};
use super::elsewhere::{Observer, described};
use super::errors::{of_agent, raised};
use super::play::{Hearing, Play};
use crate::agent::is_observable;
use crate::cli::policy_source;
use crate::environment::{ActionSpace, AgentSpec, State, Task};

/// Episodes whose actions come from Python: of one of our tasks, or of an environment that lives in Python.
///
/// Results are written into the caller's arrays: estimates `f32 [agents, worlds, joint]`, ages `i32 [agents, worlds,
/// agents]` and mask `u8 [agents, worlds, agents]`.
#[pyclass(frozen, module = "vamaro_swarm._native")]
pub(super) struct Arena(Mutex<Play>);

/// How many actions an agent has, or the bounds of its values.
type Choices = (usize, Vec<f32>, Vec<f32>);

/// Points or velocities in the plane.
type Pairs = Vec<[f64; 2]>;

#[pymethods]
impl Arena {
    /// Of `worlds` worlds of the task of this name.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "the package calls it, by name")]
    #[pyo3(signature = (task, *, links, imputer, policy, worlds, share_at_start, relay = false))]
    fn of_task(
        py: Python,
        task: &str,
        links: &str,
        imputer: Option<&str>,
        policy: Option<&str>,
        worlds: usize,
        share_at_start: bool,
        relay: bool,
    ) -> PyResult<Arena> {
        let play = || {
            let task = Task::parse(task)?;
            let policy = policy.map(|name| policy_source(name, 0)).transpose()?;
            Play::of_task(&task, policy.as_ref(), &Hearing { links, imputer, share_at_start, relay }, worlds)
        };
        play().map(|play| Arena(Mutex::new(play))).map_err(|error| raised(py, error))
    }

    /// Of an environment that lives in Python. `values` says what each agent observes, as JSON, and `dt` how long a step is,
    /// s. A `policy` file may hold a predictor that is the imputer.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "the package calls it, by name")]
    #[pyo3(signature = (name, agents, *, values, dt, links, imputer, policy, share_at_start, relay = false))]
    fn elsewhere(
        py: Python,
        name: &str,
        agents: Vec<Observer>,
        values: Option<&str>,
        dt: Option<f64>,
        links: &str,
        imputer: &str,
        policy: Option<PathBuf>,
        share_at_start: bool,
        relay: bool,
    ) -> PyResult<Arena> {
        let play = || {
            let hearing = Hearing { links, imputer: Some(imputer), share_at_start, relay };
            Play::elsewhere(described(name, &agents, values, dt)?, policy.as_deref(), &hearing)
        };
        play().map(|play| Arena(Mutex::new(play))).map_err(|error| raised(py, error))
    }

    /// The name of what is played.
    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.play()?.stage().spec().id.clone())
    }

    /// What the agents are called.
    #[getter]
    fn agents(&self) -> PyResult<Vec<String>> {
        Ok(self.play()?.stage().spec().agents.iter().map(|agent| agent.name.clone()).collect())
    }

    /// How long a joint estimate is.
    #[getter]
    fn joint(&self) -> PyResult<usize> {
        Ok(self.play()?.joint())
    }

    /// How much of a joint estimate is each agent's, and how much behind that is common to all.
    #[getter]
    fn parts(&self) -> PyResult<(Vec<usize>, usize)> {
        let play = self.play()?;
        let spec = play.stage().spec();
        Ok(match play.told() {
            None => (vec![spec.unique_dim(); spec.n_agents()], spec.common_dim()),
            Some(_) => ((0..spec.n_agents()).map(|agent| spec.obs_dim(agent)).collect(), 0),
        })
    }

    /// How many steps an episode of one of our tasks has.
    #[getter]
    fn episode_steps(&self) -> PyResult<usize> {
        Ok(self.play()?.stage().spec().episode_steps)
    }

    /// How long a step of one of our tasks is, s.
    #[getter]
    fn dt(&self) -> PyResult<f64> {
        Ok(self.play()?.stage().spec().dt)
    }

    /// What each agent can do: how many actions it has, or the bounds of its values.
    #[getter]
    fn actions(&self) -> PyResult<Vec<Choices>> {
        let play = self.play()?;
        let space = |agent: &AgentSpec| match &agent.actions {
            ActionSpace::Discrete(n) => (*n, Vec::new(), Vec::new()),
            ActionSpace::Box { low, high } => (0, low.clone(), high.clone()),
        };
        Ok(play.stage().spec().agents.iter().map(space).collect())
    }

    /// What a team earns whose agents earn these `rewards`.
    fn team_reward(&self, rewards: Vec<f64>) -> PyResult<f64> {
        Ok(self.play()?.stage().spec().team_reward(&rewards))
    }

    /// Tells what the agents of an environment that lives in Python observe, `f32 [agents, longest observation]`.
    fn tell(&self, py: Python, observations: &Bound<PyAny>) -> PyResult<()> {
        let play = self.play()?;
        let told = play.told().ok_or_else(|| {
            PyValueError::new_err("tell() is for environments in Python, not for our tasks")
        })?;
        let spec = play.stage().spec();
        let mut read = Ok(());
        told.tell(|told| {
            read = take(observations, told);
            let rows = told.chunks_exact(spec.padded_obs_dim());
            let wrong = rows.zip(&spec.agents).find(|(row, _)| !is_observable(row));
            if let (Ok(()), Some((row, agent))) = (&read, wrong) {
                let observed = &row[..agent.observation.len()];
                let words = format!("observes {observed:?}; values must be numbers from -1e9 to 1e9");
                read = Err(of_agent(py, &agent.name, &words));
            }
        });
        read
    }

    /// Begins the episodes from `episode` on, one in each world.
    fn begin(
        &self,
        py: Python,
        seed: u64,
        episode: u64,
        estimates: &Bound<PyAny>,
        ages: &Bound<PyAny>,
        mask: &Bound<PyAny>,
    ) -> PyResult<()> {
        let mut play = self.play()?;
        let playing = &mut *play;
        py.detach(|| playing.begin(seed, episode)).map_err(|error| raised(py, error))?;
        show(&play, estimates, ages, mask)
    }

    /// One step. `actions` are a list with one for each agent, of one world, or `u32 [agents, worlds, width]`; `rewards` are
    /// written, `f64 [worlds, agents]`. Whether the episodes go on.
    #[pyo3(signature = (actions, estimates, ages, mask, rewards = None))]
    fn step(
        &self,
        py: Python,
        actions: Option<&Bound<PyAny>>,
        estimates: &Bound<PyAny>,
        ages: &Bound<PyAny>,
        mask: &Bound<PyAny>,
        rewards: Option<&Bound<PyAny>>,
    ) -> PyResult<bool> {
        let mut play = self.play()?;
        match actions.map(|actions| (actions, actions.cast::<PyList>())) {
            Some((_, Ok(list))) => read_one_each(&mut play, list)?,
            Some((array, Err(_))) => {
                take(array, play.actions())?;
                check(py, &mut play)?;
            }
            None => {}
        }
        let playing = &mut *play;
        let goes_on = py.detach(|| playing.step()).map_err(|error| raised(py, error))?;
        show(&play, estimates, ages, mask)?;
        if let Some(rewards) = rewards {
            put(rewards, play.stage().all_rewards())?;
        }
        Ok(goes_on)
    }

    /// Takes these estimates in the place of those that were written last: the next step starts from them.
    fn believe(&self, estimates: &Bound<PyAny>) -> PyResult<()> {
        let mut read = Ok(());
        self.play()?.believe(|values| read = take(estimates, values));
        read
    }

    /// Where agents are, where landmarks and then targets are, how fast agents move, and the landmark that is the goal, in a
    /// world of one of our tasks.
    fn state(&self, world: usize) -> PyResult<(Pairs, Pairs, Pairs, Option<usize>)> {
        let play = self.play()?;
        if world >= play.worlds() {
            return Err(PyValueError::new_err(format!("there is no world {world}")));
        }
        let State { positions, velocities, landmarks, targets, goal } =
            play.stage().environment().state(world);
        let places = landmarks.into_iter().chain(targets.iter().map(|target| target.position)).collect();
        let pairs =
            |vectors: Vec<DVec2>| -> Pairs { vectors.into_iter().map(|vector| vector.to_array()).collect() };
        Ok((pairs(positions), pairs(places), pairs(velocities), goal))
    }
}

impl Arena {
    /// One thread at a time plays. Waiting for the other with Python's lock in hand, it would never end.
    fn play(&self) -> PyResult<MutexGuard<'_, Play>> {
        self.0.try_lock().map_err(|_| {
            PyValueError::new_err(
                "this environment is in use by another thread, or broken by a panic; make one for each thread",
            )
        })
    }
}

/// Writes what agents have.
fn show(play: &Play, estimates: &Bound<PyAny>, ages: &Bound<PyAny>, mask: &Bound<PyAny>) -> PyResult<()> {
    put(estimates, play.estimates())?;
    put(ages, play.ears().ages())?;
    put(mask, play.ears().mask())
}

/// Reads the action of each agent of one world: a whole number, or as many values as it takes.
fn read_one_each(play: &mut Play, actions: &Bound<PyList>) -> PyResult<()> {
    let spec = play.stage().spec();
    let width = spec.action_width();
    if play.worlds() != 1 || actions.len() != spec.n_agents() {
        return Err(PyValueError::new_err("one action for each agent is needed"));
    }
    let mut words = Vec::with_capacity(actions.len() * width);
    for (action, agent) in actions.iter().zip(&spec.agents) {
        match &agent.actions {
            // What does not fit is no action; the check says so.
            ActionSpace::Discrete(_) => words.push(action.extract::<u32>().unwrap_or(u32::MAX)),
            ActionSpace::Box { .. } => {
                let values: Vec<f32> = action.extract().unwrap_or_default();
                words.extend((0..width).map(|at| values.get(at).map_or(f32::NAN, |value| *value).to_bits()));
                if values.len() > width {
                    words.iter_mut().rev().take(width).for_each(|word| *word = f32::NAN.to_bits());
                }
            }
        }
        let row = &words[words.len() - width..];
        if !agent.actions.contains(row) {
            return Err(no_action(agent, &action));
        }
    }
    play.actions().copy_from_slice(&words);
    Ok(())
}

/// An error if an agent has no such action.
fn check(py: Python, play: &mut Play) -> PyResult<()> {
    let spec = play.stage().spec().clone();
    let each = play.worlds() * spec.action_width();
    for (actions, agent) in play.actions().chunks_exact(each).zip(&spec.agents) {
        for action in actions.chunks_exact(spec.action_width()) {
            if !agent.actions.contains(action) {
                return Err(no_action(agent, action.into_pyobject(py)?.as_any()));
            }
        }
    }
    Ok(())
}

fn no_action(agent: &AgentSpec, action: &Bound<PyAny>) -> PyErr {
    let space = match &agent.actions {
        ActionSpace::Discrete(n) => format!("a whole number from 0 to {}", n - 1),
        ActionSpace::Box { low, high } => format!("{} values from {low:?} to {high:?}", low.len()),
    };
    let shown = action.repr().map_or_else(|_| "this".to_owned(), |text| text.to_string());
    of_agent(action.py(), &agent.name, &format!("its action {shown} is not {space}"))
}
