//! Training runs that are stopped, killed, resumed and damaged: nothing is lost, and nothing of it shows.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::training::{Folder, SMALL, assert_same, result};
use crate::common::{self, Swarm, assert_gone, command, fail, succeed};
use rustix::process::{Signal, kill_process};
use serde_json::Value;

/// Starts a run that saves after every update.
fn start(words: &str, out: &Path) -> std::process::Child {
    let words = format!("train {SMALL} --checkpoint-every 0 --out {} {words}", out.display());
    let mut command = command(&words);
    command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::null()).spawn().unwrap()
}

/// Waits until a run has learned: then there is a row after that of the beginning.
fn await_learning(out: &Path) {
    let deadline = Instant::now() + Duration::from_secs(60);
    while fs::read_to_string(out.join("metrics.csv")).map_or(0, |text| text.lines().count()) < 3 {
        assert!(Instant::now() < deadline, "the run does not learn");
        std::thread::sleep(Duration::from_millis(1));
    }
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
    await_learning(&out);
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
    await_learning(&out);
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

/// The checkpoint was written before episodes could end early and predictors could see actions:
/// 500 steps, with a batch that updates share and episodes to replay. `went-on.csv` is what that program made of 500 more.
#[test]
fn a_checkpoint_of_an_older_program_goes_on_as_it_did_there() {
    let folder = Folder::new();
    let (old, run) = (common::data("checkpoints/before-early-ends"), folder.path("run"));
    fs::create_dir(&run).unwrap();
    for name in ["checkpoint.safetensors", "config.toml", "metrics.csv"] {
        fs::copy(old.join(name), run.join(name)).unwrap();
    }
    let inspected = succeed(&format!("inspect {}", run.join("checkpoint.safetensors").display()));
    assert!(inspected.contains("500 of 500 env steps, 20 episodes"), "{inspected}");
    succeed(&format!("train --resume --in-process --steps 1000 --out {}", run.display()));
    let read = |path: &Path| fs::read_to_string(path).unwrap();
    let (metrics, expected) = (read(&run.join("metrics.csv")), read(&old.join("went-on.csv")));
    assert!(metrics.starts_with(&read(&old.join("metrics.csv"))), "what was written stays");
    let last = |text: &str| -> Vec<f64> {
        text.lines().last().unwrap().split(',').map(|value| value.parse().unwrap_or(f64::NAN)).collect()
    };
    let (found, expected) = (last(&metrics), last(&expected));
    assert_eq!(found[..3], [1000.0, 40.0, 19.0], "timestep, episodes, updates");
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected).filter(|(_, expected)| !expected.is_nan()) {
        // The last bits are those of the instruction set.
        assert!((found - expected).abs() <= 1e-4 * (1.0 + expected.abs()), "{found} is not {expected}");
    }
}

#[test]
fn actions_that_nobody_has_are_refused() {
    let folder = Folder::new();
    let words = "--steps 500 --in-process --set update_every=5 --set predictor_inputs=estimate,own-action";
    let run = folder.train("run", words);
    let checkpoint = run.join("checkpoint.safetensors");
    let good = fs::read(&checkpoint).unwrap();
    let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    let tensors: Value = serde_json::from_slice(&good[8..header]).unwrap();
    for name in ["batch.actions", "replay.actions"] {
        for action in [200.0f32, -1.0, f32::NAN] {
            let mut bytes = good.clone();
            let first = tensors[name]["data_offsets"][0].as_u64().unwrap() as usize;
            bytes[header + first..][..4].copy_from_slice(&action.to_le_bytes());
            fs::write(&checkpoint, bytes).unwrap();
            let resume = format!("train --resume --in-process --steps 1000 --out {}", run.display());
            fail(&resume, 1, &["damaged", name]);
        }
    }
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
    let version = b"\"version\":\"1\"";
    let at = good.windows(version.len()).position(|bytes| bytes == version).expect("it is in the metadata");
    let mut other = good.clone();
    other[at + 11] = b'7';
    fs::write(&checkpoint, other).unwrap();
    fail(&resume, 2, &["version 7", "version 1"]);
    fs::copy(run.join("policy.safetensors"), &checkpoint).unwrap();
    fail(&resume, 2, &["not a checkpoint"]);
    fs::write(&checkpoint, &good).unwrap();
    // Metrics that do not go as far as the checkpoint.
    let metrics = fs::read_to_string(run.join("metrics.csv")).unwrap();
    fs::write(run.join("metrics.csv"), metrics.lines().next().unwrap()).unwrap();
    fail(&resume, 1, &["metrics.csv"]);
    fs::write(run.join("metrics.csv"), metrics).unwrap();
    succeed(&resume);
}
