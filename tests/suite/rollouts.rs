//! Rollouts for training: the same bits by processes and in-process, with weights that are renewed on the way.

use crate::common::{self, assert_gone, swarm_of};
use rustix::process::{Signal, kill_process};
use vamaro_swarm::agent::{AgentSettings, PolicySource, dims};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::environment::{PhysicsSpec, Task};
use vamaro_swarm::link::Links;
use vamaro_swarm::nn::{ActorKind, Input, Networks, Policy, PredictorSpec, Sharing};
use vamaro_swarm::recording::{Episode, Recording, RecordingHeader};
use vamaro_swarm::supervisor::{
    Conduct, Decisions, InProcess, Order, Processes, Recorder, Session, Stage, Team, Tick,
};
use vamaro_swarm::train::{Batch, Rollout};

/// Steps of an episode of every built-in task.
const EPISODE_STEPS: usize = 25;

const SEED: u64 = 4;

/// How swarms of this binary run.
fn conduct() -> Conduct {
    Conduct { command: Some(common::this_binary()), ..Conduct::default() }
}

/// A team whose logits are listened to.
struct Overheard<T> {
    team: T,
    logits: Vec<u32>,
}

impl<T: Team> Team for Overheard<T> {
    fn muster(&mut self, orders: &[Order]) -> Result<u64> {
        self.team.muster(orders)
    }

    fn tick(&mut self, tick: &Tick, decisions: &mut Decisions) -> Result<()> {
        self.team.tick(tick, decisions)?;
        self.logits.extend(decisions.logits.iter().map(|logit| logit.to_bits()));
        Ok(())
    }

    fn renew(&mut self, weights: &[f32]) -> Result<()> {
        self.team.renew(weights)
    }
}

/// A task, its networks, and links with this p.
struct Case {
    task: Task,
    networks: Networks,
    p: f64,
}

impl Case {
    fn new(task: &str, actor: ActorKind, sharing: Sharing, p: f64) -> Case {
        // The second of two predictors is used, so that neither end of the weights is the right one.
        let predictor = |name, hidden| PredictorSpec { hidden, ..PredictorSpec::paper(name) };
        let predictors = vec![predictor("maro", 12), predictor("value-aware", 20), predictor("third", 8)];
        let networks = Networks { sharing, hidden: 24, predictors, ..Networks::paper(actor) };
        Case { task: Task::parse(task).unwrap(), networks, p }
    }

    fn all() -> Vec<Case> {
        let mut cases = Vec::new();
        for p in [1.0, 0.5] {
            cases.push(Case::new("hear-see", ActorKind::Mlp, Sharing::Separate, p));
            cases.push(Case::new("speaker-listener", ActorKind::Mlp, Sharing::Shared, p));
            cases.push(Case::new("spread-xy-4", ActorKind::Gru, Sharing::Separate, p));
            cases.push(Case::new("spread-blindfold", ActorKind::Gru, Sharing::Shared, p));
        }
        for case in cases.iter_mut().filter(|case| case.networks.sharing == Sharing::Shared) {
            case.networks.actor_inputs = vec![Input::Estimate, Input::Delivered, Input::Age];
        }
        cases
    }

    fn policy(&self, seed: u64) -> Policy {
        Policy::untrained(&dims(self.task.spec()), seed, self.networks.clone()).unwrap()
    }

    fn weights(&self, seed: u64) -> Vec<f32> {
        let policy = self.policy(seed);
        let mut weights = vec![0.0; policy.n_values()];
        policy.copy_values(&mut weights);
        weights
    }

    fn settings(&self, worlds: usize) -> AgentSettings {
        let imputer = match self.p {
            1.0 => "hold".to_owned(),
            _ => "value-aware".to_owned(),
        };
        let policy = PolicySource::Training;
        AgentSettings {
            imputer,
            policy,
            seed: SEED,
            worlds,
            tell_logits: true,
            ..AgentSettings::of(self.task.spec())
        }
    }

    fn links(&self) -> Links {
        Links::level(self.p)
    }

    fn rollout(&self, worlds: usize, first_episode: u64) -> Rollout {
        Rollout::new(self.task.environment(worlds), self.links(), SEED, first_episode)
    }

    fn batch(&self, episodes: usize) -> Batch {
        Batch::zeros(self.task.spec(), episodes, self.p < 1.0)
    }

    fn processes(&self, worlds: usize, seed: u64) -> Processes {
        Processes::start(&self.settings(worlds), &self.policy(seed), conduct()).unwrap()
    }

    fn in_process(&self, worlds: usize, seed: u64) -> InProcess {
        InProcess::new(&self.settings(worlds), &self.policy(seed)).unwrap()
    }
}

/// Every bit that a batch holds.
fn bits(batch: &Batch) -> Vec<u32> {
    let floats = [&batch.observations, &batch.joint, &batch.estimates, &batch.rewards];
    let floats = floats.into_iter().flatten().map(|value| value.to_bits());
    floats.chain(batch.actions.iter().map(|action| u32::from(*action))).collect()
}

/// What comes of rollouts with the weights of seeds 0, 1, 2 and 1 again, of which the team knows the first:
/// batches, returns and logits.
fn play(case: &Case, team: impl Team, worlds: usize) -> (Vec<Vec<u32>>, Vec<f64>, Vec<u32>) {
    let mut team = Overheard { team, logits: Vec::new() };
    let mut rollout = case.rollout(worlds, 7);
    let mut batch = case.batch(10);
    let (mut batches, mut returns) = (Vec::new(), Vec::new());
    for (at, seed) in [0, 1, 2, 1].into_iter().enumerate() {
        if at > 0 {
            team.renew(&case.weights(seed)).unwrap();
        }
        returns.extend(rollout.collect(&mut team, &mut batch).unwrap().iter().map(|(sum, _)| *sum));
        batches.push(bits(&batch));
    }
    assert_eq!(rollout.next_episode(), 7 + returns.len() as u64);
    (batches, returns, team.logits)
}

#[test]
fn processes_play_the_same_bits_through_renewals() {
    for (case, worlds) in Case::all().iter().zip([1, 2, 10, 3, 7, 10, 1, 4]) {
        let expected = play(case, case.in_process(worlds, 0), worlds);
        let found = play(case, case.processes(worlds, 0), worlds);
        assert!(found == expected, "{}, p = {}, {worlds} worlds", case.task.id(), case.p);
    }
}

/// Logits and batch of two episodes from number 5 on.
fn decide(case: &Case, team: impl Team) -> (Vec<u32>, Vec<u32>) {
    let mut team = Overheard { team, logits: Vec::new() };
    let mut rollout = case.rollout(2, 5);
    let mut batch = case.batch(2);
    rollout.collect(&mut team, &mut batch).unwrap();
    (team.logits, bits(&batch))
}

/// The team after it has played with its weights and then been given those of seed 1.
fn renewed<T: Team>(case: &Case, mut team: T) -> T {
    let mut rollout = case.rollout(2, 0);
    let mut batch = case.batch(2);
    rollout.collect(&mut team, &mut batch).unwrap();
    team.renew(&case.weights(1)).unwrap();
    team
}

#[test]
fn a_renewed_team_is_one_that_started_with_the_weights() {
    for case in Case::all() {
        let [old, new] = [0, 1].map(|seed| decide(&case, case.in_process(2, seed)));
        assert!(old.0 != new.0, "other weights make other logits");
        assert!(decide(&case, renewed(&case, case.in_process(2, 0))) == new, "{}", case.task.id());
        assert!(decide(&case, renewed(&case, case.processes(2, 0))) == new, "{}", case.task.id());
    }
}

#[test]
fn weights_are_in_force_from_the_next_episode_on() {
    let case = Case::new("spread-blindfold", ActorKind::Gru, Sharing::Separate, 0.5);
    let expected = renew_before(EPISODE_STEPS, &case, case.in_process(1, 0));
    assert!(renew_before(10, &case, case.in_process(1, 0)) == expected);
    assert!(renew_before(10, &case, case.processes(1, 0)) == expected);
}

/// The logits of two episodes in one world, when new weights come before this step.
fn renew_before(renewed: usize, case: &Case, team: impl Team) -> Vec<u32> {
    let mut team = Overheard { team, logits: Vec::new() };
    let mut stage = Stage::new(case.task.environment(1), case.links(), SEED);
    let mut decisions = Decisions::default();
    for step in 0..2 * EPISODE_STEPS {
        if step % EPISODE_STEPS == 0 {
            stage.begin_episodes(2).unwrap();
        }
        if step == renewed {
            team.renew(&case.weights(1)).unwrap();
        }
        stage.sense().unwrap();
        stage.draw_links(0).unwrap();
        team.tick(&stage.tick(), &mut decisions).unwrap();
        stage.step_worlds(&decisions).unwrap();
    }
    team.logits
}

#[test]
fn a_batch_holds_what_a_recording_of_its_episodes_does() {
    for case in Case::all() {
        let (task, settings) = (&case.task, case.settings(3));
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("trace.json");
        let header = RecordingHeader {
            task: task.id().to_owned(),
            n_agents: task.spec().n_agents(),
            n_landmarks: task.spec().landmarks,
            episode_steps: EPISODE_STEPS,
            actor: None,
            imputer: None,
            policy: None,
            seed: None,
            greedy: None,
            links: None,
            matrix: None,
            physics: PhysicsSpec::default(),
            comm_at_t0: None,
            rate: None,
            longest_delay: 0,
            relay: false,
            logs: Vec::new(),
            format_version: None,
            version: None,
        };
        let mut recorder = Recorder::create(&file, &header).unwrap();
        let mut session = Session::new(task.environment(settings.worlds), case.links(), SEED);
        session.play(&mut case.in_process(3, 0), 7, &mut [&mut recorder]).unwrap();
        recorder.finish().unwrap();
        let recording = Recording::read(&file).unwrap();

        // Episodes 4, 5 and 6 are columns 4, 0 and 1 of five.
        let mut rollout = case.rollout(3, 4);
        let mut batch = case.batch(5);
        let returns = rollout.collect(&mut case.in_process(3, 0), &mut batch).unwrap();
        let of = |episode: &Episode| (episode.episode_return, EPISODE_STEPS as u64);
        let expected: Vec<(f64, u64)> = recording.episodes[4..].iter().map(of).collect();
        assert_eq!(returns, expected);
        assert_eq!(batch.estimates.is_empty(), case.p == 1.0);
        let (agents, observation, joint) =
            (task.spec().n_agents(), task.spec().padded_obs_dim(), task.spec().joint_dim());
        for (number, column) in [(4, 4), (5, 0), (6, 1)] {
            let episode = &recording.episodes[number];
            let mut world = task.environment(1);
            for step in 0..=EPISODE_STEPS {
                let row = step * 5 + column;
                let (state, last_actions) = episode.at(step, 1);
                world.set_state(0, &state, last_actions.as_deref()).unwrap();
                let mut truth = vec![0.0; agents * observation];
                world.observe(1, &mut truth).unwrap();
                assert_eq!(batch.observations[row * truth.len()..][..truth.len()], truth);
                let estimates = batch.estimates.get(row * agents * joint..).unwrap_or_default();
                let found = &batch.joint[row * joint..][..joint];
                for (agent, part) in truth.chunks_exact(observation).enumerate() {
                    let (unique, predicted) = (task.spec().unique_dim(), task.spec().predicted_dim());
                    assert_eq!(found[agent * unique..][..unique], part[..unique]);
                    assert_eq!(found[predicted..], part[unique..][..task.spec().common_dim()]);
                }
                if step == EPISODE_STEPS {
                    let own = estimates.chunks_exact(joint).take(agents).enumerate();
                    own.for_each(|(agent, seen)| {
                        let unique = agent * task.spec().unique_dim()..(agent + 1) * task.spec().unique_dim();
                        assert_eq!(seen[unique.clone()], found[unique], "an agent knows its own part");
                    });
                    continue;
                }
                let actions = batch.actions[row * agents..][..agents].iter();
                assert!(actions.copied().map(u32::from).eq(episode.words(step, 1)));
                assert_eq!(batch.rewards[row], episode.team_reward[step] as f32);
                for (agent, seen) in episode.joint_estimate[step].iter().enumerate() {
                    match case.p {
                        1.0 => assert_eq!(found, seen),
                        _ => assert_eq!(estimates[agent * joint..][..joint], *seen),
                    }
                }
            }
        }
        let untouched = &batch.observations[2 * agents * observation..4 * agents * observation];
        assert!(untouched.iter().all(|value| *value == 0.0), "columns of other episodes stay as they are");
    }
}

#[test]
fn what_cannot_be_weights_is_refused() {
    let case = Case::new("hear-see", ActorKind::Mlp, Sharing::Separate, 1.0);
    let weights = case.weights(1);
    let mut processes = case.processes(2, 0);
    assert_refused(&mut processes, &weights[1..], "its policy has");
    assert_refused(&mut case.in_process(2, 0), &weights[1..], "its policy has");
    let mut astray = weights.clone();
    astray[3] = f32::NAN;
    assert_refused(&mut processes, &astray, "weight 3 is NaN");
    processes.renew(&weights).unwrap();
    // No agent has taken these yet. They are not lost.
    assert_refused(&mut processes, &weights, "taken the last ones");
    assert!(decide(&case, processes) == decide(&case, case.in_process(2, 1)));

    let (folder, policy) = (tempfile::tempdir().unwrap(), case.policy(0));
    let file = folder.path().join("policy.safetensors");
    policy.save(&file).unwrap();
    let settings = AgentSettings { policy: PolicySource::File(file), ..case.settings(1) };
    let mut frozen = Processes::start(&settings, &policy, conduct()).unwrap();
    assert_refused(&mut frozen, &weights, "frozen");
}

fn assert_refused(team: &mut impl Team, weights: &[f32], saying: &str) {
    let error = team.renew(weights).unwrap_err().to_string();
    assert!(error.contains(saying), "{error}");
}

#[test]
fn a_killed_process_ends_a_rollout_with_its_name_and_leaves_nothing() {
    let case = Case::new("spread-xy-4", ActorKind::Gru, Sharing::Separate, 0.5);
    let mut team = case.processes(2, 0);
    let (agents, tag) = swarm_of(&team);
    let mut rollout = case.rollout(2, 0);
    let mut batch = case.batch(2);
    rollout.collect(&mut team, &mut batch).unwrap();
    team.renew(&case.weights(1)).unwrap();
    kill_process(agents[2], Signal::KILL).unwrap();
    let error = rollout.collect(&mut team, &mut batch).unwrap_err().to_string();
    assert!(error.contains("signal 9") && error.contains(&agents[2].to_string()), "{error}");
    drop(team);
    assert_gone(&agents, &tag);
}

#[test]
fn a_swarm_in_training_leaves_nothing() {
    let case = Case::new("hear-see", ActorKind::Mlp, Sharing::Separate, 1.0);
    let team = case.processes(2, 0);
    let (agents, tag) = swarm_of(&team);
    assert!(!common::shared_memory(&tag).is_empty());
    decide(&case, renewed(&case, team));
    assert_gone(&agents, &tag);
}
