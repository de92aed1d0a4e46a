//! One probability for all links, another in each episode.

use super::level::lose_by;
use super::{Address, Context, Fates, Link, Model};
use crate::base::error::Result;
use crate::base::rng::Purpose;

/// `uniform`: one p ~ U(0, 1) per episode, the same for every link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Uniform;

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "uniform",
    about: "one p ~ U(0, 1) per episode, drop = 1 - p",
    parameters: &[],
    build: |_| Ok(Box::new(Uniform)),
};

impl Uniform {
    fn p(self, address: &Address) -> f64 {
        address.at_step(0).draws(Purpose::Level).uniform()
    }
}

impl Link for Uniform {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let p = self.p(&context.address);
        lose_by(context, fates, |_, _| p);
        Ok(())
    }

    fn level(&self, address: &Address) -> Option<f64> {
        Some(self.p(address))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_uniform_and_those_of_their_episode() {
        let address = |episode| Address { seed: 5, position: 0, episode, step: 7 };
        let levels: Vec<f64> = (0..200).map(|e| Uniform.level(&address(e)).unwrap()).collect();
        assert!(levels.iter().all(|p| (0.0..1.0).contains(p)));
        // Standard error of the mean of 200 uniforms is 0.02.
        assert!((levels.iter().sum::<f64>() / 200.0 - 0.5).abs() < 0.1);
        assert_eq!(Uniform.level(&address(3).at_step(9)), Some(levels[3]));
    }
}
