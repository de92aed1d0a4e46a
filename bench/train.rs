//! One update and its pieces, at the sizes of the paper, with both backends: `cargo bench --bench train`.
//!
//! candle keeps to one thread, as a network in training should, with `RAYON_NUM_THREADS=1` in the environment.

use criterion::{Criterion, criterion_group, criterion_main};

use vamaro_swarm::agent::dims;
use vamaro_swarm::environment::Task;
use vamaro_swarm::nn::{ActorKind, Network, Networks, PredictorSpec, Sharing, critic};
use vamaro_swarm::train::network::Passes;
use vamaro_swarm::train::{Backend, Batch, Ends, Learner, Parameters, Settings};

/// Steps of an episode of every built-in task.
const EPISODE_STEPS: usize = 25;

const BACKENDS: [Backend; 2] = [Backend::Native, Backend::Candle];

/// Episodes of a batch.
const EPISODES: usize = 10;

/// The paper's settings: MLP actors for the first task, GRU actors for the second.
const SETTINGS: [(ActorKind, &str); 2] = [(ActorKind::Mlp, "hear-see"), (ActorKind::Gru, "spread-xy-4")];

/// Numbers in [-1, 1] without a pattern that matters.
fn numbers(len: usize) -> Vec<f32> {
    (0..len).map(|at| (at as f32 * 0.37).sin()).collect()
}

/// Forward and backward once: what an epoch asks of a network besides its step.
fn pass(c: &mut Criterion, name: &str, network: &Network, steps: usize) {
    let mut parameters = Parameters::untrained(network, 1);
    let x = numbers(steps * EPISODES * parameters.specs[0].shape[0]);
    for backend in BACKENDS {
        let mut passes = Passes::new(backend, network);
        let d = numbers(passes.forward(&parameters.values, steps, EPISODES, &x).len());
        let Parameters { values, gradient, .. } = &mut parameters;
        c.bench_function(&format!("{name}, {backend:?}"), |bencher| {
            bencher.iter(|| {
                passes.forward(values, steps, EPISODES, &x);
                passes.backward(values, &x, &d, gradient);
            })
        });
    }
}

fn pieces(c: &mut Criterion) {
    for (kind, task) in SETTINGS {
        let (task, networks) = (Task::parse(task).expect("a task"), Networks::paper(kind));
        let (dims, id) = (dims(task.spec()), task.id());
        let actor = networks.actor(0, &dims);
        pass(c, &format!("actor epoch, {kind}, {id}"), &actor, EPISODE_STEPS);
        let inputs = task.spec().n_agents() * task.spec().padded_obs_dim();
        let critic = critic(Sharing::Separate, 0, inputs, networks.hidden);
        pass(c, &format!("critic epoch, {id}"), &critic, EPISODE_STEPS);
        let predictor = PredictorSpec::paper("maro").network(&dims);
        pass(c, &format!("predictor step, {id}"), &predictor, EPISODE_STEPS - 1);

        let mut parameters = Parameters::untrained(&actor, 1);
        parameters.gradient.each_mut().flatten().zip(numbers(1 << 20)).for_each(|(g, value)| *g = value);
        c.bench_function(&format!("Adam, actor, {kind}, {id}"), |bencher| {
            bencher.iter(|| parameters.step(1e-4, 1.0))
        });
    }
}

fn updates(c: &mut Criterion) {
    for (kind, task) in SETTINGS {
        let task = Task::parse(task).expect("a task");
        let (n, rows) = (task.spec().n_agents(), EPISODES * EPISODE_STEPS);
        let batch = Batch {
            episodes: EPISODES,
            steps: EPISODE_STEPS,
            observations: numbers((rows + EPISODES) * n * task.spec().padded_obs_dim()),
            joint: numbers((rows + EPISODES) * task.spec().joint_dim()),
            estimates: Vec::new(),
            ages: Vec::new(),
            actions: (0..rows * n).map(|at| (at % 3) as u8).collect(),
            rewards: numbers(rows),
            ends: Ends::truncated(EPISODES, EPISODE_STEPS),
        };
        let available: Vec<usize> = (0..n).map(|agent| task.spec().available_actions(agent)).collect();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let mut group = c.benchmark_group("update");
        group.sample_size(20);
        for backend in BACKENDS {
            let settings = Settings { backend, ..Settings::paper(kind) };
            let sizes = (dims(task.spec()), task.spec().padded_obs_dim());
            let mut team = Learner::untrained(settings, &sizes.0, sizes.1, &available, 1, threads);
            group.bench_function(format!("{}, {threads} threads, {backend:?}", task.id()), |bencher| {
                bencher.iter(|| team.update(&batch, &[]).critics.loss)
            });
        }
    }
}

criterion_group!(benches, pieces, updates);
criterion_main!(benches);
