//! The networks in training: forward, and backward to the gradient of every weight.
//!
//! Rows of an input are ordered by time first, then by row of a step: `[steps, rows, width]`. Whatever needs no
//! earlier step is one product over all steps. What lies between the layers stays here from the forward pass to the
//! backward pass, which may be called once after it.

#[cfg(feature = "candle")]
mod candle;
mod gru;
mod lstm;
mod native;
#[cfg(all(test, feature = "candle"))]
mod tests;

#[cfg(feature = "candle")]
use self::candle::Candle;
pub(super) use self::native::Native;
use super::memory::Flat;
use super::settings::Backend;
use crate::nn::Network;

/// The passes through a network in training.
#[derive(Clone, Debug)]
pub enum Passes {
    /// In our own kernels.
    Native(Native),
    /// In candle.
    #[cfg(feature = "candle")]
    Candle(Candle),
}

impl Passes {
    /// Those through `network`.
    pub fn new(backend: Backend, network: &Network) -> Passes {
        match backend {
            Backend::Native => Passes::Native(Native::new(network)),
            #[cfg(feature = "candle")]
            Backend::Candle => Passes::Candle(Candle::new(network)),
        }
    }

    /// The outputs `[steps, rows, outputs]` of the inputs `x` `[steps, rows, inputs]`, the one-hots among them.
    pub fn forward<'a>(&'a mut self, weights: &Flat, steps: usize, rows: usize, x: &'a [f32]) -> &'a [f32] {
        match self {
            Passes::Native(native) => native.forward(weights, steps, rows, x),
            #[cfg(feature = "candle")]
            Passes::Candle(candle) => candle.forward(weights, steps, rows, x),
        }
    }

    /// `gradient` becomes that of a loss whose derivative by the outputs of the last forward pass, that of `x`, is `d`.
    pub fn backward(&mut self, weights: &Flat, x: &[f32], d: &[f32], gradient: &mut Flat) {
        match self {
            Passes::Native(native) => {
                native.backward(weights, x, d, gradient);
            }
            #[cfg(feature = "candle")]
            Passes::Candle(candle) => candle.backward(d, gradient),
        }
    }
}
