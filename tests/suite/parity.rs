//! The same seed gives the same bits: across processes, in-process, and in any number of worlds.
//!
//! A trace holds states, masks, estimates, actions, logits and rewards of every step, so two equal files
//! are two equal runs.

use crate::common::succeed;

/// Records a run and hands out the bytes of its trace.
fn record(words: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("trace.json");
    succeed(&format!("spawn {words} --record {}", file.display()));
    std::fs::read(&file).unwrap()
}

/// Runs in-process in one world, and compares every other way to run the same with it.
fn compare(words: &str, ways: &[&str]) {
    let expected = record(&format!("{words} --in-process"));
    assert!(expected.len() > 10_000, "{words}: a trace of {} bytes", expected.len());
    for way in ways {
        assert!(record(&format!("{words} {way}")) == expected, "{words}: {way} gives other bits");
    }
}

#[test]
fn one_agent() {
    let task = "--task spread-blindfold-1 --policy untrained --episodes 5";
    compare(task, &["", "--worlds 3", "--worlds 5 --in-process", "--wait spin"]);
}

#[test]
fn two_agents() {
    for links in ["--p 1", "--p 0.5", "--p 0", "--links dynamic"] {
        let words = format!("--task hear-see --episodes 12 {links}");
        compare(
            &words,
            &["", "--worlds 1 --wait spin", "--worlds 5", "--worlds 12", "--worlds 7 --in-process"],
        );
    }
}

#[test]
fn four_agents_with_a_recurrent_policy() {
    for imputer in ["value-aware", "hold", "velocity", "zero"] {
        let words = format!("--agents 4 --episodes 11 --p 0.3 --no-comm-at-t0 --imputer {imputer} --seed 3");
        compare(&words, &["", "--worlds 4", "--worlds 10 --in-process"]);
    }
}

#[test]
fn twelve_agents() {
    for links in ["--p 0.2", "--links asymmetric"] {
        let words = format!("--agents 12 --policy untrained --episodes 6 {links} --greedy");
        compare(&words, &["", "--worlds 6", "--worlds 4", "--worlds 4 --in-process"]);
    }
}

#[test]
fn what_is_relayed() {
    for (links, imputer) in
        [("--p 0.3 --no-comm-at-t0", "dynamics"), ("--links level(0.4)+delay(2,2)", "value-aware")]
    {
        let words = format!("--agents 4 --episodes 5 --relay {links} --imputer {imputer}");
        compare(&words, &["--deadline 20s", "--worlds 4 --deadline 20s", "--worlds 3 --in-process"]);
    }
    // Who was away holds nothing, whether it was killed or stopped.
    let words = "--agents 4 --episodes 8 --relay --p 0.3 --chaos kill=0.02:300ms,stop=0.03:300ms";
    compare(words, &["--on-failure restart --deadline 20s"]);
}

#[test]
fn another_seed_gives_another_run() {
    let words = "--task hear-see --episodes 3 --in-process";
    assert!(record(&format!("{words} --seed 1")) != record(&format!("{words} --seed 2")));
}
