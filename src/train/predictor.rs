//! The predictor's part of an update: Gaussian likelihood of the next joint observation, weighted.

use std::time::Duration;

use super::batch::Trajectories;
use super::ends::blank;
use super::memory::{Buffer, Flat};
use super::network::{Kind, Network};
use super::parameters::{Parameters, clip_scale};
use super::settings::{Backend, Objective, PredictorSettings, Settings};
use crate::nn::{Dims, PredictorSpec};

/// A predictor in training.
#[derive(Clone, Debug)]
pub struct Predictor {
    /// Its weights.
    pub parameters: Parameters,
    pub(super) settings: PredictorSettings,
    n_agents: usize,
    predicted: usize,
    /// Dims that are never predicted, and so no part of the likelihood.
    held: Vec<usize>,
    network: Network,
    /// The joint observations, `[steps, rows, joint]`.
    x: Buffer,
    /// What each step of each agent's own part counts for, `[steps, rows, agents]`.
    weights: Buffer,
    d: Buffer,
    /// The clipped gradient of the step before, if it is carried on.
    pub(super) carried: Option<Flat>,
    /// Time it took since it was made.
    pub(super) busy: Duration,
}

/// What a predictor says of an update: means over its steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PredictorLosses {
    /// What is minimised: the negative log-likelihood of an agent's own part, summed over its dims, in the mean
    /// over time, trajectories and agents by what each counts for.
    pub loss: f64,
    /// The same where everything counts alike.
    pub nll: f64,
    /// The norm of the gradient, with what was carried on, before it is clipped.
    pub gradient: f64,
}

impl Predictor {
    /// An untrained predictor.
    pub(super) fn new(
        spec: &PredictorSpec,
        settings: &PredictorSettings,
        dims: &Dims,
        backend: Backend,
        seed: u64,
    ) -> Predictor {
        let specs = spec.tensors(dims);
        Predictor {
            carried: settings.carry_gradients.then(|| Flat::zeros(&specs)),
            network: Network::new(backend, Kind::Lstm, &specs),
            parameters: Parameters::untrained(specs, seed),
            settings: settings.clone(),
            n_agents: dims.n_agents,
            predicted: dims.predicted,
            held: spec.held.clone(),
            x: Buffer::default(),
            weights: Buffer::default(),
            d: Buffer::default(),
            busy: Duration::ZERO,
        }
    }

    /// Its steps of one update, on the `batch` and its `advantages` `[T, E, agents]` or on one of `replays`
    /// each, as its objective asks. `None` if there was nothing to learn from: no replay yet, or nothing
    /// that counts.
    pub(super) fn learn(
        &mut self,
        settings: &Settings,
        batch: Trajectories,
        advantages: &[f32],
        replays: &[Trajectories],
    ) -> Option<PredictorLosses> {
        let (mut steps, mut sums) = (0.0, PredictorLosses::default());
        for at in 0..settings.predictor_updates {
            if let Some(losses) = self.learn_once(batch, advantages, replays.get(at)) {
                steps += 1.0;
                sums.loss += losses.loss;
                sums.nll += losses.nll;
                sums.gradient += losses.gradient;
            }
        }
        let PredictorLosses { loss, nll, gradient } = sums;
        (steps > 0.0).then(|| PredictorLosses {
            loss: loss / steps,
            nll: nll / steps,
            gradient: gradient / steps,
        })
    }

    /// One step, or none if there is nothing to learn from.
    fn learn_once(
        &mut self,
        batch: Trajectories,
        advantages: &[f32],
        replay: Option<&Trajectories>,
    ) -> Option<PredictorLosses> {
        match self.settings.objective {
            Objective::Maro => {
                let replay = *replay?;
                let steps = replay.observations.saturating_sub(1);
                self.weights.resize(steps * replay.rows * self.n_agents).fill(1.0);
                self.step(replay)
            }
            Objective::ValueAware { lambda } => {
                // Dividing by the mean weight, as the paper does, cancels in the loss.
                let steps = batch.observations.saturating_sub(1);
                let weights = self.weights.resize(steps * batch.rows * self.n_agents).iter_mut();
                weights.zip(advantages).for_each(|(w, a)| *w = (1.0 + lambda as f32 * a).max(0.0));
                self.step(batch)
            }
        }
    }

    /// One step of Adam on the mean of the negative log-likelihood by `self.weights`.
    fn step(&mut self, trajectories: Trajectories) -> Option<PredictorLosses> {
        let (loss, nll) = self.differentiate(trajectories)?;
        let gradient = &mut self.parameters.gradient;
        if let Some(carried) = &self.carried {
            let carried = carried.all().iter();
            gradient.all_mut().iter_mut().zip(carried).for_each(|(gradient, carried)| *gradient += carried);
        }
        let norm = self.parameters.squared_norm().sqrt();
        let scale = clip_scale(norm, self.settings.largest_gradient);
        if let Some(carried) = &mut self.carried {
            let gradient = self.parameters.gradient.all().iter();
            let carried = carried.all_mut().iter_mut();
            carried.zip(gradient).for_each(|(carried, gradient)| *carried = gradient * scale as f32);
        }
        self.parameters.step(self.settings.learning_rate, scale);
        Some(PredictorLosses { loss, nll, gradient: norm })
    }

    /// The loss, the same where everything counts alike, and the gradient.
    fn differentiate(&mut self, trajectories: Trajectories) -> Option<(f64, f64)> {
        let Trajectories { rows, observations, joint, .. } = trajectories;
        let transitions: usize = (0..rows).map(|row| trajectories.transitions(row)).sum();
        if transitions == 0 {
            return None;
        }
        let steps = observations - 1;
        blank(&mut self.weights, steps, rows, |row| trajectories.transitions(row));
        let total: f64 = self.weights.iter().map(|&weight| f64::from(weight)).sum();
        if total == 0.0 {
            return None;
        }
        let width = self.parameters.specs[0].shape[0];
        let x = self.x.resize(steps * rows * width);
        x.copy_from_slice(&joint[..steps * rows * width]);
        blank(x, steps, rows, |row| trajectories.transitions(row));
        let next = &joint[rows * width..observations * rows * width];
        let Parameters { values, gradient, .. } = &mut self.parameters;
        let out = self.network.forward(values, steps, rows, &self.x);

        let d = self.d.resize(out.len());
        d.fill(0.0);
        let (mut loss, mut sum) = (0.0, 0.0);
        let moves = self.x.chunks_exact(width).zip(next.chunks_exact(width));
        let outs = out.chunks_exact(2 * self.predicted).zip(d.chunks_exact_mut(2 * self.predicted));
        let unique = self.predicted / self.n_agents;
        let weights = self.weights.chunks_exact(self.n_agents);
        for (at, (((before, after), (out, d)), weights)) in moves.zip(outs).zip(weights).enumerate() {
            if at / rows >= trajectories.transitions(at % rows) {
                continue;
            }
            let (mean, raw) = out.split_at(self.predicted);
            let (d_mean, d_raw) = d.split_at_mut(self.predicted);
            for dim in (0..self.predicted).filter(|dim| !self.held.contains(dim)) {
                let share = f64::from(weights[dim / unique]) / total;
                // -log N(delta; mean, exp(raw)) = z^2 / 2 + raw + log sqrt(2 pi), z = (delta - mean) / exp(raw)
                let scale = (-raw[dim]).exp();
                let z = (after[dim] - before[dim] - mean[dim]) * scale;
                let nll = f64::from(0.5 * z * z + raw[dim] + HALF_LOG_TWO_PI);
                loss += share * nll;
                sum += nll;
                d_mean[dim] = -share as f32 * z * scale;
                d_raw[dim] = share as f32 * (1.0 - z * z);
            }
        }
        self.network.backward(values, steps, rows, &self.x, &self.d, gradient);
        Some((loss, sum / (transitions * self.n_agents) as f64))
    }
}

/// `log sqrt(2 pi)`.
const HALF_LOG_TWO_PI: f32 = 0.918_938_5;
