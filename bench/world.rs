//! A world, piece by piece: `cargo bench --bench world`. The goal is 5 M env steps/s on one core for 4 agents, 200 ns
//! for a step and all its observations.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};

use vamaro_swarm::environment::{Task, World};

fn pieces(c: &mut Criterion) {
    for task in ["hear-see", "spread-xy-4", "spread-blindfold-12"] {
        let task = Task::parse(task).expect("a task");
        let (mut world, id) = (World::new(&task), task.id());
        let mut episode = 0;
        c.bench_function(&format!("reset, {id}"), |bencher| {
            bencher.iter(|| {
                episode += 1;
                world.reset(0, episode);
            })
        });
        let mut step = 0;
        c.bench_function(&format!("step and rewards, {id}"), |bencher| {
            let mut actions = vec![0; task.n_agents()];
            bencher.iter(|| {
                step += 1;
                actions
                    .iter_mut()
                    .enumerate()
                    .for_each(|(agent, action)| *action = ((step + agent) % 3) as u8);
                world.step(&actions);
                black_box(world.team_reward())
            })
        });
        c.bench_function(&format!("observations of all, {id}"), |bencher| {
            let mut observations = vec![0.0; task.n_agents() * task.padded_obs_dim()];
            bencher.iter(|| {
                let all = observations.chunks_exact_mut(task.padded_obs_dim());
                all.enumerate().for_each(|(agent, observation)| world.observe(agent, observation));
                black_box(&observations);
            })
        });
    }
}

criterion_group!(benches, pieces);
criterion_main!(benches);
