//! Swarms of a program that is not ours: no signal handler of ours, several swarms, deadlines of their own, and observers
//! that fail.

use std::error::Error as _;
use std::time::Duration;

use crate::common::{self, assert_gone, swarm_of};
use rustix::process::{Pid, Signal, kill_process};
use vamaro_swarm::agent::{AgentSettings, PolicySource};
use vamaro_swarm::base::error::{Error, Result};
use vamaro_swarm::environment::{
    About, ActionSpace, Actions, AgentSpec, End, Spec, State, Task, Value, World, Worlds,
};
use vamaro_swarm::link::Links;
use vamaro_swarm::supervisor::{
    Conduct, Deadlines, Decisions, Observer, Processes, Session, Stage, Statistics,
};
use vamaro_swarm::{Swarm, SwarmBuilder};

fn conduct() -> Conduct {
    Conduct { command: Some(common::this_binary()), ..Conduct::default() }
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
    // Its peers are told to leave while they wait for it, and do so by themselves.
    let deadlines = Deadlines { answer: NEVER, peers: NEVER, leave: NEVER, ..Deadlines::default() };
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
    let deadlines = Deadlines { answer, leave: answer, ..Deadlines::default() };
    let (mut swarm, mut session) = start(Conduct { deadlines, ..conduct() });
    let (processes, tag) = swarm_of(&swarm);
    kill_process(processes[1], Signal::STOP).unwrap();
    let error = session.play(&mut swarm, 1, &mut []).unwrap_err().to_string();
    assert!(error.contains("agent-1 did not") && error.contains("ms"), "{error}");
    drop(swarm);
    assert_gone(&processes, &tag);
}

/// A world of one that stands still, and fails or panics in the third episode.
struct Fragile {
    episode: u64,
    breaks: fn() -> Result<End>,
}

impl World for Fragile {
    fn reset(&mut self, _seed: u64, episode: u64) -> Result<()> {
        self.episode = episode;
        Ok(())
    }

    fn observe(&self, _agent: usize, out: &mut [f32]) {
        out.fill(0.5);
    }

    fn step(&mut self, _actions: Actions, rewards: &mut [f64]) -> Result<End> {
        rewards.fill(1.0);
        if self.episode == 2 { (self.breaks)() } else { Ok(End::Open) }
    }

    fn set_state(&mut self, _state: &State, _last_actions: Option<Actions>) -> Result<()> {
        Ok(())
    }
}

fn fragile(breaks: fn() -> Result<End>) -> SwarmBuilder {
    let value = Value::word(About::Message);
    let agent =
        AgentSpec { name: "lonely".to_owned(), observation: vec![value], actions: ActionSpace::Discrete(2) };
    let world = Worlds::new(Spec::of("fragile", vec![agent]), 1, move |_| Fragile { episode: 0, breaks });
    let builder = Swarm::builder().environment(world).policy(PolicySource::Untrained(1));
    builder.agent_command(common::this_binary())
}

#[test]
fn an_environment_that_fails_or_panics_takes_the_swarm_down_and_keeps_what_was_counted() {
    let fails: fn() -> Result<End> = || Err(Error::outside(std::io::Error::from_raw_os_error(28)));
    let panics: fn() -> Result<End> = || panic!("division by zero");
    for breaks in [fails, panics] {
        let mut swarm = fragile(breaks).build().unwrap();
        let (agents, tag) = swarm_of(swarm.processes().unwrap());
        assert_eq!(swarm.play(1).unwrap().episodes().len(), 1);
        let error = swarm.play(9).unwrap_err();
        let of_the_disk = error.source().and_then(|source| source.downcast_ref::<std::io::Error>());
        let panicked = error.to_string().contains("panicked (division by zero)");
        assert!(panicked || of_the_disk.and_then(|e| e.raw_os_error()) == Some(28), "{error:?}");
        assert_gone(&agents, &tag);
        assert_eq!(swarm.statistics().episodes().len(), 2);
        let again = swarm.play(1).unwrap_err().to_string();
        assert!(again.contains("shut down"), "{again}");
    }
}

#[test]
fn an_observer_that_fails_or_panics_leaves_nothing_behind() {
    let fails: fn() -> Result<()> = || Err(Error::Failed("the disk is full".to_owned()));
    let panics: fn() -> Result<()> = || panic!("a bug of the observer");
    for (act, saying) in [(fails, "the disk is full"), (panics, "panicked (a bug of the observer)")] {
        let mut swarm = fragile(|| Ok(End::Open)).build().unwrap();
        let (agents, tag) = swarm_of(swarm.processes().unwrap());
        let error = swarm.play_before(1, &mut [&mut At { step: 7, act }]).unwrap_err().to_string();
        assert!(error.contains(saying), "{error}");
        assert_gone(&agents, &tag);
    }
}

#[test]
fn a_swarm_plays_the_same_whatever_its_agents_are() {
    let builder = || Swarm::builder().environment("hear-see").links("level(0.3)").seed(3).worlds(2);
    let mut processes = builder().agent_command(common::this_binary()).build().unwrap();
    let mut here = builder().in_process().build().unwrap();
    let returns = |statistics: &Statistics| {
        let episodes = statistics.episodes().iter();
        episodes.map(|episode| (episode.episode_return.to_bits(), episode.delivered)).collect::<Vec<_>>()
    };
    assert_eq!(returns(processes.play(5).unwrap()), returns(here.play(5).unwrap()));
    // It goes on where it was.
    assert_eq!(returns(processes.play(1).unwrap()), returns(here.play(1).unwrap()));
    assert_eq!(here.statistics().episodes().len(), 6);
}

#[test]
fn what_makes_no_sense_is_refused_before_anything_starts() {
    let refused = |builder: SwarmBuilder, words: &str| {
        let error = builder.build().err().expect("it makes no sense");
        assert!(matches!(error, Error::Usage(_)) && error.to_string().contains(words), "{error:?}");
    };
    refused(Swarm::builder().environment("hear-sea"), "did you mean `hear-see`?");
    refused(Swarm::builder().links("gilbrt(0.1, 0.3)"), "gilbert");
    refused(Swarm::builder().imputer("hlod"), "hold");
    refused(Swarm::builder().worlds(0), "1 or more worlds");
    refused(Swarm::builder().rate(f64::NAN), "ticks a second");
}
