//! Imputers through the library: one of one's own, in agents that are processes, and one that is learned.

// Helpers of tests are tests, which clippy does not see.
#![allow(clippy::unwrap_used)]

use crate::common;
use std::time::Duration;

use vamaro_swarm::agent::imputer::{Imputer, JointLayout, Setup, Step};
use vamaro_swarm::agent::{AgentSettings, Inbox, PolicySource, Registry};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::Links;
use vamaro_swarm::nn::Policy;
use vamaro_swarm::supervisor::{
    Conduct, Decisions, InProcess, Ledger, Observer, Processes, Session, Stage, Team,
};
use vamaro_swarm::train::{Config, Layer, Preset, Trainer};

const SEED: u64 = 6;

/// Takes what is lost for the mean of all that was received of the same sender in the episode.
#[derive(Debug)]
struct Mean {
    layout: JointLayout,
    agent: usize,
    /// `[worlds, agents, unique]`.
    sums: Vec<f32>,
    /// `[worlds, agents]`.
    counts: Vec<f32>,
}

impl Mean {
    fn make(setup: &Setup) -> Result<Box<dyn Imputer>> {
        let layout = JointLayout::of(setup.spec);
        let counts = vec![0.0; setup.worlds * layout.agents];
        let sums = vec![0.0; counts.len() * layout.unique];
        Ok(Box::new(Mean { layout, agent: setup.agent, sums, counts }))
    }
}

impl Imputer for Mean {
    fn begin_episodes(&mut self, _worlds: usize) {
        self.sums.fill(0.0);
        self.counts.fill(0.0);
    }

    fn fuse(&mut self, world: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        let JointLayout { agents, unique, .. } = self.layout;
        for sender in 0..agents {
            let at = world * agents + sender;
            let sums = &mut self.sums[at * unique..][..unique];
            let received = inbox.from(sender).map(|received| received.observation);
            if let Some(received) = received.filter(|_| sender != self.agent) {
                self.counts[at] += 1.0;
                sums.iter_mut().zip(received).for_each(|(sum, value)| *sum += value);
            }
            let count = self.counts[at].max(1.0);
            for (dim, sum) in sums.iter().enumerate() {
                let known = if sender == self.agent { Some(own) } else { received };
                estimate[sender * unique + dim] = known.map_or(sum / count, |known| known[dim]);
            }
        }
        estimate[agents * unique..].copy_from_slice(&own[unique..]);
    }

    fn predict(&mut self, _step: &Step) {}
}

/// What agents of this binary know.
pub fn registry() -> Registry {
    Registry::default().with_imputer("mean", "the mean of what was received", Mean::make)
}

/// All that the agents of an episode say, bit by bit, by world.
#[derive(Default)]
struct Heard(Vec<u32>);

impl Observer for Heard {
    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _exchange: Duration) -> Result<()> {
        assert_eq!(stage.worlds(), 1);
        self.0.extend(&decisions.actions);
        self.0.extend(decisions.estimates.iter().map(|value| value.to_bits()));
        Ok(())
    }
}

/// What is heard of a team, and the mean return of four episodes.
fn play(task: &Task, p: f64, team: &mut impl Team) -> (Vec<u32>, f64) {
    let mut session = Session::new(task.environment(1), Links::level(p), SEED);
    let (mut heard, mut ledger) = (Heard::default(), Ledger::default());
    session.play(team, 40, &mut [&mut heard, &mut ledger]).unwrap();
    let statistics = ledger.into_statistics();
    let returns: Vec<f64> = statistics.episodes().iter().map(|episode| episode.episode_return).collect();
    (heard.0, returns.iter().sum::<f64>() / returns.len() as f64)
}

fn settings(task: &Task, imputer: &str) -> AgentSettings {
    let imputer = imputer.to_owned();
    AgentSettings { imputer, registry: registry(), seed: SEED, ..AgentSettings::of(task.spec()) }
}

#[test]
fn an_imputer_of_ones_own_runs_in_processes_as_it_does_here() {
    let task = Task::parse("spread-xy-4").unwrap();
    let policy = PolicySource::Builtin.load(task.spec()).unwrap();
    let here = |imputer| play(&task, 0.4, &mut InProcess::new(&settings(&task, imputer), &policy).unwrap()).0;
    let conduct = Conduct { command: Some(common::this_binary()), ..Conduct::default() };
    let mut processes = Processes::start(&settings(&task, "mean"), &policy, conduct).unwrap();
    let mean = here("mean");
    assert!(play(&task, 0.4, &mut processes).0 == mean, "processes impute as they do here");
    assert!(mean != here("hold"), "the mean is not what was received last");
}

#[test]
fn a_program_without_the_imputer_says_which_it_has() {
    let task = Task::parse("hear-see").unwrap();
    let policy = PolicySource::Builtin.load(task.spec()).unwrap();
    let strange = AgentSettings { registry: Registry::default(), ..settings(&task, "mean") };
    let error = InProcess::new(&strange, &policy).err().unwrap().to_string();
    assert!(
        error.contains("no imputer `mean`") && error.contains("Always there: hold, velocity, zero"),
        "{error}"
    );
}

/// A small team that has learned for a while, with a predictor that sees its agent's own action.
fn learned() -> (Task, Policy) {
    let mut layer = Layer::new("this test");
    for (key, value) in [
        ("task", "hear-see"),
        ("seed", "6"),
        ("hidden", "32"),
        ("learning_rate", "1e-3"),
        ("predictors", "maro"),
        ("predictor_hidden", "32"),
        ("predictor_updates", "4"),
        ("predictor_inputs", "estimate, own-action"),
    ] {
        layer.set(key, value);
    }
    let config = Config::resolve(Preset::Paper, &[layer]).unwrap();
    let mut trainer = Trainer::new(config, 1).unwrap();
    let mut agents = InProcess::new(&trainer.agents(), &trainer.policy().unwrap()).unwrap();
    while trainer.timestep() < 60_000 {
        trainer.play(&mut agents).unwrap();
        if let Some(weights) = trainer.learn().unwrap() {
            agents.renew(weights).unwrap();
        }
    }
    (trainer.task().clone(), trainer.policy().unwrap())
}

/// Everything is drawn at addresses, so these are the same numbers whenever and wherever they are computed, but for how an
/// instruction set groups sums.
#[test]
fn a_learned_imputer_that_sees_the_own_action_beats_zero() {
    let (task, policy) = learned();
    let returns = ["maro", "zero"]
        .map(|imputer| play(&task, 0.0, &mut InProcess::new(&settings(&task, imputer), &policy).unwrap()).1);
    let everything = play(&task, 1.0, &mut InProcess::new(&settings(&task, "zero"), &policy).unwrap()).1;
    let [learned, zero] = returns;
    assert!(learned > zero + 20.0, "learned {learned}, zero {zero}, everything delivered {everything}");
}
