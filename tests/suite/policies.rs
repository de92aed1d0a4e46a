//! Policies through the library, as a user has them: imported, saved, opened, run, and read by Python.

// Helpers of tests are tests, which clippy does not see.
#![allow(clippy::unwrap_used)]

use crate::common::acting::{ACTING, acting};
use crate::common::{fail, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use vamaro_swarm::environment::Task;
use vamaro_swarm::nn::{self, ActorKind, Dims, Meta, Policy, PolicyFile, Scratch, Sharing};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/import").join(name)
}

fn expected() -> Value {
    serde_json::from_slice(&std::fs::read(data("expected.json")).unwrap()).unwrap()
}

fn floats(value: &Value) -> Vec<f32> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap() as f32).collect()
}

fn dims() -> Dims {
    let expected = expected();
    let size = |name: &str| expected[name].as_u64().unwrap() as usize;
    let (n_agents, joint, predicted) = (size("n_agents"), size("joint"), size("predicted"));
    Dims {
        task: "toy".to_string(),
        n_agents,
        joint,
        predicted,
        n_actions: size("n_actions"),
        agents: Vec::new(),
    }
}

fn import(name: &str) -> Policy {
    let predictors = [("value-aware".to_string(), data("network.th"))];
    let meta = Meta { steps: 1000, origin: "a test".to_string(), ..Meta::new("toy", 3) };
    nn::import(&data(&format!("{name}.th")), &predictors, &dims(), meta).unwrap()
}

fn assert_close(found: &[f32], expected: &[f32]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 2e-6, "{found} is not {expected}");
    }
}

#[test]
fn imported_networks_compute_what_they_did() {
    let expected = expected();
    let dims = dims();
    let folder = tempfile::tempdir().unwrap();
    for name in ["mlp-separate", "gru-shared"] {
        let imported = import(name);
        let path = folder.path().join(name);
        imported.save(&path).unwrap();
        for policy in [imported, Policy::open(&path, &dims).unwrap()] {
            let inputs: Vec<_> = expected["inputs"].as_array().unwrap().iter().map(floats).collect();
            let mut scratch = Scratch::default();
            for agent in 0..dims.n_agents {
                let actor = policy.actor(agent);
                let mut state = actor.state(1);
                let mut logits = vec![0.0; dims.n_actions];
                for (step, inputs) in inputs.iter().enumerate() {
                    actor.step(1, inputs, &[], &mut state, &mut scratch, &mut logits).unwrap();
                    assert_close(&logits, &floats(&expected[name][agent][step]));
                }
            }
            let predictor = policy.predictor("value-aware").unwrap();
            let (mut state, mut out) = (predictor.state(1), vec![0.0; 2 * dims.predicted]);
            for (step, inputs) in inputs.iter().enumerate() {
                predictor.step(1, inputs, &[], &mut state, &mut scratch, &mut out);
                assert_close(&out, &floats(&expected["prediction"][step]));
            }
        }
    }
}

#[test]
fn what_was_imported_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    import("gru-shared").save(&path).unwrap();
    let file = PolicyFile::read(&path).unwrap();
    assert_eq!((file.networks.actor, file.networks.sharing), (ActorKind::Gru, Sharing::Shared));
    assert_eq!((file.networks.hidden, file.networks.predictors[0].hidden), (4, 3));
    assert_eq!((&file.meta.task[..], file.meta.steps, &file.meta.origin[..]), ("toy", 1000, "a test"));
}

/// What a team of a policy file makes of twenty episodes, most of whose observations are lost.
fn play(policy: &Path, imputer: &str) -> [Value; 3] {
    let words = format!(
        "spawn --task hear-see --policy {} --imputer {imputer} --p 0.3 --episodes 20 --in-process --json",
        policy.display()
    );
    let summary: Value = serde_json::from_str(&succeed(&words)).unwrap();
    ["return_mean", "return_ci95", "imputation_rmse"].map(|key| summary[key].clone())
}

#[test]
fn a_policy_that_is_exported_is_the_same_but_for_rounding() {
    let folder = tempfile::tempdir().unwrap();
    let [full, half, rounded, again] =
        ["full", "half", "rounded", "again"].map(|name| folder.path().join(name));
    let policy = acting(Task::parse("hear-see").unwrap().spec());
    policy.save(&full).unwrap();
    succeed(&format!("export {} --out {}", full.display(), half.display()));
    let exported = Policy::open(&half, policy.dims()).unwrap();
    assert_eq!(exported.networks(), policy.networks());
    let values =
        |policy: &Policy| policy.tensors().flat_map(|(_, t)| t.values().to_vec()).collect::<Vec<_>>();
    for (exported, value) in values(&exported).into_iter().zip(values(&policy)) {
        // Eleven bits, and below the normal numbers of f16 steps of 2^-24.
        assert!((exported - value).abs() <= value.abs() / 2048.0 + 2f32.powi(-25), "{value}: {exported}");
    }
    // Once rounded, it stays the same in either precision.
    exported.save(&rounded).unwrap();
    succeed(&format!("export {} --out {}", rounded.display(), again.display()));
    assert_eq!(std::fs::read(&half).unwrap(), std::fs::read(&again).unwrap());
    for imputer in ACTING {
        assert_eq!(play(&half, imputer), play(&rounded, imputer), "{imputer}");
    }
    assert_ne!(play(&half, ACTING[0]), play(&half, ACTING[1]));
    let import = format!("import {} --task hear-see", half.display());
    fail(&import, 2, &["is already a policy file", "every command takes it as it is"]);
}

/// Runs the snippet in `docs/policy-file.md`, word for word, and compares what it prints.
#[test]
fn the_documented_python_computes_the_same_logits() {
    let python = |arguments: &[&str]| Command::new("python3").args(arguments).output();
    match python(&["-c", "import numpy, safetensors"]) {
        Ok(output) if output.status.success() => {}
        _ => return eprintln!("skipped: there is no python3 with numpy and safetensors"),
    }
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/policy-file.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, behind) = page.split_once("```python\n").expect("the page has a snippet");
    let (snippet, _) = behind.split_once("```").expect("the snippet ends");

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("policy.safetensors");
    let policy = import("mlp-separate");
    policy.save(&path).unwrap();
    let output = python(&["-c", snippet, path.to_str().unwrap()]).unwrap();
    let (printed, errors) =
        (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{errors}");

    // The snippet runs agent 1 on a joint estimate of evenly spaced numbers from -1 to 1.
    let joint = dims().joint;
    let inputs: Vec<f32> = (0..joint).map(|at| -1.0 + 2.0 * at as f32 / (joint - 1) as f32).collect();
    let mut logits = vec![0.0; dims().n_actions];
    let actor = policy.actor(1);
    actor.step(1, &inputs, &[], &mut actor.state(1), &mut Scratch::default(), &mut logits).unwrap();
    let last = printed.lines().last().expect("the snippet prints the logits");
    let found: Vec<f32> = last.split(' ').map(|word| word.parse().unwrap()).collect();
    assert_close(&found, &logits);
    assert!(printed.contains("toy"), "the snippet prints the task: {printed}");
}
