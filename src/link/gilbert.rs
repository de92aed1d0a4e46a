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

/// The line of `gilbert(p, r)` in the registry.
pub(super) const MODEL: Model = Model {
    name: "gilbert",
    about: "losses in bursts: a good link turns bad with probability p, a bad one good with r",
    parameters: &[
        Parameter { name: "p", domain: Domain::PROBABILITY, default: None },
        Parameter { name: "r", domain: Domain::PROBABILITY, default: None },
    ],
    build: |arguments| Ok(Box::new(Gilbert::new(arguments[0].number(), arguments[1].number())?)),
};

/// The line of `gilbert(loss, burst)` in the registry.
pub(super) const BURSTS: Model = Model {
    name: "gilbert",
    about: "losses in bursts, given the mean loss and the mean length of bursts in steps",
    parameters: &[
        Parameter { name: "loss", domain: Domain::PROBABILITY, default: None },
        Parameter { name: "burst", domain: Domain::Number("number of steps", 1.0, 1e6), default: None },
    ],
    build: |arguments| Ok(Box::new(Gilbert::with_bursts(arguments[0].number(), arguments[1].number())?)),
};

impl Gilbert {
    /// Links that lose this share of all observations, in bursts that last `burst` steps on average.
    ///
    /// # Errors
    /// `Usage` if nothing is ever delivered, or bursts are so short that a good link would have to turn bad with a
    /// probability above 1.
    pub fn with_bursts(loss: f64, burst: f64) -> Result<Gilbert> {
        let good = super::complement(loss);
        if good == 0.0 {
            return Err(usage!(
                "loss must be below 1: a burst that never ends has no mean length; take level(0)"
            ));
        }
        let p = loss / (burst * good);
        if p > 1.0 {
            return Err(usage!(
                "burst must be at least loss / (1 - loss) = {}: with burst = {burst} the probability that a good link \
                 turns bad, loss / (burst (1 - loss)), would be {p}",
                loss / good
            ));
        }
        Gilbert::new(p, 1.0 / burst)
    }

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
        let agents = fates.agents();
        for (receiver, row) in self.good(context, agents).iter().enumerate() {
            (0..agents)
                .filter(|sender| row >> sender & 1 == 0)
                .for_each(|sender| fates.lose(receiver, sender));
        }
        Ok(())
    }
}

impl Gilbert {
    /// Which links of a team of `agents` are good at this step: bit j of row i is that to i from j.
    pub(super) fn good(&mut self, context: &Context, agents: usize) -> &[u64] {
        let address = context.address;
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
        &world.good
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Losses, STEPS, links, rows, rows_of};
    use super::*;
    use crate::base::error::Error;

    #[test]
    fn the_mean_loss_holds_at_every_step() {
        Losses::of("gilbert(0.1, 0.3)").check_every_step(|_| 0.25);
        Losses::of("gilbert(r=0.05, p=0.2)").check_every_step(|_| 0.8);
        Losses::of("gilbert(loss=0.8, burst=20)").check_every_step(|_| 0.8);
    }

    #[test]
    fn bursts_last_as_long_as_they_should() {
        for (text, expected) in
            [("gilbert(0.2, 0.5)", 2.0), ("gilbert(0.2, 0.25)", 4.0), ("gilbert(burst=10, loss=0.6)", 10.0)]
        {
            let losses = Losses::of(text);
            // Over all pairs of steps of which the first is bad: how often the second is good. Means of bursts within
            // an episode would be cut short at its end.
            let (mut bad, mut ended) = (0u32, 0u32);
            for episode in &losses.episodes {
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
            assert!((mean - expected).abs() < tolerance, "{text}: bursts last {mean}, not {expected}");
        }
    }

    #[test]
    fn bursts_that_begin_in_an_episode_have_geometric_lengths() {
        let losses = Losses::of("gilbert(0.2, 0.5)");
        // Bursts that begin at steps 1 to 10 and so have 15 steps to end in.
        let mut lengths = [0u32; 4];
        let mut bursts = 0u32;
        for episode in &losses.episodes {
            for link in 0..episode[0].len() {
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
        for (text, level) in
            [("gilbert(0.75, 0.25)", "level(0.25)"), ("gilbert(loss=0.8, burst=5)", "level(0.2)")]
        {
            let mut gilbert = links(text);
            for episode in 0..20 {
                gilbert.begin(0, episode);
                for step in 0..STEPS {
                    let level = rows(level, episode, step, 5);
                    assert_eq!(
                        rows_of(&mut gilbert, episode, step, 5),
                        level,
                        "{text}: {episode}, step {step}"
                    );
                }
            }
        }
    }

    #[test]
    fn bursts_that_no_link_can_have_are_refused() {
        assert!(Gilbert::with_bursts(0.8, 4.0).is_ok() && Gilbert::with_bursts(0.0, 1.0).is_ok());
        for (loss, burst, words) in
            [(0.8, 3.0, "burst must be at least loss / (1 - loss) = 4"), (1.0, 9.0, "loss must be below 1")]
        {
            let error = Gilbert::with_bursts(loss, burst).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
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
