//! The services of a swarm and their limits: the one place that says how large anything is.

use std::path::PathBuf;

use iceoryx2::config::Config;
use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{
    FileName, LogLevel, Path, SemanticString, ServiceName, SignalHandlingMode, ipc, set_log_level_from_env_or,
};
use iceoryx2::service::Service;
use iceoryx2::service::builder::publish_subscribe::Builder as PubSubBuilder;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use serde::{Deserialize, Serialize};

use super::directory::{prefix_of, root_of};
use super::{Header, Layout, PROTOCOL};
use crate::base::error::{Error, Result, Source};

/// Samples of one publisher that a receiver can hold where nothing is delayed: the one in its inbox and the one replacing
/// it. An inbox holds one more for each tick that an observation may be under way.
const BORROWED: usize = 2;

/// Samples of one publisher that wait for a receiver. The newest wins when they are more.
const BUFFERED: usize = 2;

/// Samples a publisher has room for in lockstep, where no more than three are in use at a time if nothing is delayed:
/// being written, in the buffers, and in the inboxes.
const SAMPLES: usize = 8;

/// Samples of weights there is room for. Every agent has copied the last ones before the next are published;
/// were it not so, there would be no sample to write to, and publishing would fail.
const WEIGHTS_SAMPLES: usize = 1;

/// Names a swarm to its agents.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SwarmAddress {
    /// Eight hex digits, see [`super::SwarmDirectory`].
    pub tag: String,
    /// Size of the team.
    pub agents: usize,
    /// The most worlds in a message.
    pub worlds: usize,
    /// How many weights are published at a time; 0 if the policy stays as it is.
    pub weights: usize,
    /// Whether it plays by the clock, where no agent waits for another.
    pub real_time: bool,
    /// The most ticks that an observation may be under way.
    pub longest_delay: u8,
}

/// What an agent in another language needs in order to open the services of a swarm; ours work it out from the address.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wire {
    /// [`PROTOCOL`].
    pub protocol: u32,
    /// The root path of iceoryx2's configuration.
    pub root: PathBuf,
    /// The prefix of iceoryx2's configuration.
    pub prefix: String,
    /// Messages that each of its publishers has room for.
    pub samples: usize,
    /// Sizes of the messages.
    pub layout: Layout,
}

pub(super) type Words = publish_subscribe::PortFactory<ipc::Service, [u32], Header>;
pub(super) type Event = event::PortFactory<ipc::Service>;
pub(super) type WordPublisher = Publisher<ipc::Service, [u32], Header>;
pub(super) type WordSubscriber = Subscriber<ipc::Service, [u32], Header>;

/// The services of a swarm, open in one process.
#[derive(Debug)]
pub(super) struct Services {
    pub(super) observations: Words,
    pub(super) decisions: Words,
    /// Only where there are weights to publish.
    pub(super) weights: Option<Words>,
    pub(super) wake_agents: Event,
    pub(super) wake_supervisor: Event,
}

/// How many there are of what a service connects.
#[derive(Clone, Copy, Debug)]
struct Limits {
    publishers: usize,
    subscribers: usize,
    /// Samples of one publisher that a subscriber can hold.
    borrowed: usize,
}

impl Limits {
    fn of(publishers: usize, subscribers: usize) -> Limits {
        Limits { publishers, subscribers, borrowed: BORROWED }
    }

    /// Samples of one publisher that can be in use at a time: all that subscribers hold, and one being written.
    fn samples(&self) -> usize {
        self.subscribers * (BUFFERED + self.borrowed) + 1
    }
}

/// Whether a process makes the services or finds them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// Creates every service, with explicit limits.
    Supervisor,
    /// Only opens.
    Agent,
}

impl SwarmAddress {
    /// A swarm of one agent in one world, in lockstep, with a policy that stays as it is.
    pub fn of(tag: &str) -> SwarmAddress {
        SwarmAddress {
            tag: tag.to_owned(),
            agents: 1,
            worlds: 1,
            weights: 0,
            real_time: false,
            longest_delay: 0,
        }
    }

    /// The number that marks this swarm's messages.
    pub fn id(&self) -> u64 {
        u64::from_str_radix(&self.tag, 16).unwrap_or_default()
    }

    /// The same for agents in other languages, of a team with messages of these sizes.
    pub(crate) fn wire(&self, layout: &Layout) -> Wire {
        Wire {
            protocol: PROTOCOL,
            root: root_of(&self.tag),
            prefix: prefix_of(&self.tag),
            samples: self.observation_samples(),
            layout: *layout,
        }
    }

    /// This process's entry point to iceoryx2.
    pub(super) fn node(&self, role: Role) -> Result<Node<ipc::Service>> {
        node(&self.tag, role)
    }

    /// The services that all of the swarm share.
    pub(super) fn services(&self, node: &Node<ipc::Service>, role: Role) -> Result<Services> {
        Ok(Services {
            observations: self.words(node, "observations", self.observation_limits(), role)?,
            decisions: self.words(node, "decisions", Limits::of(self.agents, 1), role)?,
            weights: match self.weights {
                0 => None,
                _ => Some(self.words(node, "weights", Limits::of(1, self.agents), role)?),
            },
            wake_agents: self.event(node, "wake-agents", [1, self.agents], role)?,
            wake_supervisor: self.supervisors_event(node, role)?,
        })
    }

    /// The service that wakes the supervisor: it has room for the agents, of whom some may be dead, and for the one that
    /// notices that. (For a bell there is the room of an agent that is elsewhere.)
    pub(super) fn supervisors_event<S: Service>(
        &self,
        node: &Node<S>,
        role: Role,
    ) -> Result<event::PortFactory<S>> {
        self.event(node, "wake-supervisor", [self.agents + 1, 1], role)
    }

    /// The service by which the supervisor speaks to one agent.
    pub(super) fn sensor(&self, node: &Node<ipc::Service>, agent: usize, role: Role) -> Result<Words> {
        self.words(node, &format!("sensor-{agent}"), Limits::of(1, 1), role)
    }

    /// Everybody receives observations, the supervisor too.
    fn observation_limits(&self) -> Limits {
        let limits = Limits::of(self.agents, self.agents + 1);
        Limits { borrowed: limits.borrowed + usize::from(self.longest_delay), ..limits }
    }

    /// Samples a publisher of observations has room for.
    fn observation_samples(&self) -> usize {
        // Receivers that do not wait for each other hold different messages, each as many as it may.
        if self.real_time {
            return self.observation_limits().samples();
        }
        // An agent that is not there keeps what it held when it was lost, which may be something else for each.
        SAMPLES + usize::from(self.longest_delay) + self.agents * self.observation_limits().borrowed
    }

    /// A publisher of messages of up to `words` words.
    pub(super) fn publisher(&self, service: &Words, words: usize) -> Result<WordPublisher> {
        publisher_of(service, words, self.observation_samples())
    }

    fn words(&self, node: &Node<ipc::Service>, name: &str, limits: Limits, role: Role) -> Result<Words> {
        let builder: PubSubBuilder<[u32], Header, ipc::Service> =
            node.service_builder(&service_name(name)?).publish_subscribe::<[u32]>().user_header::<Header>();
        let what = format!("open the service {name}");
        match role {
            Role::Agent => builder.open().map_err(bus_error(&what)),
            Role::Supervisor => builder
                .max_publishers(limits.publishers)
                .max_subscribers(limits.subscribers)
                .max_nodes(self.agents + 1)
                .subscriber_max_buffer_size(BUFFERED)
                .subscriber_max_borrowed_samples(limits.borrowed)
                .history_size(0)
                .enable_safe_overflow(true)
                .create()
                .map_err(bus_error(&what)),
        }
    }

    fn event<S: Service>(
        &self,
        node: &Node<S>,
        name: &str,
        [notifiers, listeners]: [usize; 2],
        role: Role,
    ) -> Result<event::PortFactory<S>> {
        let builder = node.service_builder(&service_name(name)?).event();
        let what = format!("open the service {name}");
        match role {
            Role::Agent => builder.open().map_err(bus_error(&what)),
            Role::Supervisor => builder
                .max_notifiers(notifiers)
                .max_listeners(listeners)
                .max_nodes(notifiers + listeners)
                .event_id_max_value(0)
                .create()
                .map_err(bus_error(&what)),
        }
    }
}

/// This process's entry point to iceoryx2, in the swarm with this tag.
pub(crate) fn node(tag: &str, role: Role) -> Result<Node<ipc::Service>> {
    node_at(&root_of(tag), &prefix_of(tag), &format!("{role:?}"))
}

/// The same of any kind of service, with this root and this prefix, under some name.
pub(super) fn node_at<S: Service>(root: &std::path::Path, prefix: &str, name: &str) -> Result<Node<S>> {
    set_log_level_from_env_or(LogLevel::Fatal);
    let name = format!("vamaro-swarm {name}");
    NodeBuilder::new()
        .name(&name.as_str().try_into().map_err(bus_error("name the node"))?)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&config(root, prefix)?)
        .create()
        .map_err(bus_error("create a node"))
}

/// Built here and nowhere else: iceoryx2's global configuration reads files of the working directory.
fn config(root: &std::path::Path, prefix: &str) -> Result<Config> {
    let mut config = Config::default();
    let root = Path::new(root.as_os_str().as_encoded_bytes()).map_err(bus_error("name its directory"))?;
    config.global.set_root_path(&root);
    config.global.prefix = FileName::new(prefix.as_bytes()).map_err(bus_error("name its shared memory"))?;
    // A swarm begins with nobody and its directory ends with everything: cleaning is for when an agent is started anew.
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    Ok(config)
}

/// A publisher of so many weights.
pub(super) fn weights_publisher(service: &Words, words: usize) -> Result<WordPublisher> {
    publisher_of(service, words, WEIGHTS_SAMPLES)
}

fn publisher_of(service: &Words, words: usize, samples: usize) -> Result<WordPublisher> {
    service
        .publisher_builder()
        .initial_max_slice_len(words)
        .max_loaned_samples(1)
        .override_sample_preallocation(move |worst_case| worst_case.min(samples))
        .create()
        .map_err(bus_error("create a publisher"))
}

/// A subscriber that keeps the newest messages of each publisher.
pub(super) fn subscriber(service: &Words) -> Result<WordSubscriber> {
    service.subscriber_builder().buffer_size(BUFFERED).create().map_err(bus_error("create a subscriber"))
}

/// How much shared memory a swarm may come to use, in bytes: payloads, and what iceoryx2 needs to manage
/// them (measured: a page of 4 KiB for each connection of a publisher and a subscriber, a few for each
/// process; twice that to be safe).
pub fn shared_memory_needed(address: &SwarmAddress, layout: &Layout) -> u64 {
    let SwarmAddress { agents, worlds, weights, .. } = *address;
    let message = |words: usize| 4 * words + 256;
    let payloads = SAMPLES * message(layout.sensor_words(worlds))
        + address.observation_samples() * message(layout.observation_words(worlds))
        + SAMPLES * message(layout.decision_words(worlds));
    let payloads = agents * payloads;
    let weights = WEIGHTS_SAMPLES * 4 * weights;
    let connections = agents * (agents + 4);
    (payloads + weights + connections * 8 * 1024 + (agents + 1) * 64 * 1024) as u64
}

/// How many files a process of a swarm may have open (measured: 862 in the supervisor of 64 agents in training).
pub fn open_files_needed(agents: usize) -> u64 {
    64 + 14 * agents as u64
}

pub(crate) fn service_name(name: &str) -> Result<ServiceName> {
    name.try_into().map_err(bus_error("name a service"))
}

/// Turns an error of iceoryx2 into ours.
pub(crate) fn bus_error<E: Into<Source>>(what: &str) -> impl Fn(E) -> Error + use<'_, E> {
    move |e| Error::Bus { what: what.to_owned(), source: e.into() }
}
