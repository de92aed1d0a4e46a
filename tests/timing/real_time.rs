//! Swarms against the clock.

use crate::common::{Swarm, fail, succeed};
use rustix::process::{Signal, kill_process};
use serde_json::Value;

fn json(words: &str) -> Value {
    serde_json::from_str(&succeed(words)).expect("output is JSON")
}

#[test]
fn in_time_it_is_the_same_as_in_lockstep() {
    let swarm = "spawn --task hear-see --p 0.3 --episodes 2 --audit --json";
    let lockstep = json(swarm);
    assert_eq!(lockstep["real_time"], Value::Null);
    // Others may need this machine too: a period that somebody missed is no answer.
    let in_time = (0..20).map(|_| json(&format!("{swarm} --rate 25"))).find(|played| {
        played["real_time"]["late_rate"] == 0.0 && played["real_time"]["missed_decisions"] == 0
    });
    let in_time = in_time.expect("within 20 ms an agent answers, mostly");
    for what in ["return_mean", "delivery_rate", "imputation_rmse", "audit", "ticks"] {
        assert_eq!(in_time[what], lockstep[what], "{what}");
    }
    assert!(in_time["elapsed_s"].as_f64().unwrap() >= 50.0 / 25.0, "50 periods of 40 ms");
}

#[test]
fn what_cannot_be_in_time_is_late_or_missed_and_counted() {
    // Nobody plays at 100 kHz.
    let played = json("spawn --task spread-xy-4 --p 0.7 --rate 100000 --episodes 40 --audit --json");
    let (clock, audit) = (&played["real_time"], &played["audit"]);
    let number = |value: &Value| value.as_f64().unwrap();
    assert!(number(&clock["missed_decisions"]) > 0.0 || number(&clock["skipped_periods"]) > 0.0);
    assert!(number(&clock["achieved_rate"]) <= 100_000.0);
    // A decision that was made has one part for each agent; what was missed has none.
    let parts = ["own", "received", "imputed"].map(|origin| number(&audit[origin]));
    let made = 40.0 * 25.0 * 4.0 - number(&clock["missed_decisions"]);
    assert_eq!((parts[0], parts.iter().sum::<f64>()), (made, 4.0 * made));
    assert_eq!((&audit["altered"], &audit["leaked"]), (&0.into(), &0.into()));
    if made > 0.0 {
        assert!(number(&played["delivery_rate"]) + number(&clock["late_rate"]) <= 1.0);
        assert!(number(&audit["late"]) > 0.0 || clock["late_rate"] == 0.0);
    }
}

#[test]
fn an_agent_that_hangs_holds_nobody_up() {
    let mut swarm = Swarm::start("--task hear-see --rate 200 --episodes 40");
    swarm.first_line();
    kill_process(swarm.agents[1], Signal::STOP).unwrap();
    std::thread::sleep(std::time::Duration::from_millis(500));
    kill_process(swarm.agents[1], Signal::CONT).unwrap();
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(0), "{stderr}");
    // Half a second is 100 periods. Its peer does without it, unless they are left out.
    let words = stdout.split_whitespace().collect::<Vec<_>>();
    let before = |word: &str, back: usize| -> f64 {
        let at = words.iter().position(|found| *found == word).unwrap_or_else(|| panic!("{stdout}"));
        words[at - back].parse().unwrap()
    };
    let (missed, left_out) = (before("decisions", 3), before("left", 2));
    assert!((90.0..40.0 * 25.0 * 2.0).contains(&(missed + left_out)), "{stdout}");
    assert!(before("late", 2) > 0.0 || left_out > 90.0, "{stdout}");
}

#[test]
fn a_large_team_in_several_worlds_counts_what_it_did() {
    // Three episodes in two worlds at a time: the last one is played alone.
    for (task, agents) in [("spread-xy-4", 4.0), ("spread-blindfold-64", 64.0)] {
        let words = format!(
            "spawn --task {task} --policy untrained --rate 20 --worlds 2 --episodes 3 --deadline 60s"
        );
        let played = json(&format!("{words} --p 0.5 --audit --json"));
        let (clock, audit) = (&played["real_time"], &played["audit"]);
        let number = |value: &Value| value.as_f64().unwrap();
        let made = 3.0 * 25.0 * agents - number(&clock["missed_decisions"]);
        assert_eq!(
            (number(&audit["own"]), &audit["altered"], &audit["leaked"]),
            (made, &0.into(), &0.into())
        );
        assert_eq!((&played["ticks"], &played["tick_p50_us"]), (&50.into(), &Value::Null));
        let shares = [&clock["dropped_rate"], &clock["late_rate"], &played["delivery_rate"]].map(number);
        assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{shares:?}");
    }
}

/// Periods of 100 s: longer than anybody waits for the swarm to end.
const SLOW: &str = "--task hear-see --rate 0.01 --on-failure abort";

#[test]
fn an_agent_that_dies_ends_the_swarm_also_between_ticks() {
    let mut swarm = Swarm::start(SLOW);
    swarm.first_line();
    kill_process(swarm.agents[1], Signal::KILL).unwrap();
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("agent-1") && stderr.contains("signal 9"), "{stderr}");
}

#[test]
fn a_slow_clock_can_be_interrupted() {
    let mut swarm = Swarm::start(SLOW);
    swarm.first_line();
    swarm.signal_supervisor(Signal::INT);
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
}

#[test]
fn a_trace_against_the_clock_says_who_was_not_there_and_is_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace.json").display().to_string();
    succeed(&format!(
        "spawn --task hear-see --p 0.6 --rate 100 --episodes 4 --on-failure restart --chaos stop=0.1:50ms --record {trace}"
    ));
    let table = succeed(&format!("verify {trace}"));
    assert!(table.contains("all 10 comparisons hold"), "{table}");
    let trace: Value = serde_json::from_slice(&std::fs::read(trace).unwrap()).unwrap();
    assert_eq!(trace["rate"], 100.0);
    let episodes = trace["episodes"].as_array().unwrap();
    let all = episodes.iter().flat_map(|episode| episode["presence"].as_array().into_iter().flatten());
    assert!(all.flat_map(|step| step.as_array().unwrap()).any(|it| *it == 2), "nobody was stopped");
}

#[test]
fn rates_that_make_no_sense_are_refused() {
    for rate in ["0", "-5", "nan", "1e7", "fast"] {
        fail(&format!("spawn --rate {rate}"), 2, &["--rate", "such as 100"]);
    }
    fail("spawn --rate 100 --in-process", 2, &["--rate", "--in-process"]);
    fail("bench rate --tasks nowhere", 2, &["nowhere"]);
    fail("bench rate --episodes 1", 2, &["--episodes"]);
}

#[test]
fn a_bench_of_rates_says_what_was_lost_and_draws_it() {
    let folder = tempfile::tempdir().unwrap();
    let svg = folder.path().join("rate.svg");
    let words =
        format!("bench rate --tasks hear-see --p 1 --rates 100,50 --episodes 2 --svg {}", svg.display());
    let result = json(&format!("{words} --json"));
    let case = &result["cases"][0];
    let number = |value: &Value| value.as_f64().unwrap();
    assert_eq!(
        (&case["task"], &case["p"], &result["episodes"]),
        (&"hear-see".into(), &1.0.into(), &2.into())
    );
    for at_rate in case["at_rates"].as_array().unwrap() {
        let lost = number(&case["lockstep"]["return_mean"]) - number(&at_rate["return_mean"]);
        assert!((lost - number(&at_rate["lost_mean"])).abs() < 1e-9, "the same episodes: {case}");
        let left_out = number(&at_rate["skipped_rate"]);
        let reached = number(&at_rate["achieved_rate"]) / number(&at_rate["rate"]);
        assert!(reached <= 1.0 + 1e-6 && (left_out > 0.0 || reached > 0.999), "{at_rate}");
    }
    assert_eq!(case["at_rates"].as_array().unwrap().len(), 2);
    assert!(std::fs::read_to_string(svg).unwrap().contains("hear-see"));
}
