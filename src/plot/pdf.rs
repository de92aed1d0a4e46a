//! A drawing as a PDF document of one page, for a column of a paper.
//!
//! Its font is Helvetica, which every reader of PDF has, so that it is not in the file.

use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

use super::drawing::{Anchor, Drawing, Face, Ink, Shape};
use super::style::{BAND_OPACITY, Look, TEXT, TITLE};

/// Points per unit of a drawing: text of 16 units is set in 8 points.
pub(super) const SCALE: f64 = 0.5;

const CATALOG: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const PAGE: Ref = Ref::new(3);
const CONTENT: Ref = Ref::new(4);
const INFORMATION: Ref = Ref::new(5);
const FONTS: [(Name, Name, Ref); 2] =
    [(PLAIN, Name(b"Helvetica"), Ref::new(6)), (BOLD, Name(b"Helvetica-Bold"), Ref::new(7))];
const OPACITY: Ref = Ref::new(8);

const PLAIN: Name = Name(b"F0");
const BOLD: Name = Name(b"F1");
const TRANSLUCENT: Name = Name(b"G0");

/// The document, on white paper.
pub(super) fn pdf(drawing: &Drawing) -> Vec<u8> {
    let [width, height] = [drawing.width, drawing.height.round()].map(|side| (SCALE * side) as f32);
    let mut pdf = Pdf::new();
    pdf.catalog(CATALOG).pages(PAGES);
    pdf.pages(PAGES).kids([PAGE]).count(1);
    let mut page = pdf.page(PAGE);
    page.media_box(Rect::new(0.0, 0.0, width, height)).parent(PAGES).contents(CONTENT);
    let mut resources = page.resources();
    resources.fonts().pairs(FONTS.map(|(name, _, font)| (name, font)));
    resources.ext_g_states().pair(TRANSLUCENT, OPACITY);
    resources.finish();
    page.finish();
    for (_, family, font) in FONTS {
        pdf.type1_font(font).base_font(family).encoding_predefined(Name(b"WinAnsiEncoding"));
    }
    pdf.ext_graphics(OPACITY).non_stroking_alpha(BAND_OPACITY);
    pdf.document_info(INFORMATION).title(TextStr(&drawing.title));
    pdf.stream(CONTENT, &content(drawing, height));
    pdf.finish()
}

/// What is drawn, from back to front.
fn content(drawing: &Drawing, height: f32) -> Vec<u8> {
    let mut content = Content::new();
    // Here y grows upwards.
    content.transform([SCALE as f32, 0.0, 0.0, -SCALE as f32, 0.0, height]);
    for shape in &drawing.shapes {
        content.save_state();
        match shape {
            Shape::Path { ink, points } => path(&mut content, *ink, points),
            Shape::Text { face, at: (x, y), anchor, text } => {
                let before = match anchor {
                    Anchor::Start => 0.0,
                    Anchor::Middle => 0.5 * width(text),
                    Anchor::End => width(text),
                };
                write(&mut content, *face, [1.0, 0.0, 0.0, -1.0], (x - before, *y), text);
            }
            Shape::UpwardText { at: (x, y), text } => {
                let below = 0.5 * width(text);
                write(&mut content, Face::Text, [0.0, -1.0, -1.0, 0.0], (*x, y + below), text);
            }
        }
        content.restore_state();
    }
    content.finish().into_vec()
}

fn path(content: &mut Content, ink: Ink, points: &[(f64, f64)]) {
    let Look { colour, width, dashes } = Look::of(ink);
    let [red, green, blue] = colour.map(|part| f32::from(part) / 255.0);
    content.set_stroke_rgb(red, green, blue).set_fill_rgb(red, green, blue);
    content.set_line_width(width).set_dash_pattern(dashes.iter().copied(), 0.0);
    if let Ink::Band(_) = ink {
        content.set_parameters(TRANSLUCENT);
    }
    for (index, (x, y)) in points.iter().enumerate() {
        let (x, y) = (rounded(*x), rounded(*y));
        if index == 0 {
            content.move_to(x, y)
        } else {
            content.line_to(x, y)
        };
    }
    if ink.fills() {
        content.close_path().fill_nonzero()
    } else {
        content.stroke()
    };
}

/// A text at its place, its directions to the right and upwards being columns of a matrix.
fn write(content: &mut Content, face: Face, [a, b, c, d]: [f32; 4], (x, y): (f64, f64), text: &str) {
    let (font, size) = match face {
        Face::Text => (PLAIN, TEXT),
        Face::Panel => (BOLD, TEXT),
        Face::Title => (BOLD, TITLE),
    };
    content.begin_text().set_font(font, size as f32);
    content.set_text_matrix([a, b, c, d, rounded(x), rounded(y)]);
    content.show(Str(&encoded(text))).end_text();
}

/// As many digits as can be seen.
fn rounded(place: f64) -> f32 {
    ((place * 100.0).round() / 100.0) as f32
}

/// The bytes of a text: those of Latin-1, and a question mark for what is not in it.
fn encoded(text: &str) -> Vec<u8> {
    let byte = |character: char| {
        let byte = u8::try_from(character).ok();
        byte.filter(|byte| matches!(byte, 0x20..=0x7e | 0xa0..=0xff)).unwrap_or(b'?')
    };
    text.chars().map(byte).collect()
}

/// How wide a text is in plain Helvetica.
fn width(text: &str) -> f64 {
    let of = |byte: u8| HELVETICA.get(usize::from(byte) - 0x20).map_or(DIGIT, |width| *width);
    encoded(text).into_iter().map(|byte| TEXT * f64::from(of(byte)) / 1000.0).sum()
}

/// The width of a digit, and of most letters with an accent, in thousandths of the font's size.
const DIGIT: u16 = 556;

/// The same of ASCII from the blank to the tilde: Adobe's metrics of Helvetica.
#[rustfmt::skip]
const HELVETICA: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556,
    1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556,
    333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556,
    556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];

#[cfg(test)]
mod tests {
    use super::super::{Figure, Panel, Point, Series};
    use super::*;

    #[test]
    fn a_text_is_as_wide_as_its_letters() {
        // 500 + 556 + 222 + 556 + 556 + 333 + 556 + 722 + 556 + 333 + 556.
        assert!((width("value-aware") - 16.0 * 5.446).abs() < 1e-9);
        assert_eq!(width("é"), width("0"));
        assert_eq!(encoded("± €"), b"\xb1 ?");
    }

    #[test]
    fn a_figure_is_a_page_as_wide_as_a_column_with_its_text_in_it() {
        let points = [0.0, 1.0].map(|x| Point { x, y: -x, band: Some((-x - 1.0, -x + 1.0)) });
        let series = Series { name: "a (b)".to_owned(), points: points.to_vec() };
        let panel = Panel { title: "task".to_owned(), series: vec![series], ..Panel::default() };
        let figure = Figure { title: "A title".to_owned(), panels: vec![panel] };
        let bytes = figure.to_pdf();
        assert_eq!(bytes, figure.to_pdf());
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.starts_with("%PDF-1.") && text.ends_with("%%EOF"), "{text}");
        let side = |at: usize| -> f64 {
            let sides = text.split("/MediaBox [").nth(1).unwrap().split(']').next().unwrap();
            sides.split(' ').nth(at).unwrap().parse().unwrap()
        };
        assert_eq!((side(0), side(1), side(2)), (0.0, 0.0, 252.0));
        assert!(side(3) > 100.0);
        for part in ["/BaseFont /Helvetica\n", "(task) Tj", "(a (b)) Tj", "/F0 16 Tf", "(-2) Tj", "/G0 gs"] {
            assert!(text.contains(part), "{part} is not in {text}");
        }
        assert!(!text.contains("(A title) Tj"), "a paper has captions");
    }
}
