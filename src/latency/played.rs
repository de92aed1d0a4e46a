//! A swarm that plays to be measured.

#[cfg(feature = "hosts")]
use std::path::Path;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::pin::Pinned;
use crate::agent::{AgentSettings, PREFERRED, PolicySource, dims, paper_actor};
use crate::base::error::{Error, Result};
use crate::bus::Wait;
use crate::environment::Task;
use crate::link::Links;
use crate::nn::{Networks, Policy};
use crate::supervisor::{AgentTimes, Decisions, Observer, Processes, Session, Stage};

/// What a team of some size plays with: its task, and the paper's networks with random weights in a file.
#[derive(Debug)]
pub struct Setup {
    task: Task,
    policy: PathBuf,
    _folder: TempDir,
}

impl Setup {
    /// For a team of `agents`: `spread-blindfold` has a task for any.
    pub fn new(agents: usize) -> Result<Setup> {
        let task = Task::parse(&format!("spread-blindfold-{agents}"))?;
        let folder = tempfile::tempdir()
            .map_err(|e| Error::io("make", &std::env::temp_dir(), std::io::Error::from(e.kind())))?;
        let path = folder.path().join("policy.safetensors");
        Policy::untrained(&dims(task.spec()), 0, Networks::paper(paper_actor(task.spec())))?.save(&path)?;
        Ok(Setup { task, policy: path, _folder: folder })
    }

    /// The task.
    pub fn task(&self) -> &Task {
        &self.task
    }

    /// The file of its policy.
    #[cfg(feature = "hosts")]
    pub(super) fn policy(&self) -> &Path {
        &self.policy
    }

    /// What its agents run, in so many worlds.
    pub(super) fn settings(&self, worlds: usize) -> AgentSettings {
        let policy = PolicySource::File(self.policy.clone());
        let imputer = PREFERRED.to_owned();
        AgentSettings { policy, imputer, worlds, ..AgentSettings::of(self.task.spec()) }
    }

    /// Bytes of the observation that an agent publishes for so many worlds.
    pub fn payload(&self, worlds: usize) -> usize {
        worlds * 4 * self.task.spec().padded_obs_dim()
    }

    /// The number of worlds whose observations come closest to this many bytes.
    pub fn worlds(&self, payload: usize) -> usize {
        let one = self.payload(1);
        ((payload + one / 2) / one).max(1)
    }
}

/// A swarm of processes at play, all of whose observations are delivered.
#[derive(Debug)]
pub struct Played {
    session: Session,
    team: Processes,
}

impl Played {
    /// Starts a team in so many worlds.
    pub fn start(setup: &Setup, worlds: usize, wait: Wait) -> Result<Played> {
        Played::of(setup, worlds, |settings, policy| Processes::start(settings, policy, wait))
    }

    /// The same with a team that `start` starts.
    pub(super) fn of(
        setup: &Setup,
        worlds: usize,
        start: impl FnOnce(&AgentSettings, &Policy) -> Result<Processes>,
    ) -> Result<Played> {
        let task = &setup.task;
        let settings = setup.settings(worlds);
        let team = start(&settings, &settings.policy.load(task.spec())?)?;
        let links = Links::level(1.0);
        Ok(Played { session: Session::new(task.environment(worlds), links, settings.seed), team })
    }

    /// The agents.
    pub fn team(&self) -> &Processes {
        &self.team
    }

    /// Plays one step.
    pub fn tick(&mut self) -> Result<()> {
        self.play_until(Stopwatch::new(Duration::ZERO, 1, |_: &[AgentTimes], _| {}))
    }

    /// Plays for so long, at least ten steps, after a tenth of it to warm up, and tells `each` of the steps after that:
    /// the agents' times, and the time from the first sensor message to the last decision. Each process has a core of
    /// its own where there are enough.
    pub fn play(&mut self, longest: Duration, each: impl FnMut(&[AgentTimes], Duration)) -> Result<()> {
        let processes: Vec<u32> = self.team.process_ids().collect();
        // Where all agents are elsewhere, this one shall not be, either.
        let _pinned = (!processes.is_empty()).then(|| Pinned::new(&processes));
        self.play_until(Stopwatch::new(longest / 10, 5, |_: &[AgentTimes], _| {}))?;
        self.play_until(Stopwatch::new(longest, 10, each))
    }

    fn play_until<F: FnMut(&[AgentTimes], Duration)>(&mut self, mut stopwatch: Stopwatch<F>) -> Result<()> {
        self.session.play(&mut self.team, u64::MAX, &mut [&mut stopwatch])
    }
}

/// Ends the play when it has lasted long enough.
struct Stopwatch<F> {
    began: Instant,
    longest: Duration,
    /// Ticks that are still to be played, however long it takes.
    least: u32,
    /// Is told of each tick.
    each: F,
}

impl<F: FnMut(&[AgentTimes], Duration)> Stopwatch<F> {
    fn new(longest: Duration, least: u32, each: F) -> Stopwatch<F> {
        Stopwatch { began: Instant::now(), longest, least, each }
    }
}

impl<F: FnMut(&[AgentTimes], Duration)> Observer for Stopwatch<F> {
    fn ticked(&mut self, _stage: &Stage, decisions: &Decisions, exchange: Duration) -> Result<()> {
        self.least = self.least.saturating_sub(1);
        (self.each)(&decisions.times, exchange);
        Ok(())
    }

    fn has_seen_enough(&self) -> bool {
        self.least == 0 && self.began.elapsed() >= self.longest
    }
}
