//! Seeing a swarm: what a view shows as data, and how a terminal draws it.

#[allow(dead_code)] // What draws it comes next.
pub(crate) mod places;
