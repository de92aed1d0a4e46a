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
pub enum Loss {
    /// Its process has ended; how, and what it said last.
    Died(String),
    /// It did not do its part in time, so it was killed.
    Hung(String),
}

/// What befell the agents of a swarm, but for what was injected on purpose.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    /// Agents whose process ended.
    pub deaths: u64,
    /// Agents that did not answer, and were killed.
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
    /// Starts in a row after which it did not get ready.
    failed_starts: u32,
    /// When it last answered, nanoseconds of the monotonic clock; by the clock only.
    answered_ns: u64,
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

/// An agent that does not get ready so often in a row never will.
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
    /// Everybody is there, for the first time.
    pub(super) fn new(agents: usize, on_failure: OnFailure) -> Roster {
        let entry = || Entry { presence: Presence::There, incarnation: 0, failed_starts: 0, answered_ns: 0 };
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
        let agents = self.agents.iter().enumerate();
        agents.fold(0, |bits, (agent, entry)| bits | u64::from(of(entry.presence)) << agent)
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
        entry.failed_starts += u32::from(matches!(entry.presence, Presence::Starting(_)));
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
        entry.incarnation += 1;
        entry.incarnation
    }

    /// Notes that an agent is ready, at this moment of the monotonic clock.
    pub(super) fn ready(&mut self, agent: usize, now_ns: u64) {
        let entry = &mut self.agents[agent];
        if let Presence::Starting(since) = entry.presence {
            self.faults.restarts += 1;
            self.faults.rejoin.record(since.elapsed().as_nanos() as u64);
        }
        (entry.presence, entry.failed_starts, entry.answered_ns) = (Presence::There, 0, now_ns);
    }

    /// Notes who has answered at a tick that ended at this moment of the monotonic clock. Returns the agents that are there
    /// but have not answered for longer than this.
    pub(super) fn silent(&mut self, answered: u64, now_ns: u64, longest: Duration) -> u64 {
        let mut silent = 0;
        for (agent, entry) in self.agents.iter_mut().enumerate() {
            if answered >> agent & 1 == 1 || entry.presence != Presence::There || entry.answered_ns == 0 {
                entry.answered_ns = now_ns;
            }
            silent |= u64::from(now_ns - entry.answered_ns > longest.as_nanos() as u64) << agent;
        }
        silent
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (Loss::Died(words) | Loss::Hung(words)) = self;
        f.write_str(words)
    }
}

/// The agents whose bits are set.
pub(super) fn members_of(bits: u64) -> impl Iterator<Item = usize> {
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
        roster.ready(1, 5);
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
        assert!(!roster.lose(0, 0, &died()));
        let gives_up = |roster: &mut Roster| {
            roster.start(0);
            roster.lose(0, 0, &died())
        };
        assert_eq!([(); 3].map(|()| gives_up(&mut roster)), [false, false, true]);
    }

    #[test]
    fn who_does_not_answer_for_too_long_is_silent() {
        let (mut roster, second) = (Roster::new(3, OnFailure::Restart), Duration::from_secs(1));
        assert_eq!(roster.silent(0, 1, second), 0, "the first tick is the first chance");
        roster.set(2, Presence::Stopped);
        assert_eq!(roster.silent(0b001, 900_000_000, second), 0);
        assert_eq!(roster.silent(0b001, 1_000_000_002, second), 0b010);
    }
}
