//! `Lessons`: a predictor for an environment that lives in Python.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::buffers::take;
use super::elsewhere::{Observer, described};
use super::errors::raised;
use super::interrupt::interruptible;
use crate::agent::PolicySource;
use crate::environment::Spec;
use crate::nn::PredictorSpec;
use crate::supervisor::signals;
use crate::train;

/// A predictor that learns from what is played in Python.
#[pyclass(frozen, module = "vamaro_swarm._native")]
pub(super) struct Lessons(Mutex<train::Lessons>, Spec);

/// What the predictor is called in its file.
pub(super) const FITTED: &str = "fitted";

#[pymethods]
impl Lessons {
    /// For these agents. The values at `held`, of a padded joint estimate, never change.
    #[new]
    #[pyo3(signature = (name, agents, *, held, seed))]
    fn new(py: Python, name: &str, agents: Vec<Observer>, held: Vec<usize>, seed: u64) -> PyResult<Lessons> {
        let lessons = || {
            let spec = described(name, &agents, None, None)?.spec;
            let predictor = PredictorSpec { held, skip: true, ..PredictorSpec::paper(FITTED) };
            let lessons = train::Lessons::new(&PolicySource::Nobody.load(&spec)?, predictor, seed);
            Ok(Lessons(Mutex::new(lessons), spec))
        };
        lessons().map_err(|error| raised(py, error))
    }

    /// Keeps an episode: what was true, `f32 [observations, agents, longest observation]`, and what each agent saw, `f32
    /// [observations, agents, agents, longest observation]`.
    fn keep(&self, observations: usize, truth: &Bound<PyAny>, seen: &Bound<PyAny>) -> PyResult<()> {
        let values = observations * self.1.joint_dim();
        let (mut true_ones, mut seen_ones) = (vec![0.0; values], vec![0.0; values * self.1.n_agents()]);
        take(truth, &mut true_ones)?;
        take(seen, &mut seen_ones)?;
        self.lessons()?.keep(true_ones, seen_ones);
        Ok(())
    }

    /// Takes steps whose learning rates go from the first to the last. Returns the last loss.
    fn learn(&self, py: Python, steps: u64, first: f64, last: f64) -> PyResult<Option<f64>> {
        let mut lessons = self.lessons()?;
        let lessons = &mut *lessons;
        interruptible(py, || {
            let mut loss = None;
            for step in 0..steps {
                signals::check_stop()?;
                let share = step as f64 / steps as f64;
                loss = lessons.learn(first + (last - first) * share)?.map(|losses| losses.loss);
            }
            Ok(loss)
        })
    }

    /// Writes a policy file that holds the predictor.
    fn save(&self, py: Python, path: PathBuf) -> PyResult<()> {
        let lessons = self.lessons()?;
        let save = || lessons.policy()?.save(&path);
        save().map_err(|error| raised(py, error))
    }
}

impl Lessons {
    fn lessons(&self) -> PyResult<MutexGuard<'_, train::Lessons>> {
        self.0.try_lock().map_err(|_| PyValueError::new_err("another thread is using these lessons"))
    }
}
