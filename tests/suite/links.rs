//! Models of links, as a user meets them.

use serde_json::Value;

use crate::common::{command, fail, run, stderr, succeed};

/// What `spawn --json` says of ten episodes of hear-see with these links.
fn spawn(links: &str, more: &str) -> Value {
    let mut command = command(&format!("spawn --task hear-see --episodes 10 --json --audit {more}"));
    let output = command.args(["--links", links]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{links}: {}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn every_model_plays_and_delivers_what_it_says() {
    // Of the steps 1 to 24 an agent is heard in every second, and both are in twelve.
    for (links, delivered) in [
        ("tdma(2)", 0.5),
        ("budget(32)", 0.5),
        ("budget(64, priority)", 1.0),
        ("jam(5, 9)", 20.0 / 24.0),
        ("jam(0, 0, 100)", 0.0),
        ("range(0)", 0.0),
        ("range(100)", 1.0),
        ("gilbert(loss=0, burst=3) + latency(0.49)", 1.0),
        // What is sent at the last step is still under way.
        ("delay 100ms", 23.0 / 24.0),
        ("gemodel(0, 1, 1, 1)", 0.0),
    ] {
        let rate = spawn(links, "--in-process")["delivery_rate"].as_f64().unwrap();
        assert!((rate - delivered).abs() < 1e-12, "{links}: {rate}, not {delivered}");
    }
}

#[test]
fn what_a_trace_says_of_links_is_drawn_again() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    std::fs::write(at("log.csv"), "step,receiver,sender,delivered,delay\n0,0,1,1,2\n0,1,0,0,\n").unwrap();
    std::fs::write(at("matrix.txt"), "1 0.5\n0.25 1\n").unwrap();
    let record = |links: &str| {
        let mut command =
            command("spawn --task hear-see --episodes 3 --worlds 2 --in-process --imputer hold");
        let output = command.args(["--links", links, "--record", &at("trace.json")]).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{links}: {}", stderr(&output));
    };
    let chain =
        "gemodel(0.1, 0.3, 0.9) + range(1.5, noise_floor=-20) + latency(1, 1) + jam(x=0, y=0, radius=0.2)";
    for links in ["level(0.3)", "dynamic", chain, &at("log.csv"), &at("matrix.txt"), "budget(32) + tdma(2)"] {
        record(links);
        let text = succeed(&format!("verify {}", at("trace.json")));
        assert!(text.contains("links: what arrived, and when"), "{links}: {text}");
    }
    // Of another seed, links are others.
    record(chain);
    let text = std::fs::read_to_string(at("trace.json")).unwrap();
    std::fs::write(at("trace.json"), text.replacen("\"seed\":0", "\"seed\":1", 1)).unwrap();
    let output = run(&format!("verify {}", at("trace.json")));
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let differ: Vec<&str> = text.lines().filter(|line| line.starts_with("FAIL")).collect();
    assert!(differ.len() == 1 && differ[0].contains("links: what arrived, and when"), "{text}");
    // Of a chain with a matrix the file is not known, so the links are left out.
    record(&format!("matrix({}) + delay(1)", at("matrix.txt")));
    let text = succeed(&format!("verify {}", at("trace.json")));
    assert!(!text.contains("links:"), "{text}");
}

#[test]
fn processes_and_netem_make_no_difference() {
    let [netem, ours, here] = [
        spawn("loss gemodel 10% 30% 90% delay 150ms 100ms", ""),
        spawn("gemodel(0.1, 0.3, 0.9) + latency(1.5, 1)", ""),
        spawn("gemodel(0.1, 0.3, 0.9) + latency(1.5, 1)", "--in-process"),
    ];
    for same in ["links", "return_mean", "delivery_rate", "delayed_rate", "outdated_rate", "audit"] {
        assert_eq!((&netem[same], &here[same]), (&ours[same], &ours[same]), "{same}");
    }
    assert!(ours["delayed_rate"].as_f64().unwrap() > 0.4);
}

#[test]
fn a_log_of_a_radio_is_played_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("log.csv");
    let path = file.to_str().unwrap();
    // Three steps: agent 0 always receives, agent 1 in one of three.
    let rows = "0,0,1,1\n0,1,0,1\n1,0,1,1\n1,1,0,0\n2,0,1,1\n2,1,0,0\n";
    std::fs::write(&file, format!("step,receiver,sender,delivered\n{rows}")).unwrap();
    let rate = |links: &str| spawn(links, "--in-process")["delivery_rate"].as_f64().unwrap();
    // 24 steps are 8 times the log.
    assert!((rate(path) - 2.0 / 3.0).abs() < 1e-12);
    assert!((rate(&format!("trace({path}) + tdma(1)")) - 2.0 / 3.0).abs() < 1e-12);
    let report = succeed(&format!(
        "evaluate builtin --task hear-see --levels 1 --imputers hold --episodes 2 --in-process --json --links {path}"
    ));
    assert!(report.contains("\"logs\": ["), "{report}");
    std::fs::write(&file, format!("step,receiver,sender,delivered\n{}", &rows[8..])).unwrap();
    fail(&format!("spawn --links {path}"), 2, &["log.csv", "step 0, receiver 0, sender 1 is missing"]);
}
