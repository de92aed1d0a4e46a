//! How bodies move: damped point masses, pushed by their actions and by soft contacts.

use glam::DVec2;

use super::PhysicsSpec;

/// The laws of a world. The defaults are those of the reference environments the paper trains on.
#[derive(Clone, Debug, PartialEq)]
pub struct Physics {
    /// Length of a step, s. Default 0.1: an episode of 25 steps is 2.5 s.
    pub dt: f64,
    /// Share of its velocity that a body loses in a step. Default 0.25: at full thrust
    /// agents approach 2 m/s and cross the 2 m in which they start in 1.3 s.
    pub damping: f64,
    /// Force of an action, N. Default 5: one step from rest reaches 0.5 m/s.
    pub force: f64,
    /// Standard deviation of the error of an agent's force along each axis, in units of `force`. Default 0.
    pub motor_noise: f64,
    /// Standard deviation of the wind's force along each axis, in units of `force`. Default 0.
    pub wind: f64,
    /// Contact force per length of overlap, N/m. Default 100: a full overlap of two 0.15 m agents pushes
    /// with 30 N, six times what an action can press against it.
    pub contact_stiffness: f64,
    /// Length over which the contact force sets in, m. Default 0.001: far below every agent's size, so
    /// that contact is nearly hard-edged and still smooth.
    pub contact_margin: f64,
    /// The agents' bodies, in order.
    pub bodies: Vec<Body>,
}

/// An agent's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Radius, m; set by the task. Two bodies touch when they are closer than the sum of theirs.
    pub size: f64,
    /// Mass, kg. Default 1, so that forces read as accelerations.
    pub mass: f64,
    /// Whether it moves. Default true; the speaker does not.
    pub movable: bool,
    /// Whether it feels and exerts contact forces. Default false; true in the spread tasks.
    pub collides: bool,
}

impl Body {
    /// A body with the given radius, in m, and the defaults otherwise.
    pub fn of_size(size: f64) -> Body {
        Body { size, mass: 1.0, movable: true, collides: false }
    }
}

impl Physics {
    /// The default laws for these bodies.
    pub fn of(bodies: Vec<Body>) -> Physics {
        Physics {
            dt: 0.1,
            damping: 0.25,
            force: 5.0,
            motor_noise: 0.0,
            wind: 0.0,
            contact_stiffness: 100.0,
            contact_margin: 1e-3,
            bodies,
        }
    }

    /// The same, but for what `spec` says. Its noise and its wind come on top of those that the world has by itself.
    pub fn under(mut self, spec: &PhysicsSpec) -> Physics {
        let PhysicsSpec { motor_noise, damping, mass, wind } = *spec;
        // Of independent errors the variances add.
        let (motor_noise, wind) = (self.motor_noise.hypot(motor_noise), self.wind.hypot(wind));
        self.bodies.iter_mut().for_each(|body| body.mass = mass);
        Physics { motor_noise, wind, damping, ..self }
    }

    /// The force of an action, N; none for an action that does not exist.
    pub fn action_force(&self, action: u32) -> DVec2 {
        // Nothing, `+x`, `-x`, `+y`, `-y`.
        const DIRECTIONS: [DVec2; 5] = [DVec2::ZERO, DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y];
        DIRECTIONS.get(action as usize).map_or(DVec2::ZERO, |&direction| direction * self.force)
    }

    /// Adds the contact forces, N, of all pairs of bodies that collide to `forces`.
    pub fn add_contact_forces(&self, positions: &[DVec2], forces: &mut [DVec2]) {
        for a in 0..self.bodies.len() {
            for b in a + 1..self.bodies.len() {
                if self.bodies[a].collides && self.bodies[b].collides {
                    let apart = positions[a] - positions[b];
                    let touching = self.bodies[a].size + self.bodies[b].size;
                    if self.is_beyond(apart, touching) {
                        continue;
                    }
                    let force = self.contact_force(apart, touching);
                    forces[a] += force;
                    forces[b] -= force;
                }
            }
        }
    }

    /// The force, N, on a body `apart` from something that stands still, and which it touches at distance `touching`.
    pub fn push_off(&self, apart: DVec2, touching: f64) -> DVec2 {
        if self.is_beyond(apart, touching) { DVec2::ZERO } else { self.contact_force(apart, touching) }
    }

    /// Whether a contact force is less than the rounding of an action's, so that it counts as none.
    #[inline]
    fn is_beyond(&self, apart: DVec2, touching: f64) -> bool {
        let reach = touching + 40.0 * self.contact_margin;
        apart.length_squared() > reach * reach
    }

    /// The force on the first of two bodies `apart` (first minus second) that touch at distance `touching`.
    ///
    /// The overlap is a softplus of `touching - d`, smooth over the contact margin. Two bodies in the same place have no
    /// direction between them: the first is pushed towards `+x`, so that any number of them come apart.
    #[cold]
    fn contact_force(&self, apart: DVec2, touching: f64) -> DVec2 {
        let distance = apart.length();
        let overlap = self.contact_margin * softplus((touching - distance) / self.contact_margin);
        let (apart, distance) = if distance > 0.0 { (apart, distance) } else { (DVec2::X, 1.0) };
        // In the order of the reference, so that whole episodes agree with it to the last bit.
        self.contact_stiffness * apart / distance * overlap
    }

    /// Tells of each pair of bodies that touch.
    #[inline]
    pub fn touching(&self, positions: &[DVec2], mut pair: impl FnMut(usize, usize)) {
        for a in 0..positions.len() {
            for b in a + 1..positions.len() {
                if positions[a].distance(positions[b]) < self.bodies[a].size + self.bodies[b].size {
                    pair(a, b);
                }
            }
        }
    }

    /// Moves the bodies by one step: first the velocities, then the positions with the new velocities.
    #[inline]
    pub fn integrate(&self, forces: &[DVec2], velocities: &mut [DVec2], positions: &mut [DVec2]) {
        let moving = self.bodies.iter().zip(forces).zip(velocities).zip(positions);
        for (((body, &force), velocity), position) in moving {
            if body.movable {
                *velocity = *velocity * (1.0 - self.damping) + force / body.mass * self.dt;
                *position += *velocity * self.dt;
            }
        }
    }
}

/// `ln(1 + exp(x))` without overflow.
fn softplus(x: f64) -> f64 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;

    fn colliding(size: f64) -> Body {
        Body { collides: true, ..Body::of_size(size) }
    }

    fn contacts(bodies: Vec<Body>, positions: &[DVec2]) -> Vec<DVec2> {
        let mut forces = vec![DVec2::ZERO; bodies.len()];
        Physics::of(bodies).add_contact_forces(positions, &mut forces);
        forces
    }

    #[test]
    fn bodies_in_one_place_come_apart() {
        for place in [DVec2::ZERO, dvec2(0.3, -0.7)] {
            // Apart by so little that the squared distance underflows.
            for second in [place, place + dvec2(0.0, 1e-200)] {
                let forces = contacts(vec![colliding(0.15); 2], &[place, second]);
                assert!((forces[0] - dvec2(30.0, 0.0)).length() < 1e-12, "{forces:?}");
                assert_eq!(forces[1], -forces[0]);
            }
        }
        let forces = contacts(vec![colliding(0.05); 12], &[DVec2::ZERO; 12]);
        assert!(forces.iter().all(|force| force.is_finite()));
        assert!(forces.windows(2).all(|pair| pair[0].x > pair[1].x + 1.0), "{forces:?}");
    }

    #[test]
    fn leaving_out_far_contacts_changes_nothing() {
        let physics = Physics::of(vec![]);
        let (touching, margin) = (0.2, physics.contact_margin);
        for step in 0..2000 {
            let distance = 1e-3 + 1e-3 * f64::from(step);
            let full = physics.contact_stiffness * margin * softplus((touching - distance) / margin);
            let ours = physics.contact_force(dvec2(0.0, distance), touching).y;
            assert!((full - ours).abs() <= 1e-15 * full.max(1.0), "at {distance}: {full} and {ours}");
        }
    }

    #[test]
    fn contact_pushes_both_apart_with_equal_force_and_only_those_that_collide() {
        let places = [dvec2(0.0, 0.0), dvec2(0.06, 0.08), dvec2(0.02, 0.01)];
        let forces = contacts(vec![colliding(0.1), colliding(0.1), Body::of_size(0.1)], &places);
        assert!((forces[0] - dvec2(-6.0, -8.0)).length() < 1e-9, "{forces:?}");
        assert_eq!(forces[1], -forces[0]);
        assert_eq!(forces[2], DVec2::ZERO);
    }

    #[test]
    fn velocity_moves_first_and_mass_and_movability_count() {
        let physics = Physics::of(vec![
            Body::of_size(0.1),
            Body { mass: 2.0, ..Body::of_size(0.1) },
            Body { movable: false, ..Body::of_size(0.1) },
        ]);
        let (mut velocities, mut positions) = ([DVec2::ZERO; 3], [DVec2::ONE; 3]);
        physics.integrate(&[dvec2(5.0, 0.0); 3], &mut velocities, &mut positions);
        assert_eq!(velocities, [dvec2(0.5, 0.0), dvec2(0.25, 0.0), DVec2::ZERO]);
        assert_eq!(positions, [dvec2(1.05, 1.0), dvec2(1.025, 1.0), DVec2::ONE]);
        physics.integrate(&[DVec2::ZERO; 3], &mut velocities, &mut positions);
        assert_eq!(velocities[0], dvec2(0.375, 0.0));
    }

    #[test]
    fn an_action_that_does_not_exist_pushes_nothing() {
        let physics = Physics::of(vec![]);
        assert_eq!(physics.action_force(1), dvec2(5.0, 0.0));
        assert_eq!(physics.action_force(4), dvec2(0.0, -5.0));
        for action in [0, 5, u32::MAX] {
            assert_eq!(physics.action_force(action), DVec2::ZERO);
        }
    }
}
