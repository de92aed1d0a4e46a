//! Batches of episodes in which links failed.

use super::*;

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
            let actor = |team: &Learner| bits(&team.actors[agent].parameters);
            assert_eq!(actor(&found), actor(&believed), "{kind}, agent {agent}");
            assert_ne!(actor(&found), actor(&told), "{kind}, agent {agent}");
            let critic = |team: &Learner| bits(&team.critics[agent].parameters);
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
