//! Environments in another process that are none. Those in Python are in `tests/python/test_serve.py`.

use std::process::Command;
use std::time::Duration;

use vamaro_swarm::supervisor::{AgentCommand, Deadlines, Hosted};

use crate::common::fail;

#[test]
fn a_command_that_hosts_nothing_is_named() {
    let words = "spawn --episodes 1 --env";
    fail(&format!("{words} false"), 1, &["the environment (false) (process", "ended with exit code 1"]);
    fail(&format!("{words} /no/such/program"), 1, &["the environment (/no/such/program)", "No such file"]);
    fail(&format!("{words}="), 2, &["no words"]);
    for other in ["--task hear-see", "--agents 2", "--record x.trace", "--physics mass=2"] {
        fail(&format!("{words} true {other}"), 2, &["cannot be used with"]);
    }
}

#[test]
fn one_that_never_says_what_it_is_takes_those_along_that_it_started() {
    let seconds = 8000 + std::process::id();
    let command = AgentCommand::new("sh").word("-c").word(format!("sleep {seconds} & wait"));
    let deadlines = Deadlines { ready: Duration::from_millis(500), ..Deadlines::default() };
    let error = Hosted::start(&command, 1, deadlines).unwrap_err();
    assert!(error.is_loss(), "{error}");
    let error = error.to_string();
    assert!(
        error.contains("the environment (sh -c sleep") && error.contains("did not say what it is"),
        "{error}"
    );
    let found = Command::new("pgrep").args(["-f", &format!("sleep {seconds}$")]).output();
    let Ok(found) = found else { return eprintln!("skipped: this machine has no `pgrep`") };
    assert_eq!(String::from_utf8_lossy(&found.stdout), "", "it has left somebody behind");
}
