//! How numbers and conditions are written, in whatever file.

use crate::agent::Truth;
use crate::environment::Unit;
use crate::evaluate::grouping::distinct;
use crate::evaluate::{
    AgeErrors, Axis, CellSummary, Claims, Condition, Explained, Group, ImputerSummary, Interval, Loss,
    Profile, Summary, UnitErrors,
};

/// `p = 0.2`, or the text of the links.
pub fn condition(condition: &Condition) -> String {
    match condition.p() {
        Some(p) => format!("p = {p}"),
        None => condition.name().to_owned(),
    }
}

/// `burst = 10`.
pub fn value(axis: &Axis, at: usize) -> String {
    format!("{} = {}", axis.parameter, axis.points[at].value)
}

/// The profiles of a group along an axis.
pub fn profiles(group: &Group, axis: usize) -> Vec<&Profile> {
    group.profiles.iter().filter(|profile| profile.axis == axis).collect()
}

/// The conditions a group was played under.
pub fn conditions(group: &Group) -> Vec<&Condition> {
    let first = group.imputers.first();
    first.map_or(Vec::new(), |imputer| imputer.cells.iter().map(|cell| &cell.condition).collect())
}

/// `hear-see: mappo`.
pub fn group(group: &Group) -> String {
    format!("{}: {}", group.task, group.label)
}

/// `seeds 0, 1, 2`.
pub fn seeds(summary: &Summary, group: &Group) -> String {
    let seeds: Vec<String> =
        group.contenders.iter().map(|at| summary.contenders[*at].seed.to_string()).collect();
    format!("seed{} {}", if seeds.len() == 1 { "" } else { "s" }, seeds.join(", "))
}

/// `1 policy`, `3 policies`.
pub fn policies(n: usize) -> String {
    format!("{n} polic{}", if n == 1 { "y" } else { "ies" })
}

/// By how much the return is better and the spread over seeds smaller, in percent.
pub fn improvement(improvement: f64, std_reduction: Option<f64>) -> [String; 2] {
    [percent(improvement, 1), std_reduction.map_or("-".to_owned(), |share| percent(share, 1))]
}

/// What a claim is about, and what it comes to.
pub fn claim(claims: &Claims) -> String {
    let [better, smaller] = improvement(claims.improvement, claims.std_reduction);
    let tasks = distinct(claims.cells.iter().map(|cell| &cell.task[..])).join(", ");
    let levels = distinct(claims.cells.iter().map(|cell| cell.p)).into_iter().map(|p| p.to_string());
    format!(
        "{}, {} against {} over {tasks} at p = {}: mean return better by {better}, standard deviation over seeds \
         smaller by {smaller}",
        claims.label,
        claims.imputer,
        claims.baseline,
        levels.collect::<Vec<_>>().join(" and ")
    )
}

/// Whether any imputer is an oracle.
pub fn has_oracles(imputers: &[&str]) -> bool {
    imputers.iter().any(|name| Truth::split(name).1.is_some())
}

/// What a loss is, and what explains it: a sentence each.
pub fn loss(loss: &Loss) -> Vec<String> {
    let Loss { imputer, condition: under, loss, explained } = loss;
    let first = format!(
        "{}: {imputer} loses {} {} of the score.",
        condition(under),
        number(loss.value, 3),
        ends(loss, 3)
    );
    let rest = explained.iter().map(|Explained { truth, gain, share }| {
        let of = match truth {
            Truth::Own => "its own agent's state".to_owned(),
            Truth::Others => "the other agents' state".to_owned(),
            Truth::Targets => "the targets' state".to_owned(),
            Truth::Constants => "what is no agent's state".to_owned(),
            Truth::Agent(agent) => format!("agent {agent}'s state"),
        };
        match share {
            Some(Interval { value, low, high }) => {
                let [low, high] = [low, high].map(|end| number(100.0 * end, 1));
                format!("Not knowing {of} explains {} [{low}, {high}] of that.", percent(*value, 1))
            }
            None => format!("Knowing {of} adds {} {}.", number(gain.value, 3), ends(gain, 3)),
        }
    });
    std::iter::once(first).chain(rest).collect()
}

/// What the summary knows of an imputer of a group.
pub fn imputer<'a>(group: &'a Group, name: &str) -> Option<&'a ImputerSummary> {
    group.imputers.iter().find(|imputer| imputer.imputer == name)
}

/// Its name, and how many of the group's policies were played with it where not all were.
pub fn played(group: &Group, imputer: &ImputerSummary) -> String {
    let played = imputer.cells.iter().map(|cell| cell.seed_means.len()).max().unwrap_or_default();
    match group.contenders.len() {
        all if all == played => imputer.imputer.clone(),
        all => format!("{} ({played} of {all})", imputer.imputer),
    }
}

/// Where 90 % of the score is left: `<= 0.20` if that is the lowest level played.
pub fn p_for_90(imputer: &ImputerSummary, p: &Interval) -> String {
    let levels = imputer.cells.iter().filter_map(|cell| cell.condition.p());
    let lowest = levels.fold(1.0, f64::min);
    let at_most = if p.value == lowest && lowest > 0.0 { "<= " } else { "" };
    format!("{at_most}{}", number(p.value, 2))
}

/// What came of it under a condition.
pub fn cell<'a>(imputer: &'a ImputerSummary, condition: &Condition) -> Option<&'a CellSummary> {
    imputer.cells.iter().find(|cell| cell.condition == *condition)
}

/// Whether a group has scores: where everything is delivered it is better than random, as far as was played.
pub fn has_scores(group: &Group) -> bool {
    group.imputers.iter().flat_map(|imputer| &imputer.cells).any(|cell| cell.score.is_some())
}

/// All imputers, in the order in which they first come.
pub fn imputers(summary: &Summary) -> Vec<&str> {
    distinct(summary.groups.iter().flat_map(|group| &group.imputers).map(|imputer| &imputer.imputer[..]))
}

/// The units of what a group's imputers imputed.
pub fn units(group: &Group) -> Vec<Unit> {
    let errors = || group.imputers.iter().flat_map(|imputer| &imputer.errors);
    let imputed = |unit: &Unit| errors().any(|errors| errors.unit == *unit && all_ages(errors).count > 0);
    Unit::ALL.into_iter().filter(imputed).collect()
}

/// A unit with what is measured in it, where the symbol alone would say nothing.
pub fn unit(unit: Unit) -> &'static str {
    if unit == Unit::One { "colours and words" } else { unit.symbol() }
}

/// What is measured in a unit.
pub fn quantity(unit: Unit) -> &'static str {
    match unit {
        Unit::Metre => "positions",
        Unit::MetrePerSecond => "velocities",
        Unit::One => "colours and words",
    }
}

/// The errors of all ages.
pub fn all_ages(errors: &UnitErrors) -> AgeErrors {
    let mut all = AgeErrors::default();
    errors.ages.iter().for_each(|age| all.add(age));
    all
}

/// A number with this many decimals, never a negative zero; `-` if it is not finite.
pub fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.trim_start_matches(['-', '0', '.']) {
        _ if !value.is_finite() => "-".to_owned(),
        "" => text.trim_start_matches('-').to_owned(),
        _ => text,
    }
}

/// A number with its sign.
pub fn signed(value: f64, decimals: usize) -> String {
    let text = number(value, decimals);
    let above = value > 0.0 && text.contains(|digit| ('1'..='9').contains(&digit));
    if above { format!("+{text}") } else { text }
}

/// `-26.3 +- 1.2`: an estimate and half the width of its interval.
pub fn plus_minus(interval: &Interval, decimals: usize) -> String {
    let half = (interval.high - interval.low) / 2.0;
    format!("{} +- {}", number(interval.value, decimals), number(half, decimals))
}

/// `[-27.5, -25.1]`.
pub fn ends(interval: &Interval, decimals: usize) -> String {
    format!("[{}, {}]", number(interval.low, decimals), number(interval.high, decimals))
}

/// `95 % interval -27.5 to -25.1`.
pub fn interval(interval: &Interval, decimals: usize) -> String {
    format!("95 % interval {} to {}", number(interval.low, decimals), number(interval.high, decimals))
}

/// `-26.3 (95 % interval -27.5 to -25.1)`; without one that is none.
pub fn with_interval(estimate: &Interval, decimals: usize) -> String {
    let value = number(estimate.value, decimals);
    if estimate.low < estimate.high { format!("{value} ({})", interval(estimate, decimals)) } else { value }
}

/// A share as a percentage.
pub fn percent(share: f64, decimals: usize) -> String {
    format!("{} %", number(100.0 * share, decimals))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_they_are_read() {
        assert_eq!([number(-0.04, 1), number(-26.35, 1), number(0.0, 2)], ["0.0", "-26.4", "0.00"]);
        assert_eq!([signed(0.04, 1), signed(-0.04, 1), signed(9.3, 1)], ["0.0", "0.0", "+9.3"]);
        assert_eq!([number(f64::NAN, 1), signed(f64::INFINITY, 1), percent(f64::NAN, 0)], ["-", "-", "- %"]);
        let interval = Interval { value: -26.3, low: -27.5, high: -25.1 };
        assert_eq!(plus_minus(&interval, 1), "-26.3 +- 1.2");
        assert_eq!(ends(&interval, 1), "[-27.5, -25.1]");
    }
}
