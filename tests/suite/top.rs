//! `top`: watching a swarm of another process, through a pseudo-terminal. Whatever becomes of those who watch, the swarm plays
//! on.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::{Signal, kill_process};

use crate::common::{HeldSwarm, Swarm, assert_gone, fail, is_running, root, shared_memory};
use crate::view::Seat;

/// Longer than anything takes here.
const LONG: Duration = Duration::from_secs(60);

fn await_that(holds: impl Fn() -> bool, what: &str) {
    let deadline = Instant::now() + LONG;
    while !holds() {
        assert!(Instant::now() < deadline, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A seat from which a swarm that can be watched is watched.
fn watch(swarm: &Swarm, columns: u16, rows: u16) -> Seat {
    Seat::at(&format!("top {}", swarm.supervisor().as_raw_nonzero()), columns, rows)
}

#[test]
fn a_swarm_is_watched_and_left_as_it_was() {
    let mut swarm = Swarm::start("--agents 4 --p 0.5");
    swarm.first_line();
    // The swarm itself may still be making its own.
    let shared_with_guests = || shared_memory(&format!("{}-", swarm.tag)).len();
    let before = shared_with_guests();
    let mut seat = watch(&swarm, 80, 24);
    seat.sees(&["spread-xy-4  episode", "watching", "the world as agent 0 knows it", "p = 0.5", "q quit"]);
    seat.press("\t");
    seat.sees(&["the world as agent 1 knows it"]);
    seat.press("k");
    seat.sees(&["top only watches"]);
    seat.press(" ");
    seat.sees(&["picture held"]);
    // Others come and are killed, more than there are places for.
    for _ in 0..5 {
        let mut other = watch(&swarm, 100, 30);
        other.sees(&["watching", "step "]);
        assert!(shared_with_guests() > before);
        kill_process(other.id(), Signal::KILL).unwrap();
        other.program.wait().unwrap();
    }
    let (columns, rows) = (120, 40);
    let mut last = watch(&swarm, columns, rows);
    last.sees(&["watching", "step "]);
    last.press("q");
    for seat in [last, {
        seat.press("q");
        seat
    }] {
        let (code, text) = seat.ends();
        assert_eq!((code, text.trim()), (Some(0), ""));
    }
    await_that(|| shared_with_guests() == before, "something is left of those who watched");
    assert!(swarm.agents.iter().all(|agent| is_running(*agent)));
    swarm.signal_supervisor(Signal::INT);
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
    assert!(!stdout.contains("by hand"), "{stdout}");
    assert_gone(&agents, &tag);
}

#[test]
fn a_swarm_waits_for_nobody_who_watches_and_says_when_it_ends() {
    let mut held = HeldSwarm::start("--agents 2 --p 0.5 --episodes 8");
    let (agents, tag) = (held.swarm.agents.clone(), held.swarm.tag.clone());
    let (sign, process) = (root(&tag).join("view.json"), held.swarm.supervisor().as_raw_nonzero());
    await_that(|| Path::new(&sign).exists(), "it cannot be watched");
    let mut stopped = watch(&held.swarm, 80, 24);
    stopped.sees(&["watching", "waiting for the next tick"]);
    kill_process(stopped.id(), Signal::STOP).unwrap();
    held.let_go();
    let (code, stderr) = held.wait();
    assert_eq!(code, Some(0), "{stderr}");
    assert_gone(&agents, &tag);
    kill_process(stopped.id(), Signal::CONT).unwrap();
    let (code, text) = stopped.ends();
    assert_eq!((code, text.trim()), (Some(0), format!("The swarm of process {process} has ended.").as_str()));
    assert_gone(&agents, &tag);
}

#[test]
fn who_interrupts_it_leaves_and_the_swarm_plays_on() {
    let mut swarm = Swarm::start("--task speaker-listener --rate 50 --on-failure restart --chaos kill=0.001");
    swarm.first_line();
    let mut seat = watch(&swarm, 200, 60);
    seat.sees(&["speaker-listener  episode", "no ghosts: nobody observes where agents are"]);
    seat.press("\x03");
    let (code, text) = seat.ends();
    assert_eq!(code, Some(130), "{text}");
    assert!(text.contains("error: interrupted"), "{text}");
    assert!(is_running(swarm.supervisor()));
}

#[test]
fn what_cannot_be_watched_is_said() {
    fail("top 4194304", 2, &["there is no process 4194304"]);
    fail(&format!("top {}", std::process::id()), 2, &["runs no swarm that can be watched"]);
    fail("top -1", 2, &["PID"]);
}
