//! Other physics through the real binary: the same bits wherever agents run, and said in all that is written.

// Helpers of tests are tests, which clippy does not see.
#![allow(clippy::unwrap_used)]

use std::fs;

use crate::common::{fail, succeed};
use serde_json::Value;

const PHYSICS: &str = "motor_noise=0.3,damping=0.3,mass=1.2";

fn json(words: &str) -> Value {
    serde_json::from_str(&succeed(words)).unwrap()
}

#[test]
fn a_recorded_swarm_is_the_same_anywhere_and_is_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace.json");
    let words =
        format!("spawn --task SXY-4 --p 0.4 --episodes 5 --physics {PHYSICS} --record {}", trace.display());
    let ways = ["--in-process", "--worlds 3", "--worlds 5 --in-process"];
    let traces: Vec<Vec<u8>> = ways
        .iter()
        .map(|way| {
            let said = succeed(&format!("{words} {way}"));
            assert!(said.starts_with(&format!("spread-xy-4 with physics {PHYSICS}: 4 agents")), "{said}");
            fs::read(&trace).unwrap()
        })
        .collect();
    assert!(traces.iter().all(|trace| *trace == traces[0]));
    let table = succeed(&format!("verify {}", trace.display()));
    assert!(table.contains("all 10 comparisons hold"), "{table}");
    let said = succeed(&format!("inspect {}", trace.display()));
    assert!(said.starts_with(&format!("trace of spread-xy-4 with physics {PHYSICS}\n")), "{said}");
    // Under other physics, or with other draws of the noise, that is not what happens.
    let recorded: Value = serde_json::from_slice(&traces[0]).unwrap();
    assert_eq!(recorded["physics"], PHYSICS);
    let verify_with = |change: &dyn Fn(&mut Value), code, saying: &str| {
        let mut changed = recorded.clone();
        change(&mut changed);
        fs::write(&trace, changed.to_string()).unwrap();
        fail(&format!("verify {}", trace.display()), code, &[saying]);
    };
    verify_with(&|trace| trace["physics"] = "motor_noise=0.3,damping=0.3".into(), 1, "do not hold");
    verify_with(&|trace| trace["physics"] = "damping=0.3,mass=1.2".into(), 1, "do not hold");
    verify_with(&|trace| trace["episodes"][2]["episode"] = 7.into(), 1, "do not hold");
    verify_with(
        &|trace| trace["seed"] = Value::Null,
        1,
        "motor noise, wind and the turns of targets cannot be drawn again without `seed`",
    );
    verify_with(&|trace| trace["physics"] = "gravity=1".into(), 1, "physics has no `gravity`");
}

#[test]
fn targets_cannot_be_drawn_again_without_their_address() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace.json");
    let words = "spawn --task scout-2 --policy untrained --episodes 1 --in-process --record";
    succeed(&format!("{words} {}", trace.display()));
    let recorded: Value = serde_json::from_slice(&fs::read(&trace).unwrap()).unwrap();
    let without_seed: fn(&mut Value) = |trace| trace["seed"] = Value::Null;
    for change in [without_seed, |trace| trace["episodes"][0]["episode"] = Value::Null] {
        let mut changed = recorded.clone();
        change(&mut changed);
        fs::write(&trace, changed.to_string()).unwrap();
        fail(&format!("verify {}", trace.display()), 1, &["the turns of targets cannot be drawn again"]);
    }
}

#[test]
fn physics_is_said_unless_it_is_the_default() {
    let words = "spawn --task hear-see --episodes 3 --in-process --json --p 0";
    let default = json(&format!("{words} --physics damping=0.25"));
    assert_eq!(default["return_mean"], json(words)["return_mean"]);
    assert!(default.get("physics").is_none());
    let other = json(&format!("{words} --physics damping=0.3"));
    assert_eq!(other["physics"], "motor_noise=0,damping=0.3,mass=1");
    assert_ne!(other["return_mean"], default["return_mean"]);
}

#[test]
fn cells_of_other_physics_are_kept_apart() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().display();
    let words = format!(
        "evaluate builtin --task spread-xy-2 --imputers hold --episodes 20 --levels 1,0 --report {report}"
    );
    let said = succeed(&format!("{words} --in-process --physics {PHYSICS}"));
    let said = said.replace("\n  ", " ");
    assert!(said.contains(&format!("20 episodes each with physics {PHYSICS}\nuniform actions")), "{said}");
    let text = |file: &str| fs::read_to_string(folder.path().join(file)).unwrap();
    for file in ["results.json", "report.html", "table.md"] {
        assert!(text(file).contains(PHYSICS), "{file}");
    }
    let results: Value = serde_json::from_str(&text("results.json")).unwrap();
    assert_eq!(results["settings"]["physics"], PHYSICS);
    let cells = text("cells.jsonl");
    fail(
        &words,
        2,
        &[&format!("20 episodes with physics {PHYSICS}"), "this evaluation has 20 episodes, seed 0"],
    );
    assert_eq!(text("cells.jsonl"), cells);
    // As processes, from the beginning: the same returns, of the random team as well.
    fs::remove_file(folder.path().join("cells.jsonl")).unwrap();
    succeed(&format!("{words} --worlds 7 --physics {PHYSICS}"));
    let again: Value = serde_json::from_str(&text("results.json")).unwrap();
    assert_eq!(again["groups"], results["groups"]);
    let default = json(&format!("{} --in-process --json", words.split(" --report").next().unwrap()));
    assert_ne!(default["groups"][0]["random"], results["groups"][0]["random"], "its agents are as heavy");
}

#[test]
fn a_run_keeps_its_physics() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let train = format!(
        "train --task hear-see --steps 600 --set test_episodes=5 --in-process --out {}",
        at("run").display()
    );
    succeed(&format!("{train} --physics {PHYSICS}"));
    let config = fs::read_to_string(at("run/config.toml")).unwrap();
    assert!(config.contains(&format!("physics = \"{PHYSICS}\"\n")), "{config}");
    let said = succeed(&format!("inspect {}", at("run").display()));
    assert!(said.contains(&format!("trained by vamaro-swarm with physics {PHYSICS}\n")), "{said}");
    let resume = format!("train --resume --steps 1200 --in-process --out {}", at("run").display());
    fail(&format!("{resume} --physics mass=2"), 2, &["other settings", "`physics` was", "mass=2"]);
    succeed(&resume);
    // What was interrupted is what was not, and what was trained with other physics is something else.
    let whole = |name: &str, physics: &str| {
        let out = at(name);
        let train = train
            .replace("--steps 600", "--steps 1200")
            .replace(&at("run").display().to_string(), &out.display().to_string());
        succeed(&format!("{train} {physics}"));
        fs::read(out.join("metrics.csv")).unwrap()
    };
    let metrics = fs::read(at("run/metrics.csv")).unwrap();
    assert_eq!(whole("whole", &format!("--set physics={PHYSICS}")), metrics);
    assert_ne!(whole("default", ""), metrics);
}

#[test]
fn physics_that_cannot_be_is_refused() {
    for command in ["spawn", "evaluate builtin --task hear-see", "train --dry-run", "fit policy.safetensors"]
    {
        for (physics, says) in [
            ("dampng=0.3", "did you mean `damping`?"),
            ("gravity=1", "there are motor_noise, damping, mass, wind"),
            ("damping=-0.1", "`damping` is \"-0.1\", expected a number from 0 to 1"),
            ("mass=0", "expected a number from 0.01 to 100"),
            ("0.3", "expected NAME=VALUE"),
        ] {
            fail(&format!("{command} --physics {physics}"), 2, &["--physics", says]);
        }
    }
    fail("train --dry-run --set physics=dampng=1", 2, &["--set", "`physics`", "did you mean `damping`?"]);
    fail("train --dry-run --set physics=1", 2, &["--set", "`physics`"]);
}
