//! The supervisor's side: hosts, and the agents that run there.

use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use super::engine::{Heard, Line};
use super::frame::Shape;
use super::host::{Host, translated};
use super::orders::{LARGEST_POLICY, Order, understand};
use super::plan::Plan;
use crate::agent::PolicySource;
use crate::agent::process::ProcessSettings;
use crate::base::error::{Error, Result};
use crate::base::regular;
use crate::bus::{Bell, Header, Kind, Layout, Sample, StandIns, now_ns};
use crate::failed;
use crate::supervisor::{Elsewhere, HostReport, members_of, say as say_aloud};

/// How much longer a host may take to leave than its agents.
const LONGEST_FAREWELL: Duration = Duration::from_secs(10);

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

impl Hosts {
    /// Connects to all hosts of a plan, for a team of so many. Whether the network is the link: then it may lose
    /// observations.
    ///
    /// # Errors
    /// `Lost` if a host cannot be reached, refuses the key or does not answer; `Failed` if it is of another version.
    pub(crate) fn connect(plan: &Plan, team: usize, network_is_link: bool) -> Result<Hosts> {
        let (key, places) = (plan.key()?, plan.place(team)?);
        // A host without agents has nothing to do.
        let places = plan.hosts.iter().zip(places).filter(|(_, agents)| *agents != 0);
        let hosts = at_once(places, |(planned, agents)| {
            Host::connect(planned, key.as_ref(), plan.patience, agents, network_is_link)
        })?;
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

impl Presence {
    /// Puts messages of a host on the bus, with their times by our clock.
    fn bring(&self, bytes: &[u8], host: &mut Host) -> Result<()> {
        let Host { running, agents, clock, tallies: [tally, _], .. } = host;
        let (running, agents, clock, now_ns) = (*running, *agents, clock.estimate(), now_ns());
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
        at_once(self.hosts.iter_mut(), |host| host.join(example, &policy, &bell))?;
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
            if host.clock.is_due(now) {
                host.ask_time();
            }
        }
        Ok(())
    }

    fn report(&self) -> Vec<HostReport> {
        let of = |host: &Host| {
            let clock = host.clock.estimate_now();
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
                clock_jumps: host.clock.jumps(),
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

impl fmt::Debug for Hosts {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_list().entries(self.hosts.iter().map(|host| &host.name)).finish()
    }
}

/// Does something with all of these at a time, each in a thread of its own: they wait for machines that may be far away. The
/// first error counts, when all have ended.
fn at_once<T: Send, R: Send>(
    all: impl Iterator<Item = T>,
    act: impl Fn(T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let act = &act;
    thread::scope(|scope| {
        let start = |one| thread::Builder::new().spawn_scoped(scope, move || act(one));
        let threads = all.map(start).collect::<io::Result<Vec<_>>>();
        let threads = threads.map_err(|e| failed!("no thread can be started: {e}"))?;
        let wait = |thread: thread::ScopedJoinHandle<_>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        threads.into_iter().map(wait).collect()
    })
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::super::engine::{Engine, Question};
    use super::super::orders::{Answer, Identity, say};
    use super::super::patience::Patience;
    use super::*;

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
        let answer = move |question: Question| {
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
