//! Messages that also carry what their senders have received.

use vamaro_swarm::recording::Recording;

use crate::common::{fail, run, succeed};

/// The statistics of a run, as JSON.
fn json(words: &str) -> serde_json::Value {
    serde_json::from_str(&succeed(&format!("spawn {words} --json"))).unwrap()
}

#[test]
fn what_was_lost_on_one_way_arrives_on_another() {
    let words = "--agents 4 --p 0.3 --episodes 40 --worlds 20 --in-process --imputer hold";
    let (without, with) = (json(words), json(&format!("{words} --relay --audit")));
    assert_eq!(without["delivery_rate"], with["delivery_rate"], "links are the same");
    assert!(without.get("relay").is_none() && without.get("relayed_rate").is_none());
    assert!(with["relayed_rate"].as_f64().unwrap() > 0.05, "{with}");
    let audit = &with["audit"];
    assert!(audit["relayed"].as_u64().unwrap() > 0, "{audit}");
    assert_eq!(audit["relayed"], audit["delayed"]);
    assert_eq!((&audit["altered"], &audit["leaked"], &audit["late"]), (&0.into(), &0.into(), &0.into()));
    let error = |run: &serde_json::Value| run["imputation_rmse"].as_f64().unwrap();
    assert!(error(&with) < error(&without));
}

#[test]
fn where_all_hear_the_same_there_is_nothing_to_pass_on() {
    // Who is heard is heard by all: of what others know nothing is new.
    for links in ["tdma(4)", "budget(400)", "level(1)"] {
        let run = json(&format!("--agents 4 --links {links} --episodes 4 --in-process --relay"));
        assert_eq!(run["relayed_rate"], 0.0, "{links}");
    }
}

#[test]
fn a_larger_message_takes_more_of_a_budget() {
    // 48 bytes an observation; with what is held of all four, and ages, 4 * 49.
    let words = "spawn --agents 4 --episodes 1 --in-process --links budget(195)";
    succeed(words);
    fail(&format!("{words} --relay"), 2, &["bytes = 195", "196"]);
}

#[test]
fn against_the_clock_nothing_is_newer_than_its_links_let_through() {
    let run = json("--agents 4 --p 0.3 --episodes 4 --rate 250 --relay --audit");
    assert_eq!((&run["audit"]["leaked"], &run["audit"]["altered"]), (&0.into(), &0.into()), "{run}");
}

#[test]
fn a_trace_says_so_and_is_verified() {
    let folder = tempfile::tempdir().unwrap();
    for links in ["--p 0.3", "--links level(0.5)+delay(1,1)"] {
        let [json, compact] = ["trace.json", "trace.vst"].map(|name| folder.path().join(name));
        for file in [&json, &compact] {
            let file = file.display();
            succeed(&format!("spawn --agents 4 --episodes 3 --relay {links} --in-process --record {file}"));
            let verified = succeed(&format!("verify {file}"));
            assert!(verified.contains("links: what arrived, and when"), "{verified}");
        }
        let recorded = Recording::read(&json).unwrap();
        assert!(recorded.header.relay);
        assert!(Recording::read(&compact).unwrap().episodes[0].ages == recorded.episodes[0].ages);
        // Something relayed is said to be a step older than it is.
        let mut tampered: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
        let ages = tampered["episodes"][0]["ages"].as_array_mut().unwrap();
        let age = ages.iter_mut().skip(9).flat_map(|step| step.as_array_mut().unwrap());
        let mut age = age.flat_map(|row| row.as_array_mut().unwrap()).filter(|age| age.as_u64() > Some(1));
        *age.next().unwrap() = 9.into();
        std::fs::write(&json, tampered.to_string()).unwrap();
        let output = run(&format!("verify {}", json.display()));
        let told = String::from_utf8_lossy(&output.stdout);
        let links = told.lines().find(|line| line.contains("links: what arrived"));
        assert!(links.is_some_and(|line| line.starts_with("FAIL")), "{told}");
        assert_eq!(output.status.code(), Some(1));
    }
    // Without --relay a trace is what it always was.
    let file = folder.path().join("plain.json");
    succeed(&format!("spawn --agents 2 --episodes 1 --p 0.5 --in-process --record {}", file.display()));
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(!text.contains("relay") && !text.contains("ages") && !text.contains("\"logs\""));
}

#[test]
fn a_team_learns_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let train = |name: &str, more: &str| {
        let out = folder.path().join(name);
        let small = "--set hidden=8 --set predictor_hidden=8 --set test_episodes=4 --steps 500 --in-process";
        let task = "train --task spread-blindfold-3 --train-p 0.3";
        succeed(&format!("{task} {small} {more} --out {}", out.display()));
        let read = |file: &str| std::fs::read_to_string(out.join(file)).unwrap();
        (read("config.toml"), read("metrics.csv"))
    };
    let ((plain, alone), (relayed, together)) = (train("plain", ""), train("relayed", "--relay"));
    assert!(!plain.contains("relay") && relayed.contains("relay = true"));
    assert_ne!(alone, together);
}

#[test]
fn what_is_expected_of_relayed_observations_is_known_by_their_age() {
    let found = succeed(
        "evaluate builtin --task spread-xy-4 --levels 1,0.4 --imputers value-aware --episodes 4 --in-process --relay --json",
    );
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    assert_eq!(found["settings"]["relay"], true, "{found}");
}
