//! The program.

use std::process::ExitCode;

use vamaro_swarm::agent::Registry;

fn main() -> ExitCode {
    vamaro_swarm::run_if_agent(&Registry::default());
    ExitCode::from(vamaro_swarm::cli::run(std::env::args_os().skip(1).collect()))
}
