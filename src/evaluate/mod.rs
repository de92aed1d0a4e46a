//! How robust frozen policies are: sweeps over links that fail, statistics and a report.
//!
//! ```text
//!     policies x conditions x imputers -> cells -> Evaluation -> Summary -> table, results.json, CSV, report
//! ```

mod errors;
mod evaluation;
mod play;
mod record;
mod require;
mod summary;
mod sweep;

pub use evaluation::{
    AgeErrors, Calibration, Cell, Condition, Contender, Evaluation, Outcome, RandomTeam, Settings, UnitErrors,
};
pub use record::{CELLS, Record};
pub use require::{Metric, Requirement, Verdict};
pub use summary::{Aggregate, CellSummary, Comparison, Group, ImputerSummary, Interval, Summary};
pub use sweep::{Entrant, Place, Sweep};
