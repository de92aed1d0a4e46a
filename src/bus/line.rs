//! The line between a supervisor and an environment in another process: requests one way, answers the other.
//!
//! It has a tag and services of its own, which no agent is told of: an agent sees its sensor, and nothing else of the
//! worlds. Its ports are those that any thread may use, since an environment may move from one to another.

use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc_threadsafe::Service;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use serde::{Deserialize, Serialize};

use super::directory::{keep_to_this_user, prefix_of, root_of};
use super::services::{bus_error, node_at, service_name};
use super::shared::sleep;
use super::{Header, PROTOCOL};
use crate::base::error::Result;
use crate::failed;

/// Messages of one side that can be in use at a time: being written, waiting, and being read.
const SAMPLES: usize = 4;

/// What an environment in another process is told at its start: the last word of its command, as JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LineSettings {
    /// Eight hex digits that name the line.
    pub(crate) tag: String,
    /// The worlds it is to have.
    pub(crate) worlds: usize,
    /// Process id of the supervisor.
    pub(crate) supervisor: i32,
    /// What programs in other languages need to open the services.
    pub(crate) wire: LineWire,
}

/// How iceoryx2 is configured; ours work it out from the tag.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LineWire {
    /// [`PROTOCOL`].
    pub(crate) protocol: u32,
    root: PathBuf,
    prefix: String,
}

/// Sizes of what is sent for one world, in words.
///
/// | message | parts |
/// |---|---|
/// | reset | the world, seed (2) |
/// | step | whether each world plays (1 each), actions `[agents, worlds, action]` |
/// | outcome | rewards `[worlds, agents]` (2 each), whether each episode is over (1 each), observations `[agents, worlds, observation]` |
#[derive(Clone, Copy, Debug)]
pub(crate) struct LineLayout {
    pub(crate) agents: usize,
    pub(crate) observation: usize,
    pub(crate) action: usize,
}

/// The parts of an outcome.
pub(crate) struct LineOutcome<'a> {
    /// Halves of an f64 each, `[worlds, agents]`.
    pub(crate) rewards: &'a [[u32; 2]],
    /// 0 open, 1 terminated, 2 truncated, `[worlds]`.
    pub(crate) ends: &'a [u32],
    /// `[agents, worlds, observation]`.
    pub(crate) observations: &'a [f32],
}

impl LineLayout {
    /// Words of a reset.
    pub(crate) const RESET: usize = 3;

    /// Words of a step.
    pub(crate) fn step_words(&self, worlds: usize) -> usize {
        worlds * (1 + self.agents * self.action)
    }

    /// Words of an outcome.
    pub(crate) fn outcome_words(&self, worlds: usize) -> usize {
        worlds * (1 + self.agents * (2 + self.observation))
    }

    /// Reads an outcome of [`LineLayout::outcome_words`] words.
    pub(crate) fn outcome<'a>(&self, words: &'a [u32], worlds: usize) -> LineOutcome<'a> {
        let (rewards, rest) = words.split_at(2 * worlds * self.agents);
        let (ends, observations) = rest.split_at(worlds);
        LineOutcome {
            rewards: bytemuck::cast_slice(rewards),
            ends,
            observations: bytemuck::cast_slice(observations),
        }
    }
}

/// Whose end of a line it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LineEnd {
    /// The supervisor's: it creates the services.
    Supervisor,
    /// The environment's, which only opens them.
    Environment,
}

/// One end of a line.
#[derive(Debug)]
pub(crate) struct Line {
    out: Words,
    speaks: Option<Publisher<Service, [u32], Header>>,
    hears: Subscriber<Service, [u32], Header>,
    wake: Notifier<Service>,
    woken: Listener<Service>,
    // Declared last: ports go before the node they belong to.
    _node: Node<Service>,
}

type Words = publish_subscribe::PortFactory<Service, [u32], Header>;
type Event = event::PortFactory<Service>;

impl LineSettings {
    /// What to tell the environment at the other end of the line with this tag.
    pub(crate) fn of(tag: &str, worlds: usize) -> LineSettings {
        let wire = LineWire { protocol: PROTOCOL, root: root_of(tag), prefix: prefix_of(tag) };
        LineSettings { tag: tag.to_owned(), worlds, supervisor: std::process::id() as i32, wire }
    }
}

impl Line {
    /// An end of the line with this tag.
    pub(crate) fn open(tag: &str, end: LineEnd) -> Result<Line> {
        let node = node(tag, end)?;
        if end == LineEnd::Supervisor {
            keep_to_this_user(tag)?;
        }
        let down = words(&node, "to-environment", end)?;
        let up = words(&node, "from-environment", end)?;
        let wake_environment = event(&node, "wake-environment", 1, end)?;
        let wake_supervisor = supervisors_event(&node, end)?;
        let (out, into, wake, woken) = match end {
            LineEnd::Supervisor => (down, up, wake_environment, wake_supervisor),
            LineEnd::Environment => (up, down, wake_supervisor, wake_environment),
        };
        let hears = into.subscriber_builder().buffer_size(2).create();
        Ok(Line {
            speaks: None,
            hears: hears.map_err(bus_error("create a subscriber"))?,
            wake: wake.notifier_builder().create().map_err(bus_error("create a notifier"))?,
            woken: woken.listener_builder().create().map_err(bus_error("create a listener"))?,
            out,
            _node: node,
        })
    }

    /// Makes room for messages of up to so many words. Before that, nothing can be sent.
    pub(crate) fn make_room(&mut self, words: usize) -> Result<()> {
        let builder = self.out.publisher_builder().initial_max_slice_len(words).max_loaned_samples(1);
        let speaks = builder.override_sample_preallocation(|worst_case| worst_case.min(SAMPLES)).create();
        self.speaks = Some(speaks.map_err(bus_error("create a publisher"))?);
        Ok(())
    }

    /// Sends a payload of `header.length` words that `write` fills in place, and wakes the other end.
    pub(crate) fn send(&self, header: Header, write: impl FnOnce(&mut [u32])) -> Result<()> {
        let publisher = self.speaks.as_ref().ok_or_else(|| failed!("no room was made for messages"))?;
        let mut sample = publisher.loan_slice(header.length as usize).map_err(bus_error("loan a sample"))?;
        *sample.user_header_mut() = header;
        write(sample.payload_mut());
        sample.send().map_err(bus_error("send a sample"))?;
        self.wake.notify().map(drop).map_err(bus_error("wake the other end"))
    }

    /// Reads the next message, if there is one.
    pub(crate) fn receive<T>(&self, read: impl FnOnce(&Header, &[u32]) -> T) -> Result<Option<T>> {
        let sample = self.hears.receive().map_err(bus_error("receive a sample"))?;
        Ok(sample.map(|sample| read(sample.user_header(), sample.payload())))
    }

    /// Sleeps until the other end wakes this one, at most for `longest`.
    pub(crate) fn sleep(&self, longest: Duration) -> Result<()> {
        sleep(&self.woken, longest)
    }
}

/// Wakes the supervisor's end of the line with this tag in place of an environment that has died, from a thread that has no
/// port.
pub(crate) fn wake_supervisor_of_line(tag: &str) -> Result<()> {
    let end = LineEnd::Environment;
    let node = node(tag, end)?;
    let notifier = supervisors_event(&node, end)?.notifier_builder().create();
    let notifier = notifier.map_err(bus_error("create a notifier"))?;
    notifier.notify().map(drop).map_err(bus_error("wake the supervisor"))
}

/// How much shared memory a line may come to use, in bytes: payloads, and what iceoryx2 needs to manage them.
pub(crate) fn line_memory_needed(words: usize) -> u64 {
    (SAMPLES * (4 * words + 256) + 256 * 1024) as u64
}

/// This process's entry point to iceoryx2.
fn node(tag: &str, end: LineEnd) -> Result<Node<Service>> {
    node_at(&root_of(tag), &prefix_of(tag), &format!("{end:?}"))
}

/// The event that wakes the supervisor: it has room for the environment, and for who notices that it has died.
fn supervisors_event(node: &Node<Service>, end: LineEnd) -> Result<Event> {
    event(node, "wake-supervisor", 2, end)
}

fn words(node: &Node<Service>, name: &str, end: LineEnd) -> Result<Words> {
    let service = node.service_builder(&service_name(name)?).publish_subscribe::<[u32]>();
    let builder = service.user_header::<Header>();
    let what = format!("open the service {name}");
    match end {
        LineEnd::Environment => builder.open().map_err(bus_error(&what)),
        LineEnd::Supervisor => builder
            .max_publishers(1)
            .max_subscribers(1)
            .max_nodes(2)
            .subscriber_max_buffer_size(2)
            .subscriber_max_borrowed_samples(1)
            .history_size(0)
            .enable_safe_overflow(true)
            .create()
            .map_err(bus_error(&what)),
    }
}

fn event(node: &Node<Service>, name: &str, notifiers: usize, end: LineEnd) -> Result<Event> {
    let builder = node.service_builder(&service_name(name)?).event();
    let what = format!("open the service {name}");
    match end {
        LineEnd::Environment => builder.open().map_err(bus_error(&what)),
        LineEnd::Supervisor => builder
            .max_notifiers(notifiers)
            .max_listeners(1)
            .max_nodes(notifiers + 1)
            .event_id_max_value(0)
            .create()
            .map_err(bus_error(&what)),
    }
}
