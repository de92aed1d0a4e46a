//! The supervisor: owns the worlds, the clock and the seeds, and the agents' processes.
//!
//! [`Session`] plays episodes with a [`Team`], in lockstep or by the clock: agents that run as processes of their own
//! ([`Processes`]) or within this one ([`InProcess`]). [`Observer`]s look on.

mod answers;
mod arrivals;
mod audit;
mod chaos;
mod chaos_spec;
mod chronicle;
mod clock;
mod command;
mod control;
mod deadlines;
mod draws;
mod elsewhere;
mod examination;
mod hosted;
mod in_process;
mod launch;
mod ledger;
mod needs;
mod observer;
mod processes;
mod punctuality;
mod recorder;
mod recovery;
mod relays;
mod roster;
mod session;
pub mod signals;
mod speakers;
mod stage;
mod statistics;
mod stderr;
mod watcher;

pub(crate) use arrivals::Arrivals;
pub use audit::Audit;
pub use chaos::{Event, Injected, Order};
pub(crate) use chaos_spec::parse_duration;
pub use chaos_spec::{ChaosSpec, Injection};
pub use command::AgentCommand;
pub use control::{Command, Control, Steered};
pub use deadlines::Deadlines;
#[cfg(feature = "hosts")]
pub(crate) use elsewhere::Elsewhere;
pub use elsewhere::HostReport;
pub use examination::{Check, Examination};
pub use hosted::Hosted;
pub use in_process::InProcess;
pub(crate) use launch::Children;
pub use ledger::Ledger;
#[cfg(feature = "hosts")]
pub(crate) use needs::{allow_open_files, check_tasks, reserve_shared_memory};
pub(crate) use needs::{check_shared_memory, tasks_needed};
pub use observer::Observer;
pub use processes::{Conduct, Processes};
pub use punctuality::Punctuality;
pub use recorder::Recorder;
pub(crate) use relays::Relays;
use roster::Loss;
pub(crate) use roster::members_of;
pub use roster::{Faults, OnFailure};
pub use session::Session;
pub use stage::Stage;
pub use statistics::{EpisodeStatistics, Statistics};
#[cfg(feature = "hosts")]
pub(crate) use stderr::say;
#[cfg(feature = "view")]
pub(crate) use stderr::{hold_words, release_words};

use self::draws::ActionDraws;
use crate::base::error::Result;
use crate::bus::{Decision, DecisionTimes, Header, Layout, NOT_ARRIVED, Sensor, now_ns};
use crate::environment::Spec;
use crate::failed;
use crate::nn::kernels::all_finite;
use crate::recording::Action;

/// What the supervisor gives a team at a tick.
#[derive(Clone, Copy, Debug)]
pub struct Tick<'a> {
    /// Episode of world 0; world w plays episode + w.
    pub episode: u64,
    /// Step within the episode.
    pub step: u32,
    /// Ticks since the team started.
    pub tick: u64,
    /// Size of the team.
    pub agents: usize,
    /// Worlds that are played.
    pub worlds: usize,
    /// The agents that are not there, bit by bit.
    pub absent: u64,
    /// What was carried out at the step before, zeros at the first of an episode, `[agents, worlds, action]`.
    pub carried_out: &'a [u32],
    /// Padded observations, `[agents, worlds, observation]`.
    pub observations: &'a [f32],
    /// How old what arrives at each agent from each sender is, or [`NOT_ARRIVED`], `[agents, worlds, agents]`. Where agents
    /// relay it may have come through others.
    pub ages: &'a [u8],
    /// The same of the messages that arrive: of what comes from the sender itself.
    pub messages: &'a [u8],
    /// Where agents relay, how old the newest is that each agent can hold of each other now, `[agents, worlds, agents]`.
    pub held: &'a [u8],
    /// The same of what they told at this tick, before anything arrived.
    pub told: &'a [u8],
}

/// What a team answers.
#[derive(Clone, Debug, Default)]
pub struct Decisions {
    /// `[agents, worlds, width]`, see [`ActionSpace`](crate::environment::ActionSpace).
    pub actions: Vec<u32>,
    /// How old what had reached each agent from each sender was, or [`NOT_ARRIVED`], `[agents, worlds, agents]`.
    pub ages: Vec<u8>,
    /// The policies' inputs, `[agents, worlds, joint]`.
    pub estimates: Vec<f32>,
    /// `[agents, worlds, n_actions]`; empty unless the agents' settings ask for them.
    pub logits: Vec<f32>,
    /// The agents that did not decide in time, bit by bit. Against the clock their actions are those of the tick before,
    /// or 0 if the episode has just begun; in lockstep they are 0. What else there is of them is old.
    pub missing: u64,
    /// Those of them that were not there: absent from the beginning of the tick, or lost in it.
    pub absent: u64,
    /// Those that decided for the first time since they were started anew: they remember nothing.
    pub anew: u64,
    /// When each agent did what it does in a tick.
    pub times: Vec<AgentTimes>,
}

/// When an agent did what it does in a tick, by its own word: nanoseconds of the monotonic clock of the supervisor's
/// machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AgentTimes {
    /// It published its observation.
    pub published_ns: u64,
    /// It had all observations, and had fused them.
    pub decision: DecisionTimes,
    /// It published its decision.
    pub decided_ns: u64,
}

/// A team of agents.
pub trait Team {
    /// Gets ready for the next tick: carries out what is ordered, and takes back whom it can. Returns the agents that will
    /// not be there, bit by bit.
    ///
    /// # Errors
    /// `Lost` if an agent is lost for good and must not be.
    fn muster(&mut self, orders: &[Order]) -> Result<u64>;

    /// Gives every agent its own observation and says what arrives at it, lets them exchange observations, and
    /// returns when all have decided: in lockstep, unless the team keeps to a clock.
    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()>;

    /// The most ticks by which links may postpone what it exchanges: the [`AgentSettings`](crate::agent::AgentSettings) it
    /// was started with say so.
    fn longest_delay(&self) -> u8 {
        0
    }

    /// Whether its agents relay: the same say so.
    fn relays(&self) -> bool {
        false
    }

    /// Gives the agents new weights, in the order of [`Policy::copy_values`](crate::nn::Policy::copy_values).
    /// They are in force from the next tick that begins an episode.
    ///
    /// # Errors
    /// `Failed` if there are too many or too few, one is not finite, or the team cannot take them:
    /// [`Processes`] must play a [policy in training](crate::agent::PolicySource::Training), and an episode
    /// must have begun with the last ones, of which there is one copy for all.
    fn renew(&mut self, weights: &[f32]) -> Result<()>;
}

/// An error if these cannot be the `expected` weights of a policy: agents act on what they are given.
fn check_weights(expected: usize, weights: &[f32]) -> Result<()> {
    if weights.len() != expected {
        return Err(failed!("a team got {} new weights, its policy has {expected}", weights.len()));
    }
    if all_finite(weights) {
        return Ok(());
    }
    let at = weights.iter().position(|weight| !weight.is_finite()).expect("not all are finite");
    Err(failed!("new weight {at} is {}: training went astray, try smaller steps", weights[at]))
}

impl Tick<'_> {
    /// How old what arrives at one agent in one world is, by sender.
    pub fn arriving(&self, agent: usize, world: usize) -> &[u8] {
        &self.ages[(agent * self.worlds + world) * self.agents..][..self.agents]
    }

    /// How old the messages that arrive at one agent in one world are, by sender.
    pub fn messages(&self, agent: usize, world: usize) -> &[u8] {
        &self.messages[(agent * self.worlds + world) * self.agents..][..self.agents]
    }

    /// Whether agents relay.
    pub fn relays(&self) -> bool {
        !self.held.is_empty()
    }

    /// Where agents relay, how old the newest is that one agent in one world can hold of each other now.
    fn held(&self, agent: usize, world: usize) -> &[u8] {
        &self.held[(agent * self.worlds + world) * self.agents..][..self.agents]
    }

    /// The same of what it told at this tick.
    fn told(&self, agent: usize, world: usize) -> &[u8] {
        &self.told[(agent * self.worlds + world) * self.agents..][..self.agents]
    }

    /// The padded observation of one agent in one world.
    pub fn observation(&self, spec: &Spec, agent: usize, world: usize) -> &[f32] {
        let length = spec.padded_obs_dim();
        &self.observations[(agent * self.worlds + world) * length..][..length]
    }

    /// The parts of a sensor message's header that are the same for all agents.
    fn header(&self, words: usize) -> Header {
        Header {
            episode: self.episode,
            step: self.step,
            tick: self.tick,
            worlds: self.worlds as u32,
            length: words as u64,
            sent_ns: now_ns(),
            absent: self.absent,
            ..Header::default()
        }
    }

    /// Writes the sensor message of one agent: its own observations, draws, and what arrives at it, nobody else's.
    fn write(&self, agent: usize, layout: &Layout, draws: &ActionDraws, words: &mut [u32]) {
        let mine = agent * self.worlds..(agent + 1) * self.worlds;
        let observations = &self.observations[mine.start * layout.observation..mine.end * layout.observation];
        let ages = &self.messages[mine.start * layout.agents..mine.end * layout.agents];
        let carried_out = &self.carried_out[mine.start * layout.action..mine.end * layout.action];
        let draws = &draws.all()[mine];
        layout.write_sensor(words, &Sensor { carried_out, ages, draws, observations });
    }
}

impl Decisions {
    /// Makes room for a team of `agents` in `worlds` worlds.
    fn resize(&mut self, agents: usize, worlds: usize, layout: &Layout) {
        let rows = agents * worlds;
        self.actions.resize(rows * layout.action, 0);
        self.ages.resize(rows * agents, NOT_ARRIVED);
        self.estimates.resize(rows * layout.joint, 0.0);
        self.logits.resize(rows * layout.logits, 0.0);
        self.times.resize(agents, AgentTimes::default());
    }

    /// In lockstep, agents that are not there do nothing: their actions are 0.
    fn leave_out(&mut self, absent: u64) {
        (self.missing, self.absent) = (absent, absent);
        let each = self.actions.len() / self.times.len();
        for agent in members_of(absent) {
            self.actions[agent * each..][..each].fill(0);
        }
    }

    /// What an agent did in a world.
    fn action(&self, spec: &Spec, tick: &Tick, agent: usize, world: usize) -> Action {
        let width = spec.action_width();
        let words = &self.actions[(agent * tick.worlds + world) * width..][..width];
        Action::of(&spec.agents[agent].actions, words)
    }

    /// The agents of a team of so many that decided in time.
    fn present(&self, agents: usize) -> impl Iterator<Item = usize> + use<> {
        let missing = self.missing;
        (0..agents).filter(move |agent| missing >> agent & 1 == 0)
    }

    /// What is wrong with a decision, if it is none that this agent can make.
    fn fault_of(spec: &Spec, agent: usize, decision: &Decision) -> Option<String> {
        let space = &spec.agents[agent].actions;
        let mut actions = decision.actions.chunks_exact(spec.action_width());
        if let Some(action) = actions.find(|action| !space.contains(action)) {
            return Some(format!("chose an action it does not have: {action:?} of {space:?}"));
        }
        let numbers = all_finite(decision.estimates) && all_finite(decision.logits);
        (!numbers).then(|| "decided on a joint estimate or logits that are not numbers".to_owned())
    }

    /// Takes in one agent's decision for all worlds of a tick.
    fn take(&mut self, agent: usize, decision: &Decision) {
        let (actions, ages) = (decision.actions, decision.ages);
        let (estimates, logits) = (decision.estimates, decision.logits);
        self.actions[agent * actions.len()..][..actions.len()].copy_from_slice(actions);
        self.estimates[agent * estimates.len()..][..estimates.len()].copy_from_slice(estimates);
        self.ages[agent * ages.len()..][..ages.len()].copy_from_slice(ages);
        self.logits[agent * logits.len()..][..logits.len()].copy_from_slice(logits);
        self.times[agent].decision = decision.times;
    }

    /// An error if a decision of this tick does not rest on all that the links delivered of those who are there.
    ///
    /// In lockstep, a team in which somebody was late, however that came about, would give another result than the
    /// same team undisturbed.
    fn check_nobody_late(&self, tick: &Tick) -> Result<()> {
        let place = |at: usize| (at % tick.agents, at / (tick.agents * tick.worlds));
        let absent =
            |(sender, agent): (usize, usize)| (self.absent >> sender | self.absent >> agent) & 1 == 1;
        // What somebody was to pass on who was lost in this tick may have come otherwise, or not at all.
        let somebody_was_lost = tick.relays() && self.absent & !tick.absent != 0;
        let is_sure = |at: &usize| !somebody_was_lost || tick.ages[*at] == tick.messages[*at];
        // Nothing gets in that did not arrive, so what differs is missing.
        let differs = |at: &usize| tick.ages[*at] != self.ages[*at] && is_sure(at);
        let mut late = (0..self.ages.len()).filter(differs).map(place);
        match late.find(|place| !absent(*place)) {
            None => Ok(()),
            Some((late, agent)) => {
                Err(failed!("agent-{late} was too late for agent-{agent}; ending the swarm"))
            }
        }
    }

    /// What one agent in one world imagined of each peer it did not hear: the sum of its squared errors.
    pub(crate) fn imputation_errors(
        &self,
        spec: &Spec,
        tick: &Tick,
        agent: usize,
        world: usize,
    ) -> impl Iterator<Item = f64> {
        let (joint, unique, used) = (spec.joint_dim(), spec.unique_dim(), self.used(tick, agent, world));
        let estimate = &self.estimates[(agent * tick.worlds + world) * joint..][..joint];
        (0..tick.agents).filter(|sender| used[*sender] != 0).map(move |sender| {
            let (imputed, truth) = (&estimate[sender * unique..], tick.observation(spec, sender, world));
            let squares = imputed.iter().zip(&truth[..unique]).map(|(a, b)| f64::from(a - b).powi(2));
            squares.sum()
        })
    }

    /// How old what had reached one agent in one world was, by sender.
    pub fn used(&self, tick: &Tick, agent: usize, world: usize) -> &[u8] {
        &self.ages[(agent * tick.worlds + world) * tick.agents..][..tick.agents]
    }
}
