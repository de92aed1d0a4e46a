//! What was played: the returns and errors of every cell, as they came.

use serde::{Deserialize, Serialize};

use super::axis::Axis;
use super::condition::Condition;
use crate::environment::{PhysicsSpec, Unit};

/// A sweep: policies, each played under every condition with every imputer.
///
/// All cells of a task start from the same initial states, with the same draws of actions and of links, so
/// episode e of one cell is paired with episode e of any other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// How it was played.
    pub settings: Settings,
    /// Axes on which conditions are.
    pub axes: Vec<Axis>,
    /// Who was played, in the order of the command line.
    pub contenders: Vec<Contender>,
    /// What agents that choose uniformly among their available actions bring in, task by task.
    pub random: Vec<RandomTeam>,
    /// Contender by contender, condition by condition, imputer by imputer. Where everything is delivered all
    /// imputers have the same outcome, each a cell of its own.
    pub cells: Vec<Cell>,
}

/// What decides how an episode goes, beside its cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Episodes of every cell.
    pub episodes: u64,
    /// Seed of all draws.
    pub seed: u64,
    /// Actions are the most probable ones, not sampled.
    pub greedy: bool,
    /// Everything is delivered at t = 0.
    pub comm_at_t0: bool,
    /// How bodies move, in all cells and for the random team; not written down if it is the default.
    #[serde(default, skip_serializing_if = "PhysicsSpec::is_default")]
    pub physics: PhysicsSpec,
    /// Agents pass on the newest observation that they hold of each other agent; written down if so.
    #[serde(default, skip_serializing_if = "is_false")]
    pub relay: bool,
}

fn is_false(flag: &bool) -> bool {
    !flag
}

impl Settings {
    /// What is to be said of how it was played, if anything: physics other than by default, and relaying.
    pub(crate) fn if_other(&self) -> String {
        self.physics.if_other() + if self.relay { ", relayed" } else { "" }
    }
}

/// A frozen policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contender {
    /// As it was named on the command line.
    pub name: String,
    /// Id of its task.
    pub task: String,
    /// What trained it, such as `mappo`.
    pub algorithm: String,
    /// Seed of the run that made it.
    pub seed: u64,
    /// Environment steps it was trained for.
    pub steps: u64,
    /// Where it comes from.
    pub origin: String,
    /// Distinguishes its weights from others, 16 hexadecimal digits.
    pub fingerprint: String,
    /// The predictors it carries.
    pub predictors: Vec<String>,
}

/// The returns of a task's agents when they choose uniformly among their available actions, episode by episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RandomTeam {
    /// Id of the task.
    pub task: String,
    /// Undiscounted sums of team rewards, one per episode.
    pub returns: Vec<f64>,
}

/// One policy under one condition with one imputer.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Index into [`Evaluation::contenders`].
    pub contender: usize,
    /// How links behave.
    pub condition: Condition,
    /// Name of the imputer.
    pub imputer: String,
    /// What came of it.
    pub outcome: Outcome,
}

/// What came of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Undiscounted sums of team rewards, one per episode.
    pub returns: Vec<f64>,
    /// Errors of what was imputed, unit by unit; empty if nothing was.
    pub errors: Vec<UnitErrors>,
}

/// Errors of the imputed values of one unit, over all episodes and receivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnitErrors {
    /// The unit.
    pub unit: Unit,
    /// At index a - 1, those of values last received a steps ago. What was never received is not among them.
    pub ages: Vec<AgeErrors>,
}

/// Errors of imputed values of one unit and age.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AgeErrors {
    /// Imputed values.
    pub count: u64,
    /// Sum of their squared errors, unit squared.
    pub squared: f64,
    /// How the errors compare with what a predictor expected of them; `None` for the plain imputers.
    pub calibration: Option<Calibration>,
}

/// Errors in units of the sigma that the predictor stated: z = error / sigma.
///
/// The sigma of a value imputed a steps in a row is that of the sum of a independent changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Values for which the predictor stated a sigma: all but those it holds.
    pub count: u64,
    /// Sum of z^2; its mean is 1 for a predictor that knows how sure it may be.
    pub z_squared: f64,
    /// Values within the central 50 % interval of the stated normal distribution.
    pub within_50: u64,
    /// Values within its central 95 % interval.
    pub within_95: u64,
}

impl Outcome {
    /// Whether all numbers are numbers: estimates can overflow.
    pub fn is_finite(&self) -> bool {
        let finite = |errors: &AgeErrors| {
            errors.squared.is_finite() && errors.calibration.is_none_or(|stated| stated.z_squared.is_finite())
        };
        let mut ages = self.errors.iter().flat_map(|errors| &errors.ages);
        self.returns.iter().all(|value| value.is_finite()) && ages.all(finite)
    }
}

impl AgeErrors {
    /// Root mean squared error; `None` if there was no value.
    pub fn rmse(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squared / self.count as f64).sqrt())
    }

    /// Takes in other errors of the same unit and age.
    pub fn add(&mut self, other: &AgeErrors) {
        self.count += other.count;
        self.squared += other.squared;
        if let Some(other) = other.calibration {
            let own = self.calibration.get_or_insert_default();
            own.count += other.count;
            own.z_squared += other.z_squared;
            own.within_50 += other.within_50;
            own.within_95 += other.within_95;
        }
    }
}
