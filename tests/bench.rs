//! What `bench` says, never how fast it is.

mod common;

use common::{fail, succeed};
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
    assert_eq!(all["tasks"].as_array().unwrap().len(), 8);
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
    assert!(measured["tick_exponents"]["agents"].is_f64() && measured["tick_exponents"]["worlds"].is_null());
    fail("bench spawn --agents 65", 2, &["--agents"]);
}
