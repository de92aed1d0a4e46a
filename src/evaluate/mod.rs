//! How robust frozen policies are: sweeps over links that fail, statistics and a report.
//!
//! ```text
//!     policies x conditions x imputers -> cells -> Evaluation -> Summary -> table, results.json, CSV, report
//! ```

mod evaluation;
pub mod report;
mod summary;

pub use evaluation::{
    AgeErrors, Calibration, Cell, Condition, Contender, Evaluation, Outcome, RandomTeam, Settings, UnitErrors,
};
pub use summary::{Aggregate, CellSummary, Comparison, Group, ImputerSummary, Interval, Summary};
