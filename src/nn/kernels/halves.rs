//! Weights that are stored as f16, read as they are.
//!
//! The conversion is exact, so products are bit-identical to those of the same values as f32; there is just half as much to
//! read, which is what the product of one row takes most of its time for. Only AVX-512 does it in passing.

use super::linear::Linear;
use super::{ARCH, Start};
use pulp::{Arch, Simd};

/// A vector of f32 from weights of type `W`.
pub(super) trait Load<W>: Simd {
    /// Up to one vector from the front of `weights`; missing lanes are zero.
    fn load(self, weights: &[W]) -> Self::f32s;
}

impl<S: Simd> Load<f32> for S {
    #[inline(always)]
    fn load(self, weights: &[f32]) -> S::f32s {
        super::load(self, weights)
    }
}

#[cfg(target_arch = "x86_64")]
impl Load<u16> for pulp::x86::V4 {
    #[inline(always)]
    fn load(self, weights: &[u16]) -> Self::f32s {
        const LANES: usize = pulp::x86::V4::F32_LANES;
        let halves = weights.first_chunk::<LANES>().copied().unwrap_or_else(|| {
            let mut halves = [0; LANES];
            halves[..weights.len()].copy_from_slice(weights);
            halves
        });
        pulp::cast(self.avx512f._mm512_cvtph_ps(pulp::cast(halves)))
    }
}

/// Whether [`linear_of_halves`] works on this machine.
pub fn take_halves() -> bool {
    #[cfg(target_arch = "x86_64")]
    return matches!(*ARCH, Arch::V4(_));
    #[cfg(not(target_arch = "x86_64"))]
    return false;
}

/// [`linear`](super::linear()) of a weight that is the bits of f16.
///
/// # Panics
/// Unless [`take_halves`].
pub fn linear_of_halves(rows: usize, x: &[f32], weight: &[u16], start: Start, y: &mut [f32]) {
    let Some(op) = Linear::new(rows, x, weight, start, y) else { return };
    #[cfg(target_arch = "x86_64")]
    if let Arch::V4(simd) = *ARCH {
        return simd.vectorize(
            #[inline(always)]
            || op.run(simd),
        );
    }
    unreachable!("only where `take_halves` says so")
}
