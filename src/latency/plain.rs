//! iceoryx2 with nothing of ours around it. The one file outside of the bus that names it.

use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::prelude::ipc;

use super::transport::Transport;
use crate::base::error::Result;
use crate::bus::{Role, Wait, bus_error, node, service_name};

/// One end of two services, one for each direction, each with an event to wake its receiver.
pub(super) struct PlainEnd {
    publisher: Publisher,
    subscriber: Subscriber,
    notifier: Notifier,
    listener: Listener,
    wait: Wait,
    // Declared last: ports go before the node they belong to.
    _node: PlainNode,
}

impl PlainEnd {
    /// The end that begins; the other one is opened by the peer.
    pub(super) fn create(tag: &str, payload: usize, wait: Wait) -> Result<PlainEnd> {
        PlainEnd::of(PlainNode::new(tag)?, ["there", "back"], payload, wait)
    }

    /// The other end.
    pub(super) fn open(tag: &str, payload: usize, wait: Wait) -> Result<PlainEnd> {
        PlainEnd::of(PlainNode::new(tag)?, ["back", "there"], payload, wait)
    }

    fn of(node: PlainNode, [out, back]: [&str; 2], payload: usize, wait: Wait) -> Result<PlainEnd> {
        Ok(PlainEnd {
            publisher: node.publisher(out, 1, 1, payload)?,
            subscriber: node.subscriber(back, 1, 1)?,
            notifier: node.notifier(out, 1, 1)?,
            listener: node.listener(back, 1, 1)?,
            wait,
            _node: node,
        })
    }
}

impl Transport for PlainEnd {
    fn send(&mut self, fill: impl FnOnce(&mut [u8])) -> Result<()> {
        self.publisher.send(fill)?;
        match self.wait {
            Wait::Block => self.notifier.wake(),
            Wait::Spin => Ok(()),
        }
    }

    fn receive(&mut self, read: impl FnOnce(&[u8])) -> Result<bool> {
        self.subscriber.receive(read)
    }

    fn sleep(&self, longest: Duration) -> Result<()> {
        self.listener.sleep(longest)
    }
}

/// This process's entry point to services, which the first process to come creates.
pub(super) struct PlainNode(Node<ipc::Service>);

pub(super) struct Publisher {
    port: iceoryx2::port::publisher::Publisher<ipc::Service, [u8], ()>,
    payload: usize,
}

pub(super) struct Subscriber(iceoryx2::port::subscriber::Subscriber<ipc::Service, [u8], ()>);

pub(super) struct Notifier(iceoryx2::port::notifier::Notifier<ipc::Service>);

pub(super) struct Listener(iceoryx2::port::listener::Listener<ipc::Service>);

impl PlainNode {
    /// In the directory of the swarm with this tag.
    pub(super) fn new(tag: &str) -> Result<PlainNode> {
        node(tag, Role::Agent).map(PlainNode)
    }

    /// A publisher of messages of `payload` bytes, one of so many, to so many subscribers.
    pub(super) fn publisher(
        &self,
        name: &str,
        publishers: usize,
        subscribers: usize,
        payload: usize,
    ) -> Result<Publisher> {
        let service = self.messages(name, publishers, subscribers)?;
        let port = service.publisher_builder().initial_max_slice_len(payload).create();
        Ok(Publisher { port: port.map_err(bus_error("create a publisher"))?, payload })
    }

    /// One of so many subscribers to so many publishers.
    pub(super) fn subscriber(&self, name: &str, publishers: usize, subscribers: usize) -> Result<Subscriber> {
        let port = self.messages(name, publishers, subscribers)?.subscriber_builder().create();
        port.map(Subscriber).map_err(bus_error("create a subscriber"))
    }

    /// One of so many who wake so many listeners.
    pub(super) fn notifier(&self, name: &str, notifiers: usize, listeners: usize) -> Result<Notifier> {
        let port = self.events(name, notifiers, listeners)?.notifier_builder().create();
        port.map(Notifier).map_err(bus_error("create a notifier"))
    }

    /// One of so many who are woken.
    pub(super) fn listener(&self, name: &str, notifiers: usize, listeners: usize) -> Result<Listener> {
        let port = self.events(name, notifiers, listeners)?.listener_builder().create();
        port.map(Listener).map_err(bus_error("create a listener"))
    }

    fn messages(
        &self,
        name: &str,
        publishers: usize,
        subscribers: usize,
    ) -> Result<iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, [u8], ()>> {
        let service = self.0.service_builder(&service_name(name)?).publish_subscribe::<[u8]>();
        service
            .max_publishers(publishers)
            .max_subscribers(subscribers)
            .max_nodes(publishers.max(subscribers) + 1)
            .open_or_create()
            .map_err(bus_error("open a service"))
    }

    fn events(
        &self,
        name: &str,
        notifiers: usize,
        listeners: usize,
    ) -> Result<iceoryx2::service::port_factory::event::PortFactory<ipc::Service>> {
        let service = self.0.service_builder(&service_name(&format!("wake-{name}"))?).event();
        service
            .max_notifiers(notifiers)
            .max_listeners(listeners)
            .max_nodes(notifiers.max(listeners) + 1)
            .open_or_create()
            .map_err(bus_error("open a service"))
    }
}

impl Publisher {
    /// Publishes what `fill` writes in place.
    pub(super) fn send(&self, fill: impl FnOnce(&mut [u8])) -> Result<()> {
        let mut sample = self.port.loan_slice(self.payload).map_err(bus_error("loan a sample"))?;
        fill(sample.payload_mut());
        sample.send().map(drop).map_err(bus_error("send a sample"))
    }
}

impl Subscriber {
    /// Shows `read` the next message, if there is one; whether there was.
    pub(super) fn receive(&self, read: impl FnOnce(&[u8])) -> Result<bool> {
        let sample = self.0.receive().map_err(bus_error("receive a sample"))?;
        Ok(sample.map(|sample| read(sample.payload())).is_some())
    }
}

impl Notifier {
    pub(super) fn wake(&self) -> Result<()> {
        self.0.notify().map(drop).map_err(bus_error("notify"))
    }
}

impl Listener {
    pub(super) fn sleep(&self, longest: Duration) -> Result<()> {
        match self.0.timed_wait(|_| {}, longest) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => Ok(()),
            Err(e) => Err(bus_error("wait")(e)),
        }
    }
}
