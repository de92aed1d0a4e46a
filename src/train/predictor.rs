//! The predictor's part of an update: likelihood or error of the next joint observation, weighted.

use std::time::Duration;

use super::batch::Trajectories;
use super::divergence::Divergence;
use super::ends::blank;
use super::memory::{Buffer, Flat};
use super::network::Passes;
use super::parameters::{Parameters, clip_scale};
use super::settings::{Backend, Loss, Objective, PredictorSettings, Settings};
use crate::bus::NOT_ARRIVED;
use crate::nn::{Dims, Predictor, PredictorSpec, Proximity, Scratch};

/// A predictor in training.
#[derive(Clone, Debug)]
pub struct LearningPredictor {
    /// Its weights.
    pub parameters: Parameters,
    pub(super) settings: PredictorSettings,
    spec: PredictorSpec,
    dims: Dims,
    passes: Passes,
    /// What it sees, `[steps, rows, views, width]`.
    x: Buffer,
    /// The same predictor as agents run it, if it hears: what it sees then follows from step to step.
    runs: Option<Predictor>,
    /// Who is near whom, if it sees that.
    proximity: Option<Proximity>,
    /// What each step of each agent's own part counts for, `[steps, rows, agents]`.
    weights: Buffer,
    /// What each predicted dim counts for beside that where agents see different things, `[agents, predicted]`; empty if
    /// all count alike.
    pub(super) importance: Vec<f32>,
    /// What [`Loss::Kl`] is of.
    pub(super) divergence: Option<Divergence>,
    d: Buffer,
    /// The clipped gradient of the step before, if it is carried on.
    pub(super) carried: Option<Flat>,
    /// Time it took since it was made.
    pub(super) busy: Duration,
}

/// What a predictor says of an update: means over its steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PredictorLosses {
    /// What is minimised: the negative log-likelihood, or the squared error, of an agent's own part, summed over its
    /// dims, in the mean over time, trajectories and agents by what each counts for; or the divergence of probabilities
    /// of actions.
    pub loss: f64,
    /// The negative log-likelihood where everything counts alike.
    pub nll: f64,
    /// The norm of the gradient, with what was carried on, before it is clipped.
    pub gradient: f64,
}

impl LearningPredictor {
    /// An untrained predictor.
    pub(super) fn new(
        spec: &PredictorSpec,
        settings: &PredictorSettings,
        dims: &Dims,
        backend: Backend,
        seed: u64,
    ) -> LearningPredictor {
        let network = spec.network(dims);
        let parameters = Parameters::untrained(&network, seed);
        LearningPredictor {
            runs: spec.hears().then(|| Predictor::new(spec, dims, &parameters.all_values())),
            proximity: spec.proximity(dims),
            carried: settings.carry_gradients.then(|| Flat::zeros(&parameters.specs)),
            passes: Passes::new(backend, &network),
            parameters,
            settings: settings.clone(),
            spec: spec.clone(),
            dims: dims.clone(),
            x: Buffer::default(),
            weights: Buffer::default(),
            importance: Vec::new(),
            divergence: None,
            d: Buffer::default(),
            busy: Duration::ZERO,
        }
    }

    /// How many rows a trajectory is to it: one for each agent where they see different things.
    pub(super) fn views(&self) -> usize {
        if self.spec.sees_own_action() { self.dims.n_agents } else { 1 }
    }

    /// Writes down what it sees by running it, step by step and with gradients left aside.
    fn see_by_running(&mut self, steps: usize, views: usize, trajectories: &Trajectories) {
        let Trajectories { rows, joint, estimates, ages, actions, .. } = *trajectories;
        let Dims { joint: length, predicted, n_agents, .. } = self.dims;
        let predictor = self.runs.as_mut().expect("it runs where it has senses");
        predictor.renew(&self.parameters.all_values());
        let width = self.parameters.specs[0].shape[0];
        let (mut state, mut scratch) = (predictor.state(rows * views), Scratch::default());
        let (mut seen, mut acts) = (vec![0.0; rows * views * length], vec![0; rows * views]);
        let mut out = vec![0.0; rows * views * 2 * predicted];
        let x = self.x.resize(steps * rows * views * width);
        x.fill(0.0);
        for (step, x) in x.chunks_exact_mut(rows * views * width).enumerate() {
            for view in 0..rows * views {
                let (at, agent) = (step * rows + view / views, view % views);
                let from = match estimates {
                    [] => &joint[at * length..],
                    estimates => &estimates[(at * n_agents + agent) * length..],
                };
                seen[view * length..][..length].copy_from_slice(&from[..length]);
                for sender in 0..n_agents {
                    let age = ages.get((at * n_agents + agent) * n_agents + sender).copied().unwrap_or(0);
                    let arrived = Some(age).filter(|age| *age != NOT_ARRIVED);
                    state.hear(view, sender, if sender == agent { Some(0) } else { arrived });
                }
                if self.spec.sees_own_action() {
                    acts[view] = self.dims.act(agent, actions[at * n_agents + agent].into());
                }
            }
            predictor.step(rows * views, &seen, &acts, &mut state, &mut scratch, &mut out);
            let inputs = state.seen().len() / (rows * views);
            for (view, (x, seen)) in
                x.chunks_exact_mut(width).zip(state.seen().chunks_exact(inputs)).enumerate()
            {
                if trajectories.has_transition(step * rows + view / views) {
                    let (values, acts_seen) = x.split_at_mut(inputs);
                    values.copy_from_slice(seen);
                    if let Some(one) = acts_seen.get_mut(acts[view]) {
                        *one = 1.0;
                    }
                }
            }
        }
    }

    /// One step on trajectories whose every step counts alike. `None` if there was nothing to learn from.
    pub(super) fn learn_alike(&mut self, trajectories: Trajectories) -> Option<PredictorLosses> {
        let steps = trajectories.observations.saturating_sub(1);
        self.weights.resize(steps * trajectories.rows * self.dims.n_agents).fill(1.0);
        self.step(trajectories)
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
            Objective::Maro => self.learn_alike(*replay?),
            Objective::ValueAware { lambda } => {
                // Dividing by the mean weight, as the paper does, cancels in the loss.
                let steps = batch.observations.saturating_sub(1);
                let weights = self.weights.resize(steps * batch.rows * self.dims.n_agents).iter_mut();
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
        let &Dims { joint: width, predicted, n_agents, .. } = &self.dims;
        let views = if trajectories.estimates.is_empty() { self.views() } else { n_agents };
        self.see(steps, views, &trajectories);
        let total = total * views as f64;
        let Parameters { values, gradient, .. } = &mut self.parameters;
        let out = self.passes.forward(values, steps, rows * views, &self.x);

        let d = self.d.resize(out.len());
        d.fill(0.0);
        let (mut loss, mut sum) = (0.0, 0.0);
        let unique = predicted / n_agents;
        let outs = out.chunks_exact(2 * predicted).zip(d.chunks_exact_mut(2 * predicted));
        for (view, (out, d)) in outs.enumerate() {
            let at = view / views;
            if !trajectories.has_transition(at) {
                continue;
            }
            let before = match trajectories.estimates {
                [] => &joint[at * width..][..width],
                estimates => &estimates[view * width..][..width],
            };
            let after = &joint[(at + rows) * width..][..width];
            let weights = &self.weights[at * n_agents..][..n_agents];
            let (mean, raw) = out.split_at(predicted);
            let (d_mean, d_raw) = d.split_at_mut(predicted);
            for dim in (0..predicted).filter(|dim| !self.spec.held.contains(dim)) {
                let importance = self.importance.get(view % views * predicted + dim).copied().unwrap_or(1.0);
                let share = f64::from(weights[dim / unique] * importance) / total;
                // -log N(delta; mean, sigma) = z^2 / 2 + log sigma + log sqrt(2 pi), z = (delta - mean) / sigma
                let log_std = self.spec.sigma.log_std(raw[dim]);
                let (error, scale) = (after[dim] - before[dim] - mean[dim], (-log_std).exp());
                let z = error * scale;
                let nll = f64::from(0.5 * z * z + log_std + HALF_LOG_TWO_PI);
                sum += nll;
                match self.settings.loss {
                    Loss::Nll => {
                        loss += share * nll;
                        d_mean[dim] = -share as f32 * z * scale;
                        d_raw[dim] = share as f32 * (1.0 - z * z) * self.spec.sigma.slope(raw[dim]);
                    }
                    Loss::Mse => {
                        loss += share * f64::from(error * error);
                        d_mean[dim] = -2.0 * share as f32 * error;
                    }
                    Loss::Kl => {}
                }
            }
        }
        if self.settings.loss == Loss::Kl {
            let divergence = self.divergence.as_mut().expect("there is a policy to compare with");
            loss = divergence.differentiate(&trajectories, &self.spec.held, out, &mut self.d);
        }
        self.passes.backward(values, &self.x, &self.d, gradient);
        Some((loss, sum / (transitions * n_agents * views) as f64))
    }

    /// Writes down what it sees: the joint observation, or the agents' estimates of it, and who is near whom and what the
    /// row's agent does there if that is part of it. Where there is no transition to learn from it sees zeros.
    fn see(&mut self, steps: usize, views: usize, trajectories: &Trajectories) {
        if self.runs.is_some() {
            return self.see_by_running(steps, views, trajectories);
        }
        let Trajectories { rows, joint, estimates, actions, .. } = *trajectories;
        let Dims { joint: length, n_agents, .. } = self.dims;
        let width = self.parameters.specs[0].shape[0];
        let mut near = Vec::new();
        let x = self.x.resize(steps * rows * views * width);
        x.fill(0.0);
        let transitions = x.chunks_exact_mut(views * width).enumerate();
        for (at, x) in transitions.filter(|(at, _)| trajectories.has_transition(*at)) {
            for (agent, x) in x.chunks_exact_mut(width).enumerate() {
                let (estimate, rest) = x.split_at_mut(length);
                let seen = match estimates {
                    [] => &joint[at * length..],
                    estimates => &estimates[(at * views + agent) * length..],
                };
                estimate.copy_from_slice(&seen[..length]);
                near.clear();
                self.proximity.iter().for_each(|proximity| proximity.show(estimate, &mut near));
                let (proximity, acts) = rest.split_at_mut(near.len());
                proximity.copy_from_slice(&near);
                if self.spec.sees_own_action() {
                    acts[self.dims.act(agent, actions[at * n_agents + agent].into())] = 1.0;
                }
            }
        }
    }
}

/// `log sqrt(2 pi)`.
const HALF_LOG_TWO_PI: f32 = 0.918_938_5;
