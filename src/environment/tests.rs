use super::*;
use crate::base::rng::{Draws, Purpose};

/// One world of each task.
fn worlds() -> Vec<Box<dyn Environment>> {
    let mut tasks = Task::all();
    tasks.extend(["spread-blindfold-1", "spread-xy-64"].map(|name| Task::parse(name).unwrap()));
    tasks.iter().map(|task| task.environment(1)).collect()
}

fn world(name: &str) -> Box<dyn Environment> {
    Task::parse(name).unwrap().environment(1)
}

/// Of the first world.
fn bits(world: &dyn Environment) -> Vec<[u64; 2]> {
    bits_of(world, 0)
}

fn bits_of(batch: &dyn Environment, world: usize) -> Vec<[u64; 2]> {
    let State { positions, velocities, landmarks, .. } = batch.state(world);
    let all = positions.iter().chain(&velocities).chain(&landmarks);
    all.map(|vector| vector.to_array().map(f64::to_bits)).collect()
}

fn step(world: &mut dyn Environment, actions: &[u32]) -> Vec<f64> {
    let mut outcome = Outcome::of(1, world.spec().n_agents());
    world.step(actions, &[true], &mut outcome).unwrap();
    outcome.rewards
}

/// Padded observations, `[agents, observation]`.
fn observe(world: &mut dyn Environment) -> Vec<f32> {
    let mut observations = vec![f32::NAN; world.spec().n_agents() * world.spec().padded_obs_dim()];
    world.observe(1, &mut observations).unwrap();
    observations
}

#[test]
fn an_episode_starts_where_its_address_says() {
    for mut world in worlds() {
        let (agents, width) = (world.spec().n_agents(), world.spec().action_width());
        world.reset(0, 7, 3).unwrap();
        let (first, State { positions, velocities, landmarks, goal, .. }) = (bits(&*world), world.state(0));
        let everywhere = positions.iter().chain(&landmarks);
        assert!(everywhere.flat_map(|place| place.to_array()).all(|x| (-1.0..1.0).contains(&x)));
        assert!(velocities.iter().all(|&velocity| velocity == DVec2::ZERO));
        let seen = observe(&mut *world);
        for (seed, episode) in [(7, 4), (8, 3)] {
            world.reset(0, seed, episode).unwrap();
            assert_ne!(bits(&*world), first);
        }
        step(&mut *world, &vec![1; agents * width]);
        world.reset(0, 7, 3).unwrap();
        assert_eq!((bits(&*world), world.state(0).goal), (first, goal));
        assert_eq!(observe(&mut *world), seen, "nothing is left of the episode before");
    }
}

#[test]
fn starts_are_drawn_in_a_fixed_order() {
    let mut world = world("speaker-listener");
    world.reset(0, 1, 2).unwrap();
    let mut draws = Draws::new(1, Purpose::Reset, 2, 0);
    let State { positions, landmarks, goal, .. } = world.state(0);
    for place in positions.iter().chain(&landmarks) {
        assert_eq!(place.to_array(), [draws.between(-1.0, 1.0), draws.between(-1.0, 1.0)]);
    }
    assert_eq!(goal, Some(draws.below(3)));
}

#[test]
fn every_landmark_becomes_the_goal() {
    let mut world = world("speaker-listener");
    let mut seen = [0; 3];
    for episode in 0..300 {
        world.reset(0, 0, episode).unwrap();
        seen[world.state(0).goal.unwrap()] += 1;
    }
    assert!(seen.iter().all(|&times| times > 70), "{seen:?}");
}

#[test]
fn the_listener_hears_and_both_are_paid_for_the_goal() {
    let mut world = world("speaker-listener");
    let state = State {
        positions: vec![DVec2::ONE, DVec2::ZERO],
        velocities: vec![DVec2::ZERO; 2],
        landmarks: vec![DVec2::X, DVec2::Y, DVec2::NEG_X],
        goal: Some(2),
        ..State::default()
    };
    world.set_state(0, &state, None).unwrap();
    let seen = observe(&mut *world);
    assert_eq!(seen[..11], [0.15, 0.15, 0.65, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(seen[11..], [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0]);

    let rewards = step(&mut *world, &[1, 2]);
    assert_eq!(world.positions(0)[0], DVec2::ONE, "the speaker does not move");
    let seen = observe(&mut *world);
    assert_eq!(seen[11..], [-0.5, 0.0, 1.05, 0.0, 0.05, 1.0, -0.95, 0.0, 0.0, 1.0, 0.0]);
    assert!((rewards[0] + 0.95 * 0.95).abs() < 1e-15);
    assert!((world.spec().team_reward(&rewards) + 4.0 * 0.95 * 0.95).abs() < 1e-15);
}

#[test]
fn a_state_of_another_task_is_refused() {
    let state = world("hear-see").state(0);
    for name in ["speaker-listener", "spread-xy-2", "spread-blindfold"] {
        assert!(world(name).set_state(0, &state, None).is_err());
    }
    let goal = State { goal: Some(1), ..state };
    assert!(world("hear-see").set_state(0, &goal, None).is_err(), "there is one landmark");
}

#[test]
fn agents_that_all_start_in_one_place_come_apart_and_stay_finite() {
    for mut world in worlds() {
        let Spec { episode_steps, agents, .. } = world.spec().clone();
        // They push each other, or their motors are unsteady.
        let part = ["spread", "predator", "rendezvous"].iter().any(|name| world.spec().id.contains(name));
        let n = agents.len();
        let still = vec![0; n * world.spec().action_width()];
        for _ in 0..episode_steps {
            let rewards = step(&mut *world, &still);
            assert!(world.positions(0).iter().all(|position| position.is_finite()));
            assert!(rewards.iter().all(|reward| reward.is_finite()));
        }
        let [first, last] = [world.positions(0)[0], world.positions(0)[n - 1]];
        assert_eq!(first != last, part && n > 1);
    }
}

#[test]
fn worlds_of_a_batch_do_not_touch_each_other() {
    let mut batch = Task::parse("spread-xy-4").unwrap().environment(3);
    let (mut outcome, actions) = (Outcome::of(3, 4), [1, 2, 3, 4, 0, 1, 2, 3, 4, 0, 1, 2]);
    (0..3).for_each(|at| batch.reset(at, 5, 10 + at as u64).unwrap());
    let untouched = bits_of(&*batch, 1);
    batch.step(&actions, &[true, false, true], &mut outcome).unwrap();
    assert_eq!(bits_of(&*batch, 1), untouched, "a world that idles stays as it is");
    assert_eq!(outcome.rewards[4..8], [0.0; 4]);
    for at in [0, 2] {
        let mut alone = world("spread-xy-4");
        alone.reset(0, 5, 10 + at as u64).unwrap();
        let own: Vec<u32> = (0..4).map(|agent| actions[agent * 3 + at]).collect();
        assert_eq!(step(&mut *alone, &own), outcome.rewards[4 * at..][..4]);
        assert_eq!(bits(&*alone), bits_of(&*batch, at));
    }
}

#[test]
fn what_is_said_of_every_value_is_what_the_world_does() {
    for mut world in worlds() {
        let spec = world.spec().clone();
        world.reset(0, 3, 1).unwrap();
        for t in 0..10 {
            let mut actions = vec![0; spec.n_agents() * spec.action_width()];
            let mut draws = Draws::new(1, Purpose::Action, 0, t);
            let each = actions.chunks_exact_mut(spec.action_width()).zip(&spec.agents);
            each.for_each(|(action, agent)| agent.actions.draw(&mut draws, action));
            let before = observe(&mut *world);
            step(&mut *world, &actions);
            let after = observe(&mut *world);
            let rows = before.chunks(spec.padded_obs_dim()).zip(after.chunks(spec.padded_obs_dim()));
            for (agent, (before, after)) in spec.agents.iter().zip(rows) {
                assert!(agent.observation.len() <= spec.unique);
                let padding = &after[agent.observation.len()..spec.unique];
                assert!(padding.iter().all(|padding| *padding == 0.0));
                for (dim, value) in agent.observation.iter().enumerate() {
                    // In some worlds velocities change first, in others places do.
                    let expected = match value.rate {
                        Some((velocity, sign)) => {
                            [before, after].map(|seen| spec.dt as f32 * sign * seen[velocity])
                        }
                        None if value.about == About::Landmark => [0.0; 2],
                        None => continue,
                    };
                    let moved = after[dim] - before[dim];
                    let agrees = expected.iter().any(|expected| (moved - expected).abs() < 1e-5);
                    assert!(agrees, "{} {} dim {dim}", spec.id, agent.name);
                }
                for dim in spec.unique..spec.padded_obs_dim() {
                    assert_eq!(before[dim], after[dim], "landmarks stay");
                }
            }
        }
    }
}

#[test]
fn a_value_about_an_agent_changes_when_that_agent_is_moved_and_only_then() {
    for mut world in worlds() {
        let spec = world.spec().clone();
        world.reset(0, 9, 2).unwrap();
        let (state, before) = (world.state(0), observe(&mut *world));
        for moved in 0..spec.n_agents() {
            let mut other = state.clone();
            other.positions[moved] += glam::dvec2(0.25, 0.5);
            other.velocities[moved] += glam::dvec2(0.125, 0.375);
            world.set_state(0, &other, None).unwrap();
            let after = observe(&mut *world);
            for (agent, spec_of) in spec.agents.iter().enumerate() {
                for (dim, value) in spec_of.observation.iter().enumerate() {
                    let at = agent * spec.padded_obs_dim() + dim;
                    let (changes, about) = (before[at] != after[at], value.about == About::Agent(moved));
                    // What is seen from here changes with it as well.
                    let may_change = about || moved == agent;
                    assert!(changes || !about, "{} {agent} {dim}", spec.id);
                    assert!(!changes || may_change, "{} {agent} {dim}", spec.id);
                }
            }
        }
    }
}
