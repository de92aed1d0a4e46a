//! A random matrix of probabilities: a p for each sender and receiver.

use super::level::lose_by;
use super::{Context, Fates, Link, Model};
use crate::base::error::Result;
use crate::base::rng::Purpose;

/// In `dynamic` a matrix holds for this many steps: t = 1-5, 6-10, ..
pub const DYNAMIC_PERIOD: u64 = 5;

/// `asymmetric`: entries ~ U(0, 1), drawn per episode. `dynamic`: the same, drawn again every few steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Asymmetric {
    /// Steps for which a matrix holds; `None` for all of an episode.
    pub period: Option<u64>,
}

/// The line of `asymmetric` in the registry.
pub(super) const ASYMMETRIC: Model = Model {
    name: "asymmetric",
    about: "p ~ U(0, 1) per link and episode, drop = 1 - p",
    parameters: &[],
    build: |_| Ok(Box::new(Asymmetric { period: None })),
};

/// The line of `dynamic` in the registry.
pub(super) const DYNAMIC: Model = Model {
    name: "dynamic",
    about: "p ~ U(0, 1) per link, redrawn every 5 steps, drop = 1 - p",
    parameters: &[],
    build: |_| Ok(Box::new(Asymmetric { period: Some(DYNAMIC_PERIOD) })),
};

impl Asymmetric {
    /// How often the matrix has been redrawn at this step.
    fn redraw(self, step: u64) -> u64 {
        self.period.map_or(0, |period| step.saturating_sub(1) / period)
    }
}

impl Link for Asymmetric {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let redraw = self.redraw(context.address.step);
        let mut entries = context.address.at_step(redraw).draws(Purpose::Matrix);
        lose_by(context, fates, |receiver, sender| match sender {
            0 => entries.at(receiver, 0).uniform(),
            _ => entries.uniform(),
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, rows};
    use super::*;

    #[test]
    fn matrices_are_redrawn_when_they_should() {
        let dynamic = Asymmetric { period: Some(DYNAMIC_PERIOD) };
        assert_eq!([1, 5, 6, 10, 11, 24].map(|step| dynamic.redraw(step)), [0, 0, 1, 1, 2, 4]);
    }

    #[test]
    fn links_differ() {
        // Entries ~ U(0, 1) deliver half of the time on average, but unevenly between links.
        for links in ["asymmetric", "dynamic"] {
            let one_link =
                |episode| (1..STEPS).filter(|&t| rows(links, episode, t, 2)[0] >> 1 & 1 == 1).count() as f64;
            let counts: Vec<f64> = (0..300).map(one_link).collect();
            let mean = counts.iter().sum::<f64>() / 300.0;
            let variance = counts.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / 299.0;
            assert!((mean - 12.0).abs() < 2.0, "{links}: mean {mean}");
            // A fair coin would give 24 / 4 = 6; a p drawn per episode (or per 5 steps) gives more.
            assert!(variance > 8.0, "{links}: variance {variance}");
        }
    }

    #[test]
    fn masks_do_not_depend_on_call_order_or_team_size() {
        let forward: Vec<_> = (0..STEPS).map(|t| rows("dynamic", 3, t, 6)).collect();
        let backward: Vec<_> = (0..STEPS).rev().map(|t| rows("dynamic", 3, t, 6)).collect();
        assert!(forward.iter().eq(backward.iter().rev()));
        for (t, large) in forward.iter().enumerate().skip(1) {
            let small = rows("dynamic", 3, t as u64, 4);
            assert!(small.iter().zip(large).all(|(s, l)| *s == l & 0b1111));
        }
    }
}
