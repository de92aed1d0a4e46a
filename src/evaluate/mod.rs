//! How robust frozen policies are: sweeps over links that fail, statistics and a report.
//!
//! ```text
//!     policies x conditions x imputers -> cells -> Evaluation -> Summary -> table, results.json, CSV, report
//! ```

mod aggregate;
mod bootstrap;
mod claims;
mod curve;
mod errors;
mod estimate;
mod evaluation;
mod grouping;
mod play;
mod record;
pub mod report;
mod require;
mod sample;
mod summary;
mod sweep;
#[cfg(test)]
mod tests;
mod weighted;

#[cfg(test)]
use claims::Claim;
pub use claims::Claims;
pub use evaluation::{AgeErrors, Calibration, Condition, Evaluation, Settings, UnitErrors};
#[cfg(test)]
use evaluation::{Cell, Contender, Outcome, RandomTeam};
pub use record::Record;
pub use require::{Requirement, Verdict};
pub use summary::{Aggregate, CellSummary, Comparison, Group, ImputerSummary, Interval, Summary};
pub use sweep::{Entrant, Place, Sweep};
