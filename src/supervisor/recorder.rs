//! The recorder: a trace of everything that is played.

use std::path::Path;
use std::time::Duration;

use super::{Decisions, Observer, Stage, Tick};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::{End, Spec};
use crate::failed;
use crate::recording::{Episode, RecordingFile, RecordingHeader};

/// Writes down what the agents saw and thought, and what the worlds did.
#[derive(Debug)]
pub struct Recorder {
    file: RecordingFile,
    /// The episodes being played, one per world.
    playing: Vec<Episode>,
}

impl Recorder {
    /// Starts a trace at `path`.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<Recorder> {
        Ok(Recorder { file: RecordingFile::create(path, header)?, playing: Vec::new() })
    }

    /// Puts the trace in its place. Without this there is none.
    pub fn finish(self) -> Result<()> {
        self.file.finish()
    }
}

impl Observer for Recorder {
    fn begin_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.playing.clear();
        for (world, number) in (0..stage.worlds()).zip(stage.tick().episode..) {
            let (episode, p) = (Some(number), stage.level(number));
            self.playing.push(Episode { episode, p, ..Episode::begin(stage.environment().state(world)) });
        }
        Ok(())
    }

    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _exchange: Duration) -> Result<()> {
        if decisions.logits.is_empty() && stage.spec().n_actions() > 0 {
            return Err(failed!("a recording needs the logits; the team's settings must have `tell_logits`"));
        }
        if decisions.absent != 0 {
            return Err(failed!(
                "an agent is not there, which a recording cannot say; record without faults"
            ));
        }
        for world in stage.playing() {
            let (tick, episode) = (stage.tick(), &mut self.playing[world]);
            record_tick(stage.spec(), &tick, decisions, world, episode);
            if stage.longest_delay() > 0 {
                let age = |age: &u8| Some(*age).filter(|age| *age != NOT_ARRIVED);
                let ages = |agent| decisions.used(&tick, agent, world).iter().map(age).collect();
                episode.ages.push((0..tick.agents).map(ages).collect());
            }
        }
        Ok(())
    }

    fn stepped(&mut self, stage: &Stage, _decisions: &Decisions) -> Result<()> {
        for world in stage.stepped() {
            let episode = &mut self.playing[world];
            episode.push_state(stage.environment().state(world));
            episode.agent_reward.push(stage.rewards(world).to_vec());
            episode.team_reward.push(stage.team_reward(world));
            episode.episode_return += stage.team_reward(world);
            episode.terminated = stage.end(world) == End::Terminated;
        }
        Ok(())
    }

    fn end_episodes(&mut self, _stage: &Stage) -> Result<()> {
        self.playing.drain(..).try_for_each(|episode| self.file.push(&episode))
    }
}

fn record_tick(spec: &Spec, tick: &Tick, decisions: &Decisions, world: usize, episode: &mut Episode) {
    let (agents, joint, n_actions) = (spec.n_agents(), spec.joint_dim(), spec.n_actions());
    let rows = || (0..agents).map(|agent| agent * tick.worlds + world);
    episode.obs.push((0..agents).map(|agent| tick.observation(spec, agent, world).to_vec()).collect());
    episode.actions.push((0..agents).map(|agent| decisions.action(spec, tick, agent, world)).collect());
    let delivered =
        |agent| decisions.used(tick, agent, world).iter().map(|age| u8::from(*age == 0)).collect();
    episode.delivered.push((0..agents).map(delivered).collect());
    episode
        .joint_estimate
        .push(rows().map(|row| decisions.estimates[row * joint..][..joint].to_vec()).collect());
    let logits = |(agent, row)| decisions.logits[row * n_actions..][..spec.available_actions(agent)].to_vec();
    episode.logits.push(rows().enumerate().map(logits).collect());
}
