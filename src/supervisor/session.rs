//! Playing episodes: each phase of a tick, by name.

use std::time::Instant;

use super::{Decisions, Observer, Stage, Team, signals};
use crate::base::error::Result;
use crate::environment::Environment;
use crate::link::Links;
use crate::usage;

/// The one episode driver: worlds and links, in which a [`Team`] plays while [`Observer`]s look on.
#[derive(Debug)]
pub struct Session {
    stage: Stage,
    decisions: Decisions,
}

impl Session {
    /// A session in all worlds of an environment.
    pub fn new(environment: Box<dyn Environment>, links: Links, seed: u64) -> Session {
        Session { stage: Stage::new(environment, links, seed), decisions: Decisions::default() }
    }

    /// Begins with this episode instead of number 0.
    pub fn starting_at(mut self, episode: u64) -> Session {
        self.stage = self.stage.starting_at(episode);
        self
    }

    /// The first episode that has not been begun.
    pub fn next_episode(&self) -> u64 {
        self.stage.next_episode()
    }

    /// Plays all episodes numbered below `end` that it has not played, or until an observer has seen enough.
    ///
    /// # Errors
    /// `Usage` if the links postpone by more than the team was started for; `Interrupted` if the program was asked to
    /// stop; whatever the team or an observer fails with.
    pub fn play(
        &mut self,
        team: &mut impl Team,
        end: u64,
        observers: &mut [&mut dyn Observer],
    ) -> Result<()> {
        let (links, kept) = (self.stage.longest_delay(), team.longest_delay());
        if links > kept {
            return Err(usage!(
                "these links postpone by up to {links} ticks, but this team keeps observations for {kept}; start it with \
                 settings whose `longest_delay` is {links}"
            ));
        }
        while self.next_episode() < end && !observers.iter().any(|observer| observer.has_seen_enough()) {
            self.play_episodes(team, end, observers)?;
        }
        Ok(())
    }

    /// Plays one episode in each world.
    fn play_episodes(
        &mut self,
        team: &mut impl Team,
        end: u64,
        observers: &mut [&mut dyn Observer],
    ) -> Result<()> {
        let Session { stage, decisions } = self;
        stage.begin_episodes(end)?;
        observers.iter_mut().try_for_each(|observer| observer.begin_episodes(stage))?;
        stage.sense()?;
        while stage.is_playing() {
            signals::check_stop()?;
            if observers.iter().any(|observer| observer.has_seen_enough()) {
                return Ok(());
            }
            stage.draw_links()?;
            let exchange = Instant::now();
            team.tick(&stage.tick(), decisions)?;
            let exchange = exchange.elapsed();
            observers.iter_mut().try_for_each(|observer| observer.ticked(stage, decisions, exchange))?;
            stage.step_worlds(decisions)?;
            observers.iter_mut().try_for_each(|observer| observer.stepped(stage, decisions))?;
            stage.sense()?;
        }
        if observers.iter().any(|observer| observer.wants_last_tick()) {
            stage.draw_links()?;
            team.tick(&stage.tick(), decisions)?;
            observers.iter_mut().try_for_each(|observer| observer.last_ticked(stage, decisions))?;
        }
        observers.iter_mut().try_for_each(|observer| observer.end_episodes(stage))
    }
}
