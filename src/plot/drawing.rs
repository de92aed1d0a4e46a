//! A drawing: what there is to see, in whatever format it is written.

/// Shapes from back to front. x grows to the right and y downwards; a line of text is 16 units high.
#[derive(Debug, Default)]
pub(super) struct Drawing {
    /// What readers are told who cannot see it.
    pub title: String,
    pub width: f64,
    pub height: f64,
    /// How many series have a style of their own.
    pub n_series: usize,
    pub shapes: Vec<Shape>,
}

/// A part of a drawing.
#[derive(Debug)]
pub(super) enum Shape {
    Path {
        ink: Ink,
        points: Vec<(f64, f64)>,
    },
    Text {
        face: Face,
        at: (f64, f64),
        anchor: Anchor,
        text: String,
    },
    /// Is read upwards, and centred at its place.
    UpwardText {
        at: (f64, f64),
        text: String,
    },
}

/// How a path looks. Numbers are those of series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ink {
    Grid,
    Axis,
    /// Solid, dashed or dotted, as its series is.
    Line(usize),
    /// A line that is always solid.
    Bar(usize),
    /// An area that others shine through.
    Band(usize),
    /// A filled outline.
    Marker(usize),
}

/// How a text looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Face {
    Text,
    Panel,
    Title,
}

/// Which end of a text is at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Ink {
    /// Whether what it encloses is filled; otherwise its outline is drawn.
    pub(super) fn fills(self) -> bool {
        matches!(self, Ink::Band(_) | Ink::Marker(_))
    }
}

impl Drawing {
    /// A path through these points, closed if its ink fills.
    pub(super) fn path(&mut self, ink: Ink, points: impl IntoIterator<Item = (f64, f64)>) {
        self.shapes.push(Shape::Path { ink, points: points.into_iter().collect() });
    }

    /// A text at (x, y), its baseline there.
    pub(super) fn text(&mut self, face: Face, at: (f64, f64), anchor: Anchor, text: &str) {
        self.shapes.push(Shape::Text { face, at, anchor, text: text.to_owned() });
    }

    /// A text that is read upwards, centred at (x, y).
    pub(super) fn upward_text(&mut self, at: (f64, f64), text: &str) {
        self.shapes.push(Shape::UpwardText { at, text: text.to_owned() });
    }

    /// The marker of a series, centred at (x, y).
    pub(super) fn marker(&mut self, series: usize, (x, y): (f64, f64)) {
        let (corners, turn) = MARKERS[series % MARKERS.len()];
        let radius = if corners > 4 { 4.5 } else { 5.5 };
        let corner = |k| {
            let angle = (f64::from(k) / f64::from(corners) + turn) * std::f64::consts::TAU;
            (x + radius * angle.sin(), y - radius * angle.cos())
        };
        self.path(Ink::Marker(series), (0..corners).map(corner));
    }
}

/// Regular polygons: their corners, and by what part of a turn the first is off the top. Their number has no factor in
/// common with that of the colours.
const MARKERS: [(u32, f64); 5] = [(16, 0.0), (4, 0.125), (3, 0.0), (4, 0.0), (3, 0.5)];
