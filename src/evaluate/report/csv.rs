//! `summary.csv`, `episodes.csv` and `errors.csv`: rows for spreadsheets and data frames.

use csv::Writer;

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
    let rows = summary.groups.iter().flat_map(|group| {
        let cells = group.imputers.iter().flat_map(|of| of.cells.iter().map(move |cell| (of, cell)));
        cells.map(move |(imputer, cell)| summary_row(group, imputer, cell))
    });
    table(SUMMARY, rows)
}

fn summary_row(group: &Group, imputer: &ImputerSummary, cell: &CellSummary) -> Vec<String> {
    let mut row = vec![
        group.task.clone(),
        group.label.clone(),
        cell.seed_means.len().to_string(),
        imputer.imputer.clone(),
    ];
    let comparison = cell.comparison.as_ref();
    row.extend(condition(&cell.condition));
    row.extend(interval(Some(cell.mean)));
    row.extend(interval(Some(cell.iqm)));
    row.push(optional(cell.seed_std));
    row.extend(interval(cell.score));
    row.push(comparison.and(group.baseline.clone()).unwrap_or_default());
    row.extend(interval(comparison.map(|comparison| comparison.difference)));
    row.push(optional(comparison.map(|comparison| comparison.relative)));
    row.extend(interval(comparison.map(|comparison| comparison.probability_of_improvement)));
    row.push(optional(comparison.and_then(|comparison| comparison.std_ratio)));
    row
}

/// A row per episode of each cell; those of uniform actions have no policy.
pub fn episodes(evaluation: &Evaluation) -> String {
    let none = String::new;
    let random = evaluation.random.iter().map(|random| {
        let cell = [random.task.clone(), none(), none(), none(), none()];
        (cell, &random.returns)
    });
    let played = evaluation.cells.iter().map(|cell| {
        let contender = &evaluation.contenders[cell.contender];
        let [name, level] = condition(&cell.condition);
        let cell_of = [contender.task.clone(), contender.name.clone(), cell.imputer.clone(), name, level];
        (cell_of, &cell.outcome.returns)
    });
    let rows = random.chain(played).flat_map(|(cell, returns)| {
        let episodes = returns.iter().enumerate();
        episodes.map(move |(episode, value)| {
            cell.clone().into_iter().chain([episode.to_string(), value.to_string()]).collect()
        })
    });
    table(EPISODES, rows)
}

/// A row per group, imputer, unit and age of which there were values.
pub fn errors(summary: &Summary) -> String {
    let imputers = summary.groups.iter().flat_map(|group| group.imputers.iter().map(move |of| (group, of)));
    let units = imputers.flat_map(|(group, of)| of.errors.iter().map(move |errors| (group, of, errors)));
    let rows = units.flat_map(|(group, of, errors)| {
        let ages = errors.ages.iter().enumerate().filter(|(_, errors)| errors.count > 0);
        ages.map(move |(index, at_age)| {
            let unit = errors.unit.symbol().to_owned();
            let age = (index + 1).to_string();
            let names = [group.task.clone(), group.label.clone(), of.imputer.clone(), unit, age];
            names.into_iter().chain(errors_row(at_age)).collect()
        })
    });
    table(ERRORS, rows)
}

fn errors_row(errors: &AgeErrors) -> [String; 5] {
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
}

/// CSV text: a header and rows.
fn table(header: &str, rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut writer = Writer::from_writer(Vec::new());
    let header = header.split(',').map(str::to_owned).collect();
    for row in std::iter::once(header).chain(rows) {
        writer.write_record(&row).expect("memory takes everything, and all rows are as long as the header");
    }
    String::from_utf8(writer.into_inner().expect("memory takes everything")).expect("fields are text")
}

/// A condition in two fields: its name and its level.
fn condition(condition: &Condition) -> [String; 2] {
    [condition.name().to_owned(), optional(condition.p())]
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
        let row = ["runs/hs-0", "a,b \"c\"\n", ""].map(str::to_owned).to_vec();
        assert_eq!(table("a,b,c", [row].into_iter()), "a,b,c\nruns/hs-0,\"a,b \"\"c\"\"\n\",\n");
    }
}
