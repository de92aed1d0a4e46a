//! Links that fail in bursts.

use super::{Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::rng::Purpose;
use crate::usage;

/// `gilbert(p, r)`: each link is good or bad. A good one delivers and turns bad with probability p from one step to the
/// next; a bad one loses and turns good with probability r.
///
/// The order of the parameters is that of netem's `loss gemodel`. The first state is drawn from the stationary
/// distribution, so that at every step, from the first one on, a link loses with probability p / (p + r); bursts of
/// losses last 1 / r steps on average. With p + r = 1 nothing is remembered: `gilbert(1 - x, x)` is `level(x)`.
///
/// A link is good if and only if `U < P(good)`, given its state at the step before, with the draw `U` that `level`
/// takes. All states follow from the draws of the episode so far, in whatever order steps are asked for.
#[derive(Clone, Debug)]
pub struct Gilbert {
    bad_to_good: f64,
    /// Probability that a good link stays so.
    good_to_good: f64,
    /// Probability that a link is good when an episode begins.
    good: f64,
    worlds: Vec<World>,
}

/// The states of the links in one world.
#[derive(Clone, Debug, Default)]
struct World {
    episode: u64,
    /// The step whose states these are; `None` before the first.
    step: Option<u64>,
    /// Bit j of row i tells whether the link to i from j is good.
    good: Vec<u64>,
}

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "gilbert",
    about: "losses in bursts: a good link turns bad with probability p, a bad one good with r",
    parameters: &[
        Parameter { name: "p", domain: Domain::PROBABILITY, default: None },
        Parameter { name: "r", domain: Domain::PROBABILITY, default: None },
    ],
    build: |arguments| Ok(Box::new(Gilbert::new(arguments[0].number(), arguments[1].number())?)),
};

impl Gilbert {
    /// Links that turn bad with probability p and good with probability r.
    ///
    /// # Errors
    /// `Usage` if both are 0: then no state ever changes, and there is no stationary distribution to start from.
    pub fn new(p: f64, r: f64) -> Result<Gilbert> {
        if p + r == 0.0 {
            return Err(usage!(
                "p and r cannot both be 0: no link would ever change, and nothing says which begin good"
            ));
        }
        let good_to_good = super::complement(p);
        Ok(Gilbert { bad_to_good: r, good_to_good, good: r / (p + r), worlds: Vec::new() })
    }
}

impl Link for Gilbert {
    fn begin(&mut self, world: usize, episode: u64) {
        if self.worlds.len() <= world {
            self.worlds.resize_with(world + 1, World::default);
        }
        let world = &mut self.worlds[world];
        (world.episode, world.step) = (episode, None);
    }

    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let (address, agents) = (context.address, fates.agents());
        let world = &mut self.worlds[context.world];
        world.good.resize(agents, 0);
        // Usually the one step from the last; from the first if this one has been passed.
        let passed = world.step.filter(|step| *step <= address.step);
        for step in passed.map_or(0, |step| step + 1)..=address.step {
            let mut draws = address.at_step(step).draws(Purpose::Link);
            for (receiver, row) in world.good.iter_mut().enumerate() {
                draws.at(receiver, 0);
                let before = *row;
                *row = 0;
                for sender in 0..agents {
                    let good = match (step, before >> sender & 1) {
                        (0, _) => self.good,
                        (_, 0) => self.bad_to_good,
                        _ => self.good_to_good,
                    };
                    *row |= u64::from(draws.uniform() < good) << sender;
                }
            }
        }
        world.step = Some(address.step);
        for (receiver, row) in world.good.iter().enumerate() {
            (0..agents)
                .filter(|sender| row >> sender & 1 == 0)
                .for_each(|sender| fates.lose(receiver, sender));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, links, rows, rows_of};
    use super::*;
    use crate::base::error::Error;

    const EPISODES: u64 = 2000;
    const AGENTS: usize = 4;
    const LINKS: f64 = 12.0;

    /// Whether each link but an agent's own lost, `[episode][step][link]`.
    fn losses(text: &str) -> Vec<Vec<Vec<bool>>> {
        let mut links = links(text).sharing_at_start(false);
        let mut episode = |episode| {
            links.begin(0, episode);
            let mut step = |step| {
                let rows = rows_of(&mut links, episode, step, AGENTS);
                let pairs = (0..AGENTS * AGENTS).map(|pair| (pair / AGENTS, pair % AGENTS));
                pairs.filter(|(i, j)| i != j).map(|(i, j)| rows[i] >> j & 1 == 0).collect()
            };
            (0..=STEPS).map(&mut step).collect()
        };
        (0..EPISODES).map(&mut episode).collect()
    }

    #[test]
    fn the_mean_loss_holds_at_every_step() {
        for (text, p, r) in [("gilbert(0.1, 0.3)", 0.1, 0.3), ("gilbert(r=0.05, p=0.2)", 0.2, 0.05)] {
            let losses = losses(text);
            let expected = p / (p + r);
            for step in 0..=STEPS as usize {
                let lost = losses.iter().flat_map(|episode| &episode[step]).filter(|lost| **lost).count();
                let n = EPISODES as f64 * LINKS;
                let sigma = (expected * (1.0 - expected) / n).sqrt();
                let rate = lost as f64 / n;
                assert!(
                    (rate - expected).abs() < 5.0 * sigma,
                    "{text}, step {step}: {rate} is not {expected}"
                );
            }
        }
    }

    #[test]
    fn bursts_last_as_long_as_they_should() {
        for (r, expected) in [(0.5, 2.0), (0.25, 4.0)] {
            let losses = losses(&format!("gilbert(0.2, {r})"));
            // Over all pairs of steps of which the first is bad: how often the second is good. Means of bursts within
            // an episode would be cut short at its end.
            let (mut bad, mut ended) = (0u32, 0u32);
            for episode in &losses {
                for pair in episode.windows(2) {
                    for (before, after) in pair[0].iter().zip(&pair[1]).filter(|(before, _)| **before) {
                        bad += u32::from(*before);
                        ended += u32::from(!after);
                    }
                }
            }
            let mean = f64::from(bad) / f64::from(ended);
            // The relative error of a count of n geometric ends is about 1 / sqrt(n).
            let tolerance = 5.0 * expected / f64::from(ended).sqrt();
            assert!((mean - expected).abs() < tolerance, "r = {r}: bursts last {mean}, not {expected}");
        }
    }

    #[test]
    fn bursts_that_begin_in_an_episode_have_geometric_lengths() {
        let losses = losses("gilbert(0.2, 0.5)");
        // Bursts that begin at steps 1 to 10 and so have 15 steps to end in.
        let mut lengths = [0u32; 4];
        let mut bursts = 0u32;
        for episode in &losses {
            for link in 0..LINKS as usize {
                for begin in (1..=10).filter(|step| episode[*step][link] && !episode[*step - 1][link]) {
                    let length = episode[begin..].iter().take_while(|losses| losses[link]).count();
                    bursts += 1;
                    if let Some(count) = lengths.get_mut(length - 1) {
                        *count += 1;
                    }
                }
            }
        }
        for (length, count) in (1..).zip(lengths) {
            let expected = 0.5f64.powi(length);
            let sigma = (expected * (1.0 - expected) / f64::from(bursts)).sqrt();
            let share = f64::from(count) / f64::from(bursts);
            assert!((share - expected).abs() < 5.0 * sigma, "length {length}: {share} is not {expected}");
        }
    }

    #[test]
    fn without_memory_it_is_a_level() {
        let mut gilbert = links("gilbert(0.75, 0.25)");
        for episode in 0..20 {
            gilbert.begin(0, episode);
            for step in 0..STEPS {
                let level = rows("level(0.25)", episode, step, 5);
                assert_eq!(rows_of(&mut gilbert, episode, step, 5), level, "episode {episode}, step {step}");
            }
        }
    }

    #[test]
    fn states_follow_from_the_address_alone() {
        let mut forward = links("gilbert(0.1, 0.3)");
        forward.begin(0, 7);
        let in_order: Vec<_> = (0..STEPS).map(|step| rows_of(&mut forward, 7, step, 6)).collect();
        let mut other = links("gilbert(0.1, 0.3)");
        // Another episode has been played in this world before.
        other.begin(0, 6);
        rows_of(&mut other, 6, 20, 6);
        other.begin(0, 7);
        for step in [24, 3, 3, 4, 9, 0, 24] {
            assert_eq!(rows_of(&mut other, 7, step, 6), in_order[step as usize], "step {step}");
        }
        // Nor do they depend on the size of the team.
        other.begin(0, 7);
        let small = rows_of(&mut other, 7, 24, 3);
        assert!(small.iter().zip(&in_order[24]).all(|(small, large)| *small == large & 0b111));
        // Sharing everything at the start does not touch them.
        assert_eq!(in_order[0], [0b111111; 6]);
        let mut losing = links("gilbert(0.1, 0.3)").sharing_at_start(false);
        losing.begin(0, 7);
        assert_ne!(rows_of(&mut losing, 7, 0, 6), in_order[0]);
        assert_eq!(rows_of(&mut losing, 7, 1, 6), in_order[1]);
    }

    #[test]
    fn better_links_deliver_what_worse_ones_do() {
        let mut nested = ["gilbert(0.3, 0.2)", "gilbert(0.2, 0.2)", "gilbert(0.2, 0.4)"].map(links);
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

    #[test]
    fn states_that_nothing_says_are_refused() {
        let error = Gilbert::new(0.0, 0.0).unwrap_err();
        assert!(matches!(error, Error::Usage(_)), "{error:?}");
        for (text, expected) in [("gilbert(0, 0.5)", 0b11), ("gilbert(0.5, 0)", 0b01)] {
            let mut links = links(text);
            links.begin(0, 0);
            assert_eq!(rows_of(&mut links, 0, 1, 2)[0], expected, "{text}");
        }
    }
}
