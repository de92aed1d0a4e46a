//! Scout: one agent sees a target that moves unpredictably, and all must stay with it.

use super::family::{AnySize, Family, named};
use super::point_mass::{Plane, Rules, worlds, write};
use super::{About, ActionSpace, AgentSpec, Axis, Body, PaperSetting, Physics, Spec, TeamReward, Value};
use crate::base::rng::Draws;

pub(super) const FAMILY: Family = Family {
    summary: "one agent sees a target that moves unpredictably; all must stay with it",
    named: &[named(3, "scout-3", &[])],
    any_size: Some(AnySize { prefix: "scout-", group: 1 }),
    spec,
    worlds: worlds::<Scout>,
    chance: 0.0,
};

/// Who sees the target.
const SCOUT: usize = 0;

/// Speed of the target, m/s: half of the 2 m/s that an agent reaches.
const SPEED: f64 = 1.0;

#[derive(Clone, Debug)]
struct Scout;

/// See [`Scout::observe`].
fn spec(id: &str, n_agents: usize) -> Spec {
    let moving = |about, first| {
        let places = Axis::BOTH.map(|axis| Value::moving(about, axis, first + axis as usize, 1.0));
        [Axis::BOTH.map(|axis| Value::velocity(about, axis)), places].concat()
    };
    let agent = |agent| {
        let (own, sees) = (moving(About::Agent(agent), 0), agent == SCOUT);
        AgentSpec {
            name: if sees { "scout".to_owned() } else { format!("agent-{agent}") },
            observation: if sees { [own, moving(About::Target(0), 4)].concat() } else { own },
            actions: ActionSpace::Discrete(5),
        }
    };
    let agents: Vec<AgentSpec> = (0..n_agents).map(agent).collect();
    Spec {
        id: id.to_owned(),
        unique: agents[SCOUT].observation.len(),
        agents,
        common: Vec::new(),
        landmarks: 0,
        targets: 1,
        episode_steps: 25,
        dt: Scout::physics(n_agents).dt,
        team_reward: TeamReward::Sum,
        paper: PaperSetting::One,
        positions: true,
    }
}

impl Rules for Scout {
    fn physics(n_agents: usize) -> Physics {
        Physics::of(vec![Body::of_size(0.075); n_agents])
    }

    fn move_targets(plane: &mut Plane, physics: &Physics, draws: &mut Draws) {
        let target = &mut plane.targets[0];
        target.go(SPEED * target.wander(draws), physics.dt);
    }

    /// Every agent observes its own velocity and place, and the scout those of the target behind them.
    fn observe(plane: &Plane, agent: usize, out: &mut [f32]) {
        out.fill(0.0);
        write(&[plane.velocities[agent], plane.positions[agent]], out);
        if agent == SCOUT {
            let target = plane.targets[0];
            write(&[target.velocity, target.position], &mut out[4..]);
        }
    }

    /// Everybody pays how far the agents are from the target in the mean.
    fn reward(plane: &Plane, _physics: &Physics, rewards: &mut [f64]) {
        let target = plane.targets[0].position;
        let distances: f64 = plane.positions.iter().map(|position| position.distance(target)).sum();
        rewards.fill(-distances / plane.positions.len() as f64);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Outcome, State, Target, Task};
    use glam::{DVec2, dvec2};

    #[test]
    fn only_the_scout_sees_the_target_and_all_pay_for_all() {
        let mut world = Task::parse("scout-2").unwrap().environment(1);
        let target = Target { position: dvec2(0.5, -0.5), velocity: dvec2(0.0, 1.0) };
        let state = State {
            positions: vec![dvec2(0.5, 0.0), dvec2(0.0, -0.5)],
            velocities: vec![DVec2::ZERO; 2],
            targets: vec![target],
            ..State::default()
        };
        world.set_state(0, &state, None).unwrap();
        let mut seen = [f32::NAN; 16];
        world.observe(1, &mut seen).unwrap();
        assert_eq!(seen[..8], [0.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, -0.5]);
        assert_eq!(seen[8..], [0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 0.0, 0.0]);
        let mut outcome = Outcome::of(1, 2);
        world.step(&[0, 0], &[true], &mut outcome).unwrap();
        let target = world.state(0).targets[0];
        assert!((target.velocity.length() - 1.0).abs() < 1e-12);
        let expected =
            -state.positions.iter().map(|place| place.distance(target.position)).sum::<f64>() / 2.0;
        assert_eq!(outcome.rewards, [expected; 2]);
    }

    #[test]
    fn the_target_does_not_care_what_agents_do() {
        let walk = |action| {
            let mut world = Task::parse("scout-3").unwrap().environment(1);
            world.reset(0, 1, 2).unwrap();
            for _ in 0..25 {
                world.step(&[action; 3], &[true], &mut Outcome::of(1, 3)).unwrap();
            }
            world.state(0).targets
        };
        assert_eq!(walk(0), walk(3));
    }
}
