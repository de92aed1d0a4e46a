use super::*;

fn worlds() -> Vec<World> {
    let mut tasks = Task::all();
    tasks.extend(["spread-blindfold-1", "spread-xy-64"].map(|name| Task::parse(name).unwrap()));
    tasks.iter().map(World::new).collect()
}

fn bits(world: &World) -> Vec<[u64; 2]> {
    let bodies = world.positions().iter().chain(world.velocities()).chain(world.landmarks());
    bodies.map(|vector| vector.to_array().map(f64::to_bits)).collect()
}

#[test]
fn an_episode_starts_where_its_address_says() {
    for mut world in worlds() {
        world.reset(7, 3);
        let (first, goal) = (bits(&world), world.goal());
        let everywhere = world.positions().iter().chain(world.landmarks());
        assert!(everywhere.flat_map(|place| place.to_array()).all(|x| (-1.0..1.0).contains(&x)));
        for (seed, episode) in [(7, 4), (8, 3)] {
            world.reset(seed, episode);
            assert_ne!(bits(&world), first);
        }
        world.step(&vec![1; world.task().n_agents()]);
        world.reset(7, 3);
        assert_eq!((bits(&world), world.goal()), (first, goal));
        assert!(world.velocities().iter().all(|&velocity| velocity == DVec2::ZERO));
        assert!(world.agent_rewards().iter().all(|&reward| reward == 0.0));
        assert_eq!(world.message(), None);
    }
}

#[test]
fn starts_are_drawn_in_a_fixed_order() {
    let mut world = World::new(&Task::parse("speaker-listener").unwrap());
    world.reset(1, 2);
    let mut draws = Draws::new(1, Purpose::Reset, 2, 0);
    for place in world.positions().iter().chain(world.landmarks()) {
        assert_eq!(place.to_array(), [draws.between(-1.0, 1.0), draws.between(-1.0, 1.0)]);
    }
    assert_eq!(world.goal(), Some(draws.below(3)));
}

#[test]
fn every_landmark_becomes_the_goal() {
    let mut world = World::new(&Task::parse("speaker-listener").unwrap());
    let mut seen = [0; 3];
    for episode in 0..300 {
        world.reset(0, episode);
        seen[world.goal().unwrap()] += 1;
    }
    assert!(seen.iter().all(|&times| times > 70), "{seen:?}");
}

#[test]
fn the_listener_hears_and_both_are_paid_for_the_goal() {
    let mut world = World::new(&Task::parse("speaker-listener").unwrap());
    let landmarks = [DVec2::X, DVec2::Y, DVec2::NEG_X];
    world.set_state(&[DVec2::ONE, DVec2::ZERO], &[DVec2::ZERO; 2], &landmarks, Some(2), None);
    let mut seen = [f32::NAN; 11];
    world.observe(0, &mut seen);
    assert_eq!(seen, [0.15, 0.15, 0.65, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    world.observe(1, &mut seen);
    assert_eq!(seen, [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0]);

    world.step(&[1, 2]);
    assert_eq!((world.message(), world.positions()[0]), (Some(1), DVec2::ONE));
    world.observe(1, &mut seen);
    assert_eq!(seen, [-0.5, 0.0, 1.05, 0.0, 0.05, 1.0, -0.95, 0.0, 0.0, 1.0, 0.0]);
    assert!((world.agent_rewards()[0] + 0.95 * 0.95).abs() < 1e-15);
    assert!((world.team_reward() + 4.0 * 0.95 * 0.95).abs() < 1e-15);
}

#[test]
fn an_action_an_agent_does_not_have_does_nothing() {
    for task in Task::all() {
        let mut world = World::new(&task);
        world.reset(0, 0);
        let mut still = world.clone();
        let beyond: Vec<u8> = (0..task.n_agents()).map(|agent| task.available_actions(agent) as u8).collect();
        for actions in [beyond, vec![255; task.n_agents()]] {
            world.step(&actions);
            still.step(&vec![0; task.n_agents()]);
            assert_eq!(bits(&world), bits(&still));
            assert_eq!(world.message(), None);
        }
    }
}

#[test]
fn agents_that_all_start_in_one_place_come_apart_and_stay_finite() {
    for mut world in worlds() {
        let n = world.task().n_agents();
        let collide = world.task().physics().bodies[0].collides;
        for _ in 0..EPISODE_STEPS {
            world.step(&vec![0; n]);
            assert!(world.positions().iter().all(|position| position.is_finite()));
            assert!(world.team_reward().is_finite());
        }
        let [first, last] = [world.positions()[0], world.positions()[n - 1]];
        assert_eq!(first != last, collide && n > 1);
    }
}

#[test]
#[should_panic(expected = "one action per agent")]
fn a_step_takes_one_action_per_agent() {
    World::new(&Task::by_team_size(4).unwrap()).step(&[0; 3]);
}
