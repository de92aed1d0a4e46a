//! Where the panels of a figure stand, and what is in them.

use super::axis::{Axis, Scale};
use super::drawing::{Anchor, Drawing, Face, Ink};
use super::figure::{LINE, MARGIN, width, wrap};
use super::panel::{Form, Panel, Point, Series};
use super::style::TEXT;

/// Where panels stand, and their axes.
pub(super) struct Grid {
    /// Where the last panel ends.
    pub bottom: f64,
    places: Vec<Place>,
}

/// Where a panel stands.
struct Place {
    /// Left, top, right and bottom of what its axes enclose.
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
    /// Room for text to the left of it.
    gutter: f64,
    x_axis: Axis,
    /// `None` for rows.
    y_axis: Option<Axis>,
    title: Vec<String>,
    labelled: Labelled,
}

/// What a panel says itself, rather than its neighbour.
#[derive(Clone, Copy)]
struct Labelled {
    /// What x is; otherwise the panel below says it.
    x: bool,
    /// What y is, or which rows there are; otherwise the panel to the left says it.
    y: bool,
}

/// Height of the lines of a panel that stands alone, and of one beside another.
const HEIGHTS: [f64; 2] = [260.0, 150.0];
const ROW: f64 = 22.0;
/// Between what the axes of two neighbours enclose, without the text in between.
const GAP: f64 = 26.0;
/// What an axis with ticks needs at least.
const NARROWEST: f64 = 120.0;
/// The most points of a line that are marked. More would hide it.
const MARKED: usize = 12;

impl Grid {
    /// On a page of this width, from `top` downwards.
    pub(super) fn new(panels: &[Panel], page: f64, top: f64, scales: [Scale; 2]) -> Grid {
        let y_axes: Vec<Option<Axis>> = panels.iter().map(|panel| y_axis(panels, panel, scales[1])).collect();
        let within = |columns: usize| {
            let labelled: Vec<Labelled> =
                (0..panels.len()).map(|index| labelled(panels, index, columns)).collect();
            let gutters: Vec<f64> = (0..columns)
                .map(|column| {
                    let of_column = (column..panels.len()).step_by(columns);
                    let widths = of_column.map(|at| gutter(&panels[at], y_axes[at].as_ref(), labelled[at].y));
                    widths.fold(0.0, f64::max)
                })
                .collect();
            let room = page - 2.0 * MARGIN - gutters.iter().sum::<f64>() - GAP * columns as f64;
            (labelled, gutters, room / columns as f64)
        };
        let most = panels.len().clamp(1, 2);
        let (labelled, gutters, panel_width) =
            Some(within(most)).filter(|(.., width)| *width >= NARROWEST).unwrap_or_else(|| within(1));
        let columns = gutters.len();
        let (mut places, mut y, mut y_axes) = (Vec::new(), top, y_axes.into_iter());
        for (row, of_row) in panels.chunks(columns).enumerate() {
            let titles: Vec<Vec<String>> =
                of_row.iter().map(|panel| wrap(&panel.title, panel_width, TEXT)).collect();
            y += LINE * titles.iter().map(Vec::len).max().unwrap_or_default() as f64;
            let heights = of_row.iter().map(|panel| match panel.form {
                Form::Lines => HEIGHTS[columns - 1],
                Form::Rows => ROW * panel.row_names().len() as f64,
            });
            let height = heights.fold(0.0, f64::max);
            let mut left = MARGIN;
            for (column, (panel, title)) in of_row.iter().zip(titles).enumerate() {
                left += gutters[column];
                let height =
                    if panel.form == Form::Rows { ROW * panel.row_names().len() as f64 } else { height };
                places.push(Place {
                    left,
                    top: y,
                    right: left + panel_width,
                    bottom: y + height,
                    gutter: gutters[column],
                    x_axis: x_axis(panels, panel, scales[0], panel_width),
                    y_axis: y_axes.next().expect("there is one for each panel"),
                    title,
                    labelled: labelled[row * columns + column],
                });
                left += panel_width + GAP;
            }
            let says_x = places[row * columns..].iter().any(|place| place.labelled.x);
            y += height + LINE + if says_x { LINE } else { 0.0 } + 8.0;
        }
        Grid { bottom: y + 4.0, places }
    }

    /// Draws a panel, the `index`-th of the figure, whose series are called so.
    pub(super) fn draw(&self, drawing: &mut Drawing, index: usize, panel: &Panel, names: &[&str]) {
        let place = &self.places[index];
        place.draw_x_axis(drawing, panel);
        place.draw_y_axis(drawing, panel);
        let style = |series: &Series| {
            names.iter().position(|name| *name == series.name).expect("names are of these series")
        };
        let styled: Vec<(usize, &Series)> = panel.drawn().map(|series| (style(series), series)).collect();
        match &place.y_axis {
            Some(y_axis) => {
                styled.iter().for_each(|(style, series)| place.draw_band(drawing, y_axis, *style, series));
                styled.iter().for_each(|(style, series)| place.draw_line(drawing, y_axis, *style, series));
            }
            None => {
                for (row, (style, series)) in styled.into_iter().enumerate() {
                    place.draw_row(drawing, row, style, series);
                }
            }
        }
    }
}

impl Place {
    fn x(&self, value: f64) -> f64 {
        self.left + (self.right - self.left) * self.x_axis.position(value)
    }

    fn y(&self, y_axis: &Axis, value: f64) -> f64 {
        self.top + (self.bottom - self.top) * (1.0 - y_axis.position(value).clamp(0.0, 1.0))
    }

    /// With the title of the panel. A number that would run into the one before is left out.
    fn draw_x_axis(&self, drawing: &mut Drawing, panel: &Panel) {
        let &Place { left, top, right, bottom, .. } = self;
        for (line, text) in self.title.iter().rev().enumerate() {
            drawing.text(Face::Panel, (left, top - 8.0 - line as f64 * LINE), Anchor::Start, text);
        }
        let mut free = f64::NEG_INFINITY;
        for (value, text) in &self.x_axis.ticks {
            let (x, half) = (self.x(*value), 0.5 * width(text, TEXT));
            match panel.form {
                Form::Lines => drawing.path(Ink::Axis, [(x, bottom), (x, bottom + 4.0)]),
                Form::Rows if *value == 0.0 => drawing.path(Ink::Axis, [(x, top), (x, bottom + 4.0)]),
                Form::Rows => drawing.path(Ink::Grid, [(x, top), (x, bottom + 4.0)]),
            }
            if x - half > free {
                drawing.text(Face::Text, (x, bottom + 20.0), Anchor::Middle, text);
                free = x + half + 4.0;
            }
        }
        drawing.path(Ink::Axis, [(left, bottom), (right, bottom)]);
        if self.labelled.x {
            let at = (0.5 * (left + right), bottom + 20.0 + LINE);
            drawing.text(Face::Text, at, Anchor::Middle, &panel.x_label);
        }
    }

    /// Numbers with lines across, or the names of rows.
    fn draw_y_axis(&self, drawing: &mut Drawing, panel: &Panel) {
        let beside = |drawing: &mut Drawing, y: f64, text: &str| {
            drawing.text(Face::Text, (self.left - 8.0, y + 0.35 * TEXT), Anchor::End, text);
        };
        if let Some(y_axis) = &self.y_axis {
            for (value, text) in &y_axis.ticks {
                let y = self.y(y_axis, *value);
                drawing.path(Ink::Grid, [(self.left, y), (self.right, y)]);
                beside(drawing, y, text);
            }
        }
        if self.labelled.y {
            for (row, name) in panel.row_names().into_iter().enumerate() {
                beside(drawing, self.row(row), name);
            }
            let x = self.left - self.gutter + 0.8 * TEXT;
            if !panel.y_label.is_empty() {
                drawing.upward_text((x, 0.5 * (self.top + self.bottom)), &panel.y_label);
            }
        }
    }

    /// The middle of a row.
    fn row(&self, row: usize) -> f64 {
        self.top + (row as f64 + 0.5) * ROW
    }

    fn draw_band(&self, drawing: &mut Drawing, y_axis: &Axis, style: usize, series: &Series) {
        let points = self.points(y_axis, series);
        let bands: Vec<_> = points.iter().filter_map(|point| Some((self.x(point.x), point.band?))).collect();
        let low = bands.iter().map(|(x, (low, _))| (*x, self.y(y_axis, *low)));
        let high = bands.iter().rev().map(|(x, (_, high))| (*x, self.y(y_axis, *high)));
        if bands.len() > 1 {
            drawing.path(Ink::Band(style), low.chain(high));
        }
    }

    fn draw_line(&self, drawing: &mut Drawing, y_axis: &Axis, style: usize, series: &Series) {
        let points = self.points(y_axis, series);
        let places: Vec<_> = points.iter().map(|point| (self.x(point.x), self.y(y_axis, point.y))).collect();
        if places.len() > 1 {
            drawing.path(Ink::Line(style), places.iter().copied());
        }
        if places.len() <= MARKED {
            places.into_iter().for_each(|place| drawing.marker(style, place));
        }
    }

    fn draw_row(&self, drawing: &mut Drawing, row: usize, style: usize, series: &Series) {
        let y = self.row(row);
        for point in series.points.iter().filter(|point| point.is_finite()) {
            if let Some((low, high)) = point.band {
                drawing.path(Ink::Bar(style), [(self.x(low), y), (self.x(high), y)]);
            }
            drawing.marker(style, (self.x(point.y), y));
        }
    }

    /// The points that have a place.
    fn points<'a>(&self, y_axis: &Axis, series: &'a Series) -> Vec<&'a Point> {
        let finite = |point: &&Point| {
            let ys = point.values().map(|value| y_axis.position(value));
            self.x_axis.position(point.x).is_finite() && ys.into_iter().all(f64::is_finite)
        };
        series.points.iter().filter(finite).collect()
    }
}

fn labelled(panels: &[Panel], index: usize, columns: usize) -> Labelled {
    let panel = &panels[index];
    let below = panels.get(index + columns);
    let left = (!index.is_multiple_of(columns)).then(|| &panels[index - 1]);
    let same = |left: &Panel| (&left.y_label, left.row_names()) == (&panel.y_label, panel.row_names());
    Labelled {
        x: below.is_none_or(|below| below.x_label != panel.x_label),
        y: left.is_none_or(|left| !same(left)),
    }
}

/// Room for what stands to the left of a panel.
fn gutter(panel: &Panel, y_axis: Option<&Axis>, labelled: bool) -> f64 {
    let numbers = y_axis.into_iter().flat_map(|axis| &axis.ticks).map(|(_, text)| width(text, TEXT));
    let names = panel.row_names();
    let names = names.iter().filter(|_| labelled).map(|name| width(name, TEXT));
    let label = if labelled && !panel.y_label.is_empty() { LINE } else { 0.0 };
    numbers.chain(names).fold(0.0, f64::max) + label + 8.0
}

/// The axis of a panel's values and of those it shares the label with; `None` for rows.
fn y_axis(panels: &[Panel], panel: &Panel, scale: Scale) -> Option<Axis> {
    let of =
        |other: &&Panel| std::ptr::eq(*other, panel) || !panel.own_range && other.y_label == panel.y_label;
    let values = panels.iter().filter(of).flat_map(values);
    (panel.form == Form::Lines).then(|| Axis::new(scale, values, 5))
}

/// The same from left to right: of x, or of the values of rows.
fn x_axis(panels: &[Panel], panel: &Panel, scale: Scale, room: f64) -> Axis {
    let of = |other: &&Panel| {
        let own = panel.form == Form::Rows && panel.own_range;
        std::ptr::eq(*other, panel) || !own && other.x_label == panel.x_label
    };
    let along = |panel: &Panel| -> Vec<f64> {
        let span = panel.x_span.into_iter().flat_map(|(low, high)| [low, high]);
        match panel.form {
            Form::Lines => points(panel).map(|point| point.x).chain(span).collect(),
            Form::Rows => values(panel).collect(),
        }
    };
    let axis = Axis::new(scale, panels.iter().filter(of).flat_map(along), if room < 200.0 { 3 } else { 4 });
    if panel.x_ticks.is_empty() { axis } else { axis.with_ticks(&panel.x_ticks) }
}

fn points(panel: &Panel) -> impl Iterator<Item = &Point> {
    panel.series.iter().flat_map(|series| &series.points)
}

/// What the axis of values must reach.
fn values(panel: &Panel) -> impl Iterator<Item = f64> {
    let fits = |point: &&Point| panel.fits_from.is_none_or(|from| point.x >= from);
    points(panel).filter(fits).flat_map(Point::values)
}
