//! Agents that die, hang or are killed on purpose: the others play on, and what happened is said.

use std::time::{Duration, Instant};

use crate::common::{self, Swarm, assert_gone, fail, succeed, swarm_of};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use vamaro_swarm::agent::AgentSettings;
use vamaro_swarm::base::error::Result;
use vamaro_swarm::bus::{AgentPort, AgentSharedPort, Header, Kind, PROTOCOL, SwarmAddress};
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::{LinkSpec, Links};
use vamaro_swarm::supervisor::{
    Conduct, Deadlines, Decisions, InProcess, Ledger, Observer, OnFailure, Processes, Session, Stage,
    Statistics, Team,
};

fn json(words: &str) -> Value {
    serde_json::from_str(&succeed(words)).unwrap()
}

/// Chaos in which much happens.
const CHAOS: &str = "kill=0.02:300ms,stop=0.03:200ms";

#[test]
fn chaos_is_the_same_across_processes_and_within_one() {
    for words in [
        "--task spread-xy-2 --p 0.4 --imputer value-aware --seed 3",
        "--task spread-xy-4 --links gilbert(0.3,0.4)+delay(2,1) --imputer teammates",
        "--task hear-see --p 0.5 --imputer hold --no-comm-at-t0",
    ] {
        let calm = format!("spawn {words} --episodes 4 --audit --json");
        let words = format!("{calm} --chaos {CHAOS}");
        let (across, within) =
            (json(&format!("{words} --deadline 60s")), json(&format!("{words} --in-process")));
        for what in
            ["return_mean", "delivery_rate", "imputation_rmse", "absent", "chaos", "audit", "delayed_rate"]
        {
            assert_eq!(across[what], within[what], "{what} of {words}");
        }
        assert!(across["absent"].as_u64().unwrap() > 0, "{across}");
        let faults = &across["faults"];
        assert_eq!((&faults["deaths"], &faults["hangs"]), (&0.into(), &0.into()), "{words}");
        assert!(faults["restarts"].as_u64() <= across["chaos"]["kills"].as_u64());
        let calm = json(&format!("{calm} --in-process"));
        assert_ne!(calm["return_mean"], within["return_mean"], "chaos changes something");
    }
}

#[test]
fn many_may_be_absent_at_a_time() {
    let words =
        "spawn --task spread-blindfold-12 --policy untrained --imputer hold --p 0.5 --episodes 2 --json";
    let words = format!("{words} --chaos stop=0.1:60s,kill=0.05:60s");
    let (across, within) = (json(&format!("{words} --deadline 60s")), json(&format!("{words} --in-process")));
    for what in ["return_mean", "delivery_rate", "imputation_rmse", "absent"] {
        assert_eq!(across[what], within[what], "{what}: {}", across["faults"]);
    }
    assert_eq!(across["faults"]["deaths"], 0);
}

#[test]
fn who_is_ready_between_two_periods_is_back() {
    let swarm = Swarm::start("--agents 4 --p 0.5 --rate 1000 --episodes 280 --deadline 60s --json");
    for agent in &swarm.agents {
        std::thread::sleep(Duration::from_millis(1200));
        kill_process(*agent, Signal::KILL).unwrap();
    }
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(0), "{stderr}");
    let summary: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!([&summary["faults"]["deaths"], &summary["faults"]["restarts"]], [4, 4], "{summary}");
}

#[test]
fn a_run_in_which_nobody_is_left_has_failed() {
    let swarm = Swarm::start("--agents 2 --on-failure continue");
    swarm.agents.iter().for_each(|agent| kill_process(*agent, Signal::KILL).unwrap());
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(1));
    assert!(stderr.contains("no agent is left"), "{stderr}");
}

#[test]
fn chaos_needs_one_world_and_sense() {
    fail("spawn --chaos kill=0.1 --worlds 2 --episodes 4 --in-process", 2, &["--worlds 1"]);
    fail("spawn --chaos kil=0.1", 2, &["`kill`"]);
}

/// Hits agents before a step of the first episode.
struct Hit {
    step: u32,
    agents: Vec<Pid>,
    signal: Signal,
}

impl Hit {
    fn at(&self, stage: &Stage) {
        if (stage.tick().episode, stage.tick().step) == (0, self.step) {
            self.agents.iter().for_each(|agent| kill_process(*agent, self.signal).unwrap());
        }
    }
}

impl Observer for Hit {
    fn begin_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.at(stage);
        Ok(())
    }

    fn stepped(&mut self, stage: &Stage, _: &Decisions) -> Result<()> {
        self.at(stage);
        Ok(())
    }
}

const LONG: Duration = Duration::from_secs(30);

fn start(on_failure: OnFailure, answer: Duration, delays: bool) -> (Processes, Session) {
    let task = Task::parse("spread-xy-4").unwrap();
    let text = if delays { "gilbert(0.1, 0.5) + delay(2, 1)" } else { "level(0.5)" };
    let links = LinkSpec::parse(text, 4).unwrap().build();
    let settings = AgentSettings { longest_delay: links.longest_delay(), ..AgentSettings::of(task.spec()) };
    let policy = settings.policy.load(task.spec()).unwrap();
    let deadlines = Deadlines { answer, peers: LONG, ..Deadlines::default() };
    let conduct =
        Conduct { on_failure, deadlines, command: Some(common::this_binary()), ..Conduct::default() };
    (Processes::start(&settings, &policy, conduct).unwrap(), Session::new(task.environment(1), links, 0))
}

/// Plays three episodes, in the first of which agent 2 is hit.
fn play(swarm: &mut Processes, session: &mut Session, signal: Signal) -> Statistics {
    let hit = Hit { step: 7, agents: vec![swarm_of(swarm).0[2]], signal };
    play_with(swarm, session, hit)
}

fn play_with(swarm: &mut Processes, session: &mut Session, mut hit: Hit) -> Statistics {
    let mut ledger = Ledger::default();
    session.play(swarm, 3, &mut [&mut ledger, &mut hit]).unwrap();
    ledger.into_statistics()
}

#[test]
fn who_dies_is_replaced_and_the_others_play_on() {
    for delays in [false, true] {
        for signal in [Signal::KILL, Signal::ABORT] {
            let (mut swarm, mut session) = start(OnFailure::Restart, LONG, delays);
            let (before, tag) = swarm_of(&swarm);
            let statistics = play(&mut swarm, &mut session, signal);
            assert_eq!(statistics.episodes().len(), 3);
            let faults = swarm.faults();
            assert_eq!((faults.deaths, faults.hangs, faults.restarts), (1, 0, 1), "{:?}", faults.told);
            assert!(faults.told[0].starts_with("agent-2 (process"), "{:?}", faults.told);
            // It may have been noticed before the next tick began.
            assert!(statistics.absent() <= 1);
            let after = swarm_of(&swarm).0;
            assert!(after.len() == 4 && after[2] != before[2] && after[3] == before[3]);
            drop(swarm);
            assert_gone(&[before, after].concat(), &tag);
        }
    }
}

#[test]
fn several_may_die_at_a_tick_and_at_the_first_of_all() {
    for step in [0, 7] {
        let (mut swarm, mut session) = start(OnFailure::Restart, LONG, false);
        let (before, tag) = swarm_of(&swarm);
        let hit = Hit { step, agents: before[..3].to_vec(), signal: Signal::KILL };
        let statistics = play_with(&mut swarm, &mut session, hit);
        assert_eq!(statistics.episodes().len(), 3);
        let faults = swarm.faults();
        assert_eq!((faults.deaths, faults.hangs, faults.restarts), (3, 0, 3), "{:?}", faults.told);
        // Each may have been noticed before the next tick began, or while it was played.
        assert!(statistics.absent() <= 3);
        let after = swarm_of(&swarm).0;
        assert!(after[..3].iter().all(|agent| !before.contains(agent)) && after[3] == before[3]);
        drop(swarm);
        assert_gone(&[before, after].concat(), &tag);
    }
}

#[test]
fn who_dies_while_it_starts_is_started_once_more() {
    let swarm = Swarm::start("--agents 3 --p 0.5 --deadline 60s --json");
    let (supervisor, first) = (swarm.supervisor().as_raw_nonzero().get() as u32, swarm.agents.clone());
    kill_process(first[1], Signal::KILL).unwrap();
    let deadline = Instant::now() + LONG;
    // Its process is there, and has hardly begun.
    let second = loop {
        assert!(Instant::now() < deadline, "nobody takes its place");
        let new = |agent: &Pid| !first.contains(agent);
        if let Some(agent) = common::children(supervisor).into_iter().find(new) {
            break agent;
        }
        std::thread::sleep(Duration::from_micros(100));
    };
    kill_process(second, Signal::KILL).unwrap();
    while common::is_running(second) {
        assert!(Instant::now() < deadline, "it does not die");
    }
    common::await_sleeps(swarm.supervisor(), 200);
    swarm.signal_supervisor(Signal::INT);
    let tag = swarm.tag.clone();
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
    let summary: Value = serde_json::from_str(&stdout).unwrap();
    let count = |what: &str| summary["faults"][what].as_u64().unwrap();
    // On a busy machine it may just have got ready.
    assert!(count("deaths") == 2 && (1..=2).contains(&count("restarts")), "{summary}");
    assert_gone(&[first, vec![second]].concat(), &tag);
}

#[test]
fn a_stopped_agent_holds_up_nobody_who_is_to_end() {
    let swarm = Swarm::start("--agents 3 --p 0.5 --deadline 60s");
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    kill_process(agents[2], Signal::STOP).unwrap();
    swarm.signal_supervisor(Signal::INT);
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
    assert_gone(&agents, &tag);
}

#[test]
fn against_the_clock_the_others_may_play_on_without_it() {
    let swarm =
        Swarm::start("--agents 3 --p 0.5 --rate 50 --episodes 6 --deadline 60s --on-failure continue --json");
    // One that is killed before it is ready ends the swarm. Once it can be watched, all are.
    let (sign, deadline) =
        (common::root(&swarm.tag).join("view.json"), Instant::now() + Duration::from_secs(60));
    while !sign.exists() {
        assert!(Instant::now() < deadline, "the swarm does not start");
        std::thread::sleep(Duration::from_millis(5));
    }
    kill_process(swarm.agents[1], Signal::KILL).unwrap();
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(0), "{stderr}");
    let summary: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!([&summary["faults"]["deaths"], &summary["faults"]["restarts"]], [1, 0], "{summary}");
    assert!(summary["absent"].as_u64().unwrap() > 0, "{summary}");
}

#[test]
fn without_it_the_others_play_on_to_the_end() {
    let (mut swarm, mut session) = start(OnFailure::Continue, LONG, true);
    let (agents, tag) = swarm_of(&swarm);
    let statistics = play(&mut swarm, &mut session, Signal::KILL);
    assert_eq!(statistics.absent(), 18 + 2 * 25, "it missed all ticks from the eighth on");
    assert_eq!((swarm.faults().deaths, swarm.faults().restarts), (1, 0));
    assert_eq!(statistics.episodes()[1].sent, 24 * 3 * 2, "nobody sends to it or hears of it");
    assert_eq!(swarm_of(&swarm).0.len(), 3);
    drop(swarm);
    assert_gone(&agents, &tag);
}

#[test]
fn who_hangs_is_killed_at_the_deadline_and_replaced() {
    let (mut swarm, mut session) = start(OnFailure::Restart, Duration::from_millis(600), false);
    let statistics = play(&mut swarm, &mut session, Signal::STOP);
    let faults = swarm.faults();
    assert_eq!((faults.deaths, faults.hangs, faults.restarts), (0, 1, 1), "{:?}", faults.told);
    assert!(faults.told[0].starts_with("agent-2 did not"), "{:?}", faults.told);
    assert_eq!(statistics.absent(), 1, "the tick in which it hung");
}

#[test]
fn against_the_clock_the_dead_and_the_hung_come_back_while_the_others_play() {
    let swarm = Swarm::start("--agents 4 --p 0.5 --rate 50 --episodes 12 --deadline 400ms --json");
    kill_process(swarm.agents[1], Signal::KILL).unwrap();
    kill_process(swarm.agents[3], Signal::STOP).unwrap();
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(0), "{stderr}");
    let summary: Value = serde_json::from_str(&stdout).unwrap();
    let faults = &summary["faults"];
    // On a busy machine others may hang, too.
    let count = |what: &str| faults[what].as_u64().unwrap();
    assert!(count("deaths") == 1 && count("hangs") >= 1 && count("restarts") >= 2, "{summary}");
    assert!(summary["absent"].as_u64().unwrap() > 0);
    assert_eq!(summary["episodes"], 12);
    assert_gone(&agents, &tag);
}

#[test]
fn nobody_outlives_the_supervisor() {
    let swarm = Swarm::start("--agents 4 --p 0.2");
    let agents = swarm.agents.clone();
    swarm.signal_supervisor(Signal::KILL);
    let died = Instant::now();
    while agents.iter().any(|agent| common::is_running(*agent)) {
        assert!(died.elapsed() < LONG, "they stay");
        std::thread::sleep(Duration::from_millis(1));
    }
    swarm.wait();
    succeed("spawn --episodes 1");
}

#[test]
fn what_was_finished_is_summarised_whatever_ends_the_run() {
    let swarm = Swarm::start("--agents 2 --p 0.5 --on-failure abort");
    common::await_sleeps(swarm.supervisor(), 500);
    kill_process(swarm.agents[0], Signal::KILL).unwrap();
    let (code, stdout, stderr) = swarm.wait();
    assert_eq!(code, Some(1));
    assert!(stdout.contains("return ") && stdout.contains("1 death"), "{stdout}");
    assert!(stderr.contains("agent-0") && stderr.contains("episodes were finished"), "{stderr}");
}

#[test]
fn a_run_that_does_not_keep_to_a_requirement_ends_with_3() {
    succeed("spawn --episodes 2 --require missed<=0 --require deaths<=0 --require return>=-1000");
    fail("spawn --episodes 2 --require return>=1000", 3, &["return>=1000: not met"]);
    fail("spawn --episodes 2 --in-process --require rate>=1", 3, &["no `rate`"]);
    fail("spawn --require misses<=0", 2, &["`missed`"]);
}

/// A team that is told of somebody's absence, step by step.
#[test]
fn those_who_are_there_decide_as_if_links_to_the_absent_were_down() {
    let task = Task::parse("spread-xy-2").unwrap();
    let settings = AgentSettings::of(task.spec());
    let policy = settings.policy.load(task.spec()).unwrap();
    let played = |p: f64, absent: u64| {
        let mut team = InProcess::new(&settings, &policy).unwrap();
        let mut stage = Stage::new(task.environment(1), Links::level(p).sharing_at_start(false), 0);
        let (mut decisions, mut estimates) = (Decisions::default(), Vec::new());
        stage.begin_episodes(1).unwrap();
        for _ in 0..10 {
            stage.sense().unwrap();
            stage.draw_links(absent).unwrap();
            team.tick(&stage.tick(), &mut decisions).unwrap();
            assert_eq!((decisions.missing, decisions.absent), (absent, absent));
            estimates.push(decisions.estimates[..task.spec().joint_dim()].to_vec());
            // The same way for both, whatever they decide.
            decisions.actions.fill(0);
            stage.step_worlds(&decisions).unwrap();
        }
        estimates
    };
    assert_eq!(played(1.0, 0b10), played(0.0, 0));
    assert_ne!(played(1.0, 0), played(0.0, 0));
}

/// Speaks for an agent that has died, and says what its sensor has not given it.
struct Liar {
    port: Option<AgentSharedPort>,
    header: Header,
    says: f32,
}

impl Observer for Liar {
    fn stepped(&mut self, stage: &Stage, _: &Decisions) -> Result<()> {
        let Some(port) = &mut self.port else { return Ok(()) };
        let header = Header { tick: stage.tick().tick + 1, ..self.header };
        port.publish_observation(header, |words| words.fill(self.says.to_bits()))
    }
}

#[test]
fn what_no_sensor_gave_ends_the_run() {
    for says in [f32::NAN, 1e30, 0.25] {
        let (mut swarm, mut session) = start(OnFailure::Continue, LONG, false);
        let ((processes, tag), mut ledger) = (swarm_of(&swarm), Ledger::default());
        let task = Task::parse("spread-xy-4").unwrap();
        let settings = AgentSettings::of(task.spec());
        let (address, layout) = (SwarmAddress { agents: 4, ..SwarmAddress::of(&tag) }, settings.layout());
        let header = Header {
            protocol: PROTOCOL,
            kind: Kind::Observation as u32,
            swarm: address.id(),
            sender: 2,
            worlds: 1,
            length: layout.observation_words(1) as u64,
            ..Header::default()
        };
        let mut liar = Liar { port: None, header, says };
        kill_process(processes[2], Signal::KILL).unwrap();
        session.play(&mut swarm, 1, &mut [&mut ledger, &mut liar]).unwrap();
        assert_eq!(swarm.faults().deaths, 1);
        liar.port = Some(AgentSharedPort::open(&address, &layout, 2, 1).unwrap());
        let error = session.play(&mut swarm, 2, &mut [&mut ledger, &mut liar]).unwrap_err().to_string();
        assert!(error.contains("agent-2 published something other"), "{error}");
        assert_eq!(ledger.statistics().episodes().len(), 1);
    }
}

#[test]
fn a_training_that_loses_an_agent_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let train = |out: &str| {
        let out = folder.path().join(out);
        let words = "train --task hear-see --steps 20000 --threads 1 --set test_episodes=0 --on-failure restart --out";
        (format!("{words} {}", out.display()), out.join("policy.safetensors"))
    };
    let (calm, expected) = train("calm");
    succeed(&calm);
    let (hit, found) = train("hit");
    let swarm = Swarm::of(&hit);
    common::await_sleeps(swarm.supervisor(), 300);
    kill_process(swarm.agents[1], Signal::KILL).unwrap();
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(0), "{stderr}");
    assert!(stderr.contains("agent-1") && stderr.contains("restarting the team"), "{stderr}");
    assert_eq!(std::fs::read(found).unwrap(), std::fs::read(expected).unwrap());
    fail("train --on-failure continue --steps 1000", 2, &["abort or restart"]);
}

#[test]
fn damaged_shared_memory_holds_nobody_up_at_the_end() {
    let swarm = Swarm::start("--agents 4 --p 0.2");
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    kill_process(swarm.supervisor(), Signal::STOP).unwrap();
    for name in common::shared_memory(&tag).iter().filter(|name| name.ends_with(".connection")) {
        let file = std::fs::OpenOptions::new().write(true).open(format!("/dev/shm/{name}")).unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, &[0xff; 16], 0).unwrap();
    }
    kill_process(swarm.supervisor(), Signal::TERM).unwrap();
    kill_process(swarm.supervisor(), Signal::CONT).unwrap();
    // Whatever iceoryx2 makes of it, it ends, and the next start cleans up.
    swarm.wait();
    succeed("spawn --episodes 1");
    common::assert_gone(&agents, &tag);
}
