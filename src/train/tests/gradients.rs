//! Gradients against the losses that they are of.

use super::*;

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
        for (batch, sees_all) in [(batch(3), false), (ended(3), false), (heard(3), true)] {
            let settings = settings(kind, sharing);
            let settings = if sees_all { sensing(settings) } else { settings };
            let advantages = numbers(8, batch.actions.len());
            for mut actor in team(settings.clone(), 1).actors {
                actor.begin(N, &batch);
                actor.differentiate(&settings, &batch, &AVAILABLE, &advantages, true);
                // A step away from the old policy, some ratios are clipped and some are not.
                actor.parameters.step(0.05, 1.0);
                actor.differentiate(&settings, &batch, &AVAILABLE, &advantages, false);
                let (values, gradient) = (actor.parameters.values.clone(), actor.parameters.gradient.clone());
                check_gradient(
                    &format!("{kind}, {sharing}, {:?}", batch.ends),
                    &values,
                    &gradient,
                    |values| {
                        actor.parameters.values = values.clone();
                        actor.differentiate(&settings, &batch, &AVAILABLE, &advantages, false);
                        actor.losses.loss
                    },
                );
            }
        }
    }
}

#[test]
fn the_gradient_of_a_critic_is_that_of_its_loss() {
    use CriticInput::{AllObservations, Joint, OwnObservation, Team};
    for input in [Team, AllObservations, Joint, OwnObservation] {
        for sharing in [Sharing::Separate, Sharing::Shared] {
            let settings = Settings { critic_input: input, ..settings(ActorKind::Mlp, sharing) };
            for batch in [batch(4), ended(4)] {
                for mut critic in team(settings.clone(), 1).critics {
                    critic.begin(&settings, N, &batch, &batch.rewards);
                    critic.differentiate(N, &batch);
                    let (values, gradient) =
                        (critic.parameters.values.clone(), critic.parameters.gradient.clone());
                    check_gradient(
                        &format!("{input:?}, {sharing}, {:?}", batch.ends),
                        &values,
                        &gradient,
                        |values| {
                            critic.parameters.values = values.clone();
                            critic.differentiate(N, &batch);
                            critic.losses.loss
                        },
                    );
                }
            }
        }
    }
}

#[test]
fn the_gradient_of_a_predictor_is_that_of_its_loss() {
    for batch in [batch(5), ended(5)] {
        let advantages = numbers(9, batch.actions.len());
        let (estimate, acting) = (vec![Input::Estimate], vec![Input::Estimate, Input::OwnAction]);
        let (value_aware, exp, soft) =
            (Objective::ValueAware { lambda: 2.0 }, Sigma::Exp, Sigma::SoftBounded);
        for (objective, held, inputs, skip, sigma, loss) in [
            (value_aware, vec![], &estimate, false, exp, Loss::Nll),
            (Objective::ValueAware { lambda: 1.0 }, vec![1, 4], &estimate, false, exp, Loss::Nll),
            (Objective::Maro, vec![], &estimate, true, soft, Loss::Nll),
            (value_aware, vec![3], &acting, false, exp, Loss::Nll),
            (Objective::Maro, vec![], &acting, true, exp, Loss::Nll),
            (Objective::Maro, vec![], &acting, false, soft, Loss::Nll),
            (value_aware, vec![2], &acting, true, exp, Loss::Mse),
        ] {
            let spec = PredictorSpec { hidden: 5, held, inputs: inputs.clone(), ..PredictorSpec::paper("p") };
            let mut predictor = still(PredictorSpec { skip, sigma, ..spec }, objective, false);
            predictor.settings.loss = loss;
            let learn = |predictor: &mut LearningPredictor| {
                let trajectories = batch.trajectories();
                predictor.learn(&once(), trajectories, &advantages, &[trajectories]).unwrap()
            };
            learn(&mut predictor);
            let (values, gradient) =
                (predictor.parameters.values.clone(), predictor.parameters.gradient.clone());
            let what = format!("{objective:?}, {inputs:?}, {skip}, {sigma:?}, {loss:?}, {:?}", batch.ends);
            check_gradient(&what, &values, &gradient, |values| {
                predictor.parameters.values = values.clone();
                learn(&mut predictor).loss
            });
        }
    }
}

#[test]
fn the_gradient_of_a_predictor_in_closed_loop_is_that_of_its_loss() {
    for inputs in [vec![Input::Estimate], vec![Input::Estimate, Input::OwnAction]] {
        for mut batch in [batch(5), ended(5)] {
            let rows = (batch.steps + 1) * batch.episodes * N;
            batch.estimates = numbers(12, rows * dims().joint);
            let spec =
                PredictorSpec { hidden: 5, skip: true, inputs: inputs.clone(), ..PredictorSpec::paper("p") };
            let mut predictor = still(spec, Objective::Maro, false);
            predictor.importance = (0..N * dims().predicted).map(|at| (at % 4) as f32).collect();
            let on_truth = predictor.learn_alike(batch.trajectories()).unwrap().loss;
            let learn = |predictor: &mut LearningPredictor| {
                predictor.learn_alike(batch.trajectories_as_seen()).unwrap().loss
            };
            assert_ne!(learn(&mut predictor), on_truth);
            let Parameters { values, gradient, .. } = predictor.parameters.clone();
            check_gradient(&format!("{inputs:?}, {:?}", batch.ends), &values, &gradient, |values| {
                predictor.parameters.values = values.clone();
                learn(&mut predictor)
            });
        }
    }
}

#[test]
fn the_gradient_through_a_policy_is_that_of_the_divergence() {
    for (kind, sharing) in kinds() {
        let networks = Networks { hidden: 7, predictors: Vec::new(), sharing, ..Networks::paper(kind) };
        let policy = Policy::untrained(&dims(), 5, networks).unwrap();
        // An actor that minds what it sees.
        let weights: Vec<f32> = numbers(5, policy.n_values()).iter().map(|weight| 1.5 * weight).collect();
        let policy = policy.with_values(&weights).unwrap();
        for (inputs, in_closed_loop) in [
            (vec![Input::Estimate], false),
            (vec![Input::Estimate, Input::OwnAction], false),
            (vec![Input::Estimate], true),
        ] {
            let mut batch = ended(5);
            batch.estimates = numbers(12, (batch.steps + 1) * batch.episodes * N * dims().joint);
            let spec =
                PredictorSpec { hidden: 5, skip: true, inputs, held: vec![3], ..PredictorSpec::paper("p") };
            let mut predictor = still(spec, Objective::Maro, false);
            predictor.settings.loss = Loss::Kl;
            predictor.divergence = Some(Divergence::new(&policy, &AVAILABLE));
            let learn = |predictor: &mut LearningPredictor| {
                let seen = if in_closed_loop { batch.trajectories_as_seen() } else { batch.trajectories() };
                predictor.learn_alike(seen).unwrap().loss
            };
            assert!(learn(&mut predictor) > 0.0);
            let Parameters { values, gradient, .. } = predictor.parameters.clone();
            let what = format!("{kind}, {sharing}, {in_closed_loop}, {:?}", predictor.views());
            check_gradient(&what, &values, &gradient, |values| {
                predictor.parameters.values = values.clone();
                learn(&mut predictor)
            });
        }
    }
}
