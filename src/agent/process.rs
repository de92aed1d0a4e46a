//! An agent as a process: opens its ports, reports ready, and ticks until it is told to leave.

use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, getppid, set_parent_process_death_signal};
use serde::{Deserialize, Serialize};

use super::{Agent, AgentSettings, Member, Sensed};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;
use crate::base::scheduling::Scheduling;
use crate::bus::{
    AgentSharedPort, PROTOCOL, SwarmAddress, Wait, Wire, is_tag, wait_for_moment, wait_until, wake_on_time,
};
use crate::failed;
use crate::link::LONGEST_DELAY;

/// At most so many threads wake each other, one after the other, to carry a decision to another machine: the steward of this
/// one, and three of the engine.
const CARRIERS: usize = 4;

/// How long an agent tries to open what its supervisor has created.
const OPEN_DEADLINE: Duration = Duration::from_secs(5);

/// The most 32-bit words that a supervisor puts into a message.
const MOST_WORDS: usize = 1 << 26;

/// What the supervisor tells an agent process at its start. `docs/protocol.md` says which of it other languages can rely on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ProcessSettings {
    /// The swarm it belongs to. It comes first: by that a program knows what it was started for.
    pub address: SwarmAddress,
    /// Which agent it is.
    pub agent: usize,
    /// How often this agent has been started before.
    pub incarnation: u32,
    /// How it waits.
    pub wait: Wait,
    /// How long it waits for its peers in lockstep before it acts without those that are missing.
    pub peers: Duration,
    /// Whether what it sends is carried to other machines: then somebody waits for that against the clock, too.
    #[serde(default, skip_serializing_if = "is_false")]
    pub carried: bool,
    /// What it asks the kernel for.
    pub scheduling: Scheduling,
    /// Process id of the supervisor.
    pub supervisor: i32,
    /// What it runs.
    pub settings: AgentSettings,
    /// How messages are made, for those that are not this program.
    pub wire: Wire,
}

impl ProcessSettings {
    /// An error if no supervisor of this version can have written these settings. Sizes follow from them.
    pub(crate) fn check(&self) -> Result<()> {
        let ProcessSettings { address, agent, settings, wire, .. } = self;
        if wire.protocol != PROTOCOL {
            return Err(failed!(
                "the program that started this agent speaks version {} of the protocol, and this one {PROTOCOL}; build \
                 both from the same source",
                wire.protocol
            ));
        }
        let team = settings.spec.n_agents();
        let sound = (1..=MAX_AGENTS).contains(&team)
            && address.agents == team
            && *agent < team
            && settings.worlds > 0
            && address.worlds == settings.worlds
            && self.longest_message().is_some_and(|words| words <= MOST_WORDS)
            && address.longest_delay == settings.longest_delay
            && address.longest_delay <= LONGEST_DELAY
            && is_tag(&address.tag);
        if sound {
            return Ok(());
        }
        Err(failed!(
            "these are no settings of an agent: agent {agent} of {} in a team of {team}, {} worlds in messages of {}, delays \
             of up to {} and {} ticks, in the swarm `{}`",
            address.agents,
            settings.worlds,
            address.worlds,
            settings.longest_delay,
            address.longest_delay,
            address.tag
        ))
    }

    /// The words of the longest message; `None` if a part of it is too long already. The sums of a [`Spec`](crate::environment::Spec) wrap if its
    /// parts are huge, so the parts come first.
    fn longest_message(&self) -> Option<usize> {
        let AgentSettings { spec, worlds, relay, .. } = &self.settings;
        let (team, unique, common) = (spec.n_agents(), spec.unique, spec.common.len());
        let parts = [team, unique, common, spec.n_actions(), spec.action_width(), *worlds];
        if parts.iter().any(|part| *part > MOST_WORDS) {
            return None;
        }
        let joint = team.checked_mul(unique)?.checked_add(common)?;
        // With --relay, a message has an observation and an age of everybody.
        let relayed = if *relay { team.checked_mul(unique + common + 1)? } else { 0 };
        let widest = [joint, relayed, unique + common, spec.n_actions(), spec.action_width()];
        widest.into_iter().max()?.checked_mul(*worlds)
    }
}

/// Runs an agent until the supervisor sends it away.
pub fn run(process: &ProcessSettings) -> Result<()> {
    leave_with(process.supervisor, Signal::KILL)?;
    // What `top` and `ps` show; not worth an error.
    let name = std::ffi::CString::new(format!("vs-agent-{}", process.agent)).expect("no NUL in it");
    let _ = rustix::thread::set_name(&name);
    let agent = Agent::new(&process.settings, process.agent)?;
    let actor = agent.actor().clone();
    actor.at_home(|| play(process, agent))
}

/// Ticks, on the thread that computes.
fn play(process: &ProcessSettings, mut agent: Agent) -> Result<()> {
    let ProcessSettings { address, incarnation, wait, peers, carried, scheduling, settings, .. } = process;
    if address.real_time {
        wake_on_time();
    }
    agent.warm_up()?;
    let layout = settings.layout();
    let port = open(address, &layout, agent.index(), *incarnation)?;
    // The supervisor is process 0.
    let granted = scheduling.apply(agent.index() + 1);
    let mut member = Member::new(agent, port, layout, address.id(), *incarnation);
    member.report_ready(granted)?;
    wake(&member, *wait)?;
    while next_tick(&mut member, *wait)? {
        member.publish()?;
        match member.deadline_ns() {
            None if !in_lockstep(&mut member, *wait, *carried, *peers)? => return Ok(()),
            Some(_) if !in_real_time(&mut member, *wait, *carried)? => return Ok(()),
            _ => member.predict(),
        }
    }
    Ok(())
}

/// Decides when all observations are in. The supervisor waits for either. False if the agent shall leave, which it may be
/// told while it waits for one that has died.
fn in_lockstep(member: &mut SharedMember, wait: Wait, carried: bool, peers: Duration) -> Result<bool> {
    wake(member, wait)?;
    let deadline = Instant::now() + peers;
    let mut leaves = false;
    wait_until(member, wait, deadline, sleep, |member| {
        let mut complete = member.collect()?;
        if !complete {
            match member.sense()? {
                Sensed::Nothing => {}
                // It is told again whom to wait for.
                Sensed::Tick => complete = member.collect()?,
                Sensed::Shutdown => leaves = true,
            }
        }
        Ok(complete || leaves)
    })?;
    if leaves {
        return Ok(false);
    }
    member.decide()?;
    wake(member, wait)?;
    if wait == Wait::Block {
        // Whom this has woken, and who has yet to decide on the same core, come first: predicting can wait. Whoever
        // carries it to another machine wakes the next.
        let turns = if carried { CARRIERS } else { 1 };
        (0..turns).for_each(|_| std::thread::yield_now());
    }
    Ok(true)
}

/// Decides at the deadline, with the observations that are in; the supervisor looks at its own time. False if the agent
/// shall leave, which it may be told in a long period.
fn in_real_time(member: &mut SharedMember, wait: Wait, carried: bool) -> Result<bool> {
    let carry = |member: &SharedMember| if carried { wake(member, wait) } else { Ok(()) };
    carry(member)?;
    while let Some(deadline_ns) = member.deadline_ns()
        && !wait_for_moment(wait, deadline_ns)
    {
        match member.sense()? {
            Sensed::Nothing => {}
            Sensed::Tick => member.publish().and_then(|()| carry(member))?,
            Sensed::Shutdown => return Ok(false),
        }
    }
    member.collect()?;
    member.decide()?;
    carry(member)?;
    Ok(true)
}

type SharedMember = Member<AgentSharedPort>;

/// Waits for the next tick; false if the agent shall leave.
///
/// Each wait has a bound, but there is no bound on their number: a supervisor may be busy or stopped
/// for long, and if it dies the kernel takes the agent along.
fn next_tick(member: &mut SharedMember, wait: Wait) -> Result<bool> {
    let mut sensed = Sensed::Nothing;
    while sensed == Sensed::Nothing {
        let deadline = Instant::now() + Duration::from_secs(1);
        wait_until(member, wait, deadline, sleep, |member| {
            sensed = member.sense()?;
            Ok(sensed != Sensed::Nothing)
        })?;
    }
    Ok(sensed == Sensed::Tick)
}

fn is_false(value: &bool) -> bool {
    !value
}

fn wake(member: &SharedMember, wait: Wait) -> Result<()> {
    match wait {
        Wait::Block => member.port().wake_supervisor(),
        Wait::Spin => Ok(()),
    }
}

fn sleep(member: &SharedMember, longest: Duration) -> Result<()> {
    member.port().sleep(longest)
}

fn open(
    address: &SwarmAddress,
    layout: &crate::bus::Layout,
    agent: usize,
    incarnation: u32,
) -> Result<AgentSharedPort> {
    let deadline = Instant::now() + OPEN_DEADLINE;
    loop {
        match AgentSharedPort::open(address, layout, agent, incarnation) {
            Err(_) if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(20)),
            result => return result,
        }
    }
}

/// Has the kernel send this process a signal when the one that started it dies, however that happens.
pub fn leave_with(parent: i32, signal: Signal) -> Result<()> {
    set_parent_process_death_signal(Some(signal))
        .map_err(|e| failed!("cannot tie this process to the one that started it: {e}"))?;
    // It may have died before the line above.
    match getppid().map(Pid::as_raw_nonzero) {
        Some(now) if now.get() == parent => Ok(()),
        _ => Err(failed!("process {parent}, which started this one, is gone")),
    }
}
