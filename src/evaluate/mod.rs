//! How robust frozen policies are: sweeps over links that fail, statistics and a report.
//!
//! ```text
//!     policies x conditions x imputers -> cells -> Evaluation -> Summary -> table, results.json, CSV, report
//! ```

mod aggregate;
mod axis;
mod bootstrap;
mod claims;
mod condition;
mod curve;
mod errors;
mod estimate;
mod evaluation;
mod grouping;
mod play;
mod profile;
mod record;
mod replays;
pub mod report;
mod require;
mod sample;
mod study;
mod summary;
mod sweep;
#[cfg(test)]
mod tests;
mod weighted;

pub use axis::Axis;
pub use condition::Condition;
pub use evaluation::{AgeErrors, Calibration, Evaluation, Settings, UnitErrors};
#[cfg(any(test, feature = "python"))]
pub use evaluation::{Cell, Contender, Outcome, RandomTeam};
pub use record::Record;
pub use replays::Replay;
pub use require::{Requirement, Verdict};
#[cfg(test)]
use summary::Claim;
pub use summary::{
    Aggregate, CellSummary, Claims, Comparison, Explained, Group, ImputerSummary, Interval, Loss, Profile,
    Summary,
};
pub use sweep::{Entrant, Place, Sweep};
