//! Seeing a swarm: what a view shows as data, and how a terminal draws it.
//!
//! ```text
//! session -> camera (an observer) -> scene -> draw -> terminal
//!    ^                                          |
//!    +------ control <------ desk <------ keys -+
//! ```
//!
//! The camera is on the swarm's side. All the rest is on a thread of its own, which nobody waits for; or in another process:
//!
//! ```text
//! session -> camera -> scene -> window -> shared memory -> visit -> scene -> draw -> terminal
//! ```

pub(crate) mod film;

#[cfg(feature = "view")]
mod camera;
#[cfg(feature = "view")]
mod desk;
#[cfg(feature = "view")]
mod doubt;
#[cfg(feature = "view")]
mod draw;
#[cfg(feature = "view")]
mod facts;
#[cfg(feature = "view")]
mod keys;
#[cfg(feature = "view")]
mod live;
#[cfg(feature = "view")]
mod panels;
#[cfg(feature = "view")]
mod pictures;
#[cfg(feature = "view")]
mod scene;
#[cfg(feature = "view")]
mod sign;
#[cfg(feature = "view")]
mod terminal;
#[cfg(feature = "view")]
mod theme;
#[cfg(feature = "view")]
mod visit;
#[cfg(feature = "view")]
mod window;
#[cfg(feature = "view")]
mod world;

#[cfg(feature = "view")]
pub(crate) use camera::Camera;
#[cfg(feature = "view")]
pub(crate) use facts::Facts;
#[cfg(feature = "view")]
pub(crate) use live::Live;
#[cfg(feature = "view")]
pub(crate) use pictures::Film;
#[cfg(feature = "view")]
pub(crate) use sign::Sign;
#[cfg(feature = "view")]
pub(crate) use visit::{Farewell, visit};
#[cfg(feature = "view")]
pub(crate) use window::Window;
