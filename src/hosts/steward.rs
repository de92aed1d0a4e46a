//! The host's side: a program that looks after some agents of one swarm at a time.

use std::net::ToSocketAddrs;
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, RecvTimeoutError, bounded, unbounded};
use rustix::process::Signal;

use super::engine::{self, End, Engine, Heard, Line};
use super::frame::{Frame, Shape};
use super::key::Key;
use super::orders::{Answer, Event, Identity, Invitation, Order, Question, say, understand};
use super::plan::check_address;
use crate::agent::PolicySource;
use crate::agent::process::ProcessSettings;
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::base::hash::fnv1a;
use crate::bus::{Bell, Header, Kind, PROTOCOL, Sample, StandIns, SupervisorPort, SwarmDirectory, Wait};
use crate::supervisor::{
    AgentCommand, Children, Deadlines, allow_open_files, check_tasks, members_of, reserve_shared_memory,
    signals,
};
use crate::{failed, usage};

/// How long what some agents have answered waits for the others: who is slower has a frame of its own.
const PATIENCE: Duration = Duration::from_millis(20);

/// The longest this sleeps before it looks again.
const LONGEST_SLEEP: Duration = Duration::from_millis(100);

/// How long the supervisor may take to be there after it has asked.
const LONGEST_ARRIVAL: Duration = Duration::from_secs(5);

/// Somebody wants this host to join a swarm.
struct Request {
    question: engine::Question,
    invitation: Invitation,
    policy: Vec<u8>,
}

/// Listens at an address until the program is asked to stop, for all that have the key. `tell` is told what happens.
pub(crate) fn serve(at: &str, key: Option<&Path>, tell: impl Fn(&str)) -> Result<()> {
    check_address(at).map_err(|how| usage!("--listen {at}, {how}"))?;
    let key = key.map(Key::read).transpose()?;
    if key.is_none() && !is_within_this_machine(at) {
        return Err(usage!(
            "at {at} others could start agents here; give a key with --key FILE, or listen at tcp/127.0.0.1:7447"
        ));
    }
    let engine = Engine::listen(at, key.as_ref())?;
    let (is_busy, (ask, asked)) = (Arc::new(AtomicBool::new(false)), bounded(1));
    let busy = is_busy.clone();
    let _answering = engine.answer(move |question| {
        let bytes = question.bytes();
        let answer = match Question::parse(&bytes) {
            Err(e) => Answer::No(e.to_string()),
            Ok((Question::Who, _)) => Answer::I(Identity::own()),
            Ok((Question::Join(_), _)) if busy.swap(true, Ordering::Relaxed) => {
                Answer::No("it looks after the agents of another swarm".to_owned())
            }
            Ok((Question::Join(invitation), policy)) => {
                let request = Request { question, invitation: *invitation, policy: policy.to_vec() };
                // There is one at a time, and whoever listens has ended if there is no place.
                return drop(ask.try_send(request));
            }
        };
        question.answer(say(&answer));
    })?;
    tell(&format!("listening at {at}; Ctrl-C ends it"));
    loop {
        signals::check_stop()?;
        match asked.recv_timeout(LONGEST_SLEEP) {
            Ok(request) => look_after(&engine, request, &is_busy, &tell)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(failed!("the engine has ended")),
        }
    }
}

/// Whether nobody on another machine can get at an address.
fn is_within_this_machine(at: &str) -> bool {
    let addresses = at.trim_start_matches("tcp/").to_socket_addrs();
    addresses.is_ok_and(|mut addresses| addresses.all(|address| address.ip().is_loopback()))
}

/// Joins a swarm, and is part of it until it ends. Before the supervisor hears that, this host is there for the next.
///
/// # Errors
/// `Interrupted` if the program was asked to stop; all else is told to the supervisor.
fn look_after(engine: &Engine, request: Request, is_busy: &AtomicBool, tell: &impl Fn(&str)) -> Result<()> {
    let Request { question, invitation, policy } = request;
    let mut steward = match Steward::join(engine, &invitation, &policy) {
        Ok(steward) => steward,
        Err(e) => {
            tell(&format!("did not join a swarm: {e}"));
            is_busy.store(false, Ordering::Relaxed);
            question.answer(say(&Answer::No(e.to_string())));
            return Ok(());
        }
    };
    let agents: Vec<String> = members_of(steward.own).map(|agent| agent.to_string()).collect();
    tell(&format!("joined swarm {} with agents {}", invitation.example.address.tag, agents.join(", ")));
    question.answer(say(&Answer::Yes));
    let ended = steward.run();
    let line = steward.leave();
    is_busy.store(false, Ordering::Relaxed);
    match ended {
        Ok(()) => {
            tell("the swarm has ended");
            line.say(say(&Event::Left));
        }
        Err(e) => {
            tell(&format!("the swarm has ended: {e}"));
            line.say(say(&Event::Failed(e.to_string())));
            if matches!(e, Error::Interrupted(_)) {
                return Err(e);
            }
        }
    }
    Ok(())
}

/// What looks after the agents here: on the bus of this machine it is their supervisor, and stands in for all other agents.
struct Steward {
    line: Line,
    shape: Shape,
    /// The settings of any agent here.
    example: ProcessSettings,
    /// The agents that run here, bit by bit.
    own: u64,
    /// Those that have been started and have not ended.
    running: u64,
    /// Those that have not been ready yet.
    unready: u64,
    /// How often each had been started before.
    incarnations: Vec<u32>,
    out: Outgoing,
    /// What agents say on stderr.
    said: Receiver<(usize, String)>,
    children: Children,
    /// `None` if all agents run here: then there is no room.
    stand_ins: Option<StandIns>,
    port: SupervisorPort,
    // Declared last: all else in it goes first.
    directory: SwarmDirectory,
}

/// What is to be sent, and who is waited for.
#[derive(Default)]
struct Outgoing {
    frame: Frame,
    /// When the first message came in.
    since: Option<Instant>,
    /// Whether it cannot wait for others.
    is_urgent: bool,
    /// Whether there are decisions in it.
    has_decisions: bool,
    /// Agents that have yet to publish at this tick, bit by bit, and to decide.
    silent: u64,
    undecided: u64,
    /// Whether no agent that is elsewhere is waited for.
    is_alone: bool,
}

impl Steward {
    /// Makes room for the agents, and opens the line.
    fn join(engine: &Engine, invitation: &Invitation, policy: &[u8]) -> Result<Steward> {
        let Invitation { example, agents: own, policy: hash } = invitation;
        example.check()?;
        let (team, layout) = (example.address.agents, example.settings.layout());
        let everybody = u64::MAX >> (u64::BITS as usize - team);
        if *own == 0 || own & !everybody != 0 || example.address.weights != 0 || example.address.real_time {
            return Err(failed!("this is no swarm that a host can be part of"));
        }
        if fnv1a(policy.iter().copied()) != *hash {
            return Err(failed!("the policy did not arrive whole ({} bytes); try again", policy.len()));
        }
        let directory = SwarmDirectory::create()?;
        let path = directory.path().join("policy.safetensors");
        AtomicFile::write(&path, policy)?;
        let mut example = example.clone();
        let supervisors = std::mem::replace(&mut example.address.tag, directory.tag().to_owned());
        example.settings.policy = PolicySource::Copy(path);
        example.supervisor = std::process::id() as i32;
        example.wait = Wait::Block;
        example.wire = example.address.wire(&layout);
        let address = &example.address;
        reserve_shared_memory(&directory, address, &layout)?;
        allow_open_files(team)?;
        check_tasks(own.count_ones() as usize)?;
        let port = SupervisorPort::create(address, &layout)?;
        let bell = Arc::new(Bell::of(address)?);
        let (say, said) = unbounded();
        let ring = bell.clone();
        let mut children = Children::new(AgentCommand::this_program()?, move || ring.ring())?.heard_by(say);
        (0..team).for_each(|_| children.leave_out());
        let others = everybody & !own;
        Ok(Steward {
            line: engine.line(&supervisors, End::Host, move || bell.ring())?,
            shape: Shape { layout, worlds: example.settings.worlds },
            own: *own,
            running: 0,
            unready: *own,
            incarnations: vec![0; team],
            out: Outgoing::default(),
            said,
            children,
            stand_ins: (others != 0).then(|| StandIns::open(address, &layout, others)).transpose()?,
            port,
            directory,
            example,
        })
    }

    /// Looks after them until the supervisor wants no more of it.
    fn run(&mut self) -> Result<()> {
        let (began, mut has_come) = (Instant::now(), false);
        loop {
            signals::check_stop()?;
            let mut wakes = false;
            while let Some(heard) = self.line.hear() {
                match heard {
                    Heard::Here => has_come = true,
                    Heard::Gone => return Err(failed!("the supervisor is gone")),
                    Heard::Frame(bytes) => {
                        self.take_frame(&bytes)?;
                        wakes = true;
                    }
                    Heard::Words(words) => match understand(&words)? {
                        Order::Leave => return Ok(()),
                        order => self.follow(order),
                    },
                }
            }
            if !has_come && began.elapsed() > LONGEST_ARRIVAL {
                return Err(failed!("the supervisor did not come"));
            }
            if wakes {
                self.port.wake_agents()?;
            }
            self.take_answers()?;
            self.take_dead()?;
            self.send_due()?;
            let waits =
                self.out.since.map_or(LONGEST_SLEEP, |since| PATIENCE.saturating_sub(since.elapsed()));
            // Not 0, which is forever.
            self.port.sleep(waits.max(Duration::from_millis(1)))?;
        }
    }

    /// Puts on the bus what the supervisor and the agents elsewhere have sent.
    fn take_frame(&mut self, bytes: &[u8]) -> Result<()> {
        let Steward { port, stand_ins, out, own, .. } = self;
        let (shape, swarm) = (self.shape, self.example.address.id());
        let everybody = u64::MAX >> (u64::BITS as usize - shape.layout.agents);
        shape.each(bytes, |header, words| {
            let (agent, bit) = (header.sender as usize, 1 << header.sender);
            let header = Header { swarm, ..header };
            let copy = |to: &mut [u32]| bytemuck::cast_slice_mut(to).copy_from_slice(words);
            match header.kind {
                kind if kind == Kind::Observation as u32 && *own & bit == 0 => {
                    stand_ins.as_ref().map_or(Ok(()), |stand_ins| stand_ins.publish_observation(header, copy))
                }
                kind if kind == Kind::Sensor as u32 && *own & bit != 0 => {
                    if header.incarnation == 0 {
                        out.silent |= bit;
                        out.undecided |= bit;
                    }
                    out.is_alone = (*own | header.absent) & everybody == everybody;
                    port.send_sensor(agent, header, copy)
                }
                kind if kind == Kind::Shutdown as u32 && *own & bit != 0 => {
                    port.send_sensor(agent, header, copy)
                }
                kind => Err(failed!("the supervisor sent agent-{agent} a message of kind {kind}")),
            }
        })
    }

    fn follow(&mut self, order: Order) {
        match order {
            Order::Start { agent, incarnation } if self.own >> agent & 1 == 1 => {
                self.incarnations[agent] = incarnation;
                let settings = ProcessSettings { agent, incarnation, ..self.example.clone() };
                let (name, nothing) = (format!("agent-{agent}"), [Stdio::null(), Stdio::null()]);
                match self.children.start_anew(agent, &name, "agent", &settings, nothing) {
                    Ok(()) => self.running |= 1 << agent,
                    Err(e) => self.line.say(say(&Event::Ended { agent, incarnation, how: e.to_string() })),
                }
            }
            Order::Signal { agent, signal } if self.own >> agent & 1 == 1 => {
                let signal = Signal::from_named_raw(signal);
                signal.iter().for_each(|signal| self.children.signal(agent, *signal));
            }
            Order::End { agent } if self.own >> agent & 1 == 1 => {
                self.children.end(agent);
                self.running &= !(1 << agent);
            }
            // Nobody sends these.
            _ => {}
        }
    }

    /// Takes what the agents here have published and decided.
    fn take_answers(&mut self) -> Result<()> {
        while let Some(sample) = self.port.receive_observation()? {
            let bit = 1 << sample.header().sender;
            // Those that are elsewhere are read along.
            if self.own & bit != 0 {
                self.out.push(sample.header(), sample.words());
                self.out.silent &= !bit;
            }
        }
        while let Some(sample) = self.port.receive_decision()? {
            let bit = 1 << sample.header().sender;
            self.out.push(sample.header(), sample.words());
            if sample.header().kind == Kind::Ready as u32 {
                self.out.is_urgent = true;
                self.unready &= !bit;
                if self.unready == 0 {
                    // All segments are there.
                    self.directory.take_pages()?;
                }
            } else {
                self.out.has_decisions = true;
                self.out.undecided &= !bit;
            }
        }
        Ok(())
    }

    fn take_dead(&mut self) -> Result<()> {
        let dead = self.children.take_dead()?;
        for (agent, line) in self.said.try_iter() {
            self.line.say(say(&Event::Said { agent, line }));
        }
        for (agent, _, how) in dead {
            self.running &= !(1 << agent);
            self.line.say(say(&Event::Ended { agent, incarnation: self.incarnations[agent], how }));
        }
        Ok(())
    }

    /// Sends what is complete, or has waited for long enough.
    fn send_due(&mut self) -> Result<()> {
        let (out, running) = (&mut self.out, self.running);
        let Some(since) = out.since else { return Ok(()) };
        let is_complete = out.silent & running == 0 && !(out.has_decisions && out.undecided & running != 0);
        if !is_complete && !out.is_urgent && since.elapsed() < PATIENCE {
            return Ok(());
        }
        self.line.send(out.frame.take());
        (out.since, out.is_urgent, out.has_decisions) = (None, false, false);
        if out.is_alone && out.silent & running == 0 && out.undecided & running != 0 {
            // Nothing comes from elsewhere that would wake them.
            self.port.wake_agents()?;
        }
        Ok(())
    }

    /// Ends all agents. Nothing of the swarm is left then, but for the line.
    fn leave(mut self) -> Line {
        for agent in members_of(self.own) {
            self.children.signal(agent, Signal::CONT);
            let header = Header {
                protocol: PROTOCOL,
                kind: Kind::Shutdown as u32,
                swarm: self.example.address.id(),
                sender: agent as u32,
                ..Header::default()
            };
            // An agent that cannot be told is ended.
            let _ = self.port.send_sensor(agent, header, |_| {});
        }
        let _ = self.port.wake_agents();
        self.children.reap(Deadlines::default().leave);
        let Steward { line, said, .. } = self;
        said.try_iter().for_each(|(agent, words)| line.say(say(&Event::Said { agent, line: words })));
        line
    }
}

impl Outgoing {
    fn push(&mut self, header: &Header, words: &[u32]) {
        self.frame.push(header, words);
        self.since.get_or_insert_with(Instant::now);
    }
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;
    use crate::agent::AgentSettings;
    use crate::base::scheduling::Scheduling;
    use crate::bus::SwarmAddress;
    use crate::environment::Task;

    #[test]
    fn a_policy_that_does_not_arrive_whole_is_refused() {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let engine = Engine::listen(&format!("tcp/127.0.0.1:{port}"), None).unwrap();
        let settings = AgentSettings::of(Task::parse("hear-see").unwrap().spec());
        let address = SwarmAddress { agents: 2, ..SwarmAddress::of("0123abcd") };
        let example = ProcessSettings {
            wire: address.wire(&settings.layout()),
            address,
            agent: 0,
            incarnation: 0,
            wait: Wait::Block,
            peers: Duration::from_secs(1),
            scheduling: Scheduling::default(),
            supervisor: 1,
            settings,
        };
        let invitation = Invitation { example, agents: 0b01, policy: fnv1a(*b"policy") };
        let refused = |invitation: &Invitation, policy: &[u8]| {
            Steward::join(&engine, invitation, policy).err().expect("it is refused").to_string()
        };
        assert!(refused(&invitation, b"polic").contains("did not arrive whole (5 bytes)"));
        let nobody = Invitation { agents: 0b100, ..invitation };
        assert!(refused(&nobody, b"policy").contains("no swarm"));
    }
}
