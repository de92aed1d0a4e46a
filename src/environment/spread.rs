//! The spread families: as many landmarks as agents; cover them all and do not collide.
//!
//! The two families differ in what an agent observes of the swarm, and in the size of their bodies.

use glam::DVec2;

use super::physics::Body;
use super::{Observed, World, write};

pub(super) const SUMMARY_XY: &str =
    "agents in pairs, each sees one axis of its pair; together they cover all landmarks without colliding";
pub(super) const SUMMARY_BLINDFOLD: &str =
    "agents see themselves and the landmarks but not each other; they cover all landmarks without colliding";

/// The dims of an observation that are the agent's own; the landmarks behind them are the same for all.
pub(super) const UNIQUE_DIM: usize = 4;

/// See [`observe_axis`].
pub(super) const OBSERVED_XY: [Observed; UNIQUE_DIM] =
    [Observed::moving(2, 1.0), Observed::moving(3, 1.0), Observed::VELOCITY, Observed::VELOCITY];
/// See [`observe_self`].
pub(super) const OBSERVED_BLINDFOLD: [Observed; UNIQUE_DIM] =
    [Observed::VELOCITY, Observed::VELOCITY, Observed::moving(0, 1.0), Observed::moving(1, 1.0)];

/// Team sizes and agent sizes (m) of the reference environments, smallest team first.
pub(super) type Sizes = [(usize, f64); 3];
pub(super) const SIZES_XY: Sizes = [(2, 0.15), (4, 0.1), (8, 0.07)];
pub(super) const SIZES_BLINDFOLD: Sizes = [(3, 0.15), (6, 0.1), (12, 0.05)];

pub(super) fn bodies(sizes: &Sizes, n_agents: usize) -> Vec<Body> {
    vec![Body { collides: true, ..Body::of_size(agent_size(sizes, n_agents)) }; n_agents]
}

/// The size of the agents of a team, so that teams of any number have room.
///
/// Between the given team sizes it is interpolated in log-log; below the smallest team it stays; above the
/// largest the area that all agents cover together stays.
fn agent_size(sizes: &Sizes, n_agents: usize) -> f64 {
    let (smaller, larger) = sizes.split_at(sizes.partition_point(|&(n, _)| n <= n_agents));
    let Some(&(n_below, size_below)) = smaller.last() else { return sizes[0].1 };
    let growth = n_agents as f64 / n_below as f64;
    match larger.first() {
        None => size_below / growth.sqrt(),
        Some(&(n_above, size_above)) => {
            let share = growth.ln() / (n_above as f64 / n_below as f64).ln();
            size_below * (size_above / size_below).powf(share)
        }
    }
}

/// Agents 2k and 2k + 1 are a pair; the first observes x and the second y of both: positions, velocities.
pub(super) fn observe_axis(world: &World, agent: usize, out: &mut [f32]) {
    let (axis, first) = (agent % 2, agent - agent % 2);
    let along_axis = |of: &[DVec2]| DVec2::new(of[first][axis], of[first + 1][axis]);
    observe(world, [along_axis(&world.positions), along_axis(&world.velocities)], out);
}

/// An agent observes its own velocity and position.
pub(super) fn observe_self(world: &World, agent: usize, out: &mut [f32]) {
    observe(world, [world.velocities[agent], world.positions[agent]], out);
}

/// What is the agent's own, then where every landmark is.
fn observe(world: &World, own: [DVec2; UNIQUE_DIM / 2], out: &mut [f32]) {
    let (unique, common) = out.split_at_mut(UNIQUE_DIM);
    write(&own, unique);
    write(&world.landmarks, common);
}

/// Every agent pays the distance from each landmark to the agent nearest to it, and 1 for every agent it
/// touches. As in the reference environments it touches itself, too: a constant of 1 in every step.
pub(super) fn reward(world: &mut World) {
    let World { task, positions, landmarks, rewards, .. } = world;
    let to_nearest = |landmark: &DVec2| {
        let squared = positions.iter().map(|position| position.distance_squared(*landmark));
        squared.fold(f64::INFINITY, f64::min).sqrt()
    };
    rewards.fill(-landmarks.iter().map(to_nearest).sum::<f64>() - 1.0);
    let bodies = &task.physics.bodies;
    for a in 0..positions.len() {
        for b in a + 1..positions.len() {
            if positions[a].distance(positions[b]) < bodies[a].size + bodies[b].size {
                rewards[a] -= 1.0;
                rewards[b] -= 1.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::MAX_AGENTS;

    #[test]
    fn agents_shrink_as_the_team_grows() {
        for sizes in [SIZES_XY, SIZES_BLINDFOLD] {
            for (n, size) in sizes {
                assert_eq!(agent_size(&sizes, n), size, "exact where the reference gives it");
            }
            let (n_smallest, largest_size) = sizes[0];
            assert!((1..=n_smallest).all(|n| agent_size(&sizes, n) == largest_size));
            assert!((n_smallest..MAX_AGENTS).all(|n| agent_size(&sizes, n + 1) < agent_size(&sizes, n)));
        }
    }

    #[test]
    fn the_size_rule_interpolates_in_log_log_and_then_keeps_the_area() {
        // The geometric mean of two teams has the geometric mean of their sizes.
        let sizes = [(4, 0.1), (16, 0.025), (64, 0.02)];
        assert!((agent_size(&sizes, 8) - 0.05).abs() < 1e-15);
        for sizes in [SIZES_XY, SIZES_BLINDFOLD] {
            let (n, size) = sizes[2];
            let area = |n: usize, size: f64| n as f64 * size * size;
            assert!((area(MAX_AGENTS, agent_size(&sizes, MAX_AGENTS)) - area(n, size)).abs() < 1e-15);
        }
    }
}
