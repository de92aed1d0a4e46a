//! A moment as pixels: smooth lines and circles on light paper.

use glam::DVec2;

use super::font;
use super::scene::{Anchor, Ink, Moment, Pen, Stroke};

/// A picture of so many pixels.
#[derive(Clone, Debug)]
pub(super) struct Raster {
    pub width: usize,
    pub height: usize,
    /// Row by row from the top: red, green, blue.
    pub pixels: Vec<[u8; 3]>,
}

impl Raster {
    pub(super) fn of(moment: &Moment) -> Raster {
        let (width, height) = moment.size();
        let (width, height) = (width as usize, height as usize);
        let mut raster = Raster { width, height, pixels: vec![rgb(Ink::Stage); width * height] };
        moment.draw(&mut raster);
        raster
    }

    /// Lays ink over the pixels in a box, as thick as `cover` says of the middle of each, from 0 to 1.
    fn lay(&mut self, (low, high): (DVec2, DVec2), ink: Ink, cover: impl Fn(DVec2) -> f64) {
        let within = |value: f64, most: usize| value.clamp(0.0, most as f64) as usize;
        let ink = rgb(ink);
        for y in within(low.y - 1.0, self.height)..within(high.y + 2.0, self.height) {
            for x in within(low.x - 1.0, self.width)..within(high.x + 2.0, self.width) {
                let cover = cover(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                if cover > 0.0 {
                    let pixel = &mut self.pixels[y * self.width + x];
                    for (below, above) in pixel.iter_mut().zip(ink) {
                        *below = (f64::from(*below) * (1.0 - cover) + f64::from(above) * cover).round() as u8;
                    }
                }
            }
        }
    }

    /// Lays ink along segments, each pixel once.
    fn stroke(&mut self, segments: &[[DVec2; 2]], width: f64, alpha: f64, ink: Ink) {
        let ends = || segments.iter().flatten();
        let low = ends().copied().fold(DVec2::INFINITY, DVec2::min) - width;
        let high = ends().copied().fold(DVec2::NEG_INFINITY, DVec2::max) + width;
        self.lay((low, high), ink, |at| {
            let nearest = segments.iter().map(|segment| distance(at, *segment)).fold(f64::INFINITY, f64::min);
            // A line thinner than a pixel is a fainter one.
            let (radius, faint) = (width.max(1.0) / 2.0, width.min(1.0));
            alpha * faint * (radius + 0.5 - nearest).clamp(0.0, 1.0)
        });
    }
}

impl Pen for Raster {
    fn disc(&mut self, centre: DVec2, radius: f64, ink: Ink) {
        let reach = DVec2::splat(radius);
        self.lay((centre - reach, centre + reach), ink, |at| {
            (radius + 0.5 - at.distance(centre)).clamp(0.0, 1.0)
        });
    }

    fn ring(&mut self, centre: DVec2, radius: f64, stroke: Stroke) {
        const CORNERS: u32 = 48;
        let corner =
            |corner| DVec2::from_angle(f64::from(corner) / f64::from(CORNERS) * std::f64::consts::TAU);
        let points: Vec<DVec2> = (0..=CORNERS).map(|at| centre + radius * corner(at)).collect();
        self.line(&points, stroke);
    }

    fn line(&mut self, points: &[DVec2], stroke: Stroke) {
        let Stroke { ink, width, alpha, dash } = stroke;
        if dash[1] > 0.0 {
            // They do not touch each other.
            dashes(points, dash).iter().for_each(|part| self.stroke(&[*part], width, alpha, ink));
        } else {
            let whole: Vec<[DVec2; 2]> = points.windows(2).map(|ends| [ends[0], ends[1]]).collect();
            self.stroke(&whole, width, alpha, ink);
        }
    }

    fn text(&mut self, at: DVec2, size: f64, anchor: Anchor, ink: Ink, text: &str) {
        let unit = size / 9.0;
        let left = if anchor == Anchor::Middle { at.x - unit * font::width(text) / 2.0 } else { at.x };
        for (index, letter) in text.chars().enumerate() {
            let corner = DVec2::new(left + unit * font::ADVANCE * index as f64, at.y);
            let segments: Vec<[DVec2; 2]> = font::strokes(letter)
                .map(|ends| ends.map(|(x, y)| corner + unit * DVec2::new(x, -y)))
                .collect();
            if !segments.is_empty() {
                self.stroke(&segments, 0.11 * size, 1.0, ink);
            }
        }
    }
}

/// The parts of a line that its dashes draw, with gaps between them.
fn dashes(points: &[DVec2], [dash, gap]: [f64; 2]) -> Vec<[DVec2; 2]> {
    let (mut parts, mut along) = (Vec::new(), 0.0);
    for (from, to) in points.iter().zip(&points[1..]) {
        let length = from.distance(*to);
        let at = |way: f64| from.lerp(*to, (way / length).clamp(0.0, 1.0));
        // The dashes that touch this segment, by where they begin along the line.
        let first = (along / (dash + gap)).floor() as i64;
        let last = ((along + length) / (dash + gap)).floor() as i64;
        if length > 0.0 {
            let begins = (first..=last).map(|number| number as f64 * (dash + gap) - along);
            let within = begins.filter(|begin| begin + dash > 0.0 && *begin < length);
            parts.extend(within.map(|begin| [at(begin), at(begin + dash)]));
        }
        along += length;
    }
    parts
}

fn distance(point: DVec2, [from, to]: [DVec2; 2]) -> f64 {
    let way = to - from;
    let part = ((point - from).dot(way) / way.length_squared().max(1e-12)).clamp(0.0, 1.0);
    point.distance(from + part * way)
}

fn rgb(ink: Ink) -> [u8; 3] {
    let [_, red, green, blue] = ink.colours()[0].to_be_bytes();
    [red, green, blue]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_go_on_behind_a_corner() {
        let points = [(0.0, 0.0), (5.0, 0.0), (5.0, 5.0)].map(DVec2::from);
        let parts = dashes(&points, [4.0, 2.0]);
        let expected = [[(0.0, 0.0), (4.0, 0.0)], [(5.0, 1.0), (5.0, 5.0)]];
        assert_eq!(parts, expected.map(|ends| ends.map(DVec2::from)));
    }
}
