//! `Imputer`: what one agent of a swarm imputes by whose process is in Python.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::buffers::{put, take};
use super::elsewhere::{Observer, described};
use super::errors::raised;
use super::lessons::FITTED;
use super::play::check_worlds;
use crate::agent::imputer::{Setup, Step};
use crate::agent::{self, Inbox, JointLayout, PolicySource, Received, Registry};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::nn::Policy;
use crate::usage;

/// The predictor of a file that `fit_imputer` wrote, at the work of one agent.
#[pyclass(frozen, module = "vamaro_swarm._native")]
pub(super) struct Imputer(Mutex<Imputing>);

struct Imputing {
    imputer: Box<dyn agent::Imputer>,
    agent: usize,
    layout: JointLayout,
    /// The most worlds, and how many play.
    room: usize,
    worlds: usize,
    /// `[worlds, agents]`.
    ages: Vec<u8>,
    /// `[worlds, agents, observation]`; all of it is the agents' own.
    observations: Vec<f32>,
    /// `[worlds, joint]`.
    estimates: Vec<f32>,
    /// What the agent does, which this predictor does not look at, `[worlds]`.
    nothing: Vec<u32>,
}

#[pymethods]
impl Imputer {
    /// That of agent `agent` among these, in at most `worlds` worlds, where nothing that arrives is older than `oldest`
    /// ticks.
    #[new]
    #[pyo3(signature = (path, name, agents, *, agent, worlds, oldest))]
    fn new(
        py: Python,
        path: PathBuf,
        name: &str,
        agents: Vec<Observer>,
        agent: usize,
        worlds: usize,
        oldest: u8,
    ) -> PyResult<Imputer> {
        let imputing = || {
            let spec = described(name, &agents, None, None)?.spec;
            if agent >= spec.n_agents() {
                return Err(usage!("there is no agent {agent} of {name}, which has {}", spec.n_agents()));
            }
            check_worlds(&spec, worlds)?;
            let nobody = PolicySource::Nobody.load(&spec)?;
            let policy = Policy::open(&path, nobody.dims())?;
            let setup = Setup {
                spec: &spec,
                policy: &policy,
                agent,
                worlds,
                longest_delay: oldest,
                seed: 0,
                greedy: false,
            };
            let imputer = Registry::default().make(FITTED, &setup)?;
            Ok(Imputing::new(imputer, agent, JointLayout::of(&spec), worlds))
        };
        imputing().map(|imputing| Imputer(Mutex::new(imputing))).map_err(|error| raised(py, error))
    }

    /// An episode begins in each of so many worlds.
    fn begin(&self, py: Python, worlds: usize) -> PyResult<()> {
        self.imputing()?.begin(worlds).map_err(|error| raised(py, error))
    }

    /// Writes the joint estimates, padded, `f32 [worlds, joint]`: of what the agent itself observes and what has just
    /// arrived, `f32 [worlds, agents, observation]`, where `u8 [worlds, agents]` says how old that is, 255 if nothing arrived.
    fn fuse(
        &self,
        ages: &Bound<PyAny>,
        observations: &Bound<PyAny>,
        estimates: &Bound<PyAny>,
    ) -> PyResult<()> {
        let mut imputing = self.imputing()?;
        take(ages, &mut imputing.ages)?;
        take(observations, &mut imputing.observations)?;
        imputing.fuse();
        put(estimates, &imputing.estimates)
    }

    /// Carries the last estimates over to the next tick.
    fn predict(&self) -> PyResult<()> {
        self.imputing()?.predict();
        Ok(())
    }
}

impl Imputer {
    fn imputing(&self) -> PyResult<MutexGuard<'_, Imputing>> {
        self.0.try_lock().map_err(|_| PyValueError::new_err("another thread is using this imputer"))
    }
}

impl Imputing {
    fn new(imputer: Box<dyn agent::Imputer>, agent: usize, layout: JointLayout, room: usize) -> Imputing {
        let (ages, observations, estimates, nothing) = Default::default();
        Imputing { imputer, agent, layout, room, worlds: 0, ages, observations, estimates, nothing }
    }

    fn begin(&mut self, worlds: usize) -> Result<()> {
        if !(1..=self.room).contains(&worlds) {
            return Err(usage!("an episode begins in {worlds} worlds, and there are 1 to {}", self.room));
        }
        self.worlds = worlds;
        self.ages.resize(worlds * self.layout.agents, NOT_ARRIVED);
        self.observations.resize(worlds * self.layout.predicted(), 0.0);
        self.estimates.resize(worlds * self.layout.joint(), 0.0);
        self.nothing.resize(worlds, 0);
        self.imputer.begin_episodes(worlds);
        Ok(())
    }

    fn fuse(&mut self) {
        let JointLayout { agents, unique, .. } = self.layout;
        let rows = self.ages.chunks_exact(agents).zip(self.observations.chunks_exact(agents * unique));
        for (world, ((ages, observations), estimate)) in
            rows.zip(self.estimates.chunks_exact_mut(self.layout.joint())).enumerate()
        {
            let of = |sender: usize| &observations[self.layout.part(sender)];
            let inbox = Inbox::of(agents, |sender| {
                let arrived = sender != self.agent && ages[sender] != NOT_ARRIVED;
                arrived.then(|| Received { age: ages[sender], observation: of(sender) })
            });
            self.imputer.fuse(world, of(self.agent), &inbox, estimate);
        }
    }

    fn predict(&mut self) {
        // Where the episode stands matters only to imputers that draw.
        let step = Step { episode: 0, step: 0, estimates: &self.estimates, actions: &self.nothing };
        self.imputer.predict(&step);
    }
}
