//! Charts as SVG, complete in themselves: no script, no font and no link to anywhere, light or dark as the reader
//! has it. Or as PDF for a column of a paper.
//!
//! No crate draws them: those that draw well fix colours that vanish on one of the two backgrounds, or draw one
//! panel without bands, and what is needed is a few hundred lines. Those that turn SVG into PDF bring some forty
//! crates for what a drawing of lines and text does not need.

mod axis;
mod curves;
mod drawing;
mod figure;
mod grid;
mod links;
mod panel;
#[cfg(feature = "cli")]
mod pdf;
mod style;
mod svg;

pub use curves::curves;
pub use figure::Figure;
pub use links::links;
pub use panel::{Form, Panel, Point, Series};
