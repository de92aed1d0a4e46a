//! The supervisor's side of a tick: worlds, sensors and links.

use std::fmt;

use super::arrivals::Arrivals;
use super::roster::members_of;
use super::{Decisions, Relays, Tick};
use crate::agent::is_observable;
use crate::base::error::Result;
use crate::bus::Layout;
use crate::environment::{End, Environment, Outcome, Spec};
use crate::failed;
use crate::link::{Address, Context, Fates, Links};

/// Parallel worlds that play consecutive episodes, step by step together. Episodes may end early: a world that is
/// done idles until all of them are.
pub struct Stage {
    environment: Box<dyn Environment>,
    spec: Spec,
    links: Links,
    /// What becomes of what is sent in one world.
    fates: Fates,
    /// What is under way in each world.
    arrivals: Vec<Arrivals>,
    /// What agents hold in each world; nothing if they do not relay.
    relays: Vec<Relays>,
    seed: u64,
    /// Episode of world 0; world w plays episode + w.
    episode: u64,
    next_episode: u64,
    step: u32,
    /// Ticks so far. Agents start at tick 0, so the first one is 1.
    tick: u64,
    /// The agents that are not there, bit by bit.
    absent: u64,
    /// What was carried out at the step before, `[agents, active, action]`.
    carried_out: Vec<u32>,
    /// Padded observations, `[agents, active, observation]`.
    observations: Vec<f32>,
    /// How old what arrives is, `[agents, active, agents]`.
    ages: Vec<u8>,
    /// Where agents relay, how old the messages are that bring it, what each agent can hold, and what each told.
    messages: Vec<u8>,
    held: Vec<u8>,
    told: Vec<u8>,
    /// Worlds whose episodes are under way, `[active]`. Fewer than all worlds are active in the last batch.
    playing: Vec<bool>,
    /// Worlds that took the last step, `[active]`.
    stepped: Vec<bool>,
    /// Of the last step, `[active, ..]`.
    outcome: Outcome,
}

impl Stage {
    /// A stage of all worlds of an environment.
    pub fn new(environment: Box<dyn Environment>, links: Links, seed: u64) -> Stage {
        Stage {
            spec: environment.spec().clone(),
            fates: Fates::new(environment.spec().n_agents()),
            arrivals: vec![
                Arrivals::new(environment.spec().n_agents(), links.longest_delay());
                environment.worlds()
            ],
            relays: Vec::new(),
            environment,
            links,
            seed,
            episode: 0,
            next_episode: 0,
            step: 0,
            tick: 0,
            absent: 0,
            carried_out: Vec::new(),
            observations: Vec::new(),
            ages: Vec::new(),
            messages: Vec::new(),
            held: Vec::new(),
            told: Vec::new(),
            playing: Vec::new(),
            stepped: Vec::new(),
            outcome: Outcome::default(),
        }
    }

    /// Begins with this episode instead of number 0.
    pub fn starting_at(mut self, episode: u64) -> Stage {
        self.next_episode = episode;
        self
    }

    /// Has messages also carry the newest that their senders hold of others, if so.
    pub fn relaying(mut self, relay: bool) -> Stage {
        let relays = Relays::new(self.spec.n_agents(), self.longest_delay());
        self.relays = vec![relays; if relay { self.environment.worlds() } else { 0 }];
        self
    }

    /// Whether messages also carry the newest that their senders hold of others.
    pub fn relays(&self) -> bool {
        !self.relays.is_empty()
    }

    /// From here on draws have this seed, and the next episode this number.
    #[cfg(feature = "python")]
    pub(crate) fn start_over(&mut self, seed: u64, episode: u64) {
        (self.seed, self.next_episode) = (seed, episode);
    }

    /// What the environment is.
    pub fn spec(&self) -> &Spec {
        &self.spec
    }

    /// The environment, whose first [`worlds`](Stage::worlds) worlds play.
    pub fn environment(&self) -> &dyn Environment {
        &*self.environment
    }

    /// Seed of all draws.
    pub(super) fn seed(&self) -> u64 {
        self.seed
    }

    /// The one probability with which every link delivers in an episode, if there is one.
    pub fn level(&self, episode: u64) -> Option<f64> {
        self.links.level_of(self.seed, episode)
    }

    /// The probability with which the first level in the chain of links delivers, to be changed between ticks; `None` if
    /// there is no level.
    pub(super) fn dial(&mut self) -> Option<&mut f64> {
        self.links.dial()
    }

    /// The most ticks by which anything is postponed.
    pub fn longest_delay(&self) -> u8 {
        self.links.longest_delay()
    }

    /// How many observations at this tick are older than what their receivers have seen, and so are not shown.
    pub fn outdated(&self, world: usize) -> u64 {
        self.arrivals[world].outdated()
    }

    /// The number of worlds in which an episode has begun.
    pub fn worlds(&self) -> usize {
        self.playing.len()
    }

    /// The first episode that has not been begun.
    pub fn next_episode(&self) -> u64 {
        self.next_episode
    }

    /// Whether an episode is under way in any world.
    pub fn is_playing(&self) -> bool {
        self.playing.contains(&true)
    }

    /// Whether the episode of this world is under way.
    pub fn plays(&self, world: usize) -> bool {
        self.playing[world]
    }

    /// The worlds whose episodes are under way.
    pub fn playing(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.worlds()).filter(|world| self.playing[*world])
    }

    /// The worlds that took the last step.
    pub fn stepped(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.worlds()).filter(|world| self.stepped[*world])
    }

    /// What each agent of a world earned in its last step.
    pub fn rewards(&self, world: usize) -> &[f64] {
        let agents = self.spec.n_agents();
        &self.outcome.rewards[world * agents..(world + 1) * agents]
    }

    /// What each agent of each world earned in its last step, `[worlds, agents]`.
    #[cfg(feature = "python")]
    pub(crate) fn all_rewards(&self) -> &[f64] {
        &self.outcome.rewards
    }

    /// What the team of a world earned in its last step.
    pub fn team_reward(&self, world: usize) -> f64 {
        self.spec.team_reward(self.rewards(world))
    }

    /// Whether and how the episode of a world is over.
    pub fn end(&self, world: usize) -> End {
        self.outcome.ends[world]
    }

    /// Begins an episode in every world, up to the episode numbered `end`.
    pub fn begin_episodes(&mut self, end: u64) -> Result<()> {
        self.episode = self.next_episode;
        let worlds = (end - self.episode).min(self.environment.worlds() as u64) as usize;
        self.next_episode += worlds as u64;
        self.step = 0;
        for (world, episode) in (0..worlds).zip(self.episode..) {
            self.environment.reset(world, self.seed, episode)?;
            self.links.begin(world, episode);
            self.arrivals[world].begin();
        }
        self.relays.iter_mut().for_each(Relays::begin);
        let rows = self.spec.n_agents() * worlds;
        self.carried_out.clear();
        self.carried_out.resize(rows * self.spec.action_width(), 0);
        self.ages.resize(rows * self.spec.n_agents(), 0);
        if self.relays() {
            for ages in [&mut self.messages, &mut self.held, &mut self.told] {
                ages.resize(rows * self.spec.n_agents(), 0);
            }
        }
        self.observations.resize(rows * self.spec.padded_obs_dim(), 0.0);
        self.outcome.rewards.resize(rows, 0.0);
        for (all, begun) in [(&mut self.playing, true), (&mut self.stepped, false)] {
            all.clear();
            all.resize(worlds, begun);
        }
        self.outcome.ends.clear();
        self.outcome.ends.resize(worlds, End::Open);
        Ok(())
    }

    /// Reads every agent's sensor.
    ///
    /// # Errors
    /// Whatever the environment fails with; `Failed` if a value is no number, or larger than 1e9.
    pub fn sense(&mut self) -> Result<()> {
        self.environment.observe(self.playing.len(), &mut self.observations)?;
        if is_observable(&self.observations) {
            return Ok(());
        }
        let each = self.spec.padded_obs_dim();
        let row = self.observations.chunks_exact(each).position(|row| !is_observable(row));
        let row = row.expect("a value is in a row");
        let (agent, world) = (row / self.playing.len(), row % self.playing.len());
        Err(failed!(
            "agent-{agent} observes {:?} in world {world} of {}: values must be numbers up to 1e9",
            &self.observations[row * each..][..each],
            self.spec.id
        ))
    }

    /// Draws what becomes of the observations sent at this step, and works out which arrive. Those who are `absent`, bit
    /// by bit, send nothing and receive nothing.
    ///
    /// # Errors
    /// Whatever the links fail with; `Failed` if they postpone by more than their longest delay.
    pub fn draw_links(&mut self, absent: u64) -> Result<()> {
        self.absent = absent;
        let (agents, worlds) = (self.spec.n_agents(), self.worlds());
        let bytes = Layout::radio_bytes(agents, self.spec.padded_obs_dim(), self.relays());
        for world in 0..worlds {
            let (episode, step) = (self.episode + world as u64, self.step.into());
            let address = Address { seed: self.seed, position: 0, episode, step };
            let positions = Some(self.environment.positions(world)).filter(|places| !places.is_empty());
            self.links.deliveries(&Context { address, world, bytes, positions }, &mut self.fates)?;
            for absent in members_of(absent) {
                (0..agents).for_each(|other| self.fates.cut(absent, other));
                self.arrivals[world].forget_receiver(absent);
            }
            let all = &mut self.ages;
            self.arrivals[world].send(&self.fates, |agent, ages| {
                all[(agent * worlds + world) * agents..][..agents].copy_from_slice(ages);
            })?;
            self.relay(world);
        }
        self.tick += 1;
        Ok(())
    }

    /// Works out what the messages that arrive in a world bring, where agents relay.
    fn relay(&mut self, world: usize) {
        let Some(relays) = self.relays.get_mut(world) else { return };
        let (agents, worlds) = (self.spec.n_agents(), self.playing.len());
        members_of(self.absent).for_each(|absent| relays.forget(absent));
        relays.tell();
        for agent in 0..agents {
            let row = (agent * worlds + world) * agents..(agent * worlds + world + 1) * agents;
            self.messages[row.clone()].copy_from_slice(&self.ages[row.clone()]);
            relays.receive(agent, &self.messages[row.clone()], &mut self.ages[row.clone()]);
            self.held[row.clone()].copy_from_slice(relays.held(agent));
            self.told[row].copy_from_slice(relays.told(agent));
        }
    }

    /// Takes note of agents that were lost while they decided: what they had not sent is not under way, and what was under
    /// way to them is lost. Others may have come by less than they would have through them.
    pub fn lose(&mut self, decisions: &Decisions) {
        let (worlds, agents, lost) = (self.worlds(), self.spec.n_agents(), decisions.absent & !self.absent);
        if lost == 0 {
            return;
        }
        for (world, relays) in self.relays.iter_mut().enumerate().take(worlds) {
            for agent in decisions.present(agents) {
                relays.settle(agent, &decisions.ages[(agent * worlds + world) * agents..][..agents]);
            }
        }
        for agent in members_of(lost) {
            self.relays.iter_mut().for_each(|relays| relays.forget(agent));
            for arrivals in &mut self.arrivals[..worlds] {
                arrivals.forget_receiver(agent);
                arrivals.forget_sent(agent);
            }
        }
    }

    /// What the team is given at this step.
    pub fn tick(&self) -> Tick<'_> {
        Tick {
            episode: self.episode,
            step: self.step,
            tick: self.tick,
            agents: self.spec.n_agents(),
            worlds: self.worlds(),
            absent: self.absent,
            carried_out: &self.carried_out,
            observations: &self.observations,
            ages: &self.ages,
            messages: if self.relays() { &self.messages } else { &self.ages },
            held: &self.held,
            told: &self.told,
        }
    }

    /// Carries out what was decided in the worlds that play.
    pub fn step_worlds(&mut self, decisions: &Decisions) -> Result<()> {
        self.environment.step(&decisions.actions, &self.playing, &mut self.outcome)?;
        self.carried_out.copy_from_slice(&decisions.actions);
        self.step += 1;
        self.stepped.copy_from_slice(&self.playing);
        let time_is_up = self.step as usize >= self.spec.episode_steps;
        for (plays, end) in self.playing.iter_mut().zip(&mut self.outcome.ends).filter(|(plays, _)| **plays) {
            if time_is_up && *end == End::Open {
                *end = End::Truncated;
            }
            *plays = *end == End::Open;
        }
        Ok(())
    }
}

impl fmt::Debug for Stage {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Stage { spec, links, seed, episode, step, .. } = self;
        let mut stage = f.debug_struct("Stage");
        stage.field("environment", &spec.id).field("links", links).field("seed", seed);
        stage.field("episode", episode).field("step", step).finish_non_exhaustive()
    }
}
