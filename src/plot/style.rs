//! How lines, bands and text look.

use std::fmt::Write;

/// The style sheet, for this many series. Its rules hold inside of charts only, also where a chart is part of a
/// page. Renderers that know no dark mode skip that part.
pub(super) fn style(n_series: usize) -> String {
    let mut light = String::from(
        ".vs text{font-family:sans-serif;font-size:16px;fill:#24292f}
.vs .title{font-size:19px;font-weight:bold}
.vs .panel{font-weight:bold}
.vs .paper{fill:#ffffff}
.vs .grid{stroke:#d8dde3}
.vs .axis{stroke:#6e7781}
.vs .line{fill:none;stroke-width:2.2;stroke-linejoin:round}
.vs .band{opacity:.22}
",
    );
    let mut dark = String::from(
        ".vs text{fill:#e6edf3}
.vs .paper{fill:#0d1117}
.vs .grid{stroke:#30363d}
.vs .axis{stroke:#8b949e}
",
    );
    for index in 0..n_series {
        let (on_light, on_dark) = COLOURS[index % COLOURS.len()];
        let dash = DASHES[index % DASHES.len()];
        writeln!(
            light,
            ".vs .s{index}{{stroke:{on_light};stroke-dasharray:{dash}}}\n.vs .b{index}{{fill:{on_light}}}"
        )
        .expect("a string takes everything");
        writeln!(dark, ".vs .s{index}{{stroke:{on_dark}}}\n.vs .b{index}{{fill:{on_dark}}}")
            .expect("a string takes everything");
    }
    format!("{light}@media (prefers-color-scheme:dark){{\n{dark}}}\n")
}

/// Colours that colour-blind readers can tell apart, the first five after Okabe and Ito (2008), on light and on
/// dark paper.
const COLOURS: [(&str, &str); 7] = [
    ("#0072b2", "#56b4e9"),
    ("#d55e00", "#e69f00"),
    ("#009e73", "#2fc99c"),
    ("#b0508a", "#cc79a7"),
    ("#444444", "#f0e442"),
    ("#8c959f", "#8b949e"),
    ("#4b93c4", "#e07a5f"),
];

/// Their number has no factor in common with that of the colours, so 28 lines differ.
const DASHES: [&str; 4] = ["none", "9 4", "2.5 3", "10 3 2.5 3"];
