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

/// An epoch's own probabilities are those that the agent acted by, so that every ratio is one.
#[test]
fn actors_that_hear_learn_from_what_their_agents_heard() {
    for (kind, sharing) in kinds() {
        let (settings, mut batch) = (sensing(settings(kind, sharing)), heard(4));
        let mut team = team(settings.clone(), 1);
        let mut values = Vec::new();
        team.policy_values(&mut values);
        let policy = Policy::new(&dims(), Meta::new("toy", 0), settings.networks.clone(), &values).unwrap();
        for agent in 0..N {
            let (actor, mut scratch) = (policy.actor(agent), Scratch::default());
            assert_eq!(actor.n_inputs(), dims().joint);
            let learning = agent.min(team.actors.len() - 1);
            let learning = &mut team.actors[learning];
            learning.begin(N, &batch);
            let network = settings.networks.actor(agent, &dims());
            let rows = batch.episodes * learning.agents.len();
            let x = learning.x.to_vec();
            let mut passes = Passes::new(Backend::Native, &network);
            let learned = passes.forward(&learning.parameters.values, batch.steps, rows, &x);

            let mut state = actor.state(1);
            for episode in 0..batch.episodes {
                state.start(1);
                for step in 0..batch.ends.lengths()[episode] {
                    let at = (step * batch.episodes + episode) * N + agent;
                    for sender in 0..N {
                        let age = Some(batch.ages[at * N + sender]).filter(|age| *age != NOT_ARRIVED);
                        state.hear(0, sender, if sender == agent { Some(0) } else { age });
                    }
                    let (seen, mut logits) =
                        (&batch.estimates[at * dims().joint..][..dims().joint], [0.0; 5]);
                    actor.step(1, seen, &[], &mut state, &mut scratch, &mut logits).unwrap();
                    let row = (step * batch.episodes + episode) * learning.agents.len() + agent
                        - learning.agents.start;
                    assert_eq!(logits, learned[row * 5..][..5], "{kind}, {sharing}, agent {agent}, {step}");
                }
            }
        }
        // Where everything arrives there is nothing to hear of that.
        let learn = |batch: &Batch| {
            let mut team = self::team(settings.clone(), 1);
            team.update(batch, &[]);
            weights(&team)
        };
        let before = learn(&batch);
        batch.ages.fill(0);
        let everything = learn(&batch);
        assert_ne!(before, everything, "{kind}, {sharing}: what arrived counts");
        batch.ages.clear();
        assert_eq!(everything, learn(&batch), "{kind}, {sharing}");
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
