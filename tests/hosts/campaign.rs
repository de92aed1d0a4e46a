//! Hosts on networks of all kinds. It takes many minutes, so it runs only when asked:
//! `cargo test --release --features hosts --test hosts -- --ignored --nocapture`

use std::time::{Duration, Instant};

use serde_json::Value;

use crate::bad_network::{Pair, interrupt, manners};
use crate::common::{await_sleeps, children, stderr, succeed};
use crate::namespaces::{Namespace, skipped};
use crate::{Host, alone, assert_same_bits, end, plan, play};

/// The patience that a network which drops a third of all packets takes: TCP waits twice as long after each loss in a row.
const PATIENT: &str = "300s";

#[test]
#[ignore = "takes minutes"]
fn table_of_hosts_delays_and_losses() {
    let _alone = alone();
    println!(
        "| hosts | delay, ms | loss | equal bits | tick p50, p99, ms | packets dropped | joined after, s |"
    );
    println!("|---|---|---|---|---|---|---|");
    for loss in [0.0, 0.05, 0.3] {
        for (hosts, delay_ms) in [(2, 0), (3, 0), (2, 50), (3, 50)] {
            let numbers = 0..hosts;
            let networks: Option<Vec<_>> =
                numbers.map(|number| Namespace::behind(number, manners(delay_ms, loss))).collect();
            let Some(networks) = networks else { return skipped() };
            println!("{}", row(&networks, delay_ms, loss));
        }
    }
}

/// Plays an episode over hosts in these networks; its row of the table.
fn row(networks: &[Namespace], delay_ms: u64, loss: f64) -> String {
    let folder = tempfile::tempdir().unwrap();
    let names = ["left", "right", "third"];
    let hosts: Vec<Host> = networks
        .iter()
        .zip(names)
        .map(|(network, name)| network.start(name, folder.path(), PATIENT))
        .collect();
    let hosts: Vec<&Host> = hosts.iter().collect();
    let plan = plan(folder.path(), &hosts, "");
    let [here, there] = ["here.json", "there.json"].map(|name| folder.path().join(name));
    // Its policy is small, and there are enough agents for three hosts.
    let policy = concat!(env!("CARGO_MANIFEST_DIR"), "/agents/pretrained/rendezvous-3/seed-0.safetensors");
    let words = format!(
        "spawn --task rendezvous-3 --policy {policy} --episodes 1 --seed 5 --p 0.5 --audit --deadline 600s --json --record"
    );
    succeed(&format!("{words} {}", here.display()));
    let began = Instant::now();
    let summary = succeed(&format!("{words} {} --hosts {}", there.display(), plan.display()));
    let took = began.elapsed().as_secs_f64();
    hosts.iter().for_each(|host| host.assert_empty());
    let is_equal = std::fs::read(here).unwrap() == std::fs::read(there).unwrap();
    let summary: Value = serde_json::from_str(&summary).unwrap();
    let number = |name: &str| summary[name].as_f64().unwrap();
    let counts = networks.iter().map(|network| network.relay().counts());
    let [carried, dropped] = counts.fold([0, 0], |[a, b], [c, d]| [a + c, b + d]);
    assert!(is_equal, "{} hosts, {delay_ms} ms, loss {loss}", hosts.len());
    format!(
        "| {} | {delay_ms} | {:.0} % | yes | {:.1}, {:.1} | {:.1} % | {:.1} |",
        hosts.len(),
        100.0 * loss,
        number("tick_p50_us") / 1e3,
        number("tick_p99_us") / 1e3,
        100.0 * dropped as f64 / (carried + dropped) as f64,
        took - number("elapsed_s"),
    )
}

#[test]
#[ignore = "takes half a minute"]
fn a_cable_cut_for_5_s_changes_no_bit_if_patience_allows() {
    let _alone = alone();
    let Some(pair) = Pair::new([manners(0, 0.0); 2], "20s") else { return skipped() };
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // All play by then: they have agents that sleep in every tick.
            let right = &pair.hosts[1];
            while right.swarms().is_empty() || children(right.process.id()).len() < 2 {
                std::thread::sleep(Duration::from_millis(5));
            }
            await_sleeps(children(right.process.id())[0], 100);
            pair.networks[1].relay().cut(true);
            std::thread::sleep(Duration::from_secs(5));
            pair.networks[1].relay().cut(false);
        });
        assert_same_bits(&pair.hosts(), "--agents 4 --p 0.5 --episodes 40", "");
    });
    let [_, dropped] = pair.networks[1].relay().counts();
    assert!(dropped > 0, "it was cut while they played");
}

#[test]
#[ignore = "takes half a minute"]
fn a_cable_cut_for_5_s_is_a_host_that_is_lost_by_default() {
    let _alone = alone();
    let Some(pair) = Pair::new([manners(0, 0.0); 2], "2s") else { return skipped() };
    let plan = plan(pair.folder.path(), &pair.hosts(), "");
    for on_failure in ["abort", "continue", "restart"] {
        let supervisor = play(&plan, &pair.hosts(), &format!("--agents 4 --on-failure {on_failure}"));
        pair.networks[1].relay().cut(true);
        std::thread::sleep(Duration::from_secs(5));
        pair.networks[1].relay().cut(false);
        pair.hosts[1].assert_empty();
        let (code, said) = match on_failure {
            "continue" => {
                await_sleeps(children(pair.hosts[0].process.id())[0], 50);
                end(supervisor)
            }
            _ => {
                let output = supervisor.wait_with_output().unwrap();
                (output.status.code(), stderr(&output))
            }
        };
        let expected = if on_failure == "continue" { 130 } else { 1 };
        assert_eq!(code, Some(expected), "{on_failure}: {said}");
        pair.assert_empty();
    }
    succeed(&format!("spawn --agents 4 --episodes 1 --deadline 60s --hosts {}", plan.display()));
}

#[test]
#[ignore = "takes half a minute"]
fn interrupted_at_any_moment_nothing_is_left() {
    let _alone = alone();
    let Some(pair) = Pair::new([manners(5, 0.0), manners(20, 0.0)], "2s") else { return skipped() };
    for ms in (0..1600).step_by(100) {
        let began = Instant::now();
        interrupt(&pair, |_| began.elapsed() >= Duration::from_millis(ms));
    }
}
