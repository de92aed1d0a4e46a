//! Playing episodes: the phases of a tick by name.

use std::time::Instant;

use super::{Audit, Decisions, Ledger, Stage, Statistics, Team, signals};
use crate::base::error::Result;
use crate::environment::{EPISODE_STEPS, Task};
use crate::link::LinkModel;
use crate::recording::Recorder;

/// Worlds and links, a team that plays in them, and a ledger of what happened.
#[derive(Debug)]
pub struct Session {
    stage: Stage,
    decisions: Decisions,
    ledger: Ledger,
}

impl Session {
    /// A session in `worlds` parallel worlds.
    pub fn new(task: &Task, links: LinkModel, seed: u64, worlds: usize) -> Session {
        Session {
            stage: Stage::new(task, links, seed, worlds),
            decisions: Decisions::default(),
            ledger: Ledger::default(),
        }
    }

    /// Begins with this episode instead of number 0.
    pub fn starting_at(mut self, episode: u64) -> Session {
        self.stage = self.stage.starting_at(episode);
        self
    }

    /// Counts where the parts of policy inputs come from.
    pub fn with_audit(mut self) -> Session {
        self.ledger.audit = Some(Audit::default());
        self
    }

    /// Records all episodes.
    pub fn with_recorder(mut self, recorder: Recorder) -> Session {
        self.ledger.recorder = Some(recorder);
        self
    }

    /// Plays all episodes numbered below `episodes` that it has not played, and tells `progress` after each batch of worlds.
    pub fn play(
        &mut self,
        team: &mut impl Team,
        episodes: u64,
        mut progress: impl FnMut(&Statistics),
    ) -> Result<()> {
        let Session { stage, decisions, ledger } = self;
        let started = Instant::now();
        while stage.next_episode() < episodes {
            stage.begin_episodes(episodes);
            ledger.begin_episodes(stage);
            for _ in 0..EPISODE_STEPS {
                signals::check_stop()?;
                stage.sense();
                stage.draw_links();
                let exchange = Instant::now();
                team.tick(&stage.tick(), decisions)?;
                ledger.note_tick(stage, decisions, exchange.elapsed());
                stage.step_worlds(&decisions.actions);
                ledger.note_worlds(stage);
                ledger.statistics.set_elapsed(started.elapsed());
            }
            ledger.end_episodes()?;
            progress(&ledger.statistics);
        }
        Ok(())
    }

    /// Gives the recording up, and hands out what was counted so far: finished episodes, but all ticks.
    pub fn abandon(self) -> (Statistics, Option<Audit>) {
        (self.ledger.statistics, self.ledger.audit)
    }

    /// Finishes the recording, if there is one, and hands out what was counted.
    pub fn finish(self) -> Result<(Statistics, Option<Audit>)> {
        let Ledger { statistics, audit, recorder, .. } = self.ledger;
        recorder.map_or(Ok(()), Recorder::finish)?;
        Ok((statistics, audit))
    }
}
