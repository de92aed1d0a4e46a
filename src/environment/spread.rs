//! The spread families: as many landmarks as agents; cover them all and do not collide.
//!
//! The two families differ in what an agent observes of the swarm, and in the size of their bodies.

use glam::DVec2;

use super::family::{AnySize, Family, Named, named};
use super::point_mass::{Plane, Rules, worlds, write};
use super::{About, ActionSpace, AgentSpec, Axis, Body, PaperSetting, Physics, Spec, TeamReward, Value};

pub(super) const XY: Family = Family {
    summary: "agents in pairs, each sees one axis of its pair; together they cover all landmarks without colliding",
    named: &[
        named(2, "spread-xy-2", &["SXY-2", "SimpleSpreadXY-v0"]),
        Named { default_for_its_size: true, ..named(4, "spread-xy-4", &["SXY-4", "SimpleSpreadXY4-v0"]) },
        Named { default_for_its_size: true, ..named(8, "spread-xy-8", &["SimpleSpreadXY8-v0"]) },
    ],
    any_size: Some(AnySize { prefix: "spread-xy-", group: 2 }),
    spec: spec_xy,
    worlds: worlds::<Xy>,
    chance: 0.0,
};

pub(super) const BLINDFOLD: Family = Family {
    summary: "agents see themselves and the landmarks but not each other; they cover all landmarks without colliding",
    named: &[
        Named {
            default_for_its_size: true,
            ..named(3, "spread-blindfold", &["SBF", "SimpleSpreadBlind-v0", "spread-blindfold-3"])
        },
        Named { default_for_its_size: true, ..named(6, "spread-blindfold-6", &["SimpleSpreadBlind6-v0"]) },
        Named { default_for_its_size: true, ..named(12, "spread-blindfold-12", &["SimpleSpreadBlind12-v0"]) },
    ],
    any_size: Some(AnySize { prefix: "spread-blindfold-", group: 1 }),
    spec: spec_blindfold,
    worlds: worlds::<Blindfold>,
    chance: 0.0,
};

/// The dims of an observation that are the agent's own; the landmarks behind them are the same for all.
const UNIQUE_DIM: usize = 4;

/// Team sizes and agent sizes (m) of the reference environments, smallest team first.
type Sizes = [(usize, f64); 3];
const SIZES_XY: Sizes = [(2, 0.15), (4, 0.1), (8, 0.07)];
const SIZES_BLINDFOLD: Sizes = [(3, 0.15), (6, 0.1), (12, 0.05)];

/// Agents 2k and 2k + 1 are a pair; the first observes x and the second y of both: positions, velocities.
#[derive(Clone, Debug)]
struct Xy;

/// An agent observes its own velocity and position.
#[derive(Clone, Debug)]
struct Blindfold;

/// See [`Xy`]: an agent's other axis stands in its teammate's observation.
fn spec_xy(id: &str, n_agents: usize) -> Spec {
    let observation = |agent: usize| {
        let axis = Axis::BOTH[agent % 2];
        let pair = [agent - agent % 2, agent - agent % 2 + 1].map(About::Agent);
        let [first, second] = pair;
        let [v, w] = pair.map(|about| Value::velocity(about, axis));
        vec![Value::moving(first, axis, 2, 1.0), Value::moving(second, axis, 3, 1.0), v, w]
    };
    // The paper trains the smallest team as it does the tasks for two.
    let paper = if n_agents == 2 { PaperSetting::One } else { PaperSetting::Two };
    spec(id, n_agents, paper, observation)
}

/// See [`Blindfold`].
fn spec_blindfold(id: &str, n_agents: usize) -> Spec {
    let observation = |agent| {
        let own = About::Agent(agent);
        let [x, y] = Axis::BOTH;
        let places = [Value::moving(own, x, 0, 1.0), Value::moving(own, y, 1, 1.0)];
        [Axis::BOTH.map(|axis| Value::velocity(own, axis)), places].concat()
    };
    spec(id, n_agents, PaperSetting::Two, observation)
}

fn spec(id: &str, n_agents: usize, paper: PaperSetting, observation: impl Fn(usize) -> Vec<Value>) -> Spec {
    let agent = |agent| AgentSpec {
        name: format!("agent-{agent}"),
        observation: observation(agent),
        actions: ActionSpace::Discrete(5),
    };
    let landmark = Axis::BOTH.map(|axis| Value::place(About::Landmark, axis));
    Spec {
        id: id.to_owned(),
        agents: (0..n_agents).map(agent).collect(),
        unique: UNIQUE_DIM,
        common: landmark.repeat(n_agents),
        landmarks: n_agents,
        targets: 0,
        episode_steps: 25,
        dt: Xy::physics(n_agents).dt,
        team_reward: TeamReward::SumForEach,
        paper,
        positions: true,
    }
}

impl Rules for Xy {
    const HAS_GOAL: bool = false;

    fn physics(n_agents: usize) -> Physics {
        physics(&SIZES_XY, n_agents)
    }

    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        let (axis, first) = (agent % 2, agent - agent % 2);
        let along_axis = |of: &[DVec2]| DVec2::new(of[first][axis], of[first + 1][axis]);
        observe(plane, [along_axis(&plane.positions), along_axis(&plane.velocities)], out);
    }

    fn reward(plane: &Plane, physics: &Physics, rewards: &mut [f64]) {
        reward(plane, physics, rewards);
    }
}

impl Rules for Blindfold {
    const HAS_GOAL: bool = false;

    fn physics(n_agents: usize) -> Physics {
        physics(&SIZES_BLINDFOLD, n_agents)
    }

    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        observe(plane, [plane.velocities[agent], plane.positions[agent]], out);
    }

    fn reward(plane: &Plane, physics: &Physics, rewards: &mut [f64]) {
        reward(plane, physics, rewards);
    }
}

/// What is the agent's own, then where every landmark is.
fn observe(plane: &Plane, own: [DVec2; UNIQUE_DIM / 2], out: &mut [f32]) {
    let (unique, common) = out.split_at_mut(UNIQUE_DIM);
    write(&own, unique);
    write(&plane.landmarks, common);
}

/// Every agent pays the distance from each landmark to the agent nearest to it, and 1 for every agent it
/// touches. As in the reference environments it touches itself, too: a constant of 1 in every step.
fn reward(plane: &Plane, physics: &Physics, rewards: &mut [f64]) {
    rewards.fill(-plane.uncovered() - 1.0);
    physics.touching(&plane.positions, |a, b| {
        rewards[a] -= 1.0;
        rewards[b] -= 1.0;
    });
}

fn physics(sizes: &Sizes, n_agents: usize) -> Physics {
    Physics::of(vec![Body { collides: true, ..Body::of_size(agent_size(sizes, n_agents)) }; n_agents])
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
