//! A lost observation never reaches imputer or policy, and a delayed one not before it arrives: with the payloads of all
//! that has not arrived replaced by an absurd number, nothing changes by a bit.

use std::collections::HashMap;
use std::sync::Arc;

use crate::common::acting::{ACTING, acting};
use vamaro_swarm::agent::{AgentSettings, PolicySource};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::bus::{AgentPort, Header, Kind, Layout, LocalPort, LocalSample, NOT_ARRIVED, Sample};
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::{LinkSpec, Links};
use vamaro_swarm::nn::Policy;
use vamaro_swarm::supervisor::{Decisions, InProcess, Stage, Team};

/// Worlds that are played side by side, for two batches of episodes.
const WORLDS: usize = 3;

/// Ticks of that, counted from 1; an episode of every built-in task has 25.
const TICKS: u64 = 50;

/// What is sent on one link at one tick.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct Sent {
    tick: u64,
    world: usize,
    from: usize,
    to: usize,
}

/// When what is sent arrives. What is not in it is lost, or outdated.
type Arrivals = HashMap<Sent, u64>;

/// What stands for what has not arrived: no NaN, which an inbox refuses, but nothing an agent has ever seen.
const POISON: f32 = 9e8;

/// A port that replaces what has not arrived at the end by poison before the agent receives it.
struct Poisoned {
    port: LocalPort,
    layout: Layout,
    arrivals: Arc<Arrivals>,
    /// The last tick that counts.
    end: u64,
    /// Whose port it is, by the first message it gets.
    agent: usize,
}

impl AgentPort for Poisoned {
    type Sample = LocalSample;

    fn receive_sensor(&mut self) -> Result<Option<LocalSample>> {
        let sample = self.port.receive_sensor()?;
        if let Some(sample) = &sample {
            self.agent = sample.header().sender as usize;
        }
        Ok(sample)
    }

    fn receive_observation(&mut self) -> Result<Option<LocalSample>> {
        let Some(sample) = self.port.receive_observation()? else { return Ok(None) };
        let header = *sample.header();
        assert_eq!(header.kind, Kind::Observation as u32);
        Ok(Some(LocalSample::new(header, |words| {
            words.copy_from_slice(sample.words());
            let (tick, from, to) = (header.tick, header.sender as usize, self.agent);
            let Layout { agents, observation, relay, .. } = self.layout;
            let worlds = header.worlds as usize;
            let each = if relay { agents * observation } else { observation };
            let ages = self.layout.observation_words(worlds) - worlds * each;
            for (world, words) in words[ages..].chunks_exact_mut(each).enumerate() {
                let arrives = self.arrivals.get(&Sent { tick, world, from, to });
                if arrives.is_none_or(|tick| *tick > self.end) {
                    words.fill(POISON.to_bits());
                }
            }
        })))
    }

    fn receive_weights(&mut self) -> Result<Option<LocalSample>> {
        self.port.receive_weights()
    }

    fn publish_observation(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        self.port.publish_observation(header, write)
    }

    fn publish_decision(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        self.port.publish_decision(header, write)
    }
}

/// What a team decided at a tick, bit by bit.
#[derive(PartialEq)]
struct Decided {
    actions: Vec<u32>,
    estimates: Vec<u32>,
    logits: Vec<u32>,
}

impl Decided {
    fn is_finite(&self) -> bool {
        self.estimates.iter().chain(&self.logits).all(|bits| f32::from_bits(*bits).is_finite())
    }
}

/// Everything a team decides until the end, a tick, and what arrived until then.
fn play(team: &mut impl Team, task: &Task, links: Links, end: u64) -> (Vec<Decided>, Arrivals) {
    let mut stage = Stage::new(task.environment(WORLDS), links, 5).relaying(team.relays());
    let (mut decisions, mut all, mut arrivals) = (Decisions::default(), Vec::new(), Arrivals::new());
    while (all.len() as u64) < end {
        if !stage.is_playing() {
            stage.begin_episodes(u64::MAX).unwrap();
        }
        stage.sense().unwrap();
        stage.draw_links(0).unwrap();
        let tick = stage.tick();
        team.tick(&tick, &mut decisions).unwrap();
        for (to, world) in (0..tick.agents).flat_map(|to| (0..WORLDS).map(move |world| (to, world))) {
            let ages = tick.messages(to, world).iter().enumerate();
            for (from, &age) in ages.filter(|(_, age)| **age != NOT_ARRIVED) {
                arrivals.insert(Sent { tick: tick.tick - u64::from(age), world, from, to }, tick.tick);
            }
        }
        let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect();
        let (estimates, logits) = (bits(&decisions.estimates), bits(&decisions.logits));
        all.push(Decided { actions: decisions.actions.clone(), estimates, logits });
        stage.step_worlds(&decisions).unwrap();
    }
    (all, arrivals)
}

/// Whether with these links what has not arrived at the end matters to nothing that is decided until then.
fn check(task: &Task, policy: &Policy, imputer: &str, relay: bool, links: impl Fn() -> Links, ends: &[u64]) {
    let settings = AgentSettings {
        relay,
        imputer: imputer.to_owned(),
        worlds: WORLDS,
        longest_delay: links().longest_delay(),
        tell_logits: true,
        ..AgentSettings::of(task.spec())
    };
    let layout = settings.layout();
    let mut plain = InProcess::new(&settings, policy).unwrap();
    let (expected, arrivals) = play(&mut plain, task, links(), TICKS);
    assert!(expected.iter().all(Decided::is_finite), "{}, {imputer}", task.id());
    let arrivals = Arc::new(arrivals);
    for &end in ends {
        let arrivals = arrivals.clone();
        let poison = move |port| Poisoned { port, layout, arrivals: arrivals.clone(), end, agent: 0 };
        let mut poisoned = InProcess::with_ports(&settings, policy, poison).unwrap();
        let (decided, _) = play(&mut poisoned, task, links(), end);
        let differs = decided.iter().zip(&expected).position(|(found, expected)| found != expected);
        assert_eq!(differs, None, "{}, {imputer}, {:?}, poisoned until {end}", task.id(), links());
    }
}

/// Tasks whose actors are of both kinds, with two policies each, and the imputers they can have.
fn cases() -> impl Iterator<Item = (Task, Policy, &'static str)> {
    ["hear-see", "spread-xy-4"].into_iter().flat_map(|name| {
        let task = Task::parse(name).unwrap();
        let builtin = PolicySource::Builtin.load(task.spec()).unwrap();
        let acting = acting(task.spec());
        let imputers = ["zero", "hold", "velocity", "value-aware", "dynamics", "teammates"];
        let builtin = imputers.map(|imputer| (task.clone(), builtin.clone(), imputer));
        let acting = ACTING.map(|imputer| (task.clone(), acting.clone(), imputer));
        builtin.into_iter().chain(acting)
    })
}

#[test]
fn nothing_of_a_lost_observation_gets_through() {
    for (task, policy, imputer) in cases() {
        for p in [0.0, 0.3, 0.8] {
            for share_at_start in [true, false] {
                let links = || Links::level(p).sharing_at_start(share_at_start);
                check(&task, &policy, imputer, false, links, &[TICKS]);
            }
        }
    }
}

#[test]
fn nothing_of_a_delayed_observation_gets_through_before_it_arrives() {
    for (task, policy, imputer) in cases() {
        for text in ["delay(2)", "level(0.7) + delay(1, 3)"] {
            let links = LinkSpec::parse(text, task.spec().n_agents()).unwrap();
            let ends: Vec<u64> = (1..=TICKS).step_by(7).collect();
            check(&task, &policy, imputer, false, || links.build(), &ends);
        }
    }
}

#[test]
fn what_is_relayed_comes_from_messages_that_arrived_and_from_nothing_else() {
    for (task, policy, imputer) in cases().filter(|(_, _, imputer)| ["hold", "dynamics"].contains(imputer)) {
        for text in ["level(0.3)", "level(0.5) + delay(1, 3)"] {
            let links = LinkSpec::parse(text, task.spec().n_agents()).unwrap();
            check(&task, &policy, imputer, true, || links.build().sharing_at_start(false), &[8, 20, TICKS]);
        }
    }
}
