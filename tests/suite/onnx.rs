//! Policies that are ONNX files, through the library and the real binary. `tests/data/onnx/make.py` made the files, and
//! `make_newer.py` beside it one by PyTorch's newer exporter.

// Helpers of tests are tests, which clippy does not see.
#![allow(clippy::unwrap_used)]

use std::path::Path;

use serde_json::Value;
use vamaro_swarm::agent::dims;
use vamaro_swarm::environment::Task;
use vamaro_swarm::nn::{Meta, Policy, Scratch, import};

use crate::common::{data, fail, succeed};

/// Files that PyTorch exported, and their tasks.
const TEAMS: [(&str, &str); 3] = [("mlp", "hear-see"), ("gru", "spread-xy-2"), ("own", "speaker-listener")];

/// Whether there is nothing to test.
fn skipped() -> bool {
    if !cfg!(feature = "onnx") {
        println!("skipped: built without the feature onnx");
    }
    !cfg!(feature = "onnx")
}

fn file(name: &str) -> String {
    data("onnx").join(name).display().to_string()
}

fn floats(value: &Value) -> Vec<f32> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap() as f32).collect()
}

fn json(words: &str) -> Value {
    serde_json::from_str(&succeed(words)).unwrap()
}

/// That each actor says what PyTorch says, in a row beside others, twice.
fn says_what_pytorch_says(policy: &Policy, case: &Value, name: &str) {
    let estimates: Vec<_> = case["estimates"].as_array().unwrap().iter().map(floats).collect();
    let mut scratch = Scratch::default();
    for agent in 0..policy.dims().n_agents {
        let (actor, n_actions) = (policy.actor(agent), policy.dims().n_actions);
        let mut state = actor.state(1);
        for rows in [1, 3] {
            state.start(rows);
            for (step, estimate) in estimates.iter().enumerate() {
                let mut logits = vec![f32::NAN; rows * n_actions];
                let seen = [estimate.clone(), vec![0.5; (rows - 1) * estimate.len()]].concat();
                actor.step(rows, &seen, &[], &mut state, &mut scratch, &mut logits).unwrap();
                let expected = floats(&case["logits"][agent][step]);
                for (found, expected) in logits.iter().zip(&expected) {
                    assert!(
                        (found - expected).abs() < 1e-5,
                        "{name}, agent {agent}, step {step}: {found}, not {expected}"
                    );
                }
                assert!(
                    logits[expected.len()..n_actions].iter().all(|logit| *logit == f32::MIN),
                    "{logits:?}"
                );
            }
        }
    }
}

#[test]
fn graphs_say_what_pytorch_says_and_so_do_our_networks_with_the_same_weights() {
    if skipped() {
        return;
    }
    let expected: Value = serde_json::from_slice(&std::fs::read(file("expected.json")).unwrap()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, task) in TEAMS {
        let dims = dims(Task::parse(task).unwrap().spec());
        let graphs = Policy::open(Path::new(&file(&format!("{name}.toml"))), &dims).unwrap();
        says_what_pytorch_says(&graphs, &expected[name], name);
        let kept = folder.path().join(name);
        graphs.save(&kept).unwrap();
        says_what_pytorch_says(&Policy::open(&kept, &dims).unwrap(), &expected[name], "as a policy file");
        if name != "own" {
            let weights = data("onnx").join(format!("{name}.th"));
            let ours = import(&weights, &[], &dims, Meta::new(task, 0)).unwrap();
            says_what_pytorch_says(&ours, &expected[name], "ours");
        }
    }
    // The same actor by PyTorch's newer exporter, which splits gates by sequences.
    let path = file("gru-dynamo.toml");
    let newer = Policy::open(Path::new(&path), &dims(Task::parse("spread-xy-2").unwrap().spec())).unwrap();
    says_what_pytorch_says(&newer, &expected["gru"], "by the newer exporter");
    let described = folder.path().join("normalised.toml");
    let (mean, std): (Vec<f64>, Vec<f64>) =
        (0..16).map(|at| (f64::from(at) / 16.0, f64::from(at + 1) / 8.0)).unzip();
    let files = [file("mlp-0.onnx"), file("mlp-1.onnx")];
    let text = format!(
        "task = 'hear-see'\nonnx = {files:?}\n[actor]\nnormalise = {{ mean = {mean:?}, std = {std:?} }}\n"
    );
    std::fs::write(&described, text).unwrap();
    let policy = Policy::open(&described, &dims(Task::parse("hear-see").unwrap().spec())).unwrap();
    says_what_pytorch_says(&policy, &expected["normalised"], "normalised");
}

#[test]
fn teams_play_the_same_episodes_as_ours_with_the_same_weights() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, task) in &TEAMS[..2] {
        let ours = folder.path().join(format!("{name}.safetensors")).display().to_string();
        succeed(&format!("import {} --task {task} --out {ours}", file(&format!("{name}.th"))));
        assert!(succeed(&format!("inspect {ours}")).contains("unknown, and so are env steps and seed"));
        let played = |policy: &str| {
            let words = format!(
                "spawn --policy {policy} --p 0.5 --imputer hold --greedy --episodes 6 --worlds 3 --json"
            );
            let mut played = json(&words);
            let whole = played["imputation_rmse"].take();
            (
                played["return_mean"].clone(),
                played["return_std"].clone(),
                played["delivery_rate"].clone(),
                whole,
            )
        };
        let expected = played(&ours);
        assert!(expected.0.is_number() && expected.2.is_number(), "{expected:?}");
        assert_eq!(played(&file(&format!("{name}.toml"))), expected, "{name}");

        let kept = folder.path().join("kept.safetensors").display().to_string();
        let printed = succeed(&format!("import --toml {} --out {kept}", file(&format!("{name}.toml"))));
        assert!(printed.contains("onnx for"), "{printed}");
        // What is fitted depends on the task alone, and goes into the file.
        succeed(&format!("fit {ours} --episodes 10"));
        succeed(&format!("fit {kept} --episodes 10"));
        let cells = |policy: &str, place: &str| {
            let words = format!(
                "evaluate {policy} --episodes 4 --levels 1,0.3 --imputers hold,velocity,kalman,zero --greedy {place} --json"
            );
            json(&words)["groups"][0]["imputers"].clone()
        };
        let expected = cells(&ours, "--in-process");
        assert_eq!(expected.as_array().map(Vec::len), Some(4));
        assert_eq!(cells(&kept, "--in-process"), expected, "{name}");
        assert_eq!(cells(&kept, ""), expected, "{name}, as processes");
    }
}

#[test]
fn a_team_on_its_own_observations_plays_alike_whatever_is_lost() {
    if skipped() {
        return;
    }
    let played = |words: &str| {
        let words = format!("spawn --policy {} --episodes 4 --worlds 2 --json {words}", file("own.toml"));
        json(&words)["return_mean"].clone()
    };
    let expected = played("--p 1 --imputer zero");
    assert!(expected.is_number());
    assert_eq!(played("--p 0 --imputer zero"), expected);
    assert_eq!(played("--p 0.5 --imputer hold"), expected);
    assert_ne!(played("--p 1 --greedy"), expected);
    // Said in the description it needs no option.
    let folder = tempfile::tempdir().unwrap();
    let greedy = folder.path().join("greedy.toml");
    let files = [file("own-0.onnx"), file("own-1.onnx")];
    let about = "[actor]\ninput = 'own'\nstates = { h = 'h_out' }\nactions = 'greedy'";
    std::fs::write(&greedy, format!("task = 'speaker-listener'\nonnx = {files:?}\n{about}\n")).unwrap();
    let words = format!("spawn --policy {} --episodes 4 --p 0 --json", greedy.display());
    assert_eq!(json(&words)["return_mean"], played("--p 1 --greedy"));
}

#[test]
fn agents_that_act_by_values_play_too() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("team.toml");
    let about = "[actor]\ninput = 'own'\noutput = 'mean-log-std'";
    let text = format!("task = 'simple-spread-continuous-3'\nonnx = {:?}\n{about}\n", file("gaussian.onnx"));
    std::fs::write(&path, text).unwrap();
    let cells = |place: &str| {
        let words =
            format!("evaluate {} --episodes 3 --levels 0.5 --imputers hold {place} --json", path.display());
        json(&words)["groups"][0]["imputers"].clone()
    };
    let sampled = cells("");
    assert!(sampled.is_array());
    assert_eq!(cells("--in-process"), sampled);
    assert_ne!(cells("--in-process --greedy"), sampled);
    let spawned = json(&format!("spawn --policy {} --episodes 2 --imputer hold --json", path.display()));
    assert!(spawned["return_mean"].is_number(), "{spawned}");
    fail(&format!("fit {} --out {}", path.display(), folder.path().join("out").display()), 2, &["discrete"]);
}

#[test]
fn what_does_not_fit_is_refused_with_what_to_do() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let refuse = |text: &str, code: i32, saying: &[&str]| {
        std::fs::write(at("team.toml"), text).unwrap();
        fail(&format!("spawn --episodes 1 --policy {}", at("team.toml").display()), code, saying);
    };
    let (mlp, gru, own) = (file("mlp-0.onnx"), file("gru.onnx"), file("own-1.onnx"));
    refuse("task = ", 2, &["team.toml", "docs/onnx.md", "line 1"]);
    refuse("task = 'hear-see'\nonxn = 'a'", 2, &["onxn"]);
    refuse("task = 'hear-se'\nonnx = 'a'", 2, &["hear-se"]);
    refuse("task = 'hear-see'\nonnx = 'nowhere.onnx'", 2, &["there is no file", "nowhere.onnx"]);
    refuse(&format!("task = 'spread-xy-4'\nonnx = [{mlp:?}]"), 2, &["4 agents", "1 ONNX files"]);
    refuse(&format!("task = 'spread-xy-4'\nonnx = {mlp:?}"), 2, &["sees 16 values", "has 24", "`input`"]);
    refuse(&format!("task = 'spread-xy-2'\nonnx = {gru:?}"), 2, &["sees 14 values", "agent-id"]);
    let normal = |values: &str| format!("task = 'hear-see'\nonnx = {mlp:?}\n[actor]\nnormalise = {values}");
    refuse(&normal("{ mean = [1.0], std = [1.0] }"), 2, &["sees 16"]);
    refuse(&normal("{ mean = [1.0], std = [0.0] }"), 2, &["no `std` is zero"]);
    let listener =
        |more: &str| format!("task = 'speaker-listener'\nonnx = [{own:?}, {own:?}]\n[actor]\n{more}");
    refuse(&listener("input = 'own'"), 2, &["its input `h`", "`next_h`", "states"]);
    refuse(&listener("input = 'own'\nstates = { h = 'nothing' }"), 2, &["`h`", "`nothing`"]);
    refuse(
        &normal("{ mean = [1.0], std = [1.0] }").replace("normalise", "output = 'mean-log-std' #"),
        2,
        &["logits"],
    );

    // Graphs that are none, or too much.
    let described = "task = 'hear-see'\nonnx = 'graph.onnx'";
    std::fs::write(at("graph.onnx"), "no graph").unwrap();
    refuse(described, 2, &["team.toml", "the ONNX file"]);
    std::fs::File::create(at("graph.onnx")).unwrap().set_len(3 << 30).unwrap();
    refuse(described, 1, &["graph.onnx"]);
    for operator in ["Conv", "Rexu"] {
        let mut other = std::fs::read(&mlp).unwrap();
        // The kind of a node is its field 4.
        let found = 2 + other.windows(6).position(|part| part == b"\x22\x04Relu").unwrap();
        other[found..found + 4].copy_from_slice(operator.as_bytes());
        std::fs::write(at("graph.onnx"), other).unwrap();
        refuse(described, 2, &["the ONNX file", operator]);
    }
    std::fs::write(at("graph.onnx"), with_weights_elsewhere()).unwrap();
    refuse(described, 2, &["the ONNX file", "external_data=False"]);
    // Zeros are fine, and nothing else is.
    let tiny = format!("{{ mean = {:?}, std = {:?} }}", [0.0; 16], [1e-38; 16]);
    std::fs::write(at("team.toml"), normal(&tiny)).unwrap();
    let words = format!(
        "evaluate {} --episodes 1 --levels 1 --imputers hold --in-process",
        at("team.toml").display()
    );
    fail(&words, 1, &["ONNX actor of agent-", "it says"]);
    let words = format!("spawn --episodes 1 --policy {mlp}");
    fail(&words, 2, &["is an ONNX file", "import --onnx"]);
    fail(&format!("import --onnx {mlp} --out {}", at("out").display()), 2, &["--task"]);
    assert!(!at("out").exists());
}

/// An ONNX file with a weight in another one, as PyTorch writes it by default.
fn with_weights_elsewhere() -> Vec<u8> {
    let part = |number: u8, bytes: &[u8]| [&[number << 3 | 2, bytes.len() as u8][..], bytes].concat();
    let entry =
        |key: &str, value: &str| part(13, &[part(1, key.as_bytes()), part(2, value.as_bytes())].concat());
    let place = [entry("location", "weights.bin"), entry("offset", "0"), entry("length", "16")].concat();
    let tensor = [vec![0x08, 4, 0x10, 1], part(8, b"w"), place, vec![0x70, 1]].concat();
    let node = [part(1, b"w"), part(2, b"y"), part(4, b"Relu")].concat();
    let graph = [part(1, &node), part(2, b"graph"), part(5, &tensor), part(12, &part(1, b"y"))].concat();
    [vec![0x08, 8], part(8, &[0x10, 17]), part(7, &graph)].concat()
}

/// Bytes that are nearly an ONNX file make an error or a policy, and no panic. Which ones is fixed, so that a fault is found again.
#[test]
fn damaged_files_are_errors() {
    if skipped() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (name, task, about) in [
        ("mlp-0", "hear-see", ""),
        ("gru", "spread-xy-2", "[actor]\nagent-id = true"),
        ("gaussian", "simple-spread-continuous-3", "[actor]\ninput = 'own'\noutput = 'mean-log-std'"),
    ] {
        let dims = dims(Task::parse(task).unwrap().spec());
        let path = folder.path().join("team.toml");
        std::fs::write(&path, format!("task = '{task}'\nonnx = 'graph.onnx'\n{about}")).unwrap();
        let bytes = std::fs::read(file(&format!("{name}.onnx"))).unwrap();
        let mut refused = 0;
        for seed in 0..60_usize {
            let mut damaged = bytes.clone();
            let at = |n: usize| {
                (seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(7 * n as u32 + 3) % bytes.len()
            };
            for n in 0..1 + seed % 4 {
                damaged[at(n)] = (at(n + 5) % 256) as u8;
            }
            if seed % 10 == 0 {
                damaged.truncate(at(9));
            }
            std::fs::write(folder.path().join("graph.onnx"), &damaged).unwrap();
            refused += usize::from(Policy::open(&path, &dims).is_err());
        }
        assert!((6..60).contains(&refused), "{name}: {refused}");
    }
}
