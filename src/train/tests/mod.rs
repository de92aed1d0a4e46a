//! Updates against their definitions. That they are the paper's, `tests/suite/verify.rs` shows on recorded ones.

mod checkpoint;
mod ends;
mod estimates;
mod fit;
mod gradients;
mod learner_state;
mod losses;
mod predictors;

use super::batch::gather;
use super::divergence::Divergence;
use super::learner_state::Counters;
use super::memory::Buffer;
use super::network::Passes;
use super::predictor::LearningPredictor;
use super::*;
use crate::base::rng::{Draws, Purpose};
use crate::bus::NOT_ARRIVED;
use crate::environment::{About, ActionSpace, AgentSpec, Axis, Value};
use crate::nn::{ActorKind, Dims, Input, Meta, Networks, Policy, PredictorSpec, Scratch, Sharing, Sigma};
use std::collections::HashMap;
use std::time::{Duration, Instant};

const N: usize = 3;
const OBSERVATION: usize = 4;
/// The second agent lacks two actions.
const AVAILABLE: [usize; N] = [5, 3, 5];

fn numbers(seed: u64, n: usize) -> Vec<f32> {
    let mut draws = Draws::new(seed, Purpose::Reset, 0, 0);
    (0..n).map(|_| draws.between(-1.0, 1.0) as f32).collect()
}

fn dims() -> Dims {
    let observation = |agent: usize| {
        let places = Axis::BOTH.map(|axis| Value::moving(About::Agent(agent), axis, 2 + axis as usize, 1.0));
        [places, Axis::BOTH.map(|axis| Value::velocity(About::Agent(agent), axis))].concat()
    };
    let agent = |agent| AgentSpec {
        name: "toy".to_string(),
        observation: observation(agent),
        actions: ActionSpace::Discrete(5),
    };
    Dims {
        task: "toy".to_string(),
        n_agents: N,
        joint: 8,
        predicted: 6,
        n_actions: 5,
        agents: (0..N).map(agent).collect(),
    }
}

fn batch(seed: u64) -> Batch {
    let (episodes, steps) = (4, 6);
    let rows = episodes * steps;
    Batch {
        episodes,
        steps,
        observations: numbers(seed, (rows + episodes) * N * OBSERVATION),
        joint: numbers(seed + 1, (rows + episodes) * dims().joint),
        estimates: Vec::new(),
        ages: Vec::new(),
        actions: (0..rows * N).map(|at| (at * 7 % AVAILABLE[at % N]) as u8).collect(),
        rewards: numbers(seed + 2, rows),
        ends: Ends::truncated(episodes, steps),
    }
}

/// The same with episodes of which one goes to the end, one is cut off and two are terminated, one of them at once.
fn ended(seed: u64) -> Batch {
    let mut batch = batch(seed);
    batch.ends.set(1, 3, true);
    batch.ends.set(2, 4, false);
    batch.ends.set(3, 1, true);
    batch
}

fn settings(actor: ActorKind, sharing: Sharing) -> Settings {
    let predictor = |name| PredictorSpec { hidden: 5, ..PredictorSpec::paper(name) };
    let predictors = vec![predictor("value-aware"), predictor("maro")];
    let networks = Networks { sharing, hidden: 12, predictors, ..Networks::paper(actor) };
    let objectives = [Objective::ValueAware { lambda: 1.0 }, Objective::Maro];
    Settings {
        networks,
        critic_sharing: sharing,
        critic_hidden: 12,
        predictors: objectives.map(PredictorSettings::paper).to_vec(),
        entropy_coefficient: 0.5,
        ..Settings::paper(actor)
    }
}

/// The same with predictors that see what their agent does.
fn acting(mut settings: Settings) -> Settings {
    for predictor in &mut settings.networks.predictors {
        predictor.inputs = vec![Input::Estimate, Input::OwnAction];
    }
    settings
}

/// The same with actors that see what arrives and how old it is.
fn sensing(mut settings: Settings) -> Settings {
    settings.networks.actor_inputs = vec![Input::Estimate, Input::Delivered, Input::Age];
    settings
}

/// Episodes in which links failed, of different lengths.
fn heard(seed: u64) -> Batch {
    let batch = ended(seed);
    let rows = (batch.steps + 1) * batch.episodes;
    let age = |at: usize| if at * 7 % 5 < 2 { NOT_ARRIVED } else { (at * 3 % 4) as u8 };
    Batch {
        estimates: numbers(seed + 3, rows * N * dims().joint),
        ages: (0..rows * N * N).map(age).collect(),
        ..batch
    }
}

fn team(settings: Settings, threads: usize) -> Learner {
    Learner::untrained(settings, &dims(), OBSERVATION, &AVAILABLE, 5, threads)
}

fn kinds() -> impl Iterator<Item = (ActorKind, Sharing)> {
    let kinds = [ActorKind::Mlp, ActorKind::Gru].into_iter();
    kinds.flat_map(|kind| [(kind, Sharing::Separate), (kind, Sharing::Shared)])
}

fn weights(team: &Learner) -> Vec<u32> {
    team.networks().flat_map(|network| network.values.all()).map(|value| value.to_bits()).collect()
}

/// One step of a predictor in an update.
fn once() -> Settings {
    settings(ActorKind::Mlp, Sharing::Separate)
}

/// A predictor for `objective` that does not move.
fn still_predictor(objective: Objective, held: Vec<usize>, carry_gradients: bool) -> LearningPredictor {
    still(PredictorSpec { hidden: 5, held, ..PredictorSpec::paper("p") }, objective, carry_gradients)
}

/// A predictor of this kind that does not move.
fn still(spec: PredictorSpec, objective: Objective, carry_gradients: bool) -> LearningPredictor {
    let settings = PredictorSettings {
        learning_rate: 0.0,
        largest_gradient: 0.1,
        carry_gradients,
        ..PredictorSettings::paper(objective)
    };
    LearningPredictor::new(&spec, &settings, &dims(), Backend::Native, 2)
}

/// A team's state by name.
fn saved(team: &Learner) -> HashMap<String, Vec<f32>> {
    team.state().into_iter().map(|(name, _, values)| (name, values.to_vec())).collect()
}

#[test]
fn any_number_of_threads_comes_to_the_same_bits() {
    for (kind, sharing) in kinds() {
        let learn = |threads| {
            let settings = settings(kind, sharing);
            let settings = if kind == ActorKind::Gru { acting(settings) } else { settings };
            let mut team = team(settings, threads);
            for seed in 0..3 {
                let (batch, replay) = (batch(seed), batch(seed + 100));
                team.update(&batch, &[replay.trajectories()]);
            }
            let losses = team.update(&batch(9), &[]).clone();
            (weights(&team), losses)
        };
        let one = learn(1);
        assert!(one.1.predictors[0].is_some() && one.1.predictors[1].is_none());
        for threads in [2, 5] {
            assert_eq!(learn(threads), one, "{kind}, {sharing}, {threads} threads");
        }
    }
}

#[test]
fn learner_and_agents_compute_the_same_bits() {
    for (kind, sharing) in kinds() {
        let settings = settings(kind, sharing);
        let (team, batch) = (team(settings.clone(), 1), batch(1));
        let mut values = Vec::new();
        team.policy_values(&mut values);
        let policy = Policy::new(&dims(), Meta::new("toy", 0), settings.networks.clone(), &values).unwrap();
        for agent in 0..N {
            let weights = &team.actors[agent.min(team.actors.len() - 1)].parameters.values;
            let mut x = Buffer::default();
            gather(&batch.joint, 1, dims().joint, &(agent..agent + 1), sharing.id_len(&dims()), &mut x);
            let network = settings.networks.actor(agent, &dims());
            let mut passes = Passes::new(Backend::Native, &network);
            let learned = passes.forward(weights, batch.steps + 1, batch.episodes, &x);

            let (actor, mut scratch) = (policy.actor(agent), Scratch::default());
            let mut state = actor.state(batch.episodes);
            let mut logits = vec![0.0; batch.episodes * dims().n_actions];
            let steps = batch.joint.chunks_exact(batch.episodes * dims().joint);
            for (inputs, learned) in steps.zip(learned.chunks_exact(logits.len())) {
                actor.step(batch.episodes, inputs, &[], &mut state, &mut scratch, &mut logits).unwrap();
                let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&logits), bits(learned), "{kind}, {sharing}, agent {agent}");
            }
        }
    }
}

#[test]
fn egocentric_actors_learn_from_what_their_agents_see() {
    for (kind, sharing) in kinds() {
        let mut settings = settings(kind, sharing);
        settings.networks.actor_inputs = vec![Input::Egocentric];
        let (mut team, batch) = (team(settings.clone(), 1), batch(1));
        let mut values = Vec::new();
        team.policy_values(&mut values);
        let policy = Policy::new(&dims(), Meta::new("toy", 0), settings.networks.clone(), &values).unwrap();
        for agent in 0..N {
            let actors = team.actors.len();
            let learning = &mut team.actors[agent.min(actors - 1)];
            learning.begin(N, &batch);
            let (views, network) = (learning.agents.len(), settings.networks.actor(agent, &dims()));
            let mut passes = Passes::new(Backend::Native, &network);
            let rows = batch.episodes * views;
            let learned = passes.forward(&learning.parameters.values, batch.steps, rows, &learning.x);
            let mut learned = learned.chunks_exact(dims().n_actions).skip(agent % views).step_by(views);

            let (actor, mut scratch) = (policy.actor(agent), Scratch::default());
            let mut state = actor.state(batch.episodes);
            let mut logits = vec![0.0; batch.episodes * dims().n_actions];
            for inputs in batch.joint.chunks_exact(batch.episodes * dims().joint).take(batch.steps) {
                actor.step(batch.episodes, inputs, &[], &mut state, &mut scratch, &mut logits).unwrap();
                for logits in logits.chunks_exact(dims().n_actions) {
                    assert_eq!(Some(logits), learned.next(), "{kind}, {sharing}, agent {agent}");
                }
            }
        }
    }
}

#[test]
fn the_critic_of_a_team_says_one_value_for_all() {
    let settings = Settings {
        critic_input: CriticInput::Team,
        critic_hidden: 7,
        critic_sharing: Sharing::Shared,
        ..settings(ActorKind::Mlp, Sharing::Separate)
    };
    let mut team = team(settings, 2);
    assert_eq!((team.critics.len(), team.actors.len()), (1, N));
    let batch = batch(1);
    team.update(&batch, &[]);
    let rows = team.advantages().chunks_exact(N);
    assert!(rows.clone().all(|row| row.iter().all(|advantage| *advantage == row[0])));
    assert!(rows.clone().any(|row| row[0] != team.advantages()[0]));
    // What it sees last is the reward of the step before.
    let critic = &team.critics[0];
    let inputs = critic.parameters.specs[0].shape[0];
    assert_eq!((inputs, critic.parameters.specs[0].shape[1]), (N * OBSERVATION + 1, 7));
    let reward = |at: usize| critic.x[at * inputs + inputs - 1];
    let mut rewards = batch.rewards.clone();
    crate::train::returns::standardise(&mut rewards, &batch.ends);
    for at in 0..batch.episodes * batch.steps {
        let before = at.checked_sub(batch.episodes).map_or(0.0, |before| rewards[before]);
        assert_eq!(reward(at), before, "row {at}");
    }
}

#[test]
fn targets_follow_when_it_is_time() {
    let mut team = team(Settings { target_interval: 3, ..settings(ActorKind::Mlp, Sharing::Separate) }, 1);
    let start = team.critics[1].target.all().to_vec();
    for update in 1..=7 {
        team.update(&batch(update), &[]);
        let critic = &team.critics[1];
        assert_eq!(critic.target.all() == start, update < 3, "update {update}");
        assert_eq!(critic.target.all() == critic.parameters.values.all(), update % 3 == 0, "update {update}");
    }
}

#[test]
fn every_network_is_timed() {
    let mut team = team(settings(ActorKind::Gru, Sharing::Separate), 2);
    assert_eq!(team.busy(), Busy::default());
    let began = Instant::now();
    team.update(&batch(1), &[batch(2).trajectories()]);
    let (busy, passed) = (team.busy(), began.elapsed());
    for part in [busy.actors, busy.critics, busy.predictors] {
        assert!(part > Duration::ZERO && part <= 2 * passed);
    }
}

#[test]
fn operations_counted_by_hand() {
    let settings = Settings { predictor_updates: 2, epochs: 3, ..settings(ActorKind::Gru, Sharing::Shared) };
    let team = team(settings, 1);
    // Ids behind 8 joint and 3 x 4 observed values; the first layer's input has no derivative.
    let (first, cell, out) = (11 * 12, 2 * 12 * 36, 12 * 5);
    let actor = 2 * (2 * first + 3 * (cell + out)) * 3 * (4 * 6 * N);
    let (first, rest) = (15 * 12, 12 * 12 + 12);
    let critic = 2 * (2 * first + 3 * rest) * 3 * (4 * 6 * N) + 2 * (first + rest) * (4 * 7 * N);
    let (first, cell, out) = (8 * 5, 2 * 5 * 20, 5 * 12);
    let predictor = |episodes: usize| 2 * (2 * first + 3 * (cell + out)) * 2 * (episodes * 5);
    let expected = actor + critic + predictor(4) + predictor(7);
    assert_eq!(team.flop_per_update(4, 6, 7), expected as f64);

    // A predictor that sees its agent's action has a row for each agent, and 3 x 5 more values in it. A skip's input
    // has no derivative either.
    let mut settings = acting(Settings {
        predictor_updates: 2,
        epochs: 3,
        ..self::settings(ActorKind::Gru, Sharing::Shared)
    });
    settings.networks.predictors.iter_mut().for_each(|predictor| predictor.skip = true);
    let team = self::team(settings, 1);
    let on_input = 23 * 5 + 23 * 12;
    let predictor = |episodes: usize| 2 * (2 * on_input + 3 * (cell + out)) * 2 * (episodes * 5) * N;
    let expected = actor + critic + predictor(4) + predictor(7);
    assert_eq!(team.flop_per_update(4, 6, 7), expected as f64);
}

#[cfg(feature = "candle")]
#[test]
fn candle_comes_to_the_same_weights() {
    for (kind, sharing) in kinds() {
        let learn = |backend| {
            let settings = Settings { backend, ..settings(kind, sharing) };
            // Both kinds of predictor, by turns.
            let settings = if kind == ActorKind::Gru { acting(settings) } else { settings };
            let mut team = team(settings, 2);
            let start = saved(&team);
            for seed in 0..3 {
                team.update(&ended(seed), &[batch(seed + 100).trajectories()]);
            }
            (start, saved(&team))
        };
        let ((start, native), (_, candle)) = (learn(Backend::Native), learn(Backend::Candle));
        let distance =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
        for (name, found) in &native {
            let (error, change) = (distance(found, &candle[name]), distance(found, &start[name]));
            assert!(error <= 1e-3 * change, "{kind}, {sharing}, {name}: {error} of {change}");
            assert!(change > 0.0 || name.starts_with("target"), "{name} moves");
        }
        assert_ne!(native, candle, "rounding tells them apart");
    }
}
