//! The program.

use std::process::ExitCode;

use vamaro_swarm::agent::Registry;

fn main() -> ExitCode {
    vamaro_swarm::run_if_agent(&Registry::default());
    let words = std::env::args_os().skip(1).collect::<Vec<_>>();
    #[cfg(feature = "hosts")]
    vamaro_swarm::cli::share_engine_threads(&words);
    ExitCode::from(vamaro_swarm::cli::run(words))
}
