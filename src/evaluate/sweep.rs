//! A sweep: plays every cell that is not finished yet.

use std::sync::{Mutex, PoisonError};

use super::axis::Axis;
use super::condition::Condition;
use super::evaluation::{Cell, Contender, Evaluation, Outcome, RandomTeam, Settings};
use super::play::{play, play_at_random};
use super::record::{Key, Record};
use crate::agent::{AgentSettings, PolicySource, Registry};
use crate::base::error::{Error, Result};
use crate::base::threads::side_by_side;
use crate::bus::Wait;
use crate::environment::Task;
use crate::failed;
use crate::nn::Policy;
use crate::supervisor::{InProcess, Processes, signals};

/// What is to be played, and how.
#[derive(Debug)]
pub struct Sweep {
    /// What all cells share.
    pub settings: Settings,
    /// How links behave.
    pub conditions: Vec<Condition>,
    /// Axes on which some of them are.
    pub axes: Vec<Axis>,
    /// Who plays.
    pub entrants: Vec<Entrant>,
    /// Episodes that are played side by side in each cell.
    pub worlds: usize,
    /// Where agents run.
    pub place: Place,
}

/// A policy and the imputers that it is played with.
#[derive(Debug)]
pub struct Entrant {
    /// Who it is.
    pub contender: Contender,
    /// Where agents find it.
    pub source: PolicySource,
    /// The policy.
    pub policy: Policy,
    /// Its task.
    pub task: Task,
    /// The imputers.
    pub imputers: Vec<String>,
}

/// Where agents run. It changes no result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Each is a process, one cell after the other.
    Processes(Wait),
    /// Within this process, a cell on each of so many threads.
    InProcess(usize),
}

/// A cell that is to be played. Where everything is delivered one stands for those of all imputers.
struct Job<'a> {
    entrant: &'a Entrant,
    condition: &'a Condition,
    imputer: Option<&'a str>,
}

impl Entrant {
    /// The policy called `name` on the command line, with these imputers.
    pub fn new(
        name: &str,
        source: PolicySource,
        policy: Policy,
        task: Task,
        imputers: Vec<String>,
    ) -> Entrant {
        let meta = policy.meta();
        let contender = Contender {
            name: name.to_owned(),
            task: meta.task.clone(),
            algorithm: meta.algorithm.clone(),
            seed: meta.seed,
            steps: meta.steps,
            origin: meta.origin.clone(),
            fingerprint: policy.fingerprint(),
            predictors: policy.predictor_names().map(str::to_owned).collect(),
        };
        Entrant { contender, source, policy, task, imputers }
    }

    /// Whether it is played with this imputer.
    pub fn plays(&self, imputer: &str) -> bool {
        self.imputers.iter().any(|name| name == imputer)
    }
}

impl Sweep {
    /// Plays what `record` does not have yet, keeps it there, and returns everything. `progress` is told how many
    /// cells are done, out of how many.
    ///
    /// # Errors
    /// `Interrupted` if the program was asked to stop, whatever a team or the record fails with. What is
    /// finished by then is in the record.
    pub fn run(
        &self,
        record: Option<&mut Record>,
        progress: impl Fn(usize, usize) + Sync,
    ) -> Result<Evaluation> {
        let jobs: Vec<Job> = self.jobs();
        let finished = |job: &Job| record.as_ref().and_then(|record| record.get(&job.key())).cloned();
        let known: Vec<Option<Outcome>> = jobs.iter().map(finished).collect();
        let done = known.iter().flatten().count();
        let state = Mutex::new(State { outcomes: known, record, done, failure: None });
        let lock = || state.lock().unwrap_or_else(PoisonError::into_inner);
        let left: Vec<usize> = (0..jobs.len()).filter(|at| lock().outcomes[*at].is_none()).collect();
        progress(done, jobs.len());
        side_by_side(self.threads(), left.into_iter(), |at| {
            if lock().failure.is_some() {
                return;
            }
            let played = self.play(&jobs[at]);
            let mut state = lock();
            state.take(at, &jobs[at], played);
            progress(state.done, jobs.len());
        });
        let State { outcomes, failure, .. } = state.into_inner().unwrap_or_else(PoisonError::into_inner);
        failure.map_or(Ok(()), Err)?;
        let outcomes = outcomes.into_iter().map(|outcome| outcome.expect("every job is done"));
        self.evaluation(outcomes.collect(), &jobs)
    }

    /// Entrant by entrant, condition by condition, imputer by imputer.
    fn jobs(&self) -> Vec<Job<'_>> {
        let conditions = |entrant| self.conditions.iter().map(move |condition| (entrant, condition));
        let cells = self.entrants.iter().flat_map(conditions);
        let jobs = cells.flat_map(|(entrant, condition): (&Entrant, &Condition)| {
            let imputers: Vec<_> = if condition.is_lossless() {
                vec![None]
            } else {
                entrant.imputers.iter().map(|name| Some(&name[..])).collect()
            };
            imputers.into_iter().map(move |imputer| Job { entrant, condition, imputer })
        });
        jobs.collect()
    }

    fn threads(&self) -> usize {
        match self.place {
            Place::Processes(_) => 1,
            Place::InProcess(threads) => threads,
        }
    }

    fn play(&self, job: &Job) -> Result<Outcome> {
        signals::check_stop()?;
        let Entrant { policy, task, .. } = job.entrant;
        let imputer = job.imputer.unwrap_or("hold");
        let condition = job.condition;
        // An agent is one process for all worlds, and what befalls it would befall it in all of them.
        let worlds = condition.chaos().map_or(self.worlds, |_| 1);
        let settings = self.agents(job.entrant, condition, imputer, worlds);
        let worlds = settings.worlds;
        match self.place {
            Place::Processes(wait) => {
                let mut team = Processes::start(&settings, policy, wait)?;
                play(&self.settings, policy, task, condition, imputer, worlds, &mut team)
            }
            Place::InProcess(_) => {
                let mut team = InProcess::new(&settings, policy)?;
                play(&self.settings, policy, task, condition, imputer, worlds, &mut team)
            }
        }
    }

    /// The agents of a cell, in at most so many worlds.
    pub(super) fn agents(
        &self,
        entrant: &Entrant,
        condition: &Condition,
        imputer: &str,
        worlds: usize,
    ) -> AgentSettings {
        AgentSettings {
            spec: entrant.task.spec().clone(),
            policy: entrant.source.clone(),
            imputer: imputer.to_owned(),
            registry: Registry::default(),
            greedy: self.settings.greedy,
            seed: self.settings.seed,
            worlds: worlds.min(self.settings.episodes as usize),
            longest_delay: condition.links().longest_delay(),
            relay: self.settings.relay,
            tell_logits: false,
        }
    }

    /// Puts everything together.
    fn evaluation(&self, outcomes: Vec<Outcome>, jobs: &[Job]) -> Result<Evaluation> {
        let mut random: Vec<RandomTeam> = Vec::new();
        for Entrant { task, .. } in &self.entrants {
            if random.iter().all(|team| team.task != task.id()) {
                let returns = play_at_random(&self.settings, task)?;
                random.push(RandomTeam { task: task.id().to_owned(), returns });
            }
        }
        let mut cells = Vec::new();
        for (Job { entrant, condition, imputer }, outcome) in jobs.iter().zip(outcomes) {
            let contender = self.entrants.iter().position(|other| std::ptr::eq(other, *entrant));
            let contender = contender.expect("jobs are of these entrants");
            let all = entrant.imputers.iter().map(String::as_str);
            for imputer in all.filter(|name| imputer.is_none_or(|one| one == *name)) {
                let (condition, imputer, outcome) =
                    ((*condition).clone(), imputer.to_owned(), outcome.clone());
                cells.push(Cell { contender, condition, imputer, outcome });
            }
        }
        let contenders = self.entrants.iter().map(|entrant| entrant.contender.clone()).collect();
        Ok(Evaluation { settings: self.settings.clone(), axes: self.axes.clone(), contenders, random, cells })
    }
}

impl Job<'_> {
    fn key(&self) -> Key {
        Key {
            fingerprint: self.entrant.contender.fingerprint.clone(),
            condition: serde_json::to_value(self.condition).expect("a condition is text and numbers"),
            imputer: self.imputer.map(str::to_owned),
        }
    }
}

/// What is shared by those who play.
struct State<'a> {
    outcomes: Vec<Option<Outcome>>,
    record: Option<&'a mut Record>,
    done: usize,
    /// The first thing that went wrong.
    failure: Option<Error>,
}

impl State<'_> {
    fn take(&mut self, at: usize, job: &Job, played: Result<Outcome>) {
        let kept = played.and_then(|outcome| {
            if !outcome.is_finite() {
                let (policy, imputer) = (&job.entrant.contender.name, job.key().imputer.unwrap_or_default());
                let condition = job.condition;
                return Err(failed!("{policy}, {condition}: what {imputer} imputes is not finite"));
            }
            if let Some(record) = &mut self.record {
                record.keep(&job.key(), &outcome)?;
            }
            Ok(outcome)
        });
        match kept {
            Ok(outcome) => {
                self.outcomes[at] = Some(outcome);
                self.done += 1;
            }
            Err(error) => {
                self.failure.get_or_insert(error);
            }
        }
    }
}
