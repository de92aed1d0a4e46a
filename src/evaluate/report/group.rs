//! The part of `report.html` about one group.

use maud::{Markup, PreEscaped, html};

use super::table::{Cell, Table, on_demand};
use super::{REPLAYS, figures, findings, words};
use crate::evaluate::grouping::distinct;
use crate::evaluate::{
    AgeErrors, Axis, Calibration, CellSummary, Comparison, Group, ImputerSummary, Interval, Profile, Replay,
    Summary,
};
use crate::plot::Figure;

/// Of fewer policies a standard deviation is a guess, and the ratio of two says nothing.
const FEWEST_FOR_RATIOS: usize = 3;

/// What was found of a group, figures and tables, and where these of its episodes are to be seen.
pub fn group(summary: &Summary, group: &Group, replays: &[&Replay]) -> Markup {
    let imputers = words::imputers(summary);
    let groups = std::slice::from_ref(group);
    let is_alone = summary.groups.len() == 1;
    let findings = if is_alone { Vec::new() } else { findings::of_group(summary, group) };
    let errors = figures::error_by_age(groups, &imputers);
    html! {
        @if !findings.is_empty() { p { (findings.join(" ")) } }
        p {
            (words::policies(group.contenders.len())) " (" (words::seeds(summary, group)) "); uniformly random actions \
            return " (words::number(group.random.value, 1)) " " (words::ends(&group.random, 1)) "."
        }
        div.figures {
            // Of one group alone it is at the top of the page.
            @if !is_alone { (figure(&figures::robustness(groups, &imputers))) }
            (figure(&figures::sweeps(groups, &summary.axes, &imputers)))
            (figure(&figures::modes(groups, &summary.axes, &imputers)))
            (figure(&figures::difference(groups, &imputers)))
        }
        (outcomes(group))
        (comparisons(group))
        (to_see(summary, replays))
        h3 { "Over all p" }
        (over_p(group))
        @for (at, axis) in summary.axes.iter().enumerate() {
            h3 { "Over " (axis.parameter) ", " (axis.links) }
            (over_axis(group, at, axis))
        }
        @if !group.losses.is_empty() {
            h3 { "What the loss is made of" }
            @for loss in &group.losses { p { (words::loss(loss).join(" ")) } }
        }
        @if !errors.panels.is_empty() {
            h3 { "What was imputed" }
            (figure(&errors))
            (imputed(group))
        }
    }
}

/// A figure, if there is something to see.
pub fn figure(figure: &Figure) -> Markup {
    html! { @if !figure.panels.is_empty() { figure { (PreEscaped(figure.to_svg())) } } }
}

/// A number of each cell; on demand, what else is known of it.
fn outcomes(group: &Group) -> Markup {
    let table =
        |caption: &str, cell: &dyn Fn(&CellSummary) -> Option<Cell>| by_condition(group, caption, cell);
    let mean = table("Mean return.", &|cell| Some(Cell::of(words::number(cell.mean.value, 1))));
    let score =
        table("Score: 0 is what random actions return, 1 what the same policies return at p = 1.", &|cell| {
            Some(Cell::of(words::number(cell.score?.value, 2)))
        });
    let more = [
        table("Mean return, 95 % interval.", &|cell| Some(Cell::of(words::ends(&cell.mean, 1)))),
        table("Score, 95 % interval.", &|cell| Some(Cell::of(words::ends(&cell.score?, 2)))),
        table("Interquartile mean of the return.", &|cell| Some(Cell::of(words::number(cell.iqm.value, 1)))),
        table("Standard deviation of the mean return over policies.", &|cell| {
            Some(Cell::of(words::number(cell.seed_std?, 1)))
        }),
    ];
    html! {
        h3 { "Return and score" }
        @for table in [score, mean].into_iter().flatten() { (table.markup()) }
        (on_demand("Intervals, interquartile means, deviations", &more.into_iter().flatten().collect::<Vec<_>>()))
    }
}

/// The same of what was compared with a baseline.
fn comparisons(group: &Group) -> Markup {
    let table = |caption: &str, cell: &dyn Fn(&Comparison) -> Option<Cell>| {
        by_condition(group, caption, &|of| cell(of.comparison.as_ref()?))
    };
    let Some(baseline) = &group.baseline else { return html! {} };
    let caption = format!(
        "Mean difference of return to {baseline}, episode by episode; bold where the 95 % interval leaves out zero."
    );
    let Some(difference) = table(&caption, &|comparison| Some(difference(comparison))) else {
        return html! {};
    };
    let more = [
        table("The difference, 95 % interval.", &|comparison| {
            Some(Cell::of(words::ends(&comparison.difference, 1)))
        }),
        table(&format!("The difference as a share of the mean return with {baseline}."), &|comparison| {
            Some(Cell::of(format!("{} %", words::signed(100.0 * comparison.relative, 1))))
        }),
        table(&format!("Episodes that go better than with {baseline}."), &|comparison| {
            Some(Cell::of(words::percent(comparison.probability_of_improvement.value, 0)))
        }),
        table(
            &format!(
                "Standard deviation over {} policies, divided by that with {baseline}: with so few it is rough.",
                group.contenders.len()
            ),
            &|comparison| {
                let ratio = comparison.std_ratio.filter(|_| group.contenders.len() >= FEWEST_FOR_RATIOS)?;
                Some(Cell::of(words::number(ratio, 2)))
            },
        ),
    ];
    html! {
        h3 { "Against " (baseline) }
        (difference.markup())
        (on_demand("Intervals, shares, how often it is better", &more.into_iter().flatten().collect::<Vec<_>>()))
    }
}

/// A row per imputer, with links to its best and its worst episode.
fn to_see(summary: &Summary, replays: &[&Replay]) -> Markup {
    let Some(first) = replays.first() else { return html! {} };
    let cell = |replay: &Replay| {
        let policy = match summary.contenders.len() {
            1 => String::new(),
            _ => format!(", {}", summary.contenders[replay.contender].name),
        };
        let told =
            format!("{} (episode {}{policy})", words::number(replay.episode_return, 1), replay.episode);
        Cell { link: Some(format!("{REPLAYS}/{}", replay.file())), ..Cell::of(told) }
    };
    let rows = distinct(replays.iter().map(|replay| &replay.imputer)).into_iter().map(|imputer| {
        let of_it = replays.iter().filter(|replay| replay.imputer == *imputer);
        (imputer.clone(), of_it.map(|replay| cell(replay)).collect())
    });
    let table = Table {
        caption: "Return of the best and of the worst episode. Each link plays the episode, beside the same one at p = 1, \
                  where everything is delivered."
            .to_owned(),
        columns: ["imputer", "best", "worst"].map(str::to_owned).to_vec(),
        rows: rows.collect(),
    };
    html! { h3 { "Episodes to see, at p = " (first.p) } (table.markup()) }
}

/// Bold where it is surely a difference, and one that can be read.
fn difference(comparison: &Comparison) -> Cell {
    let Interval { value, low, high } = comparison.difference;
    let is_there = words::number(value, 1) != words::number(0.0, 1);
    Cell { strong: (low > 0.0 || high < 0.0) && is_there, ..Cell::of(words::signed(value, 1)) }
}

/// A table with a row per imputer and a column per condition, without those that have nothing to say; `None` if none
/// has.
fn by_condition(group: &Group, caption: &str, cell: &dyn Fn(&CellSummary) -> Option<Cell>) -> Option<Table> {
    let says = |at: &usize| group.imputers.iter().any(|imputer| cell(&imputer.cells[*at]).is_some());
    let conditions = words::conditions(group);
    let columns: Vec<usize> = (0..conditions.len()).filter(says).collect();
    let names = columns.iter().map(|at| words::condition(conditions[*at]));
    let rows = group.imputers.iter().filter_map(|imputer| {
        let cells: Vec<Option<Cell>> = columns.iter().map(|at| cell(&imputer.cells[*at])).collect();
        let says = cells.iter().any(Option::is_some);
        let cells = cells.into_iter().map(|cell| cell.unwrap_or_else(Cell::none));
        says.then(|| (words::played(group, imputer), cells.collect()))
    });
    (!columns.is_empty()).then(|| Table {
        caption: caption.to_owned(),
        columns: std::iter::once("imputer".to_owned()).chain(names).collect(),
        rows: rows.collect(),
    })
}

/// What the curves over p come to.
fn over_p(group: &Group) -> Markup {
    let table = |caption: &str, cells: &dyn Fn(&ImputerSummary) -> [Option<String>; 3]| Table {
        caption: caption.to_owned(),
        columns: ["imputer", "area under the return", "area under the score", "p for 90 % of the score"]
            .map(str::to_owned)
            .to_vec(),
        rows: group
            .imputers
            .iter()
            .map(|imputer| {
                let cells = cells(imputer).map(|cell| cell.map_or_else(Cell::none, Cell::of));
                (words::played(group, imputer), cells.to_vec())
            })
            .collect(),
    };
    let number = |estimate: Option<Interval>, decimals| Some(words::number(estimate?.value, decimals));
    let ends = |estimate: Option<Interval>, decimals| Some(words::ends(&estimate?, decimals));
    let values = table("What the curves over p come to.", &|imputer| {
        let p_for_90 = imputer.p_for_90.map(|p| words::p_for_90(imputer, &p));
        [number(imputer.return_area, 1), number(imputer.score_area, 3), p_for_90]
    });
    let intervals = table("The same, 95 % intervals.", &|imputer| {
        [ends(imputer.return_area, 1), ends(imputer.score_area, 3), ends(imputer.p_for_90, 2)]
    });
    html! { (values.markup()) (on_demand("Intervals", &[intervals])) }
}

/// What the curves over an axis come to, and how far its points are from the first.
fn over_axis(group: &Group, at: usize, axis: &Axis) -> Markup {
    let profiles = words::profiles(group, at);
    let areas = ["imputer", "area under the return", "area under the score"].map(str::to_owned).into_iter();
    let others = (1..axis.points.len()).map(|at| words::value(axis, at));
    let table = |caption: String, estimate: &dyn Fn(&Interval, usize) -> String| Table {
        caption,
        columns: areas.clone().chain(others.clone()).collect(),
        rows: profiles
            .iter()
            .map(|Profile { imputer, return_area, score_area, differences, .. }| {
                let score = score_area.map_or_else(Cell::none, |area| Cell::of(estimate(&area, 3)));
                let differences = differences.iter().map(|of| Cell::of(estimate(of, 1)));
                let cells = [Cell::of(estimate(return_area, 1)), score].into_iter().chain(differences);
                (imputer.clone(), cells.collect())
            })
            .collect(),
    };
    let caption = format!(
        "What the curves come to, and the paired differences of return to {}.",
        words::value(axis, 0)
    );
    let values = table(caption, &|interval, decimals| words::number(interval.value, decimals));
    let intervals = table("The same, 95 % intervals.".to_owned(), &words::ends);
    html! { (values.markup()) (on_demand("Intervals", &[intervals])) }
}

/// Errors at some ages; on demand, how they compare with what predictors said of them.
fn imputed(group: &Group) -> Markup {
    let table = |caption: &str, cell: &dyn Fn(&AgeErrors) -> Option<Cell>| {
        let rows = group.imputers.iter().flat_map(|imputer| {
            let errors = imputer.errors.iter().filter(|errors| words::all_ages(errors).count > 0);
            errors.filter_map(|errors| {
                let at = |age: usize| errors.ages.get(age - 1).copied().unwrap_or_default();
                let cells = [at(1), at(5), words::all_ages(errors)].map(|errors| cell(&errors));
                let says = cells.iter().any(Option::is_some);
                let cells = cells.map(|cell| cell.unwrap_or_else(Cell::none));
                let unit = Cell::of(words::unit(errors.unit));
                says.then(|| (words::played(group, imputer), [&[unit], &cells[..]].concat()))
            })
        });
        Table {
            caption: caption.to_owned(),
            columns: ["imputer", "unit", "after 1 step", "after 5 steps", "all"].map(str::to_owned).to_vec(),
            rows: rows.collect(),
        }
    };
    let stated = |caption: &str, value: &dyn Fn(&Calibration) -> String| {
        table(caption, &|errors| Some(Cell::of(value(errors.calibration.as_ref()?))))
    };
    let share = |part: u64, stated: &Calibration| words::percent(part as f64 / stated.count as f64, 1);
    let more = [
        stated("True values within the 50 % interval that the predictor stated.", &|of| {
            share(of.within_50, of)
        }),
        stated("True values within the 95 % interval that it stated.", &|of| share(of.within_95, of)),
        stated(
            "Mean of the squared error in units of the standard deviation that it stated; 1 is right.",
            &|of| words::number(of.z_squared / of.count as f64, 2),
        ),
    ];
    let more: Vec<Table> = more.into_iter().filter(|table| !table.rows.is_empty()).collect();
    html! {
        (table("RMSE of values last received so many steps ago.", &|errors| {
            Some(Cell::of(words::number(errors.rmse()?, 4)))
        }).markup())
        (on_demand("How sure predictors are, and may be", &more))
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    fn text(summary: &Summary) -> String {
        group(summary, &summary.groups[0], &[]).into_string()
    }

    #[test]
    fn what_rounds_to_nothing_is_not_bold() {
        let of = |value: f64, low: f64, high: f64| {
            let (_, summary) = fixture::two_tasks();
            let comparison = summary.groups[0].imputers[0].cells[1].comparison.unwrap();
            difference(&Comparison { difference: Interval { value, low, high }, ..comparison })
        };
        let strong = |value: &str| Cell { strong: true, ..Cell::of(value) };
        assert_eq!(of(0.04, 0.01, 0.07), Cell::of("0.0"));
        assert_eq!(of(-0.04, -0.07, -0.01), Cell::of("0.0"));
        assert_eq!([of(0.06, 0.01, 0.09), of(-3.0, -4.0, -2.0)], ["+0.1", "-3.0"].map(strong));
        assert_eq!(of(3.0, -1.0, 7.0), Cell::of("+3.0"));
    }

    #[test]
    fn a_cell_has_one_number_and_intervals_are_on_demand() {
        let (_, summary) = fixture::two_tasks();
        let text = text(&summary);
        let (shown, on_demand): (Vec<&str>, Vec<&str>) = {
            let parts = || text.split("<details>");
            let shown = parts().map(|part| part.rsplit("</details>").next().unwrap());
            let hidden = parts().skip(1).map(|part| part.split("</details>").next().unwrap());
            (shown.collect(), hidden.collect())
        };
        let interval = words::ends(&summary.groups[0].imputers[0].cells[1].mean, 1);
        assert!(on_demand.concat().contains(&format!("<td>{interval}</td>")));
        for cell in shown.concat().split("<td>").skip(1).map(|cell| cell.split("</td>").next().unwrap()) {
            let words = cell.replace("<strong>", "").replace("</strong>", "");
            let is_number = words.parse::<f64>().is_ok();
            assert!(is_number || ["-", "m", "m/s"].contains(&&words[..]), "{words}");
        }
    }

    #[test]
    fn deviations_of_two_policies_have_no_ratio() {
        let (_, mut summary) = fixture::two_tasks();
        assert!(text(&summary).contains("Standard deviation over 3 policies, divided by that with maro"));
        summary.groups.remove(0);
        assert!(!text(&summary).contains("divided by"), "two policies");
    }
}
