//! The supervisor's side of a tick: worlds, sensors and links.

use super::Tick;
use crate::base::rng::MAX_AGENTS;
use crate::environment::{EPISODE_STEPS, Task, World};
use crate::link::LinkModel;

/// Parallel worlds that play consecutive episodes, step by step together.
#[derive(Debug)]
pub struct Stage {
    task: Task,
    links: LinkModel,
    seed: u64,
    worlds: Vec<World>,
    /// Worlds that play; fewer than all in the last batch.
    active: usize,
    /// Episode of world 0; world w plays episode + w.
    episode: u64,
    next_episode: u64,
    step: u32,
    /// Ticks so far. Agents start at tick 0, so the first one is 1.
    tick: u64,
    /// Padded observations, `[agents, active, observation]`.
    observations: Vec<f32>,
    /// Link rows, `[agents, active]`.
    rows: Vec<u64>,
}

impl Stage {
    /// A stage of `worlds` worlds.
    pub fn new(task: &Task, links: LinkModel, seed: u64, worlds: usize) -> Stage {
        Stage {
            task: task.clone(),
            links,
            seed,
            worlds: (0..worlds).map(|_| World::new(task)).collect(),
            active: 0,
            episode: 0,
            next_episode: 0,
            step: 0,
            tick: 0,
            observations: Vec::new(),
            rows: Vec::new(),
        }
    }

    /// Begins with this episode instead of number 0.
    pub fn starting_at(mut self, episode: u64) -> Stage {
        self.next_episode = episode;
        self
    }

    /// The task.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// The links.
    pub fn links(&self) -> &LinkModel {
        &self.links
    }

    /// The worlds that play.
    pub fn worlds(&self) -> &[World] {
        &self.worlds[..self.active]
    }

    /// The first episode that has not been begun.
    pub fn next_episode(&self) -> u64 {
        self.next_episode
    }

    /// Begins an episode in every world, up to the episode numbered `end`.
    pub fn begin_episodes(&mut self, end: u64) {
        self.episode = self.next_episode;
        self.active = (end - self.episode).min(self.worlds.len() as u64) as usize;
        self.next_episode += self.active as u64;
        self.step = 0;
        for (world, episode) in self.worlds[..self.active].iter_mut().zip(self.episode..) {
            world.reset(self.seed, episode);
        }
        let rows = self.task.n_agents() * self.active;
        self.rows.resize(rows, 0);
        self.observations.resize(rows * self.task.padded_obs_dim(), 0.0);
    }

    /// Whether the episodes are under way.
    pub fn is_playing(&self) -> bool {
        (self.step as usize) < EPISODE_STEPS
    }

    /// Reads every agent's sensor.
    pub fn sense(&mut self) {
        let observations = self.observations.chunks_exact_mut(self.task.padded_obs_dim());
        for (row, observation) in observations.enumerate() {
            self.worlds[row % self.active].observe(row / self.active, observation);
        }
    }

    /// Draws who receives whom.
    pub fn draw_links(&mut self) {
        let agents = self.task.n_agents();
        let mut rows = [0; MAX_AGENTS];
        for world in 0..self.active {
            self.links.rows(self.episode + world as u64, self.step.into(), &mut rows[..agents]);
            for (agent, row) in rows[..agents].iter().enumerate() {
                self.rows[agent * self.active + world] = *row;
            }
        }
        self.tick += 1;
    }

    /// What the team is given at this step.
    pub fn tick(&self) -> Tick<'_> {
        Tick {
            episode: self.episode,
            step: self.step,
            tick: self.tick,
            worlds: self.active,
            observations: &self.observations,
            rows: &self.rows,
        }
    }

    /// Carries out the actions `[agents, active]`.
    pub fn step_worlds(&mut self, actions: &[u8]) {
        let agents = self.task.n_agents();
        let mut team = [0; MAX_AGENTS];
        for (w, world) in self.worlds[..self.active].iter_mut().enumerate() {
            for (agent, action) in team[..agents].iter_mut().enumerate() {
                *action = actions[agent * self.active + w];
            }
            world.step(&team[..agents]);
        }
        self.step += 1;
    }
}
