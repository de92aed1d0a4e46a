//! Imputers that know the dynamics, through the real binary: fitted, kept in policy files, and what they are worth.

// Helpers of tests are tests, which clippy does not see.
#![allow(clippy::unwrap_used)]

use crate::common::{fail, succeed};
use serde_json::Value;

/// The mean return of 100 episodes in which only what is sent at t = 0 arrives, or everything.
fn mean_return(task: &str, imputer: &str, p: f64, options: &str) -> f64 {
    let words =
        format!("spawn --task {task} --imputer {imputer} --p {p} --episodes 100 --seed 3 --json {options}");
    let summary: Value = serde_json::from_str(&succeed(&words)).unwrap();
    summary["return_mean"].as_f64().unwrap()
}

#[test]
fn with_its_own_state_right_a_team_hardly_needs_its_radio() {
    for (task, dynamics_lose, teammates_lose) in [("hear-see", 0.01, 0.01), ("spread-xy-2", 3.0, 1.0)] {
        let everything = mean_return(task, "dynamics", 1.0, "--in-process");
        let [learned, dynamics, teammates] = ["value-aware", "dynamics", "teammates"]
            .map(|imputer| everything - mean_return(task, imputer, 0.0, "--in-process"));
        assert!(learned > 8.0, "{task}: {learned}");
        assert!(dynamics < dynamics_lose, "{task}: {dynamics}");
        assert!(teammates < teammates_lose, "{task}: {teammates}");
    }
}

#[test]
fn imputers_differ_in_what_they_know() {
    let play = |imputer, p| mean_return("spread-xy-2", imputer, p, "--in-process");
    let everything = play("dynamics", 1.0);
    // Who knows the teammate's dice knows what it does.
    let shared = play("shared-dice", 0.0);
    assert!((everything - shared).abs() < 0.5, "{everything} {shared}");
    // A model without drag and contacts, in which others go on as they are.
    let [kalman, velocity] = ["kalman", "velocity"].map(|imputer| play(imputer, 0.0));
    assert!(everything - kalman > 20.0 && kalman > velocity, "{everything} {kalman} {velocity}");
    // Who the rest is left to.
    let [best, named, paper, held] =
        ["dynamics", "dynamics(acting)", "dynamics(value-aware)", "dynamics(hold)"]
            .map(|imputer| play(imputer, 0.2));
    assert_eq!(best, named, "the predictor that sees its agent's own action");
    assert!(best != paper && paper != held, "{best} {paper} {held}");
}

#[test]
fn who_is_told_the_physics_plays_as_after_a_fit_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (light, trace) = (path("light.safetensors"), path("run.trace"));
    let physics = "--physics mass=0.8,motor_noise=0.1";
    succeed(&format!("fit spread-xy-4/seed-0 --physics mass=0.8 --episodes 300 --out {light}"));
    for (given, fitted) in [("given-dynamics", "dynamics"), ("given-teammates", "teammates")] {
        let refitted =
            mean_return("spread-xy-4", fitted, 0.0, &format!("--in-process {physics} --policy {light}"));
        let told = mean_return("spread-xy-4", given, 0.0, &format!("--in-process {physics}"));
        assert_eq!(told, refitted);
        assert_ne!(told, mean_return("spread-xy-4", fitted, 0.0, &format!("--in-process {physics}")));
    }
    // Processes are told it too, and so is who thinks again what they thought.
    let told =
        |options: &str| mean_return("spread-xy-2", "given-dynamics", 0.0, &format!("{physics} {options}"));
    assert_eq!(told(&format!("--record {trace}")), told("--in-process"));
    succeed(&format!("verify {trace}"));
    let untold = "bench imputers --task spread-xy-2 --imputers given-dynamics";
    fail(untold, 2, &["nobody knows the physics of spread-xy-2 here", "`spawn` and `evaluate`"]);
}

#[test]
fn what_arrives_late_tells_agents_where_they_are() {
    for task in ["hear-see", "spread-xy-2", "spread-xy-4"] {
        let [learned, dynamics, teammates, deaf] =
            [("value-aware", 1.0), ("dynamics", 1.0), ("teammates", 1.0), ("dynamics", 0.0)].map(
                |(imputer, p)| mean_return(task, imputer, p, "--links delay(1) --no-comm-at-t0 --in-process"),
            );
        assert!(
            dynamics > learned - 1.0 && teammates > learned - 1.0,
            "{task}: {learned} {dynamics} {teammates}"
        );
        assert!(deaf < dynamics, "{task}: {deaf} {dynamics}");
    }
}

#[test]
fn agents_that_are_processes_compute_the_same() {
    for imputer in ["dynamics(maro)", "teammates", "particles"] {
        let [alone, processes] =
            ["--in-process", ""].map(|options| mean_return("spread-xy-4", imputer, 0.2, options));
        assert_eq!(alone, processes, "{imputer}");
    }
    // What arrives late is used as well, in any number of worlds.
    let [one, many] = ["--worlds 1", "--worlds 7"].map(|worlds| {
        ["teammates", "particles"].map(|imputer| {
            let options = format!("--links delay(1,1) --in-process {worlds}");
            mean_return("spread-xy-2", imputer, 0.5, &options)
        })
    });
    assert_eq!(one, many);
}

#[test]
fn fitting_changes_nothing_of_a_policy_but_what_it_knows_of_dynamics() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let run = run.display();
    succeed(&format!("train --task spread-xy-2 --steps 1000 --out {run}"));
    fail(
        &format!("spawn --task spread-xy-2 --policy {run} --imputer dynamics --episodes 1 --in-process"),
        2,
        &["holds no dynamics of spread-xy-2", "vamaro-swarm fit"],
    );
    let fitted = folder.path().join("fitted.safetensors");
    let fitted = fitted.display();
    let said = succeed(&format!("fit {run} --out {fitted}"));
    assert!(said.contains("0.7500 of it stays") && said.contains("nearer than 0.3000 m"), "{said}");
    assert!(succeed(&format!("inspect {fitted}")).contains("dynamics    fitted"));
    let play = |policy: &str| {
        succeed(&format!(
            "spawn --task spread-xy-2 --policy {policy} --imputer value-aware --p 0.2 --episodes 5 --in-process --json"
        ))
    };
    let returns = |text: &str| serde_json::from_str::<Value>(text).unwrap()["return_mean"].as_f64().unwrap();
    assert_eq!(returns(&play(&run.to_string())), returns(&play(&fitted.to_string())));
    succeed(&format!(
        "spawn --task spread-xy-2 --policy {fitted} --imputer dynamics --episodes 5 --in-process"
    ));
    // A predictor that sees the own action, beside it.
    let said = succeed(&format!("fit {fitted} --imputers acting --updates 60"));
    assert!(said.contains("predictor acting, 60 updates"), "{said}");
    let held = succeed(&format!("inspect {fitted}"));
    assert!(
        held.contains("acting (hidden 128, sees who is near, sees the own action, skip)")
            && held.contains("dynamics    fitted"),
        "{held}"
    );
    assert_eq!(returns(&play(&run.to_string())), returns(&play(&fitted.to_string())));
    succeed(&format!(
        "spawn --task spread-xy-2 --policy {fitted} --imputer acting --episodes 5 --in-process"
    ));
    // In the folder of a run, dynamics stay when it goes on; it does not go on over a predictor that would be lost.
    succeed(&format!("fit {run}"));
    succeed(&format!("train --resume --out {run} --steps 2000"));
    assert!(succeed(&format!("inspect {run}")).contains("dynamics    fitted"));
    succeed(&format!("fit {run} --imputers acting --updates 2"));
    fail(&format!("train --resume --out {run} --steps 3000"), 2, &["predictor `acting`", "would be lost"]);
    fail(&format!("fit {fitted} --imputers acting"), 2, &["has a predictor `acting`"]);
    fail(&format!("fit {run} --imputers a/b"), 2, &["--imputers"]);
    std::fs::write(folder.path().join("other.txt"), "not a policy").unwrap();
    let other = folder.path().join("other.txt");
    fail(&format!("fit {run} --out {}", other.display()), 2, &["is not a policy file; choose another"]);
    fail(&format!("fit {fitted} --imputers hold"), 2, &["\"hold\", which names another imputer"]);
    fail("fit builtin", 2, &["builtin is not a file"]);
    let said = succeed(&format!("fit {run} --episodes 1 --out {fitted}"));
    assert!(said.contains("dynamics from 1 episode\n"), "{said}");
    fail(&format!("fit {run} --episodes 0"), 2, &["--episodes"]);
    fail(&format!("fit {run} --physics damping=0.3"), 2, &["needs --out"]);
}
