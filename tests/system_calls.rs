//! A tick makes no system calls but waits and notifications: processes of swarms that play, traced call by call from
//! before the first tick to after the last, so that it is known how many ticks the calls are for.
#![cfg(target_env = "gnu")]

mod common;

use std::collections::BTreeMap;
use std::io::{Error, Result};
use std::time::{Duration, Instant};

use common::{HeldSwarm, Swarm};
use rustix::process::{Pid, WaitOptions, WaitStatus, waitpid};

/// Steps of an episode of every built-in task.
const EPISODE_STEPS: usize = 25;

/// What notifying makes: one call for each listener, none if it has yet to look at the last one.
const NOTIFYING: [i64; 1] = [libc::SYS_sendto];

/// What waiting for a message makes: a listener sets how it wants to receive, for how long, and receives.
const WAITING: [i64; 3] = [libc::SYS_recvfrom, libc::SYS_fcntl, libc::SYS_setsockopt];

/// What waiting for a moment makes: one call.
const SLEEPING: [i64; 1] = [libc::SYS_clock_nanosleep];

/// What spinning makes, and letting others go first.
const YIELDING: [i64; 1] = [libc::SYS_sched_yield];

/// The most calls that one wait makes: it makes the socket block (2) for so long (1), receives (1), makes it not block
/// (2), and receives until nothing is left, which may be one message (2).
const CALLS_A_WAIT: usize = 8;

/// The longest sleep of a wait; after it there is another.
const LONGEST_SLEEP: Duration = Duration::from_millis(100);

/// What is played where everybody waits for everybody.
const LOCKSTEP: &str = "--p 0.5 --episodes 8 --deadline 60s";
const TICKS: usize = 8 * EPISODE_STEPS;

/// What is played against the clock. A traced process is slow, so it misses ticks.
const REAL_TIME: &str = "--p 0.5 --rate 1000 --episodes 60 --deadline 60s";
const PERIODS: usize = 60 * EPISODE_STEPS;

/// How long a traced process stands still at each stop.
const POLL: Duration = Duration::from_micros(20);
const SLOW_POLL: Duration = Duration::from_millis(1);

/// How long tracing may take.
const DEADLINE: Duration = Duration::from_secs(60);

#[test]
fn an_agent_that_blocks_waits_twice_a_tick_notifies_twice_and_lets_others_go_first_once() {
    for task in ["hear-see", "spread-xy-4"] {
        let trace = Trace::of(&format!("--task {task} {LOCKSTEP}"), an_agent);
        let known = [&NOTIFYING[..], &WAITING, &YIELDING].concat();
        trace.assert_only(&known, libc::SYS_sendto, 2 * EPISODE_STEPS);
        trace.assert_at_most(TICKS, &YIELDING);
        // Its word that it is ready may be traced too.
        trace.assert_at_most(2 * TICKS + 1, &NOTIFYING);
        // The supervisor notifies it twice a tick, and of the end. Any of this ends one wait.
        trace.assert_waits_at_most(2 * TICKS + 1);
    }
}

#[test]
fn a_supervisor_that_blocks_waits_for_each_agent_twice_a_tick_and_notifies_it_twice() {
    for (task, agents) in [("hear-see", 2), ("spread-xy-4", 4)] {
        let trace = Trace::of(&format!("--task {task} {LOCKSTEP}"), Swarm::supervisor);
        let episode = 2 * agents * EPISODE_STEPS;
        trace.assert_only(&[&NOTIFYING[..], &WAITING].concat(), libc::SYS_sendto, episode);
        // In the end it sends all away.
        trace.assert_at_most(2 * agents * TICKS + agents, &NOTIFYING);
        // Each agent notifies it twice a tick, and when it is ready. Any of this ends one wait.
        trace.assert_waits_at_most(2 * agents * TICKS + agents);
    }
}

#[test]
fn an_agent_in_real_time_waits_for_its_sensor_and_the_deadline_and_notifies_nobody() {
    let trace = Trace::of(&format!("--task spread-xy-4 {REAL_TIME}"), an_agent);
    trace.assert_only(&[&WAITING[..], &SLEEPING].concat(), libc::SYS_clock_nanosleep, EPISODE_STEPS);
    trace.assert_at_most(1, &NOTIFYING);
    trace.assert_at_most(PERIODS, &SLEEPING);
    // A notification may come so late that it ends a wait for the next one.
    trace.assert_waits_at_most(5 * trace.count(&SLEEPING) / 4);
}

#[test]
fn a_supervisor_in_real_time_sleeps_to_ends_and_beginnings_of_periods_and_notifies_each_agent_once() {
    let (agents, sleeps) = (4, libc::SYS_clock_nanosleep);
    let trace = Trace::of(&format!("--task spread-xy-4 {REAL_TIME}"), Swarm::supervisor);
    trace.assert_only(&[&NOTIFYING[..], &SLEEPING].concat(), sleeps, EPISODE_STEPS);
    // A beginning is only slept to after periods that were left out.
    trace.assert_at_most(2 * PERIODS, &SLEEPING);
    trace.assert_at_most(agents * PERIODS + agents, &NOTIFYING);
}

#[test]
fn processes_that_spin_make_no_call_a_tick_but_yield() {
    // Enough that what it takes to begin and to leave, up to some 900 calls, is far from one a tick.
    const EPISODES: usize = 80;
    const TICKS: usize = EPISODES * EPISODE_STEPS;
    for process in [an_agent as fn(&Swarm) -> Pid, Swarm::supervisor] {
        let words = format!("--task hear-see --p 0.5 --episodes {EPISODES} --wait spin");
        let trace = Trace::of(&words, process);
        // The yields of the first and the last tick cannot be told from those before and after.
        let others = trace.calls.len() - trace.count(&YIELDING);
        assert!(others < TICKS, "{others} in {TICKS} ticks: {}", trace.words());
        assert!(trace.count(&YIELDING) > 0, "{}", trace.words());
    }
}

fn an_agent(swarm: &Swarm) -> Pid {
    swarm.agents[0]
}

/// The system calls of one process, by number: from before the first tick to when it ends, or looks after children
/// that it has sent away.
struct Trace {
    calls: Vec<i64>,
    took: Duration,
}

impl Trace {
    /// Plays a swarm to its end. Its last agent is made slower than the traced process, so that this has to wait,
    /// and what it notifies has looked at the last notification.
    fn of(words: &str, process: impl Fn(&Swarm) -> Pid) -> Trace {
        let mut held = HeldSwarm::start(words);
        let began = Instant::now();
        let tracer = Tracer::seize(process(&held.swarm), POLL);
        let last = *held.swarm.agents.last().unwrap();
        let slower = std::thread::spawn(move || drop(Tracer::seize(last, SLOW_POLL).calls()));
        held.let_go();
        let trace = Trace { calls: tracer.calls(), took: began.elapsed() };
        slower.join().unwrap();
        let (code, stderr) = held.wait();
        assert_eq!(code, Some(0), "{words}: {stderr}");
        trace
    }

    fn count(&self, known: &[i64]) -> usize {
        self.calls.iter().filter(|call| known.contains(call)).count()
    }

    fn assert_at_most(&self, most: usize, known: &[i64]) {
        let found = self.count(known);
        assert!(found <= most, "{found} calls for what takes {most}: {}", self.words());
    }

    /// Fails if there were more waits for messages than so many and those that ended because they were long.
    fn assert_waits_at_most(&self, most: usize) {
        let most = most + self.took.div_duration_f64(LONGEST_SLEEP) as usize;
        self.assert_at_most(most, &[libc::SYS_setsockopt]);
        // One that finds it has been notified already does not sleep, and says nothing of how long.
        self.assert_at_most(2 * CALLS_A_WAIT * most, &WAITING);
    }

    /// Fails if there is a call other than the `known` ones after so many of one kind, which are made while ports are
    /// still being connected, and before as many in the end, when all leave.
    fn assert_only(&self, known: &[i64], kind: i64, many: usize) {
        let mut of_kind = self.calls.iter().enumerate().filter(|(_, call)| **call == kind).map(|(at, _)| at);
        let (begin, end) = (of_kind.nth(many), of_kind.nth_back(many));
        let (Some(begin), Some(end)) = (begin, end) else { panic!("too few ticks: {}", self.words()) };
        let judged = Trace { calls: self.calls[begin..end].to_vec(), took: self.took };
        assert!(
            self.count(&[libc::SYS_clock_gettime]) == 0,
            "the kernel is asked for the time; this machine's clock has no vDSO: {}",
            self.words()
        );
        assert_eq!(
            judged.count(known),
            judged.calls.len(),
            "something else than waits and notifications: {}",
            judged.words()
        );
    }

    /// How many of each, for an error.
    fn words(&self) -> String {
        const NAMES: [(i64, &str); 6] = [
            (libc::SYS_sendto, "sendto"),
            (libc::SYS_recvfrom, "recvfrom"),
            (libc::SYS_fcntl, "fcntl"),
            (libc::SYS_setsockopt, "setsockopt"),
            (libc::SYS_sched_yield, "sched_yield"),
            (libc::SYS_clock_nanosleep, "clock_nanosleep"),
        ];
        let mut counts = BTreeMap::<i64, usize>::new();
        self.calls.iter().for_each(|call| *counts.entry(*call).or_default() += 1);
        let name = |call: &i64| NAMES.iter().find(|(number, _)| number == call).map(|(_, name)| *name);
        let word = |(call, count): (&i64, &usize)| match name(call) {
            Some(name) => format!("{count} x {name}"),
            None => format!("{count} x call number {call}"),
        };
        counts.iter().map(word).collect::<Vec<String>>().join(", ")
    }
}

/// A thread of another process, stopped at each of its system calls. Only the thread that seized it can go on with it.
struct Tracer {
    process: Pid,
    poll: Duration,
    deadline: Instant,
}

/// A stop with an event, such as that of a process which is interrupted, in the upper half of its status.
const EVENT: i32 = 16;

/// What is added to the signal of a stop at a system call.
const AT_CALL: i32 = 0x80;

impl Tracer {
    fn seize(process: Pid, poll: Duration) -> Tracer {
        let tracer = Tracer { process, poll, deadline: Instant::now() + DEADLINE };
        let seized = tracer.ask(libc::PTRACE_SEIZE, 0, libc::PTRACE_O_TRACESYSGOOD as usize);
        if let Err(e) = seized.and_then(|_| tracer.ask(libc::PTRACE_INTERRUPT, 0, 0)) {
            panic!(
                "cannot trace {process:?}: {e}; this test traces processes that it has started (a container may need \
                 --cap-add SYS_PTRACE, and kernel.yama.ptrace_scope must be below 2)"
            );
        }
        tracer
    }

    /// All calls until the process ends or waits for a child; then it runs free.
    fn calls(self) -> Vec<i64> {
        const LAST: [i64; 3] = [libc::SYS_exit_group, libc::SYS_wait4, libc::SYS_waitid];
        let mut calls = Vec::new();
        loop {
            let status = self.stop();
            // An agent that takes too long to leave is killed.
            let Some(signal) = status.stopping_signal() else { return calls };
            let at_call = signal == libc::SIGTRAP | AT_CALL;
            if let Some(number) = at_call.then(|| self.entered()).flatten() {
                if LAST.contains(&number) {
                    self.ask(libc::PTRACE_DETACH, 0, 0).expect("the process is stopped");
                    return calls;
                }
                calls.push(number);
            }
            let is_signal = !at_call && status.as_raw() >> EVENT == 0;
            let passed_on = if is_signal { signal as usize } else { 0 };
            self.go_on(passed_on);
        }
    }

    /// Until the next stop. A process that has been killed in this one does not mind.
    fn go_on(&self, passed_on: usize) {
        if let Err(e) = self.ask(libc::PTRACE_SYSCALL, 0, passed_on) {
            assert_eq!(e.raw_os_error(), Some(libc::ESRCH), "{e}");
        }
    }

    /// Waits until the process stops or ends.
    fn stop(&self) -> WaitStatus {
        loop {
            match waitpid(Some(self.process), WaitOptions::NOHANG).expect("the process is traced") {
                Some((_, status)) => return status,
                None => assert!(Instant::now() < self.deadline, "tracing takes too long"),
            }
            std::thread::sleep(self.poll);
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
