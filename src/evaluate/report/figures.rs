//! Figures of an evaluation.

use super::words;
use crate::evaluate::grouping::distinct;
use crate::evaluate::{Axis, CellSummary, Condition, Group, ImputerSummary, Interval};
use crate::plot::{Figure, Form, Panel, Point, Series};

/// Score over p, a panel per group; mean return where there are no scores.
pub fn robustness(groups: &[Group], imputers: &[&str]) -> Figure {
    let panels = groups.iter().filter_map(|group| {
        let levels: Vec<f64> = words::conditions(group).into_iter().filter_map(Condition::p).collect();
        let points = |imputer: &ImputerSummary| {
            let cells = imputer
                .cells
                .iter()
                .filter_map(|cell| Some(Point { x: cell.condition.p()?, ..point(outcome(group, cell)?) }));
            let mut points: Vec<Point> = cells.collect();
            points.sort_by(|a, b| a.x.total_cmp(&b.x));
            points
        };
        let panel = Panel {
            title: words::group(group),
            x_label: "p, probability of delivery".to_owned(),
            y_label: what(group),
            series: series(group, imputers, points),
            x_span: Some((0.0, 1.0)),
            x_ticks: levels,
            own_range: true,
            ..Panel::default()
        };
        panel.series.iter().any(|series| !series.points.is_empty()).then_some(panel)
    });
    Figure { title: title(groups, "over p"), panels: panels.collect() }
}

/// The same over the values of each axis: a panel per group and axis.
pub fn sweeps(groups: &[Group], axes: &[Axis], imputers: &[&str]) -> Figure {
    let panel = |group: &Group, axis: &Axis| {
        let points = |imputer: &ImputerSummary| {
            let points = axis.points.iter().filter_map(|at| {
                let cell = words::cell(imputer, &at.condition)?;
                Some(Point { x: at.value, ..point(outcome(group, cell)?) })
            });
            let mut points: Vec<Point> = points.collect();
            points.sort_by(|a, b| a.x.total_cmp(&b.x));
            points
        };
        Panel {
            title: panel_title(groups, group, &axis.links),
            x_label: axis.parameter.clone(),
            y_label: what(group),
            series: series(group, imputers, points),
            x_ticks: axis.points.iter().map(|point| point.value).collect(),
            own_range: true,
            ..Panel::default()
        }
    };
    let panels = groups.iter().flat_map(|group| axes.iter().map(move |axis| panel(group, axis)));
    Figure { title: title(groups, "over a parameter of the links"), panels: panels.collect() }
}

/// The same without a fixed p, apart from axes: a panel per group and condition, a row per imputer.
pub fn modes(groups: &[Group], axes: &[Axis], imputers: &[&str]) -> Figure {
    let is_mode =
        |condition: &Condition| condition.p().is_none() && !axes.iter().any(|axis| axis.has(condition));
    let value = |group: &Group, _: &ImputerSummary, cell: &CellSummary| outcome(group, cell);
    Figure {
        title: title(groups, "under other conditions"),
        panels: rows(groups, imputers, is_mode, what, value),
    }
}

/// The paired difference to the baseline under all conditions where anything can be lost, a panel for each, a row per
/// imputer. Of several groups at their two lowest levels.
pub fn difference(groups: &[Group], imputers: &[&str]) -> Figure {
    let is_baseline = |group: &Group, imputer: &str| group.baseline.as_deref() == Some(imputer);
    let compared: Vec<Group> = groups.iter().filter(|group| is_compared(group)).cloned().collect();
    let lowest = |condition: &Condition| {
        let levels = compared.iter().flat_map(words::conditions).filter_map(Condition::p);
        let mut lossy = distinct(levels.filter(|p| *p < 1.0));
        lossy.sort_by(f64::total_cmp);
        lossy.iter().take(2).any(|p| Some(*p) == condition.p())
    };
    let is_shown =
        |condition: &Condition| !condition.is_lossless() && (groups.len() == 1 || lowest(condition));
    // The baseline is the line at zero.
    let value = |group: &Group, imputer: &ImputerSummary, cell: &CellSummary| {
        if is_baseline(group, &imputer.imputer) {
            return Some(Interval::default());
        }
        cell.comparison.map(|comparison| comparison.difference)
    };
    let label = |_: &Group| "difference of return".to_owned();
    let baselines = distinct(compared.iter().filter_map(|group| group.baseline.as_deref()));
    Figure {
        title: format!("Difference of return to {}, with 95 % intervals", baselines.join(" or ")),
        panels: rows(&compared, imputers, is_shown, label, value),
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
                title: panel_title(groups, group, words::quantity(unit)),
                x_label: "steps since last received".to_owned(),
                y_label: format!("RMSE, {}", words::unit(unit)),
                series: series(group, imputers, points),
                own_range: true,
                ..Panel::default()
            }
        })
    });
    Figure { title: "Error of what was imputed, over levels below 1".to_owned(), panels: panels.collect() }
}

/// Whether imputers were compared with a baseline anywhere.
fn is_compared(group: &Group) -> bool {
    let mut cells = group.imputers.iter().flat_map(|imputer| &imputer.cells);
    cells.any(|cell| cell.comparison.is_some())
}

/// What came of a cell: its score, or its mean return in a group without scores.
fn outcome(group: &Group, cell: &CellSummary) -> Option<Interval> {
    if words::has_scores(group) { cell.score } else { Some(cell.mean) }
}

/// What that is. Returns of different tasks have nothing in common.
fn what(group: &Group) -> String {
    if words::has_scores(group) { "score".to_owned() } else { format!("return, {}", group.task) }
}

fn title(groups: &[Group], how: &str) -> String {
    let scored = groups.iter().filter(|group| words::has_scores(group)).count();
    let what = match groups.len() - scored {
        0 => "Score",
        _ if scored == 0 => "Mean return",
        _ => "Score, or mean return where there is none,",
    };
    format!("{what} {how}, with 95 % intervals")
}

/// What tells a panel from others: its group, unless there is one group alone, and what else it is about.
fn panel_title(groups: &[Group], group: &Group, about: &str) -> String {
    if groups.len() == 1 { about.to_owned() } else { format!("{}, {about}", words::group(group)) }
}

/// Panels of rows: one per group and condition that is shown, if there is a value.
fn rows(
    groups: &[Group],
    imputers: &[&str],
    is_shown: impl Fn(&Condition) -> bool,
    label: impl Fn(&Group) -> String,
    value: impl Fn(&Group, &ImputerSummary, &CellSummary) -> Option<Interval>,
) -> Vec<Panel> {
    let panel = |group: &Group, at: usize, condition: &Condition| {
        let points = |imputer: &ImputerSummary| {
            let value = imputer.cells.get(at).and_then(|cell| value(group, imputer, cell));
            value.map(point).into_iter().collect()
        };
        Panel {
            title: panel_title(groups, group, &words::condition(condition)),
            x_label: label(group),
            series: series(group, imputers, points),
            form: Form::Rows,
            own_range: true,
            ..Panel::default()
        }
    };
    let panels = groups.iter().flat_map(|group| {
        let conditions = words::conditions(group).into_iter().enumerate();
        let shown = conditions.filter(|(_, condition)| is_shown(condition));
        shown.map(|(at, condition)| panel(group, at, condition)).collect::<Vec<_>>()
    });
    panels.filter(|panel| panel.series.iter().any(|series| !series.points.is_empty())).collect()
}

fn point(Interval { value, low, high }: Interval) -> Point {
    Point { x: 0.0, y: value, band: (low < high).then_some((low, high)) }
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

    fn names(panel: &Panel) -> Vec<&str> {
        panel.series.iter().map(|series| &series.name[..]).collect()
    }

    fn titles(figure: &Figure) -> Vec<&str> {
        figure.panels.iter().map(|panel| &panel.title[..]).collect()
    }

    #[test]
    fn scores_stand_over_the_levels() {
        let (_, mut summary) = fixture::two_tasks();
        let imputers = words::imputers(&summary);
        let figure = robustness(&summary.groups, &imputers);
        assert_eq!(titles(&figure), ["hear-see: mappo", "spread-xy-2: mappo"]);
        let panel = &figure.panels[0];
        assert_eq!((&panel.y_label[..], names(panel)), ("score", vec!["value-aware", "maro", "hold"]));
        assert_eq!(panel.x_ticks, [1.0, 0.2, 0.0]);
        // From p = 0 on, without the mode.
        let Interval { value: y, low, high } = summary.groups[0].imputers[0].cells[1].score.unwrap();
        let points = &panel.series[0].points;
        assert_eq!(points.iter().map(|point| point.x).collect::<Vec<_>>(), [0.0, 0.2, 1.0]);
        assert_eq!(points[1], Point { x: 0.2, y, band: Some((low, high)) });
        // Where there are no scores, mean returns stand in for them.
        fixture::forget_scores(&mut summary.groups[1]);
        let figure = robustness(&summary.groups, &["hold"]);
        assert!(figure.title.starts_with("Score, or mean return"), "{}", figure.title);
        assert_eq!(figure.panels[1].y_label, "return, spread-xy-2");
        let mean = summary.groups[1].imputers[2].cells[1].mean.value;
        assert_eq!(figure.panels[1].series[0].points[1].y, mean);
    }

    #[test]
    fn modes_have_a_figure_of_their_own() {
        let (_, mut summary) = fixture::two_tasks();
        let imputers = ["value-aware", "maro", "hold"];
        let figure = modes(&summary.groups, &[], &imputers);
        assert_eq!(titles(&figure), ["hear-see: mappo, dynamic", "spread-xy-2: mappo, dynamic"]);
        assert_eq!(titles(&modes(&summary.groups[..1], &[], &imputers)), ["dynamic"]);
        let score = summary.groups[0].imputers[2].cells[3].score.unwrap();
        assert_eq!(figure.panels[0].series[2].points, [point(score)]);
        for imputer in summary.groups.iter_mut().flat_map(|group| &mut group.imputers) {
            imputer.cells.retain(|cell| cell.condition.p().is_none());
        }
        assert!(robustness(&summary.groups, &imputers).panels.is_empty());
        assert_eq!(modes(&summary.groups, &[], &imputers).panels.len(), 2);
    }

    #[test]
    fn the_baseline_is_the_zero_line_of_differences() {
        let (_, mut summary) = fixture::two_tasks();
        let imputers = ["value-aware", "maro", "hold"];
        // Of several groups at the two lowest levels, of one wherever anything can be lost.
        let all = difference(&summary.groups, &imputers);
        assert_eq!(
            titles(&all),
            [
                "hear-see: mappo, p = 0.2",
                "hear-see: mappo, p = 0",
                "spread-xy-2: mappo, p = 0.2",
                "spread-xy-2: mappo, p = 0"
            ]
        );
        let one = difference(&summary.groups[..1], &imputers);
        assert_eq!(titles(&one), ["p = 0.2", "p = 0", "dynamic"]);
        let series = &one.panels[1].series;
        assert_eq!(series[1].points, [Point { x: 0.0, y: 0.0, band: None }]);
        assert!(series[0].points[0].y > 0.0 && series[2].points[0].y < 0.0);
        fixture::forget_baseline(&mut summary.groups[1]);
        let figure = difference(&summary.groups, &imputers);
        assert_eq!(figure.panels.len(), 2, "without a baseline there is nothing to compare with");
        assert!(figure.title.contains("to maro,"), "{}", figure.title);
    }

    #[test]
    fn errors_stand_over_their_age() {
        let (_, summary) = fixture::two_tasks();
        let figure = error_by_age(&summary.groups, &words::imputers(&summary));
        let labels: Vec<&str> = figure.panels.iter().map(|panel| &panel.y_label[..]).collect();
        assert_eq!(labels, ["RMSE, m", "RMSE, m/s", "RMSE, m", "RMSE, m/s"]);
        assert_eq!(titles(&figure)[..2], ["hear-see: mappo, positions", "hear-see: mappo, velocities"]);
        let errors = &summary.groups[0].imputers[2].errors[1].ages[3];
        assert_eq!(
            figure.panels[1].series[2].points[3],
            Point { x: 4.0, y: errors.rmse().unwrap(), band: None }
        );
    }
}
