//! Environments in another process: some that are none, and one by another program. Those that `vamaro_swarm.serve` hosts
//! are in `tests/python/test_serve.py`.

use std::process::Output;
use std::time::Duration;

use vamaro_swarm::supervisor::{AgentCommand, Deadlines, Hosted};

use crate::common::{self, fail, stderr};
use crate::foreign::{python, run_line};

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
fn what_is_wrong_without_it_is_said_before_it_starts() {
    for (options, says) in [
        ("--policy no/such", "there is no policy no/such"),
        ("--links gilber(0.1)", "gilber"),
        ("--links matrix(no-such-file)", "no-such-file"),
        ("--links gilbert(0.1,0.3)+delay(300)", "300"),
        ("--chaos kill=0.1 --worlds 2", "--worlds 1"),
    ] {
        fail(&format!("spawn --episodes 2 --env false {options}"), 2, &[says]);
    }
    // What depends on the environment is not.
    for options in ["--policy builtin", "--links delay(2)", "--in-process --deadline 1s"] {
        fail(&format!("spawn --episodes 2 --env false {options}"), 1, &["ended with exit code 1"]);
    }
    fail("spawn --in-process --deadline 1s", 2, &["--deadline is for processes"]);
}

#[test]
fn one_by_another_program_is_played_in() {
    let Some(python) = python("iceoryx2, numpy") else { return };
    let host = format!("{python} {}/tests/data/constant_environment.py", env!("CARGO_MANIFEST_DIR"));
    let play = |options: &str| -> Output {
        let words = ["spawn", "--env", &host, "--policy", "untrained", "--p", "0.5", "--json"];
        run_line(&words.into_iter().chain(options.split(' ')).collect::<Vec<_>>())
    };
    // Agent i earns i + 1 in each of three steps, and all of it is what the team earns.
    for options in ["--episodes 2", "--episodes 3 --worlds 2 --audit"] {
        let output = play(options);
        assert!(output.status.success(), "{options}: {}", stderr(&output));
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(
            (&summary["task"], &summary["return_mean"]),
            (&"constant".into(), &9.0.into()),
            "{summary}"
        );
    }
    // It does not say how long a step is.
    let output = play("--episodes 1 --chaos kill=0.1:500ms");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("how long a step is"), "{}", stderr(&output));
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
    common::assert_no_process(&format!("sleep {seconds}$"));
}
