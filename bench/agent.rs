//! A decision, piece by piece: `RAYON_NUM_THREADS=1 cargo bench --bench agent`. The goal is 1.5 times the reading of
//! the weights that it takes, in one world; what a GRU takes of its state alone is part of `predict`.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};

use vamaro_swarm::agent::{Agent, AgentSettings, Inbox, PREFERRED, Received, dims};
use vamaro_swarm::environment::Task;
use vamaro_swarm::nn::reference::CandleNetwork;
use vamaro_swarm::nn::{ActorKind, Networks, Policy, kernels};

/// Numbers in [-1, 1] without a pattern that matters.
fn numbers(len: usize) -> Vec<f32> {
    (0..len).map(|at| (at as f32 * 0.37).sin()).collect()
}

fn pieces(c: &mut Criterion) {
    let task = Task::parse("spread-xy-4").expect("a task");
    for kind in [ActorKind::Mlp, ActorKind::Gru] {
        let policy =
            Policy::untrained(&dims(task.spec()), 0, Networks::paper(kind)).expect("the paper's networks");
        let weights: Vec<&[f32]> = policy
            .tensors()
            .filter(|(spec, _)| spec.name.starts_with("actors.0.") && !spec.name.ends_with("_hh"))
            .map(|(_, tensor)| tensor.values())
            .collect();
        c.bench_function(&format!("the weights of a decision read once, {kind}"), |bencher| {
            bencher.iter(|| weights.iter().for_each(|values| _ = black_box(kernels::sum(values))))
        });
        for worlds in [1, 10] {
            let imputer = PREFERRED.to_owned();
            let settings = AgentSettings { imputer, worlds, ..AgentSettings::of(task.spec()) };
            let mut agent = Agent::with_policy(&settings, &policy, 0).expect("an agent");
            let observation = numbers(task.spec().padded_obs_dim());
            let inbox =
                Inbox::of(task.spec().n_agents(), |_| Some(Received { age: 0, observation: &observation }));
            agent.begin_episode(worlds);
            c.bench_function(&format!("fuse, {kind}, {worlds} worlds"), |bencher| {
                bencher.iter(|| (0..worlds).for_each(|world| agent.fuse(world, &observation, &inbox)))
            });
            c.bench_function(&format!("act, {kind}, {worlds} worlds"), |bencher| {
                bencher.iter(|| agent.act(0, 0, &vec![0.5; worlds]).expect("a network acts"))
            });
            c.bench_function(&format!("predict, {kind}, {worlds} worlds"), |bencher| {
                bencher.iter(|| agent.predict())
            });
            let mut actor = CandleNetwork::actor(&policy, 0, worlds);
            let inputs = numbers(worlds * task.spec().joint_dim());
            c.bench_function(&format!("candle's actor, {kind}, {worlds} worlds"), |bencher| {
                bencher.iter(|| actor.step(worlds, &inputs, &[]))
            });
        }
    }
}

criterion_group!(benches, pieces);
criterion_main!(benches);
