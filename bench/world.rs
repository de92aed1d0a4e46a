//! A world, piece by piece: `cargo bench --bench world`. The goal is 5 M env steps/s on one core for 4 agents, 200 ns
//! for a step and all its observations.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};

use vamaro_swarm::environment::{Outcome, Task};

fn pieces(c: &mut Criterion) {
    for task in ["hear-see", "spread-xy-4", "spread-blindfold-12"] {
        let task = Task::parse(task).expect("a task");
        let (spec, mut world, id) = (task.spec(), task.environment(1), task.id());
        let mut episode = 0;
        c.bench_function(&format!("reset, {id}"), |bencher| {
            bencher.iter(|| {
                episode += 1;
                world.reset(0, 0, episode).expect("it can begin");
            })
        });
        let mut step = 0;
        c.bench_function(&format!("step and rewards, {id}"), |bencher| {
            let mut actions = vec![0; spec.n_agents()];
            let mut outcome = Outcome::of(1, spec.n_agents());
            bencher.iter(|| {
                step += 1;
                actions
                    .iter_mut()
                    .enumerate()
                    .for_each(|(agent, action)| *action = ((step + agent) % 3) as u32);
                world.step(&actions, &[true], &mut outcome).expect("it can step");
                black_box(spec.team_reward(&outcome.rewards))
            })
        });
        c.bench_function(&format!("observations of all, {id}"), |bencher| {
            let mut observations = vec![0.0; spec.n_agents() * spec.padded_obs_dim()];
            bencher.iter(|| {
                world.observe(1, &mut observations).expect("it can be observed");
                black_box(&observations);
            })
        });
    }
}

criterion_group!(benches, pieces);
criterion_main!(benches);
