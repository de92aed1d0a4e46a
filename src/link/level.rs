//! One probability for all links.

use super::{Address, Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::rng::Purpose;

/// `level(p)`: every link delivers with probability p, each observation by itself.
///
/// A link delivers if and only if `U < p`, with `U` drawn at (seed, episode, step, receiver, sender). The draw does not
/// depend on p, so masks are nested: what is delivered at p is delivered at every higher p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// The probability of delivery.
    pub p: f64,
}

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "level",
    about: "every link delivers with probability p",
    parameters: &[Parameter { name: "p", domain: Domain::PROBABILITY, default: None }],
    build: |arguments| Ok(Box::new(Level { p: arguments[0].number() })),
};

impl Link for Level {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let p = self.p;
        lose_by(context, fates, |_, _| p);
        Ok(())
    }

    fn level(&self, _address: &Address) -> Option<f64> {
        Some(self.p)
    }

    fn dial(&mut self) -> Option<&mut f64> {
        Some(&mut self.p)
    }
}

/// Loses what is not delivered with the probability `p(receiver, sender)`. The draws are the same for all models that
/// lose this way, so that they can be compared on equal ones.
pub(super) fn lose_by(context: &Context, fates: &mut Fates, mut p: impl FnMut(usize, usize) -> f64) {
    let mut draws = context.address.draws(Purpose::Link);
    for receiver in 0..fates.agents() {
        draws.at(receiver, 0);
        for sender in 0..fates.agents() {
            let p = p(receiver, sender);
            if draws.uniform() >= p {
                fates.lose(receiver, sender);
            }
        }
    }
}

/// 1 - p without the noise of the subtraction, so that a drop of 0.8 is a p of 0.2 and no neighbour of it.
pub fn complement(p: f64) -> f64 {
    const DIGITS: f64 = 1e12;
    ((1.0 - p) * DIGITS).round() / DIGITS
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, check_rate, rows};
    use super::*;

    #[test]
    fn a_drop_is_the_p_it_means() {
        assert_eq!([0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0].map(complement), [1.0, 0.8, 0.6, 0.4, 0.2, 0.1, 0.0]);
    }

    #[test]
    fn realised_rates_are_the_level() {
        for p in [0.0, 0.2, 0.5, 0.8, 1.0] {
            check_rate(&format!("level({p})"), p);
        }
    }

    #[test]
    fn masks_are_nested_across_p() {
        let levels = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0].map(|p| format!("level({p})"));
        for episode in 0..20 {
            for step in 0..STEPS {
                for pair in levels.windows(2) {
                    let [low, high] = [0, 1].map(|i| rows(&pair[i], episode, step, 12));
                    assert!(low.iter().zip(&high).all(|(l, h)| l & !h == 0));
                }
            }
        }
    }
}
