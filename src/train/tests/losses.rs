//! Returns and losses worked by hand.

use super::*;
use crate::train::returns::{returns, standardise};

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
    critic.differentiate(N, &batch);
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
fn returns_worked_by_hand() {
    // Two episodes of three steps, one agent; values of the second one are 10 higher.
    let (rewards, values) = ([1.0, 10.0, 2.0, 20.0, 4.0, 40.0], [1.0, 11.0, 2.0, 12.0, 3.0, 13.0, 8.0, 18.0]);
    let found = |estimator| {
        let mut found = [0.0; 6];
        returns(estimator, 0.5, &rewards, &values, &Ends::truncated(2, 3), 1, &mut found);
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
    returns(Estimator::Steps(1), 0.5, &[1.0, 2.0, 4.0], &values, &Ends::truncated(1, 3), 2, &mut both);
    assert_eq!(both, [2.0, 7.0, 3.5, 8.5, 3.0, 13.0]);
}

#[test]
fn standardised_rewards() {
    let mut rewards = [1.0, 2.0, 3.0, 4.0];
    standardise(&mut rewards, &Ends::truncated(2, 2));
    let deviation = (5.0f64 / 3.0).sqrt() + 1e-5;
    for (found, from_mean) in rewards.iter().zip([-1.5, -0.5, 0.5, 1.5]) {
        assert!((f64::from(*found) - from_mean / deviation).abs() < 1e-7);
    }
    let mut alone = [3.0];
    standardise(&mut alone, &Ends::truncated(1, 1));
    assert_eq!(alone, [0.0]);
}
