//! Observations that arrive late: what agents make of them, with and without processes, and what is written down.

use crate::common::{fail, succeed};
use vamaro_swarm::agent::{Agent, AgentSettings, Inbox, Received};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::environment::{Outcome, Task};
use vamaro_swarm::link::{Context, Fates, Link, LinkSpec, Links};
use vamaro_swarm::recording::Recording;
use vamaro_swarm::supervisor::{Audit, Decisions, InProcess, Ledger, Session, Stage, Statistics, Team};

/// Links of an embedder: what is sent at even steps is delivered after so many ticks, what is sent at odd ones is lost.
#[derive(Debug)]
struct EvenSteps(u8);

impl Link for EvenSteps {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let agents = fates.agents();
        for (i, j) in (0..agents * agents).map(|link| (link / agents, link % agents)) {
            match context.address.step % 2 {
                0 => fates.postpone(i, j, self.0),
                _ => fates.lose(i, j),
            }
        }
        Ok(())
    }

    fn longest_delay(&self) -> u8 {
        self.0
    }
}

fn settings(task: &Task, imputer: &str, links: &Links, worlds: usize) -> AgentSettings {
    let imputer = imputer.to_owned();
    AgentSettings { imputer, worlds, longest_delay: links.longest_delay(), ..AgentSettings::of(task.spec()) }
}

fn team(settings: &AgentSettings) -> InProcess {
    InProcess::new(settings, &settings.policy.load(&settings.spec).unwrap()).unwrap()
}

/// Plays ten episodes, two at a time.
fn play(links: Links, imputer: &str) -> (Statistics, Audit) {
    let task = Task::parse("hear-see").unwrap();
    let mut team = team(&settings(&task, imputer, &links, 2));
    let (mut ledger, mut audit) = (Ledger::default(), Audit::default());
    let mut session = Session::new(task.environment(2), links, 0);
    session.play(&mut team, 10, &mut [&mut ledger, &mut audit]).unwrap();
    (ledger.into_statistics(), audit)
}

/// What agents take the joint observation for at each step of an episode, `[step][agents * joint]`, with the truth,
/// `[step][agents * observation]`, and the ages they say they had.
fn one_episode(links: Links, imputer: &str) -> Vec<(Vec<f32>, Vec<f32>, Vec<u8>)> {
    let task = Task::parse("hear-see").unwrap();
    let settings = AgentSettings { greedy: true, ..settings(&task, imputer, &links, 1) };
    let mut team = team(&settings);
    let mut stage = Stage::new(task.environment(1), links, 3);
    let mut decisions = Decisions::default();
    let mut episode = Vec::new();
    stage.begin_episodes(u64::MAX).unwrap();
    stage.sense().unwrap();
    while stage.is_playing() {
        stage.draw_links(0).unwrap();
        team.tick(&stage.tick(), &mut decisions).unwrap();
        let observations = stage.tick().observations.to_vec();
        episode.push((decisions.estimates.clone(), observations, decisions.ages.clone()));
        stage.step_worlds(&decisions).unwrap();
        stage.sense().unwrap();
    }
    episode
}

#[test]
fn links_of_an_embedder_decide_what_arrives_when() {
    let (statistics, audit) = play(Links::from(EvenSteps(3)), "hold");
    // Sent at t = 2, 4, .., 20 it arrives by t = 23; what is sent at 22 and 24 does not, and t = 0 is shared at once.
    assert_eq!(statistics.delivery_rate(), Some(10.0 / 24.0));
    assert_eq!((statistics.delayed_rate(), statistics.outdated_rate()), (Some(10.0 / 24.0), Some(0.0)));
    assert_eq!((audit.own, audit.received, audit.delayed), (500, 20, 200));
    assert!(audit.holds() && audit.late == 0);
}

#[test]
fn what_arrives_late_is_what_was_sent() {
    let task = Task::parse("hear-see").unwrap();
    let (unique, padded) = (task.spec().unique_dim(), task.spec().padded_obs_dim());
    for (age, imputer) in [(1, "hold"), (4, "hold"), (4, "zero")] {
        let episode = one_episode(Links::from(EvenSteps(age)), imputer);
        for (step, (estimates, _, ages)) in episode.iter().enumerate().skip(1) {
            let arrives = step >= age as usize + 2 && (step - age as usize).is_multiple_of(2);
            assert_eq!(ages[1], if arrives { age } else { 255 }, "step {step}");
            if arrives {
                let sent = &episode[step - age as usize].1[padded..][..unique];
                let part = &estimates[unique..2 * unique];
                match imputer {
                    "hold" => assert_eq!(part, sent, "step {step}"),
                    _ => assert!(part.iter().all(|value| *value == 0.0)),
                }
            }
        }
    }
}

/// What agent 0 takes the joint observation for at step 3, if at each step `age` says how old what agent 1 sends arrives.
fn estimate_at_step_3(imputer: &str, ages: [Option<u8>; 4]) -> Vec<f32> {
    let task = Task::parse("hear-see").unwrap();
    let settings = settings(&task, imputer, &Links::from(EvenSteps(3)), 1);
    let mut agent = Agent::new(&settings, 0).unwrap();
    let sent = |step: usize| -> Vec<f32> { (0..8).map(|dim| (step * 8 + dim) as f32 / 16.0 - 0.7).collect() };
    agent.begin_episode(1);
    for (step, age) in ages.into_iter().enumerate() {
        let observation = age.map(|age| sent(step - usize::from(age)));
        let inbox = Inbox::of(2, |sender| {
            let (age, observation) = (age?, observation.as_deref()?);
            (sender == 1).then_some(Received { age, observation })
        });
        agent.fuse(0, &[0.5; 8], &inbox);
        agent.act(0, step as u32, &[0.5]).unwrap();
        agent.predict();
    }
    agent.estimates().to_vec()
}

#[test]
fn what_comes_late_and_moves_on_is_as_if_it_had_come_at_once() {
    for imputer in ["hold", "velocity", "zero"] {
        let at_once = estimate_at_step_3(imputer, [Some(0), None, None, None]);
        let late = estimate_at_step_3(imputer, [None, None, None, Some(3)]);
        assert_eq!(at_once, late, "{imputer}");
    }
    // A predictor's network has not seen the same, but what it believed of then is put right.
    let right = estimate_at_step_3("value-aware", [Some(0), None, None, Some(3)]);
    let never_wrong = estimate_at_step_3("value-aware", [Some(0), None, None, None]);
    let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
    assert!(right.iter().zip(&never_wrong).all(close), "nothing was wrong: {right:?}, {never_wrong:?}");
    let wrong = estimate_at_step_3("value-aware", [None, None, None, None]);
    assert!(!wrong.iter().zip(&never_wrong).all(close));
}

#[test]
fn a_team_that_keeps_too_little_is_told_so() {
    let task = Task::parse("hear-see").unwrap();
    let links = Links::from(EvenSteps(3));
    let settings = AgentSettings { longest_delay: 2, ..settings(&task, "hold", &links, 1) };
    let mut session = Session::new(task.environment(1), links, 0);
    let error = session.play(&mut team(&settings), 1, &mut []).unwrap_err().to_string();
    assert!(error.contains("up to 3 ticks") && error.contains("keeps observations for 2"), "{error}");
}

#[test]
fn delays_beyond_the_episode_deliver_nothing() {
    let links = LinkSpec::parse("delay(90, 10)", 2).unwrap().build();
    let (statistics, _) = play(links, "hold");
    assert_eq!(statistics.delivery_rate(), Some(0.0));
    assert_eq!((statistics.outdated_rate(), statistics.dropped_rate()), (Some(0.0), Some(1.0)));
}

#[test]
fn everything_sent_is_delivered_outdated_or_lost() {
    let links = LinkSpec::parse("gilbert(0.1, 0.3) + delay(2, 2)", 2).unwrap().build();
    let (statistics, _) = play(links, "value-aware");
    let outdated = statistics.outdated_rate().unwrap();
    let sum = statistics.delivery_rate().unwrap() + outdated + statistics.dropped_rate().unwrap();
    assert!(outdated > 0.0 && (sum - 1.0).abs() < 1e-12, "{sum}");
}

#[test]
fn processes_and_none_see_the_same_and_traces_of_it_can_be_verified() {
    let folder = tempfile::tempdir().unwrap();
    for (task, imputer) in [("hear-see", "velocity"), ("spread-xy-4", "value-aware"), ("hear-see", "hold")] {
        let trace = |name: &str, how: &str| {
            let path = folder.path().join(name);
            succeed(&format!(
                "spawn --task {task} --imputer {imputer} --episodes 4 --worlds 3 --p 0.9 --links delay(2,2) \
                 --audit {how} --record {}",
                path.display()
            ));
            path
        };
        let [processes, none] =
            [("a.json", ""), ("b.json", "--in-process")].map(|(name, how)| trace(name, how));
        assert_eq!(std::fs::read(&processes).unwrap(), std::fs::read(&none).unwrap(), "{task}, {imputer}");
        assert!(succeed(&format!("verify {}", processes.display())).contains("10 comparisons hold"));
        let recording = Recording::read(&processes).unwrap();
        assert_eq!(recording.header.links.as_deref(), Some("level(0.9) + delay(2, 2)"));
        let ages =
            recording.episodes.iter().flat_map(|episode| episode.ages.iter().flatten().flatten().flatten());
        let mut seen: Vec<u8> = ages.copied().collect();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen, [0, 1, 2, 3, 4]);
        // An age from before the episode began.
        let text = std::fs::read_to_string(&processes).unwrap();
        let wrong = text.replacen("\"ages\":[[[0,0", "\"ages\":[[[0,1", 1);
        assert_ne!(text, wrong);
        std::fs::write(&processes, wrong).unwrap();
        fail(&format!("verify {}", processes.display()), 1, &["`ages` of step 0 has 1"]);
    }
}

#[test]
fn against_the_clock_what_is_postponed_arrives_too() {
    let text = succeed("spawn --agents 2 --links delay(2) --rate 200 --episodes 2 --json");
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(summary["delayed_rate"].as_f64().unwrap() > 0.0, "{text}");
    assert_eq!(summary["delayed_rate"], summary["delivery_rate"], "all takes two ticks, but for t = 0");
}

/// Returns of 40 episodes of spread-xy-2 in which all that is sent at t >= 1 arrives after so many ticks, and agents know
/// that, or take it as if it were new.
fn returns(imputer: &str, late: usize, as_if_new: bool) -> Vec<f64> {
    let task = Task::parse("spread-xy-2").unwrap();
    let (spec, mut world) = (task.spec(), task.environment(1));
    let (agents, each) = (spec.n_agents(), spec.padded_obs_dim());
    let settings = AgentSettings {
        imputer: imputer.to_owned(),
        greedy: true,
        longest_delay: late as u8,
        ..AgentSettings::of(spec)
    };
    let mut team: Vec<Agent> = (0..agents).map(|index| Agent::new(&settings, index).unwrap()).collect();
    let mut outcome = Outcome::of(1, agents);
    let mut episode = |episode| {
        world.reset(0, 5, episode).unwrap();
        team.iter_mut().for_each(|agent| agent.begin_episode(1));
        let (mut sent, mut episode_return) = (Vec::new(), 0.0);
        for step in 0..spec.episode_steps {
            let mut observations = vec![0.0; agents * each];
            world.observe(1, &mut observations).unwrap();
            sent.push(observations);
            let mut actions = Vec::new();
            for agent in &mut team {
                let index = agent.index();
                let inbox = Inbox::of(agents, |sender| {
                    let at_once = step == 0 || sender == index;
                    let then =
                        if at_once { step } else { step.checked_sub(late).filter(|then| *then > 0)? };
                    let age = if as_if_new { 0 } else { (step - then) as u8 };
                    Some(Received { age, observation: &sent[then][sender * each..][..each] })
                });
                agent.fuse(0, &sent[step][index * each..][..each], &inbox);
                agent.act(episode, step as u32, &[0.5]).unwrap();
                actions.extend_from_slice(agent.actions());
            }
            world.step(&actions, &[true], &mut outcome).unwrap();
            team.iter_mut().for_each(Agent::predict);
            episode_return += spec.team_reward(&outcome.rewards);
        }
        episode_return
    };
    (0..40).map(&mut episode).collect()
}

/// The mean of some returns or differences, and two standard errors of it.
fn estimate(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, 2.0 * (variance / n).sqrt())
}

#[test]
fn moving_on_what_is_late_is_worth_it() {
    for imputer in ["hold", "velocity", "value-aware", "dynamics"] {
        for late in [2, 6] {
            let [moved_on, as_if_new] = [false, true].map(|as_if_new| returns(imputer, late, as_if_new));
            let gains: Vec<f64> = moved_on.iter().zip(&as_if_new).map(|(a, b)| a - b).collect();
            let (gain, sure) = estimate(&gains);
            let [with, without] = [&moved_on, &as_if_new].map(|returns| estimate(returns).0);
            println!(
                "{imputer}, {late} ticks late: {with:.1} moved on, {without:.1} as if new, {gain:+.1} +- {sure:.1}"
            );
            match imputer {
                "hold" => assert_eq!(gain, 0.0, "it uses both alike"),
                "dynamics" => assert!(gain > -sure, "{late}: {gain} +- {sure}"),
                _ => assert!(gain > sure, "{imputer}, {late}: {gain} +- {sure}"),
            }
        }
    }
}
