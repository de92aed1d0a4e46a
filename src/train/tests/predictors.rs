//! What predictors learn from, how, and what they say.

use super::*;

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

/// A predictor that sees what its agent does.
fn acting(objective: Objective) -> LearningPredictor {
    let inputs = vec![Input::Estimate, Input::OwnAction];
    still(PredictorSpec { hidden: 5, inputs, ..PredictorSpec::paper("p") }, objective, false)
}

/// Gives the rows of its first layer's weight that actions are multiplied by the value zero.
fn ignore_actions(predictor: &mut LearningPredictor) {
    let weight = predictor.parameters.values.tensor_mut(0);
    weight[dims().joint * 5..].fill(0.0);
}

#[test]
fn who_ignores_what_agents_do_has_the_loss_of_who_does_not_see_it() {
    let batch = batch(6);
    let advantages = numbers(10, 72);
    for objective in [Objective::Maro, Objective::ValueAware { lambda: 1.0 }] {
        let mut acting = acting(objective);
        ignore_actions(&mut acting);
        let mut blind = still_predictor(objective, vec![], false);
        for at in 1..blind.parameters.specs.len() {
            blind.parameters.values.tensor_mut(at).copy_from_slice(acting.parameters.values.tensor(at));
        }
        let estimate = &acting.parameters.values.tensor(0)[..dims().joint * 5];
        blind.parameters.values.tensor_mut(0).copy_from_slice(estimate);
        let [acting, blind] = [&mut acting, &mut blind].map(|predictor| {
            predictor.learn(&once(), batch.trajectories(), &advantages, &[batch.trajectories()]).unwrap()
        });
        assert!((acting.loss - blind.loss).abs() < 1e-6, "{acting:?}, {blind:?}");
        assert!((acting.nll - blind.nll).abs() < 1e-6, "{acting:?}, {blind:?}");
        assert!(acting.gradient > blind.gradient, "there is something to learn of actions");
    }
}

#[test]
fn the_loss_is_over_what_every_agent_predicts_on_what_it_did() {
    let batch = batch(6);
    let mut predictor = acting(Objective::Maro);
    let found = predictor.learn(&once(), batch.trajectories(), &[], &[batch.trajectories()]).unwrap();

    // The same by the network that agents run, row by row.
    let specs = PredictorSpec { hidden: 5, ..PredictorSpec::paper("p") };
    let specs = PredictorSpec { inputs: vec![Input::Estimate, Input::OwnAction], ..specs };
    let networks = Networks { hidden: 1, predictors: vec![specs], ..Networks::paper(ActorKind::Mlp) };
    let untrained = Policy::untrained(&dims(), 2, networks).unwrap();
    let predictor = untrained.predictor("p").unwrap();
    let (mut sum, mut count, mut out) = (0.0, 0, vec![0.0; 2 * dims().predicted]);
    for episode in 0..batch.episodes {
        for agent in 0..N {
            let (mut state, mut scratch) = (predictor.state(1), Scratch::default());
            for step in 0..batch.steps - 1 {
                let joint = |step: usize| &batch.joint[(step * batch.episodes + episode) * 8..][..8];
                let action = batch.actions[(step * batch.episodes + episode) * N + agent];
                let act = dims().act(agent, action.into());
                predictor.step(1, joint(step), &[act], &mut state, &mut scratch, &mut out);
                for dim in 0..dims().predicted {
                    let (mean, raw) = (f64::from(out[dim]), f64::from(out[dims().predicted + dim]));
                    let z = (f64::from(joint(step + 1)[dim] - joint(step)[dim]) - mean) / raw.exp();
                    sum += z * z / 2.0 + raw + (2.0 * std::f64::consts::PI).sqrt().ln();
                }
                // Each agent's own part by itself.
                count += N;
            }
        }
    }
    assert!((found.loss - sum / count as f64).abs() < 1e-5, "{found:?}, {}", sum / count as f64);
}

#[test]
fn a_predictor_with_senses_learns_from_what_agents_would_have_heard() {
    use Input::{Age, Delivered, Estimate, Innovation, OwnAction, Proximity};
    let mut batch = ended(6);
    let rows = (batch.steps + 1) * batch.episodes * N;
    batch.estimates = numbers(12, rows * dims().joint);
    batch.ages = (0..rows * N).map(|at| if at % 3 == 0 { NOT_ARRIVED } else { (at % 3) as u8 - 1 }).collect();
    for inputs in [
        vec![Estimate, Delivered],
        vec![Estimate, Age],
        vec![Estimate, Innovation],
        vec![Estimate, Proximity],
        vec![Estimate, Delivered, Age, Innovation, Proximity, OwnAction],
    ] {
        let spec = PredictorSpec { hidden: 5, inputs: inputs.clone(), ..PredictorSpec::paper("p") };
        let mut learning = still(spec.clone(), Objective::Maro, false);
        let found = learning.learn_alike(batch.trajectories_as_seen()).unwrap().loss;

        // The same by the predictor that agents run, row by row.
        let networks = Networks { hidden: 1, predictors: vec![spec], ..Networks::paper(ActorKind::Mlp) };
        let untrained = Policy::untrained(&dims(), 2, networks).unwrap();
        let predictor = untrained.predictor("p").unwrap();
        let (mut sum, mut count, mut out) = (0.0, 0, vec![0.0; 2 * dims().predicted]);
        for (episode, agent) in
            (0..batch.episodes).flat_map(|episode| (0..N).map(move |agent| (episode, agent)))
        {
            let (mut state, mut scratch) = (predictor.state(1), Scratch::default());
            for step in 0..batch.ends.lengths()[episode] - 1 {
                let at = step * batch.episodes + episode;
                for sender in 0..N {
                    let age = batch.ages[(at * N + agent) * N + sender];
                    let age = Some(age).filter(|age| *age != NOT_ARRIVED);
                    state.hear(0, sender, if sender == agent { Some(0) } else { age });
                }
                let seen = &batch.estimates[(at * N + agent) * 8..][..8];
                let act = dims().act(agent, batch.actions[at * N + agent].into());
                predictor.step(1, seen, &[act], &mut state, &mut scratch, &mut out);
                let truth = &batch.joint[(at + batch.episodes) * 8..][..8];
                for dim in 0..dims().predicted {
                    let (mean, raw) = (f64::from(out[dim]), f64::from(out[dims().predicted + dim]));
                    let z = (f64::from(truth[dim] - seen[dim]) - mean) / raw.exp();
                    sum += z * z / 2.0 + raw + (2.0 * std::f64::consts::PI).sqrt().ln();
                }
                count += N;
            }
        }
        assert!((found - sum / count as f64).abs() < 1e-5, "{inputs:?}: {found}, {}", sum / count as f64);
        let everything = learning.learn_alike(batch.trajectories()).unwrap().loss;
        assert_ne!(found, everything, "{inputs:?}: what was heard counts");
    }
}
