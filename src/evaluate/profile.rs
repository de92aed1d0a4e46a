//! What a group does along an axis.

use super::axis::Axis;
use super::curve::mean_height;
use super::grouping::distinct;
use super::sample::Sample;
use super::study::Study;
use super::summary::Profile;
use crate::base::stats::mean;

impl Study<'_> {
    /// Axis by axis and imputer by imputer.
    pub(super) fn profiles(&self, axes: &[Axis]) -> Vec<Profile> {
        let imputers = distinct(self.group.cells.iter().map(|cell| cell.imputer));
        let of_axis = |(at, axis)| imputers.iter().filter_map(move |imputer| self.profile(at, axis, imputer));
        axes.iter().enumerate().flat_map(of_axis).collect()
    }

    /// `None` for an imputer that was not played everywhere on the axis.
    fn profile(&self, at: usize, axis: &Axis, imputer: &str) -> Option<Profile> {
        let cell = |condition| self.group.find(imputer, condition);
        let cells: Option<Vec<usize>> = axis.points.iter().map(|point| cell(&point.condition)).collect();
        let cells = cells?;
        let mut points: Vec<(f64, usize)> =
            axis.points.iter().zip(&cells).map(|(point, cell)| (point.value, *cell)).collect();
        points.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let returns = |sample: &Sample| -> Vec<(f64, f64)> {
            points.iter().map(|(value, cell)| (*value, mean(&sample.means(*cell)))).collect()
        };
        let scores = |sample: &Sample| -> Option<Vec<(f64, f64)>> {
            let score = |cell| Some(mean(&sample.scores(cell, self.lossless(cell)?)?));
            points.iter().map(|(value, cell)| Some((*value, score(*cell)?))).collect()
        };
        let difference = |cell: &usize| {
            self.bootstrap.interval(|sample| {
                let (there, first) = sample.paired_means(*cell, cells[0]);
                mean(&there) - mean(&first)
            })
        };
        Some(Profile {
            axis: at,
            imputer: imputer.to_owned(),
            return_area: self.bootstrap.interval_if(|sample| mean_height(&returns(sample)))?,
            score_area: self.bootstrap.interval_if(|sample| mean_height(&scores(sample)?)),
            differences: cells[1..].iter().map(difference).collect(),
        })
    }
}
