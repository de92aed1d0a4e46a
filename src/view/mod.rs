//! Seeing a swarm: what a view shows as data, and how a terminal draws it.

pub(crate) mod film;
#[allow(dead_code)] // What draws it comes next.
pub(crate) mod places;
