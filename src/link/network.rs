//! The network between machines as the link.

use super::{Context, Fates, Link, Model};
use crate::base::error::Result;

/// `network`: nothing is emulated. What the network between machines loses or delays is lost.
#[derive(Clone, Copy, Debug)]
struct Network;

/// It is no line of the registry: there is such a network only where a swarm plays over hosts, against the clock.
pub(super) const MODEL: Model = Model {
    name: "network",
    about: "nothing is emulated: what the network between hosts loses or delays is lost",
    parameters: &[],
    build: |_| Ok(Box::new(Network)),
};

impl Link for Network {
    fn deliveries(&mut self, _context: &Context, _fates: &mut Fates) -> Result<()> {
        Ok(())
    }
}
