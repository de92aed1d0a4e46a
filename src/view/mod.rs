//! Seeing a swarm: what a view shows as data, and how a terminal draws it.
//!
//! ```text
//! session -> camera (an observer) -> scene -> draw -> terminal
//!    ^                                          |
//!    +------ control <------ desk <------ keys -+
//! ```
//!
//! The camera is on the swarm's side. All the rest is on a thread of its own, which nobody waits for.

#![cfg_attr(not(feature = "view"), allow(dead_code))]

mod camera;
mod facts;
pub(crate) mod film;
pub(crate) mod places;
mod scene;

#[cfg(feature = "view")]
mod desk;
#[cfg(feature = "view")]
mod doubt;
#[cfg(feature = "view")]
mod draw;
#[cfg(feature = "view")]
mod keys;
#[cfg_attr(not(feature = "view"), path = "blind.rs")]
mod live;
#[cfg(feature = "view")]
mod panels;
#[cfg(feature = "view")]
mod terminal;
#[cfg(feature = "view")]
mod theme;
#[cfg(feature = "view")]
mod world;

pub(crate) use camera::Camera;
#[cfg(not(feature = "view"))]
pub(crate) use camera::Film;
pub(crate) use facts::Facts;
pub(crate) use live::Live;
