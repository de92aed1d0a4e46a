//! `evaluate` through the real binary: the same numbers wherever agents run, sweeps that go on, requirements.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::common::{self, Swarm, assert_gone, command, fail, run, stderr, succeed};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

/// A sweep of a second or less.
const SMALL: &str =
    "evaluate builtin --task hear-see --episodes 30 --levels 1,0.3 --modes uniform,asymmetric,dynamic";

fn json(words: &str) -> Value {
    serde_json::from_str(&succeed(words)).unwrap()
}

/// What was found, without who made it, when and how.
fn findings(results: &Value) -> Value {
    let parts = ["format", "version", "settings", "contenders", "groups", "aggregates", "claims"];
    parts.iter().map(|part| (part.to_string(), results[part].clone())).collect()
}

fn results(folder: &Path) -> Value {
    findings(&serde_json::from_str(&fs::read_to_string(folder.join("results.json")).unwrap()).unwrap())
}

#[test]
fn one_parameter_of_links_may_be_swept() {
    let folder = tempfile::tempdir().unwrap();
    let words =
        "evaluate builtin --task hear-see --levels 1,0.2 --imputers hold,dynamics --episodes 20 --in-process";
    let sweep = |links: &[&str], more: &[&str]| {
        let mut command = command(words);
        for links in links {
            command.args(["--links", links]);
        }
        command.args(more).output().unwrap()
    };
    let links = ["gilbert(loss=0.8, burst=[5,20])", "delay([0,4])"];
    let output = sweep(&links, &["--json", "--report", folder.path().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(0), "{}", common::stderr(&output));
    let results: Value = serde_json::from_slice(&output.stdout).unwrap();
    let axis = &results["axes"][0];
    assert_eq!((&axis["links"], &axis["parameter"]), (&json!(links[0]), &json!("burst")));
    assert_eq!(axis["points"][1], json!({"value": 20.0, "condition": "gilbert(loss=0.8, burst=20)"}));
    let group = &results["groups"][0];
    let cells = group["imputers"][0]["cells"].as_array().unwrap();
    let mean = |condition: Value| {
        cells.iter().find(|cell| cell["condition"] == condition).unwrap()["mean"]["value"].as_f64().unwrap()
    };
    // Bursts of five steps are independent losses, draw for draw.
    let [independent, level] = [json!("gilbert(loss=0.8, burst=5)"), json!({"level": 0.2})].map(mean);
    assert_eq!(independent, level);
    let profile = &group["profiles"][0];
    assert_eq!((&profile["axis"], &profile["imputer"]), (&json!(0), &json!("hold")));
    let difference = profile["differences"][0]["value"].as_f64().unwrap();
    assert!((difference - (mean(json!("gilbert(loss=0.8, burst=20)")) - level)).abs() < 1e-9);
    assert_eq!(group["profiles"].as_array().unwrap().len(), 4);
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(read("sweeps.svg").contains(">burst</text>"));
    assert!(read("report.html").contains("Over burst, gilbert(loss=0.8, burst=[5,20])"));
    assert!(!folder.path().join("modes.svg").exists(), "they are on axes");
    // Without a list nothing of this is there.
    let output = sweep(&["delay(4)"], &["--json"]);
    assert!(!common::stderr(&output).contains("error"), "{}", common::stderr(&output));
    let plain: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&plain["axes"], &plain["groups"][0]["profiles"]), (&Value::Null, &Value::Null));
    let output = sweep(&["delay([0,4], [1,2])"], &[]);
    assert!(common::stderr(&output).contains("only one parameter may have a list"));
}

#[test]
fn the_same_numbers_wherever_agents_run() {
    let processes = findings(&json(&format!("{SMALL} --json")));
    let imputers = processes["groups"][0]["imputers"].as_array().unwrap();
    let names: Vec<&str> = imputers.iter().map(|imputer| imputer["imputer"].as_str().unwrap()).collect();
    assert_eq!(names, ["value-aware", "maro", "dynamics", "hold", "kalman", "teammates", "velocity", "zero"]);
    assert!(imputers.iter().all(|imputer| imputer["cells"].as_array().unwrap().len() == 5));
    for words in
        ["--in-process --threads 1", "--in-process --worlds 7", "--worlds 30", "--wait spin --worlds 11"]
    {
        assert_eq!(findings(&json(&format!("{SMALL} --json {words}"))), processes, "{words}");
    }
    let other = findings(&json(&format!("{SMALL} --json --in-process --seed 1")));
    assert_ne!(other["groups"], processes["groups"], "another seed is another sample");
}

/// A sweep of a second or less under these links too.
fn under(links: &[&str], words: &str) -> Command {
    let mut command = command(&format!("{SMALL} --imputers value-aware,dynamics {words}"));
    links.iter().for_each(|links| {
        command.args(["--links", links]);
    });
    command
}

#[test]
fn any_links_can_be_a_condition() {
    let links = ["gilbert(0.2,0.3) + delay(1, 1)", "delay(2)"];
    let of = |words: &str| {
        let output = under(&links, words).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        findings(&serde_json::from_slice(&output.stdout).unwrap())
    };
    let processes = of("--json");
    for words in ["--json --in-process --threads 2 --worlds 7", "--json --worlds 30"] {
        assert_eq!(of(words), processes, "{words}");
    }
    let imputers = |all: &Value| all["groups"][0]["imputers"].as_array().unwrap().clone();
    for imputer in imputers(&processes) {
        let cells = imputer["cells"].as_array().unwrap();
        let names: Vec<&Value> = cells[5..].iter().map(|cell| &cell["condition"]).collect();
        assert_eq!(names, ["gilbert(0.2, 0.3) + delay(1, 1)", "delay(2, 0)"]);
        let scores: Vec<f64> = cells.iter().map(|cell| cell["score"]["value"].as_f64().unwrap()).collect();
        assert!(scores[5] != scores[6] && scores[5] != 1.0, "{scores:?}");
        // Whoever knows what it did itself misses nothing that is late here.
        let misses = scores[5..].iter().all(|score| *score < 0.999);
        assert_eq!(misses, imputer["imputer"] == "value-aware", "{scores:?}");
    }
    // What was played before is played as before.
    let without = findings(&json(&format!("{SMALL} --imputers value-aware,dynamics --in-process --json")));
    for (imputer, before) in imputers(&processes).iter().zip(imputers(&without)) {
        assert_eq!(imputer["cells"].as_array().unwrap()[..5], before["cells"].as_array().unwrap()[..]);
        assert_eq!(imputer["score_area"], before["score_area"]);
    }
    // However it is written, a level is a level.
    let words = "evaluate builtin --task hear-see --episodes 30 --imputers value-aware,dynamics --levels 1 --in-process \
                 --json --links level(p=0.3)";
    let level = json(words);
    assert_eq!(imputers(&level)[0]["cells"][1], imputers(&without)[0]["cells"][1]);
}

#[test]
fn cells_under_links_are_found_again_unless_the_links_have_changed() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("who hears.txt");
    fs::write(
        &file,
        "1 0.5
1 1
",
    )
    .unwrap();
    let matrix = format!("matrix({}) + delay(1)", file.display());
    let report = folder.path().join("report");
    let play = || {
        let links = ["gilbert(0.2, 0.3)", &matrix];
        let words = format!("--in-process --report {}", report.display());
        let output = under(&links, &words)
            .args(["--require", "gilbert( 0.2,0.3 ) imputer=dynamics score>=0.5"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(stderr(&output).contains("gilbert(0.2, 0.3) imputer=dynamics score>=0.5: met"));
        fs::read_to_string(report.join("cells.jsonl")).unwrap()
    };
    let cells = play();
    // A header; p = 1 once; p = 0.3, three modes, and two links with both imputers.
    assert_eq!(cells.lines().count(), 1 + 1 + 2 * 6);
    for form in
        [r#""condition":{"level":0.3},"#, r#""condition":"uniform","#, r#""condition":"gilbert(0.2, 0.3)","#]
    {
        assert_eq!(cells.matches(form).count(), 2, "{form}");
    }
    assert_eq!(play(), cells, "nothing is played twice");
    let summary = fs::read_to_string(report.join("summary.csv")).unwrap();
    assert!(summary.contains(r#","gilbert(0.2, 0.3)",,-"#), "{summary}");
    assert!(fs::read_to_string(report.join("report.html")).unwrap().contains("<dt>gilbert(p, r)</dt>"));
    fs::write(
        &file,
        "1 0.1
1 1
",
    )
    .unwrap();
    let with_others = play();
    assert_eq!(with_others.lines().count(), cells.lines().count() + 2, "other links are under the same name");
    assert!(with_others.starts_with(&cells));
}

#[test]
fn a_report_is_complete_and_an_interrupted_sweep_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    let sweep = format!("{SMALL} --in-process --worlds 5 --report");
    let text = succeed(&format!("{sweep} {}", whole.display()));
    assert!(text.contains("hear-see") && text.contains("velocity"), "{text}");
    let mut files: Vec<String> = fs::read_dir(&whole)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    let expected = [
        "cells.jsonl",
        "difference.svg",
        "episodes.csv",
        "error-by-age.svg",
        "errors.csv",
        "marl-eval.json",
        "modes.svg",
        "replays",
        "report.html",
        "results.json",
        "robustness.svg",
        "summary.csv",
        "table.md",
    ];
    assert_eq!(files, expected);

    // Stopped when some cells are finished, again and again.
    let begun = Instant::now();
    let cells = || fs::read_to_string(parts.join("cells.jsonl")).map_or(0, |text| text.lines().count());
    let mut stops = 0;
    loop {
        let before = cells();
        let mut child = command(&format!("{sweep} {} --threads 1", parts.display()))
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        while cells() < before + 2 && child.try_wait().unwrap().is_none() {
            assert!(begun.elapsed() < Duration::from_secs(60), "the sweep does not end");
            std::thread::sleep(Duration::from_millis(1));
        }
        let process = Pid::from_child(&child);
        let signal = if stops % 2 == 0 { Signal::KILL } else { Signal::TERM };
        if child.try_wait().unwrap().is_none() {
            // It may end by itself in between.
            let _ = kill_process(process, signal);
        }
        match child.wait().unwrap().code() {
            Some(0) => break,
            Some(130) | None => stops += 1,
            other => panic!("exit code {other:?}"),
        }
    }
    assert!(stops > 1, "the sweep was stopped {stops} times");
    assert_eq!(results(&parts), results(&whole));

    // Narrower or wider, nothing is played twice, and figures that say nothing any more go.
    let lines = cells();
    succeed(&format!("{sweep} {} --imputers maro", parts.display()));
    assert_eq!(cells(), lines);
    assert_eq!(results(&parts)["groups"][0]["imputers"].as_array().unwrap().len(), 1);
    assert!(!parts.join("difference.svg").exists() && parts.join("robustness.svg").exists());
    let wider = sweep.replace("--levels 1,0.3", "--levels 1,0.3,0");
    succeed(&format!("{wider} {} --imputers maro,hold", parts.display()));
    assert_eq!(cells(), lines + 2);

    // With other settings these are no cells of the sweep.
    let kept = fs::read(parts.join("cells.jsonl")).unwrap();
    let there = parts.display();
    fail(&format!("{SMALL} --report {there} --seed 1"), 2, &["seed 0", "seed 1", "--report"]);
    fail(&format!("{SMALL} --report {there} --greedy"), 2, &["sampled", "greedy"]);
    assert_eq!(fs::read(parts.join("cells.jsonl")).unwrap(), kept);
}

#[test]
fn an_interrupted_sweep_leaves_no_process() {
    let folder = tempfile::tempdir().unwrap();
    let words =
        format!("evaluate builtin --task hear-see --episodes 100000 --report {}", folder.path().display());
    let swarm = Swarm::of(&words);
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    swarm.signal_supervisor(Signal::TERM);
    let (code, _, words) = swarm.wait();
    assert_eq!(code, Some(130), "{words}");
    assert!(words.contains("the same command continues"), "{words}");
    assert_gone(&agents, &tag);
}

#[test]
fn requirements_decide_the_exit_code() {
    let check = |requirements: &[&str], code| {
        let mut command = command(&format!("{SMALL} --in-process"));
        for requirement in requirements {
            command.args(["--require", requirement]);
        }
        let output = command.output().unwrap();
        let stderr = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{requirements:?}: {stderr}");
        // Whatever comes of it, the table is there.
        assert!(String::from_utf8_lossy(&output.stdout).contains("value-aware"), "{stderr}");
        stderr
    };
    check(&["p=0.3 score>=0.5", "dynamic return>=-100", "p=1 score>=1"], 0);
    let words = check(&["p=0.3 score>=0.5", "p=0.3 imputer=zero score>=0.99"], 3);
    assert!(words.contains("imputer=zero score>=0.99: not met"), "{words}");
    let never = |requirement: &str, saying: &str| {
        let output = command(SMALL).args(["--require", requirement]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{requirement}");
        assert!(stderr(&output).contains(saying), "{requirement}: {}", stderr(&output));
    };
    never("p=0.2 score>=0.9", "p=0.2 is not played");
    never("p=0.3 imputer=lambda0 score>=0.9", "not played with lambda0");
    never("p=0.3 luck>=0.9", "is not a requirement");
    let few = "evaluate builtin --task hear-see --episodes 9 --require";
    let output = command(few).arg("p=0.2 score>=0.1").output().unwrap();
    assert_eq!((output.status.code(), stderr(&output).contains("at least 20")), (Some(2), true));
    // What a swarm uses by itself is not played, so nobody can say how it does.
    let output =
        command(SMALL).args(["--imputers", "hold", "--require", "p=0.3 score>=0.1"]).output().unwrap();
    assert!(stderr(&output).contains("its default imputer; name another"), "{}", stderr(&output));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("not played with dynamics"), "{}", stderr(&output));
}

#[test]
fn requests_that_make_no_sense() {
    fail("evaluate", 2, &["POLICY"]);
    fail("evaluate builtin", 2, &["--task"]);
    fail("evaluate no/such/policy", 2, &["no/such/policy"]);
    fail("evaluate builtin --task hear-see --levels 1,1.5", 2, &["--levels", "1.5"]);
    fail("evaluate builtin --task hear-see --levels 1,-0.5", 2, &["--levels", "-0.5"]);
    fail("evaluate builtin --task hear-see --levels 1,nan", 2, &["--levels", "nan"]);
    fail("evaluate builtin --task hear-see --levels 1,dynamic", 2, &["--levels", "dynamic"]);
    fail("evaluate builtin --task hear-see --levels 1,0.2,.2", 2, &["p=0.2 is given twice"]);
    fail("evaluate builtin --task hear-see --modes often", 2, &["--modes", "often", "dynamic"]);
    fail(
        "evaluate builtin --task hear-see --links gilbret(0.1,0.3)",
        2,
        &["no links `gilbret`", "nearest is `gilbert`"],
    );
    fail("evaluate builtin --task hear-see --links gilbert(0.1)", 2, &["`r` is missing", "gilbert(p, r)"]);
    fail("evaluate builtin --task hear-see --links delay(101)", 2, &["ticks", "100"]);
    fail("evaluate builtin --task hear-see --links level(0.20)", 2, &["--links: p=0.2 is given twice"]);
    fail(
        "evaluate builtin --task hear-see --require gilbert(0.1,0.3)score>=0.9",
        2,
        &["is not a requirement"],
    );
    fail("evaluate builtin --task hear-see --imputers lambda0", 2, &["builtin", "lambda0", "value-aware"]);
    fail("evaluate builtin --task hear-see --baseline lambda0", 2, &["--baseline", "lambda0"]);
    fail("evaluate builtin builtin --task hear-see", 2, &["the same policy"]);
    fail("evaluate builtin --task hear-see --episodes 0", 2, &["--episodes"]);
    fail("evaluate builtin --task hear-see --protocol paper --greedy", 2, &["--greedy"]);
    let policy = common::data("traces/hear-see/policy.safetensors");
    let policy = policy.display();
    fail(&format!("evaluate {policy} --task spread-xy-4"), 2, &["hear-see", "spread-xy-4"]);
    let folder = tempfile::tempdir().unwrap();
    let matrix = folder.path().join("matrix");
    fs::write(&matrix, "1 1\n1 1\n").unwrap();
    let words = format!("evaluate hear-see/seed-0 spread-xy-4/seed-0 --links {}", matrix.display());
    fail(&words, 2, &["4 agents need 4 rows"]);
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let words = format!("{SMALL} --report {}", file.display());
    fail(&words, 1, &["cannot create the folder"]);
    fs::write(folder.path().join("cells.jsonl"), "something else\n").unwrap();
    fail(&format!("{SMALL} --report {}", folder.path().display()), 2, &["cells.jsonl", "does not begin"]);
    assert_eq!(fs::read(folder.path().join("cells.jsonl")).unwrap(), b"something else\n");
    assert_eq!(run("evaluate --help").status.code(), Some(0));
}

#[test]
fn the_protocol_of_the_paper_is_a_hundred_sampled_episodes() {
    let results =
        json("evaluate builtin --task speaker-listener --protocol paper --levels 1,0 --in-process --json");
    assert_eq!(results["settings"]["episodes"], 100);
    assert_eq!(results["settings"]["greedy"], false);
}
