//! Training through the real binary: what a run leaves, and that nothing but its settings decides it.

mod common;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use common::{Swarm, assert_gone, command, fail, run, stderr, succeed};
use rustix::process::{Signal, kill_process};
use serde_json::Value;

/// Networks and tests that are small, so that a run takes a second.
const SMALL: &str = "--set hidden=32 --set predictor_hidden=16 --set test_episodes=4 --set test_interval=2000 \
                     --set replay_batch=8";

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A run that must succeed, in a folder of this name.
    fn train(&self, name: &str, words: &str) -> PathBuf {
        succeed(&format!("train {SMALL} --out {} {words}", self.path(name).display()));
        self.path(name)
    }
}

/// What must be the same in two runs of the same settings.
fn result(run: &Path) -> (String, Vec<u8>) {
    let read = |name: &str| fs::read(run.join(name)).unwrap();
    (String::from_utf8(read("metrics.csv")).unwrap(), read("policy.safetensors"))
}

fn assert_same(a: &Path, b: &Path) {
    let ((metrics, policy), (others, other)) = (result(a), result(b));
    assert_eq!(metrics, others);
    assert!(policy == other, "{} and {} have different policies", a.display(), b.display());
}

#[test]
fn a_run_leaves_what_it_promises() {
    let folder = Folder::new();
    let run = folder.train("hs", "--task hear-see --steps 6000 --in-process");
    let mut names: Vec<String> =
        fs::read_dir(&run).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let events = names.iter().position(|name| name.contains("tfevents")).unwrap();
    names.remove(events);
    assert_eq!(
        names,
        ["checkpoint.safetensors", "config.toml", "curves.svg", "metrics.csv", "policy.safetensors"]
    );
    // Rows at 0, 2000, 4000 and 6000 timesteps.
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    let timesteps: Vec<&str> = metrics.lines().skip(1).map(|line| line.split(',').next().unwrap()).collect();
    assert_eq!(timesteps, ["0", "2000", "4000", "6000"]);
    let header = metrics.lines().next().unwrap();
    for column in ["return_mean", "pg_loss", "value-aware/nll", "maro/test_p=0.2_return_mean"] {
        assert!(header.split(',').any(|name| name == column), "{column} is not in {header}");
    }
    assert!(fs::read_to_string(run.join("config.toml")).unwrap().contains("hidden = 32"));
    // The policy is one like any other, and can be kept in half the size.
    let kept = folder.path("kept.safetensors");
    succeed(&format!("export {} --out {}", run.display(), kept.display()));
    assert!(
        kept.metadata().unwrap().len() < run.join("policy.safetensors").metadata().unwrap().len() * 6 / 10
    );
    succeed(&format!("spawn --policy {} --episodes 1", kept.display()));
    let inspected = succeed(&format!("inspect {}", run.join("policy.safetensors").display()));
    assert!(inspected.contains("mappo, 6000 env steps"), "{inspected}");
    for imputer in ["value-aware", "maro"] {
        let words = format!(
            "spawn --task hear-see --policy {} --imputer {imputer} --episodes 2 --p 0.2",
            run.display()
        );
        succeed(&words);
    }
}

#[test]
fn every_column_of_every_kind_of_run_is_defined_in_the_docs() {
    let folder = Folder::new();
    let docs = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/metrics.md")).unwrap();
    let run = folder.train("hs", "--steps 250 --in-process --predictors value-aware,maro,lambda0,maro-carry");
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    for column in metrics.lines().next().unwrap().split(',') {
        let name = column.rsplit('/').next().unwrap();
        let name = match name.strip_prefix("test_p=") {
            Some(test) => format!("test_p=<level>{}", &test[test.find('_').unwrap()..]),
            None => name.to_owned(),
        };
        assert!(docs.contains(&name), "{column} (`{name}`) is not in docs/metrics.md");
    }
}

#[test]
fn every_setting_is_explained_in_the_docs() {
    let docs = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/training.md")).unwrap();
    let plan = succeed("train --dry-run --set hidden=16 --set test_episodes=1");
    let settings = plan.lines().filter_map(|line| line.split_once(" = "));
    let mut count = 0;
    for (key, _) in settings.filter(|(key, _)| !key.starts_with('#')) {
        assert!(docs.contains(&format!("| `{key}` |")), "{key} is not in docs/training.md");
        count += 1;
    }
    assert!(count > 30, "{plan}");
}

#[test]
fn processes_and_threads_change_nothing() {
    let folder = Folder::new();
    for (task, more) in [
        ("hear-see", "--predictors value-aware,maro,lambda0,maro-carry --set predictor_updates=2"),
        ("spread-xy-4", "--train-p uniform --algorithm ippo --set share_actors=true --set update_every=3"),
    ] {
        let words = format!("--task {task} --steps 3000 {more}");
        let processes = folder.train(&format!("{task}-processes"), &words);
        let one = folder.train(&format!("{task}-one"), &format!("{words} --in-process --threads 1"));
        let three = folder.train(&format!("{task}-three"), &format!("{words} --in-process --threads 3"));
        assert_same(&processes, &one);
        assert_same(&processes, &three);
    }
}

#[test]
fn settings_decide_what_comes_out() {
    let folder = Folder::new();
    let settings = [
        "",
        "--seed 1",
        "--task spread-xy-2",
        "--task spread-xy-2 --algorithm ippo",
        "--set critic_input=local",
        "--set advantage=gae",
        "--set share_actors=true",
        "--set share_critics=true",
        "--set standardise_rewards=false",
        "--set update_every=1",
        "--set epochs=3",
        "--set actor=gru",
        "--train-p 0.5",
        "--train-p uniform",
        "--preset published-code",
    ];
    // What was measured and not the policy file, which says by itself how it was trained.
    let mut metrics = Vec::new();
    for (at, setting) in settings.iter().enumerate() {
        let run = folder.train(&at.to_string(), &format!("--steps 1000 --in-process {setting}"));
        metrics.push(result(&run).0);
    }
    for (at, run) in metrics.iter().enumerate() {
        let same = metrics[..at].iter().position(|other| other == run);
        assert_eq!(same, None, "{:?} changes nothing", settings[at]);
    }
}

#[test]
fn predictors_beside_a_policy_do_not_change_it() {
    let folder = Folder::new();
    let both = folder.train("both", "--steps 3000 --in-process");
    let alone = folder.train("alone", "--steps 3000 --in-process --predictors maro");
    let column = |run: &Path, name: &str| -> Vec<String> {
        let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
        let at = metrics.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
        metrics.lines().skip(1).map(|line| line.split(',').nth(at).unwrap().to_owned()).collect()
    };
    for name in ["return_mean", "critic_loss", "pg_loss", "maro/loss", "maro/test_p=0.2_return_mean"] {
        assert_eq!(column(&both, name), column(&alone, name), "{name}");
    }
}

/// Starts a run that saves after every update.
fn start(words: &str, out: &Path) -> std::process::Child {
    let words = format!("train {SMALL} --checkpoint-every 0 --out {} {words}", out.display());
    let mut command = command(&words);
    command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null()).spawn().unwrap()
}

#[test]
fn a_run_that_is_killed_again_and_again_ends_as_if_it_had_not_been() {
    let folder = Folder::new();
    for (name, words) in [
        ("plain", "--task hear-see --steps 40000 --predictors value-aware,maro-carry"),
        ("overlapping", "--task spread-xy-2 --steps 9000 --set update_every=3 --train-p 0.6 --in-process"),
    ] {
        let began = Instant::now();
        let whole = folder.train(&format!("{name}-whole"), words);
        // The killed run takes no less: it writes more checkpoints.
        let longest = began.elapsed() / 5;
        let out = folder.path(&format!("{name}-killed"));
        let mut killed = 0;
        let mut child = start(words, &out);
        // Moments that have nothing to do with what the run is doing.
        for part in (1..=40).map(|n| f64::from(n * 7919 % 331) / 331.0) {
            std::thread::sleep(longest.mul_f64(part));
            if child.try_wait().unwrap().is_some() {
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
            killed += 1;
            let resume = out.join("checkpoint.safetensors").exists();
            child = start(if resume { "--resume" } else { words }, &out);
        }
        assert!(killed > 0, "{name} was never killed");
        let deadline = Instant::now() + Duration::from_secs(120);
        while child.try_wait().unwrap().is_none() {
            assert!(Instant::now() < deadline, "{name} does not end");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert_same(&whole, &out);
    }
    // What agents of killed runs have left behind goes.
    succeed("doctor --clean");
}

#[test]
fn a_finished_run_goes_on_to_more_steps() {
    let folder = Folder::new();
    let whole = folder.train("whole", "--steps 7000 --in-process");
    // 3250 ends between two rows of the longer run.
    let parts = folder.train("parts", "--steps 3250 --in-process");
    assert_eq!(fs::read_to_string(parts.join("metrics.csv")).unwrap().lines().count(), 4);
    let resume = format!("train --resume --out {} --in-process", parts.display());
    let unchanged = result(&parts);
    succeed(&resume);
    assert!(result(&parts) == unchanged, "a finished run has nothing to do");
    succeed(&format!("{resume} --steps 7k"));
    assert_same(&whole, &parts);
    let events = |run: &Path| {
        let files = fs::read_dir(run).unwrap().map(|entry| entry.unwrap());
        files
            .filter(|file| file.file_name().to_string_lossy().contains("tfevents"))
            .map(|f| f.metadata().unwrap().len())
            .collect::<Vec<_>>()
    };
    assert_eq!(events(&whole), events(&parts));
}

#[test]
fn a_run_whose_updates_are_longer_than_its_intervals_has_one_row_for_each() {
    let folder = Folder::new();
    let rows = |run: &Path| fs::read_to_string(run.join("metrics.csv")).unwrap().lines().count() - 1;
    let whole = folder.train("whole", "--steps 1500 --in-process --set test_interval=100");
    assert_eq!(rows(&whole), 7);
    let parts = folder.train("parts", "--steps 750 --in-process --set test_interval=100");
    let resume = format!("train --resume --out {} --in-process", parts.display());
    succeed(&resume);
    assert_eq!(rows(&parts), 4);
    succeed(&format!("{resume} --steps 1500"));
    assert_same(&whole, &parts);
}

#[test]
fn a_run_that_stopped_while_its_folder_was_made_can_be_resumed() {
    let folder = Folder::new();
    let words = "--steps 500 --in-process";
    let whole = folder.train("whole", words);
    // A run that stops at once leaves what `create` makes, in its order: checkpoint, config, metrics, events.
    let out = folder.path("run");
    fail(
        &format!("train {SMALL} {words} --set learning_rate=1e30 --out {}", out.display()),
        1,
        &["diverged"],
    );
    let made = ["config.toml", "metrics.csv", "events.out.tfevents.vamaro-swarm"];
    let resume = format!("train --resume --in-process --out {}", out.display());
    for missing in 0..made.len() {
        made[missing..].iter().for_each(|name| fs::remove_file(out.join(name)).unwrap());
        fail(&resume, 1, &["diverged"]);
        assert!(made.iter().all(|name| out.join(name).exists()));
    }
    // The settings are then those of the checkpoint.
    fs::remove_file(whole.join("config.toml")).unwrap();
    let finished = result(&whole);
    succeed(&format!("train --resume --in-process --out {}", whole.display()));
    assert!(result(&whole) == finished && whole.join("config.toml").exists());
}

#[test]
fn an_agent_that_dies_stops_the_run_and_loses_nothing() {
    let folder = Folder::new();
    let words = "--task hear-see --steps 30000";
    let whole = folder.train("whole", &format!("{words} --in-process"));
    let out = folder.path("killed");
    let swarm = Swarm::of(&format!("train {SMALL} {words} --out {}", out.display()));
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    std::thread::sleep(Duration::from_millis(100));
    kill_process(agents[1], Signal::KILL).unwrap();
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("agent-1") && stderr.contains("--resume"), "{stderr}");
    assert_gone(&agents, &tag);
    succeed(&format!("train --resume --out {}", out.display()));
    assert_same(&whole, &out);
}

#[test]
fn interrupting_keeps_what_was_learned() {
    let folder = Folder::new();
    let out = folder.path("run");
    let swarm = Swarm::of(&format!("train {SMALL} --steps 100M --out {}", out.display()));
    let (agents, tag) = (swarm.agents.clone(), swarm.tag.clone());
    // It has learned once there is a row after that of the beginning.
    let deadline = Instant::now() + Duration::from_secs(60);
    while fs::read_to_string(out.join("metrics.csv")).is_ok_and(|text| text.lines().count() < 3) {
        assert!(Instant::now() < deadline, "the run does not learn");
        std::thread::sleep(Duration::from_millis(10));
    }
    swarm.signal_supervisor(Signal::TERM);
    let (code, _, stderr) = swarm.wait();
    assert_eq!(code, Some(130), "{stderr}");
    assert!(stderr.contains("--resume --out"), "{stderr}");
    assert_gone(&agents, &tag);
    let inspected = succeed(&format!("inspect {}", out.join("policy.safetensors").display()));
    assert!(!inspected.contains(" 0 env steps"), "{inspected}");
}

#[test]
fn a_folder_is_for_one_run_at_a_time() {
    let folder = Folder::new();
    let out = folder.path("run");
    let mut child = start("--steps 100M --in-process", &out);
    let deadline = Instant::now() + Duration::from_secs(30);
    while !out.join("metrics.csv").exists() {
        assert!(Instant::now() < deadline, "the run does not start");
        std::thread::sleep(Duration::from_millis(10));
    }
    fail(&format!("train --out {}", out.display()), 2, &["in use", "--out"]);
    fail(&format!("train --resume --out {}", out.display()), 2, &["in use"]);
    child.kill().unwrap();
    child.wait().unwrap();
    fail(&format!("train --out {}", out.display()), 2, &["--resume"]);
}

#[test]
fn training_that_diverges_stops_with_the_last_good_checkpoint() {
    let folder = Folder::new();
    let out = folder.path("run");
    let words = format!("train {SMALL} --in-process --steps 100000 --out {}", out.display());
    fail(&format!("{words} --set learning_rate=1e30"), 1, &["diverged", "finite", "learning rate"]);
    // The checkpoint is whole, and knows what the run was told.
    fail(&format!("train --resume --in-process --out {}", out.display()), 1, &["diverged"]);
}

#[test]
fn many_seeds_side_by_side() {
    let folder = Folder::new();
    let out = folder.path("hs");
    // A seed among the settings does not make all runs the same one.
    let words = format!(
        "train {SMALL} --set seed=9 --steps 1000 --in-process --seeds 3..5 --jobs 2 --out {}",
        out.display()
    );
    let summary = succeed(&words);
    assert!(summary.contains("seed 3") && summary.contains("seed 4"), "{summary}");
    let alone = folder.train("alone", "--steps 1000 --in-process --seed 4");
    assert_same(&alone, &folder.path("hs-4"));
    // Once more: one of them is done, the other has never begun.
    fs::remove_dir_all(folder.path("hs-3")).unwrap();
    succeed(&format!("{words} --resume"));
    assert!(folder.path("hs-3").join("policy.safetensors").exists());
    let refused = run(&words);
    assert_eq!(refused.status.code(), Some(1));
    let said = stderr(&refused);
    assert!(said.contains("[seed 3] error") && said.contains("3, 4"), "{said}");
}

#[test]
fn a_dry_run_plans_and_writes_nothing() {
    let folder = Folder::new();
    let out = folder.path("run");
    let plan = succeed(&format!("train {SMALL} --steps 1M --dry-run --out {}", out.display()));
    for part in [
        "1000000 env steps to go",
        "4000 updates",
        "env steps/s",
        " MB",
        "hidden = 32",
        "task = \"hear-see\"",
    ] {
        assert!(plan.contains(part), "{part} is not in {plan}");
    }
    assert!(!out.exists());
    // What it prints is a configuration.
    let config = folder.path("config.toml");
    fs::write(&config, plan).unwrap();
    succeed(&format!("train --config {} --steps 250 --in-process --out {}", config.display(), out.display()));
}

#[test]
fn a_summary_that_programs_read() {
    let folder = Folder::new();
    let words =
        format!("train {SMALL} --steps 500 --in-process --json --out {}", folder.path("run").display());
    let summary: Value = serde_json::from_str(&succeed(&words)).unwrap();
    assert_eq!((&summary["task"], &summary["timesteps"]), (&"hear-see".into(), &500.into()));
    assert_eq!(summary["tests"].as_array().unwrap().len(), 12);
    assert_eq!(summary["tests"][0]["return_mean"], summary["tests"][6]["return_mean"], "p = 1 is one test");
}

#[test]
fn bad_requests_are_refused_and_nothing_is_written() {
    let folder = Folder::new();
    let out = folder.path("run");
    let with = |words: &str| format!("train --out {} {words}", out.display());
    fail(&with("--set learning_rat=1"), 2, &["learning_rat", "nearest is `learning_rate`"]);
    fail(&with("--set clip"), 2, &["KEY=VALUE"]);
    fail(&with("--set clip=wide"), 2, &["`clip`"]);
    fail(&with("--task hear-sea"), 2, &["hear-sea", "hear-see"]);
    fail(&with("--steps 1.5"), 2, &["--steps", "1e6"]);
    fail(&with("--steps 0"), 2, &["--steps"]);
    fail(&with("--train-p 1.5"), 2, &["train_p", "0 to 1"]);
    fail(&with("--train-p 0.5 --set predictors=[]"), 2, &["needs a predictor"]);
    fail(&with("--predictors kalman"), 2, &["kalman", "value-aware"]);
    fail(&with("--config nowhere.toml"), 2, &["nowhere.toml"]);
    fail(&with("--resume"), 2, &["no run to resume"]);
    fail(&with("--seeds 5..5"), 2, &["--seeds"]);
    fail(&with("--seeds 0..2 --seed 1"), 2, &["--seed"]);
    fail(&with("--jobs 2"), 2, &["--seeds"]);
    fail("train --resume", 2, &["--out"]);
    assert!(!out.exists());
    let file = folder.path("file");
    fs::write(&file, "something else").unwrap();
    fail(&format!("train --out {}", file.display()), 1, &["file"]);
    let config = folder.path("config.toml");
    fs::write(&config, "clip = 0.2\nepoch = 3\n").unwrap();
    fail(&with(&format!("--config {}", config.display())), 2, &["config.toml", "`epoch`", "`epochs`"]);
}

#[test]
fn actions_that_nobody_has_are_refused() {
    let folder = Folder::new();
    let run = folder.train("run", "--steps 500 --in-process --set update_every=5");
    let checkpoint = run.join("checkpoint.safetensors");
    let mut bytes = fs::read(&checkpoint).unwrap();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let tensors: Value = serde_json::from_slice(&bytes[8..header]).unwrap();
    let first = tensors["batch.actions"]["data_offsets"][0].as_u64().unwrap() as usize;
    bytes[header + first..][..4].copy_from_slice(&200f32.to_le_bytes());
    fs::write(&checkpoint, bytes).unwrap();
    let resume = format!("train --resume --in-process --steps 1000 --out {}", run.display());
    fail(&resume, 1, &["damaged", "batch.actions"]);
}

#[test]
fn checkpoints_of_other_runs_and_damaged_ones_are_refused() {
    let folder = Folder::new();
    let run = folder.train("run", "--steps 500 --in-process");
    let resume = format!("train --resume --in-process --out {}", run.display());
    fail(&format!("{resume} --set clip=0.3"), 2, &["other settings", "`clip` was 0.2 and is now 0.3"]);
    fail(&format!("{resume} --task spread-xy-2"), 2, &["`task` was \"hear-see\""]);
    let checkpoint = run.join("checkpoint.safetensors");
    let good = fs::read(&checkpoint).unwrap();
    // A truncated file, another version, a policy in its place.
    fs::write(&checkpoint, &good[..good.len() - 4]).unwrap();
    fail(&resume, 1, &["damaged"]);
    let text = String::from_utf8_lossy(&good).into_owned();
    let at = text.find("\"version\":\"1\"").expect("the metadata is at the beginning");
    let mut other = good.clone();
    other[at + 11] = b'7';
    fs::write(&checkpoint, other).unwrap();
    fail(&resume, 2, &["version 7", "version 1"]);
    fs::copy(run.join("policy.safetensors"), &checkpoint).unwrap();
    fail(&resume, 2, &["no checkpoint"]);
    fs::write(&checkpoint, &good).unwrap();
    // Metrics that do not go as far as the checkpoint.
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    fs::write(run.join("metrics.csv"), metrics.lines().next().unwrap()).unwrap();
    fail(&resume, 1, &["metrics.csv"]);
    fs::write(run.join("metrics.csv"), metrics).unwrap();
    succeed(&resume);
}
