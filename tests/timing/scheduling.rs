//! Real-time hygiene: what is said to be granted is what the kernel says, whatever this machine permits.

use crate::common::{self, Swarm, fail, status, succeed};
use rustix::process::{Pid, Signal};
use serde_json::Value;

/// Steps of an episode of every built-in task.
const EPISODE_STEPS: usize = 25;

/// The number of the scheduling policy and the real-time priority of a process's first thread.
fn policy(process: Pid) -> (u32, u32) {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.as_raw_nonzero())).unwrap();
    // The name before it may hold anything; what follows begins with field 3.
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    let field = |number: usize| fields[number - 3].parse().unwrap();
    (field(41), field(40))
}

fn is_pinned(process: Pid) -> bool {
    status(process, "Cpus_allowed_list").parse::<usize>().is_ok()
}

fn is_locked(process: Pid) -> bool {
    status(process, "VmLck") != "0 kB"
}

/// Runs a swarm of four agents with these words, has `look` see its processes while it plays, and ends it; its summary
/// and what it said on stderr.
fn play(words: &str, mut look: impl FnMut(Pid)) -> (String, String) {
    let mut swarm = Swarm::start(&format!("--agents 4 --p 0.2 {words}"));
    assert!(swarm.first_line().contains("4 agents as processes"), "it plays");
    swarm.agents.iter().copied().chain([swarm.supervisor()]).for_each(&mut look);
    // There is a summary after an episode. An agent sleeps twice a tick, and again only if nothing comes for long.
    common::await_sleeps(swarm.agents[0], 4 * EPISODE_STEPS);
    swarm.signal_supervisor(Signal::TERM);
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
    (stdout, stderr)
}

/// The same, counting the processes in which `holds`; their number, the line of the summary and what was said.
fn count(words: &str, holds: impl Fn(Pid) -> bool) -> (usize, String, String) {
    let mut holding = 0;
    let (stdout, stderr) = play(words, |process| holding += usize::from(holds(process)));
    // Lines are broken where a terminal ends.
    let stdout = stdout.replace("\n            ", " ");
    let line = stdout.lines().find(|line| line.starts_with("scheduling")).expect(&stdout);
    (holding, line.to_owned(), stderr)
}

/// Fails unless the summary counts `holding` of five processes with `said`, and what was refused is said at once.
fn assert_said(holding: usize, said: &str, line: &str, stderr: &str) {
    assert!(line.contains(&format!("{said} {holding} of 5")), "{holding}: {line}");
    assert_eq!(line.contains("not permitted"), holding < 5, "{line}");
    assert_eq!(stderr.contains(&format!("note: {said} {holding} of 5 ")), holding < 5, "{stderr}");
}

#[test]
fn pinned_processes_have_one_core_each() {
    let (pinned, line, stderr) = count("--pin", is_pinned);
    assert_said(pinned, "pinned", &line, &stderr);
}

#[test]
fn locked_memory_is_what_the_kernel_counts() {
    let (locked, line, stderr) = count("--lock-memory", is_locked);
    assert_said(locked, "memory locked in", &line, &stderr);
}

#[test]
fn real_time_processes_have_the_policy_and_its_priority() {
    const SCHED_FIFO: u32 = 1;
    for (words, priority) in [("--fifo", 10), ("--fifo 3", 3)] {
        let (first, line, stderr) = count(words, |process| policy(process) == (SCHED_FIFO, priority));
        assert_said(first, &format!("SCHED_FIFO {priority} in"), &line, &stderr);
    }
}

#[test]
fn nothing_is_done_unasked() {
    let ours = Pid::from_raw(std::process::id() as i32).unwrap();
    let (stdout, stderr) = play("", |process| {
        assert_eq!(status(process, "Cpus_allowed_list"), status(ours, "Cpus_allowed_list"));
        assert_eq!((is_locked(process), policy(process)), (false, policy(ours)));
    });
    assert!(!stdout.contains("scheduling") && !stderr.contains("note"), "{stdout}{stderr}");
}

#[test]
fn results_do_not_depend_on_scheduling() {
    let result = |words: &str| {
        let words = format!("spawn --agents 4 --p 0.2 --episodes 20 --audit --json {words}");
        let mut json: Value = serde_json::from_str(&succeed(&words)).unwrap();
        for time in ["tick_p50_us", "tick_p99_us", "elapsed_s"] {
            json[time] = Value::Null;
        }
        let scheduling = json["scheduling"].take();
        (json, scheduling)
    };
    let (usual, nothing) = result("");
    assert_eq!(nothing, Value::Null);
    let (with_all, granted) = result("--pin --lock-memory --fifo 5");
    assert_eq!(with_all, usual);
    assert_eq!((&granted["processes"], &granted["priority"]), (&5.into(), &5.into()));
    assert!(
        ["cores", "pinned", "memory_locked", "fifo"].iter().all(|key| granted[key].is_u64()),
        "{granted}"
    );
    let (_, granted) = result("--lock-memory");
    assert_eq!((&granted["pinned"], &granted["priority"]), (&Value::Null, &Value::Null));
}

#[test]
fn requests_that_make_no_sense() {
    for words in ["--pin", "--lock-memory", "--fifo"] {
        fail(&format!("spawn --in-process {words}"), 2, &["--in-process", words]);
    }
    for priority in ["0", "100", "-1", "high"] {
        fail(&format!("spawn --fifo {priority}"), 2, &["--fifo", priority]);
    }
    fail("spawn --fifo --wait spin", 2, &["--wait block"]);
}
