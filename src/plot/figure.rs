//! Panels, and one legend for all.

use super::axis::Scale;
use super::drawing::{Anchor, Drawing, Face, Ink};
use super::grid::Grid;
use super::panel::{Form, Panel};
#[cfg(feature = "cli")]
use super::pdf::pdf;
use super::style::{TEXT, TITLE};
use super::svg::svg;

/// A chart: panels in two columns (or one, for one panel, or where there is no room), each row from left to right.
///
/// Panels whose axes have the same label share its range, so they can be compared by eye, unless they have
/// [their own](Panel::own_range); the label stands once per row or column. Series of the same name look the same in all
/// panels.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Stands above everything, on as many lines as it needs.
    pub title: String,
    /// In reading order.
    pub panels: Vec<Panel>,
}

/// What a figure is drawn on.
struct Page {
    width: f64,
    /// Whether the title is drawn: in a paper there is a caption.
    titled: bool,
}

/// A screen. The units are pixels at this width; a chart is legible from the width of a phone.
const SCREEN: Page = Page { width: 640.0, titled: true };

/// A column of a paper: 252 points (3.5 inches) where text is set in 8 points.
const COLUMN: Page = Page { width: 504.0, titled: false };

pub(super) const MARGIN: f64 = 16.0;
/// Height of a line of text.
pub(super) const LINE: f64 = 24.0;
/// Length of a line in the legend.
const SAMPLE: f64 = 40.0;

impl Figure {
    /// The chart as an SVG document, as wide as the reader makes it.
    pub fn to_svg(&self) -> String {
        svg(&self.draw(&SCREEN, [Scale::Linear; 2]))
    }

    /// The same with logarithmic axes. Points that are not positive are left out.
    pub fn to_log_svg(&self) -> String {
        svg(&self.draw(&SCREEN, [Scale::Logarithmic; 2]))
    }

    /// The same with a logarithmic x axis. Points whose x is not positive are left out.
    pub fn to_semilog_svg(&self) -> String {
        svg(&self.draw(&SCREEN, [Scale::Logarithmic, Scale::Linear]))
    }

    /// The chart as a PDF document for a column of a paper: 252 points wide, with text of 8 points in Helvetica, and
    /// without the title: a paper has captions.
    #[cfg(feature = "cli")]
    pub fn to_pdf(&self) -> Vec<u8> {
        pdf(&self.draw(&COLUMN, [Scale::Linear; 2]))
    }

    fn draw(&self, page: &Page, scales: [Scale; 2]) -> Drawing {
        let names = self.names();
        let mut drawing = Drawing {
            title: self.title.clone(),
            width: page.width,
            n_series: names.len(),
            ..Drawing::default()
        };
        let mut y = MARGIN;
        let title =
            if page.titled { wrap(&self.title, page.width - 2.0 * MARGIN, TITLE) } else { Vec::new() };
        for line in &title {
            y += TITLE + 6.0;
            drawing.text(Face::Title, (MARGIN, y - 6.0), Anchor::Start, line);
        }
        y = self.draw_legend(&mut drawing, y, &names) + 8.0;
        let grid = Grid::new(&self.panels, page.width, y, scales);
        for (index, panel) in self.panels.iter().enumerate() {
            grid.draw(&mut drawing, index, panel, &names);
        }
        drawing.height = grid.bottom;
        drawing
    }

    /// From `top` to what is returned. Rows have their names beside them.
    fn draw_legend(&self, drawing: &mut Drawing, top: f64, names: &[&str]) -> f64 {
        if self.panels.iter().all(|panel| panel.form == Form::Rows) {
            return top;
        }
        let (mut x, mut y) = (MARGIN, top + 0.5 * LINE);
        for (index, name) in names.iter().enumerate().filter(|(_, name)| self.is_drawn(name)) {
            let entry = SAMPLE + 8.0 + width(name, TEXT);
            if x > MARGIN && x + entry > drawing.width - MARGIN {
                (x, y) = (MARGIN, y + LINE);
            }
            drawing.path(Ink::Line(index), [(x, y), (x + SAMPLE, y)]);
            drawing.marker(index, (x + 0.5 * SAMPLE, y));
            drawing.text(Face::Text, (x + SAMPLE + 8.0, y + 0.35 * TEXT), Anchor::Start, name);
            x += entry + 12.0;
        }
        y + 0.5 * LINE
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
        self.panels.iter().flat_map(Panel::drawn).any(|series| series.name == name)
    }
}

/// An upper estimate of a text's width: fonts differ, and SVG has no way to ask.
pub(super) fn width(text: &str, size: f64) -> f64 {
    0.6 * size * text.chars().count() as f64
}

/// Breaks a text into lines between words.
pub(super) fn wrap(text: &str, room: f64, size: f64) -> Vec<String> {
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

#[cfg(test)]
mod tests {
    use super::super::panel::{Point, Series};
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
    fn a_range_of_its_own_hides_nothing() {
        let mut panels = vec![panel("y", &["a"], &[0.0, 1.0]), panel("y", &["a"], &[0.0, 900.0])];
        panels.iter_mut().for_each(|panel| panel.own_range = true);
        let svg = figure(panels).to_svg();
        assert_eq!((svg.matches(">800</text>").count(), svg.matches("rotate(-90)").count()), (1, 1));
    }

    #[test]
    fn points_are_marked_where_they_are_few() {
        let marked = |n: usize| {
            let svg = figure(vec![panel("y", &["a"], &vec![1.0; n])]).to_svg();
            svg.matches("class=\"marker b0\"").count()
        };
        // One more is in the legend.
        assert_eq!([marked(1), marked(12), marked(13)], [2, 13, 1]);
    }

    #[test]
    fn ticks_stand_at_levels_and_do_not_run_into_each_other() {
        let mut panel = panel("y", &["a"], &[0.0, 1.0]);
        panel.x_ticks = vec![1.0, 0.3, 0.305, 0.0];
        let svg = figure(vec![panel]).to_svg();
        for (tick, there) in [("0", true), ("0.3", true), ("0.305", false), ("1", true), ("0.5", false)] {
            assert_eq!(svg.contains(&format!("text-anchor=\"middle\">{tick}</text>")), there, "{tick}");
        }
    }

    #[test]
    fn rows_have_names_beside_them_instead_of_a_legend() {
        let rows = |names: &[&str]| Panel { form: Form::Rows, ..panel("", names, &[7.0]) };
        let svg = figure(vec![rows(&["a", "b"]), rows(&["a", "b"])]).to_svg();
        assert_eq!([">a</text>", ">b</text>"].map(|name| svg.matches(name).count()), [1, 1]);
        assert_eq!(svg.matches("class=\"bar s1\"").count(), 2);
        // The second has other rows, so it says which.
        let svg = figure(vec![rows(&["a", "b"]), rows(&["a"])]).to_svg();
        assert_eq!(svg.matches(">a</text>").count(), 2);
        // Names that leave no room for two columns get one.
        let long = "a name as long as forty characters or so";
        let svg = figure(vec![rows(&[long]), rows(&[long])]).to_svg();
        assert_eq!(svg.matches(&format!(">{long}</text>")).count(), 2);
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
        assert!(svg.contains("marker b0"), "one point alone is a marker");
    }
}
