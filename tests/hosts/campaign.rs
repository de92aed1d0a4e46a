//! Hosts on networks of all kinds. It takes many minutes, so it runs only when asked:
//! `cargo test --release --features hosts --test hosts -- --ignored --nocapture`

use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use crate::bad_network::{Pair, interrupt, manners};
use crate::common::{await_sleeps, children, stderr, succeed};
use crate::namespaces::{Namespace, skipped};
use crate::{Host, alone, assert_same_bits, await_end, end, plan, play};

/// The patience that a network which drops a third of all packets takes: TCP waits twice as long after each loss in a row.
const PATIENT: &str = "300s";

/// How long each setting is played against the clock, in seconds.
const LONG: u32 = 10;

/// Hosts that are each behind a relay of its own.
struct Setting {
    // Hosts go before the networks that they are in.
    hosts: Vec<Host>,
    networks: Vec<Namespace>,
    folder: TempDir,
}

impl Setting {
    /// So many hosts at `tcp` or `udp`; `None` where this user may not have them.
    fn new(hosts: u8, kind: &str, delay_ms: u64, loss: f64) -> Option<Setting> {
        let behind = |number| Namespace::behind(number, manners(delay_ms, loss));
        let networks: Vec<Namespace> = (0..hosts).map(behind).collect::<Option<_>>()?;
        let folder = tempfile::tempdir().unwrap();
        let named = networks.iter().zip(["left", "right", "third"]);
        let start = |(network, name): (&Namespace, _)| network.start_over(kind, name, folder.path(), PATIENT);
        Some(Setting { hosts: named.map(start).collect(), networks, folder })
    }

    /// The words that play `rendezvous-3`: its policy is small, and there are enough agents for three hosts.
    fn words(rest: &str) -> String {
        let policy =
            concat!(env!("CARGO_MANIFEST_DIR"), "/agents/pretrained/rendezvous-3/seed-0.safetensors");
        format!("spawn --task rendezvous-3 --policy {policy} --seed 5 --deadline 600s --json {rest}")
    }

    /// Plays over the hosts; the summary.
    fn play(&self, rest: &str) -> Value {
        let hosts: Vec<&Host> = self.hosts.iter().collect();
        let plan = plan(self.folder.path(), &hosts, "");
        let summary = succeed(&format!("{} --hosts {}", Setting::words(rest), plan.display()));
        serde_json::from_str(&summary).unwrap()
    }

    /// The share of packets that were dropped, in percent.
    fn dropped(&self) -> f64 {
        let counts = self.networks.iter().map(|network| network.relay().counts());
        let [carried, dropped] = counts.fold([0, 0], |[a, b], [c, d]| [a + c, b + d]);
        100.0 * dropped as f64 / (carried + dropped) as f64
    }
}

#[test]
#[ignore = "takes half a minute"]
fn lockstep_without_loss() {
    lockstep(0.0);
}

#[test]
#[ignore = "takes a minute"]
fn lockstep_at_5_percent_loss() {
    lockstep(0.05);
}

#[test]
#[ignore = "takes many minutes"]
fn lockstep_at_30_percent_loss() {
    lockstep(0.3);
}

/// Plays an episode in each setting with this loss, and compares all that was recorded.
fn lockstep(loss: f64) {
    let _alone = alone();
    println!(
        "| hosts | delay, ms | loss | equal bits | tick p50, p99, ms | packets dropped | joined after, s |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (hosts, delay_ms) in [(2, 0), (3, 0), (2, 50), (3, 50)] {
        let Some(setting) = Setting::new(hosts, "tcp", delay_ms, loss) else { return skipped() };
        let [here, there] = ["here.json", "there.json"].map(|name| setting.folder.path().join(name));
        let rest = "--episodes 1 --p 0.5 --audit --record";
        succeed(&Setting::words(&format!("{rest} {}", here.display())));
        let began = Instant::now();
        let summary = setting.play(&format!("{rest} {}", there.display()));
        let took = began.elapsed().as_secs_f64();
        let is_equal = std::fs::read(here).unwrap() == std::fs::read(there).unwrap();
        assert!(is_equal, "{hosts} hosts, {delay_ms} ms, loss {loss}");
        let number = |name: &str| summary[name].as_f64().unwrap();
        println!(
            "| {hosts} | {delay_ms} | {:.0} % | yes | {:.1}, {:.1} | {:.1} % | {:.1} |",
            100.0 * loss,
            number("tick_p50_us") / 1e3,
            number("tick_p99_us") / 1e3,
            setting.dropped(),
            took - number("elapsed_s"),
        );
        // Where a third is lost, hosts may hear minutes later that it is over.
        if loss < 0.3 {
            setting.hosts.iter().for_each(Host::assert_empty);
        }
    }
}

#[test]
#[ignore = "takes minutes"]
fn against_the_clock() {
    let _alone = alone();
    head_by_the_clock();
    for loss in [0.0, 0.05, 0.3] {
        for (delay_ms, rates) in [(0, [20, 5]), (10, [20, 5]), (50, [5, 2])] {
            for (rate, hosts) in rates.into_iter().flat_map(|rate| [(rate, 2), (rate, 3)]) {
                let Some(setting) = Setting::new(hosts, "tcp", delay_ms, loss) else { return skipped() };
                by_the_clock(&setting, delay_ms, loss, rate, "--p 1");
            }
        }
    }
}

/// The network is the link, and loses datagrams.
#[cfg(feature = "hosts-udp")]
#[test]
#[ignore = "takes minutes"]
fn against_the_clock_by_datagrams() {
    let _alone = alone();
    head_by_the_clock();
    // At 30 % it takes many minutes to connect.
    for loss in [0.0, 0.05] {
        for (delay_ms, rate) in [(0, 20), (10, 5)] {
            let Some(setting) = Setting::new(2, "udp", delay_ms, loss) else { return skipped() };
            by_the_clock(&setting, delay_ms, loss, rate, "--links network");
        }
    }
}

fn head_by_the_clock() {
    println!(
        "| hosts | delay, ms | loss | rate, Hz | achieved | delivered | late | missed | lost | clock right to, ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
}

/// Plays for a while in a setting; prints its row.
fn by_the_clock(setting: &Setting, delay_ms: u64, loss: f64, rate: u32, links: &str) {
    // An episode has 25 ticks.
    let episodes = (rate * LONG).div_ceil(25);
    let summary = setting.play(&format!("--rate {rate} --episodes {episodes} {links}"));
    // If no decision was made in time, there is nobody to whom anything could be delivered.
    let percent =
        |value: &Value| value.as_f64().map_or("-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
    let hosts = summary["hosts"].as_array().unwrap();
    let sum = |name: &str| hosts.iter().map(|host| host[name].as_u64().unwrap()).sum::<u64>();
    let error_ns = hosts.iter().map(|host| host["error_ns"].as_u64().unwrap()).max().unwrap();
    let clock = &summary["real_time"];
    println!(
        "| {} | {delay_ms} | {:.0} % | {rate} | {:.2} | {} | {} | {} | {} of {} | {:.1} |",
        hosts.len(),
        100.0 * loss,
        clock["achieved_rate"].as_f64().unwrap(),
        percent(&summary["delivery_rate"]),
        percent(&clock["late_rate"]),
        percent(&clock["missed_rate"]),
        sum("lost"),
        sum("observations"),
        error_ns as f64 / 1e6,
    );
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
                let output = await_end(supervisor);
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
