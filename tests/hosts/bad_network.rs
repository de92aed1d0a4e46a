//! Hosts behind relays, which delay and drop real packets, and are cut.

use std::os::unix::process::ExitStatusExt;
use std::process::Stdio;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::common::{self, await_sleeps, children, fail, shared_memory, stderr};
use crate::namespaces::{Namespace, skipped};
use crate::relay::Manners;
use crate::{Host, alone, assert_same_bits, await_end, end, plan, play};

/// Two hosts, each behind a relay of its own.
pub struct Pair {
    // Hosts go before the networks that they are in.
    pub hosts: [Host; 2],
    pub networks: [Namespace; 2],
    pub folder: TempDir,
}

impl Pair {
    /// With this patience; `None` where this user may not have it.
    pub fn new(manners: [Manners; 2], patience: &str) -> Option<Pair> {
        let [first, second] = manners;
        let networks = [Namespace::behind(0, first)?, Namespace::behind(1, second)?];
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = &networks;
        let hosts =
            [first.start("left", folder.path(), patience), second.start("right", folder.path(), patience)];
        Some(Pair { hosts, networks, folder })
    }

    pub fn hosts(&self) -> [&Host; 2] {
        self.hosts.each_ref()
    }

    pub fn assert_empty(&self) {
        self.hosts.iter().for_each(Host::assert_empty);
    }
}

/// So much delay, a quarter as much jitter, and so much loss.
pub fn manners(delay_ms: u64, loss: f64) -> Manners {
    let [delay, jitter] = [delay_ms * 1000, delay_ms * 250].map(Duration::from_micros);
    Manners { delay, jitter, loss, seed: 11 }
}

#[test]
fn what_a_network_delays_and_drops_changes_no_bit() {
    let _alone = alone();
    let Some(pair) = Pair::new([manners(2, 0.01), manners(4, 0.02)], "5s") else { return skipped() };
    assert_same_bits(&pair.hosts(), "--task hear-see --episodes 1 --p 0.6", "");
    for network in &pair.networks {
        let [carried, dropped] = network.relay().counts();
        assert!(carried > 100 && dropped > 0, "{carried} packets, {dropped} dropped");
    }
}

#[test]
fn a_cut_cable_is_a_host_that_is_lost() {
    let _alone = alone();
    let Some(pair) = Pair::new([manners(0, 0.0); 2], "1s") else { return skipped() };
    let [left, right] = pair.hosts();
    let plan = plan(pair.folder.path(), &[left, right], "");
    let supervisor = play(&plan, &[left, right], "--task hear-see --on-failure continue");
    pair.networks[1].relay().cut(true);
    // Both sides notice: the host ends its agents, and the others play on.
    right.assert_empty();
    await_sleeps(children(left.process.id())[0], 50);
    let (code, said) = end(supervisor);
    assert_eq!(code, Some(130), "{said}");
    left.assert_empty();
    fail(
        &format!("spawn --task hear-see --hosts {}", plan.display()),
        1,
        &["host right", "cannot be reached"],
    );
    left.assert_empty();
    // Where nobody may be lost, the run ends.
    pair.networks[1].relay().cut(false);
    let supervisor = play(&plan, &[left, right], "--task hear-see --on-failure abort");
    pair.networks[1].relay().cut(true);
    let output = await_end(supervisor);
    let said = stderr(&output);
    assert!(output.status.code() == Some(1) && said.contains("host right"), "{said}");
    pair.assert_empty();
}

#[test]
fn who_interrupts_while_hosts_join_leaves_nothing_anywhere() {
    let _alone = alone();
    let Some(pair) = Pair::new([manners(0, 0.0), manners(40, 0.0)], "2s") else { return skipped() };
    // The second is asked when the first has joined, and a policy takes a while to get there.
    interrupt(&pair, |pair| !pair.hosts[0].swarms().is_empty());
}

/// Starts a swarm, interrupts it as soon as `is_time`, and expects that it ends and leaves nothing.
pub fn interrupt(pair: &Pair, is_time: impl Fn(&Pair) -> bool) {
    let plan = plan(pair.folder.path(), &pair.hosts(), "");
    let mut command = common::command("spawn --task hear-see --episodes 10000000 --hosts");
    let supervisor = command.arg(plan).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(30);
    while !is_time(pair) {
        assert!(Instant::now() < deadline, "nobody joins");
        std::thread::sleep(Duration::from_millis(1));
    }
    let tags: Vec<String> = pair.hosts.iter().flat_map(Host::swarms).collect();
    // Not SIGINT: what a script starts in the background ignores that.
    kill_process(Pid::from_child(&supervisor), Signal::TERM).unwrap();
    let output = await_end(supervisor);
    let said = stderr(&output);
    // It ends of the signal itself where it has not begun to take it.
    let by_itself = Some(Signal::TERM.as_raw());
    let is_interrupted = output.status.code() == Some(130) || output.status.signal() == by_itself;
    assert!(is_interrupted && !said.contains("panicked"), "{:?}: {said}", output.status);
    pair.assert_empty();
    assert!(tags.iter().all(|tag| shared_memory(tag).is_empty()));
}
