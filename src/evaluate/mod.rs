//! How robust frozen policies are: sweeps over links that fail, statistics and a report.
//!
//! ```text
//!     policies x conditions x imputers -> cells -> Evaluation -> Summary -> table, results.json, CSV, report
//! ```

mod aggregate;
mod bootstrap;
mod claims;
mod curve;
mod estimate;
mod evaluation;
mod grouping;
mod sample;
mod summary;
#[cfg(test)]
mod tests;
mod weighted;

pub use claims::{Claim, Claims, Scope};
pub use evaluation::{
    AgeErrors, Calibration, Cell, Condition, Contender, Evaluation, Outcome, RandomTeam, Settings, UnitErrors,
};
pub(crate) use grouping::thousands;
pub use summary::{Aggregate, CellSummary, Comparison, Group, ImputerSummary, Interval, Summary};
