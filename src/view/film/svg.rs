//! A moment as an SVG document, light or dark as the reader has it.

use std::fmt::Write;

use glam::DVec2;
use maud::{Markup, PreEscaped, html};

use super::scene::{Anchor, Ink, Moment, Pen, Stroke};

/// The document.
pub(crate) fn svg(moment: &Moment) -> String {
    let mut pen = SvgPen::default();
    moment.draw(&mut pen);
    let (width, height) = moment.size();
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height) } role="img" {
            title { (moment.title()) }
            style { (PreEscaped(style_sheet())) }
            rect.paper width="100%" height="100%" {}
            (PreEscaped(pen.shapes))
        }
    };
    svg.into_string() + "\n"
}

#[derive(Default)]
struct SvgPen {
    shapes: String,
}

impl SvgPen {
    fn push(&mut self, shape: Markup) {
        self.shapes.push_str(&shape.0);
        self.shapes.push('\n');
    }
}

impl Pen for SvgPen {
    fn disc(&mut self, centre: DVec2, radius: f64, ink: Ink) {
        let [x, y, r] = [centre.x, centre.y, radius].map(tenths);
        self.push(html! { circle class=(class("f", ink)) cx=(x) cy=(y) r=(r) {} });
    }

    fn ring(&mut self, centre: DVec2, radius: f64, stroke: Stroke) {
        let [x, y, r] = [centre.x, centre.y, radius].map(tenths);
        self.push(
            html! { circle class=(class("s", stroke.ink)) style=(style(&stroke)) cx=(x) cy=(y) r=(r) {} },
        );
    }

    fn line(&mut self, points: &[DVec2], stroke: Stroke) {
        let points = points.iter().map(|point| format!("{} {}", tenths(point.x), tenths(point.y)));
        let points = points.collect::<Vec<_>>().join(" ");
        self.push(
            html! { polyline class=(class("s", stroke.ink)) style=(style(&stroke)) points=(points) {} },
        );
    }

    fn text(&mut self, at: DVec2, size: f64, anchor: Anchor, ink: Ink, text: &str) {
        let anchor = (anchor == Anchor::Middle).then_some("middle");
        let [x, y] = at.to_array().map(tenths);
        self.push(html! {
            text class=(class("f", ink)) font-size=(tenths(size)) text-anchor=[anchor] x=(x) y=(y) { (text) }
        });
    }
}

fn tenths(value: f64) -> String {
    format!("{value:.1}")
}

/// The class of what is filled (`f`) or drawn (`s`) with an ink.
fn class(how: &str, ink: Ink) -> String {
    match ink {
        Ink::Agent(agent) => format!("{how}-agent{}", agent % 7),
        _ => format!("{how}-{ink:?}").to_lowercase(),
    }
}

fn style(stroke: &Stroke) -> String {
    let Stroke { width, alpha, dash: [dash, gap], .. } = stroke;
    let mut style = format!("stroke-width:{width}");
    if *alpha < 1.0 {
        write!(style, ";opacity:{alpha:.2}").expect("a string takes everything");
    }
    if *gap > 0.0 {
        write!(style, ";stroke-dasharray:{dash} {gap}").expect("a string takes everything");
    }
    style
}

fn style_sheet() -> String {
    let [light, dark] = [0, 1].map(|paper| {
        let rule = |ink: Ink| {
            let (fill, stroke, colour) = (class("f", ink), class("s", ink), ink.colours()[paper]);
            format!(".{fill}{{fill:#{colour:06x}}}.{stroke}{{stroke:#{colour:06x}}}\n")
        };
        let background = Ink::Stage.colours()[paper];
        Ink::ALL.map(rule).concat() + &format!(".paper{{fill:#{background:06x}}}\n")
    });
    format!(
        "text{{font-family:sans-serif;font-weight:600}}polyline,circle[class^=s]{{fill:none}}\n{light}@media \
         (prefers-color-scheme:dark){{\n{dark}}}\n"
    )
}
