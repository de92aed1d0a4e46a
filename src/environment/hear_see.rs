//! Hear-see: one agent is told where the goal is, the other sees where both agents are.

use super::physics::Body;
use super::{Observed, World, write};

pub(super) const SUMMARY: &str = "one agent knows the goal, the other sees both agents; both go to the goal";
pub(super) const N_AGENTS: usize = 2;
pub(super) const N_LANDMARKS: usize = 1;
pub(super) const PADDED_OBS_DIM: usize = 8;
pub(super) const OBS_DIMS: [usize; N_AGENTS] = [2, PADDED_OBS_DIM];
const HEARS: usize = 0;

/// See [`observe`].
pub(super) const OBSERVED: [&[Observed]; N_AGENTS] = [
    &[Observed::FIXED; 2],
    &[
        Observed::moving(4, 1.0),
        Observed::moving(5, 1.0),
        Observed::moving(6, 1.0),
        Observed::moving(7, 1.0),
        Observed::VELOCITY,
        Observed::VELOCITY,
        Observed::VELOCITY,
        Observed::VELOCITY,
    ],
];

pub(super) fn bodies() -> Vec<Body> {
    vec![Body::of_size(0.075); N_AGENTS]
}

/// Agent 0 observes the goal; agent 1 both positions, then both velocities.
pub(super) fn observe(world: &World, agent: usize, out: &mut [f32]) {
    let (front, back) = out.split_at_mut(2 * N_AGENTS);
    if agent == HEARS {
        front.fill(0.0);
        back.fill(0.0);
        write(&[world.landmarks[world.goal]], front);
    } else {
        write(&world.positions, front);
        write(&world.velocities, back);
    }
}

/// Both agents pay the mean squared distance to the goal.
pub(super) fn reward(world: &mut World) {
    let goal = world.landmarks[world.goal];
    let squared: f64 = world.positions.iter().map(|position| position.distance_squared(goal)).sum();
    world.rewards.fill(-squared / N_AGENTS as f64);
}
