//! Predator and prey: a team hunts a prey that flees by its own rules, sees only what is near, and must go round
//! obstacles. Who sees the prey must tell.
//!
//! It is the cooperative form of `simple_tag` of OpenAI's multi-agent particle environments, with a scripted prey.

use glam::DVec2;

use super::family::{AnySize, Family, named};
use super::point_mass::{Plane, Rules, worlds, write};
use super::{About, ActionSpace, AgentSpec, Axis, Body, PaperSetting, Physics, Spec, TeamReward, Value};
use crate::base::rng::Draws;

pub(super) const FAMILY: Family = Family {
    summary: "agents hunt a prey that flees; each sees it only nearby, and must tell the others where it is",
    named: &[named(3, "predator-prey-3", &[])],
    any_size: Some(AnySize { prefix: "predator-prey-", group: 1 }),
    spec,
    worlds: worlds::<Hunt>,
    chance: 0.0,
};

/// How far a predator sees, m.
const SIGHT: f64 = 0.8;

/// Radius of predators, as in `simple_tag`, and of the prey, m.
const SIZE: f64 = 0.075;

/// Radius of an obstacle, m.
const OBSTACLE: f64 = 0.2;

const OBSTACLES: usize = 2;

/// Speed of the prey, m/s: predators reach 2 m/s, but cannot turn as fast.
const SPEED: f64 = 0.6;

/// From how far away the prey flees predators, and keeps off walls and obstacles, m.
const FEAR: f64 = 0.6;
const MARGIN: f64 = 0.2;

/// How much the prey minds a wall or an obstacle that it touches, or a predator, in units of where it would like to go.
const ALARM: f64 = 3.0;

#[derive(Clone, Debug)]
struct Hunt;

/// See [`Hunt::observe`]. A place that is seen now and then does not change at the rate of what is seen of its velocity.
fn spec(id: &str, n_agents: usize) -> Spec {
    let agent = |agent| {
        let (own, prey) = (About::Agent(agent), About::Target(0));
        let places = Axis::BOTH.map(|axis| Value::moving(own, axis, axis as usize, 1.0));
        let mut observation = [Axis::BOTH.map(|axis| Value::velocity(own, axis)), places].concat();
        observation.push(Value::word(prey));
        observation.extend(Axis::BOTH.map(|axis| Value::velocity(prey, axis)));
        observation.extend(Axis::BOTH.map(|axis| Value::place(prey, axis)));
        AgentSpec { name: format!("agent-{agent}"), observation, actions: ActionSpace::Discrete(5) }
    };
    let agents: Vec<AgentSpec> = (0..n_agents).map(agent).collect();
    Spec {
        id: id.to_owned(),
        unique: agents[0].observation.len(),
        agents,
        common: Axis::BOTH.map(|axis| Value::place(About::Landmark, axis)).repeat(OBSTACLES),
        landmarks: OBSTACLES,
        targets: 1,
        episode_steps: 25,
        dt: Hunt::physics(n_agents).dt,
        team_reward: TeamReward::Sum,
        paper: PaperSetting::One,
        positions: true,
    }
}

impl Rules for Hunt {
    fn physics(n_agents: usize) -> Physics {
        Physics::of(vec![Body { collides: true, ..Body::of_size(SIZE) }; n_agents])
    }

    /// Obstacles push predators off as these push each other.
    fn push(plane: &Plane, physics: &Physics, forces: &mut [DVec2]) {
        for (position, force) in plane.positions.iter().zip(forces) {
            for obstacle in &plane.landmarks {
                *force += physics.push_off(*position - *obstacle, SIZE + OBSTACLE);
            }
        }
    }

    fn move_targets(plane: &mut Plane, physics: &Physics, draws: &mut Draws) {
        let mut prey = plane.targets[0];
        let course = prey.wander(draws) + ALARM * alarm(plane, prey.position);
        prey.go(SPEED * course.normalize_or_zero(), physics.dt);
        for obstacle in &plane.landmarks {
            let apart = prey.position - *obstacle;
            if apart.length() < SIZE + OBSTACLE {
                prey.position = *obstacle + (SIZE + OBSTACLE) * apart.normalize_or(DVec2::X);
            }
        }
        plane.targets[0] = prey;
    }

    /// Own velocity and place; then, if the prey is in sight, 1, its velocity and its place, and zeros otherwise; then
    /// the obstacles.
    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        let (here, prey) = (plane.positions[agent], plane.targets[0]);
        let (own, rest) = out.split_at_mut(4);
        let (seen, common) = rest.split_at_mut(5);
        write(&[plane.velocities[agent], here], own);
        seen.fill(0.0);
        if here.distance(prey.position) < SIGHT {
            seen[0] = 1.0;
            write(&[prey.velocity, prey.position], &mut seen[1..]);
        }
        write(&plane.landmarks, common);
    }

    /// Everybody earns 1 for each predator that touches the prey, and pays how far the predators are from it in the mean.
    fn reward(plane: &Plane, _physics: &Physics, rewards: &mut [f64]) {
        let prey = plane.targets[0].position;
        let distances = || plane.positions.iter().map(|position| position.distance(prey));
        let touching = distances().filter(|distance| *distance < 2.0 * SIZE).count() as f64;
        let mean = distances().sum::<f64>() / plane.positions.len() as f64;
        rewards.fill(touching - mean);
    }
}

/// Away from predators, walls and obstacles: each the more the nearer, up to a length of 1.
fn alarm(plane: &Plane, here: DVec2) -> DVec2 {
    let away = |from: &DVec2, touching: f64, reach: f64| {
        let apart = here - *from;
        let nearness = 1.0 - (apart.length() - touching) / reach;
        apart.normalize_or(DVec2::X) * nearness.clamp(0.0, 1.0)
    };
    let predators = plane.positions.iter().map(|predator| away(predator, 2.0 * SIZE, FEAR));
    let obstacles = plane.landmarks.iter().map(|obstacle| away(obstacle, SIZE + OBSTACLE, MARGIN));
    let walls = -here.signum() * ((here.abs() - 1.0) / MARGIN + 1.0).clamp(DVec2::ZERO, DVec2::ONE);
    predators.chain(obstacles).sum::<DVec2>() + walls
}

#[cfg(test)]
mod tests {
    use super::super::{Environment, Outcome, State, Target, Task};
    use super::*;
    use glam::dvec2;

    /// Two predators and the prey, with the obstacles out of the way.
    fn hunt(predators: [DVec2; 2], prey: DVec2, obstacles: [DVec2; 2]) -> Box<dyn Environment> {
        let mut world = Task::parse("predator-prey-2").unwrap().environment(1);
        let state = State {
            positions: predators.to_vec(),
            velocities: vec![DVec2::ZERO; 2],
            landmarks: obstacles.to_vec(),
            targets: vec![Target { position: prey, velocity: DVec2::X }],
            goal: None,
        };
        world.set_state(0, &state, None).unwrap();
        world
    }

    fn step(world: &mut dyn Environment) -> Vec<f64> {
        let mut outcome = Outcome::of(1, 2);
        world.step(&[0, 0], &[true], &mut outcome).unwrap();
        outcome.rewards
    }

    const AWAY: [DVec2; 2] = [DVec2::splat(9.0), DVec2::splat(-9.0)];

    #[test]
    fn a_predator_sees_the_prey_only_if_it_is_near() {
        let mut world = hunt([dvec2(0.0, 0.25), dvec2(0.0, 1.25)], dvec2(0.25, 0.25), AWAY);
        let mut seen = [f32::NAN; 26];
        world.observe(1, &mut seen).unwrap();
        assert_eq!(seen[..13], [0.0, 0.0, 0.0, 0.25, 1.0, 1.0, 0.0, 0.25, 0.25, 9.0, 9.0, -9.0, -9.0]);
        assert_eq!(seen[13..], [0.0, 0.0, 0.0, 1.25, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 9.0, -9.0, -9.0]);
    }

    #[test]
    fn the_prey_flees_and_stays_inside() {
        for (predator, prey) in [(dvec2(0.2, 0.0), DVec2::ZERO), (dvec2(0.0, -0.3), dvec2(0.0, -0.1))] {
            let mut world = hunt([predator, predator], prey, AWAY);
            step(&mut *world);
            let fled = world.state(0).targets[0];
            assert!(fled.position.distance(predator) > prey.distance(predator) + 0.02, "{fled:?}");
            assert!((fled.velocity.length() - SPEED).abs() < 1e-12);
        }
        let mut world = hunt([dvec2(0.7, 0.8), dvec2(0.8, 0.7)], dvec2(0.95, 0.95), AWAY);
        for _ in 0..25 {
            step(&mut *world);
            assert!(world.state(0).targets[0].position.abs().max_element() <= 1.0);
        }
    }

    #[test]
    fn nobody_stays_in_an_obstacle() {
        let mut world = hunt([dvec2(0.1, 0.0), dvec2(5.0, 5.0)], dvec2(0.0, 0.1), [DVec2::ZERO, AWAY[1]]);
        step(&mut *world);
        let State { targets, velocities, .. } = world.state(0);
        assert!(targets[0].position.length() > SIZE + OBSTACLE - 1e-12, "{targets:?}");
        // It is 0.175 m deep: 17.5 N for 0.1 s.
        assert!((velocities[0] - dvec2(1.75, 0.0)).length() < 1e-12, "{velocities:?}");
        assert_eq!(velocities[1], DVec2::ZERO);
    }

    #[test]
    fn all_earn_what_each_catches() {
        let mut world = hunt([dvec2(0.8, 0.9), dvec2(0.9, 0.8)], dvec2(0.9, 0.9), AWAY);
        let rewards = step(&mut *world);
        let State { positions, targets, .. } = world.state(0);
        let distances = [0, 1].map(|agent| positions[agent].distance(targets[0].position));
        let touching = distances.iter().filter(|distance| **distance < 0.15).count();
        assert!(touching > 0, "{distances:?}");
        let expected = touching as f64 - (distances[0] + distances[1]) / 2.0;
        assert!(rewards.iter().all(|reward| (reward - expected).abs() < 1e-12), "{rewards:?}");
    }
}
