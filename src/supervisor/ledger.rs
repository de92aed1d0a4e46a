//! The ledger: what is counted of every episode.

use std::time::{Duration, Instant};

use super::{Decisions, EpisodeStatistics, Observer, Stage, Statistics, Tick};
use crate::base::error::Result;
use crate::bus::NOT_ARRIVED;
use crate::environment::Spec;

/// Counts what happens, episode by episode.
#[derive(Default)]
pub struct Ledger<'a> {
    statistics: Statistics,
    /// The episodes being played, one per world.
    playing: Vec<EpisodeStatistics>,
    /// When the first episode began.
    began: Option<Instant>,
    told: Option<Told<'a>>,
}

/// Is told what has been counted.
type Told<'a> = Box<dyn FnMut(&Statistics) + 'a>;

impl<'a> Ledger<'a> {
    /// A ledger that tells `told` what it has counted whenever episodes are over, and forgets the single episodes.
    pub(crate) fn telling(told: impl FnMut(&Statistics) + 'a) -> Ledger<'a> {
        Ledger { statistics: Statistics::forgetful(), told: Some(Box::new(told)), ..Ledger::default() }
    }

    /// What has been counted so far: finished episodes, but all ticks.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// What was counted: finished episodes, but all ticks.
    pub fn into_statistics(self) -> Statistics {
        self.statistics
    }
}

impl Observer for Ledger<'_> {
    fn begin_episodes(&mut self, stage: &Stage) -> Result<()> {
        self.began.get_or_insert_with(Instant::now);
        self.playing.clear();
        self.playing.resize(stage.worlds(), EpisodeStatistics::default());
        Ok(())
    }

    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, exchange: Duration) -> Result<()> {
        let (spec, tick) = (stage.spec(), stage.tick());
        self.statistics.push_tick(exchange);
        for world in stage.playing() {
            let episode = &mut self.playing[world];
            episode.due += spec.n_agents() as u64;
            episode.missed += u64::from((decisions.missing & !decisions.absent).count_ones());
            episode.absent += u64::from(decisions.absent.count_ones());
            episode.outdated += if tick.step > 0 { stage.outdated(world) } else { 0 };
            count_deliveries(&tick, decisions, world, (episode, &mut self.statistics));
            sum_imputation_errors(spec, &tick, decisions, world, episode);
        }
        Ok(())
    }

    fn stepped(&mut self, stage: &Stage, _decisions: &Decisions) -> Result<()> {
        for world in stage.stepped() {
            self.playing[world].episode_return += stage.team_reward(world);
        }
        self.statistics.set_elapsed(self.began.map_or(Duration::ZERO, |began| began.elapsed()));
        Ok(())
    }

    fn end_episodes(&mut self, _stage: &Stage) -> Result<()> {
        self.playing.drain(..).for_each(|episode| self.statistics.push_episode(episode));
        if let Some(told) = &mut self.told {
            told(&self.statistics);
        }
        Ok(())
    }
}

fn count_deliveries(
    tick: &Tick,
    decisions: &Decisions,
    world: usize,
    (episode, all): (&mut EpisodeStatistics, &mut Statistics),
) {
    if tick.step == 0 {
        return;
    }
    for agent in decisions.present(tick.agents) {
        let (arriving, used) = (tick.arriving(agent, world), decisions.used(tick, agent, world));
        let messages = tick.messages(agent, world);
        for sender in (0..tick.agents).filter(|sender| *sender != agent) {
            // What it sent before it was lost may still arrive.
            let there = decisions.absent >> sender & 1 == 0;
            episode.sent += u64::from(there);
            let (arriving, used, message) = (arriving[sender], used[sender], messages[sender]);
            // What was sent at t = 0 counts in none of these.
            let counts = |age: u8| age != NOT_ARRIVED && u32::from(age) < tick.step;
            episode.relayed += u64::from(used != message && counts(used));
            if !counts(message) {
                continue;
            }
            if used == message {
                episode.delivered += 1;
                episode.delayed += u64::from(used > 0);
            } else if arriving == message {
                episode.late += u64::from(there);
                if there {
                    all.push_late(sender);
                }
            } else {
                // Somebody else was faster.
                episode.outdated += 1;
            }
        }
    }
}

fn sum_imputation_errors(
    spec: &Spec,
    tick: &Tick,
    decisions: &Decisions,
    world: usize,
    episode: &mut EpisodeStatistics,
) {
    for agent in decisions.present(spec.n_agents()) {
        for squared_error in decisions.imputation_errors(spec, tick, agent, world) {
            episode.squared_error += squared_error;
            episode.imputed += spec.unique_dim() as u64;
        }
    }
}
