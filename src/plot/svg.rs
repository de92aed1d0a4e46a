//! A drawing as an SVG document.

use std::fmt::Write;

use super::drawing::{Anchor, Drawing, Face, Ink, Shape};
use super::style::style_sheet;

/// The document. It is as wide as the reader makes it, light or dark as the reader has it.
pub(super) fn svg(drawing: &Drawing) -> String {
    let Drawing { title, width, height, n_series, shapes } = drawing;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"vs\" viewBox=\"0 0 {width} {height:.0}\" role=\"img\">\n\
         <title>{}</title>\n<style>\n{}</style>\n<rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n",
        escape(title),
        style_sheet(*n_series)
    );
    for shape in shapes {
        svg.push_str(&element(shape));
        svg.push('\n');
    }
    svg + "</svg>\n"
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Path { ink, points } => {
            let mut d = String::new();
            for (index, (x, y)) in points.iter().enumerate() {
                let command = if index == 0 { 'M' } else { 'L' };
                write!(d, "{command}{x:.1} {y:.1}").expect("a string takes everything");
            }
            let end = if ink.fills() { "Z" } else { "" };
            format!(r#"<path class="{}" d="{d}{end}"/>"#, class(*ink))
        }
        Shape::Text { face, at: (x, y), anchor, text } => {
            let class = match face {
                Face::Text => "text",
                Face::Panel => "panel",
                Face::Title => "title",
            };
            let anchor = attribute(*anchor);
            format!(r#"<text class="{class}" x="{x:.1}" y="{y:.1}"{anchor}>{}</text>"#, escape(text))
        }
        Shape::UpwardText { at: (x, y), text } => {
            let anchor = attribute(Anchor::Middle);
            let turn = format!("translate({x:.1} {y:.1}) rotate(-90)");
            format!(r#"<text class="text" transform="{turn}"{anchor}>{}</text>"#, escape(text))
        }
    }
}

fn class(ink: Ink) -> String {
    match ink {
        Ink::Grid => "grid".to_owned(),
        Ink::Axis => "axis".to_owned(),
        Ink::Line(series) => format!("line s{series}"),
        Ink::Bar(series) => format!("bar s{series}"),
        Ink::Band(series) => format!("band b{series}"),
        Ink::Marker(series) => format!("marker b{series}"),
    }
}

fn attribute(anchor: Anchor) -> &'static str {
    match anchor {
        Anchor::Start => "",
        Anchor::Middle => r#" text-anchor="middle""#,
        Anchor::End => r#" text-anchor="end""#,
    }
}

/// Text as it must be written in XML, without the control characters that XML has no way to write.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            control if control.is_control() => escaped.push(' '),
            other => escaped.push(other),
        }
    }
    escaped
}
