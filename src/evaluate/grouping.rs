//! Which policies were trained alike, and what they played.

use super::condition::Condition;
use super::evaluation::{Evaluation, Outcome};
use crate::base::table::thousands;

/// Policies of one task that were trained alike.
pub(super) struct Alike<'a> {
    /// Id of the task.
    pub task: &'a str,
    /// What trained them, and for how long where groups of this algorithm differ in that.
    pub label: String,
    /// Indices into [`Evaluation::contenders`].
    pub contenders: Vec<usize>,
    /// Returns of the random team.
    pub random: &'a [f64],
    /// What they played, in the order in which it was first played.
    pub cells: Vec<Played<'a>>,
}

impl Alike<'_> {
    /// The cell of this imputer and condition.
    pub fn find(&self, imputer: &str, condition: &Condition) -> Option<usize> {
        self.cells.iter().position(|cell| cell.imputer == imputer && cell.condition == condition)
    }
}

/// One condition with one imputer, played by some of the group or all.
pub(super) struct Played<'a> {
    /// How links behave.
    pub condition: &'a Condition,
    /// Name of the imputer.
    pub imputer: &'a str,
    /// What came of it, contender by contender; `None` for one that did not play it.
    pub outcomes: Vec<Option<&'a Outcome>>,
}

/// The groups, in the order of their first contenders.
pub(super) fn groups(evaluation: &Evaluation) -> Vec<Alike<'_>> {
    let contenders = &evaluation.contenders;
    let ways = distinct(contenders.iter().map(|one| (&one.task[..], &one.algorithm[..], one.steps)));
    let group = |&(task, algorithm, steps): &(_, _, _)| {
        let alike = |&at: &usize| {
            let one = &contenders[at];
            (&one.task[..], &one.algorithm[..], one.steps) == (task, algorithm, steps)
        };
        let members: Vec<usize> = (0..contenders.len()).filter(alike).collect();
        // Of all tasks, so that groups of different tasks are called alike if they are alike.
        let lengths = distinct(ways.iter().filter(|way| way.1 == algorithm).map(|way| way.2));
        let label = match lengths.len() {
            1 => algorithm.to_owned(),
            _ => format!("{algorithm} {}", thousands(steps)),
        };
        let random = evaluation.random.iter().find(|random| random.task == task);
        let random = random.map_or(&[][..], |random| &random.returns);
        let cells = played(evaluation, &members);
        Alike { task, label, contenders: members, random, cells }
    };
    ways.iter().map(group).collect()
}

/// What these contenders played.
fn played<'a>(evaluation: &'a Evaluation, contenders: &[usize]) -> Vec<Played<'a>> {
    let cells: Vec<_> = evaluation.cells.iter().filter(|cell| contenders.contains(&cell.contender)).collect();
    let kinds = distinct(cells.iter().map(|cell| (&cell.condition, &cell.imputer[..])));
    let played = |(condition, imputer)| {
        let of = |contender: &usize| {
            let wanted = (*contender, condition, imputer);
            let cell =
                cells.iter().find(|cell| (cell.contender, &cell.condition, &cell.imputer[..]) == wanted);
            cell.map(|cell| &cell.outcome)
        };
        Played { condition, imputer, outcomes: contenders.iter().map(of).collect() }
    };
    kinds.into_iter().map(played).collect()
}

/// Each item once, where it first comes up.
pub(super) fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = Vec::new();
    for item in items {
        if !seen.contains(&item) {
            seen.push(item);
        }
    }
    seen
}
