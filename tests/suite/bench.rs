//! What `bench` says, never how fast it is.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::common::{self, fail, succeed};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

fn json(words: &str) -> Value {
    serde_json::from_str(&succeed(words)).expect("--json prints JSON")
}

fn positive(value: &Value) -> f64 {
    let number = value.as_f64().unwrap_or_else(|| panic!("no number: {value}"));
    assert!(number > 0.0 && number.is_finite(), "{number}");
    number
}

/// Times as `--json` has them.
fn check_times(times: &Value) {
    let us = ["p50_us", "p90_us", "p99_us", "p999_us", "max_us"].map(|key| positive(&times[key]));
    assert!(us.is_sorted(), "{times}");
    assert!(times["count"].as_u64().unwrap() >= 10 && times["overruns"].is_u64(), "{times}");
}

#[test]
fn worlds_of_all_tasks_are_measured_unless_some_are_named() {
    let all = json("bench world --seconds 0.1 --rounds 1 --json");
    assert_eq!(all["tasks"].as_array().unwrap().len(), 13);
    let some = json("bench world --tasks SXY-4,spread-blindfold-5 --seconds 0.1 --rounds 1 --json");
    let [first, second] = &some["tasks"].as_array().unwrap()[..] else { panic!("{some}") };
    assert_eq!((&first["task"], &first["agents"]), (&"spread-xy-4".into(), &4.into()));
    assert_eq!(second["agents"], 5);
    assert!((positive(&first["env_steps_per_s"]) * positive(&first["step_us"]) / 1e6 - 1.0).abs() < 1e-9);
    fail("bench world --tasks hear-sea", 2, &["hear-see"]);
}

#[test]
fn a_decision_stands_beside_its_weights_and_candle() {
    let measured = json("bench agent --task hear-see --seconds 0.1 --json");
    let cases = measured["cases"].as_array().unwrap();
    let names: Vec<_> = cases.iter().map(|case| (case["actor"].as_str(), case["worlds"].as_u64())).collect();
    assert_eq!(names, [("mlp", 1), ("mlp", 10), ("gru", 1), ("gru", 10)].map(|(a, w)| (Some(a), Some(w))));
    for case in cases {
        for key in ["imputer_us", "policy_us", "predict_us", "predict_stream_us", "predict_candle_us"] {
            positive(&case[key]);
        }
        for (ratio, other) in [("ratio_to_stream", "stream_us"), ("ratio_to_candle", "candle_us")] {
            let expected = positive(&case["decision_us"]) / positive(&case[other]);
            assert_eq!(positive(&case[ratio]), expected);
        }
    }
}

#[test]
fn what_a_swarm_costs_is_said_for_each_size() {
    let measured = json("bench spawn --agents 1,2 --worlds 3 --seconds 0.1 --json");
    let sizes = |list: &str| -> Vec<_> {
        let swarms = measured[list].as_array().unwrap();
        for swarm in swarms {
            let memory = ["private_mib", "pss_mib", "rss_mib"].map(|key| positive(&swarm[key]));
            assert!(memory.is_sorted(), "{swarm}");
            positive(&swarm["start_ms"]);
            check_times(&swarm["tick"]);
        }
        swarms
            .iter()
            .map(|swarm| ["agents", "worlds", "payload"].map(|key| swarm[key].as_u64().unwrap()))
            .collect()
    };
    assert_eq!(sizes("by_agents"), [[1, 1, 24], [2, 1, 32]]);
    assert_eq!(sizes("by_worlds"), [[4, 3, 3 * 48]]);
    let bare = measured["by_payload"].as_array().unwrap();
    bare.iter().for_each(|bare| check_times(&bare["tick"]));
    assert_eq!((&bare[0]["payload"], &bare[5]["payload"]), (&64.into(), &65536.into()));
    let exponents = &measured["tick_exponents"];
    assert!(exponents["agents"].is_f64() && exponents["worlds"].is_null() && exponents["payload"].is_f64());
    fail("bench spawn --agents 65", 2, &["--agents"]);
}

#[test]
fn hops_over_all_media_stand_beside_the_floor_and_plain_iceoryx2() {
    let folder = tempfile::tempdir().unwrap();
    let svg = folder.path().join("latency.svg");
    let words = format!("--agents 2 --payloads 64,65536 --seconds 0.1 --json --svg {}", svg.display());
    let measured = json(&format!("bench latency {words}"));
    positive(&measured["clock_ns"]);
    let hops = measured["hops"].as_array().unwrap();
    assert_eq!(hops.len(), 7 * 2 * 2, "media, waits, sizes");
    for hop in hops {
        let like = |medium: &str| {
            let same = |other: &&Value| {
                other["medium"] == medium && ["wait", "payload"].iter().all(|key| other[key] == hop[key])
            };
            hops.iter().find(same).unwrap()
        };
        for what in ["hop", "whole"] {
            check_times(&hop[what]);
            for (ratios, medium) in [("ratio_to_floor", "futex"), ("ratio_to_plain", "plain")] {
                for (name, ratio) in hop[what][ratios].as_object().unwrap() {
                    let us = |hop: &Value| positive(&hop[what][format!("{name}_us")]);
                    assert_eq!(positive(ratio), us(hop) / us(like(medium)), "{hop}");
                }
                assert_eq!(hop[what][ratios].as_object().unwrap().len(), 5);
            }
        }
        assert!(positive(&hop["hop"]["p50_us"]) <= positive(&hop["whole"]["p50_us"]), "{hop}");
    }
    let ticks = measured["ticks"].as_array().unwrap();
    assert_eq!(ticks.len(), 2 * 2, "waits, sizes");
    for tick in ticks {
        for what in ["tick", "bare", "decision", "imputer", "policy", "age"] {
            check_times(&tick[what]);
        }
        assert_eq!(positive(&tick["payload"]), 32.0 * positive(&tick["worlds"]));
        let [ticks, of_agents] = ["tick", "age"].map(|what| tick[what]["count"].as_u64().unwrap());
        assert_eq!(of_agents, 2 * ticks, "each of two agents has one peer");
        let ratio = positive(&tick["tick"]["p50_us"]) / positive(&tick["bare"]["p50_us"]);
        assert_eq!(tick["ratio_to_bare"]["p50"], ratio);
        assert!(positive(&tick["needed_us"]) > positive(&tick["bare"]["p50_us"]));
    }
    let svg = std::fs::read_to_string(svg).unwrap();
    for part in
        ["our bus", "plain iceoryx2", "memory and futex", "UDP", "2 agents", "share that takes longer"]
    {
        assert!(svg.contains(part), "{part}");
    }
}

#[test]
fn what_got_slower_since_an_earlier_result_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("before.json");
    let words = format!("bench world --tasks SXY-4 --seconds 0.1 --rounds 1 --compare {}", path.display());
    let before = |env_steps_per_s: f64| {
        let task =
            serde_json::json!({ "task": "spread-xy-4", "agents": 4, "env_steps_per_s": env_steps_per_s });
        std::fs::write(&path, serde_json::json!({ "tasks": [task] }).to_string()).unwrap();
    };
    before(1e15);
    let slower = &json(&format!("{words} --json"))["slower"];
    assert_eq!(slower.as_array().unwrap().len(), 1);
    assert_eq!(slower[0]["figure"], "tasks, task spread-xy-4, agents 4: env_steps_per_s");
    assert_eq!(positive(&slower[0]["times"]), 1e15 / positive(&slower[0]["now"]));
    assert!(succeed(&words).contains("1 of 1 figures got worse"));
    before(1.0);
    assert!(succeed(&words).contains("none of 1 figures got worse"));
    std::fs::write(&path, "{}").unwrap();
    fail(&words, 2, &["before.json", "same command"]);
    std::fs::write(&path, "no JSON").unwrap();
    fail(&words, 2, &["--compare", "--json"]);
    fail("bench spawn --compare no/such/file", 2, &["no/such/file"]);
}

#[test]
fn requests_that_cannot_be_measured() {
    for payloads in ["63", "66", "65540", "many"] {
        fail(&format!("bench latency --payloads {payloads}"), 2, &["multiple of 4 from 64 to 65536"]);
    }
    fail("bench latency --agents 1", 2, &["--agents"]);
    fail("bench latency --seconds 0", 2, &["0.1 seconds"]);
    fail("bench latency --svg no/such/folder/latency.svg", 1, &["no folder"]);
    fail("peer {}", 2, &["for `bench latency`"]);
}

/// A measurement that is at its first hop, and the peer of it.
fn measuring() -> (Child, Pid) {
    let words = "bench latency --agents 2 --payloads 64 --wait block --seconds 100";
    let mut started = common::command(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(30);
    while Instant::now() < deadline {
        // The settings are those of this program only once it runs.
        let peers = common::children(started.id());
        if let Some(peer) = peers.first().filter(|peer| common::settings_of(**peer).is_some()) {
            return (started, *peer);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    started.kill().and_then(|()| started.wait()).unwrap();
    panic!("no peer is started");
}

/// Waits for a measurement to end: exit code and stderr.
fn ended(mut measuring: Child) -> (Option<i32>, String) {
    let deadline = Instant::now() + Duration::from_secs(30);
    while measuring.try_wait().unwrap().is_none() {
        assert!(Instant::now() < deadline, "it does not end");
        std::thread::sleep(Duration::from_millis(5));
    }
    let output = measuring.wait_with_output().unwrap();
    (output.status.code(), common::stderr(&output))
}

#[test]
fn a_peer_that_is_killed_ends_the_measurement() {
    let (measuring, peer) = measuring();
    let tag = common::settings_of(peer).unwrap()["role"]["echo"]["tag"].as_str().unwrap().to_owned();
    kill_process(peer, Signal::KILL).unwrap();
    let (code, stderr) = ended(measuring);
    assert_eq!(code, Some(1));
    assert!(stderr.contains("the peer over") && stderr.contains("signal 9"), "{stderr}");
    common::assert_gone(&[peer], &tag);
}

#[test]
fn interrupting_a_measurement_leaves_nothing() {
    let (measuring, peer) = measuring();
    let tag = common::settings_of(peer).unwrap()["role"]["echo"]["tag"].as_str().unwrap().to_owned();
    kill_process(Pid::from_child(&measuring), Signal::TERM).unwrap();
    let (code, stderr) = ended(measuring);
    assert_eq!(code, Some(130), "{stderr}");
    common::assert_gone(&[peer], &tag);
}
