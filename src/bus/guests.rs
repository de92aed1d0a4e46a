//! Those who look on from outside: a service for pictures of a swarm, beside those that its agents share.
//!
//! Guests are not of the swarm and meet it nowhere else: they have a prefix and a folder of their own. So what one leaves
//! behind that was stopped or killed is in no agent's way, and what agents leave behind is in no guest's.

use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::{Subscriber, SubscriberCreateError};
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::ipc;
use iceoryx2::service::builder::publish_subscribe::{Builder, PublishSubscribeOpenError};
use iceoryx2::service::port_factory::{PortFactory as _, publish_subscribe};

use super::Living;
use super::directory::{guests_prefix_of, keep_to_this_user, root_of};
use super::memory::take_pages_of;
use super::services::{bus_error, node_at, service_name};
use crate::base::error::{Error, Result};
use crate::usage;

/// How many can look on at a time.
const GUESTS: usize = 4;

/// Pictures that wait for a guest: the newest.
const BUFFERED: usize = 1;

/// Pictures that a guest holds: the one it looks at.
const BORROWED: usize = 1;

const SERVICE: &str = "view";

type Pictures = publish_subscribe::PortFactory<ipc::Service, [u8], ()>;

/// The swarm's side: shows pictures. A guest that does not look misses them, and nobody waits for it.
#[derive(Debug)]
pub(crate) struct Host {
    publisher: Publisher<ipc::Service, [u8], ()>,
    service: Pictures,
    // Declared last: ports go before the node they belong to.
    node: Node<ipc::Service>,
}

impl Host {
    /// Lets in guests to the swarm with this tag, for pictures of up to `longest` bytes.
    pub(crate) fn open(tag: &str, longest: usize) -> Result<Host> {
        let folder = folder_in(&root_of(tag));
        let made = DirBuilder::new().mode(0o700).create(&folder);
        made.map_err(|e| Error::io("create the directory", &folder, e))?;
        let node = node_at(&folder, &guests_prefix_of(tag), "host")?;
        keep_to_this_user(tag)?;
        let service = builder(&node)?
            .max_publishers(1)
            .max_subscribers(GUESTS)
            .max_nodes(GUESTS + 1)
            .subscriber_max_buffer_size(BUFFERED)
            .subscriber_max_borrowed_samples(BORROWED)
            .history_size(0)
            .enable_safe_overflow(true)
            .create()
            .map_err(bus_error("open the service for guests"))?;
        let publisher = service
            .publisher_builder()
            .initial_max_slice_len(longest)
            .max_loaned_samples(1)
            .create()
            .map_err(bus_error("create a publisher for guests"))?;
        take_pages_of(&guests_prefix_of(tag))?;
        Ok(Host { publisher, service, node })
    }

    /// How many are there, dead ones included.
    pub(crate) fn guests(&self) -> usize {
        self.service.dynamic_config().number_of_subscribers()
    }

    /// Frees the places of dead guests, and what was shared with those that have left.
    pub(crate) fn tidy(&self) -> Result<()> {
        self.node.try_cleanup_dead_nodes();
        self.publisher.update_connections().map_err(bus_error("part with guests"))
    }

    /// Shows a picture to all guests.
    pub(crate) fn show(&self, picture: &[u8]) -> Result<()> {
        let mut sample =
            self.publisher.loan_slice(picture.len()).map_err(bus_error("loan a sample for guests"))?;
        sample.payload_mut().copy_from_slice(picture);
        sample.send().map(drop).map_err(bus_error("show a picture to guests"))
    }
}

/// A guest's side.
#[derive(Debug)]
pub(crate) struct Guest {
    subscriber: Subscriber<ipc::Service, [u8], ()>,
    // Declared last: ports go before the node they belong to.
    _node: Node<ipc::Service>,
}

impl Guest {
    /// Enters a swarm that shows itself.
    ///
    /// # Errors
    /// `Usage` if there are as many guests as there may be.
    pub(crate) fn enter(swarm: &Living) -> Result<Guest> {
        let node = node_at(&folder_in(&swarm.root), &guests_prefix_of(&swarm.tag), "guest")?;
        // Their places may be all that is left.
        node.try_cleanup_dead_nodes();
        let service = builder(&node)?.open().map_err(|e| match e {
            PublishSubscribeOpenError::ExceedsMaxNumberOfNodes => no_place(),
            e => bus_error("open the service for guests")(e),
        })?;
        let subscriber = service.subscriber_builder().create().map_err(|e| match e {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => no_place(),
            e => bus_error("create a subscriber")(e),
        })?;
        Ok(Guest { subscriber, _node: node })
    }

    /// Looks at the newest picture, if there is one that it has not seen. What is shown meanwhile waits.
    pub(crate) fn look<T>(&self, see: impl FnOnce(&[u8]) -> T) -> Result<Option<T>> {
        let sample = self.subscriber.receive().map_err(bus_error("receive a picture"))?;
        Ok(sample.map(|sample| see(sample.payload())))
    }
}

/// How much shared memory pictures of up to `longest` bytes may come to need, and all who look at them: as many as are
/// shown and looked at at a time, and more than what iceoryx2 takes for each process (measured: a page for each guest, and
/// two for the host).
pub(crate) fn guests_memory_needed(longest: usize) -> u64 {
    let pictures = GUESTS * (BUFFERED + BORROWED) + 1;
    (pictures * (longest + 256) + (GUESTS + 1) * 16 * 1024) as u64
}

fn folder_in(root: &Path) -> PathBuf {
    root.join("guests")
}

fn builder(node: &Node<ipc::Service>) -> Result<Builder<[u8], (), ipc::Service>> {
    Ok(node.service_builder(&service_name(SERVICE)?).publish_subscribe::<[u8]>())
}

fn no_place() -> Error {
    usage!(
        "{GUESTS} are looking at this swarm already, and there is room for no more; end one of them (key q)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::{SwarmDirectory, living};

    #[test]
    fn guests_see_the_newest_picture_and_there_are_no_more_than_four() {
        let swarm = SwarmDirectory::create().unwrap();
        let host = Host::open(swarm.tag(), 8).unwrap();
        let found = living().unwrap().into_iter().find(|other| other.tag == swarm.tag()).unwrap();
        let mut guests: Vec<Guest> = (0..GUESTS).map(|_| Guest::enter(&found).unwrap()).collect();
        assert_eq!(host.guests(), GUESTS);
        let refused = Guest::enter(&found).unwrap_err();
        assert!(matches!(&refused, Error::Usage(words) if words.contains("4 are looking")), "{refused}");
        // Nobody looks: nobody waits.
        for picture in 0..100u8 {
            host.show(&[picture; 8]).unwrap();
        }
        for guest in &guests {
            assert_eq!(guest.look(<[u8]>::to_vec).unwrap(), Some(vec![99; 8]));
            assert_eq!(guest.look(<[u8]>::to_vec).unwrap(), None);
        }
        assert!(host.show(&[0; 9]).is_err(), "it is longer than was said");
        guests.pop();
        assert_eq!(host.guests(), GUESTS - 1);
        host.show(&[1]).unwrap();
        let guest = Guest::enter(&found).unwrap();
        assert_eq!(guest.look(<[u8]>::to_vec).unwrap(), None, "it was shown before");
    }
}
