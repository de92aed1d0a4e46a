//! Figures of an evaluation. Conditions without a level of their own are in the tables alone.

use super::words;
use crate::evaluate::grouping::distinct;
use crate::evaluate::{CellSummary, Group, ImputerSummary, Interval};
use crate::plot::{Figure, Panel, Point, Series};

/// Mean return over p, a panel per group.
pub fn robustness(groups: &[Group], imputers: &[&str]) -> Figure {
    let mean = |_: &Group, _: &ImputerSummary, cell: &CellSummary| Some(cell.mean);
    Figure {
        title: "Mean return over p, with 95 % intervals".to_owned(),
        panels: groups.iter().filter_map(|group| over_p(group, imputers, "return", &mean)).collect(),
    }
}

/// The paired difference to the baseline over p, a panel per group that was compared with one at some level.
pub fn difference(groups: &[Group], imputers: &[&str]) -> Figure {
    // The baseline is the zero line, and where nothing can be lost all are.
    let difference = |group: &Group, imputer: &ImputerSummary, cell: &CellSummary| match &cell.comparison {
        Some(comparison) => Some(comparison.difference),
        None if group.baseline.as_ref() == Some(&imputer.imputer) => Some(Interval::default()),
        None => (cell.condition.p() == Some(1.0)).then(Interval::default),
    };
    let compared = groups.iter().filter(|group| {
        let mut cells = group.imputers.iter().flat_map(|imputer| &imputer.cells);
        cells.any(|cell| cell.comparison.is_some() && cell.condition.p().is_some())
    });
    let baselines = distinct(compared.clone().filter_map(|group| group.baseline.as_deref()));
    Figure {
        title: format!("Difference of return to {}, with 95 % intervals", baselines.join(" or ")),
        panels: compared.filter_map(|group| over_p(group, imputers, "difference", &difference)).collect(),
    }
}

/// RMSE of what was imputed by steps since last received, a panel per group and unit.
pub fn error_by_age(groups: &[Group], imputers: &[&str]) -> Figure {
    let panels = groups.iter().flat_map(|group| {
        words::units(group).into_iter().map(|unit| {
            let points = |imputer: &ImputerSummary| {
                let errors = imputer.errors.iter().filter(|errors| errors.unit == unit);
                let ages = errors.flat_map(|errors| errors.ages.iter().enumerate());
                ages.filter_map(|(index, errors)| {
                    Some(Point { x: (index + 1) as f64, y: errors.rmse()?, band: None })
                })
                .collect()
            };
            Panel {
                title: words::group(group),
                x_label: "steps since last received".to_owned(),
                y_label: format!("RMSE, {}", words::unit(unit)),
                series: series(group, imputers, points),
                ..Panel::default()
            }
        })
    });
    Figure { title: "Error of what was imputed, over levels below 1".to_owned(), panels: panels.collect() }
}

/// The panel of an estimate over p; `None` if the group has it at no level.
fn over_p(
    group: &Group,
    imputers: &[&str],
    what: &str,
    estimate: &dyn Fn(&Group, &ImputerSummary, &CellSummary) -> Option<Interval>,
) -> Option<Panel> {
    let points = |imputer: &ImputerSummary| {
        let cells = imputer.cells.iter().filter_map(|cell| {
            let Interval { value, low, high } = estimate(group, imputer, cell)?;
            Some(Point { x: cell.condition.p()?, y: value, band: Some((low, high)) })
        });
        let mut points: Vec<Point> = cells.collect();
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        points
    };
    let panel = Panel {
        title: words::group(group),
        x_label: "p, probability of delivery".to_owned(),
        // Returns of different tasks have nothing in common.
        y_label: format!("{what}, {}", group.task),
        series: series(group, imputers, points),
        x_span: Some((0.0, 1.0)),
    };
    panel.series.iter().any(|series| !series.points.is_empty()).then_some(panel)
}

/// A series for each of all imputers, so that each looks the same in all figures; empty for those that the
/// group was not played with.
fn series(group: &Group, imputers: &[&str], points: impl Fn(&ImputerSummary) -> Vec<Point>) -> Vec<Series> {
    let series = |name: &&str| Series {
        name: (*name).to_owned(),
        points: words::imputer(group, name).map(&points).unwrap_or_default(),
    };
    imputers.iter().map(series).collect()
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;

    #[test]
    fn returns_stand_over_the_levels() {
        let (_, summary) = fixture::two_tasks();
        let imputers = words::imputers(&summary);
        let figure = robustness(&summary.groups, &imputers);
        assert_eq!(figure.panels.len(), 2);
        let panel = &figure.panels[0];
        assert_eq!((&panel.title[..], &panel.y_label[..]), ("hear-see: mappo", "return, hear-see"));
        let names: Vec<&str> = panel.series.iter().map(|series| &series.name[..]).collect();
        assert_eq!(names, ["value-aware", "maro", "hold"]);
        // From p = 0 on, without the mode.
        let Interval { value: y, low, high } = summary.groups[0].imputers[0].cells[1].mean;
        let points = &panel.series[0].points;
        assert_eq!(points.iter().map(|point| point.x).collect::<Vec<_>>(), [0.0, 0.2, 1.0]);
        assert_eq!(points[1], Point { x: 0.2, y, band: Some((low, high)) });
    }

    #[test]
    fn the_baseline_is_the_zero_line_of_differences() {
        let (_, mut summary) = fixture::two_tasks();
        fixture::forget_baseline(&mut summary.groups[1]);
        let imputers = words::imputers(&summary);
        let figure = difference(&summary.groups, &imputers);
        assert_eq!(figure.panels.len(), 1, "without a baseline there is nothing to compare with");
        assert!(figure.title.contains("to maro,"), "{}", figure.title);
        let series = &figure.panels[0].series;
        assert!(series[1].points.iter().all(|point| point.y == 0.0) && series[1].points.len() == 3);
        assert_eq!(series[0].points[2].y, 0.0, "where nothing is lost");
        assert!(series[0].points[0].y > 0.0);
    }

    #[test]
    fn errors_stand_over_their_age() {
        let (_, summary) = fixture::two_tasks();
        let figure = error_by_age(&summary.groups, &words::imputers(&summary));
        let labels: Vec<&str> = figure.panels.iter().map(|panel| &panel.y_label[..]).collect();
        assert_eq!(labels, ["RMSE, m", "RMSE, m/s", "RMSE, m", "RMSE, m/s"]);
        let errors = &summary.groups[0].imputers[2].errors[1].ages[3];
        assert_eq!(
            figure.panels[1].series[2].points[3],
            Point { x: 4.0, y: errors.rmse().unwrap(), band: None }
        );
    }

    #[test]
    fn modes_alone_give_no_figure() {
        let (_, mut summary) = fixture::two_tasks();
        for imputer in summary.groups.iter_mut().flat_map(|group| &mut group.imputers) {
            imputer.cells.retain(|cell| cell.condition.p().is_none());
        }
        assert!(robustness(&summary.groups, &["hold"]).panels.is_empty());
    }
}
