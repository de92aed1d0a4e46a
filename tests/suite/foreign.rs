//! Other programs in the place of agents: those that play as ours do, and those that do not.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use vamaro_swarm::agent::AgentSettings;
use vamaro_swarm::base::error::Error;
use vamaro_swarm::bus::{AgentPort, AgentSharedPort, Header, Kind, Layout, PROTOCOL, Sample, SwarmAddress};
use vamaro_swarm::environment::Task;
use vamaro_swarm::link::LinkSpec;
use vamaro_swarm::recording::Recording;
use vamaro_swarm::supervisor::{AgentCommand, Conduct, Deadlines, Ledger, OnFailure, Processes, Session};

use crate::common::{self, PROGRAM, fail, stderr, succeed, swarm_of};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Not a test: what a stranger runs. The last word is what it is told, a word before says what it does wrong.
#[test]
fn stranger() {
    let words: Vec<String> = std::env::args().collect();
    let told = words.last().filter(|word| word.starts_with('{'));
    let Some(told) = told else { return };
    let fault = words.iter().find_map(|word| word.strip_prefix("wrong=")).unwrap();
    let told: serde_json::Value = serde_json::from_str(told).unwrap();
    let address: SwarmAddress = serde_json::from_value(told["address"].clone()).unwrap();
    let layout: Layout = serde_json::from_value(told["wire"]["layout"].clone()).unwrap();
    let me = told["agent"].as_u64().unwrap() as usize;
    let incarnation = told["incarnation"].as_u64().unwrap() as u32;
    let mut port = AgentSharedPort::open(&address, &layout, me, incarnation).unwrap();
    let is = |wrong: &str| fault == wrong;
    let own = Header {
        protocol: PROTOCOL - u32::from(is("version")),
        swarm: address.id(),
        sender: me as u32 - u32::from(is("another")),
        incarnation,
        ..Header::default()
    };
    let ready = Header { kind: Kind::Ready as u32, length: 1, ..own };
    port.publish_decision(ready, |words| words.fill(0)).unwrap();
    port.wake_supervisor().unwrap();
    loop {
        port.sleep(Duration::from_millis(20)).unwrap();
        let Some(sensor) = port.receive_sensor().unwrap() else { continue };
        let now = *sensor.header();
        if now.kind == Kind::Shutdown as u32 && !is("stays") {
            return;
        }
        if is("exit") {
            eprintln!("error: out of ideas");
            std::process::exit(7);
        }
        if is("silent") || now.kind != Kind::Sensor as u32 {
            continue;
        }
        let Header { protocol, swarm, sender, incarnation, .. } = own;
        let header = Header { protocol, swarm, sender, incarnation, ..now };
        let worlds = now.worlds as usize;
        let length = layout.observation_words(worlds) as u64;
        let observer = sender - u32::from(is("forges"));
        let observation = Header { kind: Kind::Observation as u32, sender: observer, length, ..header };
        let observed = layout.sensor(sensor.words(), worlds).observations;
        port.publish_observation(observation, |words| words.copy_from_slice(bytemuck::cast_slice(observed)))
            .unwrap();
        if is("again") {
            port.publish_decision(ready, |words| words.fill(0)).unwrap();
            continue;
        }
        let words = layout.decision_words(worlds) - usize::from(is("length"));
        let tick = now.tick + u64::from(is("tick"));
        let decision = Header { kind: Kind::Decision as u32, length: words as u64, tick, ..header };
        port.publish_decision(decision, |words| {
            words.fill(if is("number") { f32::NAN.to_bits() } else { 0 });
            words[..worlds * layout.action].fill(if is("action") { 99 } else { 0 });
        })
        .unwrap();
        port.wake_supervisor().unwrap();
    }
}

/// The command of a stranger that does this wrong. The harness runs no other test for it.
fn wrong(what: &str) -> AgentCommand {
    let program = std::env::current_exe().unwrap();
    let words = ["--exact", "foreign::stranger", "--skip", "agent", "--nocapture"];
    let command = words.iter().fold(AgentCommand::new(program), |command, word| command.word(*word));
    command.word(format!("wrong={what}"))
}

fn settings() -> AgentSettings {
    AgentSettings::of(Task::parse("hear-see").unwrap().spec())
}

/// Starts a team whose agent 1 does this wrong, and has it play an episode.
fn play(what: &str, on_failure: OnFailure) -> (Result<(), Error>, Option<Processes>) {
    // Short where nothing but time tells.
    let answer = if ["silent", "again"].contains(&what) { 1500 } else { 30_000 };
    let deadlines = Deadlines {
        ready: Duration::from_secs(20),
        answer: Duration::from_millis(answer),
        ..Deadlines::default()
    };
    let conduct = Conduct {
        command: Some(common::this_binary()),
        others: vec![(1, wrong(what))],
        deadlines,
        on_failure,
        ..Conduct::default()
    };
    let settings = settings();
    let policy = settings.policy.load(&settings.spec).unwrap();
    let mut team = match Processes::start(&settings, &policy, conduct) {
        Ok(team) => team,
        Err(error) => return (Err(error), None),
    };
    let links = LinkSpec::parse("level(1)", 2).unwrap().build();
    let mut session = Session::new(Task::parse("hear-see").unwrap().environment(1), links, 0);
    let played = session.play(&mut team, 1, &mut [&mut Ledger::default()]);
    (played, Some(team))
}

#[test]
fn what_a_stranger_does_wrong_is_said_of_it() {
    for (what, says) in [
        ("version", "of the protocol, and this program version"),
        ("another", "speaks for agent-0"),
        ("exit", "ended with exit code 7; it said: out of ideas"),
        ("silent", "did not publish an observation within"),
        ("again", "did not decide within"),
        ("tick", "is at tick 2 when tick 1 is played"),
        ("length", "words as a message of kind 4"),
        ("number", "not numbers"),
        ("action", "chose an action it does not have: [99]"),
    ] {
        let (played, team) = play(what, OnFailure::Abort);
        let error = played.unwrap_err();
        assert!(error.is_loss(), "{what}: {error}");
        let error = error.to_string();
        assert!(error.starts_with("agent-1 ") && error.contains(says), "{what}: {error}");
        if let Some(team) = team {
            let (agents, tag) = swarm_of(&team);
            drop(team);
            common::assert_gone(&agents, &tag);
        }
    }
}

#[test]
fn an_observation_in_the_name_of_another_ends_the_run() {
    let (played, _team) = play("forges", OnFailure::Continue);
    let error = played.unwrap_err().to_string();
    assert!(error.contains("agent-1 published an observation in the name of agent-0"), "{error}");
}

#[test]
fn the_others_play_on_without_a_stranger_that_does_wrong() {
    let (played, team) = play("number", OnFailure::Continue);
    played.unwrap();
    let team = team.unwrap();
    assert_eq!((team.faults().hangs, team.faults().restarts), (1, 0));
    // It is tried again, and given up.
    let (played, team) = play("number", OnFailure::Restart);
    assert!(played.unwrap_err().to_string().contains("not numbers"));
    assert_eq!(team.unwrap().faults().restarts, 2);
}

#[test]
fn who_never_gets_ready_takes_those_along_that_it_started() {
    let settings = settings();
    let policy = settings.policy.load(&settings.spec).unwrap();
    let seconds = 7000 + std::process::id();
    let deadlines = Deadlines { ready: Duration::from_secs(2), ..Deadlines::default() };
    let sleeps = AgentCommand::new("sh").word("-c").word(format!("sleep {seconds} & wait"));
    let others = vec![(1, sleeps)];
    let conduct = Conduct { command: Some(common::this_binary()), others, deadlines, ..Conduct::default() };
    let error = Processes::start(&settings, &policy, conduct).unwrap_err().to_string();
    assert!(error.contains("agent-1") && error.contains("did not get ready within 2s"), "{error}");
    common::assert_no_process(&format!("sleep {seconds}$"));
}

#[test]
fn commands_that_make_no_sense() {
    for (words, says) in [
        ("--agent 2", "expected an agent and a command"),
        ("--agent x=true", "`x` is not an agent"),
        ("--agent 0=", "no words"),
        ("--task hear-see --agent 2=true", "there is no agent 2"),
        ("--task hear-see --agent 1=true --agent 1=false", "two commands"),
        ("--in-process --agent 1=true", "--in-process"),
    ] {
        fail(&format!("spawn --episodes 1 {words}"), 2, &[says]);
    }
    let nowhere = "spawn --task hear-see --episodes 1 --agent 1=/no/such/program";
    fail(nowhere, 1, &["agent-1 (/no/such/program)", "No such file"]);
    fail("spawn --task hear-see --episodes 1 --agent 1=false", 1, &["agent-1", "exit code 1"]);
}

#[test]
fn ours_is_examined_and_does_nothing_wrong() {
    let text = succeed(&format!("verify --agent {PROGRAM}"));
    assert!(text.matches("ok ").count() == 9 && !text.contains("FAIL"), "{text}");
    fail("verify --agent false", 1, &["agent-1", "exit code 1"]);
    fail("verify --agent true recordings/", 2, &["cannot be used with"]);
}

#[test]
fn what_an_examined_stranger_does_wrong_is_found() {
    for (what, says) in [
        ("another", "speaks for agent-0"),
        ("tick", "is at tick 2 when tick 1 is played"),
        ("stays", "was still there after 2s"),
    ] {
        // It stays because it is told nothing else; what else it does is not like ours either.
        let output = run_line(&["verify", "--json", "--agent", &wrong(what).to_string()]);
        assert_eq!(output.status.code(), Some(1), "{what}: {}", stderr(&output));
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(found.to_string().contains(says) && found["holds"] == false, "{what}: {found}");
    }
}

pub fn run_line(words: &[&str]) -> std::process::Output {
    Command::new(PROGRAM).args(words).output().unwrap()
}

/// Python with these packages; `None` where there is none.
pub fn python(packages: &str) -> Option<String> {
    let own = PathBuf::from(ROOT).join("target/python-agents/bin/python");
    let python = if own.exists() { own.display().to_string() } else { "python3".to_owned() };
    let has = Command::new(&python).args(["-c", &format!("import {packages}")]).output();
    if has.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    eprintln!("skipped: `{python}` has not all of {packages}; see docs/protocol.md");
    None
}

fn hold(python: &str) -> String {
    format!("{python} {ROOT}/agents/python/hold.py")
}

/// Has a team play as `words` say, once with our agents and once with this command as agent 1, and compares the two.
fn plays_as_ours_do(words: &str, command: &str) {
    let folder = tempfile::tempdir().unwrap();
    let play = |file: &str, more: &[&str]| {
        let path = folder.path().join(file);
        let to = path.display().to_string();
        let mut all: Vec<&str> = vec!["spawn", "--imputer", "hold", "--record", &to];
        all.extend(words.split(' '));
        all.extend(more);
        let output = run_line(&all);
        assert!(output.status.success(), "{words}: {}", stderr(&output));
        Recording::read(&path).unwrap()
    };
    let ours = play("ours.json", &[]);
    let theirs = play("theirs.json", &["--agent", &format!("1={command}")]);
    for (ours, theirs) in ours.episodes.iter().zip(&theirs.episodes) {
        assert_eq!((&ours.delivered, &ours.ages), (&theirs.delivered, &theirs.ages), "{words}");
        assert_eq!(ours.joint_estimate, theirs.joint_estimate, "{words}");
        assert_eq!(ours.actions, theirs.actions, "{words}");
        let logits = ours.logits.iter().flatten().zip(theirs.logits.iter().flatten());
        for (ours, theirs) in logits {
            let largest = ours.iter().fold(1.0f32, |largest, logit| largest.max(logit.abs()));
            let near = |(ours, theirs): (&f32, &f32)| (ours - theirs).abs() <= 1e-5 * largest;
            assert!(ours.iter().zip(theirs).all(near), "{words}: {ours:?} {theirs:?}");
        }
    }
}

#[test]
fn one_in_python_plays_as_ours_do() {
    let Some(python) = python("iceoryx2, numpy") else { return };
    plays_as_ours_do("--agents 4 --p 0.3 --greedy --episodes 2", &hold(&python));
    let delayed = "--task hear-see --links gilbert(0.1,0.3)+delay(1,2) --worlds 3 --episodes 4";
    plays_as_ours_do(delayed, &hold(&python));
}

#[test]
fn one_that_acts_by_an_onnx_file_plays_as_ours_do() {
    let Some(python) = python("iceoryx2, numpy, onnx, onnxruntime") else { return };
    let folder = tempfile::tempdir().unwrap();
    for (task, words) in [("spread-xy-4", "--agents 4"), ("hear-see", "--task hear-see --worlds 2")] {
        let file = folder.path().join(format!("{task}.onnx")).display().to_string();
        let (script, policy) = ("agents/python/to_onnx.py", "agents/pretrained");
        let policy = format!("{policy}/{task}/seed-0.safetensors");
        let made =
            Command::new(&python).args([script, &policy, "1", &file]).current_dir(ROOT).output().unwrap();
        assert!(made.status.success(), "{}", stderr(&made));
        let words = format!("{words} --p 0.4 --greedy --episodes 2");
        plays_as_ours_do(&words, &format!("{} {file}", hold(&python)));
    }
}

#[test]
fn one_in_python_keeps_up_with_the_clock_and_is_examined() {
    let Some(python) = python("iceoryx2, numpy") else { return };
    let agent = format!("1={}", hold(&python));
    let words =
        "spawn --agents 4 --p 0.5 --imputer hold --rate 100 --episodes 2 --deadline 10s --json --agent";
    let mut all: Vec<&str> = words.split(' ').collect();
    all.push(&agent);
    let output = run_line(&all);
    assert!(output.status.success(), "{}", stderr(&output));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["faults"]["hangs"], 0, "{summary}");
    assert_eq!(summary["commands"]["agent-1"], hold(&python), "{summary}");
    let output = run_line(&["verify", "--agent", &hold(&python)]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
    let other = format!("{} --imputer velocity", "spawn --task hear-see --episodes 1");
    let mut all: Vec<&str> = other.split(' ').collect();
    all.extend(["--agent", &agent]);
    let error = stderr(&run_line(&all));
    assert!(error.contains("agent-1") && error.contains("use --imputer hold"), "{error}");
}

/// Where each field of the header is.
fn places() -> Vec<(&'static str, usize)> {
    macro_rules! places {
        ($($field:ident)*) => { vec![$((stringify!($field), std::mem::offset_of!(Header, $field))),*] };
    }
    places!(protocol kind swarm incarnation sender episode tick step worlds length weights sent_ns deadline_ns absent)
}

#[test]
fn the_page_on_the_protocol_says_where_the_fields_of_the_header_are() {
    let page = std::fs::read_to_string(format!("{ROOT}/docs/protocol.md")).unwrap();
    assert!(page.contains(&format!("# The protocol, version {PROTOCOL}")));
    assert!(page.contains(&format!("({} bytes,", size_of::<Header>())));
    let places = places();
    let ends = places.iter().skip(1).map(|(_, at)| *at).chain([size_of::<Header>()]);
    for ((field, at), end) in places.iter().zip(ends) {
        let row = format!("| {at}-{} | `u{} {field}` |", end - 1, 8 * (end - at));
        assert!(page.contains(&row), "{row}");
    }
    // The structs for C are the same.
    let c = page.split("```c\n").nth(1).unwrap().split("```").next().unwrap();
    let asserts: String = places
        .iter()
        .map(|(field, at)| {
            format!("_Static_assert(offsetof(struct VamaroSwarmHeader, {field}) == {at}, \"{field}\");\n")
        })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("header.c");
    let size = size_of::<Header>();
    let size = format!("_Static_assert(sizeof(struct VamaroSwarmHeader) == {size}, \"size\");\n");
    std::fs::write(&file, format!("#include <stddef.h>\n{c}{asserts}{size}")).unwrap();
    let compiled = Command::new("cc")
        .args(["-Wall", "-Werror", "-Wno-unused-function", "-fsyntax-only"])
        .arg(&file)
        .output();
    let Ok(compiled) = compiled else { return eprintln!("skipped: this machine has no `cc`") };
    assert!(compiled.status.success(), "{}", stderr(&compiled));
}
