//! Motor noise: agents do not push quite as they mean to.

use glam::DVec2;

use super::Physics;
use super::moment::Moment;
use crate::base::rng::Purpose;

/// The motors of a team.
#[derive(Clone, Debug)]
pub(super) struct Motors {
    /// Standard deviation of the error of a force along each axis, N.
    std: f64,
}

impl Motors {
    /// Those of these laws.
    pub(super) fn of(physics: &Physics) -> Motors {
        Motors { std: physics.motor_noise * physics.force }
    }

    /// Adds the errors of a step to the forces of all agents, whatever these are. The draws of agent i are those of
    /// ([`Purpose::Motor`], episode, step, receiver i).
    #[inline]
    pub(super) fn shake(&self, moment: Moment, forces: &mut [DVec2]) {
        if self.std > 0.0 {
            self.add_errors(moment, forces);
        }
    }

    /// Apart, so that a step without noise stays small.
    #[cold]
    fn add_errors(&self, moment: Moment, forces: &mut [DVec2]) {
        let mut draws = moment.draws(Purpose::Motor);
        for (agent, force) in forces.iter_mut().enumerate() {
            *force += self.std * draws.at(agent, 0).normal();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::stats::{mean, std};

    /// The errors of so many episodes of 25 steps, agent by agent.
    fn errors(motor_noise: f64, episodes: u64) -> Vec<DVec2> {
        let motors = Motors::of(&Physics { motor_noise, ..Physics::of(vec![]) });
        let mut errors = Vec::new();
        for episode in 0..episodes {
            let mut moment = Moment::first(3, episode);
            for _ in 0..25 {
                let mut forces = [DVec2::ZERO; 4];
                motors.shake(moment, &mut forces);
                moment.pass();
                errors.extend(forces);
            }
        }
        errors
    }

    #[test]
    fn errors_are_normal_and_independent() {
        let errors = errors(0.3, 400);
        let n = errors.len() as f64;
        assert_eq!(n, 40_000.0);
        let axes: [Vec<f64>; 2] = [0, 1].map(|axis| errors.iter().map(|error| error[axis] / 1.5).collect());
        // Five standard errors.
        let bound = 5.0 / n.sqrt();
        for along in &axes {
            assert!(mean(along).abs() < bound, "{}", mean(along));
            assert!((std(along).unwrap() - 1.0).abs() < bound, "{:?}", std(along));
            // The standard error of a share p is sqrt(p (1 - p) / n).
            let within = |z: f64| along.iter().filter(|x| x.abs() < z).count() as f64 / n;
            assert!((within(1.0) - 0.6827).abs() < bound && (within(2.0) - 0.9545).abs() < bound);
        }
        // Of x and y, of neighbouring agents, and of steps that follow each other (4 agents later).
        for shift in [1, 4] {
            let products: Vec<f64> = axes[0].iter().zip(&axes[0][shift..]).map(|(a, b)| a * b).collect();
            assert!(mean(&products).abs() < bound, "{shift}: {}", mean(&products));
        }
        let products: Vec<f64> = axes[0].iter().zip(&axes[1]).map(|(x, y)| x * y).collect();
        assert!(mean(&products).abs() < bound, "{}", mean(&products));
    }

    #[test]
    fn errors_are_found_by_their_address() {
        assert_eq!(errors(0.3, 2), errors(0.3, 2));
        let motors = Motors::of(&Physics { motor_noise: 0.3, ..Physics::of(vec![]) });
        let mut all = [DVec2::ZERO; 4];
        motors.shake(Moment::first(3, 1), &mut all);
        assert_eq!(all[..], errors(0.3, 2)[100..104]);
        // A smaller team has the draws of its agents in a larger one.
        let mut few = [DVec2::ZERO; 2];
        motors.shake(Moment::first(3, 1), &mut few);
        assert_eq!(few[..], all[..2]);
    }

    #[test]
    fn without_noise_forces_stay_as_they_are() {
        assert!(errors(0.0, 1).iter().all(|error| *error == DVec2::ZERO));
    }
}
