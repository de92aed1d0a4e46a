//! A team of processes over shared memory.

use std::process::Stdio;
use std::time::Instant;

use rustix::process::Signal;

use super::chronicle::Chronicle;
use super::clock::{Clock, Period};
use super::command::AgentCommand;
use super::deadlines::Deadlines;
use super::elsewhere::{Elsewhere, HostReport, Nowhere};
use super::launch::Children;
use super::needs::{allow_open_files, check_tasks, reserve_shared_memory, share_weights};
use super::roster::{Roster, members_of};
use super::speakers::Speakers;
use super::{
    ActionDraws, Decisions, Faults, OnFailure, Order, Punctuality, Team, Tick, check_weights, signals,
};
use crate::agent::process::ProcessSettings;
use crate::agent::{AgentSettings, PolicySource};
use crate::base::error::{Error, Result};
use crate::base::scheduling::{Granted, Grants, Scheduling, allowed_cores};
use crate::bus::{
    Header, Kind, Layout, PROTOCOL, SupervisorPort, SwarmAddress, SwarmDirectory, Wait, now_ns,
    wait_for_moment, wait_until, wake_on_time, wake_supervisor,
};
use crate::environment::Spec;
use crate::nn::Policy;
use crate::{failed, usage};

/// A running swarm. Dropping it ends the agents and leaves nothing behind.
#[derive(Debug)]
pub struct Processes {
    pub(super) spec: Spec,
    /// Those that run here, each in its place.
    pub(super) agents: Children,
    pub(super) elsewhere: Box<dyn Elsewhere>,
    pub(super) port: SupervisorPort,
    /// Which swarm it is, and which weights are in force.
    pub(super) identity: Header,
    pub(super) layout: Layout,
    draws: ActionDraws,
    pub(super) speakers: Speakers,
    longest_delay: u8,
    /// Against which is held what agents pass on; `None` if they do not relay.
    pub(super) chronicle: Option<Chronicle>,
    /// The number of weights of the policy.
    policy_weights: usize,
    pub(super) conduct: Conduct,
    /// What agents run, the address and the weights of the swarm included.
    settings: AgentSettings,
    pub(super) address: SwarmAddress,
    /// Who is there.
    pub(super) roster: Roster,
    /// The present tick, or the last one.
    pub(super) tick: u64,
    /// That of a team in real time; `None` in lockstep.
    pub(super) clock: Option<Clock>,
    /// Agents that have done what the current phase waits for, bit by bit.
    pub(super) answered: u64,
    /// What each agent was granted, by its own word.
    pub(super) granted: Vec<Granted>,
    grants: Option<Grants>,
    // Declared last: all else in it goes first.
    directory: SwarmDirectory,
}

/// How the processes of a swarm run. Only waiting is said by a [`Wait`] alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Conduct {
    /// How they wait.
    pub wait: Wait,
    /// Ticks a second of a swarm in real time; `None` for lockstep, where everybody waits for everybody.
    pub rate: Option<f64>,
    /// What each asks the kernel for: the agents before they are ready, this process after that. It keeps what it is
    /// granted.
    pub scheduling: Scheduling,
    /// How long each may take for what.
    pub deadlines: Deadlines,
    /// What to do when an agent dies or hangs. A policy [in training](PolicySource::Training) needs all its agents: there
    /// it is always [`OnFailure::Abort`].
    pub on_failure: OnFailure,
    /// The program to run for an agent; `None` for this very program, which must have called
    /// [`run_if_agent`](crate::run_if_agent).
    pub command: Option<AgentCommand>,
    /// Other programs to run for some agents, by index: in any language, as `docs/protocol.md` says.
    pub others: Vec<(usize, AgentCommand)>,
}

impl From<Wait> for Conduct {
    fn from(wait: Wait) -> Conduct {
        Conduct { wait, ..Conduct::default() }
    }
}

impl Processes {
    /// Starts one process per agent, with the `policy` that `settings` name, and waits until all are ready. Only
    /// a policy [in training](PolicySource::Training) can be renewed.
    pub fn start(
        settings: &AgentSettings,
        policy: &Policy,
        conduct: impl Into<Conduct>,
    ) -> Result<Processes> {
        Processes::start_also(Box::new(Nowhere), settings, policy, conduct.into())
    }

    /// The same, with some agents elsewhere.
    pub(crate) fn start_also(
        elsewhere: Box<dyn Elsewhere>,
        settings: &AgentSettings,
        policy: &Policy,
        mut conduct: Conduct,
    ) -> Result<Processes> {
        let command = conduct.command.take().map_or_else(AgentCommand::this_program, Ok)?;
        let (spec, layout) = (settings.spec.clone(), settings.layout());
        let team = spec.n_agents();
        let directory = SwarmDirectory::create()?;
        let trains = settings.policy == PolicySource::Training;
        if trains {
            conduct.on_failure = OnFailure::Abort;
        }
        let others = std::mem::take(&mut conduct.others);
        check_others(&others, team)?;
        let readers = [!others.is_empty(), elsewhere.agents() != 0];
        let settings = share_weights(settings, policy, &directory, readers)?;
        let address = SwarmAddress {
            tag: directory.tag().to_owned(),
            agents: team,
            worlds: settings.worlds,
            weights: if trains { policy.n_values() } else { 0 },
            real_time: conduct.rate.is_some(),
            longest_delay: settings.longest_delay,
        };
        reserve_shared_memory(&directory, &address, &layout)?;
        allow_open_files(team)?;
        check_tasks(team)?;
        let mut swarm = Processes {
            spec,
            agents: Children::new(command, waker(&address))?.with_others(others),
            elsewhere,
            port: SupervisorPort::create(&address, &layout)?,
            identity: Header { protocol: PROTOCOL, swarm: address.id(), ..Header::default() },
            layout,
            draws: ActionDraws::of(&settings),
            speakers: Speakers::new(team),
            longest_delay: settings.longest_delay,
            chronicle: layout
                .relay
                .then(|| Chronicle::new(team * settings.worlds * layout.observation, settings.longest_age())),
            policy_weights: policy.n_values(),
            // Until all are ready, nobody may be lost.
            roster: Roster::new(team, OnFailure::Abort),
            tick: 0,
            clock: conduct.rate.map(|rate| Clock::new(rate, team)),
            conduct,
            settings,
            address,
            answered: 0,
            granted: vec![Granted::default(); team],
            grants: None,
            directory,
        };
        swarm.elsewhere.prepare(&swarm.process_settings(0))?;
        for agent in 0..team {
            swarm.agents.leave_out();
            swarm.start_agent(agent)?;
        }
        let ready = swarm.conduct.deadlines.ready;
        let silent = swarm.await_answers(Instant::now() + ready, |swarm| {
            if let Some((agent, how)) = swarm.take_dead()?.into_iter().next() {
                return Err(Error::Lost { names: vec![name_of(agent)], how });
            }
            swarm.take_ready()
        })?;
        if silent != 0 {
            let names = members_of(silent).map(name_of).collect();
            return Err(Error::Lost { names, how: format!("did not get ready within {ready:?}") });
        }
        swarm.roster.set_on_failure(swarm.conduct.on_failure);
        swarm.directory.take_pages()?;
        if swarm.clock.is_some() {
            wake_on_time();
        }
        // Counted before this process is pinned, which it is last, since the agents would inherit it.
        let (cores, scheduling) = (allowed_cores().len(), swarm.conduct.scheduling);
        let granted = [&[scheduling.apply(0)], swarm.granted.as_slice()].concat();
        swarm.grants = Grants::count(&scheduling, cores, &granted);
        Ok(swarm)
    }

    /// Starts an agent, for the first time or anew, where it is to run.
    pub(super) fn start_agent(&mut self, agent: usize) -> Result<()> {
        if self.elsewhere.agents() >> agent & 1 == 1 {
            self.elsewhere.start(agent, self.roster.incarnation(agent));
            return Ok(());
        }
        let settings = self.process_settings(agent);
        let nothing = [Stdio::null(), Stdio::null()];
        self.agents.start_anew(agent, &name_of(agent), "agent", &settings, nothing)
    }

    /// The agents whose processes have ended, and how.
    pub(super) fn take_dead(&mut self) -> Result<Vec<(usize, String)>> {
        let here = self.agents.take_dead()?.into_iter().map(|(agent, _, how)| (agent, how));
        Ok(here.chain(self.elsewhere.take_dead()).collect())
    }

    /// Ends an agent, if it is not gone already.
    pub(super) fn end(&mut self, agent: usize) {
        self.agents.end(agent);
        self.elsewhere.end(agent);
    }

    /// Sends an agent a signal, if it is not gone.
    pub(super) fn signal(&mut self, agent: usize, signal: Signal) {
        self.agents.signal(agent, signal);
        self.elsewhere.signal(agent, signal);
    }

    fn process_settings(&self, agent: usize) -> ProcessSettings {
        ProcessSettings {
            address: self.address.clone(),
            agent,
            incarnation: self.roster.incarnation(agent),
            wait: self.conduct.wait,
            // Peers that gave up first would decide without somebody who is only slow.
            peers: self.conduct.deadlines.peers.max(2 * self.conduct.deadlines.answer),
            carried: self.elsewhere.agents() != 0,
            scheduling: self.conduct.scheduling,
            supervisor: std::process::id() as i32,
            settings: self.settings.clone(),
            wire: self.address.wire(&self.layout),
        }
    }

    /// The process ids of the agents.
    pub fn process_ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.agents.ids()
    }

    /// Where the swarm is on this machine.
    #[cfg(feature = "view")]
    pub(crate) fn directory(&self) -> &SwarmDirectory {
        &self.directory
    }

    /// How well a swarm in real time keeps to its clock; `None` in lockstep.
    pub fn punctuality(&self) -> Option<&Punctuality> {
        self.clock.as_ref().map(|clock| &clock.punctuality)
    }

    /// What the processes were granted; `None` if they asked for nothing.
    pub fn grants(&self) -> Option<&Grants> {
        self.grants.as_ref()
    }

    /// What there is to say of the other machines it runs on.
    pub fn hosts(&self) -> Vec<HostReport> {
        self.elsewhere.report()
    }

    /// What befell the agents.
    pub fn faults(&self) -> &Faults {
        &self.roster.faults
    }

    /// Everybody waits for everybody.
    fn tick_in_lockstep(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        let (began, answer) = (Instant::now(), self.conduct.deadlines.answer);
        self.send_sensors(tick, 0, false)?;
        // Who is lost by then leaves the others time to decide without it.
        let publish = answer * 4 / 5;
        self.await_present("publish an observation", tick, (began, publish), |swarm| {
            swarm.take_observations(tick, decisions)
        })?;
        self.wake_agents()?;
        self.await_present("decide", tick, (began, answer), |swarm| {
            swarm.take_decisions(tick, decisions, u64::MAX)
        })?;
        decisions.anew = self.roster.anew() & self.answered & !self.roster.absent();
        self.roster.answered(self.answered);
        decisions.leave_out(self.roster.absent());
        decisions.check_nobody_late(tick)
    }

    /// Nobody waits for anybody: agents decide at the deadline, and when the period ends what has been decided is done.
    fn tick_in_real_time(&mut self, tick: &Tick, decisions: &mut Decisions, period: Period) -> Result<()> {
        self.wait_for_moment(period.begins_ns)?;
        self.send_sensors(tick, period.deadline_ns, false)?;
        self.wait_for_moment(period.ends_ns)?;
        if tick.step == 0 {
            decisions.actions.fill(0);
        }
        self.take_observations(tick, decisions)?;
        // What is counted are decisions.
        self.answered = 0;
        self.take_decisions(tick, decisions, period.ends_ns)?;
        self.lose_dead()?;
        decisions.anew = self.roster.anew() & self.answered & !self.roster.absent();
        self.roster.answered(self.answered);
        self.lose_silent(&period)?;
        decisions.absent = self.roster.absent() | tick.absent;
        decisions.missing = decisions.absent | self.everybody() & !self.answered;
        let clock = self.clock.as_mut().expect("a swarm in real time has a clock");
        let punctuality = &mut clock.punctuality;
        for (agent, times) in decisions.times.iter().enumerate() {
            match decisions.missing >> agent & 1 {
                0 => punctuality.acts.record(times.decided_ns.saturating_sub(period.deadline_ns)),
                _ => punctuality.missed[agent] += 1 & !(decisions.absent >> agent),
            }
        }
        Ok(())
    }

    /// Waits for a moment of the clock, and for nobody. What agents tell those on other machines is carried meanwhile.
    fn wait_for_moment(&mut self, moment_ns: u64) -> Result<()> {
        let are_elsewhere = self.elsewhere.agents() != 0;
        if are_elsewhere {
            // Also where no time is left for that: else nothing of theirs would ever be taken.
            self.carry()?;
        }
        while now_ns() < moment_ns {
            if are_elsewhere {
                self.port.sleep_until(moment_ns)?;
                self.carry()?;
            } else {
                wait_for_moment(self.conduct.wait, moment_ns);
            }
            signals::check_stop()?;
            self.take_back()?;
        }
        Ok(())
    }

    /// Carries what has been said on other machines, and what has been said here.
    fn carry(&mut self) -> Result<()> {
        self.elsewhere.bring()?;
        self.elsewhere.send()
    }

    /// Sends all that are there their sensor messages, for the first time at this tick or `again`.
    pub(super) fn send_sensors(&mut self, tick: &Tick, deadline_ns: u64, again: bool) -> Result<()> {
        let words = self.layout.sensor_words(tick.worlds);
        let absent = self.roster.absent();
        for agent in members_of(self.roster.present()) {
            let header = Header { deadline_ns, absent, incarnation: again.into(), ..tick.header(words) };
            let header = self.header(Kind::Sensor, agent, header);
            let write = |words: &mut [u32]| tick.write(agent, &self.layout, &self.draws, words);
            self.port.send_sensor(agent, header, write)?;
        }
        self.wake_agents()
    }

    fn header(&self, kind: Kind, agent: usize, rest: Header) -> Header {
        let Header { protocol, swarm, weights, .. } = self.identity;
        Header { protocol, swarm, weights, kind: kind as u32, sender: agent as u32, ..rest }
    }

    fn wake_agents(&mut self) -> Result<()> {
        self.elsewhere.send()?;
        match self.conduct.wait {
            Wait::Block => self.port.wake_agents(),
            Wait::Spin => Ok(()),
        }
    }

    /// Waits until `take` has seen the answer of every agent that is there, or the deadline passes. Returns the agents that are
    /// there but have not answered, bit by bit.
    pub(super) fn await_answers(
        &mut self,
        deadline: Instant,
        mut take: impl FnMut(&mut Processes) -> Result<()>,
    ) -> Result<u64> {
        self.answered = 0;
        self.wait(deadline, |swarm| {
            take(swarm)?;
            Ok(swarm.roster.present() & !swarm.answered == 0)
        })?;
        Ok(self.roster.present() & !self.answered)
    }

    /// Waits until `ready` holds or the deadline passes; true if it held.
    pub(super) fn wait(
        &mut self,
        deadline: Instant,
        mut ready: impl FnMut(&mut Processes) -> Result<bool>,
    ) -> Result<bool> {
        let wait = self.conduct.wait;
        let sleep = |swarm: &Processes, longest| swarm.port.sleep(longest);
        wait_until(self, wait, deadline, sleep, |swarm| {
            signals::check_stop()?;
            swarm.elsewhere.bring()?;
            ready(swarm)
        })
    }

    /// All agents, bit by bit.
    pub(super) fn everybody(&self) -> u64 {
        u64::MAX >> (u64::BITS - self.agents.len() as u32)
    }
}

impl Team for Processes {
    fn muster(&mut self, orders: &[Order]) -> Result<u64> {
        self.carry_out(orders)?;
        self.take_back()?;
        if self.roster.is_deserted() {
            return Err(failed!("no agent is left, and none is to be restarted; see --on-failure restart"));
        }
        Ok(self.roster.absent())
    }

    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        decisions.resize(self.agents.len(), tick.worlds, &self.layout);
        self.tick = tick.tick;
        self.draws.draw(tick);
        self.chronicle.iter_mut().for_each(|chronicle| chronicle.note(tick));
        match self.clock.as_mut().map(Clock::begin_period) {
            None => self.tick_in_lockstep(tick, decisions),
            Some(period) => self.tick_in_real_time(tick, decisions, period),
        }
    }

    fn longest_delay(&self) -> u8 {
        self.longest_delay
    }

    fn relays(&self) -> bool {
        self.layout.relay
    }

    fn renew(&mut self, weights: &[f32]) -> Result<()> {
        check_weights(self.policy_weights, weights)?;
        let next = self.identity.weights + 1;
        let header = Header {
            kind: Kind::Weights as u32,
            weights: next,
            length: weights.len() as u64,
            sent_ns: now_ns(),
            ..self.identity
        };
        // Nobody is woken: the agents look when the message of an episode's first step tells them to.
        self.port.publish_weights(header, |words| words.copy_from_slice(bytemuck::cast_slice(weights)))?;
        self.identity.weights = next;
        Ok(())
    }
}

impl Drop for Processes {
    fn drop(&mut self) {
        for agent in 0..self.agents.len() {
            self.signal(agent, Signal::CONT);
            let header = self.header(Kind::Shutdown, agent, Header::default());
            // An agent that cannot be told is ended.
            let _ = self.port.send_sensor(agent, header, |_| {});
        }
        // Whatever the conduct says of waking.
        let _ = (self.elsewhere.send(), self.port.wake_agents());
        self.agents.reap(self.conduct.deadlines.leave);
        self.elsewhere.reap(self.conduct.deadlines.leave);
    }
}

/// An error unless these are commands for agents of such a team, one each.
fn check_others(others: &[(usize, AgentCommand)], team: usize) -> Result<()> {
    for (at, (agent, _)) in others.iter().enumerate() {
        if *agent >= team {
            return Err(usage!(
                "there is no agent {agent} to replace: this team has agents 0 to {}",
                team - 1
            ));
        }
        if others[..at].iter().any(|(other, _)| other == agent) {
            return Err(usage!("two commands for agent {agent}; give one"));
        }
    }
    Ok(())
}

/// What wakes the supervisor of a swarm when one of its agents has ended. A wake-up that fails is one that is late.
pub(super) fn waker(address: &SwarmAddress) -> impl FnMut() + Send + 'static {
    let address = address.clone();
    move || drop(wake_supervisor(&address))
}

pub(super) fn name_of(agent: usize) -> String {
    format!("agent-{agent}")
}
