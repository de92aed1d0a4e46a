//! Episodes that end early, played by the one driver and learned from: no world that is done has any say in what the
//! others count, or in what is learned.

use crate::common;
use vamaro_swarm::agent::{AgentSettings, PolicySource, dims};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::base::rng::{Draws, Purpose};
use vamaro_swarm::environment::{
    About, ActionSpace, Actions, AgentSpec, Axis, End, Environment, PaperSetting, Spec, State, TeamReward,
    Unit, Value, World, Worlds,
};
use vamaro_swarm::link::Links;
use vamaro_swarm::nn::{ActorKind, Meta, Networks, Policy, PredictorSpec};
use vamaro_swarm::supervisor::{
    self, Audit, Conduct, EpisodeStatistics, InProcess, Ledger, Processes, Session, Team as _,
};
use vamaro_swarm::train::{
    Batch, Estimator, Learner, Losses, Objective, PredictorSettings, Replay, Rollout, Settings,
};

const AGENTS: usize = 3;
const STEPS: usize = 8;
const SEED: u64 = 11;
/// Episodes of a batch.
const EPISODES: usize = 6;

/// Agents on a line, who are to meet in a place, until their time is up: which may be at any step, in one of two ways.
struct Line {
    places: [f64; AGENTS],
    meeting: f64,
    step: usize,
    end: (usize, End),
}

/// How an episode ends, and after how many steps if it is not the longest there is.
fn end_of(seed: u64, episode: u64) -> (usize, End) {
    let mut draws = Draws::new(seed, Purpose::Reset, episode, 1);
    let end = if draws.below(2) == 0 { End::Terminated } else { End::Truncated };
    (1 + draws.below(STEPS + 2), end)
}

impl World for Line {
    fn reset(&mut self, seed: u64, episode: u64) -> Result<()> {
        let mut draws = Draws::new(seed, Purpose::Reset, episode, 0);
        let places = std::array::from_fn(|_| draws.between(-1.0, 1.0));
        *self = Line { places, meeting: draws.between(-1.0, 1.0), step: 0, end: end_of(seed, episode) };
        Ok(())
    }

    fn observe(&self, agent: usize, out: &mut [f32]) {
        out.copy_from_slice(&[self.places[agent] as f32, self.meeting as f32]);
    }

    fn step(&mut self, actions: Actions, rewards: &mut [f64]) -> Result<End> {
        assert!(self.step < self.end.0, "a world that is done is left alone");
        self.step += 1;
        for (agent, (place, reward)) in self.places.iter_mut().zip(rewards).enumerate() {
            *place += 0.2 * (f64::from(actions.choice(agent)) - 1.0);
            *reward = -(*place - self.meeting).abs();
        }
        Ok(if self.step == self.end.0 { self.end.1 } else { End::Open })
    }

    fn set_state(&mut self, _state: &State, _last_actions: Option<Actions>) -> Result<()> {
        unreachable!("nobody replays these episodes")
    }
}

fn spec() -> Spec {
    let place = |about| Value { unit: Unit::Metre, about, axis: Some(Axis::X), rate: None };
    let agent = |agent| AgentSpec {
        name: format!("agent-{agent}"),
        observation: vec![place(About::Agent(agent))],
        actions: ActionSpace::Discrete(3),
    };
    Spec {
        id: "line".to_owned(),
        agents: (0..AGENTS).map(agent).collect(),
        unique: 1,
        common: vec![place(About::Landmark)],
        landmarks: 1,
        targets: 0,
        episode_steps: STEPS,
        dt: 0.1,
        team_reward: TeamReward::Sum,
        paper: PaperSetting::One,
        positions: false,
    }
}

fn environment(worlds: usize) -> Box<dyn Environment> {
    let line = |_: &Spec| Line { places: [0.0; AGENTS], meeting: 0.0, step: 0, end: (0, End::Open) };
    Box::new(Worlds::new(spec(), worlds, line))
}

/// Whether an episode terminates, and its steps: an end behind the time limit never comes.
fn ends(episodes: usize) -> Vec<(usize, bool)> {
    let ends = (0..episodes as u64).map(|episode| end_of(SEED, episode));
    ends.map(|(steps, end)| (steps.min(STEPS), steps <= STEPS && end == End::Terminated)).collect()
}

fn settings(kind: ActorKind) -> Settings {
    let predictor = |name| PredictorSpec { hidden: 8, ..PredictorSpec::paper(name) };
    let predictors = vec![predictor("value-aware"), predictor("maro")];
    let networks = Networks { hidden: 16, predictors, ..Networks::paper(kind) };
    let objectives = [Objective::ValueAware { lambda: 1.0 }, Objective::Maro];
    Settings {
        networks,
        predictors: objectives.map(PredictorSettings::paper).to_vec(),
        estimator: Estimator::Gae(0.95),
        learning_rate: 1e-2,
        ..Settings::paper(kind)
    }
}

fn agents(worlds: usize) -> AgentSettings {
    AgentSettings {
        imputer: "value-aware".to_owned(),
        policy: PolicySource::Training,
        seed: SEED,
        worlds,
        ..AgentSettings::of(&spec())
    }
}

fn policy(settings: &Settings, team: &Learner) -> Policy {
    let mut weights = Vec::new();
    team.policy_values(&mut weights);
    Policy::new(&dims(&spec()), Meta::new("line", SEED), settings.networks.clone(), &weights).unwrap()
}

fn untrained(settings: &Settings, threads: usize) -> Learner {
    let spec = spec();
    Learner::untrained(settings.clone(), &dims(&spec), spec.padded_obs_dim(), &[3; AGENTS], SEED, threads)
}

/// What comes of three updates, each on six episodes played in so many worlds: weights, what each update says of itself,
/// and the return and steps of every episode.
fn train(kind: ActorKind, p: f64, worlds: usize, threads: usize) -> (Vec<u32>, Vec<Losses>, Vec<(f64, u64)>) {
    let settings = settings(kind);
    let mut team = untrained(&settings, threads);
    let mut agents = InProcess::new(&agents(worlds), &policy(&settings, &team)).unwrap();
    let mut rollout = Rollout::new(environment(worlds), Links::level(p), SEED, 0);
    let mut batch = Batch::zeros(&spec(), EPISODES, p < 1.0);
    let mut replay = Replay::new(10, STEPS, spec().joint_dim(), 0);
    let (mut losses, mut played, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    for update in 0..3 {
        while played.len() < (update + 1) * EPISODES {
            for end in rollout.collect(&mut agents, &mut batch).unwrap() {
                replay.push(played.len() as u64, &batch, played.len() % EPISODES);
                played.push(*end);
            }
        }
        losses.push(team.update(&batch, &replay.sample(SEED, team.updates(), 1, 4)).clone());
        team.policy_values(&mut weights);
        agents.renew(&weights).unwrap();
    }
    (
        team.state().iter().flat_map(|(_, _, values)| values.iter().map(|v| v.to_bits())).collect(),
        losses,
        played,
    )
}

#[test]
fn what_is_learned_does_not_depend_on_the_worlds_beside_an_episode() {
    for (kind, p) in [(ActorKind::Mlp, 1.0), (ActorKind::Mlp, 0.5), (ActorKind::Gru, 0.5)] {
        let one_by_one = train(kind, p, 1, 1);
        let steps: Vec<usize> = one_by_one.2.iter().map(|(_, steps)| *steps as usize).collect();
        let expected: Vec<usize> = ends(3 * EPISODES).iter().map(|(steps, _)| *steps).collect();
        assert_eq!(steps, expected);
        assert!(one_by_one.1.iter().flat_map(|losses| &losses.predictors).all(Option::is_some));
        for (worlds, threads) in [(2, 1), (3, 2), (6, 1), (6, 3)] {
            assert!(train(kind, p, worlds, threads) == one_by_one, "{kind}, p = {p}, {worlds} worlds");
        }
    }
}

#[test]
fn a_batch_says_how_its_episodes_ended() {
    let settings = settings(ActorKind::Mlp);
    let policy = policy(&settings, &untrained(&settings, 1));
    let mut batch = Batch::zeros(&spec(), EPISODES, false);
    let mut rollout = Rollout::new(environment(3), Links::level(1.0), SEED, 0);
    let mut agents = InProcess::new(&agents(3), &policy).unwrap();
    let (mut terminated, mut cut_off, mut timed_out) = (0, 0, 0);
    for batch_of_ends in ends(4 * EPISODES).chunks(EPISODES) {
        for _ in 0..2 {
            rollout.collect(&mut agents, &mut batch).unwrap();
        }
        let found = batch.ends.lengths().iter().zip(batch.ends.terminated());
        let found: Vec<(usize, bool)> = found.map(|(length, terminated)| (*length, *terminated)).collect();
        assert_eq!(found, batch_of_ends);
        for &(steps, ends) in batch_of_ends {
            terminated += usize::from(ends);
            cut_off += usize::from(!ends && steps < STEPS);
            timed_out += usize::from(!ends && steps == STEPS);
        }
    }
    assert!(terminated > 0 && cut_off > 0 && timed_out > 0, "{terminated}, {cut_off}, {timed_out}");
}

fn untrained_policy() -> Policy {
    let settings = settings(ActorKind::Gru);
    policy(&settings, &untrained(&settings, 1))
}

/// What ledger and audit say of ten episodes that a team plays in so many worlds.
fn counted(mut team: impl supervisor::Team, worlds: usize) -> (Vec<EpisodeStatistics>, Audit) {
    let mut session = Session::new(environment(worlds), Links::level(0.5), SEED);
    let (mut ledger, mut audit) = (Ledger::default(), Audit::default());
    session.play(&mut team, 10, &mut [&mut ledger, &mut audit]).unwrap();
    (ledger.into_statistics().episodes().to_vec(), audit)
}

fn counted_in_process(worlds: usize) -> (Vec<EpisodeStatistics>, Audit) {
    counted(InProcess::new(&agents(worlds), &untrained_policy()).unwrap(), worlds)
}

#[test]
fn counts_and_audit_skip_worlds_that_are_done() {
    let (episodes, audit) = counted_in_process(1);
    for (episode, (steps, _)) in episodes.iter().zip(ends(10)) {
        assert_eq!(episode.due, (steps * AGENTS) as u64);
        assert_eq!(episode.sent, ((steps - 1) * AGENTS * (AGENTS - 1)) as u64);
    }
    let ticks: usize = ends(10).iter().map(|(steps, _)| steps).sum();
    assert_eq!(audit.own, (ticks * AGENTS) as u64);
    assert_eq!(audit.received + audit.imputed, (ticks * AGENTS * (AGENTS - 1)) as u64);
    assert!(audit.holds() && audit.imputed > 0);
    for worlds in [2, 3, 10] {
        assert_eq!(counted_in_process(worlds), (episodes.clone(), audit), "{worlds} worlds");
    }
}

#[test]
fn processes_idle_as_one_process_does() {
    let conduct = Conduct { command: Some(common::this_binary()), ..Conduct::default() };
    let processes = Processes::start(&agents(4), &untrained_policy(), conduct).unwrap();
    assert_eq!(counted(processes, 4), counted_in_process(4));
}
