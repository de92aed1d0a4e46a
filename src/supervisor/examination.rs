//! An agent of another program, examined: the same ticks are played to it and to one of ours, and their answers compared.

use std::process::Stdio;
use std::time::{Duration, Instant};

use rustix::process::getpid;

use super::answers::Due;
use super::needs::{reserve_shared_memory, share_weights};
use super::processes::{name_of, waker};
use super::{
    ActionDraws, AgentCommand, Children, Deadlines, Decisions, InProcess, Order, Team, Tick, signals,
};
use crate::agent::AgentSettings;
use crate::agent::process::ProcessSettings;
use crate::base::error::Result;
use crate::base::scheduling::Scheduling;
use crate::bus::{
    AgentPort, AgentSharedPort, Header, Kind, Layout, PROTOCOL, Sample, SharedSample, SupervisorPort,
    SwarmAddress, SwarmDirectory, Wait, wait_until,
};
use crate::environment::Spec;
use crate::nn::Policy;
use crate::{failed, usage};

/// How far logits may be apart, in shares of the largest: networks in f32 that add in another order.
const LOGITS: f32 = 1e-5;

/// How long an agent is watched that must not decide yet.
const WATCH: Duration = Duration::from_millis(10);

/// In every so many ticks a peer is lost.
const LOSS: u64 = 8;

/// A team of ours whose ticks are also played to an agent of another program, in the place of one of them. Its peers are not
/// really there: what they observe is published for them.
pub struct Examination {
    reference: InProcess,
    index: usize,
    spec: Spec,
    layout: Layout,
    draws: ActionDraws,
    deadlines: Deadlines,
    /// What all its messages have in common.
    identity: Header,
    musters: u64,
    checks: Vec<Check>,
    /// The one process.
    examined: Children,
    /// Its peers, and by what they speak.
    peers: Vec<(usize, AgentSharedPort)>,
    port: SupervisorPort,
    // Declared last: all else in it goes first.
    _directory: SwarmDirectory,
}

/// Something that is examined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// What it is.
    pub what: &'static str,
    /// How often it was looked at.
    pub looked: usize,
    /// What was wrong the first time that something was.
    pub fault: Option<String>,
}

const READY: usize = 0;
const MESSAGES: usize = 1;
const OBSERVATIONS: usize = 2;
const WAITING: usize = 3;
const AGES: usize = 4;
const ESTIMATES: usize = 5;
const LOGIT: usize = 6;
const ACTIONS: usize = 7;
const SHUTDOWN: usize = 8;

const CHECKS: [&str; 9] = [
    "is ready in time",
    "messages are those due",
    "publishes what its sensor gave it",
    "waits for those who are there, and for nobody else",
    "ages are of what arrives",
    "joint estimates are equal",
    "logits are equal",
    "actions are equal",
    "leaves when told to",
];

impl Examination {
    /// Starts `command` as agent `index` of a team with these settings, which are for a policy that stays as it is, and
    /// lockstep.
    pub fn start(
        settings: &AgentSettings,
        policy: &Policy,
        index: usize,
        command: AgentCommand,
        deadlines: Deadlines,
    ) -> Result<Examination> {
        let (spec, layout) = (settings.spec.clone(), settings.layout());
        if settings.relay {
            return Err(usage!("an agent is checked where nobody relays"));
        }
        let directory = SwarmDirectory::create()?;
        let reference = InProcess::new(settings, policy)?;
        let settings = share_weights(settings, policy, &directory, [true, false])?;
        let address = SwarmAddress {
            agents: spec.n_agents(),
            worlds: settings.worlds,
            longest_delay: settings.longest_delay,
            ..SwarmAddress::of(directory.tag())
        };
        reserve_shared_memory(&directory, &address, &layout)?;
        let port = SupervisorPort::create(&address, &layout)?;
        let open = |peer| Ok((peer, AgentSharedPort::open(&address, &layout, peer, 0)?));
        let peers = (0..spec.n_agents()).filter(|peer| *peer != index).map(open).collect::<Result<_>>()?;
        let mut examination = Examination {
            reference,
            index,
            layout,
            draws: ActionDraws::of(&settings),
            deadlines,
            identity: Header {
                protocol: PROTOCOL,
                swarm: address.id(),
                sender: index as u32,
                ..Header::default()
            },
            musters: 0,
            checks: CHECKS.map(|what| Check { what, looked: 0, fault: None }).to_vec(),
            examined: Children::new(command, waker(&address))?,
            peers,
            port,
            spec,
            _directory: directory,
        };
        let process = ProcessSettings {
            wire: address.wire(&layout),
            address,
            agent: index,
            incarnation: 0,
            wait: Wait::Block,
            peers: deadlines.peers,
            carried: false,
            scheduling: Scheduling::default(),
            supervisor: std::process::id() as i32,
            settings,
        };
        let nothing = [Stdio::null(), Stdio::null()];
        examination.examined.start(&name_of(index), "agent", &process, nothing)?;
        let ready = Due { kind: Kind::Ready, tick: 0, words: 1 };
        let answer = examination.await_answer(deadlines.ready, SupervisorPort::receive_decision)?;
        match answer {
            Some(sample) => examination.note(READY, ready.fault_of(&sample, &examination.identity.clone())),
            None => examination.note(READY, Some(format!("said nothing for {:?}", deadlines.ready))),
        }
        Ok(examination)
    }

    /// Whether it can be played to: a message that it cannot send is the end.
    pub fn can_go_on(&self) -> bool {
        self.checks[..=MESSAGES].iter().all(|check| check.fault.is_none())
    }

    /// Tells it to leave. What was found.
    pub fn end(mut self) -> Result<Vec<Check>> {
        if self.can_go_on() {
            let header = Header { kind: Kind::Shutdown as u32, ..self.identity };
            self.port.send_sensor(self.index, header, |_| {})?;
            self.port.wake_agents()?;
            let leave = self.deadlines.leave;
            let left = self.examined.await_exit(leave)?;
            let fault = match left {
                Some(0) => None,
                Some(code) => Some(format!("ended with exit code {code}, not 0")),
                None => Some(format!("was still there after {leave:?}")),
            };
            self.note(SHUTDOWN, fault);
        }
        Ok(self.checks)
    }

    fn note(&mut self, check: usize, fault: Option<String>) {
        let check = &mut self.checks[check];
        check.looked += 1;
        check.fault = check.fault.take().or(fault);
    }

    /// The next message by `receive`; `None` if there is none for so long, or its process has ended.
    fn await_answer(
        &mut self,
        longest: Duration,
        receive: impl Fn(&SupervisorPort) -> Result<Option<SharedSample>>,
    ) -> Result<Option<SharedSample>> {
        let (mut answer, deadline) = (None, Instant::now() + longest);
        let sleep = |examination: &Examination, longest| examination.port.sleep(longest);
        wait_until(self, Wait::Block, deadline, sleep, |examination| {
            signals::check_stop()?;
            answer = receive(&examination.port)?;
            // Not what was published for its peers.
            while answer.as_ref().is_some_and(|sample| sample.process() == Some(getpid())) {
                answer = receive(&examination.port)?;
            }
            examination.examined.check_alive()?;
            Ok(answer.is_some())
        })?;
        Ok(answer)
    }

    /// Tells it of a tick.
    fn send_sensor(&mut self, tick: &Tick, absent: u64, again: bool) -> Result<()> {
        let header = Header {
            absent,
            incarnation: again.into(),
            ..tick.header(self.layout.sensor_words(tick.worlds))
        };
        let Header { protocol, swarm, sender, .. } = self.identity;
        let header = Header { protocol, swarm, sender, kind: Kind::Sensor as u32, ..header };
        let (index, layout, draws) = (self.index, &self.layout, &self.draws);
        self.port.send_sensor(index, header, |words| tick.write(index, layout, draws, words))?;
        self.port.wake_agents()
    }

    /// Publishes what its peers observe, but for those who are absent.
    fn publish_peers(&mut self, tick: &Tick) -> Result<()> {
        let words = self.layout.observation_words(tick.worlds);
        let Header { protocol, swarm, .. } = self.identity;
        for (peer, port) in self.peers.iter_mut().filter(|(peer, _)| tick.absent >> peer & 1 == 0) {
            let (kind, sender) = (Kind::Observation as u32, *peer as u32);
            let header = Header { protocol, swarm, kind, sender, ..tick.header(words) };
            let own = &tick.observations[*peer * words..][..words];
            port.publish_observation(header, |words| words.copy_from_slice(bytemuck::cast_slice(own)))?;
        }
        self.port.wake_agents()
    }

    /// Awaits the message that is due, if it is not there `already`; an error if another comes, or none.
    fn expect(
        &mut self,
        due: Due,
        already: Option<SharedSample>,
        receive: impl Fn(&SupervisorPort) -> Result<Option<SharedSample>>,
    ) -> Result<SharedSample> {
        let answer = self.answer_due(due, already, receive);
        let fault = answer.as_ref().err().map(ToString::to_string);
        self.note(MESSAGES, fault);
        answer
    }

    fn answer_due(
        &mut self,
        due: Due,
        mut already: Option<SharedSample>,
        receive: impl Fn(&SupervisorPort) -> Result<Option<SharedSample>>,
    ) -> Result<SharedSample> {
        let longest = self.deadlines.answer;
        let deadline = Instant::now() + longest;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let answer =
                already.take().map_or_else(|| self.await_answer(left, &receive), |it| Ok(Some(it)))?;
            let Some(sample) = answer else {
                return Err(failed!("tick {}: sent no {:?} for {longest:?}", due.tick, due.kind));
            };
            if let Some(fault) = due.fault_of(&sample, &self.identity) {
                return Err(failed!("tick {}: {fault}", due.tick));
            }
            if sample.header().tick == due.tick {
                return Ok(sample);
            }
            if left.is_zero() {
                return Err(failed!("tick {}: sent only what is late for {longest:?}", due.tick));
            }
        }
    }

    /// Notes whether it has decided although it should not have yet.
    fn watch(&mut self, tick: &Tick, why: &str) -> Result<Option<SharedSample>> {
        let early = self.await_answer(WATCH, SupervisorPort::receive_decision);
        if let Err(e) = &early {
            self.note(MESSAGES, Some(format!("tick {}: {e}", tick.tick)));
        }
        let early = early?;
        self.note(WAITING, early.is_some().then(|| format!("tick {}: decided {why}", tick.tick)));
        Ok(early)
    }

    /// Compares a decision with that of ours.
    fn compare(&mut self, tick: &Tick, sample: &SharedSample, ours: &Decisions) {
        let theirs = self.layout.decision(sample.words(), tick.worlds);
        let (index, number) = (self.index, tick.tick);
        let ages = row(&ours.ages, index, theirs.ages.len());
        self.note(AGES, difference(number, theirs.ages, ages, |theirs, ours| theirs == ours));
        let estimates = row(&ours.estimates, index, theirs.estimates.len());
        let equal = |theirs: &f32, ours: &f32| theirs.to_bits() == ours.to_bits();
        self.note(ESTIMATES, difference(number, theirs.estimates, estimates, equal));
        let available = self.spec.available_actions(index);
        let each = self.layout.logits;
        let logits = row(&ours.logits, index, theirs.logits.len());
        for (theirs, ours) in theirs.logits.chunks_exact(each).zip(logits.chunks_exact(each)) {
            let (theirs, ours) = (&theirs[..available], &ours[..available]);
            let largest = ours.iter().fold(1.0f32, |largest, logit| largest.max(logit.abs()));
            let equal = |theirs: &f32, ours: &f32| (theirs - ours).abs() <= LOGITS * largest;
            self.note(LOGIT, difference(number, theirs, ours, equal));
        }
        let actions = row(&ours.actions, index, theirs.actions.len());
        self.note(ACTIONS, difference(number, theirs.actions, actions, |theirs, ours| theirs == ours));
    }
}

impl Team for Examination {
    fn muster(&mut self, _orders: &[Order]) -> Result<u64> {
        self.musters += 1;
        let lost = (self.index + 1) % self.spec.n_agents();
        Ok(u64::from(self.musters.is_multiple_of(LOSS)) << lost)
    }

    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        self.reference.tick(tick, decisions)?;
        self.draws.draw(tick);
        let words = self.layout.observation_words(tick.worlds);
        self.send_sensor(tick, 0, false)?;
        let due = Due { kind: Kind::Observation, tick: tick.tick, words };
        let observation = self.expect(due, None, SupervisorPort::receive_observation)?;
        let own: &[u32] = bytemuck::cast_slice(&tick.observations[self.index * words..][..words]);
        self.note(OBSERVATIONS, difference(tick.tick, observation.words(), own, |theirs, own| theirs == own));
        let early = if tick.absent == 0 {
            let early = self.watch(tick, "before its peers had published")?;
            self.publish_peers(tick)?;
            early
        } else {
            self.publish_peers(tick)?;
            let early = self.watch(tick, "without a peer of whom nobody had said that it is absent")?;
            self.send_sensor(tick, tick.absent, true)?;
            early
        };
        let due = Due { kind: Kind::Decision, words: self.layout.decision_words(tick.worlds), ..due };
        let decision = self.expect(due, early, SupervisorPort::receive_decision)?;
        self.compare(tick, &decision, decisions);
        Ok(())
    }

    fn longest_delay(&self) -> u8 {
        self.reference.longest_delay()
    }

    fn renew(&mut self, _weights: &[f32]) -> Result<()> {
        Err(failed!("an agent is checked with a frozen policy"))
    }
}

/// What belongs to one agent, of which each has so much.
fn row<T>(all: &[T], agent: usize, each: usize) -> &[T] {
    &all[agent * each..][..each]
}

/// The first value that is not as it should be, in words.
fn difference<T: std::fmt::Debug>(
    tick: u64,
    found: &[T],
    expected: &[T],
    equal: impl Fn(&T, &T) -> bool,
) -> Option<String> {
    let at = (0..expected.len()).find(|at| !equal(&found[*at], &expected[*at]))?;
    Some(format!("tick {tick}: value {at} is {:?}, and ours {:?}", found[at], expected[at]))
}
