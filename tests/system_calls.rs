//! A tick makes no system calls but waits and notifications: processes of a swarm that plays, traced call by call.
#![cfg(target_env = "gnu")]

mod common;

use std::collections::BTreeMap;
use std::io::{Error, Result};
use std::time::{Duration, Instant};

use common::Swarm;
use rustix::process::{Pid, WaitOptions, WaitStatus, waitpid};
use serde_json::Value;

/// What notifying comes to.
const NOTIFICATIONS: [(&str, i64); 1] = [("sendto", libc::SYS_sendto)];

/// What waiting comes to: a listener sets how it wants to receive, for how long, and receives.
const WAITS: [(&str, i64); 5] = [
    ("recvfrom", libc::SYS_recvfrom),
    ("fcntl", libc::SYS_fcntl),
    ("setsockopt", libc::SYS_setsockopt),
    ("sched_yield", libc::SYS_sched_yield),
    ("clock_nanosleep", libc::SYS_clock_nanosleep),
];

/// The most calls that one wait with no message in its socket makes: it makes the socket block (2) for so long (1),
/// receives, makes it not block (2), and receives until nothing is left, which here is one message.
const CALLS_A_WAIT: u64 = 2 + 1 + 1 + 2 + 2;

/// Calls of the first ticks, in which ports are still being connected.
const WARM_UP: usize = 500;

/// Calls that are judged.
const STRETCH: usize = 10_000;

/// How long tracing may take.
const DEADLINE: Duration = Duration::from_secs(60);

#[test]
fn an_agent_that_blocks_waits_twice_a_tick_and_notifies_twice() {
    for task in ["hear-see", "spread-xy-4"] {
        let (calls, ticks) = traced(task, "block", |swarm| swarm.agents[0]);
        // A wake-up may be left over from the last wait, hence a third one.
        check(task, &calls, 2 * ticks, 3 * CALLS_A_WAIT * ticks);
    }
}

#[test]
fn a_supervisor_that_blocks_waits_for_each_agent_twice_a_tick_and_notifies_it_twice() {
    for (task, agents) in [("hear-see", 2), ("spread-xy-4", 4)] {
        let (calls, ticks) = traced(task, "block", Swarm::supervisor);
        // Each agent's notification may end a wait of its own.
        check(task, &calls, 2 * agents * ticks, 2 * agents * CALLS_A_WAIT * ticks);
    }
}

#[test]
fn processes_that_spin_only_yield() {
    for process in [|swarm: &Swarm| swarm.agents[0], Swarm::supervisor] {
        let (calls, _) = traced("spread-xy-4", "spin", process);
        assert_eq!(calls.keys().collect::<Vec<_>>(), [&libc::SYS_sched_yield], "{}", words(&calls));
    }
}

/// System calls by number.
type Calls = BTreeMap<i64, u64>;

/// Traces one process of a swarm that plays; its calls, and the ticks of the swarm from its start to a moment after the
/// stretch.
fn traced(task: &str, wait: &str, process: impl Fn(&Swarm) -> Pid) -> (Calls, u64) {
    let swarm = Swarm::start(&format!("--task {task} --p 0.5 --wait {wait} --json"));
    let calls = Tracer::seize(process(&swarm)).calls();
    swarm.signal_supervisor(rustix::process::Signal::TERM);
    let (_, json, stderr) = swarm.wait();
    let summary: Value = serde_json::from_str(&json).unwrap_or_else(|e| panic!("{e}: {json}{stderr}"));
    (calls, summary["ticks"].as_u64().expect("ticks were played"))
}

/// Fails if there are calls other than these, or more.
fn check(task: &str, calls: &Calls, notifications: u64, waits: u64) {
    let sum = |known: &[(&str, i64)]| known.iter().filter_map(|(_, number)| calls.get(number)).sum::<u64>();
    let (notified, waited) = (sum(&NOTIFICATIONS), sum(&WAITS));
    let all: u64 = calls.values().sum();
    assert!(
        !calls.contains_key(&libc::SYS_clock_gettime),
        "{task}: the kernel is asked for the time; this machine's clock has no vDSO: {}",
        words(calls)
    );
    assert_eq!(
        notified + waited,
        all,
        "{task}: something else than waits and notifications: {}",
        words(calls)
    );
    assert!(notified > 0, "{task}: the stretch has no ticks: {}", words(calls));
    assert!(notified <= notifications, "{task}: more than {notifications} notifications: {}", words(calls));
    assert!(waited <= waits, "{task}: more than {waits} calls for waits: {}", words(calls));
}

/// The calls for an error, by name where it is known.
fn words(calls: &Calls) -> String {
    let known = || NOTIFICATIONS.iter().chain(&WAITS);
    let name = |number: i64| known().find(|(_, known)| *known == number).map(|(name, _)| (*name).to_owned());
    let word = |(number, count): (&i64, &u64)| {
        format!("{count} x {}", name(*number).unwrap_or_else(|| format!("call number {number}")))
    };
    calls.iter().map(word).collect::<Vec<String>>().join(", ")
}

/// A thread of another process, stopped at each of its system calls. Only the thread that seized it can go on with it.
struct Tracer {
    process: Pid,
    deadline: Instant,
}

/// A stop with an event, such as that of a process which is interrupted, in the upper half of its status.
const EVENT: i32 = 16;

/// What is added to the signal of a stop at a system call.
const AT_CALL: i32 = 0x80;

impl Tracer {
    fn seize(process: Pid) -> Tracer {
        let tracer = Tracer { process, deadline: Instant::now() + DEADLINE };
        let seized = tracer.ask(libc::PTRACE_SEIZE, 0, libc::PTRACE_O_TRACESYSGOOD as usize);
        if let Err(e) = seized.and_then(|_| tracer.ask(libc::PTRACE_INTERRUPT, 0, 0)) {
            panic!(
                "cannot trace {process:?}: {e}; this test traces processes that it has started (a container may need \
                 --cap-add SYS_PTRACE, and kernel.yama.ptrace_scope must be below 2)"
            );
        }
        tracer
    }

    /// The calls of a stretch, after which the process runs free.
    fn calls(self) -> Calls {
        let mut calls = Calls::new();
        let mut seen = 0;
        while seen < WARM_UP + STRETCH {
            let status = self.stop();
            let signal =
                status.stopping_signal().unwrap_or_else(|| panic!("the process has ended: {status:?}"));
            let at_call = signal == libc::SIGTRAP | AT_CALL;
            if let Some(number) = at_call.then(|| self.entered()).flatten() {
                seen += 1;
                if seen > WARM_UP {
                    *calls.entry(number).or_default() += 1;
                }
            }
            let is_signal = !at_call && status.as_raw() >> EVENT == 0;
            let passed_on = if is_signal { signal as usize } else { 0 };
            self.ask(libc::PTRACE_SYSCALL, 0, passed_on).expect("the process is stopped");
        }
        // Only a stopped process can be let go.
        self.stop();
        self.ask(libc::PTRACE_DETACH, 0, 0).expect("the process is stopped");
        calls
    }

    /// Waits until the process stops or ends.
    fn stop(&self) -> WaitStatus {
        loop {
            match waitpid(Some(self.process), WaitOptions::NOHANG).expect("the process is traced") {
                Some((_, status)) => return status,
                None => assert!(Instant::now() < self.deadline, "tracing takes too long"),
            }
            std::thread::sleep(Duration::from_micros(20));
        }
    }

    /// The number of the system call that begins at this stop; none if one ends.
    fn entered(&self) -> Option<i64> {
        const SIZE: usize = size_of::<libc::ptrace_syscall_info>();
        let mut info = std::mem::MaybeUninit::<libc::ptrace_syscall_info>::zeroed();
        self.ask(libc::PTRACE_GET_SYSCALL_INFO, SIZE, info.as_mut_ptr() as usize)
            .expect("the process is stopped");
        // SAFETY: zeros are a valid value, of which the kernel has overwritten what `op` says.
        let info = unsafe { info.assume_init() };
        match info.op {
            // SAFETY: it says so.
            libc::PTRACE_SYSCALL_INFO_ENTRY => Some(unsafe { info.u.entry.nr } as i64),
            _ => None,
        }
    }

    fn ask(&self, request: libc::c_uint, address: usize, data: usize) -> Result<i64> {
        let process = self.process.as_raw_nonzero().get();
        // SAFETY: of the requests above only one writes to this process, to the `address` bytes behind `data` that
        // are there for that.
        match unsafe { libc::ptrace(request as _, process, address, data) } {
            -1 => Err(Error::last_os_error()),
            answer => Ok(answer),
        }
    }
}
