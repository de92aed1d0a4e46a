//! Swarms of processes: nothing is left behind, however they end.

use crate::common::{self, Swarm, assert_gone, fail, run, shared_memory, stderr, succeed};
use std::time::{Duration, Instant};

use rustix::process::{Signal, kill_process};
use serde_json::Value;

#[test]
fn the_main_job_runs_and_says_what_it_did() {
    let text = succeed("spawn --agents 4 --p 0.2 --episodes 20");
    let links = text.lines().nth(1).unwrap();
    assert!(links.contains("p = 0.2") && links.contains("drop = 0.8"), "{links}");
    for part in
        ["return", "95 %", "delivered", "RMSE", "p50", "p99", "dynamics", "trained by", "5 M env steps"]
    {
        assert!(text.contains(part), "{part}: {text}");
    }
    let first = succeed("spawn --drop 0.25 --episodes 1");
    assert!(first.contains("p = 0.75") && first.contains("drop = 0.25"), "{first}");
}

#[test]
fn programs_can_read_the_summary() {
    let json: Value =
        serde_json::from_str(&succeed("spawn --agents 4 --p 0.6 --episodes 50 --audit --json")).unwrap();
    assert_eq!(json["task"], "spread-xy-4");
    assert_eq!(json["episodes"], 50);
    assert_eq!(json["ticks"], 50 * 25);
    assert!(json["return_mean"].as_f64().unwrap() < 0.0);
    assert!(json["return_ci95"].as_f64().unwrap() > 0.0);
    // 50 * 24 * 12 links, each up with 0.6: five sigma are 0.02.
    assert!((json["delivery_rate"].as_f64().unwrap() - 0.6).abs() < 0.02, "{json}");
    assert!(json["imputation_rmse"].as_f64().unwrap() > 0.0);
    let (ticks, audit) = (50 * 25 * 4, &json["audit"]);
    assert_eq!(audit["own"], ticks);
    assert_eq!(audit["received"].as_u64().unwrap() + audit["imputed"].as_u64().unwrap(), 3 * ticks);
    let first_steps = 50 * 12;
    let delivered = (json["delivery_rate"].as_f64().unwrap() * (50 * 24 * 12) as f64).round() as u64;
    assert_eq!(audit["received"], delivered + first_steps, "what was delivered is what was used");
    assert_eq!((&audit["late"], &audit["altered"], &audit["leaked"]), (&0.into(), &0.into(), &0.into()));
}

#[test]
fn a_team_of_one_has_no_links() {
    let json: Value = serde_json::from_str(&succeed(
        "spawn --agents 1 --task spread-blindfold-1 --policy untrained --episodes 3 --json",
    ))
    .unwrap();
    assert_eq!((&json["delivery_rate"], &json["imputation_rmse"]), (&Value::Null, &Value::Null));
}

#[test]
fn interrupting_takes_everything_down() {
    // Under `nohup`, say, the program leaves the signal alone.
    for signal in [Signal::INT, Signal::TERM, Signal::HUP].into_iter().filter(|s| !common::is_ignored(*s)) {
        let swarm = Swarm::start("--agents 4 --p 0.2");
        let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
        assert!(!shared_memory(&tag).is_empty(), "a running swarm has shared memory");
        swarm.signal_supervisor(signal);
        let (code, _, stderr) = swarm.wait();
        assert_eq!(code, Some(130), "{stderr}");
        assert_gone(&agents, &tag);
    }
}

#[test]
fn an_agent_that_dies_ends_the_swarm_with_its_name() {
    let swarm = Swarm::start("--agents 4 --p 0.2 --on-failure abort");
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    kill_process(agents[2], Signal::KILL).unwrap();
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(1));
    assert!(stderr.contains("agent-2") && stderr.contains("signal 9"), "{stderr}");
    assert_gone(&agents, &tag);
}

#[test]
fn a_slow_agent_changes_nothing() {
    let words = "--agents 2 --p 0.5 --episodes 3000 --deadline 60s --json --audit";
    let result = |json: &Value| (json["return_mean"].clone(), json["imputation_rmse"].clone());
    let undisturbed: Value = serde_json::from_str(&succeed(&format!("spawn {words}"))).unwrap();
    let swarm = Swarm::start(words);
    kill_process(swarm.agents[1], Signal::STOP).unwrap();
    // A tick has two waits; further ones are those of a peer that has looked again, and waits on.
    common::await_sleeps(swarm.agents[0], 6);
    kill_process(swarm.agents[1], Signal::CONT).unwrap();
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(0), "{stderr}");
    let disturbed: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(disturbed["audit"]["late"], 0);
    assert_eq!(result(&disturbed), result(&undisturbed));
}

#[test]
fn agents_go_with_their_supervisor_and_the_next_start_cleans_up() {
    let swarm = Swarm::start("--agents 4 --p 0.2");
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    swarm.signal_supervisor(Signal::KILL);
    swarm.wait();
    assert!(!shared_memory(&tag).is_empty(), "nobody was left to clean up");
    // The agents are ended by the kernel, which may take a moment.
    let deadline = Instant::now() + Duration::from_secs(10);
    while agents.iter().any(|agent| common::is_running(*agent)) && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(5));
    }
    succeed("spawn --episodes 1");
    assert_gone(&agents, &tag);
}

#[test]
fn two_swarms_on_one_machine_do_not_meet() {
    let words = "spawn --agents 4 --p 0.2 --episodes 40 --json --audit";
    let start = || common::command(words).stdout(std::process::Stdio::piped()).spawn().unwrap();
    let results = [start(), start()].map(|child| child.wait_with_output().unwrap());
    let returns = results.map(|output| {
        assert!(output.status.success());
        let json: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(json["audit"]["altered"], 0);
        json["return_mean"].as_f64().unwrap()
    });
    assert_eq!(returns[0], returns[1]);
}

#[test]
fn the_log_of_the_bus_is_off_unless_asked_for() {
    let quiet = run("spawn --episodes 1");
    assert_eq!(stderr(&quiet), "");
    let mut command = common::command("spawn --episodes 1");
    let loud = command.env("IOX2_LOG_LEVEL", "trace").output().unwrap();
    let stderr = String::from_utf8_lossy(&loud.stderr);
    assert!(
        stderr.contains("[agent-0] ") && stderr.contains("[agent-1] "),
        "agents' stderr carries their names"
    );
}

#[test]
fn agents_are_not_for_the_command_line() {
    fail("agent {}", 2, &["for the supervisor"]);
}

#[test]
fn pretrained_policies_are_found_by_name_in_a_checkout() {
    let checkout = env!("CARGO_MANIFEST_DIR");
    let spawn = |name: &str| {
        let words = format!("spawn --policy {name} --episodes 2 --worlds 2 --p 0.4 --json");
        let output = common::command(&words).current_dir(checkout).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let (first, second) = (spawn("hear-see/seed-0"), spawn("hear-see/seed-1"));
    assert_eq!((&first["task"], &second["task"]), (&"hear-see".into(), &"hear-see".into()));
    assert_ne!(first["return_mean"], second["return_mean"]);
    // Kept in half precision they come to agents as they come to a team without processes.
    let words = "spawn --policy builtin --task hear-see --episodes 2 --worlds 2 --p 0.4 --json --in-process";
    let builtin: Value = serde_json::from_str(&succeed(words)).unwrap();
    assert_eq!(first["return_mean"], builtin["return_mean"]);
    let output = common::command("inspect hear-see/seed-1").current_dir(checkout).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stdout).contains("policy for hear-see"), "{}", stderr(&output));
}
