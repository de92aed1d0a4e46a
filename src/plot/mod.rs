//! Charts as SVG, complete in themselves: no script, no font and no link to anywhere, light or dark as the reader
//! has it.
//!
//! No crate is used: those that draw well fix colours that vanish on one of the two backgrounds, or draw one
//! panel without bands, and what is needed is a few hundred lines.

mod axis;
mod curves;
mod figure;
mod style;
mod svg;

pub use curves::curves;
pub use figure::{Figure, Panel, Point, Series};
pub(crate) use svg::escape;
