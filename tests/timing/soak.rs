//! Agents that are killed again and again leave nothing behind.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::common::{self, Swarm};

/// What a swarm holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Held {
    /// Files in shared memory.
    segments: usize,
    /// Bytes of them that are in memory.
    segment_bytes: u64,
    /// Files in the swarm's folder, sockets among them.
    files: usize,
    /// Open files of the supervisor, and memory maps of it.
    open: usize,
    maps: usize,
    threads: usize,
    processes: usize,
}

impl Held {
    fn by(swarm: &Swarm) -> Held {
        use std::os::unix::fs::MetadataExt;
        let process = format!("/proc/{}", swarm.supervisor().as_raw_nonzero());
        let entries = |of: &str| std::fs::read_dir(format!("{process}/{of}")).unwrap().count();
        let segments = common::shared_memory(&swarm.tag);
        let bytes = |name: &String| {
            std::fs::metadata(Path::new("/dev/shm").join(name)).map_or(0, |file| file.blocks() * 512)
        };
        Held {
            segment_bytes: segments.iter().map(bytes).sum(),
            segments: segments.len(),
            files: count_files(&common::root(&swarm.tag)),
            open: entries("fd"),
            maps: std::fs::read_to_string(format!("{process}/maps")).unwrap().lines().count(),
            threads: entries("task"),
            processes: running(swarm).len(),
        }
    }
}

fn count_files(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| if entry.path().is_dir() { 1 + count_files(&entry.path()) } else { 1 }).sum()
}

fn running(swarm: &Swarm) -> Vec<Pid> {
    let children = common::children(swarm.supervisor().as_raw_nonzero().get() as u32);
    children.into_iter().filter(|child| common::is_running(*child)).collect()
}

/// Kills agents one after the other, each when all are there. Returns what the swarm held after the first of them were
/// replaced, and at the end.
fn kill_often(agents: usize, kills: usize) -> Vec<Held> {
    let words = format!("--agents {agents} --policy untrained --imputer hold --p 0.5 --deadline 60s");
    let swarm = Swarm::start(&words);
    let mut held = Vec::new();
    for kill in 0..=kills {
        let deadline = Instant::now() + Duration::from_secs(60);
        let there = loop {
            let there = running(&swarm);
            if there.len() == agents && there.iter().all(|agent| common::settings_of(*agent).is_some()) {
                break there;
            }
            assert!(Instant::now() < deadline, "nobody comes back after {kill} kills");
            std::thread::sleep(Duration::from_millis(1));
        };
        // It plays again.
        common::await_sleeps(swarm.supervisor(), 20);
        // After each has been killed once, all is as it will be.
        if kill == agents || kill == kills {
            held.push(Held::by(&swarm));
        }
        if kill < kills {
            let victim = there[kill * 7 % agents];
            kill_process(victim, Signal::KILL).unwrap();
            let deadline = Instant::now() + Duration::from_secs(60);
            while common::is_running(victim) {
                assert!(Instant::now() < deadline, "{victim:?} does not die");
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    }
    swarm.signal_supervisor(Signal::INT);
    let tag = swarm.tag.clone();
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
    let deaths = format!("{kills} deaths, 0 hangs, {kills} restarts");
    assert!(stdout.contains(&deaths), "{stdout}");
    println!("{stdout}");
    common::assert_gone(&[], &tag);
    held
}

fn check(agents: usize, kills: usize) {
    let held = kill_often(agents, kills);
    println!("after {agents} kills and after {kills}: {held:#?}");
    let [first, last] = held[..] else { panic!("{held:?}") };
    // Queues of the moment take a page more or less.
    let pages = |bytes: u64| bytes / 4096;
    assert!(pages(last.segment_bytes).abs_diff(pages(first.segment_bytes)) <= 2 * agents as u64, "{held:?}");
    assert_eq!(Held { segment_bytes: 0, ..first }, Held { segment_bytes: 0, ..last });
}

#[test]
fn twenty_kills_leave_nothing_behind() {
    check(3, 20);
}

/// The figures of docs/reliability.md: `cargo test --release --test timing -- --ignored --nocapture two_thousand`.
#[test]
#[ignore = "takes minutes"]
fn two_thousand_kills_leave_nothing_behind() {
    check(12, 2000);
}
