//! What a training run writes down as it goes: one row per report, as CSV for every program and as events for
//! TensorBoard.

mod events;
mod log;
mod table;

pub use log::MetricsLog;
#[cfg(test)]
pub(crate) use table::Column;
pub use table::{FILE, Metrics};
