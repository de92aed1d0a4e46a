//! Teaching a predictor for a policy that does not change.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::checkpoint::available_actions;
use super::divergence::Divergence;
use super::predictor::LearningPredictor;
use super::settings::{Backend, Loss, Objective, PredictorSettings};
use super::{Batch, PredictorLosses, Rollout};
use crate::agent::{AgentSettings, PolicySource};
use crate::base::error::{Error, Result};
use crate::environment::{About, Task, Value};
use crate::link::{Links, Uniform};
use crate::nn::kernels::all_finite;
use crate::nn::{Policy, PredictorSpec};
use crate::supervisor::{InProcess, Team};
use crate::{failed, usage};

/// How a predictor is taught for a policy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// Steps of Adam, each on fresh episodes.
    pub updates: u64,
    /// Episodes of an update.
    pub episodes: usize,
    /// What the predictor sees meanwhile.
    pub feed: Feed,
    /// What it is told of how far off it was.
    pub loss: Loss,
    /// The learning rate of the first update; it falls to zero linearly.
    pub learning_rate: f64,
    /// Largest norm of the gradient.
    pub largest_gradient: f64,
    /// What a dim that tells of the agent itself counts for, whoever observes it; all others count for one. The return
    /// depends most on what an agent believes of itself.
    pub own_weight: f64,
    /// Whether it is kept from predicting dims that never changed in the first episodes.
    pub hold_constants: bool,
    /// Seed of every draw.
    pub seed: u64,
}

/// What a predictor sees while it learns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Feed {
    /// The truth: everything arrives, and it learns what follows in one step.
    Truth,
    /// What agents made of what arrived: it imputes for them in closed loop, with a probability of delivery that is drawn
    /// for every episode, and learns to put its own errors right.
    #[default]
    ClosedLoop,
}

impl Default for FitSettings {
    fn default() -> FitSettings {
        FitSettings {
            updates: 9000,
            episodes: 32,
            feed: Feed::default(),
            loss: Loss::Mse,
            learning_rate: 2e-3,
            largest_gradient: 1.0,
            own_weight: 10.0,
            hold_constants: true,
            seed: 0,
        }
    }
}

/// The longest time between copies of an unfinished fit.
const BETWEEN_SAVES: Duration = Duration::from_secs(30);

/// A predictor on its way, and the episodes that it learns from.
#[derive(Debug)]
pub struct PredictorFit {
    pub(super) settings: FitSettings,
    pub(super) task: Task,
    pub(super) policy: Policy,
    pub(super) spec: PredictorSpec,
    pub(super) predictor: LearningPredictor,
    pub(super) rollout: Rollout,
    pub(super) batch: Batch,
    pub(super) updates: u64,
    /// All weights that the agents have, and where the predictor's are among them.
    weights: Vec<f32>,
    own: Range<usize>,
}

/// Teaches `policy` a predictor, in this process: the policy with it, untouched otherwise. `progress` hears of every
/// update. How far it is is kept in the file `unfinished`, and one that is there already goes on. When the policy is kept
/// elsewhere, that file has done its duty.
///
/// # Errors
/// `Usage` if there cannot be such a predictor, or another fit is kept in the file; `Failed` if its weights are no longer
/// numbers; `Interrupted` if the program was asked to stop, or what `progress` fails with.
pub fn fit_predictor(
    policy: &Policy,
    task: &Task,
    spec: &PredictorSpec,
    settings: &FitSettings,
    unfinished: &Path,
    mut progress: impl FnMut(u64, &PredictorLosses) -> Result<()>,
) -> Result<Policy> {
    let mut fit = PredictorFit::new(policy, task, spec, settings)?;
    if unfinished.exists() {
        fit = fit.resume(unfinished)?;
    }
    let mut agents = InProcess::new(&fit.agents(), &fit.policy()?)?;
    let mut kept = Instant::now();
    while fit.updates < settings.updates {
        let losses = fit.update(&mut agents);
        let told = losses.and_then(|losses| losses.map_or(Ok(()), |losses| progress(fit.updates, &losses)));
        if let Err(error) = told {
            if matches!(error, Error::Interrupted(_)) {
                fit.save(unfinished)?;
            }
            return Err(error);
        }
        if kept.elapsed() >= BETWEEN_SAVES {
            fit.save(unfinished)?;
            kept = Instant::now();
        }
    }
    fit.save(unfinished)?;
    fit.policy()
}

impl PredictorFit {
    /// Before the first update.
    ///
    /// # Errors
    /// `Usage` if there cannot be such a predictor; `Interrupted` if the program was asked to stop.
    pub fn new(
        policy: &Policy,
        task: &Task,
        spec: &PredictorSpec,
        settings: &FitSettings,
    ) -> Result<PredictorFit> {
        let mut spec = spec.clone();
        if settings.hold_constants {
            spec.held.extend(constants(policy, task, settings)?);
            spec.held.sort_unstable();
            spec.held.dedup();
        }
        let learning = PredictorSettings {
            loss: settings.loss,
            learning_rate: settings.learning_rate,
            largest_gradient: settings.largest_gradient,
            ..PredictorSettings::paper(Objective::Maro)
        };
        let dims = policy.dims();
        let mut predictor = LearningPredictor::new(&spec, &learning, dims, Backend::Native, settings.seed);
        predictor.importance = importance(task, settings.own_weight);
        if settings.loss == Loss::Kl && policy.networks().actors_have_senses() {
            return Err(usage!(
                "the loss kl needs actors that see joint estimates as they are, and those of this policy see something else (its \
                 `actor_inputs`); take mse or nll"
            ));
        }
        if settings.loss == Loss::Kl {
            predictor.divergence = Some(Divergence::new(policy, &available_actions(task.spec())));
        }
        let mut batch = Batch::zeros(task.spec(), settings.episodes, settings.feed == Feed::ClosedLoop);
        if spec.hears() && settings.feed == Feed::ClosedLoop {
            batch = batch.with_ages(task.spec().n_agents());
        }
        let with_it = policy.with_predictor(&spec, &predictor.parameters.all_values())?;
        let mut weights = vec![0.0; with_it.n_values()];
        with_it.copy_values(&mut weights);
        Ok(PredictorFit {
            own: with_it.predictor_range(&spec.name).expect("it has this predictor"),
            weights,
            rollout: rollout(task, settings, 0),
            batch,
            settings: settings.clone(),
            task: task.clone(),
            policy: policy.clone(),
            spec,
            predictor,
            updates: 0,
        })
    }

    /// What the agents run with that it plays with.
    pub fn agents(&self) -> AgentSettings {
        AgentSettings {
            policy: PolicySource::Training,
            imputer: self.spec.name.clone(),
            seed: self.settings.seed,
            worlds: self.settings.episodes,
            ..AgentSettings::of(self.task.spec())
        }
    }

    /// Updates so far.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// The policy with the predictor as it is now.
    ///
    /// # Errors
    /// `Usage` if there cannot be such a predictor.
    pub fn policy(&self) -> Result<Policy> {
        self.policy.with_predictor(&self.spec, &self.predictor.parameters.all_values())
    }

    /// Plays an episode in each world, with agents of its [policy](Self::policy), and takes a step. `None` if the
    /// episodes were too short to learn from.
    ///
    /// # Errors
    /// `Interrupted` if the program was asked to stop; `Failed` if a weight is no longer a number; whatever the agents
    /// fail with.
    pub fn update(&mut self, agents: &mut impl Team) -> Result<Option<PredictorLosses>> {
        self.rollout.collect(agents, &mut self.batch)?;
        let left = 1.0 - self.updates as f64 / self.settings.updates as f64;
        self.predictor.settings.learning_rate = self.settings.learning_rate * left;
        let losses = self.predictor.learn_alike(match self.settings.feed {
            Feed::Truth => self.batch.trajectories(),
            Feed::ClosedLoop => self.batch.trajectories_as_seen(),
        });
        self.updates += 1;
        if !all_finite(self.predictor.parameters.values.all()) {
            let name = &self.spec.name;
            return Err(failed!(
                "a weight of predictor {name:?} is no longer a number; try a smaller learning rate"
            ));
        }
        if self.settings.feed == Feed::ClosedLoop {
            self.weights[self.own.clone()].copy_from_slice(&self.predictor.parameters.all_values());
            agents.renew(&self.weights)?;
        }
        Ok(losses)
    }
}

/// The episodes that it learns from, after so many that have been played.
pub(super) fn rollout(task: &Task, settings: &FitSettings, played: u64) -> Rollout {
    let links = match settings.feed {
        Feed::Truth => Links::level(1.0),
        Feed::ClosedLoop => Links::from(Uniform),
    };
    Rollout::new(task.environment(settings.episodes), links, settings.seed, played)
}

/// What each predicted dim counts for to each agent, `[agents, predicted]`.
pub(super) fn importance(task: &Task, own_weight: f64) -> Vec<f32> {
    let (spec, unique) = (task.spec(), task.spec().unique_dim());
    let mut importance = vec![1.0; spec.n_agents() * spec.n_agents() * unique];
    for (agent, importance) in importance.chunks_exact_mut(spec.n_agents() * unique).enumerate() {
        for (dims, observer) in importance.chunks_exact_mut(unique).zip(&spec.agents) {
            let about_it = |(_, value): &(&mut f32, &Value)| value.about == About::Agent(agent);
            let own = dims.iter_mut().zip(&observer.observation).filter(about_it);
            own.for_each(|(importance, _)| *importance = own_weight as f32);
        }
    }
    importance
}

/// The predicted dims that change at no step of some episodes.
fn constants(policy: &Policy, task: &Task, settings: &FitSettings) -> Result<Vec<usize>> {
    let agents =
        AgentSettings { worlds: settings.episodes, seed: settings.seed, ..AgentSettings::of(task.spec()) };
    let mut batch = Batch::zeros(task.spec(), settings.episodes, false);
    let mut rollout = Rollout::new(task.environment(settings.episodes), Links::level(1.0), settings.seed, 0);
    rollout.collect(&mut InProcess::new(&agents, policy)?, &mut batch)?;
    let (rows, joint) = (batch.episodes, policy.dims().joint);
    let changes = |dim: &usize| {
        let value = |at: usize| batch.joint[at * joint + dim];
        let mut steps = (0..batch.steps).flat_map(|step| (0..rows).map(move |row| (step, row)));
        steps.any(|(step, row)| {
            batch.ends.played(step + 1, row) && value(step * rows + row) != value((step + 1) * rows + row)
        })
    };
    Ok((0..policy.dims().predicted).filter(|dim| !changes(dim)).collect())
}
