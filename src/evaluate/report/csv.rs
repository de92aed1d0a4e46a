//! `summary.csv`, `episodes.csv` and `errors.csv`: rows for spreadsheets and data frames.

use std::fmt::Write;

use crate::evaluate::{
    AgeErrors, Calibration, CellSummary, Condition, Evaluation, Group, ImputerSummary, Interval, Summary,
};

const SUMMARY: &str = "task,label,policies,imputer,condition,p,mean,mean_low,mean_high,iqm,iqm_low,iqm_high,\
                       seed_std,score,score_low,score_high,baseline,difference,difference_low,difference_high,\
                       relative,improvement,improvement_low,improvement_high,std_ratio";
const EPISODES: &str = "task,policy,imputer,condition,p,episode,return";
const ERRORS: &str = "task,label,imputer,unit,age,count,rmse,coverage_50,coverage_95,z_squared";

/// A row per group, imputer and condition.
pub fn summary(summary: &Summary) -> String {
    let mut text = format!("{SUMMARY}\n");
    for group in &summary.groups {
        for imputer in &group.imputers {
            for cell in &imputer.cells {
                text.push_str(&summary_row(group, imputer, cell).join(","));
                text.push('\n');
            }
        }
    }
    text
}

fn summary_row(group: &Group, imputer: &ImputerSummary, cell: &CellSummary) -> Vec<String> {
    let mut row = vec![
        field(&group.task),
        field(&group.label),
        cell.seed_means.len().to_string(),
        field(&imputer.imputer),
        condition(&cell.condition),
    ];
    let comparison = cell.comparison.as_ref();
    row.extend(interval(Some(cell.mean)));
    row.extend(interval(Some(cell.iqm)));
    row.push(optional(cell.seed_std));
    row.extend(interval(cell.score));
    row.push(comparison.and(group.baseline.as_deref()).map_or(String::new(), field));
    row.extend(interval(comparison.map(|comparison| comparison.difference)));
    row.push(optional(comparison.map(|comparison| comparison.relative)));
    row.extend(interval(comparison.map(|comparison| comparison.probability_of_improvement)));
    row.push(optional(comparison.and_then(|comparison| comparison.std_ratio)));
    row
}

/// A row per episode of each cell; those of uniform actions have no policy.
pub fn episodes(evaluation: &Evaluation) -> String {
    let mut text = format!("{EPISODES}\n");
    let mut add = |cell: &str, returns: &[f64]| {
        for (episode, value) in returns.iter().enumerate() {
            writeln!(text, "{cell},{episode},{value}").expect("a string takes everything");
        }
    };
    for random in &evaluation.random {
        add(&format!("{},,,,", field(&random.task)), &random.returns);
    }
    for cell in &evaluation.cells {
        let contender = &evaluation.contenders[cell.contender];
        let (task, name, imputer) = (field(&contender.task), field(&contender.name), field(&cell.imputer));
        add(&format!("{task},{name},{imputer},{}", condition(&cell.condition)), &cell.outcome.returns);
    }
    text
}

/// A row per group, imputer, unit and age of which there were values.
pub fn errors(summary: &Summary) -> String {
    let mut text = format!("{ERRORS}\n");
    for group in &summary.groups {
        for imputer in &group.imputers {
            for errors in &imputer.errors {
                let cell = [&group.task, &group.label, &imputer.imputer].map(|name| field(name)).join(",");
                let unit = errors.unit.symbol();
                for (index, errors) in errors.ages.iter().enumerate().filter(|(_, errors)| errors.count > 0) {
                    let row = errors_row(errors);
                    writeln!(text, "{cell},{unit},{},{row}", index + 1).expect("a string takes everything");
                }
            }
        }
    }
    text
}

fn errors_row(errors: &AgeErrors) -> String {
    let calibration = errors.calibration;
    let share = |part: fn(&Calibration) -> f64| {
        optional(calibration.map(|stated| part(&stated) / stated.count as f64))
    };
    [
        errors.count.to_string(),
        optional(errors.rmse()),
        share(|stated| stated.within_50 as f64),
        share(|stated| stated.within_95 as f64),
        share(|stated| stated.z_squared),
    ]
    .join(",")
}

/// A condition in two fields: its name and its level.
fn condition(condition: &Condition) -> String {
    format!("{},{}", field(condition.name()), optional(condition.p()))
}

/// An estimate and the ends of its interval, in three fields.
fn interval(interval: Option<Interval>) -> [String; 3] {
    match interval {
        Some(Interval { value, low, high }) => [value, low, high].map(|number| number.to_string()),
        None => Default::default(),
    }
}

/// The shortest decimal text that gives the same f64, or nothing.
fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

/// Text as a field, in quotes where it must be (RFC 4180).
fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    fn rows(text: &str) -> Vec<Vec<&str>> {
        text.lines().map(|line| line.split(',').collect()).collect()
    }

    #[test]
    fn there_is_a_row_for_each_cell_and_a_field_for_each_column() {
        let (evaluation, all) = fixture::two_tasks();
        let cells: usize =
            all.groups.iter().flat_map(|group| &group.imputers).map(|imputer| imputer.cells.len()).sum();
        let played: usize = evaluation.cells.iter().map(|cell| cell.outcome.returns.len()).sum();
        let random: usize = evaluation.random.iter().map(|random| random.returns.len()).sum();
        for (text, n_rows) in
            [(summary(&all), cells), (episodes(&evaluation), played + random), (errors(&all), 72)]
        {
            let rows = rows(&text);
            assert_eq!(rows.len(), n_rows + 1, "{}", rows[0].join(","));
            assert!(rows.iter().all(|row| row.len() == rows[0].len()), "{}", rows[0].join(","));
        }
    }

    #[test]
    fn values_stand_in_their_columns() {
        let (_, all) = fixture::two_tasks();
        let text = summary(&all);
        let rows = rows(&text);
        let at =
            |row: usize, column: &str| rows[row][rows[0].iter().position(|name| *name == column).unwrap()];
        let cell = &all.groups[0].imputers[0].cells[1];
        assert_eq!([at(2, "task"), at(2, "policies"), at(2, "imputer")], ["hear-see", "3", "value-aware"]);
        assert_eq!([at(2, "condition"), at(2, "p"), at(2, "baseline")], ["level", "0.2", "maro"]);
        assert_eq!(at(2, "mean_high").parse(), Ok(cell.mean.high));
        assert_eq!(at(2, "score").parse(), Ok(cell.score.unwrap().value));
        let comparison = cell.comparison.unwrap();
        assert_eq!(at(2, "improvement_low").parse(), Ok(comparison.probability_of_improvement.low));
        assert_eq!(at(2, "relative").parse(), Ok(comparison.relative));
        assert_eq!([at(4, "condition"), at(4, "p")], ["dynamic", ""]);
        assert_eq!([at(1, "baseline"), at(1, "difference"), at(1, "std_ratio")], ["", "", ""]);
    }

    #[test]
    fn headers_are_those_of_the_docs() {
        let docs = include_str!("../../../docs/formats.md");
        for header in [SUMMARY, EPISODES, ERRORS] {
            let documented = |header: &str| docs.contains(&format!("\n{header}\n"));
            assert!(documented(header), "docs/formats.md has not the line {header}");
        }
    }

    #[test]
    fn names_are_quoted_where_they_must_be() {
        assert_eq!(field("runs/hs-0"), "runs/hs-0");
        assert_eq!(field("a,b \"c\"\n"), "\"a,b \"\"c\"\"\n\"");
    }
}
