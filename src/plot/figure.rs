//! Panels of lines with bands, and one legend for all.

use super::axis::{Axis, Scale};
use super::style::style;
use super::svg::{Anchor, Svg, escape};

/// A chart: panels in two columns (or one, for one panel), each row from left to right.
///
/// Panels whose axes have the same label share its range, so they can be compared by eye; the label stands
/// once per row or column. Series of the same name look the same in all panels.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Stands above everything, on as many lines as it needs.
    pub title: String,
    /// In reading order.
    pub panels: Vec<Panel>,
}

/// One pair of axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// Stands above the panel.
    pub title: String,
    /// What x is, with its unit.
    pub x_label: String,
    /// What y is, with its unit.
    pub y_label: String,
    /// From back to front.
    pub series: Vec<Series>,
    /// What the x axis spans at least.
    pub x_span: Option<(f64, f64)>,
}

/// A line.
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
    /// From left to right.
    pub x: f64,
    /// Upwards.
    pub y: f64,
    /// The low and the high end of the band around the line.
    pub band: Option<(f64, f64)>,
}

impl Figure {
    /// The chart as an SVG document. It is as wide as the reader makes it, and legible from the width of a
    /// phone (the units below are pixels at 640).
    pub fn to_svg(&self) -> String {
        self.draw([Scale::Linear; 2])
    }

    /// The same with logarithmic axes. Points that are not positive are left out.
    pub fn to_log_svg(&self) -> String {
        self.draw([Scale::Logarithmic; 2])
    }

    /// The same with a logarithmic x axis. Points whose x is not positive are left out.
    pub fn to_semilog_svg(&self) -> String {
        self.draw([Scale::Logarithmic, Scale::Linear])
    }

    fn draw(&self, scales: [Scale; 2]) -> String {
        let names = self.names();
        let title = wrap(&self.title, WIDTH - 2.0 * MARGIN, TITLE);
        let drawn: Vec<usize> = (0..names.len()).filter(|index| self.is_drawn(names[*index])).collect();
        let (legend, legend_lines) = flow(drawn.iter().map(|index| names[*index]));
        let columns = self.panels.len().min(2);
        let top = MARGIN + title.len() as f64 * (TITLE + 6.0) + legend_lines as f64 * LINE + 8.0;
        let grid = Grid::new(&self.panels, columns, top, scales);

        let mut svg = Svg::default();
        svg.raw(&format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" class="vs" viewBox="0 0 {WIDTH} {:.0}" role="img">"#,
            grid.bottom
        ));
        svg.raw(&format!("<title>{}</title>\n<style>\n{}</style>", escape(&self.title), style(names.len())));
        svg.raw(r#"<rect class="paper" width="100%" height="100%"/>"#);
        let mut y = MARGIN;
        for line in &title {
            y += TITLE + 6.0;
            svg.text("title", (MARGIN, y - 6.0), Anchor::Start, line);
        }
        for ((x, line), index) in legend.into_iter().zip(drawn) {
            let y = y + (line as f64 + 0.5) * LINE;
            let sample = [(x, y), (x + SAMPLE, y)];
            svg.path(&format!("line s{index}"), sample.into_iter(), false);
            svg.text("text", (x + SAMPLE + 8.0, y + 0.35 * TEXT), Anchor::Start, names[index]);
        }
        for (index, panel) in self.panels.iter().enumerate() {
            grid.draw_axes(&mut svg, index, panel);
            grid.draw_series(&mut svg, index, panel, &names);
        }
        svg.raw("</svg>");
        svg.finish()
    }

    /// The names of the series, each once.
    fn names(&self) -> Vec<&str> {
        let mut names = Vec::new();
        for series in self.panels.iter().flat_map(|panel| &panel.series) {
            if !names.contains(&series.name.as_str()) {
                names.push(&series.name);
            }
        }
        names
    }

    /// Whether a series of this name has points.
    fn is_drawn(&self, name: &str) -> bool {
        let mut series = self.panels.iter().flat_map(|panel| &panel.series);
        series.any(|series| series.name == name && !series.points.is_empty())
    }
}

impl Point {
    /// What the y axis must reach.
    fn ys(&self) -> [f64; 3] {
        let (low, high) = self.band.unwrap_or((self.y, self.y));
        [low, self.y, high]
    }
}

const WIDTH: f64 = 640.0;
const MARGIN: f64 = 16.0;
const TITLE: f64 = 19.0;
const TEXT: f64 = 16.0;
/// Height of a line of text.
const LINE: f64 = 24.0;
/// Length of a line in the legend.
const SAMPLE: f64 = 40.0;
/// Height of the lines of a panel that stands alone, and of one beside another.
const PANEL_HEIGHTS: [f64; 2] = [260.0, 150.0];

/// An upper estimate of a text's width: fonts differ, and SVG has no way to ask.
fn width(text: &str, size: f64) -> f64 {
    0.6 * size * text.chars().count() as f64
}

/// Breaks a text into lines between words.
fn wrap(text: &str, room: f64, size: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(line, size) + width(word, size) + 0.6 * size <= room => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Where the entries of the legend stand (x, line), and how many lines they take.
fn flow<'a>(names: impl Iterator<Item = &'a str>) -> (Vec<(f64, usize)>, usize) {
    let (mut x, mut line) = (MARGIN, 0);
    let mut places = Vec::new();
    for name in names {
        let entry = SAMPLE + 8.0 + width(name, TEXT);
        if x > MARGIN && x + entry > WIDTH - MARGIN {
            (x, line) = (MARGIN, line + 1);
        }
        places.push((x, line));
        x += entry + 12.0;
    }
    (places, line + 1)
}

/// Where panels stand, and their axes.
struct Grid {
    columns: usize,
    /// Room for text to the left of each column's lines.
    gutters: Vec<f64>,
    /// Left and top of each panel's lines.
    corners: Vec<(f64, f64)>,
    axes: Vec<[Axis; 2]>,
    panel_width: f64,
    panel_height: f64,
    bottom: f64,
    /// Whether each panel's labels of x and y are shown, not those of a neighbour.
    labelled: Vec<[bool; 2]>,
}

impl Grid {
    fn new(panels: &[Panel], columns: usize, top: f64, scales: [Scale; 2]) -> Grid {
        let axes: Vec<_> = panels.iter().map(|panel| axes(panels, panel, scales)).collect();
        let labelled: Vec<_> = (0..panels.len())
            .map(|index| {
                let below = panels.get(index + columns);
                let left = (index % columns > 0).then(|| &panels[index - 1]);
                [
                    below.is_none_or(|below| below.x_label != panels[index].x_label),
                    left.is_none_or(|left| left.y_label != panels[index].y_label),
                ]
            })
            .collect();
        let widest =
            |[_, y]: &[Axis; 2]| y.ticks.iter().map(|(_, text)| width(text, TEXT)).fold(0.0, f64::max);
        let gutters: Vec<f64> = (0..columns)
            .map(|column| {
                let of_column = || (column..panels.len()).step_by(columns);
                let label = if of_column().any(|index| labelled[index][1]) { LINE } else { 0.0 };
                of_column().map(|index| widest(&axes[index])).fold(0.0, f64::max) + label + 8.0
            })
            .collect();
        let gap = 26.0;
        let room = WIDTH - 2.0 * MARGIN - gutters.iter().sum::<f64>() - gap * columns as f64;
        let panel_width = room / columns.max(1) as f64;
        let panel_height = PANEL_HEIGHTS[usize::from(columns > 1)];
        let lefts: Vec<f64> = (0..columns)
            .map(|c| MARGIN + gutters[..=c].iter().sum::<f64>() + c as f64 * (panel_width + gap))
            .collect();
        let mut corners = Vec::new();
        let mut y = top;
        for row in labelled.chunks(columns.max(1)) {
            y += LINE;
            corners.extend(lefts.iter().take(row.len()).map(|x| (*x, y)));
            let label = if row.iter().any(|[x, _]| *x) { LINE } else { 0.0 };
            y += panel_height + LINE + label + 8.0;
        }
        Grid { columns, gutters, corners, axes, panel_width, panel_height, bottom: y + 4.0, labelled }
    }

    /// Where a value of panel `index` is.
    fn place(&self, index: usize, x: f64, y: f64) -> (f64, f64) {
        let (left, top) = self.corners[index];
        let [x_axis, y_axis] = &self.axes[index];
        (left + self.panel_width * x_axis.position(x), top + self.panel_height * (1.0 - y_axis.position(y)))
    }

    fn draw_axes(&self, svg: &mut Svg, index: usize, panel: &Panel) {
        let (left, top) = self.corners[index];
        let (right, bottom) = (left + self.panel_width, top + self.panel_height);
        let [x_axis, y_axis] = &self.axes[index];
        svg.text("panel", (left, top - 8.0), Anchor::Start, &panel.title);
        for (value, text) in &y_axis.ticks {
            let (_, y) = self.place(index, 0.0, *value);
            svg.path("grid", [(left, y), (right, y)].into_iter(), false);
            svg.text("text", (left - 8.0, y + 0.35 * TEXT), Anchor::End, text);
        }
        for (value, text) in &x_axis.ticks {
            let (x, _) = self.place(index, *value, 0.0);
            svg.path("axis", [(x, bottom), (x, bottom + 4.0)].into_iter(), false);
            svg.text("text", (x, bottom + 20.0), Anchor::Middle, text);
        }
        svg.path("axis", [(left, bottom), (right, bottom)].into_iter(), false);
        let [x_labelled, y_labelled] = self.labelled[index];
        if x_labelled {
            svg.text("label", ((left + right) / 2.0, bottom + 20.0 + LINE), Anchor::Middle, &panel.x_label);
        }
        if y_labelled {
            let x = left - self.gutters[index % self.columns] + 0.8 * TEXT;
            svg.upward_text("label", (x, (top + bottom) / 2.0), &panel.y_label);
        }
    }

    fn draw_series(&self, svg: &mut Svg, index: usize, panel: &Panel, names: &[&str]) {
        let finite = |point: &&Point| {
            let [x_axis, y_axis] = &self.axes[index];
            let ys = point.ys().map(|y| y_axis.position(y));
            x_axis.position(point.x).is_finite() && ys.into_iter().all(f64::is_finite)
        };
        let styled = panel.series.iter().map(|series| {
            let style =
                names.iter().position(|name| *name == series.name).expect("names are of these series");
            let points: Vec<&Point> = series.points.iter().filter(finite).collect();
            (style, points)
        });
        for (style, points) in styled.clone() {
            let bands: Vec<_> = points.iter().filter_map(|point| Some((point.x, point.band?))).collect();
            let low = bands.iter().map(|(x, (low, _))| self.place(index, *x, *low));
            let high = bands.iter().rev().map(|(x, (_, high))| self.place(index, *x, *high));
            if bands.len() > 1 {
                svg.path(&format!("band b{style}"), low.chain(high), true);
            }
        }
        for (style, points) in styled {
            let mut places = points.iter().map(|point| self.place(index, point.x, point.y));
            match points.len() {
                0 => {}
                1 => svg.dot(&format!("b{style}"), places.next().expect("there is one")),
                _ => svg.path(&format!("line s{style}"), places, false),
            }
        }
    }
}

/// The axes of a panel: of its values and of those it shares the label with.
fn axes<'a>(panels: &'a [Panel], panel: &Panel, scales: [Scale; 2]) -> [Axis; 2] {
    let points = |panel: &'a Panel| panel.series.iter().flat_map(|series| &series.points);
    let x = panels.iter().filter(|other| other.x_label == panel.x_label).flat_map(|panel| {
        let span = panel.x_span.into_iter().flat_map(|(low, high)| [low, high]);
        points(panel).map(|point| point.x).chain(span)
    });
    let y = panels.iter().filter(|other| other.y_label == panel.y_label).flat_map(points);
    let [x_scale, y_scale] = scales;
    [Axis::new(x_scale, x, 4), Axis::new(y_scale, y.flat_map(Point::ys), 5)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(label: &str, names: &[&str], ys: &[f64]) -> Panel {
        let point = |(x, y): (usize, &f64)| Point { x: x as f64, y: *y, band: Some((y - 1.0, y + 1.0)) };
        let points: Vec<Point> = ys.iter().enumerate().map(point).collect();
        let series = names.iter().map(|name| Series { name: (*name).to_owned(), points: points.clone() });
        Panel {
            title: "panel".to_owned(),
            x_label: "x".to_owned(),
            y_label: label.to_owned(),
            series: series.collect(),
            ..Panel::default()
        }
    }

    fn figure(panels: Vec<Panel>) -> Figure {
        Figure { title: "title".to_owned(), panels }
    }

    /// The numbers of an attribute, wherever it stands.
    fn numbers(svg: &str, attribute: &str) -> Vec<f64> {
        let start = format!(" {attribute}=\"");
        let parts = svg.split(&start).skip(1);
        parts
            .flat_map(|part| part.split('"').next().unwrap().split(['M', 'L', 'Z', ' ']))
            .filter_map(|n| n.parse().ok())
            .collect()
    }

    #[test]
    fn everything_is_inside_of_the_picture() {
        let long = "a name that is quite long, but not wider than a picture";
        let panels = vec![
            panel("large", &[long, "b", "c"], &[-1e14, 3e14, 0.0]),
            panel("small", &["d", long], &[1e-9, f64::NAN, 2e-9]),
            panel("large", &["e"], &[f64::INFINITY, 7.0]),
        ];
        let svg = figure(panels).to_svg();
        let view: Vec<f64> = svg.split('"').nth(5).unwrap().split(' ').map(|n| n.parse().unwrap()).collect();
        assert_eq!(view[..3], [0.0, 0.0, 640.0]);
        assert!(numbers(&svg, "x").into_iter().all(|x| (0.0..640.0).contains(&x)));
        assert!(numbers(&svg, "y").into_iter().all(|y| (0.0..view[3]).contains(&y)));
        let places = numbers(&svg, "d");
        assert!(places.len() > 100);
        assert!(places.chunks(2).all(|at| at[0] < 640.0 && at[1] < view[3] && at.iter().all(|n| *n > 0.0)));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn axes_of_one_label_share_a_range() {
        let ticks = |label: &str| {
            let svg =
                figure(vec![panel("y", &["a"], &[0.0, 1.0]), panel(label, &["a"], &[0.0, 900.0])]).to_svg();
            (svg.matches(">800</text>").count(), svg.matches("rotate(-90)").count())
        };
        assert_eq!(ticks("y"), (2, 1));
        assert_eq!(ticks("other"), (1, 2));
    }

    #[test]
    fn a_name_looks_the_same_in_all_panels_and_stands_in_the_legend_once() {
        let svg =
            figure(vec![panel("y", &["a", "b"], &[0.0, 1.0]), panel("y", &["b"], &[0.0, 1.0])]).to_svg();
        assert_eq!(svg.matches(">b</text>").count(), 1);
        // In the legend and in both panels.
        assert_eq!(svg.matches("class=\"line s1\"").count(), 3);
        assert_eq!(svg.matches("class=\"line s0\"").count(), 2);
    }

    #[test]
    fn a_name_without_points_keeps_its_place_and_stands_in_no_legend() {
        let mut panel = panel("y", &["a", "b"], &[0.0, 1.0]);
        panel.series[0].points.clear();
        let svg = figure(vec![panel]).to_svg();
        assert!(svg.contains(">b</text>") && !svg.contains(">a</text>"));
        assert_eq!([0, 1].map(|style| svg.matches(&format!("class=\"line s{style}\"")).count()), [0, 2]);
    }

    #[test]
    fn an_axis_spans_what_it_should() {
        let mut panel = panel("y", &["a"], &[0.0, 1.0, 1.5]);
        panel.x_span = Some((-4.0, 1.0));
        let svg = figure(vec![panel]).to_svg();
        assert!(svg.contains(">-4</text>") && svg.contains(">2</text>"));
    }

    #[test]
    fn text_is_text_and_nothing_is_fetched() {
        let mut figure = figure(vec![panel("y", &["<b> & \"c\""], &[0.0])]);
        figure.title = "</svg><script>".to_owned();
        let svg = figure.to_svg();
        assert!(svg.contains("&lt;b&gt; &amp; &quot;c&quot;") && !svg.contains("<script"));
        assert_eq!(svg.matches("http").count(), 1, "the name of the format is the only address");
        assert!(svg.contains("prefers-color-scheme:dark"));
        assert!(svg.contains("<circle"), "one point alone is a dot");
    }
}
