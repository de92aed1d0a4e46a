//! Teaching a predictor on play from elsewhere: of a team that this program does not run.

use super::predictor::LearningPredictor;
use super::settings::{Backend, Loss, Objective, PredictorSettings};
use super::{PredictorLosses, Trajectories};
use crate::base::error::Result;
use crate::base::rng::{Draws, Purpose};
use crate::failed;
use crate::nn::kernels::all_finite;
use crate::nn::{Meta, Policy, PredictorSpec};

/// A predictor on its way, and all that was played for it.
///
/// What an agent saw was made of its own guesses when it was played, by the predictor as it was then. So the predictor meets
/// its own errors, and learns to put them right, as in DAgger (Ross, Gordon and Bagnell, 2011).
#[derive(Debug)]
pub(crate) struct Lessons {
    policy: Policy,
    spec: PredictorSpec,
    predictor: LearningPredictor,
    seed: u64,
    episodes: Vec<Episode>,
    updates: u64,
}

/// What was true in an episode, `[observations, joint]`, and what each agent saw, `[observations, agents, joint]`.
#[derive(Debug)]
struct Episode {
    truth: Vec<f32>,
    seen: Vec<f32>,
}

/// An update learns from so many episodes.
const ROWS: usize = 32;

impl Lessons {
    /// For agents with the joint observations of `policy`. What this `spec` holds is not learned.
    pub(crate) fn new(policy: &Policy, spec: PredictorSpec, seed: u64) -> Lessons {
        let settings = PredictorSettings { loss: Loss::Mse, ..PredictorSettings::paper(Objective::Maro) };
        let predictor = LearningPredictor::new(&spec, &settings, policy.dims(), Backend::Native, seed);
        Lessons { policy: policy.clone(), spec, predictor, seed, episodes: Vec::new(), updates: 0 }
    }

    /// Keeps an episode: what was true, `[observations, joint]`, and what each agent saw, `[observations, agents, joint]`.
    pub(crate) fn keep(&mut self, truth: Vec<f32>, seen: Vec<f32>) {
        self.episodes.push(Episode { truth, seen });
    }

    /// Takes a step on some of the episodes. `None` if there is nothing to learn from.
    ///
    /// # Errors
    /// `Failed` if a weight is no longer a number.
    pub(crate) fn learn(&mut self, learning_rate: f64) -> Result<Option<PredictorLosses>> {
        if self.episodes.is_empty() {
            return Ok(None);
        }
        let (joint, agents) = (self.policy.dims().joint, self.policy.dims().n_agents);
        let mut draws = Draws::new(self.seed, Purpose::Replay, self.updates, 0);
        let rows: Vec<&Episode> =
            (0..ROWS).map(|_| &self.episodes[draws.below(self.episodes.len())]).collect();
        let lengths: Vec<usize> = rows.iter().map(|episode| episode.truth.len() / joint).collect();
        let observations = lengths.iter().copied().max().unwrap_or(0);
        let side_by_side = |width: usize, of: fn(&Episode) -> &[f32]| {
            let mut all = vec![0.0; observations * ROWS * width];
            for (row, episode) in rows.iter().enumerate() {
                for (step, values) in of(episode).chunks_exact(width).enumerate() {
                    all[(step * ROWS + row) * width..][..width].copy_from_slice(values);
                }
            }
            all
        };
        let truth = side_by_side(joint, |episode| &episode.truth);
        let estimates = side_by_side(agents * joint, |episode| &episode.seen);
        self.predictor.settings.learning_rate = learning_rate;
        let losses = self.predictor.learn_alike(Trajectories {
            rows: ROWS,
            observations,
            lengths: &lengths,
            joint: &truth,
            estimates: &estimates,
            ages: &[],
            actions: &[],
        });
        self.updates += 1;
        if all_finite(self.predictor.parameters.values.all()) {
            return Ok(losses);
        }
        Err(failed!("a weight of the predictor is no longer a number; try a smaller learning rate"))
    }

    /// The policy with the predictor as it is now.
    ///
    /// # Errors
    /// `Usage` if there cannot be such a predictor.
    pub(crate) fn policy(&self) -> Result<Policy> {
        let policy = self.policy.with_predictor(&self.spec, &self.predictor.parameters.all_values())?;
        let joint = self.policy.dims().joint;
        let steps: usize =
            self.episodes.iter().map(|episode| (episode.truth.len() / joint).saturating_sub(1)).sum();
        let meta = Meta {
            algorithm: Meta::IMPUTER.to_owned(),
            steps: steps as u64,
            origin: "fitted to the play of a team from elsewhere".to_owned(),
            ..Meta::new(&policy.meta().task, self.seed)
        };
        Ok(policy.with_meta(meta))
    }
}
