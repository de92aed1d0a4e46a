//! Weights of four bits, for what needs no more than a guess: an eighth of what f32 takes to read.
//!
//! Inputs are rounded too, to 8 bits, so all sums are of whole numbers, and whole numbers have no order to add them in. What
//! is left for f32 is the same few operations everywhere. So the bits of a result do not even depend on whether the CPU has
//! fused multiply-add.

use super::Start;
use pulp::Arch;
#[cfg(target_arch = "x86_64")]
use pulp::core_arch::x86::Avx512vnni;

/// A weight `[k, n]` of four bits. In each column the sixteen values that there are go in equal steps from the least of its
/// weights to the greatest.
#[derive(Clone, Debug)]
pub struct Nibbles {
    k: usize,
    n: usize,
    /// `[panels, k]`: all inputs of a panel of columns, then those of the next.
    lines: Vec<Line>,
    /// The least of each column, and how far its values are apart, `[n]`.
    lows: Vec<f32>,
    steps: Vec<f32>,
}

/// The weights that meet one input, of one panel: as many columns as a cache line holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(64))]
struct Line([u8; 64]);

/// Columns of a panel.
const PANEL: usize = 128;

/// So many inputs are rounded together, by the largest of them, and wait on the stack.
const BLOCK: usize = 1024;

impl Nibbles {
    /// Those nearest to the values of a weight whose rows have `n` columns.
    pub fn nearest(weight: &[f32], n: usize) -> Nibbles {
        let k = weight.len() / n;
        assert_eq!(weight.len(), k * n, "nibbles: the weight is not [k, n]");
        let (mut lows, mut highs) = (vec![f32::INFINITY; n], vec![f32::NEG_INFINITY; n]);
        for row in weight.chunks_exact(n) {
            lows.iter_mut().zip(row).for_each(|(low, value)| *low = low.min(*value));
            highs.iter_mut().zip(row).for_each(|(high, value)| *high = high.max(*value));
        }
        let steps: Vec<f32> = lows.iter().zip(highs).map(|(low, high)| (high - low) / 15.0).collect();
        let mut lines = vec![Line([0; 64]); n.div_ceil(PANEL) * k];
        for (i, row) in weight.chunks_exact(n).enumerate() {
            for (column, value) in row.iter().enumerate() {
                // In a column of one value the step is zero, and so is what this makes of 0 / 0.
                let nibble = ((value - lows[column]) / steps[column]).round() as u8;
                let (byte, shift) = place(column % PANEL);
                lines[column / PANEL * k + i].0[byte] |= nibble.min(15) << shift;
            }
        }
        Nibbles { k, n, lines, lows, steps }
    }
}

/// Where the weight of a panel's column is in a line: in which byte, and how many bits up. Chosen so that the sums which the
/// vector kernels end up with lie in the order of the columns.
fn place(column: usize) -> (usize, u32) {
    let [high, group, lane, at] = [column / 64, column / 16 % 4, column / 4 % 4, column % 4];
    (16 * lane + 4 * group + at, 4 * high as u32)
}

/// [`linear`](super::linear()) of a weight of four bits, and of inputs rounded to eight.
pub fn linear_of_nibbles(rows: usize, x: &[f32], weight: &Nibbles, start: Start, y: &mut [f32]) {
    run_on(*super::ARCH, rows, x, weight, start, y);
}

pub(super) fn run_on(arch: Arch, rows: usize, x: &[f32], weight: &Nibbles, start: Start, y: &mut [f32]) {
    let Nibbles { k, n, .. } = *weight;
    assert_eq!((x.len(), y.len()), (rows * k, rows * n), "nibbles: x is not [rows, k], or y not [rows, n]");
    for (x, y) in x.chunks_exact(k).zip(y.chunks_exact_mut(n)) {
        match start {
            Start::Bias(bias) => y.copy_from_slice(bias),
            Start::Output => {}
            Start::Zero => y.fill(0.0),
        }
        for (at, x) in x.chunks(BLOCK).enumerate() {
            let op = Block { x, first: at * BLOCK, weight, y };
            match arch {
                #[cfg(target_arch = "x86_64")]
                Arch::V4(simd) => simd.vectorize(
                    #[inline(always)]
                    || match Avx512vnni::try_new() {
                        Some(vnni) => {
                            op.run(|fours, lines, next| vnni::sums((simd, vnni), fours, lines, next))
                        }
                        None => op.run(|fours, lines, next| avx2::sums(*simd, fours, lines, next)),
                    },
                ),
                #[cfg(target_arch = "x86_64")]
                Arch::V3(simd) => simd.vectorize(
                    #[inline(always)]
                    || op.run(|fours, lines, next| avx2::sums(simd, fours, lines, next)),
                ),
                _ => op.run(sums),
            }
        }
    }
}

/// A part of the inputs of a row, and the outputs that it adds to.
struct Block<'a> {
    x: &'a [f32],
    /// Which input comes first.
    first: usize,
    weight: &'a Nibbles,
    y: &'a mut [f32],
}

/// Four inputs that are not zero, and where their weights are.
#[derive(Clone, Copy, Default)]
struct Four {
    at: [u16; 4],
    x: [i8; 4],
}

impl Block<'_> {
    /// With the sums over all fours of the columns of a panel, given its lines and those of the panel behind it.
    #[inline(always)]
    fn run(self, sums: impl Fn(&[Four], &[Line], &[Line]) -> [i32; PANEL]) {
        let Block { x, first, weight, y } = self;
        let largest = x.iter().fold(0.0, |largest: f32, x| largest.max(x.abs()));
        if largest == 0.0 {
            return;
        }
        let mut rounded = [0i8; BLOCK];
        for (rounded, x) in rounded.iter_mut().zip(x) {
            // Adding 1.5 * 2^23 leaves no bits for a fraction.
            *rounded = (x / largest * 127.0 + 12_582_912.0).to_bits() as i8;
        }
        let rounded = &rounded[..x.len()];
        let total: i32 = rounded.iter().map(|x| i32::from(*x)).sum();
        // Zeros, half of what a ReLU says, cost nothing: their weights are not read.
        let mut fours = [Four::default(); BLOCK / 4 + 1];
        let mut len = 0;
        for (at, x) in rounded.iter().enumerate() {
            let four = &mut fours[len / 4];
            (four.at[len % 4], four.x[len % 4]) = (at as u16, *x);
            len += usize::from(*x != 0);
        }
        // What was written behind the last.
        fours[len / 4].x[len % 4..].fill(0);
        let fours = &fours[..len.div_ceil(4)];

        let (unit, total) = (largest / 127.0, total as f32);
        let columns = weight.lows.chunks(PANEL).zip(weight.steps.chunks(PANEL)).zip(y.chunks_mut(PANEL));
        let panels = weight.lines.chunks_exact(weight.k).map(|lines| &lines[first..][..x.len()]);
        let next = panels.clone().skip(1).chain(panels.clone().next_back());
        for ((lines, next), ((lows, steps), y)) in panels.zip(next).zip(columns) {
            let sums = sums(fours, lines, next);
            for (((y, sum), low), step) in y.iter_mut().zip(sums).zip(lows).zip(steps) {
                *y += unit * (step * sum as f32 + low * total);
            }
        }
    }
}

/// For any machine.
fn sums(fours: &[Four], lines: &[Line], _next: &[Line]) -> [i32; PANEL] {
    let mut sums = [[0; 64]; 2];
    for Four { at, x } in fours {
        for (at, x) in at.iter().zip(x) {
            let [lows, highs] = &mut sums;
            for ((low, high), byte) in lows.iter_mut().zip(highs).zip(lines[usize::from(*at)].0) {
                *low += i32::from(byte & 15) * i32::from(*x);
                *high += i32::from(byte >> 4) * i32::from(*x);
            }
        }
    }
    std::array::from_fn(|column| {
        let (byte, shift) = place(column);
        sums[shift as usize / 4][byte]
    })
}

/// One vector is a line, and one instruction makes sums over four inputs.
#[cfg(target_arch = "x86_64")]
mod vnni {
    use super::super::fetch;
    use super::{Avx512vnni, Four, Line, PANEL};
    use pulp::cast;
    use pulp::x86::V4;
    use std::arch::x86_64::*;

    pub(super) fn sums(
        _cpu: (V4, Avx512vnni),
        fours: &[Four],
        lines: &[Line],
        next: &[Line],
    ) -> [i32; PANEL] {
        // SAFETY: there is a `V4` and an `Avx512vnni` only where the CPU has these instructions.
        unsafe { sums_of(fours, lines, next) }
    }

    #[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
    fn sums_of(fours: &[Four], lines: &[Line], next: &[Line]) -> [i32; PANEL] {
        let nibble = _mm512_set1_epi8(15);
        let mut sums = [_mm512_setzero_si512(); 8];
        for Four { at, x } in fours {
            let [a, b, c, d] = at.map(|at| -> __m512i { cast(lines[usize::from(at)].0) });
            at.iter().for_each(|at| fetch(&next[usize::from(*at)]));
            let x = _mm512_set1_epi32(i32::from_le_bytes(x.map(|x| x as u8)));
            let ab = [_mm512_unpacklo_epi8(a, b), _mm512_unpackhi_epi8(a, b)];
            let cd = [_mm512_unpacklo_epi8(c, d), _mm512_unpackhi_epi8(c, d)];
            for half in 0..2 {
                let (ab, cd) = (ab[half], cd[half]);
                let abcd = [_mm512_unpacklo_epi16(ab, cd), _mm512_unpackhi_epi16(ab, cd)];
                for (quarter, bytes) in abcd.into_iter().enumerate() {
                    let low = _mm512_and_si512(bytes, nibble);
                    let high = _mm512_and_si512(_mm512_srli_epi16::<4>(bytes), nibble);
                    for (at, weights) in [low, high].into_iter().enumerate() {
                        let sum = &mut sums[4 * at + 2 * half + quarter];
                        *sum = _mm512_dpbusd_epi32(*sum, weights, x);
                    }
                }
            }
        }
        cast(sums)
    }
}

/// Two vectors are a line.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::super::fetch;
    use super::{Four, Line, PANEL};
    use pulp::cast;
    use std::arch::x86_64::__m256i;

    #[inline(always)]
    pub(super) fn sums(simd: pulp::x86::V3, fours: &[Four], lines: &[Line], next: &[Line]) -> [i32; PANEL] {
        let (avx, avx2) = (simd.avx, simd.avx2);
        let (nibble, ones) = (avx._mm256_set1_epi8(15), avx._mm256_set1_epi16(1));
        let mut all = [[avx._mm256_setzero_si256(); 2]; 8];
        for part in 0..2 {
            let mut sums = [avx._mm256_setzero_si256(); 8];
            for Four { at, x } in fours {
                let [a, b, c, d] = at.map(|at| -> __m256i {
                    let parts: [__m256i; 2] = cast(lines[usize::from(at)].0);
                    parts[part]
                });
                at.iter().for_each(|at| fetch(&next[usize::from(*at)]));
                let x = avx._mm256_set1_epi32(i32::from_le_bytes(x.map(|x| x as u8)));
                let ab = [avx2._mm256_unpacklo_epi8(a, b), avx2._mm256_unpackhi_epi8(a, b)];
                let cd = [avx2._mm256_unpacklo_epi8(c, d), avx2._mm256_unpackhi_epi8(c, d)];
                for half in 0..2 {
                    let (ab, cd) = (ab[half], cd[half]);
                    let abcd = [avx2._mm256_unpacklo_epi16(ab, cd), avx2._mm256_unpackhi_epi16(ab, cd)];
                    for (quarter, bytes) in abcd.into_iter().enumerate() {
                        let low = avx2._mm256_and_si256(bytes, nibble);
                        let high = avx2._mm256_and_si256(avx2._mm256_srli_epi16::<4>(bytes), nibble);
                        for (at, weights) in [low, high].into_iter().enumerate() {
                            let sum = &mut sums[4 * at + 2 * half + quarter];
                            let dot = avx2._mm256_madd_epi16(avx2._mm256_maddubs_epi16(weights, x), ones);
                            *sum = avx2._mm256_add_epi32(*sum, dot);
                        }
                    }
                }
            }
            all.iter_mut().zip(sums).for_each(|(all, sum)| all[part] = sum);
        }
        cast(all)
    }
}
