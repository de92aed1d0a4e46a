//! `table.md`: the tables of a paper.

use super::words;
use crate::base::table::counted;
use crate::evaluate::{CellSummary, Claims, Group, Summary};

/// Two tables, a row per group and imputer and a column per condition: mean return and standard deviation over
/// policies, as in the paper's Table II; then mean return, its 95 % interval and the score.
pub fn tables(summary: &Summary) -> String {
    let deviation = |cell: &CellSummary| match cell.seed_std {
        Some(std) => format!("{} +- {}", words::number(cell.mean.value, 1), words::number(std, 1)),
        None => words::number(cell.mean.value, 1),
    };
    let interval = |cell: &CellSummary| {
        let score = cell.score.map(|score| format!("; {}", words::number(score.value, 2)));
        format!(
            "{} {}{}",
            words::number(cell.mean.value, 1),
            words::ends(&cell.mean, 1),
            score.unwrap_or_default()
        )
    };
    format!(
        "Mean return +- standard deviation over policies (seeds), {} each{}:\n\n{}\n\
         Mean return [95 % interval]; score:\n\n{}",
        counted(summary.settings.episodes, "episode"),
        summary.settings.if_other(),
        table(summary, deviation),
        table(summary, interval)
    ) + &summary.groups.iter().map(losses).collect::<String>()
        + &summary.claims.iter().map(claims).collect::<String>()
}

/// What the losses of a group are made of.
fn losses(group: &Group) -> String {
    let paragraph = |loss| format!("\n{}: {}\n", words::group(group), words::loss(loss).join(" "));
    group.losses.iter().map(paragraph).collect()
}

/// Cell by cell and in the mean.
fn claims(claims: &Claims) -> String {
    let line = |what: [String; 2], improvement, std_reduction| {
        row(&[what, words::improvement(improvement, std_reduction)].concat())
    };
    let head = ["task", "p", "mean return better by", "standard deviation smaller by"].map(str::to_owned);
    let cells = claims
        .cells
        .iter()
        .map(|cell| line([cell.task.clone(), cell.p.to_string()], cell.improvement, cell.std_reduction));
    let mean = line(["mean".to_owned(), String::new()], claims.improvement, claims.std_reduction);
    format!(
        "\n{}:\n\n{}|---|---|---|---|\n{}{mean}",
        words::claim(claims),
        row(&head),
        cells.collect::<String>()
    )
}

fn table(summary: &Summary, value: impl Fn(&CellSummary) -> String) -> String {
    let conditions = summary.groups.first().map_or(Vec::new(), words::conditions);
    let header = ["task".to_owned(), "policies".to_owned(), "imputer".to_owned()].into_iter();
    let header: Vec<String> = header.chain(conditions.into_iter().map(words::condition)).collect();
    let mut text = row(&header) + &"|---".repeat(header.len()) + "|\n";
    for group in &summary.groups {
        for imputer in &group.imputers {
            let policies = format!("{}, {}", group.label, words::seeds(summary, group));
            let names = [group.task.clone(), policies, words::played(group, imputer)].into_iter();
            text.push_str(&row(&names.chain(imputer.cells.iter().map(&value)).collect::<Vec<_>>()));
        }
    }
    text
}

/// A line of a table, whatever is in the cells.
fn row(cells: &[String]) -> String {
    let escape = |cell: &String| cell.replace('\\', "\\\\").replace('|', "\\|").replace(['\n', '\r'], " ");
    format!("| {} |\n", cells.iter().map(escape).collect::<Vec<_>>().join(" | "))
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn all_rows_have_all_columns() {
        let (_, mut summary) = fixture::two_tasks();
        summary.groups[0].imputers[2].imputer = "a|b\n".to_owned();
        let text = tables(&summary);
        let tables: Vec<Vec<&str>> = text
            .split("\n\n")
            .filter(|part| part.starts_with('|'))
            .map(|table| table.lines().filter(|line| line.starts_with('|')).collect())
            .collect();
        assert_eq!(tables.iter().map(Vec::len).collect::<Vec<_>>(), [8, 8]);
        for line in tables.concat() {
            assert_eq!(line.replace("\\|", "").matches('|').count(), 8, "{line}");
        }
        assert_eq!(tables[0][0], "| task | policies | imputer | p = 1 | p = 0.2 | p = 0 | dynamic |");
        assert!(text.contains("| hear-see | mappo, seeds 0, 1, 2 | value-aware | -"));
        assert!(text.contains("a\\|b "));
    }

    #[test]
    fn one_policy_has_no_deviation() {
        let (_, mut summary) = fixture::two_tasks();
        let cell = &mut summary.groups[0].imputers[0].cells[0];
        let with =
            |cell: &CellSummary| format!("| {:.1} +- {:.1} |", cell.mean.value, cell.seed_std.unwrap());
        let before = with(cell);
        assert!(tables(&summary).contains(&before));
        let cell = &mut summary.groups[0].imputers[0].cells[0];
        cell.seed_std = None;
        let alone = format!("| value-aware | {:.1} |", cell.mean.value);
        assert!(tables(&summary).contains(&alone));
    }
}
