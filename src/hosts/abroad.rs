//! The supervisor's side: hosts, and the agents that run there.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rustix::process::Signal;

use super::engine::{End, Engine, Heard, Line};
use super::frame::Shape;
use super::key::Key;
use super::offset::{Estimate, Exchange, Jump, Offset};
use super::orders::{
    Answer, Event, Identity, Invitation, LARGEST_POLICY, Order, Question, bit_among, say, secret, understand,
};
use super::outbox::Outbox;
use super::patience::Patience;
use super::plan::{Plan, PlannedHost};
use super::tally::Tally;
use crate::agent::PolicySource;
use crate::agent::process::ProcessSettings;
use crate::base::error::{Error, Result};
use crate::base::hash::fnv1a;
use crate::base::regular;
use crate::bus::{Bell, Header, Kind, Layout, Sample, StandIns, now_ns};
use crate::failed;
use crate::supervisor::{Elsewhere, HostReport, members_of, say as say_aloud, signals};

/// A host is asked for the time so many times before it plays, and then this often.
const FIRST_QUESTIONS: usize = 8;
const BETWEEN_QUESTIONS: Duration = Duration::from_millis(200);

/// How many of the questions are remembered that it has not answered yet.
const MOST_QUESTIONS: usize = 64;

/// How much longer a host may take to leave than its agents.
const LONGEST_FAREWELL: Duration = Duration::from_secs(10);

/// How often a wait looks whether the program was asked to stop.
const SLICE: Duration = Duration::from_millis(50);

/// The hosts of a swarm. On the bus it stands in for the agents that run there.
pub(crate) struct Hosts {
    hosts: Vec<Host>,
    /// The swarm, once there is one.
    swarm: Option<Presence>,
    /// Agents that have ended: which and how.
    dead: Vec<(usize, String)>,
    /// Frames sent and received.
    frames: Arc<AtomicU64>,
}

/// What stands in for the agents of all hosts.
struct Presence {
    shape: Shape,
    /// The number in its messages.
    swarm: u64,
    stand_ins: StandIns,
    /// How often each had been started before.
    incarnations: Vec<u32>,
}

/// A host.
pub(super) struct Host {
    /// Name and address, for errors.
    pub(super) name: String,
    pub(super) planned: PlannedHost,
    pub(super) engine: Engine,
    /// Its agents, bit by bit.
    agents: u64,
    /// Those that have been started and have not ended.
    running: u64,
    /// Open as long as the host is there.
    line: Option<Line>,
    /// What it is sent next.
    outbox: Outbox,
    /// Of observations that come from there, and of those that have come there.
    tallies: [Tally; 2],
    offset: Offset,
    /// What is known of its clock now.
    clock: Estimate,
    /// When it is asked for the time next.
    asks: Instant,
    /// When it was asked, as far as it has not answered.
    asked: VecDeque<u64>,
}

impl Hosts {
    /// Connects to all hosts of a plan, for a team of so many. Whether the network is the link: then it may lose
    /// observations.
    ///
    /// # Errors
    /// `Lost` if a host cannot be reached, refuses the key or does not answer; `Failed` if it is of another version.
    pub(crate) fn connect(plan: &Plan, team: usize, network_is_link: bool) -> Result<Hosts> {
        let (key, places) = (plan.key()?, plan.place(team)?);
        let mut hosts = Vec::new();
        // A host without agents has nothing to do.
        for (planned, agents) in plan.hosts.iter().zip(places).filter(|(_, agents)| *agents != 0) {
            hosts.push(Host::connect(planned, key.as_ref(), plan.patience, agents, network_is_link)?);
        }
        Ok(Hosts { hosts, swarm: None, dead: Vec::new(), frames: Arc::default() })
    }

    /// Counts the frames that it sends and receives.
    pub(crate) fn frames(&self) -> Arc<AtomicU64> {
        self.frames.clone()
    }

    fn of(&mut self, agent: usize) -> Option<&mut Host> {
        self.hosts.iter_mut().find(|host| host.agents >> agent & 1 == 1)
    }
}

impl Host {
    /// Connects to one that is to have these agents.
    pub(super) fn connect(
        planned: &PlannedHost,
        key: Option<&Key>,
        patience: Patience,
        agents: u64,
        network_is_link: bool,
    ) -> Result<Host> {
        let PlannedHost { name, at, .. } = planned;
        let name = format!("host {name} ({at})");
        let engine = Engine::connect(at, key, patience).map_err(|e| lost(&name, e))?;
        let host = Host::new(name, planned.clone(), engine, agents, network_is_link);
        host.greet()?;
        Ok(host)
    }

    fn new(name: String, planned: PlannedHost, engine: Engine, agents: u64, network_is_link: bool) -> Host {
        Host {
            name,
            planned,
            engine,
            agents,
            running: 0,
            line: None,
            outbox: Outbox::new(false, network_is_link),
            tallies: [Tally::default(); 2],
            offset: Offset::default(),
            clock: Estimate::default(),
            asks: Instant::now(),
            asked: VecDeque::new(),
        }
    }

    /// Asks who it is.
    fn greet(&self) -> Result<()> {
        let patience = self.engine.patience;
        let own = Identity::own(patience);
        let other = match self.ask(&Question::Who, &[], patience.reply())? {
            Answer::I(other) => other,
            Answer::No(why) => return Err(failed!("{} does not say who it is: {why}", self.name)),
            Answer::Yes | Answer::At(_) => return Err(failed!("{} does not say who it is", self.name)),
        };
        if (&other.program, other.protocol) != (&own.program, own.protocol) {
            return Err(failed!(
                "{} runs version {} of this program (protocol {}), and this is version {} (protocol {}); install the same \
                 on both",
                self.name,
                other.program,
                other.protocol,
                own.program,
                own.protocol
            ));
        }
        if other.patience != patience {
            return Err(failed!(
                "{} waits for {:?}, and this machine for {:?}; start it with --patience {2:?}",
                self.name,
                other.patience.silence(),
                patience.silence()
            ));
        }
        if other.instructions != own.instructions {
            say_aloud(format!(
                "note: {} computes with {}, and this machine with {}: results may differ in their last bits",
                self.name, other.instructions, own.instructions
            ));
        }
        Ok(())
    }

    pub(super) fn ask(&self, question: &Question, policy: &[u8], longest: Duration) -> Result<Answer> {
        let answer = self.engine.ask(say(question), policy, longest).map_err(|e| lost(&self.name, e))?;
        understand(&answer).map_err(|e| failed!("{} is of another version: {e}", self.name))
    }

    /// Opens the line, and ships the policy.
    fn join(&mut self, example: &ProcessSettings, policy: &[u8], bell: &Arc<Bell>) -> Result<()> {
        let (bell, secret) = (bell.clone(), secret()?);
        let line = self.engine.line(&secret, End::Supervisor, move || bell.ring())?;
        self.outbox.real_time = example.address.real_time;
        let (example, hash) = (example.clone(), fnv1a(policy.iter().copied()));
        let invitation = Invitation {
            example,
            agents: self.agents,
            policy: hash,
            network_is_link: self.outbox.network_is_link,
            line: secret,
        };
        match self.ask(&Question::Join(Box::new(invitation)), policy, self.engine.patience.join())? {
            Answer::Yes => self.line = Some(line),
            Answer::No(why) => return Err(lost(&self.name, failed!("will not join: {why}"))),
            Answer::I(_) | Answer::At(_) => {
                return Err(failed!("{} does not say whether it will join", self.name));
            }
        }
        (0..FIRST_QUESTIONS).try_for_each(|_| self.await_time())
    }

    /// Asks for the time, and waits for the answer.
    fn await_time(&mut self) -> Result<()> {
        self.ask_time();
        let longest = self.engine.patience.reply();
        let deadline = Instant::now() + longest;
        while Instant::now() < deadline {
            signals::check_stop()?;
            let line = self.line.as_ref().expect("it has joined");
            let how = match line.hear_within(SLICE) {
                Some(Heard::Words(words, at_ns)) => {
                    match understand(&words).map_err(|e| lost(&self.name, e))? {
                        Event::Told { asked_ns, heard_ns, said_ns, .. } => {
                            self.note_time(Exchange { asked_ns, heard_ns, said_ns, answered_ns: at_ns });
                            return Ok(());
                        }
                        Event::Failed(how) => format!("cannot go on: {how}"),
                        _ => continue,
                    }
                }
                Some(Heard::Here | Heard::Frame(_)) | None => continue,
                Some(Heard::Gone) => "cannot be reached any longer".to_owned(),
            };
            return Err(lost(&self.name, failed!("{how}")));
        }
        Err(lost(&self.name, failed!("does not tell the time within {longest:?}")))
    }

    fn ask_time(&mut self) {
        self.asks = Instant::now() + BETWEEN_QUESTIONS;
        let Some(line) = &self.line else { return };
        let asked_ns = now_ns();
        line.say_unless_full(say(&Order::Tell { asked_ns }));
        self.asked.truncate(MOST_QUESTIONS - 1);
        self.asked.push_front(asked_ns);
    }

    /// Takes note of what its clock says, if it was asked. That it jumped is said once: the summary counts how often.
    fn note_time(&mut self, exchange: Exchange) {
        let Some(at) = self.asked.iter().position(|asked_ns| *asked_ns == exchange.asked_ns) else { return };
        self.asked.remove(at);
        if let Some(Jump { by_ns, allowed_ns, number: 1 }) = self.offset.note(&exchange) {
            say_aloud(format!(
                "warning: the clock of {} moved by {:.3} ms against ours, of which errors and drift explain {:.3} ms; was \
                 that machine suspended? Until now its times, and the deadlines it was given, may have been wrong by that",
                self.name,
                by_ns as f64 / 1e6,
                allowed_ns as f64 / 1e6
            ));
        }
        self.clock = self.offset.at(now_ns()).unwrap_or_default();
    }

    /// Adds a message to what it is sent next, with its times by the clock there.
    fn push(&mut self, header: &Header, words: &[u32]) {
        let header = translated(header, |ns| self.clock.theirs(ns));
        self.outbox.push(&header, words);
    }

    fn order(&self, order: Order) {
        self.line.iter().for_each(|line| line.say(say(&order)));
    }

    /// It is gone, and its agents with it.
    fn lose(&mut self, how: &str, dead: &mut Vec<(usize, String)>) {
        self.order(Order::Leave);
        self.line = None;
        let running = std::mem::take(&mut self.running);
        dead.extend(members_of(running).map(|agent| (agent, format!("is lost: {} {how}", self.name))));
    }

    /// The bit of an agent that it names.
    fn bit_of(&self, agent: usize) -> Result<u64> {
        bit_among(self.agents, agent).ok_or_else(|| failed!("speaks of agent-{agent}, which is not there"))
    }

    /// Takes note of something that has happened there.
    fn note(
        &mut self,
        (event, at_ns): (Event, u64),
        incarnations: &[u32],
        dead: &mut Vec<(usize, String)>,
    ) -> Result<()> {
        match event {
            Event::Ended { agent, incarnation, how } => {
                let bit = self.bit_of(agent)?;
                // It may have been ended, or started anew, in the meantime.
                if self.running & bit != 0 && incarnations[agent] == incarnation {
                    self.running &= !bit;
                    dead.push((agent, format!("on {} {how}", self.name)));
                }
                Ok(())
            }
            Event::Said { agent, line } => {
                self.bit_of(agent)?;
                say_aloud(format!("[agent-{agent}] {line}"));
                Ok(())
            }
            Event::Told { asked_ns, heard_ns, said_ns, tally } => {
                self.tallies[1] = tally;
                self.note_time(Exchange { asked_ns, heard_ns, said_ns, answered_ns: at_ns });
                Ok(())
            }
            Event::Failed(how) => Err(failed!("cannot go on: {how}")),
            Event::Left => Err(failed!("has left")),
        }
    }
}

impl Presence {
    /// Puts messages of a host on the bus, with their times by our clock.
    fn bring(&self, bytes: &[u8], host: &mut Host) -> Result<()> {
        let Host { running, agents, clock, tallies: [tally, _], .. } = host;
        let (running, agents, clock, now_ns) = (*running, *agents, *clock, now_ns());
        let numbers = self.shape.each(bytes, |header, words| {
            let agent = header.sender;
            if agents >> agent & 1 == 0 {
                return Err(failed!("sent a message of agent-{agent}, which is not there"));
            }
            // It may have been ended in the meantime.
            if running >> agent & 1 == 0 {
                return Ok(());
            }
            let header = translated(&header, |ns| clock.ours(ns));
            let header = Header { swarm: self.swarm, ..header };
            let copy = |to: &mut [u32]| bytemuck::cast_slice_mut(to).copy_from_slice(words);
            match header.kind {
                kind if kind == Kind::Observation as u32 => {
                    tally.note_time(now_ns, header.deadline_ns);
                    self.stand_ins.publish_observation(header, copy)
                }
                kind if kind == Kind::Ready as u32 => self.stand_ins.publish_decision(header, copy),
                kind if kind == Kind::Decision as u32 => self.stand_ins.publish_decision(header, |to| {
                    copy(to);
                    Layout::translate_times(to, |ns| clock.ours(ns));
                }),
                kind => Err(failed!("sent a message of kind {kind}, which no agent sends")),
            }
        })?;
        tally.note(&numbers);
        Ok(())
    }
}

impl Elsewhere for Hosts {
    fn agents(&self) -> u64 {
        self.hosts.iter().fold(0, |all, host| all | host.agents)
    }

    fn prepare(&mut self, example: &ProcessSettings) -> Result<()> {
        let ProcessSettings { address, settings, .. } = example;
        let PolicySource::Copy(path) = &settings.policy else {
            return Err(failed!("agents on other machines need a policy, and this team has none"));
        };
        let policy = regular::read(path, LARGEST_POLICY)?;
        let bell = Arc::new(Bell::of(address)?);
        for host in &mut self.hosts {
            host.join(example, &policy, &bell)?;
        }
        let layout = settings.layout();
        self.swarm = Some(Presence {
            shape: Shape { layout, worlds: settings.worlds },
            swarm: address.id(),
            stand_ins: StandIns::open(address, &layout, self.agents())?,
            incarnations: vec![0; address.agents],
        });
        Ok(())
    }

    fn start(&mut self, agent: usize, incarnation: u32) {
        self.swarm.iter_mut().for_each(|swarm| swarm.incarnations[agent] = incarnation);
        let Some(host) = self.of(agent) else { return };
        host.running |= 1 << agent;
        if host.line.is_none() {
            let how = format!("cannot be started: {} is gone", host.name);
            host.running &= !(1 << agent);
            self.dead.push((agent, how));
            return;
        }
        host.order(Order::Start { agent, incarnation });
    }

    fn signal(&mut self, agent: usize, signal: Signal) {
        if let Some(host) = self.of(agent).filter(|host| host.running >> agent & 1 == 1) {
            host.order(Order::Signal { agent, signal: signal.as_raw() });
        }
    }

    fn end(&mut self, agent: usize) {
        if let Some(host) = self.of(agent).filter(|host| host.running >> agent & 1 == 1) {
            host.running &= !(1 << agent);
            host.order(Order::End { agent });
        }
    }

    fn take_dead(&mut self) -> Vec<(usize, String)> {
        std::mem::take(&mut self.dead)
    }

    fn bring(&mut self) -> Result<()> {
        let Hosts { hosts, swarm: Some(swarm), dead, frames } = self else { return Ok(()) };
        for host in hosts {
            while let Some(heard) = host.line.as_ref().and_then(Line::hear) {
                let taken = match heard {
                    Heard::Here => Ok(()),
                    Heard::Frame(bytes) => {
                        frames.fetch_add(1, Ordering::Relaxed);
                        swarm.bring(&bytes, host)
                    }
                    Heard::Words(words, at_ns) => understand(&words)
                        .and_then(|event| host.note((event, at_ns), &swarm.incarnations, dead)),
                    Heard::Gone => Err(failed!("cannot be reached any longer")),
                };
                match taken {
                    // Shared memory is ours, not the host's.
                    Err(e @ Error::Bus { .. }) => return Err(e),
                    Err(e) => host.lose(&e.to_string(), dead),
                    Ok(()) => {}
                }
            }
        }
        Ok(())
    }

    fn send(&mut self) -> Result<()> {
        let Hosts { hosts, swarm: Some(swarm), frames, .. } = self else { return Ok(()) };
        for host in hosts.iter_mut() {
            for agent in members_of(host.agents) {
                while let Some(sample) = swarm.stand_ins.receive_sensor(agent)? {
                    host.push(sample.header(), sample.words());
                }
            }
        }
        while let Some(sample) = swarm.stand_ins.receive_observation()? {
            let sender = sample.header().sender;
            let others = hosts.iter_mut().filter(|host| host.agents >> sender & 1 == 0);
            others.for_each(|host| host.push(sample.header(), sample.words()));
        }
        let now = Instant::now();
        for host in hosts {
            frames.fetch_add(host.outbox.send(host.line.as_ref()), Ordering::Relaxed);
            if host.asks <= now {
                host.ask_time();
            }
        }
        Ok(())
    }

    fn report(&self) -> Vec<HostReport> {
        let of = |host: &Host| {
            let clock = host.offset.at(now_ns()).unwrap_or_default();
            let [here, there] = &host.tallies;
            let [observations, lost, delayed] = here.and(there);
            HostReport {
                observations,
                lost,
                delayed,
                name: host.planned.name.clone(),
                at: host.planned.at.clone(),
                agents: host.agents,
                ahead_ns: clock.ahead_ns,
                error_ns: clock.error_ns,
                clock_jumps: host.offset.jumps(),
            }
        };
        self.hosts.iter().map(of).collect()
    }

    fn reap(&mut self, longest: Duration) {
        self.hosts.iter().for_each(|host| host.order(Order::Leave));
        let began = Instant::now();
        let incarnations = self.swarm.as_ref().map_or(Vec::new(), |swarm| swarm.incarnations.clone());
        for host in &mut self.hosts {
            host.running = 0;
            let Some(line) = host.line.take() else { continue };
            let deadline = began + longest + host.engine.patience.reply().min(LONGEST_FAREWELL);
            loop {
                let heard = line.hear_within(deadline.saturating_duration_since(Instant::now()));
                match heard {
                    // It has left, has failed, or says what nobody says.
                    Some(Heard::Words(words, at_ns))
                        if understand(&words)
                            .and_then(|event| host.note((event, at_ns), &incarnations, &mut Vec::new()))
                            .is_err() =>
                    {
                        break;
                    }
                    Some(Heard::Words(..) | Heard::Frame(_) | Heard::Here) => {}
                    Some(Heard::Gone) => break,
                    None => {
                        say_aloud(format!("note: {} does not say that all its agents have left", host.name));
                        break;
                    }
                }
            }
        }
    }
}

/// A header with its times by another clock.
fn translated(header: &Header, translate: impl Fn(u64) -> u64) -> Header {
    // In lockstep there is no deadline.
    let deadline_ns = if header.deadline_ns == 0 { 0 } else { translate(header.deadline_ns) };
    Header { sent_ns: translate(header.sent_ns), deadline_ns, ..*header }
}

/// What is wrong with a host, unless it is that the program was asked to stop.
fn lost(name: &str, e: Error) -> Error {
    match e {
        Error::Interrupted(_) => e,
        e => Error::Lost { names: vec![name.to_owned()], how: e.to_string() },
    }
}

impl fmt::Debug for Hosts {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_list().entries(self.hosts.iter().map(|host| &host.name)).finish()
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_host_speaks_of_its_own_agents() {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let engine = Engine::listen(&format!("tcp/127.0.0.1:{port}"), None, Patience::default()).unwrap();
        let planned = PlannedHost { name: "left".to_owned(), at: "tcp/127.0.0.1:1".to_owned(), agents: None };
        let mut host = Host::new("left".to_owned(), planned, engine, 0b10, false);
        host.running = 0b10;
        let mut dead = Vec::new();
        let mut ended = |agent| {
            let how = "ended".to_owned();
            host.note((Event::Ended { agent, incarnation: 0, how }, 0), &[0, 0], &mut dead).is_ok()
        };
        assert!(!ended(0) && !ended(64) && !ended(65) && !ended(usize::MAX));
        assert!(ended(1) && ended(1), "it may have been ended in the meantime");
        assert_eq!(dead.len(), 1);
    }

    #[test]
    fn a_host_of_another_version_or_patience_is_refused_by_name() {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let at = format!("tcp/127.0.0.1:{port}");
        let own = Identity::own(Patience::default());
        let engine = Engine::listen(&at, None, own.patience).unwrap();
        let patience = Patience::parse("10s").unwrap();
        let others = [Identity { program: "9.9.9".to_owned(), ..own.clone() }, Identity { patience, ..own }];
        let (tell, told) = crossbeam::channel::unbounded();
        others.into_iter().for_each(|other| tell.send(other).unwrap());
        let answer = move |question: super::super::engine::Question| {
            question.answer(say(&Answer::I(told.recv().unwrap())));
        };
        let _answering = engine.answer(answer).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hosts.toml");
        std::fs::write(&path, format!("[[host]]\nname = \"left\"\nat = \"{at}\"\n")).unwrap();
        for what in ["9.9.9", "--patience 2s"] {
            let error = Hosts::connect(&Plan::read(&path).unwrap(), 2, false).unwrap_err().to_string();
            assert!(error.contains("host left") && error.contains(what), "{error}");
        }
    }
}
