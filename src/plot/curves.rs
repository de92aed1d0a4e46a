//! Learning curves: what tests returned while a team was trained, one panel per level of communication.

use super::{Figure, Panel, Point, Series};
use crate::base::error::Result;
use crate::base::stats::{mean, std};
use crate::metrics::Metrics;
use crate::usage;

/// The curves of one run, or of runs that differ in their seed: their mean and a band of one standard deviation
/// (unbiased) to both sides, at the timesteps that all have.
///
/// There is one panel for each level with columns `<predictor>/test_p=<level>_return_mean`, from the highest
/// to the lowest, and one line per predictor. Each panel has a range of its own, or what is lost at the lowest
/// level would hide what predictors differ by at the others; and that of what was tested after the first tenth, or
/// what untrained teams return would hide it. A predictor that only some runs have is the mean of these, and
/// the legend says how many.
///
/// # Errors
/// [`Error::Usage`](crate::base::error::Error::Usage) if there is no such column, or no timestep with a test that
/// all runs have.
pub fn curves(runs: &[Metrics], title: &str) -> Result<Figure> {
    let tests: Vec<(&str, f64)> = runs
        .iter()
        .flat_map(|run| &run.columns)
        .filter_map(|column| predictor_and_level(&column.name))
        .collect();
    let mut levels: Vec<f64> = tests.iter().map(|(_, level)| *level).collect();
    levels.sort_by(|a, b| b.total_cmp(a));
    levels.dedup();
    let mut predictors = Vec::new();
    for (predictor, _) in &tests {
        if !predictors.contains(predictor) {
            predictors.push(predictor);
        }
    }
    if levels.is_empty() {
        return Err(usage!(
            "no metrics of tests to plot: there is no column `<predictor>/test_p=<level>_return_mean`"
        ));
    }
    let panel = |level: &f64, series: Vec<Series>| Panel {
        title: format!("p = {level}"),
        x_label: "environment steps".to_owned(),
        y_label: "return per episode".to_owned(),
        fits_from: series
            .iter()
            .flat_map(|series| &series.points)
            .map(|point| 0.1 * point.x)
            .reduce(f64::max),
        series,
        own_range: true,
        ..Panel::default()
    };
    let lines = |level: &f64| predictors.iter().filter_map(|name| series(runs, name, *level)).collect();
    let panels: Vec<Panel> = levels.iter().map(|level| panel(level, lines(level))).collect();
    if panels.iter().flat_map(|panel| &panel.series).all(|series| series.points.is_empty()) {
        return Err(usage!("nothing to plot yet: there is no timestep at which every run was tested"));
    }
    let title = match runs.len() {
        1 => format!("{title} (one run; axes fit the last nine tenths)"),
        n => format!("{title} (mean ± std of {n} runs; axes fit the last nine tenths)"),
    };
    Ok(Figure { title, panels })
}

/// Reads the name of a column.
fn predictor_and_level(column: &str) -> Option<(&str, f64)> {
    let (predictor, level) = column.strip_suffix("_return_mean")?.rsplit_once("/test_p=")?;
    Some((predictor, level.parse().ok()?))
}

/// The line of a predictor at a level, of the runs that have it.
fn series(runs: &[Metrics], predictor: &str, level: f64) -> Option<Series> {
    let name = format!("{predictor}/test_p={level}_return_mean");
    let tested: Vec<_> = runs.iter().filter_map(|run| Some((run, run.column(&name)?))).collect();
    let (first, _) = tested.first()?;
    let returns_at = |timestep: &u64| -> Option<Vec<f64>> {
        let row_of = |run: &Metrics| run.timesteps.binary_search(timestep).ok();
        tested.iter().map(|(run, values)| values[row_of(run)?]).collect()
    };
    let points = first.timesteps.iter().filter_map(|timestep| {
        let returns = returns_at(timestep)?;
        let y = mean(&returns);
        let band = std(&returns).map(|std| (y - std, y + std));
        Some(Point { x: *timestep as f64, y, band })
    });
    let points = points.collect();
    let name = match tested.len() {
        n if n == runs.len() => predictor.to_owned(),
        n => format!("{predictor} ({n} of {} runs)", runs.len()),
    };
    Some(Series { name, points })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Column;

    fn run(timesteps: &[u64], columns: &[(&str, &[Option<f64>])]) -> Metrics {
        let columns = columns
            .iter()
            .map(|(name, values)| Column { name: format!("{name}_return_mean"), values: values.to_vec() });
        Metrics { timesteps: timesteps.to_vec(), columns: columns.collect() }
    }

    #[test]
    fn the_mean_is_over_runs_at_timesteps_that_all_have() {
        let a = run(&[250, 500, 750], &[("maro/test_p=0.2", &[Some(-1.0), None, Some(-3.0)])]);
        let b = run(&[250, 500, 1000], &[("maro/test_p=0.2", &[Some(-5.0), Some(-2.0), Some(-4.0)])]);
        let line = series(&[a.clone(), b], "maro", 0.2).unwrap();
        // Mean -3, variance (2^2 + 2^2) / 1.
        let std = 8f64.sqrt();
        assert_eq!(line.points, [Point { x: 250.0, y: -3.0, band: Some((-3.0 - std, -3.0 + std)) }]);
        let alone = series(&[a], "maro", 0.2).unwrap();
        let points: Vec<_> = alone.points.iter().map(|point| (point.x, point.y, point.band)).collect();
        assert_eq!(points, [(250.0, -1.0, None), (750.0, -3.0, None)]);
    }

    #[test]
    fn a_predictor_of_some_runs_says_so() {
        let a = run(&[250], &[("maro/test_p=1", &[Some(-1.0)])]);
        let b = run(&[250], &[("maro/test_p=1", &[Some(-1.0)]), ("va/test_p=1", &[Some(-2.0)])]);
        let chart = curves(&[a, b], "test").unwrap().to_svg();
        assert!(chart.contains(">maro<") && chart.contains(">va (1 of 2 runs)<"));
    }

    #[test]
    fn axes_fit_what_was_tested_after_the_first_tenth() {
        let values: &[Option<f64>] = &[Some(-9000.0), Some(-7.0), Some(-6.0)];
        let chart = curves(&[run(&[99, 100, 1000], &[("m/test_p=1", values)])], "test").unwrap();
        assert_eq!(chart.panels[0].fits_from, Some(100.0));
        let svg = chart.to_svg();
        assert!(svg.contains(">-7.0</text>") && svg.contains(">-6.0</text>"), "{svg}");
    }

    #[test]
    fn panels_go_from_the_highest_level_to_the_lowest() {
        let values: &[Option<f64>] = &[Some(-1.0)];
        let levels = ["m/test_p=0", "m/test_p=1", "m/test_p=0.5", "training", "m/test_p=often"];
        let columns = levels.map(|name| (name, values));
        let chart = curves(&[run(&[250], &columns)], "test").unwrap();
        let titles: Vec<&str> = chart.panels.iter().map(|panel| &panel.title[..]).collect();
        assert_eq!(titles, ["p = 1", "p = 0.5", "p = 0"]);
    }

    #[test]
    fn nothing_to_draw_is_an_error() {
        let message = |runs: &[Metrics]| curves(runs, "test").unwrap_err().to_string();
        assert!(message(&[run(&[250], &[("training", &[Some(1.0)])])]).contains("no metrics of tests"));
        let at = |timestep| run(&[timestep], &[("maro/test_p=1", &[Some(-1.0)])]);
        assert!(message(&[at(250), at(500)]).contains("no timestep"));
    }
}
