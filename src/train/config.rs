//! What a training run depends on, as text: presets, `config.toml` and `--set`.

use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::layer::{Layer, like};
use super::settings::{Backend, CriticInput, Estimator, Loss, Objective, PredictorSettings, Settings};
use crate::base::error::Result;
use crate::base::file::AtomicFile;
use crate::environment::{PhysicsSpec, Spec, Task};
use crate::link::{LinkSpec, Links};
use crate::nn::{ActorKind, Input, Networks, PredictorSpec, Sharing, Sigma};
use crate::usage;

/// Everything that the result of a training run depends on; two runs of one configuration end in the same bits.
///
/// `docs/training.md` says where the defaults come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Id of the task.
    pub task: String,
    /// How bodies move.
    pub physics: PhysicsSpec,
    /// Seed of every draw.
    pub seed: u64,
    /// Timesteps to train for; a run ends with the update that reaches them.
    pub steps: u64,
    /// What critics see by default.
    pub algorithm: Algorithm,
    /// The kind of actor.
    pub actor: ActorKind,
    /// Hidden size of actors and critics.
    pub hidden: usize,
    /// What the actors see: `estimate`, then perhaps `delivered` and `age`; written down if that is more than estimates.
    #[serde(default = "estimates_alone", skip_serializing_if = "are_estimates_alone")]
    pub actor_inputs: Vec<Input>,
    /// One actor for all agents, which sees the agent's id.
    pub share_actors: bool,
    /// One critic for all agents, which sees the agent's id.
    pub share_critics: bool,
    /// What critics see.
    pub critic_input: CriticInput,
    /// Hidden size of the critics, 0 for that of the actors; written down if not 0.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub critic_hidden: usize,
    /// Learning rate of actors and critics.
    pub learning_rate: f64,
    /// What entropy (nat) is worth in the actors' loss.
    pub entropy_coefficient: f64,
    /// Discount of one step.
    pub gamma: f64,
    /// How rewards and values become returns.
    pub advantage: AdvantageKind,
    /// Rewards in a return before a value stands for the rest, with `advantage = "n-step"`.
    pub n_steps: usize,
    /// Lambda of `advantage = "gae"`.
    pub gae_lambda: f64,
    /// How far from 1 a ratio of probabilities still counts.
    pub clip: f64,
    /// Passes over the batch in one update.
    pub epochs: usize,
    /// Largest norm of the gradient of all actors, and of all critics.
    pub max_grad_norm: f64,
    /// Shift and scale the rewards of a batch to mean 0 and standard deviation 1.
    pub standardise_rewards: bool,
    /// Updates between copies of the critics to the target critics.
    pub target_interval: u64,
    /// Episodes that an update learns from.
    pub batch_episodes: usize,
    /// Fresh episodes between updates, played side by side in as many worlds; the batch is the last
    /// `batch_episodes`.
    pub update_every: usize,
    /// Probability that an observation is delivered while the policy trains, or links, such as `"uniform"`: one level
    /// per episode. Below 1 `train_imputer` imputes.
    pub train_p: TrainP,
    /// What imputes while the policy trains: a predictor, or `zero`, `hold` or `velocity`. Empty for the first of the
    /// predictors; written down if not.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub train_imputer: String,
    /// Whether messages also carry the newest that their senders hold of others, in training and in its tests; written
    /// down if so.
    #[serde(default, skip_serializing_if = "is_false")]
    pub relay: bool,
    /// Predictors that learn beside the policy: `value-aware`, `maro`, `lambda0`, `maro-carry`.
    pub predictors: Vec<String>,
    /// Steps of each predictor per update.
    pub predictor_updates: usize,
    /// Learning rate of the predictors.
    pub predictor_learning_rate: f64,
    /// Largest norm of a predictor's gradient.
    pub predictor_max_grad_norm: f64,
    /// Hidden size of the predictors.
    pub predictor_hidden: usize,
    /// What the predictors see, in the order of [`Input`]: `estimate`, and perhaps more.
    pub predictor_inputs: Vec<Input>,
    /// Whether a linear map of what the predictors see is added to what they say.
    pub predictor_skip: bool,
    /// From the predictors' raw log-std to their standard deviation.
    pub predictor_sigma: Sigma,
    /// What the predictors are told of how far off they were: `nll` or `mse`.
    pub predictor_loss: Loss,
    /// The weight of an advantage in the value-aware loss.
    pub lambda: f64,
    /// Episodes that `maro` and `maro-carry` remember.
    pub replay_episodes: usize,
    /// Remembered episodes that each of their steps learns from.
    pub replay_batch: usize,
    /// Timesteps between rows of `metrics.csv`, each with a test.
    pub test_interval: u64,
    /// Episodes of a test at each level and with each predictor; 0 for no tests.
    pub test_episodes: u64,
    /// What computes gradients.
    pub backend: Backend,
}

/// Where a configuration starts from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Preset {
    /// The settings in the paper's text: setting 1 for hear-see, speaker-listener and spread-xy-2, setting 2
    /// for the other tasks
    #[default]
    Paper,
    /// The settings of the `mappo` configuration in the paper's published code: shared networks, an update after
    /// every episode, rewards not standardised
    PublishedCode,
    /// The settings in the paper's text, except for one small actor that all agents share, and small critics and
    /// predictors: policies of a few hundred kilobytes
    Small,
    /// For teams of any size: a small actor that all agents share and that sees its own agent's part first, with MAPPO one
    /// critic for the whole team, batches of 64 episodes, and advantages by GAE
    Team,
}

/// What trains the policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Critics that see all observations.
    Mappo,
    /// Critics that see what the actors see.
    Ippo,
}

/// Which estimator of returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AdvantageKind {
    /// [`Estimator::Steps`].
    NStep,
    /// [`Estimator::Gae`].
    Gae,
}

/// How links are while the policy trains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a probability from 0 to 1, or links such as \"uniform\"")]
pub enum TrainP {
    /// One level.
    Level(f64),
    /// Links, as [`LinkSpec`] reads them.
    Links(String),
}

/// How a predictor with this name learns.
pub(super) fn objective(name: &str, lambda: f64) -> Option<(Objective, bool)> {
    match name {
        "value-aware" => Some((Objective::ValueAware { lambda }, false)),
        "lambda0" => Some((Objective::ValueAware { lambda: 0.0 }, false)),
        "maro" => Some((Objective::Maro, false)),
        "maro-carry" => Some((Objective::Maro, true)),
        _ => None,
    }
}

impl Config {
    /// The preset with the settings of all layers; those of later ones count more.
    ///
    /// # Errors
    /// `Usage` for settings that do not exist, have a value of another type, or make no sense.
    pub fn resolve(preset: Preset, layers: &[Layer]) -> Result<Config> {
        let given =
            |key: &str| layers.iter().rev().find_map(|layer| layer.table.get(key).map(|v| (layer, v)));
        let task = match given("task") {
            Some((_, Value::String(name))) => Task::parse(name)?,
            Some((layer, other)) => {
                return Err(usage!("{}: `task` is {other}, expected a name in quotes", layer.source));
            }
            None => Task::parse("hear-see")?,
        };
        let algorithm = match given("algorithm") {
            Some((layer, value)) => value.clone().try_into().map_err(|e| layer.refuse("algorithm", &e))?,
            None => Algorithm::Mappo,
        };
        let preset = Config::preset(preset, task.spec(), algorithm);
        let mut all = preset.to_table();
        for layer in layers {
            for (key, value) in &layer.table {
                let Some(default) = all.get_mut(key) else { return Err(layer.unknown(key, &all)) };
                *default = like(default, value.clone());
                // One at a time, so that an error can say which and where.
                Config::deserialize(all.clone()).map_err(|e| layer.refuse(key, &e))?;
            }
        }
        // However it was written, it is known by its id.
        all.insert("task".to_owned(), task.id().into());
        let config = Config::deserialize(all).map_err(|e| usage!("{}", e.message()))?;
        config.check()?;
        config.links(task.spec())?;
        Ok(config)
    }

    /// The networks that agents run.
    pub fn networks(&self) -> Networks {
        let spec = |name: &String| PredictorSpec {
            hidden: self.predictor_hidden,
            inputs: self.predictor_inputs.clone(),
            skip: self.predictor_skip,
            sigma: self.predictor_sigma,
            ..PredictorSpec::paper(name)
        };
        Networks {
            actor: self.actor,
            sharing: sharing(self.share_actors),
            hidden: self.hidden,
            actor_inputs: self.actor_inputs.clone(),
            predictors: self.predictors.iter().map(spec).collect(),
        }
    }

    /// What the learner is told.
    pub fn settings(&self) -> Settings {
        let predictor = |name: &String| {
            let (objective, carry_gradients) =
                objective(name, self.lambda).expect("the names of predictors are checked");
            PredictorSettings {
                objective,
                loss: self.predictor_loss,
                learning_rate: self.predictor_learning_rate,
                largest_gradient: self.predictor_max_grad_norm,
                carry_gradients,
            }
        };
        Settings {
            networks: self.networks(),
            critic_sharing: sharing(self.share_critics || self.critic_input == CriticInput::Team),
            critic_input: self.critic_input,
            critic_hidden: if self.critic_hidden == 0 { self.hidden } else { self.critic_hidden },
            predictors: self.predictors.iter().map(predictor).collect(),
            predictor_updates: self.predictor_updates,
            learning_rate: self.learning_rate,
            entropy_coefficient: self.entropy_coefficient,
            gamma: self.gamma,
            estimator: match self.advantage {
                AdvantageKind::NStep => Estimator::Steps(self.n_steps),
                AdvantageKind::Gae => Estimator::Gae(self.gae_lambda),
            },
            clip: self.clip,
            epochs: self.epochs,
            largest_gradient: self.max_grad_norm,
            standardise_rewards: self.standardise_rewards,
            target_interval: self.target_interval,
            backend: self.backend,
        }
    }

    /// The links while the policy trains in this environment.
    ///
    /// # Errors
    /// `Usage` if there are no such links, or they are in a file: then the configuration alone would not say what comes of
    /// it.
    pub fn links(&self, spec: &Spec) -> Result<Links> {
        let text = match &self.train_p {
            TrainP::Level(p) => return Ok(Links::level(*p)),
            TrainP::Links(text) => text,
        };
        let links = LinkSpec::parse(text, spec).map_err(|e| usage!("`train_p`: {e}"))?;
        if links.matrices().next().is_some() || links.logs().next().is_some() {
            return Err(usage!("`train_p` is {text}: training takes no links from files"));
        }
        Ok(links.build())
    }

    /// Whether all observations are delivered while the policy trains.
    pub(crate) fn everything_arrives(&self) -> bool {
        self.train_p == TrainP::Level(1.0)
    }

    /// What imputes while the policy trains: nothing has to where everything is delivered.
    pub(crate) fn imputer(&self) -> String {
        match self.predictors.first() {
            _ if !self.train_imputer.is_empty() => self.train_imputer.clone(),
            Some(name) if !self.everything_arrives() => name.clone(),
            _ => "hold".to_owned(),
        }
    }

    /// What is tested: every predictor, and what imputes in training by a name of its own. Where there is neither,
    /// holding what was received last.
    pub(crate) fn tested_imputers(&self) -> Vec<String> {
        let mut imputers = self.predictors.clone();
        if imputers.is_empty() || !self.train_imputer.is_empty() && !imputers.contains(&self.train_imputer) {
            imputers.push(self.imputer());
        }
        imputers
    }

    /// Whether predictors see what their agent does.
    pub(crate) fn sees_own_actions(&self) -> bool {
        self.networks().predictors.iter().any(PredictorSpec::sees_own_action)
    }

    /// Whether some predictor learns from remembered episodes.
    pub(crate) fn replays(&self) -> bool {
        self.settings().predictors.iter().any(|predictor| predictor.objective == Objective::Maro)
    }

    /// All settings, those as well that are not written down.
    fn to_table(&self) -> Table {
        let mut table = Table::try_from(self).expect("a configuration is a table");
        let inputs = Value::try_from(&self.actor_inputs).expect("inputs are a list of words");
        table.insert("actor_inputs".to_owned(), inputs);
        table.insert("critic_hidden".to_owned(), Value::Integer(self.critic_hidden as i64));
        table.insert("relay".to_owned(), self.relay.into());
        table.insert("train_imputer".to_owned(), self.train_imputer.clone().into());
        table
    }

    /// As text, which [`Layer::parse`] reads.
    pub(crate) fn to_toml(&self) -> String {
        toml::to_string(self).expect("a configuration can be written as TOML")
    }

    /// Writes `config.toml`.
    pub(crate) fn save(&self, path: &Path) -> Result<()> {
        let program = concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"));
        let text =
            format!("# Every setting of this run of {program}; see docs/training.md.\n{}", self.to_toml());
        AtomicFile::write(path, text.as_bytes())
    }

    /// The settings in which two configurations differ: key, value here, value there.
    pub(crate) fn differences(&self, other: &Config) -> Vec<(String, Value, Value)> {
        let [here, there] = [self, other].map(Config::to_table);
        let differing = here.into_iter().filter(|(key, value)| there[key] != *value);
        differing.map(|(key, value)| (key.clone(), value, there[&key].clone())).collect()
    }
}

fn is_false(flag: &bool) -> bool {
    !flag
}

fn is_zero(size: &usize) -> bool {
    *size == 0
}

fn estimates_alone() -> Vec<Input> {
    vec![Input::Estimate]
}

fn are_estimates_alone(inputs: &[Input]) -> bool {
    inputs == [Input::Estimate]
}

fn sharing(shared: bool) -> Sharing {
    if shared { Sharing::Shared } else { Sharing::Separate }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::Error;

    fn layer(settings: &[(&str, &str)]) -> Layer {
        let mut layer = Layer::new("--set");
        settings.iter().for_each(|(key, value)| layer.set(key, value));
        layer
    }

    fn resolve(settings: &[(&str, &str)]) -> Result<Config> {
        Config::resolve(Preset::Paper, &[layer(settings)])
    }

    #[test]
    fn the_presets_are_those_of_the_paper() {
        let hear_see = resolve(&[]).unwrap();
        assert_eq!((hear_see.actor, hear_see.learning_rate), (ActorKind::Mlp, 1e-4));
        assert_eq!(hear_see.settings(), {
            let paper = Settings::paper(ActorKind::Mlp);
            let spec = PredictorSpec::paper;
            let networks = Networks { predictors: vec![spec("value-aware"), spec("maro")], ..paper.networks };
            let maro = PredictorSettings::paper(Objective::Maro);
            Settings { networks, predictors: vec![paper.predictors[0].clone(), maro], ..paper }
        });
        let spread = resolve(&[("task", "SXY-4")]).unwrap();
        assert_eq!((&spread.task[..], spread.actor), ("spread-xy-4", ActorKind::Gru));
        assert_eq!((spread.learning_rate, spread.entropy_coefficient), (3e-4, 0.01));
        let ippo = resolve(&[("algorithm", "ippo")]).unwrap();
        assert_eq!(ippo.critic_input, CriticInput::Joint);
        let code = Config::resolve(Preset::PublishedCode, &[]).unwrap();
        assert!(code.share_actors && code.share_critics && !code.standardise_rewards);
        assert_eq!(code.update_every, 1);
        let small = Config::resolve(Preset::Small, &[]).unwrap();
        assert!(small.share_actors && !small.share_critics && small.hidden < hear_see.hidden);
    }

    #[test]
    fn a_configuration_comes_back_from_its_text() {
        let uniform = resolve(&[("train_p", "uniform"), ("predictors", "maro-carry, lambda0")]).unwrap();
        assert_eq!(uniform.train_p, TrainP::Links("uniform".to_owned()));
        for config in [resolve(&[]).unwrap(), uniform] {
            let text = Layer::parse(&config.to_toml(), "config.toml").unwrap();
            assert_eq!(Config::resolve(Preset::Paper, &[text]).unwrap(), config);
        }
    }

    #[test]
    fn later_layers_count_more_and_values_are_read_as_meant() {
        assert!(resolve(&[("predictors", "none")]).unwrap().predictors.is_empty());
        let table = Layer::parse("[train]\nclip = 1", "x.toml").unwrap();
        let error = Config::resolve(Preset::Paper, &[table]).unwrap_err().to_string();
        assert!(error.contains("x.toml: settings stand by themselves"), "{error}");
        let file = Layer::parse("steps = 10\nclip = 1\nepochs = 2", "file.toml").unwrap();
        let line = layer(&[("steps", "1e6"), ("share_actors", "true"), ("critic_input", "local")]);
        let config = Config::resolve(Preset::Paper, &[file, line]).unwrap();
        assert_eq!((config.steps, config.clip, config.epochs), (1_000_000, 1.0, 2));
        assert!(config.share_actors);
        assert_eq!(config.critic_input, CriticInput::OwnObservation);
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_the_words_to_mend_it() {
        for (settings, words) in [
            (
                &[("learning_rat", "1")][..],
                "--set: there is no setting `learning_rat`; the nearest is `learning_rate`",
            ),
            (&[("clip", "wide")], "--set: `clip`: invalid type"),
            (
                &[("predictor_inputs", "estimate,weather")],
                "--set: `predictor_inputs`: unknown variant `weather`, expected one of `estimate`, `egocentric`, `delivered`, `age`, `innovation`, `proximity`, `own-action`",
            ),
            (&[("predictor_inputs", "own-action")], "\"value-aware\" sees `estimate` first"),
            (&[("predictor_inputs", "estimate,egocentric")], "\"value-aware\" sees `estimate` first"),
            (&[("actor_inputs", "estimate,own-action")], "the actors see `estimate` or `egocentric` first"),
            (&[("actor_inputs", "estimate,egocentric")], "the actors see `estimate` or `egocentric` first"),
            (&[("actor_inputs", "delivered")], "the actors see `estimate` or `egocentric` first"),
            (&[("epochs", "0")], "`epochs` is 0"),
            (&[("steps", "0")], "`steps` is 0"),
            (&[("batch_episodes", "1e12")], "`batch_episodes` is 1000000000000, expected 1 to 4096"),
            (&[("algorithm", "ippo"), ("critic_input", "all")], "`critic_input` all"),
            (&[("algorithm", "ippo"), ("critic_input", "team")], "`critic_input` team"),
            (&[("critic_hidden", "-1")], "--set: `critic_hidden`"),
            (&[("critic_hidden", "1e9")], "`critic_hidden` is 1000000000"),
            (&[("epochs", "1.5")], "--set: `epochs`"),
            (&[("learning_rate", "-1")], "`learning_rate` is -1"),
            (&[("learning_rate", "nan")], "`learning_rate` is NaN"),
            (&[("gamma", "1.01")], "`gamma` is 1.01"),
            (&[("train_p", "2")], "`train_p` is 2"),
            (&[("train_p", "0.5"), ("predictors", "[]")], "needs a predictor"),
            (&[("train_imputer", "maro"), ("predictors", "value-aware")], "`train_imputer` is maro"),
            (&[("predictors", "kalman")], "there is no predictor `kalman`"),
            (&[("predictors", "maro,maro")], "two predictors are called"),
            (&[("update_every", "11")], "`update_every` is 11"),
            (&[("replay_episodes", "8")], "`replay_batch` is 32"),
            (&[("task", "hear-sea")], "hear-sea"),
            (&[("task", "7")], "expected a name"),
            (&[("algorithm", "dqn")], "--set: `algorithm`"),
            (&[("seed", "-1")], "expected a whole number"),
            (&[("train_p", "often")], "`train_p`: there are no links `often`"),
            (&[("train_p", "true")], "expected a probability from 0 to 1, or links such as \"uniform\""),
            (&[("train_p", "gilbert(loss=2, burst=4)")], "loss: `2` is not a probability"),
            (&[("share_actors", "yes")], "expected true or false"),
        ] {
            let error = resolve(settings).unwrap_err();
            assert!(matches!(error, Error::Usage(_)), "{error:?}");
            assert!(error.to_string().contains(words), "{error}");
        }
        assert!(Layer::parse("a = = 1", "x.toml").unwrap_err().to_string().starts_with("x.toml is not TOML"));
    }

    #[test]
    fn differences_are_told_by_name() {
        let (a, b) = (resolve(&[]).unwrap(), resolve(&[("clip", "0.3")]).unwrap());
        let differences = a.differences(&b);
        assert_eq!(differences, [("clip".to_owned(), Value::Float(0.2), Value::Float(0.3))]);
    }
}
