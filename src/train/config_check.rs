//! What of a configuration makes no sense, though every setting has a value of its type.

use super::config::{Algorithm, Config, TrainP, objective};
use super::settings::{CriticInput, Loss};
use crate::base::error::Result;
use crate::nn::MAX_HIDDEN;
use crate::usage;

/// Beyond this a test would take longer than training, by mistake.
const MOST_TEST_EPISODES: u64 = 1_000_000;

/// What can impute in training and needs nothing of a policy.
const WITHOUT_A_POLICY: [&str; 3] = ["zero", "hold", "velocity"];

impl Config {
    /// Says what makes no sense.
    pub(super) fn check(&self) -> Result<()> {
        // Beyond these a run would fill the memory, or not end, by mistake.
        let whole = [
            ("n_steps", self.n_steps as u64, u64::MAX),
            ("epochs", self.epochs as u64, 1000),
            ("target_interval", self.target_interval, u64::MAX),
            ("batch_episodes", self.batch_episodes as u64, 4096),
            ("update_every", self.update_every as u64, 4096),
            ("predictor_updates", self.predictor_updates as u64, 1000),
            ("replay_episodes", self.replay_episodes as u64, 1_000_000),
            ("replay_batch", self.replay_batch as u64, 4096),
            ("test_interval", self.test_interval, u64::MAX),
            ("steps", self.steps, 1 << 50),
        ];
        if let Some((key, value, most)) = whole.iter().find(|(_, value, most)| !(1..=*most).contains(value)) {
            return Err(match most {
                &u64::MAX => usage!("`{key}` is {value}, expected 1 or more"),
                most => usage!("`{key}` is {value}, expected 1 to {most}"),
            });
        }
        if self.critic_hidden > MAX_HIDDEN {
            let size = self.critic_hidden;
            return Err(usage!(
                "`critic_hidden` is {size}, expected 0, for that of the actors, to {MAX_HIDDEN}"
            ));
        }
        if self.test_episodes > MOST_TEST_EPISODES {
            return Err(usage!(
                "`test_episodes` is {}, expected 0 to {MOST_TEST_EPISODES}",
                self.test_episodes
            ));
        }
        let positive = [
            ("learning_rate", self.learning_rate),
            ("clip", self.clip),
            ("max_grad_norm", self.max_grad_norm),
            ("predictor_learning_rate", self.predictor_learning_rate),
            ("predictor_max_grad_norm", self.predictor_max_grad_norm),
        ];
        if let Some((key, value)) = positive.iter().find(|(_, value)| !(*value > 0.0 && value.is_finite())) {
            return Err(usage!("`{key}` is {value}, expected a number above 0"));
        }
        let shares = [("gamma", self.gamma), ("gae_lambda", self.gae_lambda)];
        if let Some((key, value)) = shares.iter().find(|(_, value)| !(0.0..=1.0).contains(value)) {
            return Err(usage!("`{key}` is {value}, expected 0 to 1"));
        }
        for (key, value) in [("entropy_coefficient", self.entropy_coefficient), ("lambda", self.lambda)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(usage!("`{key}` is {value}, expected 0 or more"));
            }
        }
        if self.predictor_loss == Loss::Kl {
            return Err(usage!(
                "`predictor_loss` is kl, which is for policies that do not change any more; expected nll or mse"
            ));
        }
        if self.algorithm == Algorithm::Ippo
            && matches!(self.critic_input, CriticInput::AllObservations | CriticInput::Team)
        {
            let name = serde_json::json!(self.critic_input);
            return Err(usage!(
                "`algorithm` is ippo and `critic_input` {}: critics that see everything are those of mappo; set \
                 `critic_input` to joint or local, or `algorithm` to mappo",
                name.as_str().expect("it is written as a word")
            ));
        }
        match self.train_p {
            TrainP::Level(p) if !(0.0..=1.0).contains(&p) => {
                return Err(usage!(
                    "`train_p` is {p}, expected a probability from 0 to 1, or links such as \"uniform\""
                ));
            }
            _ if !self.everything_arrives()
                && self.predictors.is_empty()
                && self.train_imputer.is_empty() =>
            {
                return Err(usage!(
                    "`train_p` below 1 needs a predictor that imputes what is lost; name one in `predictors`, or another \
                     imputer in `train_imputer`"
                ));
            }
            _ => {}
        }
        let name = &self.train_imputer;
        if !(name.is_empty() || WITHOUT_A_POLICY.contains(&&name[..]) || self.predictors.contains(name)) {
            return Err(usage!(
                "`train_imputer` is {name}, expected one of `predictors`, or one of {}",
                WITHOUT_A_POLICY.join(", ")
            ));
        }
        if self.update_every > self.batch_episodes {
            return Err(usage!(
                "`update_every` is {} and `batch_episodes` {}: an update would never see some episodes",
                self.update_every,
                self.batch_episodes
            ));
        }
        if self.replay_batch > self.replay_episodes {
            return Err(usage!(
                "`replay_batch` is {}, more than the {} of `replay_episodes`",
                self.replay_batch,
                self.replay_episodes
            ));
        }
        if let Some(name) = self.predictors.iter().find(|name| objective(name, 1.0).is_none()) {
            return Err(usage!(
                "there is no predictor `{name}`; there are value-aware, maro, lambda0 and maro-carry"
            ));
        }
        self.networks().check().map_err(|e| usage!("{e}"))
    }
}
