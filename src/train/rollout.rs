//! Rollouts: episodes that a team plays to learn from.

use std::time::Duration;

use super::Batch;
use crate::agent::JointLayout;
use crate::base::error::Result;
use crate::environment::{End, Environment};
use crate::link::Links;
use crate::supervisor::{Decisions, Observer, Session, Stage, Team};

/// Parallel worlds whose episodes go into a [`Batch`]: episode e is column `e % batch.episodes`, so a batch of
/// more columns than worlds holds the last episodes.
#[derive(Debug)]
pub struct Rollout {
    session: Session,
    worlds: usize,
    played: Vec<(f64, u64)>,
}

impl Rollout {
    /// Rollouts in all worlds of an environment, the first of which plays `first_episode`.
    pub fn new(environment: Box<dyn Environment>, links: Links, seed: u64, first_episode: u64) -> Rollout {
        let worlds = environment.worlds();
        assert!(worlds > 0, "a rollout has worlds");
        let session = Session::new(environment, links, seed).starting_at(first_episode);
        Rollout { session, worlds, played: Vec::new() }
    }

    /// Agents pass on the newest observation that they hold of each other agent, if so.
    pub fn relaying(self, relay: bool) -> Rollout {
        Rollout { session: self.session.relaying(relay), ..self }
    }

    /// The number of the next episode: how many have been played, counted from episode 0.
    pub fn next_episode(&self) -> u64 {
        self.session.next_episode()
    }

    /// Plays one episode in each world and writes them into their columns of `batch`, which has at least as many, and
    /// estimates if links can lose something. Returns of each episode, in their order, the return, which is the
    /// undiscounted sum of the team rewards, and its steps.
    ///
    /// # Errors
    /// `Interrupted` if the program was asked to stop; whatever the team fails with. The columns are then half
    /// written.
    pub fn collect(&mut self, team: &mut impl Team, batch: &mut Batch) -> Result<&[(f64, u64)]> {
        assert!(self.worlds <= batch.episodes, "a batch holds the episodes of all worlds");
        let end = self.next_episode() + self.worlds as u64;
        self.session.play(team, end, &mut [&mut Collector { batch, played: &mut self.played }])?;
        Ok(&self.played)
    }
}

/// Writes what is played into a batch.
struct Collector<'a> {
    batch: &'a mut Batch,
    /// Return and steps of each world's episode.
    played: &'a mut Vec<(f64, u64)>,
}

impl Observer for Collector<'_> {
    fn begin_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.played.clear();
        self.played.resize(stage.worlds(), (0.0, 0));
        Ok(())
    }

    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _exchange: Duration) -> Result<()> {
        let step = stage.tick().step as usize;
        self.note_observations(stage, step);
        self.note_estimates(stage, step, decisions);
        Ok(())
    }

    fn stepped(&mut self, stage: &Stage, decisions: &Decisions) -> Result<()> {
        let (agents, worlds, step) =
            (stage.spec().n_agents(), stage.worlds(), stage.tick().step as usize - 1);
        for world in stage.stepped() {
            let row = self.row(stage, step, world);
            for (agent, action) in self.batch.actions[row * agents..][..agents].iter_mut().enumerate() {
                // The actions of the actors that learn are discrete, and few.
                *action = decisions.actions[agent * worlds + world] as u8;
            }
            let reward = stage.team_reward(world);
            self.batch.rewards[row] = reward as f32;
            let (episode_return, steps) = &mut self.played[world];
            *episode_return += reward;
            *steps += 1;
        }
        Ok(())
    }

    /// Learning from estimates needs the agents' estimates after the last step, too.
    fn wants_last_tick(&self) -> bool {
        !self.batch.estimates.is_empty()
    }

    fn last_ticked(&mut self, stage: &Stage, decisions: &Decisions) -> Result<()> {
        self.note_estimates(stage, stage.tick().step as usize, decisions);
        Ok(())
    }

    fn end_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.note_observations(stage, stage.tick().step as usize);
        for (world, (_, steps)) in self.played.iter().enumerate() {
            let terminated = stage.end(world) == End::Terminated;
            self.batch.ends.set(self.row(stage, 0, world), *steps as usize, terminated);
        }
        Ok(())
    }
}

impl Collector<'_> {
    /// Notes what there is to observe.
    fn note_observations(&mut self, stage: &Stage, step: usize) {
        let (spec, tick) = (stage.spec(), stage.tick());
        let layout = JointLayout::of(spec);
        let (observation, joint) = (spec.padded_obs_dim(), layout.joint());
        for world in 0..tick.worlds {
            let row = self.row(stage, step, world);
            let agents = (0..spec.n_agents()).map(|agent| tick.observation(spec, agent, world));
            let team = &mut self.batch.observations[row * spec.n_agents() * observation..];
            team.chunks_exact_mut(observation).zip(agents).for_each(|(to, from)| to.copy_from_slice(from));
            let known = |agent| tick.observation(spec, agent, world);
            layout.join(known, known(0), &mut self.batch.joint[row * joint..][..joint]);
        }
    }

    /// Notes what the agents decided on, if the batch keeps it.
    fn note_estimates(&mut self, stage: &Stage, step: usize, decisions: &Decisions) {
        if self.batch.estimates.is_empty() {
            return;
        }
        let (spec, worlds) = (stage.spec(), stage.worlds());
        let (agents, joint) = (spec.n_agents(), spec.joint_dim());
        for world in 0..worlds {
            let row = self.row(stage, step, world);
            let estimates = self.batch.estimates[row * agents * joint..].chunks_exact_mut(joint).take(agents);
            for (agent, estimate) in estimates.enumerate() {
                let from = (agent * worlds + world) * joint;
                estimate.copy_from_slice(&decisions.estimates[from..from + joint]);
            }
            if !self.batch.ages.is_empty() {
                let ages = self.batch.ages[row * agents * agents..].chunks_exact_mut(agents).take(agents);
                let used = (0..agents).map(|agent| decisions.used(&stage.tick(), agent, world));
                ages.zip(used).for_each(|(ages, used)| ages.copy_from_slice(used));
            }
        }
    }

    /// The row of a step of the episode that a world plays.
    fn row(&self, stage: &Stage, step: usize, world: usize) -> usize {
        let episode = stage.tick().episode + world as u64;
        step * self.batch.episodes + (episode % self.batch.episodes as u64) as usize
    }
}
