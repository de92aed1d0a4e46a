//! Oracles: what they are told is true, it counts, and nobody else is told.

use std::fs;
use std::time::Duration;

use crate::common::{fail, run, stderr, succeed};
use serde_json::Value;
use vamaro_swarm::agent::{Agent, AgentSettings, Inbox, PolicySource, Received, Truth};
use vamaro_swarm::base::error::Result;
use vamaro_swarm::bus::NOT_ARRIVED;
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::LinkSpec;
use vamaro_swarm::supervisor::{Decisions, InProcess, Observer, Session, Stage};

const PARTS: [Truth; 4] = [Truth::Own, Truth::Others, Truth::Constants, Truth::Agent(1)];

/// Looks for what is not as it was sent: dims of joint estimates, by receiver, whose sender was not heard at once.
struct Wrong {
    task: Task,
    /// `[agents, predicted]`: how often a value was wrong, and how often it had not arrived at once.
    counts: Vec<(usize, usize)>,
}

impl Observer for Wrong {
    fn ticked(&mut self, stage: &Stage, decisions: &Decisions, _exchange: Duration) -> Result<()> {
        let (spec, tick) = (self.task.spec(), stage.tick());
        for receiver in 0..spec.n_agents() {
            for world in 0..tick.worlds {
                let row = receiver * tick.worlds + world;
                let estimate = &decisions.estimates[row * spec.joint_dim()..];
                for sender in
                    (0..spec.n_agents()).filter(|sender| tick.arriving(receiver, world)[*sender] != 0)
                {
                    let values = spec.agents[sender].observation.len();
                    let truth = tick.observation(spec, sender, world);
                    for (dim, value) in truth.iter().enumerate().take(values) {
                        let at = sender * spec.unique_dim() + dim;
                        let counts = &mut self.counts[receiver * spec.predicted_dim() + at];
                        counts.0 += usize::from(estimate[at].to_bits() != value.to_bits());
                        counts.1 += 1;
                    }
                }
            }
        }
        Ok(())
    }
}

/// How often each value of each agent's estimate was wrong under these links, and could have been.
fn wrong(task: &str, links: &str, imputer: &str) -> Vec<(usize, usize)> {
    let task = Task::parse(task).unwrap();
    let links = LinkSpec::parse(links, task.spec().n_agents()).unwrap();
    let settings = AgentSettings {
        imputer: imputer.to_owned(),
        worlds: 2,
        longest_delay: links.longest_delay(),
        ..AgentSettings::of(task.spec())
    };
    let policy = PolicySource::Builtin.load(task.spec()).unwrap();
    let mut team = InProcess::new(&settings, &policy).unwrap();
    let counts = vec![(0, 0); task.spec().n_agents() * task.spec().predicted_dim()];
    let mut session = Session::new(task.environment(2), links.build(), 3);
    let mut wrong = Wrong { task, counts };
    session.play(&mut team, 6, &mut [&mut wrong]).unwrap();
    wrong.counts
}

#[test]
fn an_oracle_has_the_truth_of_its_part_and_imputes_the_rest() {
    for (name, links) in
        [("hear-see", "level(0.3)"), ("spread-xy-4", "level(0)"), ("spread-xy-4", "delay(2, 1)")]
    {
        let spec = Task::parse(name).unwrap().spec().clone();
        let imputed = wrong(name, links, "value-aware");
        assert!(imputed.iter().filter(|(wrong, _)| *wrong > 0).count() > spec.predicted_dim() / 2);
        for truth in PARTS {
            let counts = wrong(name, links, &truth.oracle("value-aware"));
            for receiver in 0..spec.n_agents() {
                let told: Vec<usize> = truth.dims(&spec, receiver).collect();
                for dim in 0..spec.predicted_dim() {
                    let at = receiver * spec.predicted_dim() + dim;
                    let (wrong, lost) = counts[at];
                    assert!(!told.contains(&dim) || wrong == 0, "{name} {truth} {receiver} {dim}: {wrong}");
                    // Whoever was wrong about a value most of the time is so still.
                    let (before, _) = imputed[at];
                    assert!(
                        told.contains(&dim) || before * 2 <= lost || wrong > 0,
                        "{name} {truth} {receiver} {dim}"
                    );
                }
            }
        }
    }
}

#[test]
fn what_is_told_counts_from_then_on_and_half_of_it_is_an_error() {
    let task = Task::parse("spread-xy-2").unwrap();
    let spec = task.spec();
    let settings = AgentSettings { imputer: Truth::Own.oracle("hold"), ..AgentSettings::of(spec) };
    let mut agent = Agent::new(&settings, 0).unwrap();
    assert!(agent.is_oracle());
    let plain = AgentSettings { imputer: "hold".to_owned(), ..settings };
    assert!(!Agent::new(&plain, 0).unwrap().is_oracle());
    agent.begin_episode(1);
    let own = [0.25; 8];
    let sent = [1.0, 2.0, 3.0, 4.0, 0.25, 0.25, 0.25, 0.25];
    let nothing = Inbox::of(2, |_| None);
    let everything = Inbox::of(2, |_| Some(Received { age: 0, observation: &sent }));
    agent.fuse(0, &own, &nothing);
    agent.substitute(0, &everything).unwrap();
    agent.act(0, 0, &[0.5]).unwrap();
    // Of agent 1's values the first and the third are agent 0's place and velocity along y.
    assert_eq!(agent.estimates()[4..8], [1.0, 0.0, 3.0, 0.0]);
    agent.predict();
    agent.fuse(0, &own, &nothing);
    assert_eq!(nothing.age(1), NOT_ARRIVED);
    let error = agent.substitute(0, &nothing).unwrap_err().to_string();
    assert!(error.contains("agent-0 is an oracle") && error.contains("agent-1"), "{error}");
    agent.act(0, 1, &[0.5]).unwrap();
    assert_eq!(agent.estimates()[4..8], [1.0, 0.0, 3.0, 0.0], "held from when it was told");
}

const SWEEP: &str = "evaluate builtin --task hear-see --episodes 60 --levels 1,0.3,0 --imputers hold,value-aware \
                     --substitute own --substitute others --substitute agent:0";

fn groups(words: &str) -> Value {
    let all: Value = serde_json::from_str(&succeed(&format!("{SWEEP} --json {words}"))).unwrap();
    all["groups"].clone()
}

#[test]
fn an_evaluation_says_what_the_loss_is_made_of() {
    let processes = groups("");
    assert_eq!(
        groups("--in-process --worlds 7 --links delay(2)")[0]["imputers"][1]["cells"][2],
        processes[0]["imputers"][1]["cells"][2]
    );
    assert_eq!(groups("--in-process --worlds 60"), processes);
    let imputers = processes[0]["imputers"].as_array().unwrap();
    let names: Vec<&str> = imputers.iter().map(|imputer| imputer["imputer"].as_str().unwrap()).collect();
    let of = |imputer: &str| ["own", "others", "agent:0"].map(|part| format!("{imputer}+oracle:{part}"));
    let expected = [
        vec!["hold".to_owned()],
        of("hold").into(),
        vec!["value-aware".to_owned()],
        of("value-aware").into(),
    ];
    assert_eq!(names, expected.concat());
    let score =
        |imputer: usize, cell: usize| imputers[imputer]["cells"][cell]["score"]["value"].as_f64().unwrap();
    // The cells of oracles are played: what they are told is worth something.
    for (imputer, own) in [(0, 1), (4, 5)] {
        assert_eq!(score(imputer, 0), 1.0);
        assert!(score(imputer, 2) < 0.95 && score(own, 2) > 0.99, "{} {}", score(imputer, 2), score(own, 2));
    }
    let losses = processes[0]["losses"].as_array().unwrap();
    assert_eq!(losses.len(), 4, "two imputers at two levels below 1");
    let at_0 =
        losses.iter().find(|loss| loss["imputer"] == "value-aware" && loss["condition"]["level"] == 0.0);
    let at_0 = at_0.unwrap();
    assert_eq!(at_0["loss"]["value"].as_f64().unwrap(), 1.0 - score(4, 2));
    let truths: Vec<&str> =
        at_0["explained"].as_array().unwrap().iter().map(|e| e["truth"].as_str().unwrap()).collect();
    assert_eq!(truths, ["own", "others", "agent:0"]);
    let own = &at_0["explained"][0]["share"];
    let [value, low, high] = ["value", "low", "high"].map(|key| own[key].as_f64().unwrap());
    assert!(low <= value && value <= high && value > 0.95 && high - low < 0.2, "{own}");
    // What nobody imputes is no error of an imputer.
    let count = |imputer: usize| imputers[imputer]["errors"][0]["ages"][0]["count"].as_u64().unwrap();
    assert!(count(1) < count(0), "{} {}", count(1), count(0));
}

#[test]
fn oracles_are_marked_wherever_a_number_of_theirs_stands() {
    let folder = tempfile::tempdir().unwrap();
    let words = format!("{SWEEP} --in-process --report {}", folder.path().display());
    let text = succeed(&words);
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    let name = "value-aware+oracle:own";
    for file in [
        "report.html",
        "results.json",
        "marl-eval.json",
        "summary.csv",
        "episodes.csv",
        "errors.csv",
        "table.md",
        "cells.jsonl",
        "robustness.svg",
        "difference.svg",
        "error-by-age.svg",
    ] {
        assert!(read(file).contains(name), "{file}");
    }
    for text in [&text, &read("report.html"), &read("table.md")] {
        assert!(text.contains(name) && text.contains("p = 0: value-aware loses "), "{text}");
        assert!(text.contains("Not knowing its own agent's state explains "), "{text}");
    }
    assert!(
        text.contains("is not an imputer: its agents are told")
            && read("report.html").contains("Not an imputer: the agents are told")
    );
    // Without oracles nothing of this is there, and the cells that are kept are the same.
    let kept = read("cells.jsonl");
    let plain = words.split(" --substitute own").next().unwrap().to_owned();
    let text = succeed(&format!("{plain} --in-process --report {}", folder.path().display()));
    assert_eq!(read("cells.jsonl"), kept);
    for text in [text, read("report.html"), read("results.json")] {
        assert!(!text.contains("oracle") && !text.contains("losses"));
    }
}

#[test]
fn nobody_becomes_an_oracle_by_mistake() {
    for words in [
        "spawn --p 0 --imputer value-aware+oracle:own",
        "evaluate builtin --task hear-see --imputers hold+oracle:own",
    ] {
        fail(words, 2, &["no imputer", "+oracle:own`"]);
    }
    fail(&SWEEP.replace("1,0.3,0", "0.3,0"), 2, &["--substitute own", "p = 1"]);
    fail(&format!("{SWEEP} --substitute own"), 2, &["own is given twice"]);
    fail(&format!("{SWEEP} --substitute agent:2"), 2, &["hear-see", "about agent 2"]);
    fail(&format!("{SWEEP} --substitute mine"), 2, &["own, others, targets, constants or agent:K"]);
    let help = run("evaluate --help");
    assert!(String::from_utf8_lossy(&help.stdout).contains("--substitute"), "{}", stderr(&help));
}
