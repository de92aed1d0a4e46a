//! Rendezvous: agents that know only where they are themselves meet, anywhere, in a wind that nobody can stand against.
//!
//! The wind blows all of them along, so that they cannot agree on a place at the start and hold it. Their motors are
//! unsteady, each in its own way, so that nobody can work out from its own motion where the others are.

use glam::DVec2;

use super::family::{AnySize, Family, named};
use super::point_mass::{Plane, Rules, worlds, write};
use super::{About, ActionSpace, AgentSpec, Axis, Body, Physics, Spec, Value};

pub(super) const FAMILY: Family = Family {
    summary: "agents see only themselves; wind and noisy motors carry them off, and they must meet, wherever that is",
    named: &[named(3, "rendezvous-3", &[])],
    any_size: Some(AnySize { prefix: "rendezvous-", group: 1 }),
    spec,
    worlds: worlds::<Rendezvous>,
    chance: CHANCE,
};

/// Standard deviation of the wind, in units of a full push: it is often stronger than a motor.
const WIND: f64 = 1.0;

/// That of the motors' errors: in an episode they carry an agent 0.7 m off along each axis.
const MOTOR_NOISE: f64 = 0.8;

/// That of both.
const CHANCE: f64 = 1.280_624_847_486_569_7;

#[derive(Clone, Debug)]
struct Rendezvous;

/// Own velocity and own place.
fn spec(id: &str, n_agents: usize) -> Spec {
    let agent = |agent| {
        let own = About::Agent(agent);
        let places = Axis::BOTH.map(|axis| Value::moving(own, axis, axis as usize, 1.0));
        AgentSpec {
            name: format!("agent-{agent}"),
            observation: [Axis::BOTH.map(|axis| Value::velocity(own, axis)), places].concat(),
            actions: ActionSpace::Discrete(5),
        }
    };
    Spec {
        dt: Rendezvous::physics(n_agents).dt,
        positions: true,
        ..Spec::of(id, (0..n_agents).map(agent).collect())
    }
}

impl Rules for Rendezvous {
    fn physics(n_agents: usize) -> Physics {
        let calm = Physics::of(vec![Body::of_size(0.075); n_agents]);
        Physics { wind: WIND, motor_noise: MOTOR_NOISE, ..calm }
    }

    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        write(&[plane.velocities[agent], plane.positions[agent]], out);
    }

    /// Everybody pays how far the agents are from their centre in the mean.
    fn reward(plane: &Plane, _physics: &Physics, rewards: &mut [f64]) {
        let n = plane.positions.len() as f64;
        let centre = plane.positions.iter().sum::<DVec2>() / n;
        let distances: f64 = plane.positions.iter().map(|position| position.distance(centre)).sum();
        rewards.fill(-distances / n);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Outcome, Task};
    use super::*;

    #[test]
    fn all_pay_how_far_the_team_is_apart_wherever_it_is() {
        let mut world = Task::parse("rendezvous-2").unwrap().environment(1);
        for (episode, action) in (0..20).zip([0, 1, 2, 3, 4].into_iter().cycle()) {
            world.reset(0, 3, episode).unwrap();
            let mut outcome = Outcome::of(1, 2);
            world.step(&[action, action], &[true], &mut outcome).unwrap();
            let apart = world.positions(0)[0].distance(world.positions(0)[1]);
            assert!(outcome.rewards.iter().all(|reward| (reward + apart / 2.0).abs() < 1e-12), "{outcome:?}");
        }
    }

    #[test]
    fn what_it_says_happens_by_chance_is_what_its_physics_says() {
        let Physics { wind, motor_noise, .. } = Rendezvous::physics(2);
        assert!((CHANCE - wind.hypot(motor_noise)).abs() < 1e-15);
    }
}
