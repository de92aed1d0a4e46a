//! One host, as the supervisor knows it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::clock::HostClock;
use super::engine::{End, Engine, Heard, Line};
use super::key::Key;
use super::offset::{Exchange, Jump};
use super::orders::{
    Answer, Event, Identity, Invitation, Order, Question, bit_among, say, secret, understand,
};
use super::outbox::Outbox;
use super::patience::Patience;
use super::plan::PlannedHost;
use super::tally::Tally;
use crate::agent::process::ProcessSettings;
use crate::base::error::{Error, Result};
use crate::base::hash::fnv1a;
use crate::bus::{Bell, Header};
use crate::failed;
use crate::supervisor::{members_of, say as say_aloud, signals};

/// How often a wait looks whether the program was asked to stop.
const SLICE: Duration = Duration::from_millis(50);

/// A host.
pub(super) struct Host {
    /// Name and address, for errors.
    pub(super) name: String,
    pub(super) planned: PlannedHost,
    pub(super) engine: Engine,
    /// Its agents, bit by bit.
    pub(super) agents: u64,
    /// Those that have been started and have not ended.
    pub(super) running: u64,
    /// Open as long as the host is there.
    pub(super) line: Option<Line>,
    /// What it is sent next.
    pub(super) outbox: Outbox,
    /// Of observations that come from there, and of those that have come there.
    pub(super) tallies: [Tally; 2],
    pub(super) clock: HostClock,
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

    pub(super) fn new(
        name: String,
        planned: PlannedHost,
        engine: Engine,
        agents: u64,
        network_is_link: bool,
    ) -> Host {
        Host {
            name,
            planned,
            engine,
            agents,
            running: 0,
            line: None,
            outbox: Outbox::new(false, network_is_link),
            tallies: [Tally::default(); 2],
            clock: HostClock::new(),
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
    pub(super) fn join(&mut self, example: &ProcessSettings, policy: &[u8], bell: &Arc<Bell>) -> Result<()> {
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
        self.await_time()
    }

    /// Asks for the time, and waits for the answer.
    fn await_time(&mut self) -> Result<()> {
        let question = self.clock.ask();
        self.order(question);
        let longest = self.engine.patience.reply();
        let deadline = Instant::now() + longest;
        while Instant::now() < deadline {
            signals::check_stop()?;
            let line = self.line.as_ref().expect("it has joined");
            let how = match line.hear_within(SLICE) {
                Some(Heard::Words(words, at_ns)) => {
                    match understand(&words).map_err(|e| lost(&self.name, e))? {
                        Event::Told { asked_ns, heard_ns, said_ns, .. } => {
                            self.note_time(&Exchange { asked_ns, heard_ns, said_ns, answered_ns: at_ns });
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

    pub(super) fn ask_time(&mut self) {
        let Host { line: Some(line), clock, .. } = self else { return };
        line.say_unless_full(say(&clock.ask()));
    }

    /// Takes note of what its clock says.
    fn note_time(&mut self, exchange: &Exchange) {
        if let Some(Jump { by_ns, allowed_ns, .. }) = self.clock.note(exchange) {
            say_aloud(format!(
                "warning: the clock of {} moved by {:.3} ms against ours, of which errors and drift explain {:.3} ms; was \
                 that machine suspended? Until now its times, and the deadlines it was given, may have been wrong by that",
                self.name,
                by_ns as f64 / 1e6,
                allowed_ns as f64 / 1e6
            ));
        }
    }

    /// Adds a message to what it is sent next, with its times by the clock there.
    pub(super) fn push(&mut self, header: &Header, words: &[u32]) {
        let clock = self.clock.estimate();
        let header = translated(header, |ns| clock.theirs(ns));
        self.outbox.push(&header, words);
    }

    pub(super) fn order(&self, order: Order) {
        self.line.iter().for_each(|line| line.say(say(&order)));
    }

    /// It is gone, and its agents with it.
    pub(super) fn lose(&mut self, how: &str, dead: &mut Vec<(usize, String)>) {
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
    pub(super) fn note(
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
                self.note_time(&Exchange { asked_ns, heard_ns, said_ns, answered_ns: at_ns });
                Ok(())
            }
            Event::Failed(how) => Err(failed!("cannot go on: {how}")),
            Event::Left => Err(failed!("has left")),
        }
    }
}

/// A header with its times by another clock.
pub(super) fn translated(header: &Header, translate: impl Fn(u64) -> u64) -> Header {
    // In lockstep there is no deadline.
    let deadline_ns = if header.deadline_ns == 0 { 0 } else { translate(header.deadline_ns) };
    Header { sent_ns: translate(header.sent_ns), deadline_ns, ..*header }
}

/// What is wrong with a host, unless it is that the program was asked to stop.
pub(super) fn lost(name: &str, e: Error) -> Error {
    match e {
        Error::Interrupted(_) => e,
        e => Error::Lost { names: vec![name.to_owned()], how: e.to_string() },
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
}
