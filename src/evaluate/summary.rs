//! What an evaluation says: estimates with intervals, group by group.

use serde::Serialize;

use super::axis::Axis;
use super::condition::Condition;
use super::evaluation::{Contender, Settings, UnitErrors};
use crate::agent::Truth;

/// The statistics of an [`Evaluation`](super::Evaluation). `docs/metrics.md` defines each.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// How it was played.
    pub settings: Settings,
    /// Links of which one parameter was varied.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub axes: Vec<Axis>,
    /// Who was played.
    pub contenders: Vec<Contender>,
    /// One per task and way of training, in the order in which their first contenders were named.
    pub groups: Vec<Group>,
    /// Over tasks, one per algorithm, condition and imputer that was played in at least two tasks.
    pub aggregates: Vec<Aggregate>,
    /// What the paper's headline says of its imputer, one per label that was played in all its cells.
    pub claims: Vec<Claims>,
}

/// Policies of one task that were trained alike: seeds of one method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// Id of the task.
    pub task: String,
    /// What trained them, and for how long where groups of this algorithm differ in that: `mappo`, `mappo 20 M`.
    pub label: String,
    /// Indices into [`Summary::contenders`].
    pub contenders: Vec<usize>,
    /// Mean return of uniform actions from the same initial states: score 0. NaN if they were not played.
    pub random: Interval,
    /// The imputer the others are compared with, if the group was played with it.
    pub baseline: Option<String>,
    /// Imputer by imputer, and each condition by condition.
    pub imputers: Vec<ImputerSummary>,
    /// What the losses are made of: imputer by imputer and condition by condition, where oracles were played beside it
    /// and there are scores.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub losses: Vec<Loss>,
    /// How it does along axes: axis by axis and imputer by imputer.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub profiles: Vec<Profile>,
}

/// How a group does with one imputer along an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Profile {
    /// Index into [`Summary::axes`].
    pub axis: usize,
    /// Name of the imputer.
    pub imputer: String,
    /// Area under return over the parameter, as a mean return over it.
    pub return_area: Interval,
    /// The same of the score; `None` if a value has none.
    pub score_area: Option<Interval>,
    /// Mean of the paired differences of return to the first value of the axis, value by value from the second on.
    pub differences: Vec<Interval>,
}

/// How a group does with one imputer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImputerSummary {
    /// Name of the imputer.
    pub imputer: String,
    /// Condition by condition, in the order in which they were asked for.
    pub cells: Vec<CellSummary>,
    /// Area under return over p, as a mean return over p; `None` for fewer than two levels.
    pub return_area: Option<Interval>,
    /// The same of the score; `None` also if a level has none.
    pub score_area: Option<Interval>,
    /// The lowest p from which on the score stays at 0.9 or above, between levels by linear interpolation; the
    /// lowest level if it does so everywhere, `None` if a level has no score.
    pub p_for_90: Option<Interval>,
    /// Errors over all levels below 1, by unit and steps since last received.
    pub errors: Vec<UnitErrors>,
}

/// What an imputer loses under a condition, and what not knowing parts of the truth has to do with it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// Name of the imputer.
    pub imputer: String,
    /// The condition.
    pub condition: Condition,
    /// Score where everything is delivered, which is 1, minus score.
    pub loss: Interval,
    /// Oracle by oracle.
    pub explained: Vec<Explained>,
}

/// How much of a loss is due to not knowing one part of the truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Explained {
    /// The part that the oracle knows.
    pub truth: Truth,
    /// How much more the oracle scores than its imputer.
    pub gain: Interval,
    /// The same as a share of the loss; `None` unless there is a loss in the sample and in every resample.
    pub share: Option<Interval>,
}

/// How a group does with one imputer under one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellSummary {
    /// The condition.
    pub condition: Condition,
    /// Mean return of each contender of the group that played this.
    pub seed_means: Vec<f64>,
    /// Their (unbiased) standard deviation, as in the paper's tables; `None` for one contender.
    pub seed_std: Option<f64>,
    /// Mean return over all episodes of all contenders.
    pub mean: Interval,
    /// Interquartile mean of the same returns.
    pub iqm: Interval,
    /// Normalised score: 0 is [`Group::random`], 1 the same policy where everything is delivered; `None` unless
    /// p = 1 was played and is better than random for every contender, in every resample.
    pub score: Option<Interval>,
    /// Against the baseline imputer; `None` for the baseline itself and where nothing can be lost.
    pub comparison: Option<Comparison>,
}

/// An imputer against the baseline, episode by episode from the same initial states with the same draws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Mean of the paired differences of return; positive is better than the baseline.
    pub difference: Interval,
    /// The difference as a share of the baseline's mean return, without its sign; infinite if only that is 0.
    pub relative: f64,
    /// Share of episodes that go better than with the baseline, ties half.
    pub probability_of_improvement: Interval,
    /// Standard deviation over seeds, divided by that of the baseline; `None` for one contender,
    /// or if that is 0.
    pub std_ratio: Option<f64>,
}

/// Scores over several tasks, after Agarwal et al. (2021).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Aggregate {
    /// Label of the groups.
    pub label: String,
    /// The condition.
    pub condition: Condition,
    /// Name of the imputer.
    pub imputer: String,
    /// Ids of the tasks.
    pub tasks: Vec<String>,
    /// Policies, over all tasks.
    pub runs: usize,
    /// Mean over tasks of the mean score of their runs.
    pub mean: Interval,
    /// Interquartile mean of the scores of all runs.
    pub iqm: Interval,
}

/// An estimate with its 95 % bootstrap interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Interval {
    /// The estimate.
    pub value: f64,
    /// Low end.
    pub low: f64,
    /// High end.
    pub high: f64,
}

/// How much better the imputer is than its baseline, averaged over the cells of a scope.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claims {
    /// Label of the groups.
    pub label: String,
    /// The imputer.
    pub imputer: String,
    /// The one it is compared with.
    pub baseline: String,
    /// Mean of [`Claim::improvement`].
    pub improvement: f64,
    /// Mean of [`Claim::std_reduction`]; `None` if a cell has none.
    pub std_reduction: Option<f64>,
    /// Task by task, level by level.
    pub cells: Vec<Claim>,
}

/// The same in one cell.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Claim {
    /// Id of the task.
    pub task: String,
    /// The level.
    pub p: f64,
    /// By how much the mean return is higher, as a share of the baseline's without its sign.
    pub improvement: f64,
    /// By how much the standard deviation over seeds is smaller, as a share of the baseline's; `None` for one
    /// seed, or if that is zero.
    pub std_reduction: Option<f64>,
}
