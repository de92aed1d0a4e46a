//! The letters that a film is captioned with, as lines: small letters, digits and what stands between them.

/// From one letter to the next.
pub(super) const ADVANCE: f64 = 6.0;

/// How wide a text is.
pub(super) fn width(text: &str) -> f64 {
    ADVANCE * text.chars().count() as f64 - 2.0
}

/// The straight lines of a letter, from its lower left corner on the baseline: 4 wide, 4 high, 6 with an ascender.
/// What there is no letter for stays blank, and capitals are written small.
pub(super) fn strokes(letter: char) -> impl Iterator<Item = [(f64, f64); 2]> {
    let letter = letter.to_ascii_lowercase();
    let lines = LETTERS.iter().find(|(known, _)| *known == letter).map_or("", |(_, lines)| lines);
    lines.split(',').flat_map(|line| {
        let points: Vec<(f64, f64)> = line.split_ascii_whitespace().map(point).collect();
        points.windows(2).map(|ends| [ends[0], ends[1]]).collect::<Vec<_>>()
    })
}

/// Two digits: how far to the right, and how far up from two below the baseline.
fn point(digits: &str) -> (f64, f64) {
    let [x, y] = [0, 1].map(|at| f64::from(digits.as_bytes()[at] - b'0'));
    (x, y - 2.0)
}

/// Lines of points, with commas between them.
const LETTERS: [(char, &str); 48] = [
    ('a', "46 42,45 36 16 05 03 12 32 43"),
    ('b', "08 02,05 16 36 45 43 32 12 03"),
    ('c', "45 36 16 05 03 12 32 43"),
    ('d', "48 42,45 36 16 05 03 12 32 43"),
    ('e', "04 44 45 36 16 05 03 12 32 43"),
    ('f', "47 38 28 17 12,06 36"),
    ('g', "46 41 30 10 01,45 36 16 05 03 12 32 43"),
    ('h', "08 02,05 16 36 45 42"),
    ('i', "26 22,28 28"),
    ('j', "36 31 20 10,38 38"),
    ('k', "08 02,36 04 42"),
    ('l', "28 23 32"),
    ('m', "06 02,05 16 25 22,25 36 45 42"),
    ('n', "06 02,05 16 36 45 42"),
    ('o', "16 36 45 43 32 12 03 05 16"),
    ('p', "06 00,05 16 36 45 43 32 12 03"),
    ('q', "46 40,45 36 16 05 03 12 32 43"),
    ('r', "06 02,04 16 36"),
    ('s', "45 36 16 05 14 34 43 32 12 03"),
    ('t', "18 13 22 32,06 36"),
    ('u', "06 03 12 32 43,46 42"),
    ('v', "06 22 46"),
    ('w', "06 12 25 32 46"),
    ('x', "06 42,02 46"),
    ('y', "06 22,46 10 00"),
    ('z', "06 46 02 42"),
    ('0', "18 38 47 43 32 12 03 07 18"),
    ('1', "07 28 22,12 32"),
    ('2', "07 18 38 47 46 02 42"),
    ('3', "07 18 38 47 46 35 15,35 44 43 32 12 03"),
    ('4', "32 38 04 44"),
    ('5', "48 08 05 35 44 43 32 12 03"),
    ('6', "38 18 07 03 12 32 43 44 35 15 04"),
    ('7', "08 48 12"),
    ('8', "18 38 47 46 35 15 06 07 18,15 04 03 12 32 43 44 35"),
    ('9', "12 32 43 47 38 18 07 06 15 35 46"),
    ('.', "12 12"),
    (',', "22 11"),
    (':', "26 26,22 22"),
    ('-', "14 34"),
    ('_', "01 41"),
    ('=', "06 46,04 44"),
    ('+', "05 45,27 23"),
    ('%', "07 07,43 43,48 02"),
    ('(', "38 27 23 32"),
    (')', "18 27 23 12"),
    ('/', "02 48"),
    (' ', ""),
];
