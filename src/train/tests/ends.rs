//! Batches of episodes that ended early.

use super::*;
use crate::train::returns::{returns, standardise};

/// Every combination of what looks at the end of an episode.
fn all_settings() -> Vec<Settings> {
    use CriticInput::{AllObservations, Joint, OwnObservation, Team};
    let mut all = Vec::new();
    for (kind, sharing) in kinds() {
        all.push(acting(settings(kind, sharing)));
        for critic_input in [Team, AllObservations, Joint, OwnObservation] {
            for estimator in [Estimator::Steps(2), Estimator::Gae(0.9)] {
                all.push(Settings { critic_input, estimator, ..settings(kind, sharing) });
            }
        }
    }
    all
}

/// Two updates: all weights, what the last one says of itself, and its advantages.
fn learn(settings: &Settings, batch: &Batch) -> (Vec<u32>, Losses, Vec<f32>) {
    let mut team = team(settings.clone(), 2);
    team.update(batch, &[batch.trajectories()]);
    let losses = team.update(batch, &[batch.trajectories()]).clone();
    assert!(losses.predictors.iter().all(Option::is_some), "every predictor has something to learn from");
    (weights(&team), losses, team.advantages().to_vec())
}

/// The episodes with what their agents saw.
fn imputed(batch: Batch) -> Batch {
    Batch { estimates: numbers(50, batch.joint.len() * N), ..batch }
}

/// These episodes of a batch as a batch of `steps` steps.
fn cut(batch: &Batch, episodes: &[usize], steps: usize) -> Batch {
    let values = |values: &[f32], observed: usize| {
        let width = values.len() / ((batch.steps + observed) * batch.episodes);
        let rows =
            (0..steps + observed).flat_map(|step| episodes.iter().map(move |e| step * batch.episodes + e));
        rows.flat_map(|row| &values[row * width..][..width]).copied().collect::<Vec<f32>>()
    };
    let mut ends = Ends::truncated(episodes.len(), steps);
    for (at, &episode) in episodes.iter().enumerate() {
        ends.set(at, batch.ends.lengths()[episode], batch.ends.terminated()[episode]);
    }
    let actions: Vec<f32> = batch.actions.iter().map(|&action| action.into()).collect();
    Batch {
        episodes: episodes.len(),
        steps,
        observations: values(&batch.observations, 1),
        joint: values(&batch.joint, 1),
        estimates: values(&batch.estimates, 1),
        ages: Vec::new(),
        actions: values(&actions, 0).iter().map(|&action| action as u8).collect(),
        rewards: values(&batch.rewards, 0),
        ends,
    }
}

/// Writes `with` to all that `values` `[steps, episodes, _]` hold of each episode from step `first[episode]` on.
fn spoil<T: Copy>(values: &mut [T], steps: usize, first: [usize; 4], with: T) {
    let width = values.len() / (steps * first.len());
    for (at, row) in values.chunks_exact_mut(width.max(1)).enumerate() {
        if at / first.len() >= first[at % first.len()] {
            row.fill(with);
        }
    }
}

#[test]
fn what_stands_behind_an_end_changes_no_bit() {
    for settings in all_settings() {
        for clean in [ended(1), imputed(ended(1))] {
            let expected = learn(&settings, &clean);
            for garbage in [1e30, f32::MIN, f32::INFINITY, f32::NAN] {
                let mut batch = clean.clone();
                let lengths = std::array::from_fn(|episode| batch.ends.lengths()[episode]);
                let valued = std::array::from_fn(|episode| batch.ends.valued(episode));
                spoil(&mut batch.observations, 7, valued, garbage);
                spoil(&mut batch.joint, 7, valued, garbage);
                spoil(&mut batch.estimates, 7, valued, garbage);
                spoil(&mut batch.actions, 6, lengths, u8::MAX);
                spoil(&mut batch.rewards, 6, lengths, garbage);
                assert_eq!(learn(&settings, &batch), expected, "{garbage}, {settings:?}");
            }
        }
    }
}

#[test]
fn what_was_played_counts_to_the_last_step() {
    // The counterpart: one more step changed, and there would be a difference.
    let settings = Settings { estimator: Estimator::Gae(0.9), ..settings(ActorKind::Gru, Sharing::Separate) };
    let clean = imputed(ended(1));
    let expected = learn(&settings, &clean);
    let lengths: [usize; 4] = std::array::from_fn(|episode| clean.ends.lengths()[episode]);
    let valued: [usize; 4] = std::array::from_fn(|episode| clean.ends.valued(episode));
    for changed in 0..4 {
        let but = |steps: [usize; 4], all: usize| {
            std::array::from_fn(|episode| if episode == changed { steps[episode] - 1 } else { all })
        };
        let differs = |spoil: &dyn Fn(&mut Batch)| {
            let mut batch = clean.clone();
            spoil(&mut batch);
            assert_ne!(learn(&settings, &batch), expected, "episode {changed}");
        };
        differs(&|batch| spoil(&mut batch.observations, 7, but(valued, 7), 0.5));
        differs(&|batch| spoil(&mut batch.estimates, 7, but(lengths, 7), 0.5));
        differs(&|batch| spoil(&mut batch.rewards, 6, but(lengths, 6), 0.5));
        differs(&|batch| spoil(&mut batch.actions, 6, but(lengths, 6), 2));
    }
}

#[test]
fn episodes_of_one_length_learn_as_if_there_had_never_been_more_steps() {
    for settings in all_settings() {
        for terminated in [false, true] {
            let mut batch = imputed(batch(1));
            (0..4).for_each(|episode| batch.ends.set(episode, 4, terminated));
            let short = learn(&settings, &cut(&batch, &[0, 1, 2, 3], 4));
            let (weights, losses, advantages) = learn(&settings, &batch);
            assert_eq!((&weights, &losses), (&short.0, &short.1), "{settings:?}");
            assert_eq!(advantages[..4 * 4 * N], short.2[..]);
            assert!(advantages[4 * 4 * N..].iter().all(|&advantage| advantage == 0.0));
        }
    }
}

/// A gradient times what its mean is over.
type Sum = Vec<f64>;

fn sum(gradient: &Flat, entries: usize) -> Sum {
    gradient.all().iter().map(|&g| f64::from(g) * entries as f64).collect()
}

/// Gradients of means add up as the episodes do: those of each episode alone, which is then as long as its batch,
/// to that of all.
fn check_sum(what: &str, batch: &Batch, mut gradient: impl FnMut(&Batch, &[usize]) -> Sum) {
    let all = gradient(batch, &[0, 1, 2, 3]);
    let alone: Vec<Sum> = (0..4)
        .map(|episode| gradient(&cut(batch, &[episode], batch.ends.lengths()[episode]), &[episode]))
        .collect();
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>().sqrt();
    let size = norm(&mut all.iter().copied());
    let added = |at: usize| alone.iter().map(|sum| sum[at]).sum::<f64>();
    let error = norm(&mut all.iter().enumerate().map(|(at, all)| all - added(at)));
    assert!(size > 0.0 && error < 1e-5 * size, "{what}: {error} of {size}");
}

#[test]
fn the_gradient_of_a_batch_is_that_of_its_episodes_each_alone() {
    let batch = imputed(ended(3));
    let advantages = numbers(8, batch.actions.len());
    // `[T, E, agents]`, as far as the episode goes.
    let own = |batch: &Batch, episodes: &[usize]| -> Vec<f32> {
        let rows = (0..batch.steps).flat_map(|step| episodes.iter().map(move |episode| step * 4 + episode));
        rows.flat_map(|row| &advantages[row * N..][..N]).copied().collect()
    };
    for settings in all_settings() {
        let team = team(settings.clone(), 1);
        for mut actor in team.actors {
            // Away from the old policy, so that some ratios are clipped.
            let (old, mut new) = (actor.parameters.values.clone(), actor.parameters.values.clone());
            let moves = numbers(12, new.all().len());
            new.all_mut().iter_mut().zip(moves).for_each(|(value, by)| *value += 0.1 * by);
            check_sum(&format!("{settings:?}"), &batch, |batch, episodes| {
                let advantages = own(batch, episodes);
                actor.begin(N, batch);
                for (values, first) in [(&old, true), (&new, false)] {
                    actor.parameters.values = values.clone();
                    actor.differentiate(&settings, batch, &AVAILABLE, &advantages, first);
                }
                sum(&actor.parameters.gradient, batch.entries(N))
            });
        }
        for mut critic in team.critics {
            check_sum(&format!("{settings:?}"), &batch, |batch, _| {
                critic.begin(&settings, N, batch, &batch.rewards);
                critic.differentiate(N, batch);
                sum(&critic.parameters.gradient, batch.entries(N))
            });
        }
    }
    let estimate = PredictorSpec { hidden: 5, held: vec![2], ..PredictorSpec::paper("p") };
    let own_action = PredictorSpec { inputs: vec![Input::Estimate, Input::OwnAction], ..estimate.clone() };
    let objectives = [Objective::Maro, Objective::ValueAware { lambda: 0.0 }];
    for (spec, objective) in
        [&estimate, &own_action].into_iter().flat_map(|spec| objectives.map(|o| (spec, o)))
    {
        let mut predictor = still(spec.clone(), objective, false);
        check_sum(&format!("{objective:?}, {:?}", spec.inputs), &batch, |batch, episodes| {
            let trajectories = batch.trajectories();
            let transitions = (0..batch.episodes).map(|row| trajectories.transitions(row)).sum();
            let found = predictor.learn(&once(), trajectories, &own(batch, episodes), &[trajectories]);
            assert_eq!(found.is_some(), transitions > 0);
            sum(&predictor.parameters.gradient, transitions)
        });
    }
}

#[test]
fn returns_of_episodes_that_end_early_worked_by_hand() {
    // Three episodes of three steps, one agent: terminated after two, truncated after two, terminated after three.
    let mut ends = Ends::truncated(3, 3);
    ends.set(0, 2, true);
    ends.set(1, 2, false);
    ends.set(2, 3, true);
    let nan = f32::NAN;
    let rewards = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, nan, nan, 4.0];
    let values = [3.0, 3.0, 3.0, 5.0, 5.0, 5.0, nan, 8.0, 6.0, nan, nan, nan];
    let found = |estimator| {
        let mut found = [-1.0; 9];
        returns(estimator, 0.5, &rewards, &values, &ends, 1, &mut found);
        found
    };
    // Terminated: r0 + g V1, r1. Truncated: r0 + g V1, V1. Terminated: r0 + g V1, r1 + g V2, r2.
    assert_eq!(found(Estimator::Steps(1)), [3.5, 3.5, 3.5, 2.0, 5.0, 5.0, -1.0, -1.0, 4.0]);
    // Terminated: r0 + g r1. Truncated: r0 + g V1. Terminated: r0 + g r1 + g^2 V2, r1 + g r2.
    assert_eq!(found(Estimator::Steps(2)), [2.0, 3.5, 3.5, 2.0, 5.0, 4.0, -1.0, -1.0, 4.0]);
    // With windows longer than an episode all that was earned: r0 + g r1 + g^2 r2.
    assert_eq!(found(Estimator::Steps(9)), [2.0, 3.5, 3.0, 2.0, 5.0, 4.0, -1.0, -1.0, 4.0]);
    // One reward and the next value: nothing where the world ended, V2 where the episode was cut off.
    assert_eq!(found(Estimator::Gae(0.0)), [3.5, 3.5, 3.5, 2.0, 6.0, 5.0, -1.0, -1.0, 4.0]);
    // All rewards, and what is left: r0 + g r1 + g^2 V2 of the truncated one.
    assert_eq!(found(Estimator::Gae(1.0)), [2.0, 4.0, 3.0, 2.0, 6.0, 4.0, -1.0, -1.0, 4.0]);
}

#[test]
fn rewards_behind_an_end_are_no_part_of_the_standard() {
    let mut ends = Ends::truncated(2, 3);
    ends.set(1, 1, false);
    let (mut rewards, mut played) = ([1.0, 2.0, 3.0, 1e30, 4.0, f32::NAN], [1.0, 2.0, 3.0, 4.0]);
    standardise(&mut rewards, &ends);
    standardise(&mut played, &Ends::truncated(1, 4));
    assert_eq!([rewards[0], rewards[1], rewards[2], rewards[4]], played);
}

#[test]
fn predictors_have_nothing_to_learn_from_episodes_of_one_step() {
    let mut batch = batch(1);
    (0..4).for_each(|episode| batch.ends.set(episode, 1, true));
    for batch in [cut(&batch, &[0, 1, 2, 3], 1), batch] {
        for objective in [Objective::Maro, Objective::ValueAware { lambda: 1.0 }] {
            let mut predictor = still_predictor(objective, vec![], false);
            let advantages = numbers(1, batch.actions.len());
            assert_eq!(
                predictor.learn(&once(), batch.trajectories(), &advantages, &[batch.trajectories()]),
                None
            );
        }
    }
}
