//! Elements of an SVG document.

use std::fmt::Write;

/// A document being written.
#[derive(Debug, Default)]
pub(super) struct Svg {
    text: String,
}

/// Which end of a text is at its place.
#[derive(Clone, Copy, Debug)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Svg {
    /// A line of the document as it is.
    pub(super) fn raw(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push('\n');
    }

    /// A text at (x, y), its baseline there.
    pub(super) fn text(&mut self, class: &str, (x, y): (f64, f64), anchor: Anchor, text: &str) {
        self.raw(&format!(
            r#"<text class="{class}" x="{x:.1}" y="{y:.1}"{}>{}</text>"#,
            anchor.attribute(),
            escape(text)
        ));
    }

    /// A text that is read upwards, centred at (x, y).
    pub(super) fn upward_text(&mut self, class: &str, (x, y): (f64, f64), text: &str) {
        self.raw(&format!(
            r#"<text class="{class}" transform="translate({x:.1} {y:.1}) rotate(-90)"{}>{}</text>"#,
            Anchor::Middle.attribute(),
            escape(text)
        ));
    }

    /// A line through points, closed or not.
    pub(super) fn path(&mut self, class: &str, points: impl Iterator<Item = (f64, f64)>, closed: bool) {
        let mut d = String::new();
        for (index, (x, y)) in points.enumerate() {
            let command = if index == 0 { 'M' } else { 'L' };
            write!(d, "{command}{x:.1} {y:.1}").expect("a string takes everything");
        }
        let end = if closed { "Z" } else { "" };
        self.raw(&format!(r#"<path class="{class}" d="{d}{end}"/>"#));
    }

    /// A small disc.
    pub(super) fn dot(&mut self, class: &str, (x, y): (f64, f64)) {
        self.raw(&format!(r#"<circle class="{class}" cx="{x:.1}" cy="{y:.1}" r="3"/>"#));
    }

    /// The document.
    pub(super) fn finish(self) -> String {
        self.text
    }
}

impl Anchor {
    fn attribute(self) -> &'static str {
        match self {
            Anchor::Start => "",
            Anchor::Middle => r#" text-anchor="middle""#,
            Anchor::End => r#" text-anchor="end""#,
        }
    }
}

/// Text as it must be written in XML, without the control characters that XML has no way to write.
pub fn escape(text: &str) -> String {
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
