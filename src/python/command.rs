//! The program `vamaro-swarm`, started by Python.

use std::ffi::OsString;

use pyo3::prelude::*;

use crate::agent::Registry;
use crate::supervisor::AgentCommand;
use crate::{cli, embed};

/// Runs the command line `arguments`, without the name of the program; returns its exit code. Agents are processes of the
/// `program` that these words start.
#[pyfunction]
pub(super) fn main(py: Python, arguments: Vec<OsString>, program: Vec<OsString>) -> u8 {
    let mut program = program.into_iter();
    let first = AgentCommand::new(program.next().unwrap_or_default());
    program.fold(first, AgentCommand::word).stand_for_this_program();
    py.detach(|| {
        embed::run_if_told(&arguments, &Registry::default());
        cli::run(arguments)
    })
}
