//! A panel of a figure, and the lines in it.

/// One pair of axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// Stands above the panel, and tells it from the others.
    pub title: String,
    /// What x is, with its unit.
    pub x_label: String,
    /// What y is, with its unit. Rows have none.
    pub y_label: String,
    /// From back to front; rows from top to bottom.
    pub series: Vec<Series>,
    /// How series are drawn.
    pub form: Form,
    /// What the x axis spans at least.
    pub x_span: Option<(f64, f64)>,
    /// Where the x axis has ticks; at round numbers if that is nowhere.
    pub x_ticks: Vec<f64>,
    /// The y axis reaches the values from this x on. Lines and bands that are beyond it before stay at its end.
    pub fits_from: Option<f64>,
    /// The axis of values has a range of its own, also where other panels have one with the same label.
    pub own_range: bool,
}

/// How the series of a panel are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    /// Points joined by a line over x, each value with its band above and below.
    #[default]
    Lines,
    /// A row for each series, with the values of its points from left to right, and bands as bars.
    Rows,
}

/// A line, or a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in the legend.
    pub name: String,
    /// In the order they are joined. Points that are not finite are left out. A name without any point is not in
    /// the legend, but keeps its place: the names after it look as they do where it has some.
    pub points: Vec<Point>,
}

/// A point of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// From left to right; of no meaning in a row.
    pub x: f64,
    /// The value.
    pub y: f64,
    /// The low and the high end of the band around the value.
    pub band: Option<(f64, f64)>,
}

impl Panel {
    /// The series that have points.
    pub(super) fn drawn(&self) -> impl Iterator<Item = &Series> {
        self.series.iter().filter(|series| !series.points.is_empty())
    }

    /// What stands to the left of each row, from top to bottom.
    pub(super) fn row_names(&self) -> Vec<&str> {
        match self.form {
            Form::Lines => Vec::new(),
            Form::Rows => self.drawn().map(|series| &series.name[..]).collect(),
        }
    }
}

impl Point {
    /// What the axis of values must reach.
    pub(super) fn values(&self) -> [f64; 3] {
        let (low, high) = self.band.unwrap_or((self.y, self.y));
        [low, self.y, high]
    }

    /// Whether it has a place on linear axes.
    pub(super) fn is_finite(&self) -> bool {
        self.x.is_finite() && self.values().into_iter().all(f64::is_finite)
    }
}
