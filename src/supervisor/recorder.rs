//! The recorder: a trace of everything that is played, in a file or in memory.

use std::path::Path;
use std::time::Duration;

use super::{Decisions, Observer, Stage, Tick};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::{End, Spec};
use crate::failed;
use crate::recording::{Episode, Format, Presence, RecordingFile, RecordingHeader};

/// Writes down what the agents saw and thought, and what the worlds did.
#[derive(Debug)]
pub struct Recorder {
    keeps: Keeps,
    /// The episodes being played, one per world.
    playing: Vec<Episode>,
}

/// Where episodes go.
#[derive(Debug)]
enum Keeps {
    File(Box<RecordingFile>),
    Episodes(Vec<Episode>),
}

impl Keeps {
    fn format(&self) -> Option<Format> {
        match self {
            Keeps::File(file) => Some(file.format()),
            Keeps::Episodes(_) => None,
        }
    }
}

impl Recorder {
    /// Starts a trace at `path`.
    pub fn create(path: &Path, header: &RecordingHeader) -> Result<Recorder> {
        let file = Box::new(RecordingFile::create(path, header)?);
        Ok(Recorder { keeps: Keeps::File(file), playing: Vec::new() })
    }

    /// Keeps the episodes, with all but the logits if nobody asks the team for them.
    pub fn in_memory() -> Recorder {
        Recorder { keeps: Keeps::Episodes(Vec::new()), playing: Vec::new() }
    }

    /// The episodes that are in memory and not in a file.
    pub fn into_episodes(self) -> Vec<Episode> {
        match self.keeps {
            Keeps::Episodes(episodes) => episodes,
            Keeps::File(_) => Vec::new(),
        }
    }

    /// Ends the trace, and puts it in its place. Without this there is none, or of an MCAP what was played so far.
    pub fn finish(self) -> Result<()> {
        match self.keeps {
            Keeps::File(file) => file.finish(),
            Keeps::Episodes(_) => Ok(()),
        }
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
        let format = self.keeps.format();
        if format == Some(Format::Json) && decisions.logits.is_empty() && stage.spec().n_actions() > 0 {
            return Err(failed!("a recording needs the logits; the team's settings must have `tell_logits`"));
        }
        let team = stage.spec().n_agents();
        for world in stage.playing() {
            let (tick, episode) = (stage.tick(), &mut self.playing[world]);
            let before = tick.step.checked_sub(1).map(|step| step as usize);
            let was_absent =
                |agent| before.is_some_and(|step| episode.presence(step, agent) == Presence::Absent);
            let presence = |agent| presence(decisions, agent, was_absent(agent));
            let presence: Vec<Presence> = (0..team).map(presence).collect();
            episode.push_presence(tick.step as usize, presence);
            record_tick(stage.spec(), &tick, decisions, world, episode);
            if format != Some(Format::Compact) {
                record_thoughts(stage.spec(), &tick, decisions, world, episode);
            }
            let late = late(&tick, decisions, world);
            episode.push_late(tick.step as usize, late);
            if stage.longest_delay() > 0 || stage.relays() {
                let age = |age: &u8| Some(*age).filter(|age| *age != NOT_ARRIVED);
                let ages = |agent| received(&tick, decisions, agent, world).map(|it| age(&it)).collect();
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
        match &mut self.keeps {
            Keeps::File(file) => self.playing.drain(..).try_for_each(|episode| file.push(&episode)),
            Keeps::Episodes(episodes) => {
                episodes.append(&mut self.playing);
                Ok(())
            }
        }
    }
}

/// Whether an agent decided.
fn presence(decisions: &Decisions, agent: usize, was_absent: bool) -> Presence {
    let is = |bits: u64| bits >> agent & 1 == 1;
    if is(decisions.absent) {
        Presence::Absent
    } else if is(decisions.missing) {
        Presence::Missed
    } else if is(decisions.anew) && was_absent {
        Presence::Anew
    } else {
        Presence::Decided
    }
}

/// How old what had reached an agent was, by sender; nothing had if it did not decide.
fn received(tick: &Tick, decisions: &Decisions, agent: usize, world: usize) -> impl Iterator<Item = u8> {
    let decided = decisions.missing >> agent & 1 == 0;
    let used = decisions.used(tick, agent, world).iter();
    used.map(move |age| if decided { *age } else { NOT_ARRIVED })
}

/// What the links delivered to those who decided, of those who were there, and was late: 1, by receiver and sender.
fn late(tick: &Tick, decisions: &Decisions, world: usize) -> Vec<Vec<u8>> {
    let of = |agent| {
        let pairs = tick.arriving(agent, world).iter().zip(decisions.used(tick, agent, world));
        let late = |(sender, (arriving, used)): (usize, (&u8, &u8))| {
            let both_there = (decisions.missing >> agent | decisions.absent >> sender) & 1 == 0;
            u8::from(both_there && *arriving != NOT_ARRIVED && *used == NOT_ARRIVED)
        };
        pairs.enumerate().map(late).collect()
    };
    (0..tick.agents).map(of).collect()
}

/// What was done, and who had received whom.
fn record_tick(spec: &Spec, tick: &Tick, decisions: &Decisions, world: usize, episode: &mut Episode) {
    let agents = || 0..tick.agents;
    episode.actions.push(agents().map(|agent| decisions.action(spec, tick, agent, world)).collect());
    let delivered = |agent| received(tick, decisions, agent, world).map(|age| u8::from(age == 0)).collect();
    episode.delivered.push(agents().map(delivered).collect());
}

/// What the agents observed and thought.
fn record_thoughts(spec: &Spec, tick: &Tick, decisions: &Decisions, world: usize, episode: &mut Episode) {
    let (agents, joint, n_actions) = (|| 0..tick.agents, spec.joint_dim(), spec.n_actions());
    let row = |agent| agent * tick.worlds + world;
    // Nothing is known of what one thought who did not decide.
    let of_those = |values: &dyn Fn(usize) -> Vec<f32>| {
        let decided = |agent| decisions.missing >> agent & 1 == 0;
        agents().map(|agent| if decided(agent) { values(agent) } else { Vec::new() }).collect()
    };
    episode.obs.push(agents().map(|agent| tick.observation(spec, agent, world).to_vec()).collect());
    let estimate = |agent| decisions.estimates[row(agent) * joint..][..joint].to_vec();
    episode.joint_estimate.push(of_those(&estimate));
    // Nobody is asked for them but for JSON.
    if !decisions.logits.is_empty() {
        let logits =
            |agent| decisions.logits[row(agent) * n_actions..][..spec.available_actions(agent)].to_vec();
        episode.logits.push(of_those(&logits));
    }
}
