//! What is noted of each tick: statistics always, an audit and a recording on request.

use std::time::Duration;

use super::{Audit, Decisions, EpisodeStatistics, Stage, Statistics, Tick};
use crate::base::error::Result;
use crate::environment::{N_ACTIONS, Task};
use crate::recording::{Episode, Recorder};

/// Notes what happens on a [`Stage`].
#[derive(Debug, Default)]
pub(super) struct Ledger {
    pub(super) statistics: Statistics,
    pub(super) audit: Option<Audit>,
    pub(super) recorder: Option<Recorder>,
    /// The episodes being played, one per world.
    playing: Vec<EpisodeStatistics>,
    /// The same, if they are recorded.
    recording: Vec<Episode>,
}

impl Ledger {
    /// Opens a page for each world.
    pub(super) fn begin_episodes(&mut self, stage: &Stage) {
        self.playing.clear();
        self.playing.resize(stage.worlds().len(), EpisodeStatistics::default());
        self.recording.clear();
        if self.recorder.is_some() {
            for (world, number) in stage.worlds().iter().zip(stage.tick().episode..) {
                let (episode, p) = (Some(number), stage.links().level(number));
                self.recording.push(Episode { episode, p, ..Episode::begin(world) });
            }
        }
    }

    /// Notes what the agents saw and decided, before the worlds move on.
    pub(super) fn note_tick(&mut self, stage: &Stage, decisions: &Decisions, time: Duration) {
        let (task, tick) = (stage.task(), stage.tick());
        self.statistics.push_tick(time);
        for (world, episode) in self.playing.iter_mut().enumerate() {
            episode.due += task.n_agents() as u64;
            episode.missed += u64::from(decisions.missing.count_ones());
            count_deliveries(task, &tick, decisions, world, episode);
            sum_imputation_errors(task, &tick, decisions, world, episode);
        }
        if let Some(audit) = &mut self.audit {
            audit.tick(task, &tick, decisions);
        }
        for (world, episode) in self.recording.iter_mut().enumerate() {
            record_tick(task, &tick, decisions, world, episode);
        }
    }

    /// Notes where the actions led.
    pub(super) fn note_worlds(&mut self, stage: &Stage) {
        for (world, episode) in stage.worlds().iter().zip(&mut self.playing) {
            episode.episode_return += world.team_reward();
        }
        for (world, episode) in stage.worlds().iter().zip(&mut self.recording) {
            episode.push_state(world);
            episode.agent_reward.push(world.agent_rewards().to_vec());
            episode.team_reward.push(world.team_reward());
            episode.episode_return += world.team_reward();
        }
    }

    /// Closes the pages.
    pub(super) fn end_episodes(&mut self) -> Result<()> {
        self.playing.drain(..).for_each(|episode| self.statistics.push_episode(episode));
        match &mut self.recorder {
            Some(recorder) => self.recording.drain(..).try_for_each(|episode| recorder.push(&episode)),
            None => Ok(()),
        }
    }
}

fn count_deliveries(
    task: &Task,
    tick: &Tick,
    decisions: &Decisions,
    world: usize,
    episode: &mut EpisodeStatistics,
) {
    if tick.step == 0 {
        return;
    }
    let agents = task.n_agents();
    for agent in decisions.present(agents) {
        let row = agent * tick.worlds + world;
        let used = decisions.used[row] & !(1 << agent);
        episode.delivered += u64::from(used.count_ones());
        episode.late += u64::from((tick.rows[row] & !decisions.used[row]).count_ones());
        episode.sent += agents as u64 - 1;
    }
}

fn sum_imputation_errors(
    task: &Task,
    tick: &Tick,
    decisions: &Decisions,
    world: usize,
    episode: &mut EpisodeStatistics,
) {
    let (agents, joint, unique) = (task.n_agents(), task.joint_dim(), task.unique_dim());
    for agent in decisions.present(agents) {
        let row = agent * tick.worlds + world;
        for sender in (0..agents).filter(|sender| decisions.used[row] >> sender & 1 == 0) {
            let imputed = &decisions.estimates[row * joint + sender * unique..][..unique];
            let truth = &tick.observation(task, sender, world)[..unique];
            let squares = imputed.iter().zip(truth).map(|(a, b)| f64::from(a - b).powi(2));
            episode.squared_error += squares.sum::<f64>();
            episode.imputed += unique as u64;
        }
    }
}

fn record_tick(task: &Task, tick: &Tick, decisions: &Decisions, world: usize, episode: &mut Episode) {
    let (agents, joint) = (task.n_agents(), task.joint_dim());
    let rows = || (0..agents).map(|agent| agent * tick.worlds + world);
    let bits = |row: u64| (0..agents).map(|sender| (row >> sender & 1) as u8).collect();
    episode.obs.push((0..agents).map(|agent| tick.observation(task, agent, world).to_vec()).collect());
    episode.actions.push(rows().map(|row| decisions.actions[row]).collect());
    episode.delivered.push(rows().map(|row| bits(decisions.used[row])).collect());
    episode
        .joint_estimate
        .push(rows().map(|row| decisions.estimates[row * joint..][..joint].to_vec()).collect());
    let logits = |(agent, row)| decisions.logits[row * N_ACTIONS..][..task.available_actions(agent)].to_vec();
    episode.logits.push(rows().enumerate().map(logits).collect());
}
