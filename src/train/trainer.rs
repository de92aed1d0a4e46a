//! Playing and learning by turns: the loop of training without the folder that keeps it.

use super::checkpoint::{Checkpoint, Progress, State, available_actions};
use super::memory_needed::check_memory;
use super::replay::Replay;
use super::{Algorithm, Batch, Config, Rollout, Team};
use crate::agent::{AgentSettings, PolicySource, dims};
use crate::base::error::Result;
use crate::environment::{EPISODE_STEPS, Task};
use crate::nn::kernels::all_finite;
use crate::nn::{Meta, Policy};
use crate::supervisor;

/// A team in training: what it has learned, and the worlds it plays in.
#[derive(Debug)]
pub struct Trainer {
    pub(super) config: Config,
    pub(super) task: Task,
    pub(super) state: State,
    rollout: Rollout,
    /// All weights of the policy, for the agents.
    weights: Vec<f32>,
}

/// Something is no longer a finite number, and what.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diverged(pub String);

impl Trainer {
    /// Before the first step.
    pub fn new(config: Config, threads: usize) -> Result<Trainer> {
        let state = State::begin(&config, threads)?;
        Trainer::assemble(config, state)
    }

    /// As it was at a checkpoint of this configuration.
    pub fn restore(config: Config, threads: usize, checkpoint: &Checkpoint) -> Result<Trainer> {
        let mut state = State::begin(&config, threads)?;
        state.restore(&config, checkpoint)?;
        Trainer::assemble(config, state)
    }

    fn assemble(config: Config, state: State) -> Result<Trainer> {
        let task = Task::parse(&config.task)?;
        let (links, first) = (config.links(), state.progress.episodes);
        let rollout = Rollout::new(&task, links, config.seed, config.update_every, first);
        let mut weights = Vec::new();
        state.team.policy_values(&mut weights);
        Ok(Trainer { config, task, state, rollout, weights })
    }

    /// Environment steps so far.
    pub fn timestep(&self) -> u64 {
        self.state.progress.timestep()
    }

    /// The networks.
    pub fn team(&self) -> &Team {
        &self.state.team
    }

    /// What the agents that collect experience run with.
    pub fn agents(&self) -> AgentSettings {
        AgentSettings {
            task: self.config.task.clone(),
            policy: PolicySource::Training,
            imputer: self.config.imputer(),
            greedy: false,
            seed: self.config.seed,
            worlds: self.config.update_every,
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
            origin: "trained by vamaro-swarm".to_owned(),
            ..Meta::new(&self.config.task, self.config.seed)
        };
        Policy::new(&dims(&self.task), meta, self.config.networks(), &self.weights)
    }

    /// Fresh episodes, into the batch and to be remembered.
    pub fn play(&mut self, agents: &mut impl supervisor::Team) -> Result<()> {
        let State { progress, replay, batch, .. } = &mut self.state;
        for episode_return in self.rollout.collect(agents, batch)? {
            progress.averages.push_return(*episode_return);
            replay.push(progress.episodes, batch, progress.episodes as usize % batch.episodes);
            progress.episodes += 1;
        }
        Ok(())
    }

    /// One update on the batch, once there is a whole one; then there are new weights.
    pub fn learn(&mut self) -> std::result::Result<Option<&[f32]>, Diverged> {
        let Config { seed, predictor_updates, replay_batch, batch_episodes, .. } = self.config;
        let State { progress, team, replay, batch } = &mut self.state;
        if progress.episodes < batch_episodes as u64 {
            return Ok(None);
        }
        let replays = replay.sample(seed, team.updates(), predictor_updates, replay_batch);
        let losses = team.update(batch, &replays);
        progress.averages.push_update(&self.config, losses).map_err(Diverged)?;
        team.policy_values(&mut self.weights);
        match all_finite(&self.weights) {
            true => Ok(Some(&self.weights)),
            false => Err(Diverged("a weight is no longer a finite number".to_owned())),
        }
    }
}

impl State {
    fn begin(config: &Config, threads: usize) -> Result<State> {
        let task = Task::parse(&config.task)?;
        check_memory(config, &task)?;
        let (dims, observation) = (dims(&task), task.padded_obs_dim());
        let available = available_actions(&task);
        let remembered = if config.replays() { config.replay_episodes } else { 0 };
        Ok(State {
            progress: Progress::default(),
            team: Team::untrained(config.settings(), &dims, observation, &available, config.seed, threads),
            replay: Replay::new(remembered, EPISODE_STEPS, dims.joint),
            batch: Batch::zeros(&task, config.batch_episodes, !config.everything_arrives()),
        })
    }
}
