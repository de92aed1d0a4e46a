//! A tick with nothing in it: the pattern of a swarm's tick over plain iceoryx2, by agents without networks.

use std::process::Stdio;
use std::time::{Duration, Instant};

use super::peer::{BareAgent, LEAVE_DEADLINE, PeerSettings, Role, await_state};
use super::pin::Pinned;
use super::plain::{Listener, Notifier, PlainNode, Publisher, Subscriber};
use crate::base::error::Result;
use crate::bus::{SwarmDirectory, Wait};
use crate::supervisor::{AgentCommand, Children, signals};

/// A supervisor and its agents. A tick is: each agent's sensor out, everybody's observation in, all woken, everybody's
/// action in.
pub struct BareTeam {
    ports: SupervisorPorts,
    agents: Children,
    wait: Wait,
    tick: u64,
    // Declared last: all else in it goes first.
    _directory: SwarmDirectory,
}

struct SupervisorPorts {
    sensors: Vec<Publisher>,
    observations: Subscriber,
    actions: Subscriber,
    wake_agents: Notifier,
    woken: Listener,
    /// Agents that have done what the phase waits for, bit by bit.
    answered: u64,
    _node: PlainNode,
}

struct AgentPorts {
    sensor: Subscriber,
    observation: Publisher,
    observations: Subscriber,
    action: Publisher,
    wake_supervisor: Notifier,
    woken: Listener,
    /// The tick of the last sensor message.
    tick: u64,
    /// Agents whose observations of this tick are in, bit by bit.
    seen: u64,
    _node: PlainNode,
}

/// Bytes of an action: tick and agent. Every message begins with these two words.
const ACTION: usize = 16;

/// The tick that tells agents to leave; the first one is 1, and agents begin by acting in tick 0.
const LEAVE: u64 = u64::MAX;

impl BareTeam {
    /// Starts the agents, whose sensor messages and observations have `payload` bytes, 64 or more.
    pub fn start(agents: usize, payload: usize, wait: Wait) -> Result<BareTeam> {
        let directory = SwarmDirectory::create()?;
        let ports = SupervisorPorts::new(directory.tag(), agents, payload)?;
        let mut team = BareTeam {
            ports,
            agents: Children::new(AgentCommand::this_program()?, || ())?,
            wait,
            tick: 0,
            _directory: directory,
        };
        for agent in 0..agents {
            let tag = team._directory.tag().to_owned();
            let settings = PeerSettings::new(wait, Role::Bare(BareAgent { tag, agent, agents, payload }));
            let (name, stdio) = (format!("agent-{agent}"), [Stdio::null(), Stdio::null()]);
            team.agents.start(&name, "peer", &settings, stdio)?;
        }
        team.await_all(SupervisorPorts::take_actions)?;
        Ok(team)
    }

    /// One tick; how long it took.
    pub fn tick(&mut self) -> Result<Duration> {
        signals::check_stop()?;
        self.tick += 1;
        let began = Instant::now();
        self.send_sensors(self.tick)?;
        self.await_all(SupervisorPorts::take_observations)?;
        self.wake_agents()?;
        self.await_all(SupervisorPorts::take_actions)?;
        Ok(began.elapsed())
    }

    /// Ticks for so long, at least ten times, after a tenth of it to warm up, and tells `each` how long those after
    /// that took. Each process has a core of its own where there are enough.
    pub fn play(&mut self, longest: Duration, mut each: impl FnMut(Duration)) -> Result<()> {
        let processes: Vec<u32> = self.agents.ids().collect();
        let _pinned = Pinned::new(&processes);
        super::repeat(longest, |counts| {
            let elapsed = self.tick()?;
            if counts {
                each(elapsed);
            }
            Ok(())
        })
    }

    fn send_sensors(&self, tick: u64) -> Result<()> {
        for (agent, sensor) in self.ports.sensors.iter().enumerate() {
            sensor.send(|bytes| {
                bytes[ACTION..].fill(tick as u8);
                write(bytes, tick, agent);
            })?;
        }
        self.wake_agents()
    }

    fn wake_agents(&self) -> Result<()> {
        match self.wait {
            Wait::Block => self.ports.wake_agents.wake(),
            Wait::Spin => Ok(()),
        }
    }

    fn await_all(&mut self, take: impl Fn(&mut SupervisorPorts, u64) -> Result<()>) -> Result<()> {
        let (tick, all) = (self.tick, u64::MAX >> (u64::BITS - self.agents.len() as u32));
        let agents = &mut self.agents;
        self.ports.answered = 0;
        await_state(
            &mut self.ports,
            self.wait,
            |ports, longest| ports.woken.sleep(longest),
            |ports| {
                take(ports, tick)?;
                Ok(ports.answered == all)
            },
            |_| {
                agents.check_alive()?;
                signals::check_stop()
            },
        )
    }
}

impl Drop for BareTeam {
    fn drop(&mut self) {
        // An agent that cannot be told is ended.
        let _ = self.send_sensors(LEAVE);
        self.agents.reap(LEAVE_DEADLINE);
    }
}

impl SupervisorPorts {
    fn new(tag: &str, agents: usize, payload: usize) -> Result<SupervisorPorts> {
        let node = PlainNode::new(tag)?;
        let sensor = |agent| node.publisher(&format!("sensor-{agent}"), 1, 1, payload);
        Ok(SupervisorPorts {
            sensors: (0..agents).map(sensor).collect::<Result<_>>()?,
            observations: node.subscriber("observations", agents, agents + 1)?,
            actions: node.subscriber("actions", agents, 1)?,
            wake_agents: node.notifier("agents", 1, agents)?,
            woken: node.listener("supervisor", agents, 1)?,
            answered: 0,
            _node: node,
        })
    }

    fn take_observations(&mut self, tick: u64) -> Result<()> {
        take(&self.observations, tick, &mut self.answered)
    }

    fn take_actions(&mut self, tick: u64) -> Result<()> {
        take(&self.actions, tick, &mut self.answered)
    }
}

/// Ticks as an agent until it is told to leave.
pub(super) fn tick(agent: &BareAgent, wait: Wait) -> Result<()> {
    let BareAgent { ref tag, agent, agents, payload } = *agent;
    let mut ports = AgentPorts::new(tag, agent, agents, payload)?;
    let all = u64::MAX >> (u64::BITS - agents as u32);
    ports.act(agent, wait)?;
    loop {
        let sensed = |ports: &mut AgentPorts| ports.sense_and_publish(agent);
        await_state(&mut ports, wait, AgentPorts::sleep, sensed, |_| Ok(()))?;
        if ports.tick == LEAVE {
            return Ok(());
        }
        ports.wake(wait)?;
        let complete = |ports: &mut AgentPorts| {
            take(&ports.observations, ports.tick, &mut ports.seen)?;
            Ok(ports.seen == all)
        };
        await_state(&mut ports, wait, AgentPorts::sleep, complete, |_| Ok(()))?;
        ports.act(agent, wait)?;
    }
}

impl AgentPorts {
    fn new(tag: &str, agent: usize, agents: usize, payload: usize) -> Result<AgentPorts> {
        let node = PlainNode::new(tag)?;
        Ok(AgentPorts {
            sensor: node.subscriber(&format!("sensor-{agent}"), 1, 1)?,
            observation: node.publisher("observations", agents, agents + 1, payload)?,
            observations: node.subscriber("observations", agents, agents + 1)?,
            action: node.publisher("actions", agents, 1, ACTION)?,
            wake_supervisor: node.notifier("supervisor", agents, 1)?,
            woken: node.listener("agents", 1, agents)?,
            tick: 0,
            seen: 0,
            _node: node,
        })
    }

    /// Publishes what the sensor says, if its message is there; whether it was.
    fn sense_and_publish(&mut self, agent: usize) -> Result<bool> {
        let mut published = Ok(());
        let there = self.sensor.receive(|sensed| {
            (self.tick, _) = read(sensed);
            if self.tick != LEAVE {
                published = self.observation.send(|bytes| {
                    bytes.copy_from_slice(sensed);
                    write(bytes, self.tick, agent);
                });
            }
        })?;
        self.seen = 0;
        published.map(|()| there)
    }

    fn act(&mut self, agent: usize, wait: Wait) -> Result<()> {
        self.action.send(|bytes| write(bytes, self.tick, agent))?;
        self.wake(wait)
    }

    fn sleep(&self, longest: Duration) -> Result<()> {
        self.woken.sleep(longest)
    }

    fn wake(&self, wait: Wait) -> Result<()> {
        match wait {
            Wait::Block => self.wake_supervisor.wake(),
            Wait::Spin => Ok(()),
        }
    }
}

/// Takes in all messages there are, and marks the senders of those of this tick.
fn take(from: &Subscriber, tick: u64, senders: &mut u64) -> Result<()> {
    let mut note = |bytes: &[u8]| {
        let (of, sender) = read(bytes);
        if of == tick {
            *senders |= 1 << sender;
        }
    };
    while from.receive(&mut note)? {}
    Ok(())
}

fn write(bytes: &mut [u8], tick: u64, agent: usize) {
    bytes[..8].copy_from_slice(&tick.to_ne_bytes());
    bytes[8..ACTION].copy_from_slice(&(agent as u64).to_ne_bytes());
}

fn read(bytes: &[u8]) -> (u64, u64) {
    let word = |at: usize| u64::from_ne_bytes(bytes[at..at + 8].try_into().expect("a word has 8 bytes"));
    (word(0), word(8))
}
