//! Agents that are killed again and again leave nothing behind.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

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

/// What is done to agents, again and again.
struct Injury {
    /// How the swarm is started, besides `spawn` and the number of episodes.
    words: String,
    agents: usize,
    signal: Signal,
    /// How many are hit at a time.
    together: usize,
}

impl Injury {
    /// Hits agents `times` times, each time when all are there. Returns what the swarm held after each agent had been hit
    /// once, and at the end, and its summary.
    fn repeat(&self, times: usize) -> (Vec<Held>, Value) {
        let Injury { ref words, agents, signal, together } = *self;
        let swarm = Swarm::start(&format!("{words} --json"));
        let mut held = Vec::new();
        for time in 0..=times {
            let there = await_all(&swarm, agents, time);
            // After each has been hit once, all is as it will be.
            if time == agents || time == times {
                held.push(Held::by(&swarm));
            }
            if time < times {
                let victims: Vec<Pid> = (0..together).map(|n| there[(time * 7 + n) % agents]).collect();
                victims.iter().for_each(|victim| kill_process(*victim, signal).unwrap());
                await_end(&victims);
            }
        }
        swarm.signal_supervisor(Signal::INT);
        let tag = swarm.tag.clone();
        let (code, stdout, stderr) = swarm.wait();
        assert_eq!(code, Some(130), "{stderr}");
        common::assert_gone(&[], &tag);
        let summary: Value = serde_json::from_str(&stdout).unwrap();
        (held, summary)
    }
}

/// Waits until all agents are there and play; who they are.
fn await_all(swarm: &Swarm, agents: usize, time: usize) -> Vec<Pid> {
    let deadline = Instant::now() + LONG;
    let there = loop {
        let there = running(swarm);
        if there.len() == agents && there.iter().all(|agent| common::settings_of(*agent).is_some()) {
            break there;
        }
        assert!(Instant::now() < deadline, "nobody comes back after {time} times");
        std::thread::sleep(Duration::from_millis(1));
    };
    common::await_sleeps(swarm.supervisor(), 20);
    there
}

/// Waits until processes have ended; how long that took.
fn await_end(processes: &[Pid]) -> Duration {
    let began = Instant::now();
    while processes.iter().any(|process| common::is_running(*process)) {
        assert!(began.elapsed() < LONG, "one of {processes:?} does not end");
        std::thread::sleep(Duration::from_millis(1));
    }
    began.elapsed()
}

const LONG: Duration = Duration::from_secs(60);

fn check(agents: usize, kills: usize) {
    let words = format!("--agents {agents} --policy untrained --imputer hold --p 0.5 --deadline 60s");
    let (held, summary) = Injury { words, agents, signal: Signal::KILL, together: 1 }.repeat(kills);
    let faults = ["deaths", "hangs", "restarts"].map(|what| summary["faults"][what].as_u64().unwrap());
    assert_eq!(faults, [kills as u64, 0, kills as u64], "{summary}");
    println!("{}\nafter {agents} kills and after {kills}: {held:#?}", summary["faults"]);
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

/// The table of docs/reliability.md: `cargo test --release --test timing -- --ignored --nocapture how_long`.
#[test]
#[ignore = "takes minutes"]
fn how_long_each_fault_lasts() {
    const TIMES: usize = 100;
    let lockstep = "--agents 4 --p 0.2";
    for (what, words, signal, together) in [
        ("SIGKILL", lockstep, Signal::KILL, 1),
        ("SIGABRT", lockstep, Signal::ABORT, 1),
        ("SIGKILL of three at once", lockstep, Signal::KILL, 3),
        ("SIGSTOP until the deadline", lockstep, Signal::STOP, 1),
        ("SIGKILL at 100 Hz", "--agents 4 --p 0.2 --rate 100", Signal::KILL, 1),
        ("SIGSTOP at 100 Hz", "--agents 4 --p 0.2 --rate 100", Signal::STOP, 1),
    ] {
        let injury = Injury { words: words.to_owned(), agents: 4, signal, together };
        let faults = injury.repeat(TIMES).1["faults"].take();
        println!("{what}, {TIMES} times: {faults}");
    }
    let mut took: Vec<Duration> = (0..TIMES)
        .map(|_| {
            let swarm = Swarm::start(lockstep);
            swarm.signal_supervisor(Signal::KILL);
            await_end(&swarm.agents)
        })
        .collect();
    took.sort();
    println!(
        "SIGKILL of the supervisor, {TIMES} times: its agents end after {:?}, {:?}",
        took[TIMES / 2],
        took[TIMES - 1]
    );
    common::succeed("spawn --episodes 1");
}
