//! What a terminal shows of an evaluation.

use super::words;
use crate::base::table::{counted, table, tables, wrapped};
use crate::evaluate::{
    Axis, CellSummary, Comparison, Condition, Group, ImputerSummary, Interval, Profile, Summary,
};

const ORACLES: &str = "NAME+oracle:PART is not an imputer: its agents are told that part of the truth,\nand NAME imputes the rest\n";

/// Tables of every group: return and score under each condition, and what a curve comes to; then the claims.
pub fn text(summary: &Summary) -> String {
    let groups = summary.groups.iter().map(|group| {
        let heading = format!(
            "{}, {} ({}), {} each{}",
            words::group(group),
            words::policies(group.contenders.len()),
            words::seeds(summary, group),
            counted(summary.settings.episodes, "episode"),
            summary.settings.if_other()
        );
        let random = format!("\nuniform actions {}\n\n", words::plus_minus(&group.random, 1));
        let heading = wrapped(&heading, 2) + &random;
        let axes: String =
            summary.axes.iter().enumerate().map(|(at, axis)| over_axis(group, at, axis)).collect();
        [heading, outcomes(group), overall(group), differences(group), axes, losses(group)].concat()
    });
    let claims = summary.claims.iter().map(|claims| wrapped(&words::claim(claims), 2) + "\n");
    let legend = "x +- y: half the width of the 95 % interval, over episodes of these policies;\n\
                  how far policies (seeds) are apart is their standard deviation (std)\n"
        .to_owned();
    let oracles = if words::has_oracles(&words::imputers(summary)) { ORACLES } else { "" };
    let legend = legend + oracles;
    std::iter::once(legend).chain(groups).chain(claims).collect::<Vec<_>>().join("\n")
}

/// Return and score, an imputer in each row and a condition in each column.
fn outcomes(group: &Group) -> String {
    let names: Vec<String> = words::conditions(group).into_iter().map(words::condition).collect();
    let mut header = vec!["mean return"];
    header.extend(names.iter().map(String::as_str));
    let cells = |imputer: &'_ ImputerSummary, value: &dyn Fn(&CellSummary) -> String| {
        let cells = imputer.cells.iter().map(value);
        std::iter::once(words::played(group, imputer)).chain(cells).collect::<Vec<_>>()
    };
    let means = |imputer| cells(imputer, &|cell| words::plus_minus(&cell.mean, 1));
    let scores = |imputer| {
        cells(imputer, &|cell| cell.score.map_or("-".into(), |score| words::number(score.value, 2)))
    };
    let deviations =
        |imputer| cells(imputer, &|cell| cell.seed_std.map_or("-".into(), |std| words::number(std, 1)));
    let mut rows: Vec<Vec<String>> = group.imputers.iter().map(means).collect();
    if group.contenders.len() > 1 {
        rows.push(vec!["std over policies".to_owned()]);
        rows.extend(group.imputers.iter().map(deviations));
    }
    if group.imputers.iter().flat_map(|imputer| &imputer.cells).any(|cell| cell.score.is_some()) {
        rows.push(vec!["score".to_owned()]);
        rows.extend(group.imputers.iter().map(scores));
    }
    tables(&header, &rows)
}

/// Areas and p for 90 % of the score, if there is more than one level.
fn overall(group: &Group) -> String {
    if words::conditions(group).into_iter().filter_map(Condition::p).count() < 2 {
        return String::new();
    }
    let row = |imputer| std::iter::once(words::played(group, imputer)).chain(curve(imputer)).collect();
    let rows = group.imputers.iter().map(row);
    format!("\n{}", table(&["over p", "return area", "score area", "p for 90 %"], rows))
}

/// Differences to the baseline at the two lowest levels.
fn differences(group: &Group) -> String {
    let Some(baseline) = &group.baseline else { return String::new() };
    let levels = words::conditions(group).into_iter().filter_map(Condition::p);
    let mut levels: Vec<f64> = levels.filter(|level| *level < 1.0).collect();
    levels.sort_by(f64::total_cmp);
    levels.truncate(2);
    if levels.is_empty() {
        return String::new();
    }
    let names: Vec<String> = levels.iter().map(|p| format!("vs {baseline}, p = {p}")).collect();
    let header: Vec<&str> = std::iter::once("difference").chain(names.iter().map(String::as_str)).collect();
    let rows = group.imputers.iter().map(|imputer| {
        let at = |p: &f64| imputer.cells.iter().find(|cell| cell.condition.p() == Some(*p));
        let comparisons = levels.iter().map(|p| at(p).and_then(|cell| cell.comparison));
        let words = comparisons.map(|comparison| {
            comparison.map_or("-".to_owned(), |Comparison { difference, .. }| signed(&difference))
        });
        std::iter::once(words::played(group, imputer)).chain(words).collect()
    });
    format!("\n{}", tables(&header, &rows.collect::<Vec<_>>()))
}

/// Areas over an axis, and differences to its first value.
fn over_axis(group: &Group, at: usize, axis: &Axis) -> String {
    let heading = format!("over {}", axis.parameter);
    let others =
        (1..axis.points.len()).map(|at| format!("{}, vs {}", words::value(axis, at), axis.points[0].value));
    let header = [heading, "return area".to_owned(), "score area".to_owned()].into_iter().chain(others);
    let header: Vec<String> = header.collect();
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let row = |Profile { imputer, return_area, score_area, differences, .. }: &&Profile| {
        let score = score_area.map_or("-".to_owned(), |area| words::plus_minus(&area, 3));
        let areas = [imputer.clone(), words::plus_minus(return_area, 1), score].into_iter();
        areas.chain(differences.iter().map(signed)).collect()
    };
    let rows: Vec<Vec<String>> = words::profiles(group, at).iter().map(row).collect();
    format!("\n{}\n{}", axis.links, tables(&header, &rows))
}

/// A difference and half the width of its interval.
fn signed(difference: &Interval) -> String {
    let half = (difference.high - difference.low) / 2.0;
    format!("{} +- {}", words::signed(difference.value, 1), words::number(half, 1))
}

/// What a curve over levels comes to.
fn curve(imputer: &ImputerSummary) -> [String; 3] {
    let estimate = |interval: &Option<_>, decimals| {
        interval.as_ref().map_or("-".to_owned(), |interval| words::plus_minus(interval, decimals))
    };
    let p_for_90 = |p: Interval| format!("{} {}", words::p_for_90(imputer, &p), words::ends(&p, 2));
    [
        estimate(&imputer.return_area, 1),
        estimate(&imputer.score_area, 3),
        imputer.p_for_90.map_or("-".to_owned(), p_for_90),
    ]
}

/// What the losses are made of: a line for each sentence.
fn losses(group: &Group) -> String {
    let line = |(at, sentence): (usize, String)| {
        let indent = if at == 0 { "" } else { "  " };
        format!("\n{}", wrapped(&format!("{indent}{sentence}"), 4))
    };
    let lines = group.losses.iter().flat_map(|loss| words::loss(loss).into_iter().enumerate().map(line));
    let lines: String = lines.collect();
    if lines.is_empty() { lines } else { lines + "\n" }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    fn wide() -> Summary {
        let conditions = fixture::conditions(&[
            "1",
            "0.8",
            "0.6",
            "0.4",
            "0.2",
            "0",
            "uniform",
            "asymmetric",
            "dynamic",
            "gilbert(0.1, 0.3) + delay(1, 1)",
        ]);
        let tasks = [("spread-xy-4", -834.0, 3), ("hear-see", -24.0, 1)];
        let imputers = ["value-aware", "maro", "hold"];
        fixture::played(&tasks, &conditions, &imputers, 1000).1
    }

    #[test]
    fn it_fits_a_terminal_and_leaves_nothing_out() {
        let summary = wide();
        let text = text(&summary);
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert!(text.contains("spread-xy-4: mappo, 3 policies (seeds 0, 1, 2), 1000 episodes each\nuniform"));
        assert!(text.contains("hear-see: mappo, 1 policy (seed 0), "));
        for group in &summary.groups {
            for cell in group.imputers.iter().flat_map(|imputer| &imputer.cells) {
                assert!(text.contains(&words::plus_minus(&cell.mean, 1)));
            }
        }
        for mode in [
            "uniform",
            "asymmetric",
            "dynamic",
            "p = 0.6",
            "gilbert(0.1, 0.3) + delay(1, 1)",
            "vs maro, p = 0.2",
        ] {
            assert_eq!(text.matches(&format!("  {mode}")).count(), 2, "{mode}\n{text}");
        }
    }

    #[test]
    fn without_a_baseline_or_levels_there_is_still_a_table() {
        let (_, mut summary) = fixture::two_tasks();
        summary.groups.truncate(1);
        fixture::forget_baseline(&mut summary.groups[0]);
        for imputer in &mut summary.groups[0].imputers {
            imputer.cells.retain(|cell| cell.condition.p().is_none());
            imputer.cells.iter_mut().for_each(|cell| cell.score = None);
            (imputer.return_area, imputer.score_area, imputer.p_for_90) = (None, None, None);
        }
        let text = text(&summary);
        assert!(text.contains("dynamic") && !text.contains("vs maro"), "{text}");
        let rows = text.lines().filter(|line| line.starts_with("hold"));
        assert_eq!(rows.map(|row| row.split_whitespace().count()).collect::<Vec<_>>(), [4, 2]);
    }
}
