//! The program: parse, dispatch, and the one place that prints an error.

use std::io::Write;
use std::process::ExitCode;

use clap::Parser;
use vamaro_swarm::agent::Registry;
use vamaro_swarm::cli::Cli;

fn main() -> ExitCode {
    vamaro_swarm::run_if_agent(&Registry::default());
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Where stderr cannot be written the exit code says it all.
            let _ = writeln!(std::io::stderr(), "error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
