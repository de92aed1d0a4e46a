//! Swarms of a program that is not ours: no signal handler of ours, several swarms, deadlines of their own, and observers
//! that fail.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use common::{assert_gone, swarm_of};
use rustix::process::{Pid, Signal, kill_process};
use vamaro_swarm::agent::AgentSettings;
use vamaro_swarm::base::error::{Error, Result};
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::Links;
use vamaro_swarm::supervisor::{Conduct, Deadlines, Decisions, Observer, Processes, Session, Stage};

/// Not a test: what the agents of the others run. None of those may have its name as a part of theirs, or agents
/// would run them too.
#[test]
fn agent() {
    vamaro_swarm::run_if_agent(&vamaro_swarm::agent::Registry::default());
}

fn conduct() -> Conduct {
    Conduct { command: common::this_binary(), ..Conduct::default() }
}

/// A swarm of two, and what it plays.
fn start(conduct: Conduct) -> (Processes, Session) {
    let task = Task::parse("hear-see").unwrap();
    let settings = AgentSettings::of(task.spec());
    let policy = settings.policy.load(task.spec()).unwrap();
    let links = Links::level(0.5);
    let session = Session::new(task.environment(1), links, 0);
    (Processes::start(&settings, &policy, conduct).unwrap(), session)
}

/// Does something once, when the team has decided at a step.
struct At<F> {
    step: u32,
    act: F,
}

impl<F: FnMut() -> Result<()>> Observer for At<F> {
    fn ticked(&mut self, stage: &Stage, _: &Decisions, _: Duration) -> Result<()> {
        if stage.tick().step == self.step { (self.act)() } else { Ok(()) }
    }
}

fn kill(process: Pid) -> Result<()> {
    kill_process(process, Signal::KILL).unwrap();
    Ok(())
}

/// Longer than any test waits.
const NEVER: Duration = Duration::from_secs(10_000);

#[test]
fn a_death_in_the_middle_of_an_episode_is_noticed_without_signal_handlers() {
    let deadlines = Deadlines { answer: NEVER, peers: NEVER, ..Deadlines::default() };
    for rate in [None, Some(50.0), Some(0.01)] {
        let (mut swarm, mut session) = start(Conduct { rate, deadlines, ..conduct() });
        let (agents, tag) = swarm_of(&swarm);
        // Nobody plays a period of 100 s to its end: it dies while the supervisor waits for the first one.
        let dying = agents[1];
        let mut observer = At { step: 7, act: || kill(dying) };
        let dies = std::thread::scope(|scope| {
            if rate == Some(0.01) {
                scope.spawn(|| kill(dying));
            }
            session.play(&mut swarm, u64::MAX, &mut [&mut observer])
        });
        let error = dies.unwrap_err().to_string();
        assert!(error.contains("agent-1") && error.contains("signal 9"), "{error}");
        drop(swarm);
        assert_gone(&agents, &tag);
    }
}

#[test]
fn swarms_of_one_program_do_not_take_each_others_dead() {
    let ((mut one, mut first), (mut two, mut second)) = (start(conduct()), start(conduct()));
    first.play(&mut one, 1, &mut []).unwrap();
    kill(swarm_of(&one).0[0]).unwrap();
    // It has ended when it is no more than a process to be reaped, and `one` has yet to look.
    second.play(&mut two, 3, &mut []).unwrap();
    let error = first.play(&mut one, u64::MAX, &mut []).unwrap_err().to_string();
    assert!(error.contains("agent-0") && error.contains("signal 9"), "{error}");
    drop(one);
    second.play(&mut two, 6, &mut []).unwrap();
}

#[test]
fn one_that_hangs_is_found_by_the_deadline_there_is() {
    let answer = Duration::from_millis(200);
    let deadlines = Deadlines { answer, ..Deadlines::default() };
    let (mut swarm, mut session) = start(Conduct { deadlines, ..conduct() });
    let (processes, tag) = swarm_of(&swarm);
    kill_process(processes[1], Signal::STOP).unwrap();
    let error = session.play(&mut swarm, 1, &mut []).unwrap_err().to_string();
    assert!(error.contains("agent-1 did not publish an observation within 200ms"), "{error}");
    drop(swarm);
    assert_gone(&processes, &tag);
}

#[test]
fn an_observer_that_fails_or_panics_leaves_nothing_behind() {
    let fails = || Err(Error::Failed("the disk is full".to_owned()));
    let panics = || panic!("a bug of the observer");
    let acts: [&dyn Fn() -> Result<()>; 2] = [&fails, &panics];
    for act in acts {
        let (mut swarm, mut session) = start(conduct());
        let (processes, tag) = swarm_of(&swarm);
        let mut observer = At { step: 7, act };
        let played = catch_unwind(AssertUnwindSafe(move || {
            session.play(&mut swarm, 1, &mut [&mut observer]).unwrap_err().to_string()
        }));
        assert!(played.is_err() || played.is_ok_and(|error| error == "the disk is full"));
        assert_gone(&processes, &tag);
    }
}
