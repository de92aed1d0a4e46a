//! Updates against their definitions. That they are the paper's, `tests/verify.rs` shows on recorded ones.

use super::batch::gather;
use super::memory::{Buffer, Flat};
use super::network::Network;
use super::returns::{returns, standardise};
use super::*;
use crate::nn::{ActorKind, Dims, Meta, Networks, Policy, PredictorSpec, Scratch, Sharing};
use crate::rng::{Draws, Purpose};
use std::collections::HashMap;
use std::ops::Range;
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
    Dims { task: "toy".to_string(), n_agents: N, joint: 8, predicted: 6, n_actions: 5 }
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
        actions: (0..rows * N).map(|at| (at * 7 % AVAILABLE[at % N]) as u8).collect(),
        rewards: numbers(seed + 2, rows),
    }
}

fn settings(actor: ActorKind, sharing: Sharing) -> Settings {
    let predictor = |name| PredictorSpec { hidden: 5, ..PredictorSpec::paper(name) };
    let networks = Networks {
        actor,
        sharing,
        hidden: 12,
        predictors: vec![predictor("value-aware"), predictor("maro")],
    };
    let objectives = [Objective::ValueAware { lambda: 1.0 }, Objective::Maro];
    Settings {
        networks,
        critic_sharing: sharing,
        predictors: objectives.map(PredictorSettings::paper).to_vec(),
        entropy_coefficient: 0.5,
        ..Settings::paper(actor)
    }
}

fn team(settings: Settings, threads: usize) -> Team {
    Team::untrained(settings, &dims(), OBSERVATION, &AVAILABLE, 5, threads)
}

fn kinds() -> impl Iterator<Item = (ActorKind, Sharing)> {
    let kinds = [ActorKind::Mlp, ActorKind::Gru].into_iter();
    kinds.flat_map(|kind| [(kind, Sharing::Separate), (kind, Sharing::Shared)])
}

fn weights(team: &Team) -> Vec<u32> {
    team.networks().flat_map(|network| network.values.all()).map(|value| value.to_bits()).collect()
}

#[test]
fn any_number_of_threads_comes_to_the_same_bits() {
    for (kind, sharing) in kinds() {
        let learn = |threads| {
            let mut team = team(settings(kind, sharing), threads);
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
            let mut network = Network::new(Backend::Native, kind.into(), &[]);
            let learned = network.forward(weights, batch.steps + 1, batch.episodes, &x);

            let (actor, mut scratch) = (policy.actor(agent), Scratch::default());
            let mut hidden = vec![0.0; batch.episodes * actor.state_len()];
            let mut logits = vec![0.0; batch.episodes * dims().n_actions];
            let steps = batch.joint.chunks_exact(batch.episodes * dims().joint);
            for (inputs, learned) in steps.zip(learned.chunks_exact(logits.len())) {
                actor.forward(batch.episodes, inputs, &mut hidden, &mut scratch, &mut logits);
                let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&logits), bits(learned), "{kind}, {sharing}, agent {agent}");
            }
        }
    }
}

/// Moves weights along their gradient and back: the loss must change by the square of the gradient's norm.
fn check_gradient(what: &str, values: &Flat, gradient: &Flat, mut loss: impl FnMut(&Flat) -> f64) {
    let squared: f64 = gradient.all().iter().map(|&g| f64::from(g).powi(2)).sum();
    // Short, because a ReLU or a clipped ratio bends the loss.
    let distance = 2e-4 / squared.sqrt();
    let mut at = |sign: f64| {
        let mut moved = values.clone();
        let pairs = moved.all_mut().iter_mut().zip(gradient.all());
        pairs.for_each(|(value, g)| *value += (sign * distance) as f32 * g);
        loss(&moved)
    };
    let slope = (at(1.0) - at(-1.0)) / (2.0 * distance);
    assert!((slope / squared - 1.0).abs() < 1e-2, "{what}: the loss changes by {slope}, not {squared}");
}

#[test]
fn the_gradient_of_an_actor_is_that_of_its_loss() {
    for (kind, sharing) in kinds() {
        let (settings, batch) = (settings(kind, sharing), batch(3));
        let advantages = numbers(8, batch.actions.len());
        for mut actor in team(settings.clone(), 1).actors {
            actor.begin(N, &batch);
            actor.differentiate(&settings, &batch, &AVAILABLE, &advantages, true);
            // A step away from the old policy, some ratios are clipped and some are not.
            actor.parameters.step(0.05, 1.0);
            actor.differentiate(&settings, &batch, &AVAILABLE, &advantages, false);
            let (values, gradient) = (actor.parameters.values.clone(), actor.parameters.gradient.clone());
            check_gradient(&format!("{kind}, {sharing}"), &values, &gradient, |values| {
                actor.parameters.values = values.clone();
                actor.differentiate(&settings, &batch, &AVAILABLE, &advantages, false);
                actor.losses.loss
            });
        }
    }
}

#[test]
fn the_gradient_of_a_critic_is_that_of_its_loss() {
    for input in [CriticInput::AllObservations, CriticInput::Joint, CriticInput::OwnObservation] {
        for sharing in [Sharing::Separate, Sharing::Shared] {
            let settings = Settings { critic_input: input, ..settings(ActorKind::Mlp, sharing) };
            let batch = batch(4);
            for mut critic in team(settings.clone(), 1).critics {
                critic.begin(&settings, N, &batch, &batch.rewards);
                critic.differentiate(batch.actions.len());
                let (values, gradient) =
                    (critic.parameters.values.clone(), critic.parameters.gradient.clone());
                check_gradient(&format!("{input:?}, {sharing}"), &values, &gradient, |values| {
                    critic.parameters.values = values.clone();
                    critic.differentiate(batch.actions.len());
                    critic.losses.loss
                });
            }
        }
    }
}

/// One step of a predictor in an update.
fn once() -> Settings {
    settings(ActorKind::Mlp, Sharing::Separate)
}

/// A predictor for `objective` that does not move.
fn still_predictor(objective: Objective, held: Vec<usize>, carry_gradients: bool) -> Predictor {
    let spec = PredictorSpec { hidden: 5, held, ..PredictorSpec::paper("p") };
    let settings =
        PredictorSettings { objective, learning_rate: 0.0, largest_gradient: 0.1, carry_gradients };
    Predictor::new(&spec, &settings, &dims(), Backend::Native, 2)
}

#[test]
fn the_gradient_of_a_predictor_is_that_of_its_loss() {
    let batch = batch(5);
    let advantages = numbers(9, batch.actions.len());
    for (objective, held) in [
        (Objective::ValueAware { lambda: 2.0 }, vec![]),
        (Objective::ValueAware { lambda: 1.0 }, vec![1, 4]),
        (Objective::Maro, vec![]),
    ] {
        let mut predictor = still_predictor(objective, held, false);
        let learn = |predictor: &mut Predictor| {
            predictor.learn(&once(), batch.trajectories(), &advantages, &[batch.trajectories()]).unwrap()
        };
        learn(&mut predictor);
        let (values, gradient) = (predictor.parameters.values.clone(), predictor.parameters.gradient.clone());
        check_gradient(&format!("{objective:?}"), &values, &gradient, |values| {
            predictor.parameters.values = values.clone();
            learn(&mut predictor).loss
        });
    }
}

#[test]
fn what_predictors_learn_from() {
    let (batch, replay) = (batch(6), batch(7));
    let advantages = numbers(10, batch.actions.len());
    let learn = |objective, advantages: &[f32], replays: &[Trajectories]| {
        still_predictor(objective, vec![], false).learn(&once(), batch.trajectories(), advantages, replays)
    };
    let ablation = Objective::ValueAware { lambda: 0.0 };
    let alike = learn(ablation, &advantages, &[]);
    assert_eq!(learn(Objective::Maro, &advantages, &[batch.trajectories()]), alike);
    assert_ne!(learn(Objective::Maro, &advantages, &[replay.trajectories()]), alike);
    assert_ne!(learn(Objective::ValueAware { lambda: 1.0 }, &advantages, &[]), alike);
    assert_eq!(learn(Objective::Maro, &advantages, &[]), None, "nothing is stored yet");
    let hopeless = vec![-2.0; advantages.len()];
    assert_eq!(learn(Objective::ValueAware { lambda: 1.0 }, &hopeless, &[]), None, "no step counts");
}

#[test]
fn several_steps_of_a_predictor_are_steps_in_a_row() {
    let replays = [batch(20), batch(21), batch(22)];
    let replays = replays.each_ref().map(Batch::trajectories);
    let (batch, thrice) = (batch(6), Settings { predictor_updates: 3, ..once() });
    let advantages = numbers(10, batch.actions.len());
    for objective in [Objective::Maro, Objective::ValueAware { lambda: 1.0 }] {
        let mut moving = still_predictor(objective, vec![], true);
        moving.settings.learning_rate = 1e-2;
        let mut one_by_one = moving.clone();
        let loss = moving.learn(&thrice, batch.trajectories(), &advantages, &replays).unwrap().loss;
        let mut losses = replays.map(|replay| {
            one_by_one.learn(&once(), batch.trajectories(), &advantages, &[replay]).unwrap().loss
        });
        assert_eq!(moving.parameters.values.all(), one_by_one.parameters.values.all(), "{objective:?}");
        assert_eq!(loss, losses.iter().sum::<f64>() / 3.0, "{objective:?}");
        losses.sort_by(f64::total_cmp);
        assert!(losses[0] < losses[2], "{objective:?} moves");
    }
}

#[test]
fn carried_gradients_are_clipped_and_added() {
    let batch = batch(11);
    let mut predictor = still_predictor(Objective::ValueAware { lambda: 0.0 }, vec![], true);
    let mut gradient = || {
        predictor.learn(&once(), batch.trajectories(), &[0.0; 72], &[]).unwrap();
        predictor.parameters.gradient.all().to_vec()
    };
    let (first, second) = (gradient(), gradient());
    let norm = first.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
    assert!(norm > 0.1, "there is something to clip: {norm}");
    for (first, second) in first.iter().zip(&second) {
        let expected = f64::from(*first) * (1.0 + 0.1 / norm);
        assert!((f64::from(*second) - expected).abs() < 1e-5, "{second}, not {expected}");
    }
}

/// What each agent sees if everybody sees `joint` `[rows, joint]`.
fn seen_by_all(joint: &[f32]) -> Vec<f32> {
    joint.chunks_exact(dims().joint).flat_map(|row| [row; N]).flatten().copied().collect()
}

#[test]
fn estimates_equal_to_the_truth_change_nothing() {
    for (kind, sharing) in kinds() {
        for critic_input in [CriticInput::AllObservations, CriticInput::Joint] {
            let learn = |imputed: bool| {
                let mut team = team(Settings { critic_input, ..settings(kind, sharing) }, 1);
                for seed in 0..2 {
                    let mut batch = batch(seed);
                    if imputed {
                        batch.estimates = seen_by_all(&batch.joint);
                    }
                    team.update(&batch, &[]);
                }
                (weights(&team), team.advantages().to_vec())
            };
            assert_eq!(learn(true), learn(false), "{kind}, {sharing}, {critic_input:?}");
        }
    }
}

#[test]
fn estimates_reach_actors_and_their_like_and_nothing_else() {
    let bits = |parameters: &Parameters| -> Vec<u32> {
        parameters.values.all().iter().map(|value| value.to_bits()).collect()
    };
    for (kind, critic_input) in
        [(ActorKind::Mlp, CriticInput::AllObservations), (ActorKind::Gru, CriticInput::Joint)]
    {
        let learn = |batch: &Batch| {
            // Nothing is clipped: a norm would tell an agent of the others.
            let settings = settings(kind, Sharing::Separate);
            let mut team = team(Settings { critic_input, largest_gradient: 1e9, ..settings }, 1);
            team.update(batch, &[]);
            team
        };
        let truth = batch(1);
        let mut imputed = truth.clone();
        imputed.estimates = numbers(50, truth.joint.len() * N);
        let found = learn(&imputed);
        for agent in 0..N {
            // A world in which the truth is what this agent believes.
            let own = imputed.estimates.chunks_exact(dims().joint).skip(agent).step_by(N);
            let believed = Batch { joint: own.flatten().copied().collect(), ..truth.clone() };
            let (believed, told) = (learn(&believed), learn(&truth));
            let actor = |team: &Team| bits(&team.actors[agent].parameters);
            assert_eq!(actor(&found), actor(&believed), "{kind}, agent {agent}");
            assert_ne!(actor(&found), actor(&told), "{kind}, agent {agent}");
            let critic = |team: &Team| bits(&team.critics[agent].parameters);
            let like = if critic_input == CriticInput::Joint { &believed } else { &told };
            assert_eq!(critic(&found), critic(like), "{kind}, agent {agent}");
        }
    }
}

#[test]
fn predictors_learn_from_the_truth() {
    let truth = batch(1);
    let imputed = Batch { estimates: numbers(50, truth.joint.len() * N), ..truth.clone() };
    let learn = |batch: &Batch| {
        let mut team = team(settings(ActorKind::Mlp, Sharing::Separate), 1);
        team.update(batch, &[batch.trajectories()]);
        team.predictors.iter().map(|p| p.parameters.values.all().to_vec()).collect::<Vec<_>>()
    };
    assert_eq!(learn(&imputed), learn(&truth));
}

#[test]
fn what_actors_and_critics_say_worked_by_hand() {
    let settings =
        Settings { entropy_coefficient: 0.5, clip: 0.2, ..settings(ActorKind::Mlp, Sharing::Shared) };
    let mut team = team(settings.clone(), 1);
    let batch = Batch { actions: vec![0; 72], ..batch(1) };
    let advantages = vec![1.0; 72];
    // Only a bias speaks: the first action has the probability `first`, the other four share the rest.
    let actor = &mut team.actors[0];
    actor.parameters.values.all_mut().fill(0.0);
    let mut speak = |first: f64, is_first: bool| {
        actor.parameters.values.tensor_mut(5)[0] = (4.0 * first / (1.0 - first)).ln() as f32;
        actor.begin(N, &batch);
        actor.differentiate(&settings, &batch, &[5; N], &advantages, is_first);
        actor.losses
    };
    let entropy = |first: f64| -first * first.ln() - (1.0 - first) * ((1.0 - first) / 4.0).ln();
    let close =
        |found: f64, expected: f64| assert!((found - expected).abs() < 1e-5, "{found}, not {expected}");
    let before = speak(0.5, true);
    close(before.policy, -1.0);
    close(before.entropy, entropy(0.5));
    close(before.loss, -1.0 - 0.5 * entropy(0.5));
    close(before.pi_max, 0.5);
    assert_eq!((before.clip_fraction, before.approx_kl), (0.0, 0.0));
    let after = speak(0.75, false);
    close(after.policy, -1.2);
    close(after.entropy, entropy(0.75));
    close(after.pi_max, 0.75);
    close(after.clip_fraction, 1.0);
    close(after.approx_kl, 0.5 - 1.5f64.ln());

    let critic = &mut team.critics[0];
    critic.begin(&settings, N, &batch, &batch.rewards);
    critic.differentiate(72);
    let mean =
        |of: &dyn Fn(f64) -> f64| critic.advantages.iter().map(|&a| of(f64::from(a))).sum::<f64>() / 72.0;
    let losses = critic.losses;
    close(losses.loss, mean(&|a| a * a));
    close(losses.td_error_abs, mean(&f64::abs));
    close(losses.advantage, mean(&|a| a));
    close(losses.target - losses.value, losses.advantage);
    assert!(losses.td_error_abs > losses.advantage.abs() && losses.value != 0.0);
}

#[test]
fn what_predictors_say() {
    let batch = batch(6);
    let learn = |lambda, advantages: &[f32]| {
        let mut predictor = still_predictor(Objective::ValueAware { lambda }, vec![], false);
        let losses = predictor.learn(&once(), batch.trajectories(), advantages, &[]).unwrap();
        let norm = predictor.parameters.squared_norm().sqrt();
        assert_eq!(losses.gradient, norm);
        losses
    };
    let advantages = numbers(10, 72);
    let (alike, weighted) = (learn(0.0, &advantages), learn(1.0, &advantages));
    assert!((alike.loss - alike.nll).abs() < 1e-9);
    assert_eq!(weighted.nll, alike.nll);
    assert_ne!(weighted.loss, weighted.nll);
    // The likelihood is that of the agents' own parts: with weights for one agent alone, it is that part's.
    let only = |agent: usize| (0..72).map(|at| if at % N == agent { 0.0 } else { -1.0 }).collect::<Vec<_>>();
    let parts: f64 = (0..N).map(|agent| learn(1.0, &only(agent)).loss).sum();
    assert!((parts / N as f64 - alike.nll).abs() < 1e-6);
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

/// Teams with every kind of predictor, one of them carrying gradients.
fn carrying(kind: ActorKind, sharing: Sharing, seed: u64) -> Team {
    let mut settings = Settings { target_interval: 2, ..settings(kind, sharing) };
    for (name, objective) in [("ablation", Objective::ValueAware { lambda: 0.0 }), ("old", Objective::Maro)] {
        settings.networks.predictors.push(PredictorSpec { hidden: 5, ..PredictorSpec::paper(name) });
        let carry_gradients = objective == Objective::Maro;
        settings
            .predictors
            .push(PredictorSettings { carry_gradients, ..PredictorSettings::paper(objective) });
    }
    Team::untrained(settings, &dims(), OBSERVATION, &AVAILABLE, seed, 1)
}

/// A team's state by name.
fn saved(team: &Team) -> HashMap<String, Vec<f32>> {
    team.state().into_iter().map(|(name, _, values)| (name, values.to_vec())).collect()
}

#[test]
fn a_restored_team_goes_on_to_the_same_bits() {
    for (kind, sharing) in kinds() {
        let learn = |team: &mut Team, updates: Range<u64>| {
            for at in updates {
                team.update(&batch(at), &[batch(at + 100).trajectories()]);
            }
        };
        let mut team = carrying(kind, sharing, 1);
        learn(&mut team, 0..3);
        let (state, counters) = (saved(&team), team.counters());
        assert!(state["carried.predictors.old.fc1.weight"].iter().any(|&carried| carried != 0.0));
        assert!(
            team.state().iter().all(|(_, shape, values)| shape.iter().product::<usize>() == values.len())
        );

        let mut other = carrying(kind, sharing, 2);
        learn(&mut other, 7..8);
        other.restore(|name| state.get(name), &counters).unwrap();
        assert_eq!((saved(&other), other.counters()), (state, counters));
        learn(&mut team, 3..6);
        learn(&mut other, 3..6);
        assert_eq!(saved(&other), saved(&team), "{kind}, {sharing}");
        assert_eq!(other.counters(), team.counters());
        assert_eq!(other.update(&batch(6), &[]), team.update(&batch(6), &[]), "{kind}, {sharing}");
    }
}

#[test]
fn a_state_that_does_not_fit_is_refused_and_changes_nothing() {
    let team = carrying(ActorKind::Mlp, Sharing::Separate, 1);
    let (state, counters) = (saved(&team), team.counters());
    let refused = |state: &HashMap<String, Vec<f32>>, counters: &Counters| {
        let mut other = carrying(ActorKind::Mlp, Sharing::Separate, 2);
        let before = saved(&other);
        let said = other.restore(|name| state.get(name), counters).unwrap_err();
        assert_eq!(saved(&other), before, "{said}");
        said
    };
    for name in state.keys() {
        let mut without = state.clone();
        let mut values = without.remove(name).unwrap();
        assert_eq!(refused(&without, &counters), format!("there is no tensor {name}"));
        values.push(0.0);
        without.insert(name.clone(), values);
        assert!(refused(&without, &counters).starts_with(&format!("tensor {name} has ")));
    }
    let mut others = counters.clone();
    others.adam.remove("critics.2").unwrap();
    assert_eq!(refused(&state, &others), "there is no number of Adam steps for critics.2");
    others = counters;
    others.adam.insert("critics.shared".to_owned(), 1);
    assert!(refused(&state, &others).contains("critics.shared"));
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
}

#[test]
fn candle_comes_to_the_same_weights() {
    for (kind, sharing) in kinds() {
        let learn = |backend| {
            let mut team = team(Settings { backend, ..settings(kind, sharing) }, 2);
            let start = saved(&team);
            for seed in 0..3 {
                team.update(&batch(seed), &[batch(seed + 100).trajectories()]);
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

#[test]
fn a_weight_that_is_no_number_is_noticed() {
    let mut team = team(settings(ActorKind::Gru, Sharing::Separate), 1);
    assert!(team.is_finite());
    *team.critics[2].parameters.values.tensor_mut(5).last_mut().unwrap() = f32::NAN;
    assert!(!team.is_finite());
}

#[test]
fn returns_worked_by_hand() {
    // Two episodes of three steps, one agent; values of the second one are 10 higher.
    let (rewards, values) = ([1.0, 10.0, 2.0, 20.0, 4.0, 40.0], [1.0, 11.0, 2.0, 12.0, 3.0, 13.0, 8.0, 18.0]);
    let found = |estimator| {
        let mut found = [0.0; 6];
        returns(estimator, 0.5, &rewards, &values, 1, &mut found);
        found
    };
    // r0 + g V1, r1 + g V2, and the last step's own value.
    assert_eq!(found(Estimator::Steps(1)), [2.0, 16.0, 3.5, 26.5, 3.0, 13.0]);
    // r0 + g r1 + g^2 V2, r1 + g V2, V2.
    assert_eq!(found(Estimator::Steps(2)), [2.75, 23.25, 3.5, 26.5, 3.0, 13.0]);
    assert_eq!(found(Estimator::Steps(2)), found(Estimator::Steps(5)));
    // With lambda 0 one reward and the next value; with 1 all rewards and the last value.
    assert_eq!(found(Estimator::Gae(0.0)), [2.0, 16.0, 3.5, 26.5, 8.0, 49.0]);
    assert_eq!(found(Estimator::Gae(1.0)), [4.0, 32.25, 6.0, 44.5, 8.0, 49.0]);
    // Two agents of one episode share its rewards.
    let mut both = [0.0; 6];
    returns(Estimator::Steps(1), 0.5, &[1.0, 2.0, 4.0], &values, 2, &mut both);
    assert_eq!(both, [2.0, 7.0, 3.5, 8.5, 3.0, 13.0]);
}

#[test]
fn standardised_rewards() {
    let mut rewards = [1.0, 2.0, 3.0, 4.0];
    standardise(&mut rewards);
    let deviation = (5.0f64 / 3.0).sqrt() + 1e-5;
    for (found, from_mean) in rewards.iter().zip([-1.5, -0.5, 0.5, 1.5]) {
        assert!((f64::from(*found) - from_mean / deviation).abs() < 1e-7);
    }
    let mut alone = [3.0];
    standardise(&mut alone);
    assert_eq!(alone, [0.0]);
}
