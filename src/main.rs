//! The program: parse, dispatch, and the one place that prints an error.

use std::process::ExitCode;

use clap::Parser;
use vamaro_swarm::cli::Cli;

fn main() -> ExitCode {
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
