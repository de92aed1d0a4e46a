//! Rollouts: episodes that a team plays to learn from.

use super::Batch;
use crate::agent::JointLayout;
use crate::base::error::Result;
use crate::environment::{EPISODE_STEPS, Task};
use crate::link::LinkModel;
use crate::supervisor::{Decisions, Stage, Team, signals};

/// Parallel worlds whose episodes go into a [`Batch`]: episode e is column `e % batch.episodes`, so a batch of
/// more columns than worlds holds the last episodes.
#[derive(Debug)]
pub struct Rollout {
    stage: Stage,
    layout: JointLayout,
    worlds: usize,
    decisions: Decisions,
    returns: Vec<f64>,
}

impl Rollout {
    /// Rollouts in `worlds` parallel worlds, the first of which plays `first_episode`.
    pub fn new(task: &Task, links: LinkModel, seed: u64, worlds: usize, first_episode: u64) -> Rollout {
        assert!(worlds > 0, "a rollout has worlds");
        Rollout {
            stage: Stage::new(task, links, seed, worlds).starting_at(first_episode),
            layout: JointLayout::of(task),
            worlds,
            decisions: Decisions::default(),
            returns: Vec::new(),
        }
    }

    /// The number of the next episode: how many have been played, counted from episode 0.
    pub fn next_episode(&self) -> u64 {
        self.stage.next_episode()
    }

    /// Plays one episode in each world and writes them into their columns of `batch`, which has
    /// at least as many, and estimates if links can lose something. Returns what each episode brought in, in their order: the undiscounted sum of the team
    /// rewards.
    ///
    /// # Errors
    /// `Interrupted` if the program was asked to stop; whatever the team fails with. The columns are then half
    /// written.
    pub fn collect(&mut self, team: &mut impl Team, batch: &mut Batch) -> Result<&[f64]> {
        assert!(self.worlds <= batch.episodes, "a batch holds the episodes of all worlds");
        self.stage.begin_episodes(self.next_episode() + self.worlds as u64);
        self.returns.clear();
        self.returns.resize(self.worlds, 0.0);
        for step in 0..EPISODE_STEPS {
            self.sense(step, batch);
            self.tick(step, team, batch)?;
            self.act(step, batch);
        }
        self.sense(EPISODE_STEPS, batch);
        if !batch.estimates.is_empty() {
            // What the agents make of the end, too; nobody carries out what they do about it.
            self.tick(EPISODE_STEPS, team, batch)?;
        }
        Ok(&self.returns)
    }

    /// Notes what there is to observe.
    fn sense(&mut self, step: usize, batch: &mut Batch) {
        self.stage.sense();
        let (task, tick) = (self.stage.task(), self.stage.tick());
        let (observation, joint) = (task.padded_obs_dim(), self.layout.joint());
        for world in 0..self.worlds {
            let row = step * batch.episodes + column(tick.episode, world, batch);
            let agents = (0..task.n_agents()).map(|agent| tick.observation(task, agent, world));
            let team = &mut batch.observations[row * task.n_agents() * observation..];
            team.chunks_exact_mut(observation).zip(agents).for_each(|(to, from)| to.copy_from_slice(from));
            let known = |agent| tick.observation(task, agent, world);
            self.layout.join(known, known(0), &mut batch.joint[row * joint..][..joint]);
        }
    }

    /// Has the team decide, and notes what it did so on.
    fn tick(&mut self, step: usize, team: &mut impl Team, batch: &mut Batch) -> Result<()> {
        signals::check_stop()?;
        self.stage.draw_links();
        let tick = self.stage.tick();
        team.tick(&tick, &mut self.decisions)?;
        if batch.estimates.is_empty() {
            return Ok(());
        }
        let (agents, joint) = (self.layout.agents, self.layout.joint());
        for world in 0..self.worlds {
            let row = step * batch.episodes + column(tick.episode, world, batch);
            let estimates = batch.estimates[row * agents * joint..].chunks_exact_mut(joint).take(agents);
            for (agent, estimate) in estimates.enumerate() {
                let from = (agent * self.worlds + world) * joint;
                estimate.copy_from_slice(&self.decisions.estimates[from..from + joint]);
            }
        }
        Ok(())
    }

    /// Carries out the actions, and notes them and where they led.
    fn act(&mut self, step: usize, batch: &mut Batch) {
        self.stage.step_worlds(&self.decisions.actions);
        let (agents, episode) = (self.layout.agents, self.stage.tick().episode);
        for (world, state) in self.stage.worlds().iter().enumerate() {
            let row = step * batch.episodes + column(episode, world, batch);
            for (agent, action) in batch.actions[row * agents..][..agents].iter_mut().enumerate() {
                *action = self.decisions.actions[agent * self.worlds + world];
            }
            batch.rewards[row] = state.team_reward() as f32;
            self.returns[world] += state.team_reward();
        }
    }
}

/// The column of the episode that a world plays.
fn column(first: u64, world: usize, batch: &Batch) -> usize {
    ((first + world as u64) % batch.episodes as u64) as usize
}
