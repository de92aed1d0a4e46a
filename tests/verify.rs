//! `verify` and `inspect` through the real binary: what holds holds, what was tampered with does not.

mod common;

use std::path::Path;

use common::{data, fail, run, succeed};
use serde_json::Value;

/// Copies a recording or trace with one value changed.
fn tampered(source: &Path, folder: &Path, pointer: &str, value: Value) -> String {
    let mut json: Value = serde_json::from_slice(&std::fs::read(source).unwrap()).unwrap();
    *json.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
    let path = folder.join("tampered.json");
    std::fs::write(&path, json.to_string()).unwrap();
    path.display().to_string()
}

#[test]
fn the_worlds_agree_with_the_reference_environments() {
    let table = succeed(&format!("verify {}", data("recordings").display()));
    // Eight tasks, five comparisons each.
    assert_eq!(table.lines().filter(|line| line.trim_start().starts_with("ok")).count(), 40, "{table}");
    assert!(table.contains("all 40 comparisons hold"), "{table}");
}

#[test]
fn the_agents_agree_with_the_papers_code() {
    let table = succeed(&format!("verify {} --policy builtin", data("traces").display()));
    assert!(table.contains("all 18 comparisons hold"), "{table}");
    for what in ["joint estimates", "joint estimates, median", "logits", "logits, median"] {
        assert_eq!(table.matches(&format!("{what}  ")).count(), 2, "{what}: {table}");
    }
}

#[test]
fn a_recorded_swarm_is_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace.json");
    for words in [
        "--agents 4 --p 0.4 --episodes 3",
        "--task SL --policy untrained --seed 9 --links uniform --episodes 3 --imputer hold",
    ] {
        succeed(&format!("spawn {words} --record {}", trace.display()));
        let table = succeed(&format!("verify {}", trace.display()));
        assert!(table.contains("all 9 comparisons hold"), "{table}");
        let said = succeed(&format!("inspect {}", trace.display()));
        assert!(said.starts_with("trace of s"), "{said}");
    }
    // With another policy it is another story.
    succeed(&format!("spawn --agents 4 --p 0.4 --episodes 3 --record {}", trace.display()));
    fail(&format!("verify {} --policy untrained", trace.display()), 1, &["comparisons do not hold"]);
}

#[test]
fn tampering_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, trace) = (data("recordings/spread-xy-2.json"), data("traces/hear-see.json"));
    for (source, pointer, value) in [
        (&recording, "/episodes/0/agent_pos/7/1/0", Value::from(0.123)),
        (&recording, "/episodes/0/team_reward/3", Value::from(-1.0)),
        (&recording, "/episodes/0/return", Value::from(-1.0)),
        (&recording, "/episodes/0/obs/25/0/2", Value::from(0.5)),
        (&recording, "/episodes/0/obs/25/0", Value::from(vec![0.5; 9])),
        (&trace, "/episodes/1/logits/9/0/1", Value::from(0.5)),
        (&trace, "/episodes/1/joint_estimate/9/0/10", Value::from(0.5)),
        (&trace, "/episodes/3/delivered/9/0/1", Value::from(1)),
    ] {
        let path = tampered(source, folder.path(), pointer, value);
        fail(&format!("verify {path} --policy builtin"), 1, &["do not hold"]);
    }
}

#[test]
fn broken_recordings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, trace) = (data("recordings/spread-xy-2.json"), data("traces/hear-see.json"));
    for (source, pointer, value, says) in [
        (&recording, "/episodes/0/agent_pos/7", Value::from(Vec::<Value>::new()), "agent_pos"),
        (&recording, "/episodes/0/actions/0/0", Value::from(9), "no action 9"),
        (&recording, "/episodes/0/goal_landmark", Value::from(1), "no goal"),
        (&recording, "/task", Value::from("hear-see"), "landmarks"),
        (&recording, "/episode_steps", Value::from(u64::MAX), "steps"),
        (&recording, "/task", Value::from("no-such-task"), "no-such-task"),
        (&trace, "/episodes/0/joint_estimate/3/1", Value::from(vec![0.5]), "joint"),
        (&trace, "/episodes/0/delivered/3/1", Value::from(vec![1]), "delivered"),
        (&trace, "/imputer", Value::from("clairvoyant"), "clairvoyant"),
    ] {
        let mut json: Value = serde_json::from_slice(&std::fs::read(source).unwrap()).unwrap();
        json["imputer"] = Value::from("value-aware");
        let with_imputer = folder.path().join("with-imputer.json");
        std::fs::write(&with_imputer, json.to_string()).unwrap();
        let path = tampered(&with_imputer, folder.path(), pointer, value);
        let output = run(&format!("verify {path} --policy builtin"));
        let stderr = common::stderr(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{pointer}: {stderr}");
        assert!(stderr.contains(says) && !stderr.contains("panicked"), "{pointer}: {stderr}");
    }
}

#[test]
fn nothing_compared_is_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    fail(&format!("verify {}", at("")), 1, &["nothing was compared"]);
    std::fs::write(at("config.json"), r#"{"kind": "update", "task": "hear-see"}"#).unwrap();
    let output = run(&format!("verify {}", at("")));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("skipped"), "updates are listed as skipped");
    std::fs::write(
        at("empty.json"),
        r#"{"task":"hear-see","n_agents":2,"n_landmarks":1,"episode_steps":25,"episodes":[]}"#,
    )
    .unwrap();
    fail(&format!("verify {}", at("empty.json")), 1, &["do not hold"]);
    fail(&format!("verify {}", at("missing")), 2, &["there is no file"]);
    // A link that leads back up is not followed, and what cannot be read does not hide the rest.
    std::fs::remove_file(at("empty.json")).unwrap();
    std::os::unix::fs::symlink(folder.path(), at("loop")).unwrap();
    std::fs::copy(data("recordings/hear-see.json"), at("a recording")).unwrap();
    let table = succeed(&format!("verify {}", at("")));
    assert!(table.contains("all 5 comparisons hold"), "{table}");
    std::fs::write(at("0.json"), "{").unwrap();
    let output = run(&format!("verify {}", at("")));
    assert_eq!(output.status.code(), Some(1));
    let table = String::from_utf8_lossy(&output.stdout);
    assert!(table.contains("FAIL") && table.contains("0.json") && table.contains("ok  "), "{table}");
    std::fs::write(at("half.json"), r#"{"task": "hear-"#).unwrap();
    fail(&format!("verify {}", at("half.json")), 1, &["half.json", "JSON"]);
}

#[test]
fn a_trace_without_a_policy_says_where_to_put_one() {
    let trace = data("traces/hear-see.json");
    fail(&format!("verify {}", trace.display()), 2, &["--policy", "policy.safetensors"]);
}
