//! Who is there: the presence of each agent's process, and what befell it.

use std::fmt;
use std::time::{Duration, Instant};

use crate::base::distribution::Distribution;

/// What a swarm does when an agent dies or hangs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum OnFailure {
    /// End the swarm.
    #[default]
    Abort,
    /// Play on without the agent: to its peers it is a lost link.
    Continue,
    /// Start the agent anew; until it is back, play on without it.
    Restart,
}

/// How an agent was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Loss {
    /// Its process has ended; how, and what it said last.
    Died(String),
    /// It did not do its part in time, or did something else, so it was killed.
    Hung(String),
}

/// What befell the agents of a swarm, but for what was injected on purpose.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    /// Agents whose process ended.
    pub deaths: u64,
    /// Agents that did not answer, or not with what an answer can be, and were killed.
    pub hangs: u64,
    /// Agents that were started anew and got ready, those that were killed on purpose too.
    pub restarts: u64,
    /// How long that took, from the moment the loss was noticed, or the absence was over.
    pub rejoin: Distribution,
    /// What happened, in words: the first [`Faults::TOLD`] losses.
    pub told: Vec<String>,
}

/// The agents of a swarm.
#[derive(Debug)]
pub(super) struct Roster {
    agents: Vec<Entry>,
    on_failure: OnFailure,
    pub(super) faults: Faults,
}

#[derive(Debug)]
struct Entry {
    presence: Presence,
    /// How often it has been started before.
    incarnation: u32,
    /// When it was started last.
    started: Instant,
    /// Starts in a row after which it did not decide once.
    failed_starts: u32,
    /// Whether it has decided since it was started.
    has_decided: bool,
    /// Ticks in a row in which it was there but did not decide.
    missed: u64,
}

/// Whether an agent is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Presence {
    There,
    /// Stopped on purpose, until it is told to go on.
    Stopped,
    /// Killed on purpose, until it is told to return.
    Away,
    /// To be started since this moment.
    Due(Instant),
    /// Started, but not ready. It is missed since this moment.
    Starting(Instant),
    /// Gone for good.
    Lost,
}

/// An agent that does not come to a decision after so many starts in a row never will.
const MOST_FAILED_STARTS: u32 = 3;

impl Faults {
    /// So many losses are told in words.
    pub const TOLD: usize = 20;

    /// Whether anything happened.
    pub fn is_empty(&self) -> bool {
        self.deaths + self.hangs + self.restarts == 0
    }
}

impl Roster {
    /// What to do from now on when an agent is lost.
    pub(super) fn set_on_failure(&mut self, on_failure: OnFailure) {
        self.on_failure = on_failure;
    }

    /// Everybody is there, for the first time.
    pub(super) fn new(agents: usize, on_failure: OnFailure) -> Roster {
        let entry = || Entry {
            presence: Presence::There,
            incarnation: 0,
            started: Instant::now(),
            failed_starts: 0,
            has_decided: false,
            missed: 0,
        };
        Roster { agents: (0..agents).map(|_| entry()).collect(), on_failure, faults: Faults::default() }
    }

    /// Whether an agent that is lost ends the swarm.
    pub(super) fn aborts(&self) -> bool {
        self.on_failure == OnFailure::Abort
    }

    pub(super) fn presence(&self, agent: usize) -> Presence {
        self.agents[agent].presence
    }

    pub(super) fn set(&mut self, agent: usize, presence: Presence) {
        self.agents[agent].presence = presence;
    }

    /// How often an agent has been started before.
    pub(super) fn incarnation(&self, agent: usize) -> u32 {
        self.agents[agent].incarnation
    }

    /// The agents that are not there, bit by bit.
    pub(super) fn absent(&self) -> u64 {
        self.bits(|presence| presence != Presence::There)
    }

    /// The agents that are there, bit by bit.
    pub(super) fn present(&self) -> u64 {
        self.bits(|presence| presence == Presence::There)
    }

    fn bits(&self, of: impl Fn(Presence) -> bool) -> u64 {
        self.bits_of(|entry| of(entry.presence))
    }

    fn bits_of(&self, of: impl Fn(&Entry) -> bool) -> u64 {
        let agents = self.agents.iter().enumerate();
        agents.fold(0, |bits, (agent, entry)| bits | u64::from(of(entry)) << agent)
    }

    /// The agents that are to be started now.
    pub(super) fn due(&self) -> impl Iterator<Item = usize> + use<> {
        members_of(self.bits(|presence| matches!(presence, Presence::Due(_))))
    }

    /// The agents that were started but are not ready.
    pub(super) fn starting(&self) -> impl Iterator<Item = usize> + use<> {
        members_of(self.bits(|presence| matches!(presence, Presence::Starting(_))))
    }

    /// Notes that an agent was lost. Returns whether it is to be given up: a swarm cannot go on like that.
    pub(super) fn lose(&mut self, agent: usize, tick: u64, loss: &Loss) -> bool {
        match loss {
            Loss::Died(_) => self.faults.deaths += 1,
            Loss::Hung(_) => self.faults.hangs += 1,
        }
        if self.faults.told.len() < Faults::TOLD {
            self.faults.told.push(format!("agent-{agent} {loss} (tick {tick})"));
        }
        let entry = &mut self.agents[agent];
        entry.failed_starts += u32::from(!entry.has_decided);
        entry.presence = match (self.on_failure, entry.presence) {
            (OnFailure::Continue, Presence::There | Presence::Stopped) => Presence::Lost,
            _ => Presence::Due(Instant::now()),
        };
        entry.failed_starts >= MOST_FAILED_STARTS
    }

    /// Notes that an agent is being started. Returns its incarnation.
    pub(super) fn start(&mut self, agent: usize) -> u32 {
        let entry = &mut self.agents[agent];
        let since = if let Presence::Due(since) = entry.presence { since } else { Instant::now() };
        entry.presence = Presence::Starting(since);
        (entry.started, entry.has_decided, entry.missed) = (Instant::now(), false, 0);
        entry.incarnation += 1;
        entry.incarnation
    }

    /// Notes that an agent is ready.
    pub(super) fn ready(&mut self, agent: usize) {
        let entry = &mut self.agents[agent];
        if let Presence::Starting(since) = entry.presence {
            self.faults.restarts += 1;
            self.faults.rejoin.record(since.elapsed().as_nanos() as u64);
            entry.presence = Presence::There;
        }
    }

    /// The agents that were started anew and have not decided since, bit by bit.
    pub(super) fn anew(&self) -> u64 {
        self.bits_of(|entry| entry.incarnation > 0 && !entry.has_decided)
    }

    /// Notes who has decided at a tick, bit by bit.
    pub(super) fn answered(&mut self, answered: u64) {
        for (agent, entry) in self.agents.iter_mut().enumerate() {
            if answered >> agent & 1 == 1 {
                (entry.failed_starts, entry.has_decided, entry.missed) = (0, true, 0);
            } else if entry.presence == Presence::There {
                entry.missed += 1;
            } else {
                entry.missed = 0;
            }
        }
    }

    /// The agents that have missed more ticks in a row than this, bit by bit.
    pub(super) fn silent(&self, longest: u64) -> u64 {
        self.bits_of(|entry| entry.missed > longest)
    }

    /// The agents that were started longer ago than this and are not ready yet, bit by bit.
    pub(super) fn starting_for(&self, longest: Duration) -> u64 {
        let starting = |entry: &Entry| matches!(entry.presence, Presence::Starting(_));
        self.bits_of(|entry| starting(entry) && entry.started.elapsed() > longest)
    }

    /// Whether all agents are gone for good.
    pub(super) fn is_deserted(&self) -> bool {
        self.agents.iter().all(|entry| entry.presence == Presence::Lost)
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (Loss::Died(words) | Loss::Hung(words)) = self;
        f.write_str(words)
    }
}

/// The agents whose bits are set.
pub(crate) fn members_of(bits: u64) -> impl Iterator<Item = usize> {
    (0..u64::BITS as usize).filter(move |agent| bits >> agent & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn died() -> Loss {
        Loss::Died("was killed by signal 9".to_owned())
    }

    #[test]
    fn who_is_lost_is_absent_until_ready_again() {
        let mut roster = Roster::new(3, OnFailure::Restart);
        assert_eq!((roster.present(), roster.absent()), (0b111, 0));
        assert!(!roster.lose(1, 7, &died()));
        assert_eq!((roster.present(), roster.due().collect::<Vec<_>>()), (0b101, vec![1]));
        assert_eq!((roster.start(1), roster.absent(), roster.due().count()), (1, 0b010, 0));
        roster.ready(1);
        assert_eq!((roster.absent(), roster.faults.deaths, roster.faults.restarts), (0, 1, 1));
        assert_eq!(roster.faults.told, ["agent-1 was killed by signal 9 (tick 7)"]);
    }

    #[test]
    fn without_restarts_the_lost_stay_away_but_those_killed_on_purpose_return() {
        let mut roster = Roster::new(2, OnFailure::Continue);
        roster.lose(0, 1, &died());
        assert_eq!((roster.presence(0), roster.due().count()), (Presence::Lost, 0));
        roster.set(1, Presence::Due(Instant::now()));
        roster.start(1);
        assert!(!roster.lose(1, 2, &died()), "it died before it was ready, and is tried again");
        assert_eq!(roster.due().collect::<Vec<_>>(), [1]);
    }

    #[test]
    fn an_agent_that_never_gets_ready_is_given_up() {
        let mut roster = Roster::new(1, OnFailure::Restart);
        roster.answered(0b1);
        assert!(!roster.lose(0, 0, &died()));
        let gives_up = |roster: &mut Roster| {
            roster.start(0);
            roster.lose(0, 0, &died())
        };
        assert_eq!([(); 3].map(|()| gives_up(&mut roster)), [false, false, true]);
    }

    #[test]
    fn who_misses_too_many_ticks_in_a_row_is_silent() {
        let mut roster = Roster::new(3, OnFailure::Restart);
        roster.set(2, Presence::Stopped);
        (0..3).for_each(|_| roster.answered(0b001));
        assert_eq!((roster.silent(3), roster.silent(2)), (0, 0b010));
        roster.answered(0b011);
        assert_eq!(roster.silent(0), 0);
    }

    #[test]
    fn starts_are_watched_and_a_swarm_without_agents_is_deserted() {
        let mut roster = Roster::new(1, OnFailure::Continue);
        roster.set(0, Presence::Due(Instant::now()));
        roster.start(0);
        assert_eq!(roster.starting_for(Duration::from_secs(60)), 0);
        std::thread::sleep(Duration::from_millis(1));
        assert_eq!(roster.starting_for(Duration::ZERO), 1);
        roster.ready(0);
        assert!(!roster.is_deserted());
        roster.lose(0, 1, &died());
        assert!(roster.is_deserted());
    }
}
