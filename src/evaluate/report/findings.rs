//! What was found, in a few sentences: which imputer, how much of the score is kept, and how sure that is.

#[cfg(test)]
mod tests;

use super::words;
use crate::agent::Truth;
use crate::base::table::counted;
use crate::evaluate::grouping::distinct;
use crate::evaluate::{Aggregate, CellSummary, Condition, Group, ImputerSummary, Interval, Summary};

/// Of fewer episodes, intervals are too narrow.
const FEW_EPISODES: u64 = 20;

/// The same of policies.
const FEW_POLICIES: usize = 30;

/// What the whole comes to: of the only group, over tasks, or else group by group.
pub fn findings(summary: &Summary) -> Vec<String> {
    match &summary.groups[..] {
        [group] => of_group(summary, group),
        groups => over_tasks(summary).unwrap_or_else(|| {
            let first = |group| Some(format!("{}: {}", words::group(group), Best::of(group)?.result()));
            groups.iter().filter_map(first).collect()
        }),
    }
}

/// What a group comes to.
pub fn of_group(summary: &Summary, group: &Group) -> Vec<String> {
    let Some(best) = Best::of(group) else { return Vec::new() };
    let sentences = [Some(best.result()), best.range(), best.against(), Some(best.certainty(summary))];
    sentences.into_iter().flatten().collect()
}

/// The imputer that does best where a group has it hardest.
struct Best<'a> {
    group: &'a Group,
    condition: &'a Condition,
    imputer: &'a ImputerSummary,
    cell: &'a CellSummary,
    /// The others there, with what came of them.
    others: Vec<(&'a ImputerSummary, &'a CellSummary)>,
}

impl<'a> Best<'a> {
    /// `None` if nothing was played. Oracles do not compete, nor do imputers that only some policies were played with.
    fn of(group: &'a Group) -> Option<Best<'a>> {
        let condition = hardest(words::conditions(group))?;
        let played = group.imputers.iter().filter(|imputer| is_imputer(&imputer.imputer));
        let cells = played.filter_map(|imputer| Some((imputer, words::cell(imputer, condition)?)));
        let most = cells.clone().map(|(_, cell)| cell.seed_means.len()).max()?;
        let mut cells: Vec<_> = cells.filter(|(_, cell)| cell.seed_means.len() == most).collect();
        // Of those that are as good the first is the best.
        cells.sort_by(|(_, a), (_, b)| merit(b).value.total_cmp(&merit(a).value));
        let (imputer, cell) = cells.remove(0);
        Some(Best { group, condition, imputer, cell, others: cells })
    }

    /// Which it is, and what is left.
    fn result(&self) -> String {
        let Best { group, condition, imputer, cell, others } = self;
        let name = &imputer.imputer;
        let place = place(condition);
        if condition.is_lossless() {
            let mean = words::with_interval(&cell.mean, 1);
            return format!(
                "Nothing was lost: {} is all that was played. The mean return is {mean}.",
                words::condition(condition)
            );
        }
        let who = match others.len() {
            0 => format!("With {name}, the only imputer played"),
            n => format!("{name} does best of {} imputers", n + 1),
        };
        let outcome = match cell.score {
            Some(score) => kept(&score),
            None => {
                let why = if words::conditions(group).iter().any(|condition| condition.is_lossless()) {
                    "at p = 1 these policies are not clearly better than random actions"
                } else {
                    "p = 1 was not played"
                };
                let mean = words::with_interval(&cell.mean, 1);
                format!("the mean return is {mean}; there is no score, because {why}")
            }
        };
        let link = if others.is_empty() { "," } else { ":" };
        format!("{who}{link} {place} {outcome}.{}", self.rivals())
    }

    /// Those whose intervals overlap with that of the best.
    fn rivals(&self) -> String {
        let low = merit(self.cell).low;
        let rivals = self.others.iter().filter(|(_, cell)| merit(cell).high >= low);
        overlap(rivals.map(|(imputer, _)| &imputer.imputer[..]).collect())
    }

    /// From which p on 90 % of the score is kept, if it is not where that result is from.
    fn range(&self) -> Option<String> {
        self.condition.p()?;
        let p = self.imputer.p_for_90.filter(|p| p.value < 1.0)?;
        self.cell.score.filter(|score| score.value < 0.9)?;
        let interval = words::interval(&p, 2);
        Some(format!("It keeps 90 % of the score from p = {} on ({interval}).", words::number(p.value, 2)))
    }

    /// Against the baseline; if it is the baseline, against the next best.
    fn against(&self) -> Option<String> {
        let baseline = self.group.baseline.as_ref()?;
        let (other, cell, role, difference) = if *baseline == self.imputer.imputer {
            let (other, cell) = self.others.first()?;
            (other, cell, "the next best", negated(cell.comparison?.difference))
        } else {
            let (other, cell) = self.others.iter().find(|(other, _)| other.imputer == *baseline)?;
            (other, cell, "the baseline", self.cell.comparison?.difference)
        };
        let score =
            cell.score.map_or(String::new(), |score| format!(", score {}", words::number(score.value, 2)));
        let is_told = difference.low > 0.0 || difference.high < 0.0;
        Some(format!(
            "The difference to {} ({role}{score}) is {} of return per episode ({}){}.",
            other.imputer,
            words::signed(difference.value, 1),
            words::interval(&difference, 1),
            if is_told { "" } else { ", not distinguishable from zero" }
        ))
    }

    /// What the intervals are about, and what they are not.
    fn certainty(&self, summary: &Summary) -> String {
        let episodes = summary.settings.episodes;
        let seeds = self.cell.seed_means.len();
        let of = if seeds == 1 { "one policy".to_owned() } else { format!("each of {seeds} policies") };
        let about = format!("Intervals are over {} of {of}", counted(episodes, "episode"));
        let others = match self.cell.seed_std {
            None => ": they say nothing about policies from other training runs.".to_owned(),
            Some(std) => format!(
                "; from policy to policy the mean return there varies with a standard deviation of {}{}.",
                words::number(std, 1),
                if seeds == 2 { " (from two policies, a rough guess)" } else { "" }
            ),
        };
        let few = if episodes < FEW_EPISODES { " With so few episodes they are too narrow." } else { "" };
        about + &others + few
    }
}

/// The same over tasks, of the label with the most policies; `None` where no two tasks have scores in common.
fn over_tasks(summary: &Summary) -> Option<Vec<String>> {
    // Of those that are as many the first.
    let largest = summary.aggregates.iter().rev().max_by_key(|aggregate| aggregate.runs)?;
    let of_label = summary.aggregates.iter().filter(|aggregate| aggregate.label == largest.label);
    let lossy = distinct(of_label.clone().map(|aggregate| &aggregate.condition));
    let condition = hardest(lossy).filter(|condition| !condition.is_lossless())?;
    let there =
        of_label.filter(|aggregate| aggregate.condition == *condition && is_imputer(&aggregate.imputer));
    let most = there.clone().map(|aggregate| aggregate.runs).max()?;
    let mut there: Vec<&Aggregate> = there.filter(|aggregate| aggregate.runs == most).collect();
    there.sort_by(|a, b| b.mean.value.total_cmp(&a.mean.value));
    let (best, others) = there.split_first()?;
    let Aggregate { label, imputer, tasks, runs, mean, .. } = best;
    let who = match others.len() {
        0 => format!("with {imputer}, the only imputer played,"),
        n => format!("{imputer} does best of {} imputers:", n + 1),
    };
    let rivals = others.iter().filter(|other| other.mean.high >= mean.low && mean.low < mean.high);
    let rivals = overlap(rivals.map(|other| &other.imputer[..]).collect());
    let result = format!(
        "In the mean over {} tasks ({label}) {who} {} {}.{rivals}",
        tasks.len(),
        place(condition),
        kept(mean)
    );
    let groups = summary.groups.iter().filter(|group| group.label == *label && tasks.contains(&group.task));
    let scores = groups.filter_map(|group| {
        let cell = words::cell(words::imputer(group, imputer)?, condition)?;
        Some((&group.task, cell.score?.value))
    });
    let mut scores: Vec<_> = scores.collect();
    scores.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    let range = match &scores[..] {
        [(worst, low), .., (easiest, high)] => Some(format!(
            "Task by task its score is between {} ({worst}) and {} ({easiest}).",
            words::number(*low, 2),
            words::number(*high, 2)
        )),
        _ => None,
    };
    let certainty = if mean.low < mean.high {
        let rough = if *runs < FEW_POLICIES { ": with so few policies it is rough" } else { "" };
        format!("This interval is over policies, {runs} in all{rough}.")
    } else {
        "There is no interval over policies, as each task has one.".to_owned()
    };
    Some([Some(result), range, Some(certainty)].into_iter().flatten().collect())
}

/// The lowest level below 1; if there is none, the first condition without a level; else what there is.
fn hardest(conditions: Vec<&Condition>) -> Option<&Condition> {
    let lossy = conditions.iter().copied().filter_map(|condition| Some((condition.p()?, condition)));
    let lowest = lossy.filter(|(p, _)| *p < 1.0).min_by(|(a, _), (b, _)| a.total_cmp(b));
    let mode = || conditions.iter().copied().find(|condition| condition.p().is_none());
    lowest.map(|(_, condition)| condition).or_else(mode).or_else(|| conditions.first().copied())
}

/// `at p = 0`, `under dynamic`.
fn place(condition: &Condition) -> String {
    let words = words::condition(condition);
    if condition.p().is_some() { format!("at {words}") } else { format!("under {words}") }
}

/// What imputers are ranked by: scores, or mean returns where there are none.
fn merit(cell: &CellSummary) -> Interval {
    cell.score.unwrap_or(cell.mean)
}

fn is_imputer(name: &str) -> bool {
    Truth::split(name).1.is_none()
}

/// How much of a score is kept, if any.
fn kept(score: &Interval) -> String {
    let number = words::with_interval(score, 2);
    if score.high < 0.0 {
        format!("the team does worse than with random actions, with a score of {number}")
    } else if score.low <= 0.0 {
        format!("the team keeps no measurable part of the score, which is {number}")
    } else {
        let shares =
            Interval { value: 100.0 * score.value, low: 100.0 * score.low, high: 100.0 * score.high };
        match words::with_interval(&shares, 1).split_once(' ') {
            Some((value, interval)) => format!("the team keeps {value} % of the score {interval}"),
            None => format!("the team keeps {} of the score", words::percent(score.value, 1)),
        }
    }
}

fn overlap(names: Vec<&str>) -> String {
    match &names[..] {
        [] => String::new(),
        [one] => format!(" The interval of {one} overlaps with that."),
        [names @ .., last] if names.len() < 4 => {
            format!(" The intervals of {} and {last} overlap with that.", names.join(", "))
        }
        all => format!(" The intervals of {} others overlap with that.", all.len()),
    }
}

fn negated(Interval { value, low, high }: Interval) -> Interval {
    Interval { value: -value, low: -high, high: -low }
}
