//! How lines, bands and text look.

use std::fmt::Write;

use super::drawing::Ink;

/// Size of a title and of all other text.
pub(super) const TITLE: f64 = 19.0;
pub(super) const TEXT: f64 = 16.0;

/// How much of what is behind a band it hides.
pub(super) const BAND_OPACITY: f32 = 0.22;

/// A stroke or a filling on white paper.
pub(super) struct Look {
    /// Red, green and blue, from 0 to 255.
    pub colour: [u8; 3],
    pub width: f32,
    /// Lengths of dashes and of the gaps between; none for a solid line.
    pub dashes: &'static [f32],
}

impl Look {
    pub(super) fn of(ink: Ink) -> Look {
        let (colour, width) = match ink {
            Ink::Grid => (GRID[0], 1.0),
            Ink::Axis => (AXIS[0], 1.0),
            Ink::Line(series) | Ink::Bar(series) | Ink::Band(series) | Ink::Marker(series) => {
                (COLOURS[series % COLOURS.len()][0], LINE_WIDTH)
            }
        };
        let dashes = if let Ink::Line(series) = ink { DASHES[series % DASHES.len()] } else { &[] };
        let [_, red, green, blue] = colour.to_be_bytes();
        Look { colour: [red, green, blue], width, dashes }
    }
}

/// The style sheet, for this many series. Its rules hold inside of charts only, also where a chart is part of a
/// page. Renderers that know no dark mode skip that part.
pub(super) fn style_sheet(n_series: usize) -> String {
    let [light, dark] = [0, 1].map(|paper| {
        let mut rules = format!(
            ".vs text{{fill:#{:06x}}}\n.vs .paper{{fill:#{:06x}}}\n.vs .grid{{stroke:#{:06x}}}\n\
             .vs .axis{{stroke:#{:06x}}}\n",
            INK[paper], PAPER[paper], GRID[paper], AXIS[paper]
        );
        for series in 0..n_series {
            let colour = COLOURS[series % COLOURS.len()][paper];
            writeln!(rules, ".vs .s{series}{{stroke:#{colour:06x}}}\n.vs .b{series}{{fill:#{colour:06x}}}")
                .expect("a string takes everything");
        }
        rules
    });
    let dashes: String = (0..n_series)
        .filter_map(|series| {
            let dashes: Vec<String> = DASHES[series % DASHES.len()].iter().map(f32::to_string).collect();
            let dashes = dashes.join(" ");
            (!dashes.is_empty()).then(|| format!(".vs .line.s{series}{{stroke-dasharray:{dashes}}}\n"))
        })
        .collect();
    format!(
        ".vs text{{font-family:sans-serif;font-size:{TEXT}px}}
.vs .title{{font-size:{TITLE}px;font-weight:bold}}
.vs .panel{{font-weight:bold}}
.vs .line,.vs .bar{{fill:none;stroke-width:{LINE_WIDTH};stroke-linejoin:round}}
.vs .band{{opacity:{BAND_OPACITY}}}
{light}{dashes}@media (prefers-color-scheme:dark){{\n{dark}}}\n"
    )
}

const LINE_WIDTH: f32 = 2.2;

/// Colours on light and on dark paper.
const INK: [u32; 2] = [0x24_292f, 0xe6_edf3];
const PAPER: [u32; 2] = [0xff_ffff, 0x0d_1117];
const GRID: [u32; 2] = [0xd8_dde3, 0x30_363d];
const AXIS: [u32; 2] = [0x6e_7781, 0x8b_949e];

/// Those of series: colour-blind readers can tell them apart, the first five after Okabe and Ito (2008).
const COLOURS: [[u32; 2]; 7] = [
    [0x00_72b2, 0x56_b4e9],
    [0xd5_5e00, 0xe6_9f00],
    [0x00_9e73, 0x2f_c99c],
    [0xb0_508a, 0xcc_79a7],
    [0x44_4444, 0xf0_e442],
    [0x8c_959f, 0x8b_949e],
    [0x4b_93c4, 0xe0_7a5f],
];

/// Their number has no factor in common with that of the colours, so 28 lines differ.
const DASHES: [&[f32]; 4] = [&[], &[9.0, 4.0], &[2.5, 3.0], &[10.0, 3.0, 2.5, 3.0]];
