//! The part of `report.html` about one group.

use super::html::{Cell, Html, Table};
use super::{figures, words};
use crate::evaluate::{CellSummary, Comparison, Group, Interval, Summary, UnitErrors};
use crate::plot::Figure;

/// Figures and tables of a group.
pub fn group(html: &mut Html, summary: &Summary, group: &Group) {
    html.element(
        "p",
        &format!(
            "{} ({}); uniformly random actions return {} {}.",
            words::policies(group.contenders.len()),
            words::seeds(summary, group),
            words::number(group.random.value, 1),
            words::ends(&group.random, 1)
        ),
    );
    let imputers = words::imputers(summary);
    let groups = std::slice::from_ref(group);
    html.raw("<div class=\"pair\">");
    figure(html, &figures::robustness(groups, &imputers));
    figure(html, &figures::difference(groups, &imputers));
    html.raw("</div>");

    html.element("h3", "Return");
    let several = group.contenders.len() > 1;
    let over_policies = if several { "standard deviation over policies, " } else { "" };
    let caption = format!("Mean return, its 95 % interval, {over_policies}interquartile mean, and score.");
    html.table(&by_condition(group, caption, |cell| Some(outcome(cell))));
    let mut cells = group.imputers.iter().flat_map(|imputer| &imputer.cells);
    let is_compared = cells.any(|cell| cell.comparison.is_some());
    if let Some(baseline) = group.baseline.as_ref().filter(|_| is_compared) {
        html.element("h3", &format!("Against {baseline}"));
        let caption = format!(
            "Paired difference of return to {baseline}, its 95 % interval, the same as a share, and how often it is \
             better{}.",
            if several { "; the ratio of the standard deviations over policies" } else { "" }
        );
        html.table(&by_condition(group, caption, |cell| cell.comparison.as_ref().map(compared)));
    }
    html.element("h3", "Over all p");
    html.table(&over_p(group));
    if !group.losses.is_empty() {
        html.element("h3", "What the loss is made of");
        group.losses.iter().for_each(|loss| html.element("p", &words::loss(loss).join(" ")));
    }
    let errors = figures::error_by_age(groups, &imputers);
    if !errors.panels.is_empty() {
        html.element("h3", "What was imputed");
        figure(html, &errors);
        html.table(&errors_of(group));
    }
}

/// A figure, if there is something to see.
fn figure(html: &mut Html, figure: &Figure) {
    if !figure.panels.is_empty() {
        html.raw(&format!("<figure>{}</figure>", figure.to_svg()));
    }
}

/// A table with a row per imputer and a column per condition, without those that have nothing to say.
fn by_condition(group: &Group, caption: String, cell: impl Fn(&CellSummary) -> Option<Cell>) -> Table {
    let says = |at: &usize| group.imputers.iter().any(|imputer| cell(&imputer.cells[*at]).is_some());
    let conditions = words::conditions(group);
    let columns: Vec<usize> = (0..conditions.len()).filter(says).collect();
    let names = columns.iter().map(|at| words::condition(conditions[*at]));
    let rows = group.imputers.iter().filter_map(|imputer| {
        let cells: Vec<Option<Cell>> = columns.iter().map(|at| cell(&imputer.cells[*at])).collect();
        let says = cells.iter().any(Option::is_some);
        let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(|| Cell::of("-")));
        says.then(|| (words::played(group, imputer), cells.collect()))
    });
    Table {
        caption,
        columns: std::iter::once("imputer".to_owned()).chain(names).collect(),
        rows: rows.collect(),
    }
}

fn outcome(cell: &CellSummary) -> Cell {
    let mut notes = vec![words::ends(&cell.mean, 1)];
    notes.extend(cell.seed_std.map(|std| format!("std {}", words::number(std, 1))));
    notes.push(format!("IQM {}", words::number(cell.iqm.value, 1)));
    notes.extend(cell.score.map(|score| format!("score {}", words::number(score.value, 2))));
    Cell { value: words::number(cell.mean.value, 1), notes, strong: false }
}

fn compared(comparison: &Comparison) -> Cell {
    let Comparison { difference, relative, probability_of_improvement, std_ratio } = comparison;
    let mut notes = vec![
        words::ends(difference, 1),
        format!("{} %", words::signed(100.0 * relative, 1)),
        format!("better in {}", words::percent(probability_of_improvement.value, 0)),
    ];
    notes.extend(std_ratio.map(|ratio| format!("std ratio {}", words::number(ratio, 2))));
    let strong = difference.low > 0.0 || difference.high < 0.0;
    Cell { value: words::signed(difference.value, 1), notes, strong }
}

fn over_p(group: &Group) -> Table {
    let columns = ["imputer", "return area", "score area", "p for 90 %"];
    let rows = group.imputers.iter().map(|imputer| {
        let p_for_90 = imputer
            .p_for_90
            .map_or(Cell::of("-"), |p| Cell { value: words::p_for_90(imputer, &p), ..estimate(Some(p), 2) });
        let cells = [estimate(imputer.return_area, 1), estimate(imputer.score_area, 3), p_for_90];
        (words::played(group, imputer), cells.to_vec())
    });
    Table {
        caption: "What the curves come to, with 95 % intervals.".to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}

fn estimate(interval: Option<Interval>, decimals: usize) -> Cell {
    let Some(interval) = interval else { return Cell::of("-") };
    let notes = vec![words::ends(&interval, decimals)];
    Cell { value: words::number(interval.value, decimals), notes, strong: false }
}

/// Errors at some ages, and how they compare with what predictors said of them.
fn errors_of(group: &Group) -> Table {
    let columns = ["imputer", "unit", "after 1 step", "after 5 steps", "all"];
    let cells = |errors: &UnitErrors| {
        let at = |age: usize| errors.ages.get(age - 1).copied().unwrap_or_default();
        let errors_at = [at(1), at(5), words::all_ages(errors)];
        let cells = errors_at.map(|errors| {
            let Some(rmse) = errors.rmse() else { return Cell::of("-") };
            let notes = errors.calibration.map_or(Vec::new(), |stated| {
                let share = |part: u64| part as f64 / stated.count as f64;
                vec![
                    format!("{} in 50 %", words::percent(share(stated.within_50), 1)),
                    format!("{} in 95 %", words::percent(share(stated.within_95), 1)),
                    format!("z^2 {}", words::number(stated.z_squared / stated.count as f64, 2)),
                ]
            });
            Cell { value: words::number(rmse, 4), notes, strong: false }
        });
        [&[Cell::of(words::unit(errors.unit))], &cells[..]].concat()
    };
    let rows = group.imputers.iter().flat_map(|imputer| {
        let errors = imputer.errors.iter().filter(|errors| words::all_ages(errors).count > 0);
        errors.map(|errors| (words::played(group, imputer), cells(errors)))
    });
    Table {
        caption: "RMSE of values last received so many steps ago; for predictors that say how sure they are, the share \
                  of true values in the 50 % and 95 % intervals they stated."
            .to_owned(),
        columns: columns.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}
