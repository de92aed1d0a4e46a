//! The ports over shared memory, one kind for the supervisor and one for an agent.
//!
//! Ports belong to the thread that created them: iceoryx2's `ipc` service is neither `Send` nor `Sync`.

use std::os::fd::BorrowedFd;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::{FileDescriptorBased, ipc};
use iceoryx2::service::Service;
use iceoryx2::service::header::payload_header::PayloadHeader;
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::Pid;
use rustix::time::Timespec;

use super::directory::keep_to_this_user;
use super::services::{
    Event, Role, Services, WordPublisher, WordSubscriber, bus_error, subscriber, weights_publisher,
};
use super::wait::LONGEST_SLEEP;
use super::{AgentPort, Header, Layout, Sample, SwarmAddress, now_ns};
use crate::base::error::Result;
use crate::failed;

/// A received message in shared memory. Holding it keeps its publisher from writing there again.
#[derive(Debug)]
pub struct SharedSample(iceoryx2::sample::Sample<ipc::Service, [u32], Header>);

impl SharedSample {
    /// The node that sent it, which has one process: its number, which no other node of the swarm ever has.
    pub(crate) fn node(&self) -> u128 {
        self.0.header().node_id().value()
    }

    /// The process of that node, dead or alive.
    pub(crate) fn process(&self) -> Option<Pid> {
        Pid::from_raw(self.0.header().node_id().pid::<ipc::Service>().ok()?.value())
    }
}

impl Sample for SharedSample {
    fn header(&self) -> &Header {
        self.0.user_header()
    }

    fn words(&self) -> &[u32] {
        self.0.payload()
    }
}

/// The supervisor's side of the bus. Creates all services; dropping it removes them.
#[derive(Debug)]
pub struct SupervisorPort {
    sensors: Vec<WordPublisher>,
    observations: WordSubscriber,
    decisions: WordSubscriber,
    weights: Option<WordPublisher>,
    wake_agents: Notifier<ipc::Service>,
    woken: Listener<ipc::Service>,
    // Declared last: ports go before the node they belong to.
    _node: Node<ipc::Service>,
}

impl SupervisorPort {
    /// Creates the services of the swarm at `address` and the supervisor's ports to them.
    pub fn create(address: &SwarmAddress, layout: &Layout) -> Result<SupervisorPort> {
        let node = address.node(Role::Supervisor)?;
        keep_to_this_user(&address.tag)?;
        let services = address.services(&node, Role::Supervisor)?;
        let sensor = |agent| {
            let service = address.sensor(&node, agent, Role::Supervisor)?;
            address.publisher(&service, layout.sensor_words(address.worlds))
        };
        Ok(SupervisorPort {
            sensors: (0..address.agents).map(sensor).collect::<Result<_>>()?,
            observations: subscriber(&services.observations)?,
            decisions: subscriber(&services.decisions)?,
            weights: services
                .weights
                .map(|service| weights_publisher(&service, address.weights))
                .transpose()?,
            wake_agents: notifier(&services.wake_agents)?,
            woken: listener(&services.wake_supervisor)?,
            _node: node,
        })
    }

    /// Sends a message to one agent.
    pub fn send_sensor(&self, agent: usize, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        publish(&self.sensors[agent], header, write)
    }

    /// The next observation that an agent has published to its peers.
    pub fn receive_observation(&self) -> Result<Option<SharedSample>> {
        receive(&self.observations)
    }

    /// The next decision.
    pub fn receive_decision(&self) -> Result<Option<SharedSample>> {
        receive(&self.decisions)
    }

    /// Sends new weights to all agents, which must have received the last ones.
    pub(crate) fn publish_weights(&self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let publisher = self.weights.as_ref();
        let publisher = publisher.ok_or_else(|| failed!("a swarm with a frozen policy takes no weights"))?;
        publish(publisher, header, write)
            .map_err(|e| failed!("cannot publish weights before all agents have taken the last ones: {e}"))
    }

    /// Wakes all agents.
    pub fn wake_agents(&self) -> Result<()> {
        self.wake_agents.notify().map(drop).map_err(bus_error("wake the agents"))
    }

    /// Sleeps until an agent wakes the supervisor, at most for `longest`.
    pub fn sleep(&self, longest: Duration) -> Result<()> {
        sleep(&self.woken, longest)
    }

    /// The same until a moment, in nanoseconds of the monotonic clock, and never for long. The kernel wakes whoever waits
    /// for a message only at its own ticks, which are milliseconds apart, but here on time.
    pub(crate) fn sleep_until(&self, moment_ns: u64) -> Result<()> {
        let left = Duration::from_nanos(moment_ns.saturating_sub(now_ns())).min(LONGEST_SLEEP);
        let left = Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
        // SAFETY: the listener keeps its file open, and stays where it is for as long as this takes.
        let woken = unsafe { BorrowedFd::borrow_raw(self.woken.file_descriptor().native_handle()) };
        // The only error there can be is that a signal came.
        let _ = poll(&mut [PollFd::new(&woken, PollFlags::IN)], Some(&left));
        self.woken.try_wait(|_| {}).map(drop).or_else(interrupted)
    }
}

/// Wakes the supervisor of the swarm at `address`, from a thread that has no port: by one that is made for that.
pub(crate) fn wake_supervisor(address: &SwarmAddress) -> Result<()> {
    let node = address.node(Role::Agent)?;
    let woken = notifier(&address.supervisors_event(&node, Role::Agent)?)?;
    woken.notify().map(drop).map_err(bus_error("wake the supervisor"))
}

/// An agent's side of the bus over shared memory. Opens what the supervisor has created.
#[derive(Debug)]
pub struct AgentSharedPort {
    sensor: WordSubscriber,
    observations_out: WordPublisher,
    observations_in: WordSubscriber,
    decisions: WordPublisher,
    weights: Option<WordSubscriber>,
    wake_supervisor: Notifier<ipc::Service>,
    woken: Listener<ipc::Service>,
    // Declared last: ports go before the node they belong to.
    _node: Node<ipc::Service>,
}

impl AgentSharedPort {
    /// Opens the ports of one agent of the swarm at `address`. One that takes the place of another first frees what the dead
    /// hold: their places in services, and their shared memory. They must have been reaped.
    pub fn open(
        address: &SwarmAddress,
        layout: &Layout,
        agent: usize,
        incarnation: u32,
    ) -> Result<AgentSharedPort> {
        let node = address.node(Role::Agent)?;
        if incarnation > 0 {
            // Not done by the supervisor: where iceoryx2 meets damage in shared memory, it waits without a bound.
            node.try_cleanup_dead_nodes();
        }
        let Services { observations, decisions, weights, wake_agents, wake_supervisor } =
            address.services(&node, Role::Agent)?;
        Ok(AgentSharedPort {
            sensor: subscriber(&address.sensor(&node, agent, Role::Agent)?)?,
            observations_out: address.publisher(&observations, layout.observation_words(address.worlds))?,
            observations_in: subscriber(&observations)?,
            decisions: address.publisher(&decisions, layout.decision_words(address.worlds))?,
            weights: weights.as_ref().map(subscriber).transpose()?,
            wake_supervisor: notifier(&wake_supervisor)?,
            woken: listener(&wake_agents)?,
            _node: node,
        })
    }

    /// Wakes the supervisor.
    pub fn wake_supervisor(&self) -> Result<()> {
        self.wake_supervisor.notify().map(drop).map_err(bus_error("wake the supervisor"))
    }

    /// Sleeps until the supervisor wakes the agents, at most for `longest`.
    pub fn sleep(&self, longest: Duration) -> Result<()> {
        sleep(&self.woken, longest)
    }
}

impl AgentPort for AgentSharedPort {
    type Sample = SharedSample;

    fn receive_sensor(&mut self) -> Result<Option<SharedSample>> {
        receive(&self.sensor)
    }

    fn receive_observation(&mut self) -> Result<Option<SharedSample>> {
        receive(&self.observations_in)
    }

    fn receive_weights(&mut self) -> Result<Option<SharedSample>> {
        self.weights.as_ref().map_or(Ok(None), receive)
    }

    fn publish_observation(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        publish(&self.observations_out, header, write)
    }

    fn publish_decision(&mut self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        publish(&self.decisions, header, write)
    }
}

fn notifier(service: &Event) -> Result<Notifier<ipc::Service>> {
    service.notifier_builder().create().map_err(bus_error("create a notifier"))
}

fn listener(service: &Event) -> Result<Listener<ipc::Service>> {
    service.listener_builder().create().map_err(bus_error("create a listener"))
}

pub(super) fn publish(
    publisher: &WordPublisher,
    header: Header,
    write: impl FnOnce(&mut [u32]),
) -> Result<()> {
    let mut sample = publisher.loan_slice(header.length as usize).map_err(bus_error("loan a sample"))?;
    *sample.user_header_mut() = header;
    write(sample.payload_mut());
    sample.send().map(drop).map_err(bus_error("send a sample"))
}

pub(super) fn receive(subscriber: &WordSubscriber) -> Result<Option<SharedSample>> {
    Ok(subscriber.receive().map_err(bus_error("receive a sample"))?.map(SharedSample))
}

pub(super) fn sleep<S: Service>(woken: &Listener<S>, longest: Duration) -> Result<()> {
    woken.timed_wait(|_| {}, longest).map(drop).or_else(interrupted)
}

/// A signal is a reason to look around, not an error.
fn interrupted(e: ListenerWaitError) -> Result<()> {
    match e {
        ListenerWaitError::InterruptSignal => Ok(()),
        e => Err(bus_error("wait")(e)),
    }
}
