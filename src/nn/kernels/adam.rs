//! The optimiser Adam (Kingma and Ba, arXiv 1412.6980) with PyTorch's conventions, in one pass over memory.

use super::{load, store};
use pulp::{Simd, WithSimd};

/// What is the same for all weights in one step of Adam.
///
/// With `m` and `v` the running means of the gradient and of its square, a weight moves by
/// `-rate * m / (root * sqrt(v) + epsilon)`.
#[derive(Clone, Copy, Debug)]
pub struct AdamStep {
    scale: f32,
    rate: f32,
    root: f32,
}

impl AdamStep {
    const BETA_1: f64 = 0.9;
    const BETA_2: f64 = 0.999;
    const EPSILON: f32 = 1e-8;

    /// Step `number` (from 1) with `learning_rate`, on gradients multiplied by `scale`.
    pub fn new(number: u64, learning_rate: f64, scale: f64) -> AdamStep {
        // No training takes 2^31 steps; both corrections are 1 long before.
        let number = i32::try_from(number).unwrap_or(i32::MAX);
        let correction = |beta: f64| 1.0 - beta.powi(number);
        AdamStep {
            scale: scale as f32,
            rate: (learning_rate / correction(Self::BETA_1)) as f32,
            root: (1.0 / correction(Self::BETA_2).sqrt()) as f32,
        }
    }
}

/// [`adam`](super::adam).
pub(super) struct Adam<'a> {
    pub step: AdamStep,
    pub gradient: &'a [f32],
    pub mean: &'a mut [f32],
    pub square: &'a mut [f32],
    pub values: &'a mut [f32],
}

impl WithSimd for Adam<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Adam { step, gradient, mean, square, values } = self;
        let [scale, rate, root, epsilon] =
            [step.scale, step.rate, step.root, AdamStep::EPSILON].map(|value| simd.splat_f32s(value));
        // 1 - beta is taken in f64: in f32 that of beta 2 is off by 5e-5.
        let [keep_mean, take_mean, keep_square, take_square] =
            [AdamStep::BETA_1, 1.0 - AdamStep::BETA_1, AdamStep::BETA_2, 1.0 - AdamStep::BETA_2]
                .map(|beta| simd.splat_f32s(beta as f32));
        let moments = mean.chunks_mut(S::F32_LANES).zip(square.chunks_mut(S::F32_LANES));
        let weights = gradient.chunks(S::F32_LANES).zip(values.chunks_mut(S::F32_LANES));
        for ((mean, square), (gradient, value)) in moments.zip(weights) {
            let g = simd.mul_f32s(load(simd, gradient), scale);
            let m = simd.mul_add_e_f32s(take_mean, g, simd.mul_f32s(keep_mean, load(simd, mean)));
            let kept = simd.mul_f32s(keep_square, load(simd, square));
            let v = simd.mul_add_e_f32s(take_square, simd.mul_f32s(g, g), kept);
            let size = simd.mul_add_e_f32s(simd.sqrt_f32s(v), root, epsilon);
            let change = simd.div_f32s(simd.mul_f32s(m, rate), size);
            store(simd, mean, m);
            store(simd, square, v);
            let after = simd.sub_f32s(load(simd, value), change);
            store(simd, value, after);
        }
    }
}
