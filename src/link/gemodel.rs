//! Links that fail in bursts, and now and then in between.

use super::{Context, Domain, Fates, Gilbert, Link, Model, Parameter, complement};
use crate::base::error::Result;
use crate::base::rng::Purpose;

/// `gemodel(p, r, 1-h, 1-k)`: the links of [`Gilbert`], but a bad one loses each observation with probability 1 - h and a
/// good one with 1 - k, independently.
///
/// Names and order of the parameters are those of netem's `loss gemodel`. With 1 - h = 1 and 1 - k = 0 it is
/// `gilbert(p, r)`.
#[derive(Clone, Debug)]
pub struct Gemodel {
    states: Gilbert,
    /// Probability that a bad link delivers, h.
    bad: f64,
    /// The same of a good one, k.
    good: f64,
}

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "gemodel",
    about: "bursts as in gilbert(p, r), but a bad link loses with probability 1-h and a good one with 1-k, as in netem",
    parameters: &[
        Parameter { name: "p", domain: Domain::PROBABILITY, default: None },
        Parameter { name: "r", domain: Domain::PROBABILITY, default: None },
        Parameter { name: "1-h", domain: Domain::PROBABILITY, default: Some("1") },
        Parameter { name: "1-k", domain: Domain::PROBABILITY, default: Some("0") },
    ],
    build: |arguments| {
        let [p, r, bad, good] = [0, 1, 2, 3].map(|at| arguments[at].number());
        let (bad, good) = (complement(bad), complement(good));
        Ok(Box::new(Gemodel { states: Gilbert::new(p, r)?, bad, good }))
    },
};

impl Link for Gemodel {
    fn begin(&mut self, world: usize, episode: u64) {
        self.states.begin(world, episode);
    }

    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let mut draws = context.address.draws(Purpose::Loss);
        for (receiver, row) in self.states.good(context, fates.agents()).iter().enumerate() {
            draws.at(receiver, 0);
            for sender in 0..fates.agents() {
                let delivers = if row >> sender & 1 == 1 { self.good } else { self.bad };
                if draws.uniform() >= delivers {
                    fates.lose(receiver, sender);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Losses, STEPS, links, rows_of};

    #[test]
    fn the_mean_loss_holds_at_every_step() {
        // Bad a quarter of the time: 0.25 * 0.9 + 0.75 * 0.1.
        Losses::of("gemodel(0.1, 0.3, 0.9, 0.1)").check_every_step(|_| 0.3);
        Losses::of("gemodel(p=0.2, r=0.2, 1-k=0.5, 1-h=0)").check_every_step(|_| 0.25);
    }

    #[test]
    fn losses_are_as_correlated_as_states() {
        // Both of two consecutive ones are lost with sum over states of P(a) l(a) P(a to b) l(b).
        let losses = Losses::of("gemodel(0.1, 0.3, 0.9, 0.1)");
        let expected = 0.75 * 0.1 * (0.9 * 0.1 + 0.1 * 0.9) + 0.25 * 0.9 * (0.3 * 0.1 + 0.7 * 0.9);
        losses.check_share("two in a row", expected, |episode, link| {
            episode.windows(2).map(|pair| pair[0][link] && pair[1][link]).collect()
        });
    }

    #[test]
    fn with_certain_losses_it_is_gilbert() {
        let [mut full, mut simple] = ["gemodel(0.1, 0.3)", "gilbert(0.1, 0.3)"].map(links);
        for episode in 0..20 {
            full.begin(0, episode);
            simple.begin(0, episode);
            for step in 0..STEPS {
                assert_eq!(rows_of(&mut full, episode, step, 5), rows_of(&mut simple, episode, step, 5));
            }
        }
    }

    #[test]
    fn fewer_losses_within_states_deliver_more() {
        let mut nested =
            ["gemodel(0.2, 0.2, 1, 0.3)", "gemodel(0.2, 0.2, 0.8, 0.3)", "gemodel(0.2, 0.2, 0.8)"].map(links);
        for episode in 0..20 {
            nested.iter_mut().for_each(|links| links.begin(0, episode));
            for step in 0..STEPS {
                let masks = nested.each_mut().map(|links| rows_of(links, episode, step, 6));
                for pair in masks.windows(2) {
                    assert!(pair[0].iter().zip(&pair[1]).all(|(worse, better)| worse & !better == 0));
                }
            }
        }
    }
}
