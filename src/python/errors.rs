//! Errors as exceptions of Python.

use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;

use crate::base::error::Error;

/// The exception that says what this error says.
pub(super) fn raised(py: Python, error: Error) -> PyErr {
    match error {
        Error::Usage(words) => PyValueError::new_err(words),
        Error::Interrupted(words) => PyKeyboardInterrupt::new_err(words),
        error => exception(py, "Error", (error.to_string(),)),
    }
}

/// What an agent did wrong.
pub(super) fn of_agent(py: Python, agent: &str, words: &str) -> PyErr {
    exception(py, "AgentError", (agent, words))
}

/// An exception of the package.
fn exception<'py>(py: Python<'py>, name: &str, arguments: impl pyo3::call::PyCallArgs<'py>) -> PyErr {
    let made = py.import("vamaro_swarm.errors").and_then(|module| module.getattr(name)?.call1(arguments));
    made.map_or_else(|error| error, PyErr::from_value)
}
