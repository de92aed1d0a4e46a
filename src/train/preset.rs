//! Where configurations start from.

use super::config::{AdvantageKind, Algorithm, Config, Preset, TrainP};
use super::settings::{Backend, CriticInput, Loss, Objective, PredictorSettings, Settings};
use crate::agent::paper_actor;
use crate::environment::{PhysicsSpec, Spec};
use crate::nn::{ActorKind, Input, PredictorSpec, Sigma};

impl Config {
    /// The defaults for a task.
    pub fn preset(preset: Preset, spec: &Spec, algorithm: Algorithm) -> Config {
        let actor = paper_actor(spec);
        let paper = Settings::paper(actor);
        let predictor = PredictorSettings::paper(Objective::Maro);
        let paper = Config {
            task: spec.id().to_owned(),
            physics: PhysicsSpec::default(),
            seed: 0,
            steps: 5_000_000,
            algorithm,
            actor,
            hidden: paper.networks.hidden,
            actor_inputs: paper.networks.actor_inputs,
            share_actors: false,
            share_critics: false,
            critic_input: match algorithm {
                Algorithm::Mappo => CriticInput::AllObservations,
                Algorithm::Ippo => CriticInput::Joint,
            },
            critic_hidden: 0,
            learning_rate: paper.learning_rate,
            entropy_coefficient: paper.entropy_coefficient,
            gamma: paper.gamma,
            advantage: AdvantageKind::NStep,
            n_steps: 5,
            gae_lambda: 0.95,
            clip: paper.clip,
            epochs: paper.epochs,
            max_grad_norm: paper.largest_gradient,
            standardise_rewards: paper.standardise_rewards,
            target_interval: paper.target_interval,
            batch_episodes: 10,
            update_every: 10,
            train_p: TrainP::Level(1.0),
            train_imputer: String::new(),
            relay: false,
            predictors: vec!["value-aware".to_owned(), "maro".to_owned()],
            predictor_updates: 1,
            predictor_learning_rate: predictor.learning_rate,
            predictor_max_grad_norm: predictor.largest_gradient,
            predictor_hidden: PredictorSpec::paper("any").hidden,
            predictor_inputs: PredictorSpec::paper("any").inputs,
            predictor_skip: false,
            predictor_sigma: Sigma::Exp,
            predictor_loss: Loss::Nll,
            lambda: 1.0,
            replay_episodes: 5_000,
            replay_batch: 32,
            test_interval: 50_000,
            test_episodes: 100,
            backend: Backend::Native,
        };
        match preset {
            Preset::Paper => paper,
            Preset::PublishedCode => Config {
                share_actors: true,
                share_critics: true,
                standardise_rewards: false,
                update_every: 1,
                ..paper
            },
            Preset::Small => Config {
                share_actors: true,
                hidden: 64,
                predictor_hidden: 64,
                // Setting 1 has a third of it: too slow for what one small network has to learn for all.
                learning_rate: 3e-4,
                ..paper
            },
            Preset::Team => Config {
                actor: ActorKind::Mlp,
                hidden: 64,
                actor_inputs: vec![Input::Egocentric],
                share_actors: true,
                critic_input: match algorithm {
                    Algorithm::Mappo => CriticInput::Team,
                    Algorithm::Ippo => CriticInput::Joint,
                },
                critic_hidden: 128,
                learning_rate: 7e-4,
                entropy_coefficient: 0.03,
                gamma: 0.95,
                advantage: AdvantageKind::Gae,
                target_interval: 1,
                batch_episodes: 64,
                update_every: 64,
                predictor_hidden: 32,
                ..paper
            },
        }
    }
}
