//! An episode as a film: an animated GIF with few colours. Each frame holds only what has changed.

use std::collections::{BTreeMap, HashMap};

use gif::{DisposalMethod, Encoder, Frame, Repeat};

use super::raster::Raster;
use super::scene::Moment;
use crate::base::error::Result;
use crate::failed;

/// How much slower than the world it runs: one can follow a step of 0.1 s then.
const SLOWER: f64 = 2.0;

/// The least time of a frame, hundredths of a second: browsers show shorter ones for longer.
const SHORTEST: f64 = 5.0;

/// How long the end stays, hundredths of a second.
const END: u16 = 150;

/// How many frames the colours are chosen from.
const SAMPLES: usize = 12;

/// Says of a pixel that it is as before. The numbers below are colours: there are few of them, for a small file.
const AS_BEFORE: u8 = 63;

/// The film of the take that `moment` is of, from its beginning to its end. It runs again and again.
pub(crate) fn gif(moment: &Moment) -> Result<Vec<u8>> {
    let films = moment.films.iter();
    let steps = films.map(|film| film.takes[moment.take].steps_taken()).max().unwrap_or(0);
    let hundredths = 100.0 * SLOWER * moment.films[0].spec().dt;
    let frames_a_step = (hundredths / SHORTEST).floor().clamp(1.0, 4.0);
    let delay = (hundredths / frames_a_step).round().clamp(SHORTEST, 100.0) as u16;
    let last = steps * frames_a_step as usize;
    let picture = |frame| Raster::of(&Moment { time: frame as f64 / frames_a_step, ..*moment });
    let palette = Palette::of((0..=last).step_by(last / SAMPLES + 1).map(picture));
    let frames = (0..=last).map(|frame| (picture(frame), if frame == last { END } else { delay }));
    encode(palette, frames).map_err(|e| failed!("cannot make the film: {e}"))
}

fn encode(
    mut palette: Palette,
    frames: impl Iterator<Item = (Raster, u16)>,
) -> std::result::Result<Vec<u8>, gif::EncodingError> {
    let mut frames = frames.peekable();
    let Raster { width, height, .. } =
        *frames.peek().map(|(picture, _)| picture).expect("a film has a frame");
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, width as u16, height as u16, &palette.colours.concat())?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut before = vec![AS_BEFORE; width * height];
    for (picture, delay) in frames {
        let now: Vec<u8> = picture.pixels.iter().map(|pixel| palette.number(*pixel)).collect();
        let (left, top, wide, high) = changes(&before, &now, width);
        let rows = (top..top + high).flat_map(|y| (left..left + wide).map(move |x| y * width + x));
        let buffer: Vec<u8> =
            rows.map(|at| if now[at] == before[at] { AS_BEFORE } else { now[at] }).collect();
        encoder.write_frame(&Frame {
            delay,
            dispose: DisposalMethod::Keep,
            transparent: Some(AS_BEFORE),
            left: left as u16,
            top: top as u16,
            width: wide as u16,
            height: high as u16,
            buffer: buffer.into(),
            ..Frame::default()
        })?;
        before = now;
    }
    drop(encoder);
    Ok(file)
}

/// The box that holds all changes: left, top, width and height, one pixel at least.
fn changes(before: &[u8], now: &[u8], width: usize) -> (usize, usize, usize, usize) {
    let changed = (0..now.len()).filter(|at| before[*at] != now[*at]);
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for at in changed {
        let (x, y) = (at % width, at / width);
        (left, right, top, bottom) = (left.min(x), right.max(x), top.min(y), bottom.max(y));
    }
    if left > right { (0, 0, 1, 1) } else { (left, top, right - left + 1, bottom - top + 1) }
}

/// The colours that a film has most often, and the nearest of them for all others.
struct Palette {
    colours: Vec<[u8; 3]>,
    numbers: HashMap<[u8; 3], u8>,
}

impl Palette {
    fn of(pictures: impl Iterator<Item = Raster>) -> Palette {
        let mut counts: BTreeMap<[u8; 3], usize> = BTreeMap::new();
        for pixel in pictures.flat_map(|picture| picture.pixels) {
            *counts.entry(pixel).or_default() += 1;
        }
        let mut colours: Vec<([u8; 3], usize)> = counts.into_iter().collect();
        colours.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        let colours = colours.into_iter().map(|(colour, _)| colour).take(AS_BEFORE.into()).collect();
        Palette { colours, numbers: HashMap::new() }
    }

    fn number(&mut self, colour: [u8; 3]) -> u8 {
        let Palette { colours, numbers } = self;
        *numbers.entry(colour).or_insert_with(|| {
            let apart = |other: &[u8; 3]| -> u32 {
                colour.iter().zip(other).map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum()
            };
            (0..colours.len()).min_by_key(|at| apart(&colours[*at])).expect("a film has a colour") as u8
        })
    }
}
