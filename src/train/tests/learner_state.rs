//! Teams saved and restored.

use super::*;
use std::ops::Range;

/// Teams with every kind of predictor, one of them carrying gradients.
fn carrying(kind: ActorKind, sharing: Sharing, seed: u64) -> Learner {
    let mut settings = Settings { target_interval: 2, ..settings(kind, sharing) };
    for (name, objective) in [("ablation", Objective::ValueAware { lambda: 0.0 }), ("old", Objective::Maro)] {
        settings.networks.predictors.push(PredictorSpec { hidden: 5, ..PredictorSpec::paper(name) });
        let carry_gradients = objective == Objective::Maro;
        settings
            .predictors
            .push(PredictorSettings { carry_gradients, ..PredictorSettings::paper(objective) });
    }
    Learner::untrained(settings, &dims(), OBSERVATION, &AVAILABLE, seed, 1)
}

#[test]
fn a_restored_team_goes_on_to_the_same_bits() {
    for (kind, sharing) in kinds() {
        let learn = |team: &mut Learner, updates: Range<u64>| {
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
fn a_weight_that_is_no_number_is_noticed() {
    let mut team = team(settings(ActorKind::Gru, Sharing::Separate), 1);
    assert!(team.is_finite());
    *team.critics[2].parameters.values.tensor_mut(5).last_mut().unwrap() = f32::NAN;
    assert!(!team.is_finite());
}
