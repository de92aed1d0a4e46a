//! Places move on with the velocity that was received with them; the rest stays as it was received.

use super::{Carried, Imputer, JointLayout, Setup, Step};
use crate::agent::Inbox;

/// Carries the estimate on with places moved.
#[derive(Debug)]
pub(super) struct Velocity {
    carried: Carried,
    motions: Vec<Motion>,
}

/// A place that moves with a velocity; both are dims of the joint observation.
#[derive(Debug)]
struct Motion {
    place: usize,
    velocity: usize,
    /// What a step adds to the place, per unit of velocity: plus or minus the length of a step, s.
    factor: f32,
}

impl Velocity {
    pub(super) fn new(setup: &Setup) -> Velocity {
        let (spec, layout) = (setup.spec, JointLayout::of(setup.spec));
        let motions = (0..layout.agents).flat_map(|agent| {
            let front = agent * layout.unique;
            spec.agents[agent].observation.iter().enumerate().filter_map(move |(dim, value)| {
                let (velocity, sign) = value.rate?;
                let factor = sign * spec.dt as f32;
                Some(Motion { place: front + dim, velocity: front + velocity, factor })
            })
        });
        Velocity { carried: Carried::new(setup), motions: motions.collect() }
    }
}

impl Imputer for Velocity {
    fn begin_episodes(&mut self, _worlds: usize) {
        self.carried.forget();
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        self.carried.fuse(world, own, inbox, estimate);
        for (sender, age) in self.carried.late(inbox) {
            let part = self.carried.layout().part(sender);
            (0..age).for_each(|_| {
                self.motions.iter().filter(|motion| part.contains(&motion.place)).for_each(|motion| {
                    estimate[motion.place] += motion.factor * estimate[motion.velocity];
                });
            });
        }
    }

    fn predict(&mut self, step: &Step) {
        for (carried, estimate) in self.carried.follow(step.estimates) {
            carried.copy_from_slice(&estimate[..carried.len()]);
            for Motion { place, velocity, factor } in &self.motions {
                carried[*place] += factor * estimate[*velocity];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::PolicySource;
    use crate::environment::Task;

    /// What a listener's observation is taken for one step after it was received.
    #[test]
    fn places_move_on_with_the_velocity_and_the_rest_stays() {
        let task = Task::parse("speaker-listener").unwrap();
        let policy = PolicySource::Untrained(0).load(task.spec()).unwrap();
        let setup = Setup::of(task.spec(), &policy, 0);
        let mut imputer = Velocity::new(&setup);
        imputer.begin_episodes(1);
        let speaker = [0.15, 0.65, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let listener = [1.0, -2.0, 0.5, 0.5, 0.0, 0.0, -0.5, 0.5, 0.0, 1.0, 0.0];
        let estimates = &[speaker, listener].concat();
        imputer.predict(&Step { episode: 0, step: 0, estimates, actions: &[0] });
        let mut estimate = [0.0; 22];
        imputer.fuse(0, &speaker, &Inbox::of(2, |_| None), &mut estimate);
        // Landmarks are seen from the listener: they come nearer as it moves towards them.
        let moved = [1.0, -2.0, 0.4, 0.7, -0.1, 0.2, -0.6, 0.7, 0.0, 1.0, 0.0];
        let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
        assert!(estimate[11..].iter().zip(&moved).all(close), "{estimate:?}");
    }
}
