//! `verify` and `inspect` through the real binary: what holds holds, what was tampered with does not.

use std::path::{Path, PathBuf};

use crate::common::{self, data, fail, run, succeed};
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
    // Eight tasks of the paper and three teams of PettingZoo's simple_spread_v3, five comparisons each.
    assert_eq!(table.lines().filter(|line| line.trim_start().starts_with("ok")).count(), 55, "{table}");
    assert!(table.contains("all 55 comparisons hold"), "{table}");
}

#[test]
fn the_agents_agree_with_the_papers_code() {
    let table = succeed(&format!("verify {}", data("traces").display()));
    assert!(table.contains("all 18 comparisons hold"), "{table}");
    for what in ["joint estimates", "joint estimates, median", "logits", "logits, median"] {
        assert_eq!(table.matches(&format!("{what}  ")).count(), 2, "{what}: {table}");
    }
}

#[test]
fn the_learner_agrees_with_the_papers_code() {
    // Two sequences of three updates, five comparisons each.
    let table = succeed(&format!("verify {}", data("updates").display()));
    assert!(table.contains("all 30 comparisons hold"), "{table}");
    for what in ["advantages", "predictor loss", "weights of actors", "weights of critics"] {
        assert_eq!(table.matches(&format!("{what}  ")).count(), 6, "{what}: {table}");
    }
}

/// A copy of recorded updates, to be tampered with.
struct Updates(tempfile::TempDir);

impl Updates {
    fn new() -> Updates {
        let copy = Updates(tempfile::tempdir().unwrap());
        for file in ["config.json", "update-1.safetensors", "update-2.safetensors"] {
            std::fs::copy(data("updates/hear-see-mappo-mlp").join(file), copy.at(file)).unwrap();
        }
        copy
    }

    fn at(&self, file: &str) -> PathBuf {
        self.0.path().join(file)
    }

    fn verify(&self) -> String {
        format!("verify {}", self.0.path().display())
    }

    fn configure(&self, pointer: &str, value: impl Into<Value>) {
        let mut json: Value =
            serde_json::from_slice(&std::fs::read(self.at("config.json")).unwrap()).unwrap();
        *json.pointer_mut(pointer).unwrap() = value.into();
        std::fs::write(self.at("config.json"), json.to_string()).unwrap();
    }

    /// Overwrites the first bytes of a tensor of the second update.
    fn overwrite(&self, tensor: &str, bytes: &[u8]) {
        let mut file = std::fs::read(self.at("update-2.safetensors")).unwrap();
        let header = u64::from_le_bytes(file[..8].try_into().unwrap()) as usize + 8;
        let json: Value = serde_json::from_slice(&file[8..header]).unwrap();
        let start = header + json[tensor]["data_offsets"][0].as_u64().unwrap() as usize;
        file[start..start + bytes.len()].copy_from_slice(bytes);
        std::fs::write(self.at("update-2.safetensors"), file).unwrap();
    }
}

#[test]
fn tampered_updates_are_found() {
    let says = succeed(&Updates::new().verify());
    assert!(says.contains("all 10 comparisons hold"), "{says}");
    for (pointer, value) in [
        ("/learning_rate", Value::from(1.1e-4)),
        ("/entropy_coefficient", Value::from(0.01)),
        ("/gamma", Value::from(0.98)),
        ("/epochs", Value::from(3)),
        ("/n_step", Value::from(4)),
        ("/grad_norm_clip", Value::from(0.01)),
        ("/standardise_rewards", Value::from(false)),
        ("/predictor/advantage_lambda", Value::from(0.5)),
        ("/predictor/grad_norm_clip", Value::from(1e-3)),
    ] {
        let updates = Updates::new();
        updates.configure(pointer, value);
        let output = run(&updates.verify());
        let found = String::from_utf8_lossy(&output.stdout).contains("FAIL");
        assert!(output.status.code() == Some(1) && found, "{pointer}");
    }
    for tensor in ["batch.reward", "batch.joint_input", "after.advantages", "after.predictor_loss"] {
        let updates = Updates::new();
        // Two agents see the same joint observation of 16 values.
        let row = [0.5f32; 16].map(f32::to_le_bytes).concat();
        match tensor {
            "batch.joint_input" => updates.overwrite(tensor, &[row.clone(), row].concat()),
            _ => updates.overwrite(tensor, &0.5f32.to_le_bytes()),
        }
        fail(&updates.verify(), 1, &["do not hold"]);
    }
}

#[test]
fn broken_updates_are_refused() {
    for (pointer, value, says) in [
        ("/task", Value::from("no-such-task"), "no-such-task"),
        ("/task", Value::from("spread-xy-2"), "expected F32"),
        ("/actor", Value::from("gru"), "weight_ih"),
        ("/algorithm", Value::from("dqn"), "mappo"),
        ("/hidden", Value::from(0), "hidden size"),
        ("/hidden", Value::from(64), "expected F32"),
        ("/hidden", Value::from(1 << 14), "expected F32"),
        ("/epochs", Value::from(0), "epochs"),
        ("/n_step", Value::from(0), "n_step"),
        ("/adam_eps", Value::from(1e-5), "adam_eps"),
        ("/target_update_interval", Value::from(0), "target_update_interval"),
        ("/predictor", Value::from(1), "config.json"),
    ] {
        let updates = Updates::new();
        updates.configure(pointer, value);
        let output = run(&updates.verify());
        let stderr = common::stderr(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{pointer}: {stderr}");
        assert!(stderr.contains(says) && !stderr.contains("panicked"), "{pointer}: {stderr}");
    }
    for (tensor, bytes, says) in [
        ("batch.actions", &9i64.to_le_bytes()[..], "no such action"),
        ("batch.filled", &0i64.to_le_bytes()[..], "shorter"),
        ("batch.avail_actions", &0i32.to_le_bytes()[..], "avail_actions"),
        ("batch.joint_input", &9f32.to_le_bytes()[..], "not everything was delivered"),
        ("batch.reward", &f32::NAN.to_le_bytes()[..], "NaN"),
    ] {
        let updates = Updates::new();
        updates.overwrite(tensor, bytes);
        fail(&updates.verify(), 1, &["update-2.safetensors", says]);
    }
    let updates = Updates::new();
    std::fs::write(updates.at("update-2.safetensors"), b"no tensors").unwrap();
    fail(&updates.verify(), 1, &["update-2.safetensors"]);
    // A gap is no end.
    std::fs::rename(updates.at("update-2.safetensors"), updates.at("update-3.safetensors")).unwrap();
    fail(&updates.verify(), 1, &["no update-2.safetensors"]);
    std::fs::remove_file(updates.at("update-1.safetensors")).unwrap();
    fail(&updates.verify(), 1, &["no update-1.safetensors"]);
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
        assert!(table.contains("all 10 comparisons hold"), "{table}");
        let said = succeed(&format!("inspect {}", trace.display()));
        assert!(said.starts_with("trace of s"), "{said}");
    }
    // With another policy it is another story.
    let words = "spawn --agents 4 --p 0.4 --episodes 3 --imputer value-aware";
    succeed(&format!("{words} --record {}", trace.display()));
    fail(&format!("verify {} --policy untrained", trace.display()), 1, &["comparisons do not hold"]);
}

#[test]
fn who_was_absent_is_recorded_and_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let words = "spawn --task hear-see --p 0.5 --episodes 8 --seed 2 --chaos kill=0.05:300ms,stop=0.05:200ms";
    for (name, way) in [("own.json", "--in-process"), ("processes.json", "--on-failure continue")] {
        succeed(&format!("{words} {way} --record {}", at(name)));
        let table = succeed(&format!("verify {}", at(name)));
        assert!(table.contains("all 10 comparisons hold"), "{table}");
    }
    let bytes = ["own.json", "processes.json"].map(|name| std::fs::read(at(name)).unwrap());
    assert!(bytes[0] == bytes[1], "the same agents are absent in either");
    let trace: Value = serde_json::from_slice(&bytes[0]).unwrap();
    assert_eq!(trace["format_version"], 1);
    let episodes = trace["episodes"].as_array().unwrap();
    let all = || episodes.iter().flat_map(|episode| episode["presence"].as_array().into_iter().flatten());
    let count =
        |which: u64| all().flat_map(|step| step.as_array().unwrap()).filter(|it| **it == which).count();
    assert!(count(2) > 5 && count(3) > 0, "{} absent, {} anew", count(2), count(3));
    assert!(succeed(&format!("inspect {}", at("own.json"))).contains("decisions of absent agents, 0 missed"));
    // An agent that was started anew remembers nothing, and one that went on does.
    let edited = |from: &str, to: &str| {
        let text = String::from_utf8(bytes[0].clone()).unwrap();
        let parts = text.split("\"presence\":").enumerate().map(|(at, part)| {
            let (array, rest) = if at == 0 { ("", part) } else { part.split_at(part.find("]]").unwrap()) };
            format!("{}{}{rest}", if at == 0 { "" } else { "\"presence\":" }, array.replace(from, to))
        });
        std::fs::write(at("edited.json"), parts.collect::<String>()).unwrap();
        format!("verify {}", at("edited.json"))
    };
    fail(&edited("3", "0"), 1, &["do not hold"]);
    fail(&edited("3", "4"), 1, &["a presence is 0 to 3"]);
    fail(&edited("2", "0"), 1, &["did not decide"]);
}

#[test]
fn a_newer_format_is_refused_by_name_and_version() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("newer.json");
    for rest in ["\"episodes\": []", "\"episodes\": {\"otherwise\": 1}"] {
        std::fs::write(&path, format!("{{\"format_version\": 2, \"version\": \"9.9.9\", {rest}}}")).unwrap();
        for command in ["verify", "inspect", "replay --html page.html"] {
            fail(
                &format!("{command} {}", path.display()),
                1,
                &["newer.json", "version 2", "vamaro-swarm 9.9.9", "up to 1"],
            );
        }
    }
}

#[test]
fn tampering_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, trace) = (data("recordings/spread-xy-2.json"), data("traces/hear-see/trace.json"));
    let policy = data("traces/hear-see").display().to_string();
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
        fail(&format!("verify {path} --policy {policy}"), 1, &["do not hold"]);
    }
}

#[test]
fn broken_recordings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, trace) = (data("recordings/spread-xy-2.json"), data("traces/hear-see/trace.json"));
    let policy = data("traces/hear-see").display().to_string();
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
        let output = run(&format!("verify {path} --policy {policy}"));
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
    std::fs::write(at("config.json"), r#"{"kind": "weather", "task": "hear-see"}"#).unwrap();
    let output = run(&format!("verify {}", at("")));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("skipped"), "what is unknown is listed");
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

/// What a command prints with `--json`, and its exit code.
fn json(words: &str) -> (Value, Option<i32>) {
    let output = run(&format!("{words} --json"));
    (serde_json::from_slice(&output.stdout).unwrap(), output.status.code())
}

#[test]
fn programs_read_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::copy(data("recordings/hear-see.json"), at("a.json")).unwrap();
    let (found, code) = json(&format!("verify {}", at("a.json")));
    assert_eq!((code, &found["holds"], &found["error"]), (Some(0), &Value::Bool(true), &Value::Null));
    assert_eq!(found["comparisons"].as_array().unwrap().len(), 5);
    let first = &found["comparisons"][0];
    assert!(first["deviation"].as_f64() <= first["tolerance"].as_f64() && first["holds"] == true, "{first}");

    let pointer = "/episodes/0/team_reward/3";
    let tampered = tampered(&data("recordings/hear-see.json"), folder.path(), pointer, Value::from(-1.0));
    let (found, code) = json(&format!("verify {tampered}"));
    assert_eq!((code, &found["holds"]), (Some(1), &Value::Bool(false)));
    let wrong = found["comparisons"].as_array().unwrap().iter().find(|one| one["holds"] == false).unwrap();
    assert_eq!(wrong["worst"]["step"], 3, "{wrong}");

    // Errors are in the object too, and their exit codes stay what they are.
    std::fs::write(at("0.json"), "{").unwrap();
    let (found, code) = json(&format!("verify {}", at("")));
    assert_eq!(code, Some(1));
    assert!(found["failed"][0]["error"].as_str().unwrap().contains("0.json"), "{found}");
    let (found, code) = json(&format!("verify {}", at("missing")));
    assert_eq!(code, Some(2));
    assert!(found["error"].as_str().unwrap().contains("there is no file"), "{found}");
}

#[test]
fn programs_read_what_a_file_holds() {
    let (policy, _) = json(&format!("inspect {}", data("traces/hear-see/policy.safetensors").display()));
    assert_eq!((&policy["kind"], &policy["task"]), (&Value::from("policy"), &Value::from("hear-see")));
    assert_eq!(policy["predictors"][0]["name"], "value-aware");
    assert!(
        policy["tensors"].as_array().unwrap().iter().any(|tensor| tensor["name"] == "actors.0.fc1.weight")
    );
    let (trace, _) = json(&format!("inspect {}", data("traces/hear-see/trace.json").display()));
    assert_eq!((&trace["kind"], &trace["about"]["task"]), (&Value::from("trace"), &Value::from("hear-see")));
    let rate = trace["episodes"][0]["delivery_rate"].as_f64().unwrap();
    assert!((0.0..=1.0).contains(&rate), "{rate}");
    let old = data("checkpoints/before-early-ends/checkpoint.safetensors");
    let (checkpoint, code) = json(&format!("inspect {}", old.display()));
    assert_eq!((code, &checkpoint["kind"]), (Some(0), &Value::from("checkpoint")));
    assert!(checkpoint["timesteps"].as_u64().unwrap() > 0 && checkpoint["config"]["task"].is_string());
    assert_eq!(run("inspect no-such-file --json").status.code(), Some(2));
}

#[test]
fn programs_read_whether_a_machine_is_ready() {
    let (found, code) = json("doctor");
    assert_eq!(found["ready"], code == Some(0));
    let checks = found["checks"].as_array().unwrap();
    let names: Vec<&str> = checks.iter().map(|check| check["check"].as_str().unwrap()).collect();
    assert_eq!(names, ["cores", "shared_memory", "place", "open_files", "processes", "dead_swarms"]);
    assert!(checks.iter().all(|check| check["words"].is_string()));
}

#[test]
fn a_trace_without_a_policy_says_where_to_put_one() {
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("trace.json");
    std::fs::copy(data("traces/hear-see/trace.json"), &alone).unwrap();
    fail(&format!("verify {}", alone.display()), 2, &["--policy", "policy.safetensors"]);
}
