//! Predictors for policies that do not change.

use super::*;
use crate::agent::{dims, paper_actor};
use crate::base::error::Error;
use crate::environment::{About, Task};
use crate::nn::TensorSpec;
use crate::supervisor::InProcess;
use crate::train::fit::importance;
use crate::train::{Feed, FitSettings, PredictorFit, fit_predictor};

fn task() -> Task {
    Task::parse("spread-xy-2").unwrap()
}

fn policy() -> Policy {
    let spec = PredictorSpec { hidden: 4, ..PredictorSpec::paper("old") };
    let kind = paper_actor(task().spec());
    let networks = Networks { hidden: 8, predictors: vec![spec], ..Networks::paper(kind) };
    Policy::untrained(&dims(task().spec()), 3, networks).unwrap()
}

fn spec() -> PredictorSpec {
    spec_for(&task())
}

fn spec_for(task: &Task) -> PredictorSpec {
    PredictorSpec { hidden: 8, ..PredictorSpec::acting("fitted", &dims(task.spec())) }
}

fn settings(feed: Feed, loss: Loss) -> FitSettings {
    FitSettings { updates: 60, episodes: 4, learning_rate: 1e-2, feed, loss, ..FitSettings::default() }
}

/// What comes of a fit, and the loss of each update.
fn fitted(settings: &FitSettings) -> (Policy, Vec<f64>) {
    let mut losses = Vec::new();
    let note = |_, found: &PredictorLosses| {
        losses.push(found.loss);
        Ok(())
    };
    let folder = tempfile::tempdir().unwrap();
    let unfinished = folder.path().join("unfinished");
    let policy = fit_predictor(&policy(), &task(), &spec(), settings, &unfinished, note).unwrap();
    (policy, losses)
}

fn bits(policy: &Policy) -> Vec<u32> {
    policy.tensors().flat_map(|(_, tensor)| tensor.values()).map(|value| value.to_bits()).collect()
}

#[test]
fn a_fit_learns_and_changes_nothing_else() {
    for (feed, loss) in
        [Feed::Truth, Feed::ClosedLoop].into_iter().flat_map(|feed| [(feed, Loss::Nll), (feed, Loss::Mse)])
    {
        let (fitted, losses) = fitted(&settings(feed, loss));
        let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
        let (first, last) = (mean(&losses[..10]), mean(&losses[50..]));
        assert!(last < first - 0.2 * first.abs(), "{feed:?}, {loss:?}: from {first} to {last}");
        let (before, after) = (bits(&policy()), bits(&fitted));
        assert_eq!(after[..before.len()], before, "{feed:?}, {loss:?}");
        assert_eq!(fitted.predictor_names().collect::<Vec<_>>(), ["old", "fitted"]);
    }
}

#[test]
fn what_a_fit_comes_to_follows_from_its_seed_and_feed() {
    let closed = settings(Feed::ClosedLoop, Loss::Nll);
    let closed = FitSettings { updates: 5, ..closed };
    assert_eq!(bits(&fitted(&closed).0), bits(&fitted(&closed).0));
    let others =
        [FitSettings { seed: 1, ..closed.clone() }, FitSettings { feed: Feed::Truth, ..closed.clone() }];
    for other in others {
        assert_ne!(bits(&fitted(&closed).0), bits(&fitted(&other).0), "{other:?}");
    }
}

#[test]
fn a_fit_hears_what_its_agents_hear() {
    use Input::{Age, Delivered, Estimate, Innovation, OwnAction};
    let settings = FitSettings { updates: 40, ..settings(Feed::ClosedLoop, Loss::Mse) };
    let inputs = vec![Estimate, Delivered, Age, Innovation, OwnAction];
    let spec = PredictorSpec { inputs, ..spec() };
    let mut losses = Vec::new();
    let note = |_, found: &PredictorLosses| {
        losses.push(found.loss);
        Ok(())
    };
    let folder = tempfile::tempdir().unwrap();
    fit_predictor(&policy(), &task(), &spec, &settings, &folder.path().join("kept"), note).unwrap();
    assert!(losses[39] < 0.5 * losses[0], "{losses:?}");

    let mut fit = PredictorFit::new(&policy(), &task(), &spec, &settings).unwrap();
    let mut agents = InProcess::new(&fit.agents(), &fit.policy().unwrap()).unwrap();
    fit.update(&mut agents).unwrap();
    let (episodes, ages) = (settings.episodes, &fit.batch.ages);
    let (first, later) = ages.split_at(episodes * 4);
    assert!(first.iter().all(|&age| age == 0), "everything is shared at the start");
    let rows = later[..24 * episodes * 4].chunks_exact(4);
    assert!(rows.clone().all(|ages| ages[0] == 0 && ages[3] == 0), "an agent hears itself");
    assert!(rows.clone().any(|ages| ages[1] == NOT_ARRIVED) && rows.clone().any(|ages| ages[1] == 0));
}

#[test]
fn actions_on_the_truth_are_nothing_to_compare_with_where_actors_hear() {
    let networks = sensing(super::settings(ActorKind::Gru, Sharing::Separate)).networks;
    let hears = Policy::untrained(&dims(task().spec()), 3, networks).unwrap();
    let fit = |loss| PredictorFit::new(&hears, &task(), &spec(), &settings(Feed::Truth, loss)).map(drop);
    let error = fit(Loss::Kl).unwrap_err().to_string();
    assert!(error.contains("the loss kl") && error.contains("take mse or nll"), "{error}");
    fit(Loss::Mse).unwrap();
}

#[test]
fn constants_are_found_and_held() {
    // A landmark stays where it is, and what hears of it sees it at a place that moves.
    let task = Task::parse("speaker-listener").unwrap();
    let networks = Networks { hidden: 4, predictors: Vec::new(), ..Networks::paper(ActorKind::Mlp) };
    let policy = Policy::untrained(&dims(task.spec()), 3, networks).unwrap();
    let held = |hold_constants| {
        let settings = FitSettings { hold_constants, updates: 1, episodes: 3, ..FitSettings::default() };
        let folder = tempfile::tempdir().unwrap();
        let kept = folder.path().join("kept");
        let policy =
            fit_predictor(&policy, &task, &spec_for(&task), &settings, &kept, |_, _| Ok(())).unwrap();
        policy.predictor("fitted").unwrap().spec().held.clone()
    };
    assert!(held(false).is_empty());
    let (found, predicted) = (held(true), policy.dims().predicted);
    assert!(!found.is_empty() && found.len() < predicted, "{found:?} of {predicted}");
}

#[test]
fn what_tells_of_an_agent_itself_can_count_for_more() {
    // Each agent observes one axis: its own place and velocity, and those of its teammate.
    let (spec, weights) = (task().spec().clone(), importance(&task(), 7.0));
    let predicted = spec.n_agents() * spec.unique_dim();
    assert_eq!(weights.len(), spec.n_agents() * predicted);
    for (agent, weights) in weights.chunks_exact(predicted).enumerate() {
        for (dim, &weight) in weights.iter().enumerate() {
            let value = &spec.agents[dim / spec.unique_dim()].observation[dim % spec.unique_dim()];
            assert_eq!(weight, if value.about == About::Agent(agent) { 7.0 } else { 1.0 });
        }
        for part in weights.chunks_exact(spec.unique_dim()) {
            assert!(part.contains(&7.0), "agent {agent} is seen by both");
        }
    }
    let fit = |own_weight| {
        let settings = settings(Feed::ClosedLoop, Loss::Mse);
        bits(&fitted(&FitSettings { own_weight, updates: 3, ..settings }).0)
    };
    assert_ne!(fit(1.0), fit(7.0));
}

#[test]
fn a_fit_for_the_policy_itself_brings_its_actions_closer() {
    let settings = FitSettings { updates: 150, ..settings(Feed::Truth, Loss::Kl) };
    let (_, losses) = fitted(&settings);
    let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
    let (first, last) = (mean(&losses[..10]), mean(&losses[120..]));
    assert!(last < 0.8 * first, "from {first} to {last}");
}

#[test]
fn a_fit_that_is_resumed_comes_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fit.safetensors");
    let settings = FitSettings { updates: 7, ..settings(Feed::ClosedLoop, Loss::Nll) };
    let (expected, _) = fitted(&settings);
    let fresh = |settings| PredictorFit::new(&policy(), &task(), &spec(), settings).unwrap();
    let go_on = |fit: &mut PredictorFit, until: u64| {
        let mut agents = InProcess::new(&fit.agents(), &fit.policy().unwrap()).unwrap();
        while fit.updates() < until {
            fit.update(&mut agents).unwrap();
        }
    };
    let mut fit = fresh(&settings);
    go_on(&mut fit, 3);
    fit.save(&path).unwrap();
    let mut fit = fresh(&settings).resume(&path).unwrap();
    assert_eq!(fit.updates(), 3);
    go_on(&mut fit, 7);
    assert_eq!(bits(&fit.policy().unwrap()), bits(&expected));

    // The same, by whoever interrupts it and calls again.
    let interrupted = folder.path().join("interrupted");
    let again = |until| {
        let stop = |updates, _: &PredictorLosses| {
            if updates == until { Err(Error::Interrupted("interrupted".to_owned())) } else { Ok(()) }
        };
        fit_predictor(&policy(), &task(), &spec(), &settings, &interrupted, stop)
    };
    assert!(matches!(again(2), Err(Error::Interrupted(_))) && interrupted.exists());
    assert_eq!(bits(&again(0).unwrap()), bits(&expected));
    assert_eq!(bits(&again(0).unwrap()), bits(&expected), "what is finished stays");

    let other = FitSettings { updates: 8, ..settings.clone() };
    let error = fresh(&other).resume(&path).unwrap_err();
    assert!(matches!(&error, Error::Usage(why) if why.contains("its `settings` is")), "{error}");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 1]).unwrap();
    let error = fresh(&settings).resume(&path).unwrap_err().to_string();
    assert!(error.contains("is damaged"), "{error}");
}

#[test]
fn a_predictor_takes_the_place_of_the_one_of_its_name() {
    let spec = PredictorSpec { name: "old".to_owned(), ..spec() };
    let n: usize = spec.network(policy().dims()).tensors().iter().map(TensorSpec::n_values).sum();
    let values = numbers(1, n);
    let policy = policy().with_predictor(&spec, &values).unwrap();
    assert_eq!(policy.networks().predictors, std::slice::from_ref(&spec));
    let found = &bits(&policy)[policy.predictor_range("old").unwrap()];
    assert!(found.iter().zip(&values).all(|(found, value)| *found == value.to_bits()));
    assert!(policy.with_predictor(&spec, &values[1..]).is_err());
}
