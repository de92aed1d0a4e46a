//! The wheel: the library for Python.
//!
//! These are thin bindings. What a user of Python sees is the package around them, `python/vamaro_swarm/`, which alone
//! calls them: it owns the numpy arrays that results are written into, and the words for what users do wrong.
//!
//! ```text
//! Arena       stage and ears -> what each agent has after links and imputer
//! Team        a policy file  -> actions
//! Evaluation  what was played -> statistics, report
//! Lessons     what was played -> a predictor
//! Imputer     a predictor     -> what one agent in a process of its own imputes by
//! Host        an environment, hosted for a supervisor elsewhere
//! command     the program `vamaro-swarm`
//! ```
//!
//! Python's lock is released while anything is played. A panic becomes an exception of Python.

mod arena;
mod buffers;
mod command;
mod ears;
mod elsewhere;
mod errors;
mod evaluation;
mod host;
mod imputer;
mod interrupt;
mod lessons;
mod play;
mod team;

use pyo3::prelude::*;

/// What the package is made of.
#[pymodule]
fn _native(module: &Bound<PyModule>) -> PyResult<()> {
    module.add("version", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<arena::Arena>()?;
    module.add_class::<team::Team>()?;
    module.add_class::<evaluation::Evaluation>()?;
    module.add_class::<host::Host>()?;
    module.add_class::<lessons::Lessons>()?;
    module.add_class::<imputer::Imputer>()?;
    module.add_function(wrap_pyfunction!(command::main, module)?)
}
