//! Playing episodes: each phase of a tick, by name.

use std::time::{Duration, Instant};

use super::chaos::Chaos;
use super::{ChaosSpec, Control, Decisions, Injected, Observer, Order, Stage, Steered, Team, Tick, signals};
use crate::base::error::Result;
use crate::environment::Environment;
use crate::link::Links;
use crate::usage;

/// The one episode driver: worlds and links, in which a [`Team`] plays while [`Observer`]s look on.
#[derive(Debug)]
pub struct Session {
    stage: Stage,
    chaos: Option<Chaos>,
    control: Option<Control>,
    /// What is to happen to agents before the next tick.
    orders: Vec<Order>,
    decisions: Decisions,
}

impl Session {
    /// A session in all worlds of an environment.
    pub fn new(environment: Box<dyn Environment>, links: Links, seed: u64) -> Session {
        Session {
            stage: Stage::new(environment, links, seed),
            chaos: None,
            control: None,
            orders: Vec::new(),
            decisions: Decisions::default(),
        }
    }

    /// Kills and stops agents on purpose, by draws that depend on seed, episode and step alone. `tick` says how many ticks
    /// an absence is.
    ///
    /// # Errors
    /// `Usage` if there is more than one world: an agent is one process for all of them, and what befalls it would no
    /// longer depend on one episode.
    pub fn with_chaos(mut self, chaos: ChaosSpec, tick: Duration) -> Result<Session> {
        let (worlds, agents) = (self.stage.environment().worlds(), self.stage.spec().n_agents());
        if worlds > 1 {
            return Err(usage!(
                "chaos needs one world, not {worlds}: an agent is one process for all of them, and a kill would hit \
                 them all at once"
            ));
        }
        self.chaos = Some(Chaos::new(chaos, self.stage.seed(), agents, tick));
        Ok(self)
    }

    /// How often agents were killed and stopped on purpose so far; `None` without chaos.
    pub fn injected(&self) -> Option<Injected> {
        self.chaos.as_ref().map(Chaos::injected)
    }

    /// Does what it is told between ticks. In real time a session cannot stand still: what is not played in time is left
    /// out.
    pub fn steered_by(mut self, control: Control) -> Session {
        self.control = Some(control);
        self
    }

    /// What was changed by hand so far; `None` without a control.
    pub fn steered(&self) -> Option<&Steered> {
        self.control.as_ref().map(Control::steered)
    }

    /// Has messages also carry the newest that their senders hold of others, if so.
    pub fn relaying(mut self, relay: bool) -> Session {
        self.stage = self.stage.relaying(relay);
        self
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

    /// Plays all episodes numbered below `end` that it has not played, or until an observer has seen enough or it is told
    /// to end.
    ///
    /// # Errors
    /// `Usage` if the links postpone by more than the team was started for, or a control asks for what cannot be;
    /// `Interrupted` if the program was asked to
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
        if self.stage.relays() != team.relays() {
            return Err(usage!(
                "one of this session and its team relays, and the other does not; start the team with settings whose `relay` \
                 is {}",
                self.stage.relays()
            ));
        }
        let is_ended = |session: &Session| session.steered().is_some_and(|steered| steered.ended);
        let have_seen_enough = |all: &[&mut dyn Observer]| all.iter().any(|one| one.has_seen_enough());
        while self.next_episode() < end && !have_seen_enough(observers) && !is_ended(self) {
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
        let Session { stage, chaos, control, orders, decisions } = self;
        let mut muster = |stage: &mut Stage, team: &mut _, orders: &mut Vec<Order>| {
            let Tick { episode, step, .. } = stage.tick();
            orders.extend(chaos.iter_mut().flat_map(|chaos| chaos.orders(episode, step)));
            let absent = Team::muster(team, orders)?;
            orders.clear();
            stage.draw_links(absent)
        };
        stage.begin_episodes(end)?;
        observers.iter_mut().try_for_each(|observer| observer.begin_episodes(stage))?;
        stage.sense()?;
        while stage.is_playing() {
            signals::check_stop()?;
            if observers.iter().any(|observer| observer.has_seen_enough()) {
                return Ok(());
            }
            if let Some(control) = control
                && !control.await_tick(stage, orders)?
            {
                return Ok(());
            }
            muster(stage, team, orders)?;
            let exchange = Instant::now();
            team.tick(&stage.tick(), decisions)?;
            let exchange = exchange.elapsed();
            stage.lose(decisions);
            observers.iter_mut().try_for_each(|observer| observer.ticked(stage, decisions, exchange))?;
            stage.step_worlds(decisions)?;
            observers.iter_mut().try_for_each(|observer| observer.stepped(stage, decisions))?;
            stage.sense()?;
        }
        if observers.iter().any(|observer| observer.wants_last_tick()) {
            muster(stage, team, orders)?;
            team.tick(&stage.tick(), decisions)?;
            observers.iter_mut().try_for_each(|observer| observer.last_ticked(stage, decisions))?;
        }
        observers.iter_mut().try_for_each(|observer| observer.end_episodes(stage))
    }
}
