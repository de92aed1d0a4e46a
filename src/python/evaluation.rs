//! `Evaluation`: what was played, and its statistics.

use std::path::PathBuf;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::errors::raised;
use super::interrupt::interruptible;
use crate::base::error::{Error, Result};
use crate::base::threads::cores;
use crate::cli::evaluate::Evaluate;
use crate::cli::machine;
use crate::evaluate::report::{self, Provenance};
use crate::evaluate::{Cell, Condition, Contender, Outcome, RandomTeam, Settings, Summary};
use crate::link::Site;

/// What was played, and its statistics.
#[pyclass(frozen, module = "vamaro_swarm._native")]
pub(super) struct Evaluation {
    played: crate::evaluate::Evaluation,
    summary: Summary,
    provenance: Provenance,
}

/// A cell: the number of the team, the condition, the imputer, and the returns.
type Played = (usize, String, String, Vec<f64>);

#[pymethods]
impl Evaluation {
    /// Plays what `vamaro-swarm evaluate` plays with these arguments.
    #[staticmethod]
    fn of_policies(py: Python, arguments: Vec<String>, call: String) -> PyResult<Evaluation> {
        let (played, summary) = interruptible(py, || Evaluate::quietly(arguments))?;
        Ok(Evaluation { played, summary, provenance: provenance(call) })
    }

    /// Raises if one of these conditions cannot be read where there are so many agents and a step takes `tick` s.
    #[staticmethod]
    fn check(py: Python, conditions: Vec<String>, agents: usize, tick: Option<f64>) -> PyResult<()> {
        let read = conditions.iter().try_for_each(|text| condition(text, Site { agents, tick }).map(drop));
        read.map_err(|error| raised(py, error))
    }

    /// The statistics of what was played in Python: returns of `teams` in an `environment` of so many agents, whose steps
    /// take `tick` s, cell by cell, and those of a team that acts at random. Imputers are compared with `baseline`.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "the package calls it, by name")]
    #[pyo3(signature = (*, environment, agents, tick, teams, seed, share_at_start, random, cells, baseline, call))]
    fn of_returns(
        py: Python,
        environment: String,
        agents: usize,
        tick: Option<f64>,
        teams: Vec<String>,
        seed: u64,
        share_at_start: bool,
        random: Vec<f64>,
        cells: Vec<Played>,
        baseline: String,
        call: String,
    ) -> PyResult<Evaluation> {
        let contender = |(seed, name): (u64, &String)| Contender {
            name: name.clone(),
            task: environment.clone(),
            algorithm: "python".to_owned(),
            seed,
            steps: 0,
            origin: "a policy in Python".to_owned(),
            fingerprint: String::new(),
            predictors: Vec::new(),
        };
        let cell = |(contender, text, imputer, returns): Played| {
            let condition = condition(&text, Site { agents, tick })?;
            Ok(Cell { contender, condition, imputer, outcome: Outcome { returns, errors: Vec::new() } })
        };
        let episodes = cells.first().map_or(0, |cell| cell.3.len());
        if episodes == 0 || cells.iter().any(|cell| cell.3.len() != episodes || cell.0 >= teams.len()) {
            return Err(PyValueError::new_err("every cell needs as many returns as the others, and a team"));
        }
        let random = (!random.is_empty()).then(|| RandomTeam { task: environment.clone(), returns: random });
        let summarise = || -> Result<_> {
            let played = crate::evaluate::Evaluation {
                settings: Settings {
                    episodes: episodes as u64,
                    seed,
                    comm_at_t0: share_at_start,
                    ..Settings::default()
                },
                contenders: (0..).zip(&teams).map(contender).collect(),
                random: random.into_iter().collect(),
                cells: cells.into_iter().map(cell).collect::<Result<_>>()?,
                ..crate::evaluate::Evaluation::default()
            };
            let summary = Summary::of(&played, &[&baseline], cores())?;
            Ok((played, summary))
        };
        let (played, summary) = interruptible(py, summarise)?;
        Ok(Evaluation { played, summary, provenance: provenance(call) })
    }

    /// The table that `vamaro-swarm evaluate` prints.
    fn text(&self) -> String {
        report::text(&self.summary)
    }

    /// `summary.csv`, or `episodes.csv`.
    fn csv(&self, episodes: bool) -> String {
        if episodes { report::episodes_csv(&self.played) } else { report::summary_csv(&self.summary) }
    }

    /// `results.json`.
    fn results(&self) -> String {
        report::results(&self.summary, &self.provenance)
    }

    /// `marl-eval.json`.
    fn marl_eval(&self) -> String {
        report::marl_eval(&self.played, &self.summary)
    }

    /// Writes the report into a folder, which is made if it is not there. Returns the files.
    fn write(&self, py: Python, folder: PathBuf, paper: bool) -> PyResult<Vec<PathBuf>> {
        let write = || {
            std::fs::create_dir_all(&folder).map_err(|e| Error::io("create the folder", &folder, e))?;
            report::write(&folder, &self.played, &self.summary, &[], &self.provenance, paper)
        };
        py.detach(write).map_err(|error| raised(py, error))
    }
}

/// The condition of a cell: a level, such as `p=0.2`, or a text of links.
fn condition(text: &str, site: Site) -> Result<Condition> {
    let level = text.strip_prefix("p=").and_then(|p| p.parse().ok());
    level.map_or_else(|| Condition::parse(text, site), Condition::level)
}

fn provenance(call: String) -> Provenance {
    Provenance {
        program: format!("vamaro-swarm {} for Python", env!("CARGO_PKG_VERSION")),
        command: call,
        cpu: machine::cpu(),
        date: machine::today(),
    }
}
