//! Playing and learning by turns: the loop of training without the folder that keeps it.

use super::checkpoint::{Checkpoint, Progress, State, available_actions};
use super::memory_needed::check_memory;
use super::replay::Replay;
use super::{Algorithm, Batch, Config, Learner, Rollout};
use crate::agent::{AgentSettings, PolicySource, Registry, dims};
use crate::base::error::Result;
use crate::environment::{ActionSpace, Spec, Task};
use crate::nn::kernels::all_finite;
use crate::nn::{Meta, Policy};
use crate::{supervisor, usage};

/// A team in training: what it has learned, and the worlds it plays in.
#[derive(Debug)]
pub struct Trainer {
    pub(super) config: Config,
    pub(super) task: Task,
    pub(super) state: State,
    rollout: Rollout,
    /// The most ticks by which links postpone anything.
    longest_delay: u8,
    /// All weights of the policy, for the agents.
    weights: Vec<f32>,
}

/// Something is no longer a finite number, and what.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diverged(pub String);

impl Trainer {
    /// Before the first step.
    pub fn new(config: Config, threads: usize) -> Result<Trainer> {
        let task = Task::parse(&config.task)?;
        Trainer::in_task(config, task, threads)
    }

    /// Before the first step, in a task that need not be one of the registry.
    pub fn in_task(config: Config, task: Task, threads: usize) -> Result<Trainer> {
        let task = task.with_physics(config.physics)?;
        let state = State::begin(&config, task.spec(), threads)?;
        Trainer::assemble(config, task, state)
    }

    /// As it was at a checkpoint of this configuration.
    pub(crate) fn restore(config: Config, threads: usize, checkpoint: &Checkpoint) -> Result<Trainer> {
        let task = Task::parse(&config.task)?.with_physics(config.physics)?;
        let mut state = State::begin(&config, task.spec(), threads)?;
        state.restore(&config, task.spec(), checkpoint)?;
        Trainer::assemble(config, task, state)
    }

    fn assemble(config: Config, task: Task, state: State) -> Result<Trainer> {
        let (links, first) = (config.links(task.spec())?, state.progress.episodes);
        let longest_delay = links.longest_delay();
        let rollout = Rollout::new(task.environment(config.update_every), links, config.seed, first)
            .relaying(config.relay);
        let mut weights = Vec::new();
        state.learner.policy_values(&mut weights);
        Ok(Trainer { config, task, state, rollout, longest_delay, weights })
    }

    /// Environment steps so far.
    pub fn timestep(&self) -> u64 {
        self.state.progress.timestep()
    }

    /// What the team learns to do.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// The networks.
    pub fn learner(&self) -> &Learner {
        &self.state.learner
    }

    /// What the agents that collect experience run with.
    pub fn agents(&self) -> AgentSettings {
        AgentSettings {
            spec: self.task.spec().clone(),
            policy: PolicySource::Training,
            imputer: self.config.imputer(),
            registry: Registry::default(),
            greedy: false,
            seed: self.config.seed,
            worlds: self.config.update_every,
            longest_delay: self.longest_delay,
            relay: self.config.relay,
            tell_logits: false,
        }
    }

    /// The policy as it is now.
    pub fn policy(&self) -> Result<Policy> {
        let algorithm = match self.config.algorithm {
            Algorithm::Mappo => "mappo",
            Algorithm::Ippo => "ippo",
        };
        let meta = Meta {
            algorithm: algorithm.to_owned(),
            steps: self.timestep(),
            origin: format!("trained by vamaro-swarm{}", self.config.physics.if_other()),
            imputer: self.config.networks().actors_hear().then(|| self.config.imputer()),
            ..Meta::new(&self.config.task, self.config.seed)
        };
        Policy::new(&dims(self.task.spec()), meta, self.config.networks(), &self.weights)
    }

    /// Fresh episodes, into the batch and to be remembered.
    pub fn play(&mut self, agents: &mut impl supervisor::Team) -> Result<()> {
        let State { progress, replay, batch, .. } = &mut self.state;
        for (episode_return, steps) in self.rollout.collect(agents, batch)? {
            progress.averages.push_return(*episode_return);
            progress.timesteps += steps;
            replay.push(progress.episodes, batch, progress.episodes as usize % batch.episodes);
            progress.episodes += 1;
        }
        Ok(())
    }

    /// One update on the batch, once there is a whole one; then there are new weights.
    pub fn learn(&mut self) -> std::result::Result<Option<&[f32]>, Diverged> {
        let Config { seed, predictor_updates, replay_batch, batch_episodes, .. } = self.config;
        let State { progress, learner, replay, batch } = &mut self.state;
        if progress.episodes < batch_episodes as u64 {
            return Ok(None);
        }
        let replays = replay.sample(seed, learner.updates(), predictor_updates, replay_batch);
        let losses = learner.update(batch, &replays);
        progress.averages.push_update(&self.config, losses).map_err(Diverged)?;
        learner.policy_values(&mut self.weights);
        if all_finite(&self.weights) {
            Ok(Some(&self.weights))
        } else {
            Err(Diverged("a weight is no longer a finite number".to_owned()))
        }
    }
}

impl State {
    fn begin(config: &Config, spec: &Spec, threads: usize) -> Result<State> {
        if spec.agents.iter().any(|agent| matches!(agent.actions, ActionSpace::Box { .. })) {
            return Err(usage!(
                "{} has agents that act by values; training has actors for discrete actions only",
                spec.id
            ));
        }
        let (dims, observation) = (dims(spec), spec.padded_obs_dim());
        config.networks().check_fit(&dims).map_err(|error| usage!("`predictor_inputs`: {error}"))?;
        check_memory(config, spec)?;
        let available = available_actions(spec);
        let remembered = if config.replays() { config.replay_episodes } else { 0 };
        let seen = if config.sees_own_actions() { dims.n_agents } else { 0 };
        let mut batch = Batch::zeros(spec, config.batch_episodes, !config.everything_arrives());
        if config.networks().actors_hear() && !config.everything_arrives() {
            batch = batch.with_ages(dims.n_agents);
        }
        Ok(State {
            progress: Progress::default(),
            learner: Learner::untrained(
                config.settings(),
                &dims,
                observation,
                &available,
                config.seed,
                threads,
            ),
            replay: Replay::new(remembered, spec.episode_steps, dims.joint, seen),
            batch,
        })
    }
}
