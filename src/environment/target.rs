//! Who moves and is not of the team: it goes straight on until it turns, which nobody foresees, and goes back at the
//! walls. A task may put it elsewhere after that, beyond the walls too.

use std::f64::consts::TAU;

use glam::{DVec2, dvec2};

use crate::base::rng::Draws;

/// How likely it turns in a step. It goes straight on for half a second in the mean.
const TURN: f64 = 0.2;

/// A body that is not of the team, and moves by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Target {
    /// Where it is, m.
    pub position: DVec2,
    /// How fast it moves, m/s.
    pub velocity: DVec2,
}

impl Target {
    /// Where it would like to go, as a direction: where it goes, or now and then somewhere else.
    pub(super) fn wander(&self, draws: &mut Draws) -> DVec2 {
        let (turn, heading) = (draws.uniform() < TURN, TAU * draws.uniform());
        let (sin, cos) = heading.sin_cos();
        if turn { dvec2(cos, sin) } else { self.velocity.normalize_or(dvec2(cos, sin)) }
    }

    /// Moves for `dt` seconds with this velocity, or where that would lead out of `[-1, 1]^2` with its mirror image.
    pub(super) fn go(&mut self, velocity: DVec2, dt: f64) {
        let there = self.position + velocity * dt;
        let leaves = there.abs().cmpgt(DVec2::ONE) & (there * velocity).cmpgt(DVec2::ZERO);
        self.velocity = DVec2::select(leaves, -velocity, velocity);
        self.position += self.velocity * dt;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Purpose;

    #[test]
    fn it_keeps_its_speed_stays_inside_and_turns_when_its_address_says() {
        let walk = |episode| {
            let mut target = Target::default();
            let step = |step| {
                let mut draws = Draws::new(2, Purpose::Turn, episode, step);
                target.go(1.5 * target.wander(&mut draws), 0.1);
                target
            };
            (0..1000).map(step).collect::<Vec<_>>()
        };
        let path = walk(5);
        assert_eq!(path, walk(5));
        assert_ne!(path, walk(6));
        for pair in path.windows(2) {
            assert!(pair.iter().all(|at| (at.velocity.length() - 1.5).abs() < 1e-12));
            assert!(pair[1].position.abs().max_element() <= 1.0, "{:?}", pair[1]);
            assert!((pair[1].position - pair[0].position - 0.1 * pair[1].velocity).length() < 1e-12);
        }
        // Where it turned by itself no component is what it was; at a wall one changes its sign. Five standard errors.
        let turned = path
            .windows(2)
            .filter(|pair| (pair[1].velocity.abs() - pair[0].velocity.abs()).abs().max_element() > 1e-9);
        let off = turned.count() as f64 / 999.0 - TURN;
        assert!(off.abs() < 5.0 * (TURN * (1.0 - TURN) / 999.0).sqrt(), "{off}");
    }
}
