//! Some agents of a swarm on this machine, whose supervisor is elsewhere: started, watched and reaped as it says.

use std::process::Stdio;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, bounded};
use rustix::process::Signal;

use super::engine::{End, Engine, Heard, Line};
use super::frame::Shape;
use super::orders::{Event, Invitation, LARGEST_POLICY, Order, bit_among, is_secret, say, understand};
use super::outgoing::Outgoing;
use super::tally::Tally;
use crate::agent::PolicySource;
use crate::agent::process::ProcessSettings;
use crate::base::error::Result;
use crate::base::file::AtomicFile;
use crate::base::hash::fnv1a;
use crate::base::scheduling::Scheduling;
use crate::bus::{
    Bell, Header, Kind, PROTOCOL, Sample, SupervisorPort, SwarmDirectory, Voices, Wait, now_ns, wake_on_time,
};
use crate::failed;
use crate::supervisor::{
    AgentCommand, Children, Deadlines, allow_open_files, check_tasks, members_of, reserve_shared_memory,
    signals,
};

/// Lines of agents that wait to be sent. More are not sent: whoever says so much says the same again.
const MOST_LINES: usize = 256;

/// The longest this sleeps before it looks again.
const LONGEST_SLEEP: Duration = Duration::from_millis(100);

/// What looks after the agents here: on the bus of this machine it is their supervisor, and stands in for all other agents.
pub(super) struct Steward {
    line: Line,
    /// How long the supervisor may take to be there after it has asked.
    arrival: Duration,
    shape: Shape,
    /// The settings of any agent here.
    example: ProcessSettings,
    /// The agents that run here, bit by bit.
    pub(super) own: u64,
    /// Those that have been started and have not ended.
    running: u64,
    /// Those that have not been ready yet.
    unready: u64,
    /// How often each had been started before.
    incarnations: Vec<u32>,
    out: Outgoing,
    /// Of observations that come from elsewhere.
    tally: Tally,
    /// What agents say on stderr.
    said: Receiver<(usize, String)>,
    children: Children,
    /// Of the agents elsewhere. `None` if all run here: then there is no room.
    voices: Option<Voices>,
    port: SupervisorPort,
    // Declared last: all else in it goes first.
    directory: SwarmDirectory,
}

impl Steward {
    /// Makes room for the agents, and opens the line.
    pub(super) fn join(engine: &Engine, invitation: &Invitation, policy: &[u8]) -> Result<Steward> {
        let Invitation { example, agents: own, policy: hash, network_is_link, line } = invitation;
        example.check()?;
        let (team, layout) = (example.address.agents, example.settings.layout());
        let everybody = u64::MAX >> (u64::BITS as usize - team);
        let is_one = *own != 0 && own & !everybody == 0 && example.address.weights == 0 && is_secret(line);
        if !is_one {
            return Err(failed!("this is no swarm that a host can be part of"));
        }
        if policy.len() as u64 > LARGEST_POLICY {
            return Err(failed!("the policy has {} bytes, and {LARGEST_POLICY} are the most", policy.len()));
        }
        if fnv1a(policy.iter().copied()) != *hash {
            return Err(failed!("the policy did not arrive whole ({} bytes); try again", policy.len()));
        }
        let directory = SwarmDirectory::create()?;
        let path = directory.path().join("policy.safetensors");
        AtomicFile::write(&path, policy)?;
        let mut example = example.clone();
        example.address.tag = directory.tag().to_owned();
        example.settings.policy = PolicySource::Copy(path);
        example.supervisor = std::process::id() as i32;
        example.wait = Wait::Block;
        example.carried = true;
        // Which cores and priorities there are here is not for others to say.
        example.scheduling = Scheduling::default();
        example.wire = example.address.wire(&layout);
        let address = &example.address;
        if address.real_time {
            wake_on_time();
        }
        reserve_shared_memory(&directory, address, &layout)?;
        allow_open_files(team)?;
        check_tasks(own.count_ones() as usize)?;
        let port = SupervisorPort::create(address, &layout)?;
        let bell = Arc::new(Bell::of(address)?);
        let (say, said) = bounded(MOST_LINES);
        let ring = bell.clone();
        let mut children = Children::new(AgentCommand::this_program()?, move || ring.ring())?.heard_by(say);
        (0..team).for_each(|_| children.leave_out());
        let others = everybody & !own;
        Ok(Steward {
            line: engine.line(line, End::Host, move || bell.ring())?,
            arrival: engine.patience.arrival(),
            shape: Shape { layout, worlds: example.settings.worlds },
            own: *own,
            running: 0,
            unready: *own,
            incarnations: vec![0; team],
            out: Outgoing::new(address.real_time, *network_is_link),
            tally: Tally::default(),
            said,
            children,
            voices: (others != 0).then(|| Voices::open(address, &layout, others)).transpose()?,
            port,
            directory,
            example,
        })
    }

    /// Looks after them until the supervisor wants no more of it.
    pub(super) fn run(&mut self) -> Result<()> {
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
                    Heard::Words(words, heard_ns) => match understand(&words)? {
                        Order::Leave => return Ok(()),
                        Order::Start { agent, incarnation } => self.start(agent, incarnation)?,
                        Order::Signal { agent, signal } => self.signal(agent, signal)?,
                        Order::End { agent } => self.end(agent)?,
                        Order::Tell { asked_ns } => {
                            let (said_ns, tally) = (now_ns(), self.tally);
                            self.line.say(say(&Event::Told { asked_ns, heard_ns, said_ns, tally }));
                        }
                    },
                }
            }
            if !has_come && began.elapsed() > self.arrival {
                return Err(failed!("the supervisor did not come"));
            }
            if wakes {
                self.port.wake_agents()?;
            }
            self.take_answers()?;
            self.take_dead()?;
            self.send_due()?;
            let longest = self.out.longest_wait().unwrap_or(LONGEST_SLEEP);
            self.port.sleep_until(now_ns() + longest.as_nanos() as u64)?;
        }
    }

    /// Puts on the bus what the supervisor and the agents elsewhere have sent.
    fn take_frame(&mut self, bytes: &[u8]) -> Result<()> {
        let Steward { port, voices, out, own, tally, .. } = self;
        let (shape, swarm, now_ns) = (self.shape, self.example.address.id(), now_ns());
        let everybody = u64::MAX >> (u64::BITS as usize - shape.layout.agents);
        let numbers = shape.each(bytes, |header, words| {
            let (agent, bit) = (header.sender as usize, 1 << header.sender);
            let header = Header { swarm, ..header };
            let copy = |to: &mut [u32]| bytemuck::cast_slice_mut(to).copy_from_slice(words);
            match header.kind {
                kind if kind == Kind::Observation as u32 && *own & bit == 0 => {
                    tally.note_time(now_ns, header.deadline_ns);
                    voices.as_ref().map_or(Ok(()), |voices| voices.publish_observation(header, copy))
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
        })?;
        tally.note(&numbers);
        Ok(())
    }

    /// The bit of an agent that the supervisor names.
    fn bit_of(&self, agent: usize) -> Result<u64> {
        bit_among(self.own, agent)
            .ok_or_else(|| failed!("the supervisor gave an order for agent-{agent}, which is not here"))
    }

    fn start(&mut self, agent: usize, incarnation: u32) -> Result<()> {
        let bit = self.bit_of(agent)?;
        self.incarnations[agent] = incarnation;
        let settings = ProcessSettings { agent, incarnation, ..self.example.clone() };
        let (name, nothing) = (format!("agent-{agent}"), [Stdio::null(), Stdio::null()]);
        match self.children.start_anew(agent, &name, "agent", &settings, nothing) {
            Ok(()) => self.running |= bit,
            Err(e) => self.line.say(say(&Event::Ended { agent, incarnation, how: e.to_string() })),
        }
        Ok(())
    }

    fn signal(&mut self, agent: usize, signal: i32) -> Result<()> {
        self.bit_of(agent)?;
        let signal = Signal::from_named_raw(signal)
            .ok_or_else(|| failed!("the supervisor sent agent-{agent} signal {signal}, which is none"))?;
        self.children.signal(agent, signal);
        Ok(())
    }

    fn end(&mut self, agent: usize) -> Result<()> {
        self.running &= !self.bit_of(agent)?;
        self.children.end(agent);
        Ok(())
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
                let is_last = self.unready == bit;
                self.unready &= !bit;
                if is_last {
                    // All segments are there. One that is started anew finds its own.
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
        if !self.out.take_due(self.running) {
            return Ok(());
        }
        self.out.outbox.send(Some(&self.line));
        if self.out.must_wake(self.running) {
            // Nothing comes from elsewhere that would wake them.
            self.port.wake_agents()?;
        }
        Ok(())
    }

    /// Ends all agents. Nothing of the swarm is left then, but for the line.
    pub(super) fn leave(mut self) -> Line {
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

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::super::orders::secret;
    use super::super::patience::Patience;
    use super::*;
    use crate::agent::AgentSettings;
    use crate::bus::SwarmAddress;
    use crate::environment::Task;

    #[test]
    fn a_policy_that_does_not_arrive_whole_is_refused() {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let engine = Engine::listen(&format!("tcp/127.0.0.1:{port}"), None, Patience::default()).unwrap();
        let settings = AgentSettings::of(Task::parse("hear-see").unwrap().spec());
        let address = SwarmAddress { agents: 2, ..SwarmAddress::of("0123abcd") };
        let example = ProcessSettings {
            wire: address.wire(&settings.layout()),
            address,
            agent: 0,
            incarnation: 0,
            wait: Wait::Block,
            peers: Duration::from_secs(1),
            carried: false,
            scheduling: Scheduling::default(),
            supervisor: 1,
            settings,
        };
        let line = secret().unwrap();
        let invitation =
            Invitation { example, agents: 0b01, policy: fnv1a(*b"policy"), network_is_link: false, line };
        let refused = |invitation: &Invitation, policy: &[u8]| {
            Steward::join(&engine, invitation, policy).err().expect("it is refused").to_string()
        };
        assert!(refused(&invitation, b"polic").contains("did not arrive whole (5 bytes)"));
        let nobody = Invitation { agents: 0b100, ..invitation.clone() };
        assert!(refused(&nobody, b"policy").contains("no swarm"));
        let overheard = Invitation { line: "**".to_owned(), ..invitation };
        assert!(refused(&overheard, b"policy").contains("no swarm"));
    }
}
