//! What each parameter of physics changes, in every task.

use super::*;
use crate::base::rng::{Draws, Purpose};
use crate::base::stats::{mean, std};

/// Each task in which nothing happens by chance, with this physics.
fn tasks(physics: &str) -> Vec<Task> {
    let physics = physics.parse().unwrap();
    let steady = Task::all().into_iter().filter(|task| task.chance() == 0.0);
    steady.map(|task| task.with_physics(physics).unwrap()).collect()
}

/// The actions of a team that all push along the same axis, or do not push.
fn actions(spec: &Spec, push: bool) -> Vec<u32> {
    let action = |agent: &AgentSpec| match agent.actions {
        ActionSpace::Discrete(_) => vec![u32::from(push)],
        ActionSpace::Box { .. } => [0.0, f32::from(u8::from(push)), 0.0, 0.0, 0.0].map(f32::to_bits).to_vec(),
    };
    spec.agents.iter().flat_map(action).collect()
}

fn step(world: &mut dyn Environment, push: bool) {
    let (actions, mut outcome) = (actions(world.spec(), push), Outcome::of(1, world.spec().n_agents()));
    world.step(&actions, &[true], &mut outcome).unwrap();
}

/// All at rest, too far apart to touch.
fn spread_out(world: &mut dyn Environment) {
    let mut state = world.state(0);
    for (agent, position) in state.positions.iter_mut().enumerate() {
        *position = glam::dvec2(agent as f64, 0.0);
    }
    state.velocities.fill(DVec2::ZERO);
    world.set_state(0, &state, None).unwrap();
}

/// How fast the last agent is, which can move in every task.
fn speed(world: &dyn Environment) -> f64 {
    world.state(0).velocities.last().unwrap().length()
}

#[test]
fn damping_and_mass_decide_what_a_push_does() {
    for (physics, keep, mass) in [
        ("mass=1", 0.75, 1.0),
        ("damping=0.3", 0.7, 1.0),
        ("mass=1.25", 0.75, 1.25),
        ("damping=0.2,mass=0.8", 0.8, 0.8),
        ("damping=0", 1.0, 1.0),
        ("damping=1", 0.0, 1.0),
    ] {
        for task in tasks(physics) {
            let mut world = task.environment(1);
            spread_out(&mut *world);
            // 5 N for 0.1 s, and again on top of what is kept.
            let push = 0.5 / mass;
            for expected in [push, push + keep * push] {
                step(&mut *world, true);
                assert!((speed(&*world) - expected).abs() < 1e-12, "{} {physics}", task.id());
            }
            step(&mut *world, false);
            let expected = keep * (push + keep * push);
            assert!((speed(&*world) - expected).abs() < 1e-12, "{} {physics}", task.id());
        }
    }
}

#[test]
fn contacts_push_light_agents_harder() {
    for id in ["spread-xy-2", "spread-blindfold", "simple-spread-3"] {
        for mass in [0.8, 1.0, 1.25] {
            let physics = PhysicsSpec { mass, ..PhysicsSpec::default() };
            let mut world = Task::parse(id).unwrap().with_physics(physics).unwrap().environment(1);
            spread_out(&mut *world);
            let mut state = world.state(0);
            // Sizes of 0.15 m overlap by 0.1 m: 10 N for 0.1 s.
            state.positions[1] = state.positions[0] + glam::dvec2(0.0, 0.2);
            world.set_state(0, &state, None).unwrap();
            step(&mut *world, false);
            let velocities = world.state(0).velocities;
            assert!((velocities[1].y - 1.0 / mass).abs() < 1e-12, "{id} {mass}: {velocities:?}");
            assert_eq!(velocities[0], -velocities[1]);
        }
    }
}

#[test]
fn motor_noise_is_in_every_push_and_on_both_axes() {
    for task in tasks("motor_noise=0.4,mass=2") {
        let mut world = task.environment(1);
        let agent = task.spec().n_agents() - 1;
        for push in [true, false] {
            let mut velocities = Vec::new();
            for episode in 0..2000 {
                world.reset(0, 5, episode).unwrap();
                spread_out(&mut *world);
                step(&mut *world, push);
                velocities.push(world.state(0).velocities[agent]);
            }
            // 0.4 of 5 N, for 0.1 s, on 2 kg.
            let (n, expected) = (velocities.len() as f64, 0.4 * 5.0 * 0.1 / 2.0);
            let of = |axis: usize| velocities.iter().map(|velocity| velocity[axis]).collect::<Vec<_>>();
            for axis in [0, 1] {
                let pushed = if push && axis == 0 { 0.25 } else { 0.0 };
                // Five standard errors.
                let (off, spread) =
                    (mean(&of(axis)).abs() - pushed, std(&of(axis)).unwrap() / expected - 1.0);
                assert!(off.abs() < 5.0 * expected / n.sqrt(), "{} {axis}: {off}", task.id());
                assert!(spread.abs() < 5.0 / (2.0 * n).sqrt(), "{} {axis}: {spread}", task.id());
            }
        }
    }
}

#[test]
fn motor_noise_does_not_depend_on_other_worlds() {
    for task in tasks("motor_noise=0.5") {
        let (spec, mut batch) = (task.spec(), task.environment(3));
        let mut alone = task.environment(1);
        (0..3).for_each(|at| batch.reset(at, 5, 10 + at as u64).unwrap());
        alone.reset(0, 5, 12).unwrap();
        let still = vec![0; 3 * spec.n_agents() * spec.action_width()];
        let mut outcome = Outcome::of(3, spec.n_agents());
        for _ in 0..4 {
            batch.step(&still, &[true, false, true], &mut outcome).unwrap();
            step(&mut *alone, false);
        }
        assert_eq!(batch.state(2), alone.state(0), "{}", task.id());
        assert_ne!(batch.state(0).velocities, alone.state(0).velocities, "{}", task.id());
        // The draws are those of the step, wherever the world is put before it.
        let state = alone.state(0);
        step(&mut *alone, false);
        let after = alone.state(0);
        alone.reset(0, 5, 12).unwrap();
        (0..4).for_each(|_| step(&mut *alone, false));
        alone.set_state(0, &state, None).unwrap();
        step(&mut *alone, false);
        assert_eq!(alone.state(0), after, "{}", task.id());
    }
}

#[test]
fn what_is_named_like_the_default_changes_nothing() {
    let named = tasks("motor_noise=0,damping=0.25,mass=1,wind=0");
    for (plain, named) in tasks("mass=1").iter().zip(named) {
        let [mut plain, mut named] = [plain.environment(1), named.environment(1)];
        for world in [&mut plain, &mut named] {
            world.reset(0, 2, 1).unwrap();
        }
        for t in 0..25 {
            let spec = plain.spec().clone();
            let mut draws = Draws::new(1, Purpose::Action, 0, t);
            let mut words = vec![0; spec.n_agents() * spec.action_width()];
            let each = words.chunks_exact_mut(spec.action_width()).zip(&spec.agents);
            each.for_each(|(action, agent)| agent.actions.draw(&mut draws, action));
            for world in [&mut plain, &mut named] {
                world.step(&words, &[true], &mut Outcome::of(1, spec.n_agents())).unwrap();
            }
            assert_eq!(plain.state(0), named.state(0));
        }
    }
}

#[test]
fn wind_pushes_all_who_move_alike_and_is_that_of_its_address() {
    for task in tasks("wind=0.5,mass=2") {
        let (spec, mut batch) = (task.spec(), task.environment(2));
        let mut alone = task.environment(1);
        (0..2).for_each(|at| batch.reset(at, 5, 20 + at as u64).unwrap());
        alone.reset(0, 5, 21).unwrap();
        let still = vec![0; 2 * spec.n_agents() * spec.action_width()];
        let mut outcome = Outcome::of(2, spec.n_agents());
        for _ in 0..3 {
            batch.step(&still, &[true; 2], &mut outcome).unwrap();
            step(&mut *alone, false);
        }
        assert_eq!(batch.state(1), alone.state(0), "{}", task.id());
        spread_out(&mut *alone);
        step(&mut *alone, false);
        let velocities = alone.state(0).velocities;
        let pushed = |velocity: &&DVec2| **velocity != DVec2::ZERO;
        let movable = usize::from(task.id() != "speaker-listener") * spec.n_agents();
        assert_eq!(velocities.iter().filter(pushed).count(), movable.max(1), "{}", task.id());
        let moving: Vec<&DVec2> = velocities.iter().filter(pushed).collect();
        assert!(moving.iter().all(|velocity| **velocity == *moving[0]), "{} {velocities:?}", task.id());
    }
}

#[test]
fn noise_and_wind_come_on_top_of_those_of_a_task() {
    let task =
        |physics: &str| Task::parse("rendezvous-3").unwrap().with_physics(physics.parse().unwrap()).unwrap();
    assert!((task("mass=1").chance() - 1f64.hypot(0.8)).abs() < 1e-15);
    assert!((task("wind=0.5,motor_noise=2").chance() - (1.0f64 + 0.64 + 0.25 + 4.0).sqrt()).abs() < 1e-15);
    let after = |physics: &str| {
        let mut world = task(physics).environment(1);
        world.reset(0, 1, 1).unwrap();
        step(&mut *world, false);
        world.state(0).velocities[0]
    };
    // The same gust, of strength 1, 1.25 and 1.5.
    let [one, stronger, strongest] = ["mass=1", "wind=0.75", "wind=1.118033988749895"].map(after);
    assert!(one != stronger && (strongest - one - 2.0 * (stronger - one)).length() < 1e-12);
}
