//! What was played: the returns and errors of every cell, as they came.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::environment::{PhysicsSpec, Unit};
use crate::link::LinkSpec;

/// A sweep: policies, each played under every condition with every imputer.
///
/// All cells of a task start from the same initial states, with the same draws of actions and of links, so
/// episode e of one cell is paired with episode e of any other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// How it was played.
    pub settings: Settings,
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

/// How links behave in a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Condition {
    /// Every link delivers with this probability p.
    Level(f64),
    /// One p ~ U(0, 1) per episode.
    Uniform,
    /// A matrix of p_ij ~ U(0, 1) per episode.
    Asymmetric,
    /// That matrix, redrawn every 5 steps.
    Dynamic,
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

impl Condition {
    /// p, where all links share one.
    pub fn level(self) -> Option<f64> {
        match self {
            Condition::Level(p) => Some(p),
            _ => None,
        }
    }

    /// `level`, or the name of the mode.
    pub fn name(self) -> &'static str {
        match self {
            Condition::Level(_) => "level",
            Condition::Uniform => "uniform",
            Condition::Asymmetric => "asymmetric",
            Condition::Dynamic => "dynamic",
        }
    }

    /// Whether everything is delivered, always.
    pub fn is_lossless(self) -> bool {
        self == Condition::Level(1.0)
    }

    /// The links that behave so.
    pub fn links(self) -> LinkSpec {
        let links = match self {
            Condition::Level(p) => LinkSpec::level(p),
            // Links of any number of agents.
            mode => LinkSpec::parse(mode.name(), 1),
        };
        links.expect("a condition is in the registry of links")
    }
}

/// `p=0.2`, or the name of the mode.
impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Condition::Level(p) => write!(f, "p={p}"),
            mode => f.write_str(mode.name()),
        }
    }
}

impl FromStr for Condition {
    type Err = String;

    /// Reads `p=0.2`, a level alone, or the name of a mode.
    fn from_str(text: &str) -> Result<Condition, String> {
        let modes = [Condition::Uniform, Condition::Asymmetric, Condition::Dynamic];
        if let Some(mode) = modes.into_iter().find(|mode| mode.to_string() == text) {
            return Ok(mode);
        }
        match text.strip_prefix("p=").unwrap_or(text).parse::<f64>() {
            // Adding zero turns -0 into 0.
            Ok(p) if (0.0..=1.0).contains(&p) => Ok(Condition::Level(p + 0.0)),
            _ => Err(format!("{text:?} is neither a probability between 0 and 1 nor a mode")),
        }
    }
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
