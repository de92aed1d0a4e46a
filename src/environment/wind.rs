//! Wind: a force on all agents alike that comes in gusts, and does not change from one step to the next all at once.

use glam::DVec2;

use super::Physics;
use super::moment::Moment;
use crate::base::rng::Purpose;

/// How long a gust lasts, s: after that time the wind still has 1/e of what it was.
const GUST: f64 = 0.5;

/// The wind of an episode: a first-order autoregressive process along each axis, stationary from the first step on.
#[derive(Clone, Debug)]
pub(super) struct Wind {
    /// Standard deviation of its force along each axis, N.
    std: f64,
    /// The share of its force that is left after a step.
    keep: f64,
    /// Its force, in standard deviations.
    now: DVec2,
}

impl Wind {
    /// That of these laws, before the first episode.
    pub(super) fn of(physics: &Physics) -> Wind {
        Wind { std: physics.wind * physics.force, keep: (-physics.dt / GUST).exp(), now: DVec2::ZERO }
    }

    /// Begins an episode, which `moment` is the first step of.
    pub(super) fn begin(&mut self, moment: Moment) {
        if self.std > 0.0 {
            self.now = moment.draws(Purpose::Wind).at(0, 0).normal();
        }
    }

    /// Adds its force to those on all agents, then changes. What it is in the next step is drawn at the address of
    /// ([`Purpose::Wind`], episode, step): its change behind where it begins.
    #[inline]
    pub(super) fn blow(&mut self, moment: Moment, forces: &mut [DVec2]) {
        if self.std > 0.0 {
            self.push(moment, forces);
        }
    }

    /// Apart, so that a step without wind stays small.
    #[cold]
    fn push(&mut self, moment: Moment, forces: &mut [DVec2]) {
        forces.iter_mut().for_each(|force| *force += self.std * self.now);
        let change = moment.draws(Purpose::Wind).at(1, 0).normal();
        self.now = self.keep * self.now + (1.0 - self.keep * self.keep).sqrt() * change;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::stats::{mean, std};

    /// The force on each of three agents, step by step.
    fn forces(wind: f64, episode: u64) -> Vec<[DVec2; 3]> {
        let (mut moment, mut blowing) =
            (Moment::first(4, episode), Wind::of(&Physics { wind, ..Physics::of(vec![]) }));
        blowing.begin(moment);
        let step = |_| {
            let mut forces = [DVec2::ZERO; 3];
            blowing.blow(moment, &mut forces);
            moment.pass();
            forces
        };
        (0..25).map(step).collect()
    }

    #[test]
    fn it_pushes_all_alike_and_fades_as_its_closed_form_says() {
        let episodes: Vec<_> = (0..4000).map(|episode| forces(0.6, episode)).collect();
        assert!(episodes.iter().flatten().all(|forces| forces.iter().all(|force| *force == forces[0])));
        let n = episodes.len() as f64;
        let at = |step: usize, axis: usize| -> Vec<f64> {
            episodes.iter().map(|episode| episode[step][0][axis] / 3.0).collect()
        };
        for (step, axis) in [(0, 0), (0, 1), (1, 0), (24, 1)] {
            let (now, first) = (at(step, axis), at(0, axis));
            // Five standard errors: stationary, with a correlation of exp(-0.2 per step).
            assert!(mean(&now).abs() < 5.0 / n.sqrt(), "{step} {axis}");
            assert!((std(&now).unwrap() - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{step} {axis}");
            let products: Vec<f64> = now.iter().zip(&first).map(|(a, b)| a * b).collect();
            let expected = (-0.2 * step as f64).exp();
            assert!((mean(&products) - expected).abs() < 5.0 * (2.0 / n).sqrt(), "{step} {axis}");
        }
        let across: Vec<f64> = at(3, 0).iter().zip(at(3, 1)).map(|(x, y)| x * y).collect();
        assert!(mean(&across).abs() < 5.0 / n.sqrt(), "one axis does not tell of the other");
    }

    #[test]
    fn it_is_found_by_its_address() {
        assert_eq!(forces(0.6, 7), forces(0.6, 7));
        assert_ne!(forces(0.6, 7), forces(0.6, 8));
        for (strong, weak) in forces(1.2, 7).iter().zip(forces(0.6, 7)) {
            assert_eq!(strong[0], 2.0 * weak[0]);
        }
        assert!(forces(0.0, 7).iter().flatten().all(|force| *force == DVec2::ZERO));
    }
}
