//! Files and limits through the real binary: what is written is whole, what is read is bounded, and what runs out is an
//! error with words.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::training::{Folder, SMALL};
use crate::common::{PROGRAM, Swarm, command, fail, run, settings_of, stderr, succeed};
use rustix::fs::{CWD, FileType, Mode, mknodat};
use serde_json::Value;

fn pipe_at(path: &Path) {
    mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
}

/// Runs a command that must refuse what `saying` names, and not wait for it.
fn refuse(words: &str, saying: &str) {
    let mut command = Command::new("timeout");
    command.args(["20", PROGRAM]).args(words.split_whitespace());
    let output = command.stdin(Stdio::null()).output().unwrap();
    let stderr = stderr(&output);
    assert!(matches!(output.status.code(), Some(1 | 2)), "{words}: {:?}, {stderr}", output.status);
    assert!(stderr.contains(saying) && !stderr.contains("panicked"), "{words}: {stderr}");
}

/// Runs a script of the shell in a mount namespace of its own; `None`, and a word, where this machine has none.
fn in_namespace(script: &str) -> Option<Output> {
    let output = Command::new("unshare").args(["-rm", "sh", "-c", "true"]).output();
    if !output.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: this machine allows no mount namespaces");
        return None;
    }
    let mut command = Command::new("unshare");
    Some(command.args(["-rm", "sh", "-c", script]).env("P", PROGRAM).output().unwrap())
}

#[test]
fn pipes_and_devices_are_refused_at_once() {
    let folder = Folder::new();
    let pipe = folder.path("pipe");
    pipe_at(&pipe);
    let policy = crate::common::data("traces/hear-see/policy.safetensors");
    let report = folder.path("report");
    fs::create_dir(&report).unwrap();
    pipe_at(&report.join("cells.jsonl"));
    for file in [pipe.as_path(), Path::new("/dev/zero")] {
        let file = file.display();
        refuse(&format!("train --config {file} --out {}", folder.path("out").display()), "pipe");
        refuse(&format!("bench world --compare {file}"), "pipe");
        refuse(&format!("verify {file}"), "");
        refuse(&format!("inspect {file}"), "");
        refuse(&format!("spawn --policy {file}"), "");
        refuse(
            &format!("import {file} --task hear-see --out {}", folder.path("policy").display()),
            "not a file",
        );
        refuse(&format!("spawn --agents 4 --links matrix({file})"), "pipe");
    }
    let (policy, report) = (policy.display(), report.display());
    refuse(&format!("evaluate {policy} --episodes 2 --report {report}"), "cells.jsonl");
    let out = folder.train("run", "--task hear-see --steps 2000 --in-process");
    for name in ["metrics.csv", "events.out.tfevents.vamaro-swarm"] {
        let (path, kept) = (out.join(name), folder.path("kept"));
        fs::rename(&path, &kept).unwrap();
        pipe_at(&path);
        refuse(&format!("train --resume --steps 4000 --out {}", out.display()), name);
        fs::rename(&kept, &path).unwrap();
    }
    assert!(!folder.path("out").exists());
}

#[test]
fn a_configuration_may_come_through_a_pipe() {
    let folder = Folder::new();
    let mut command = command(&format!("train --config /dev/stdin --out {}", folder.path("out").display()));
    let (reader, mut writer) = std::io::pipe().unwrap();
    std::io::Write::write_all(&mut writer, b"stepps = 1\n").unwrap();
    drop(writer);
    let output = command.stdin(reader).output().unwrap();
    let stderr = stderr(&output);
    assert!(stderr.contains("there is no setting `stepps`"), "it was read: {stderr}");
}

#[test]
fn a_limit_on_files_is_an_error_of_the_write() {
    let folder = Folder::new();
    let path = folder.path("recording.json");
    // 512 bytes a block.
    let script = format!(
        "ulimit -f 8; exec {PROGRAM} spawn --agents 2 --episodes 50 --in-process --record {}",
        path.display()
    );
    let output = Command::new("sh").args(["-c", &script]).output().unwrap();
    let stderr = stderr(&output);
    assert_eq!((output.status.code(), output.status.signal()), (Some(1), None), "{stderr}");
    assert!(stderr.contains("cannot write") && stderr.contains("recording.json"), "{stderr}");
    assert!(!path.exists());
}

#[test]
fn a_full_disk_keeps_the_last_good_state() {
    let train = |words: &str| format!("$P train {words} --checkpoint-every 0 --in-process >/dev/null");
    let script = [
        "mount -t tmpfs -o size=64m tmpfs /mnt".to_owned(),
        train(&format!("{SMALL} --task hear-see --steps 6000 --out /mnt/whole")),
        train(&format!("{SMALL} --task hear-see --steps 2000 --out /mnt/run")),
        "cp /mnt/run/checkpoint.safetensors /mnt/last; head -c 100m /dev/zero >/mnt/full 2>/dev/null"
            .to_owned(),
        format!("{}; echo $?", train("--resume --steps 6000 --out /mnt/run")),
        "cmp /mnt/run/checkpoint.safetensors /mnt/last; ls -A /mnt/run; rm /mnt/full".to_owned(),
        format!("{}; echo $?", train("--resume --steps 6000 --out /mnt/run")),
        "cmp /mnt/run/policy.safetensors /mnt/whole/policy.safetensors; echo same $?".to_owned(),
    ];
    let Some(output) = in_namespace(&script.join("\n")) else { return };
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output));
    let codes: Vec<&str> = stdout.lines().filter(|line| line.len() == 1).collect();
    assert_eq!(codes, ["1", "0"], "it stops, and goes on when there is room: {stdout}{stderr}");
    assert!(stderr.contains("cannot write") && !stderr.contains("panicked"), "{stderr}");
    assert!(!stdout.contains(".vamaro-swarm-") && !stdout.contains("differ"), "{stdout}");
    assert!(stdout.ends_with("same 0\n"), "nothing was lost: {stdout}{stderr}");
}

#[test]
fn metrics_of_another_time_are_refused() {
    let folder = Folder::new();
    let out = folder.train("run", "--task hear-see --steps 1000 --in-process");
    let path = out.join("metrics.csv");
    let text = fs::read_to_string(&path).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let (_, cells) = rows.lines().next().unwrap().split_once(',').unwrap();
    fs::write(&path, format!("{header}\n18446744073709551615,{cells}\n")).unwrap();
    fail(&format!("train --resume --steps 4000 --in-process --out {}", out.display()), 1, &["metrics.csv"]);
}

#[test]
fn settings_that_no_supervisor_writes_are_refused() {
    let swarm = Swarm::start("--agents 2 --p 0.5");
    let settings = settings_of(swarm.agents[0]).unwrap();
    for (at, value) in [
        ("/agent", Value::from(7)),
        ("/settings/worlds", Value::from(1u64 << 63)),
        ("/settings/worlds", Value::from(0)),
        // Twice that wraps to 2.
        ("/settings/spec/unique", Value::from((1u64 << 63) + 1)),
        ("/address/worlds", Value::from(1u64 << 63)),
        ("/address/agents", Value::from(3)),
        ("/address/longest_delay", Value::from(200)),
        ("/address/tag", Value::from("../../etc")),
    ] {
        let mut wrong = settings.clone();
        *wrong.pointer_mut(at).unwrap() = value;
        // The address comes first: by that a program knows what it was started for.
        let address = wrong.as_object_mut().unwrap().remove("address").unwrap();
        let rest = wrong.to_string();
        let text = format!("{{\"address\":{address},{}", rest.strip_prefix('{').unwrap());
        let output = Command::new(PROGRAM).args(["agent", &text]).output().unwrap();
        let stderr = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{at}: {stderr}");
        assert!(stderr.contains("no settings of an agent") && !stderr.contains("panicked"), "{at}: {stderr}");
    }
}

#[test]
fn swarms_that_start_together_share_what_memory_there_is() {
    // Each says how it ended: by itself, or with a word.
    let script = "mount -t tmpfs -o size=4m tmpfs /dev/shm; for i in 1 2 3 4 5 6 7 8; do \
                  ($P spawn --agents 4 --episodes 20 >/dev/null; echo $?) & done; wait; ls -A /dev/shm";
    let Some(output) = in_namespace(script) else { return };
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output));
    let refused = stderr.matches("shared memory is too small").count();
    let codes: Vec<&str> = stdout.lines().collect();
    assert_eq!(codes.len(), 8, "nothing is left: {stdout}");
    assert_eq!(codes.iter().filter(|code| **code == "1").count(), refused, "{stdout}{stderr}");
    assert_eq!(codes.iter().filter(|code| **code == "0").count(), 8 - refused, "{stdout}{stderr}");
    assert!(refused < 8, "some have room: {stderr}");
}

#[test]
fn a_neighbour_that_takes_all_memory_is_said_in_words() {
    let script = "mount -t tmpfs -o size=2m tmpfs /dev/shm; \
                  (while true; do head -c 4m /dev/zero >/dev/shm/full 2>/dev/null; rm -f /dev/shm/full; done) & filler=$!; \
                  for i in 1 2 3 4 5 6 7 8 9 10; do $P spawn --agents 4 --episodes 2 >/dev/null; echo $?; done; kill $filler";
    let Some(output) = in_namespace(script) else { return };
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output));
    assert_eq!(stdout.lines().count(), 10, "{stdout}{stderr}");
    assert!(stdout.lines().all(|code| matches!(code, "0" | "1")), "{stdout}{stderr}");
    // Who fails says so, and agents may say it as well.
    assert!(stdout.matches('1').count() <= stderr.matches("error: ").count(), "{stdout}{stderr}");
}

#[test]
fn doctor_says_what_starts_in_the_shared_memory_there_is() {
    let folder = Folder::new();
    for size in ["200k", "300k", "1m", "12m", "64m"] {
        let out = folder.path(size);
        let script = format!(
            "mount -t tmpfs -o size={size} tmpfs /dev/shm; $P doctor --json; echo $?; \
             $P spawn --episodes 1 >/dev/null 2>&1; echo $?; \
             $P train --task spread-xy-4 --steps 400 --set test_episodes=0 --out {} >/dev/null 2>&1; echo $?",
            out.display()
        );
        let Some(output) = in_namespace(&script) else { return };
        let stdout = String::from_utf8_lossy(&output.stdout).into_owned();
        let (json, codes) = stdout.split_once("\n}\n").unwrap();
        let codes: Vec<&str> = codes.lines().collect();
        assert_eq!(codes[0], codes[1], "{size}: doctor is about `spawn`: {json}");
        let (_, too_little) = json.split_once("too little for").unwrap_or_default();
        let trains = codes[0] == "0" && !too_little.contains("`train`");
        assert_eq!(trains, codes[2] == "0", "{size}: {json}");
    }
}

/// Kills a command at moments that have nothing to do with what it does, until `times` kills have hit a running program,
/// each followed by `check`.
fn kill_again_and_again(
    times: u32,
    mut start: impl FnMut(u32) -> Command,
    longest: Duration,
    mut check: impl FnMut(u32),
) {
    let (mut tried, mut killed) = (0, 0);
    while killed < times {
        let mut child = start(tried).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(longest.mul_f64(f64::from(tried * 7919 % 331) / 331.0));
        killed += u32::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
        check(tried);
        tried += 1;
        assert!(tried < 20 * times, "of {tried} kills {killed} hit a running program");
    }
    eprintln!("{killed} of {tried} kills hit a running program");
}

fn names(folder: &Path) -> Vec<String> {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
}

fn kill_while_checkpoints_are_written(times: u32) {
    let folder = Folder::new();
    let out = folder.path("run");
    // Every update is followed by a checkpoint.
    let start = |_| {
        let words = if out.join("checkpoint.safetensors").exists() {
            "--resume".to_owned()
        } else {
            format!("{SMALL} --task hear-see --steps 20M")
        };
        command(&format!("train {words} --checkpoint-every 0 --in-process --out {}", out.display()))
    };
    let mut last = 0;
    kill_again_and_again(times, start, Duration::from_millis(400), |_| {
        let path = out.join("checkpoint.safetensors");
        if path.exists() {
            let text = succeed(&format!("inspect {}", path.display()));
            let words = text.split_whitespace().filter_map(|word| word.replace(',', "").parse::<u64>().ok());
            last = last.max(words.max().unwrap_or(0));
        }
        let policy = out.join("policy.safetensors");
        if policy.exists() {
            succeed(&format!("inspect {}", policy.display()));
        }
    });
    assert!(last > 0);
}

fn kill_while_recordings_are_written(times: u32) {
    let folder = Folder::new();
    let path = folder.path("recording.json");
    let words = |seed: u32| {
        format!("spawn --agents 2 --episodes 20 --in-process --seed {seed} --record {}", path.display())
    };
    let whole: Vec<Vec<u8>> = [0, 1]
        .map(|seed| {
            succeed(&words(seed));
            fs::read(&path).unwrap()
        })
        .into();
    let started = Instant::now();
    succeed(&words(0));
    let longest = started.elapsed();
    let parent = path.parent().unwrap().to_owned();
    let mut found = [0, 0];
    kill_again_and_again(
        times,
        |time| command(&words(time % 2)),
        longest,
        |_| {
            let bytes = fs::read(&path).unwrap();
            let which = whole.iter().position(|one| *one == bytes).expect("the old or the new one is whole");
            found[which] += 1;
            // A part may have its name in the moment before it replaces the old one, and then it is whole.
            for name in names(&parent).into_iter().filter(|name| name != "recording.json") {
                fs::remove_file(parent.join(name)).unwrap();
            }
        },
    );
    eprintln!("found the one recording and the other {found:?} times");
}

fn kill_while_results_are_written(times: u32) {
    let folder = Folder::new();
    let policy: PathBuf = crate::common::data("traces/hear-see/policy.safetensors");
    let words = |report: &str| {
        let report = folder.path(report);
        format!(
            "evaluate {} --episodes 5 --levels 1,0.2 --imputers hold,zero --report {}",
            policy.display(),
            report.display()
        )
    };
    let started = Instant::now();
    succeed(&words("whole"));
    let longest = started.elapsed();
    let whole = |name: &str| fs::read(folder.path("whole").join(name)).unwrap();
    let report = folder.path("killed");
    kill_again_and_again(
        times,
        |time| {
            // From the start again when it is complete.
            if time % 5 == 0 {
                let _ = fs::remove_dir_all(&report);
            }
            command(&words("killed"))
        },
        longest,
        |_| {
            for name in if report.exists() { names(&report) } else { Vec::new() } {
                if report.join(&name).is_dir() {
                    continue; // The replays that it links.
                }
                let bytes = fs::read(report.join(&name)).unwrap();
                if name == "cells.jsonl" {
                    assert!(whole(&name).starts_with(&bytes), "a line that has ended is whole");
                } else if name.ends_with(".json") {
                    serde_json::from_slice::<Value>(&bytes).unwrap();
                }
            }
        },
    );
    succeed(&words("killed"));
    assert_eq!(fs::read(report.join("cells.jsonl")).unwrap(), whole("cells.jsonl"));
}

#[test]
fn a_killed_write_leaves_the_old_or_the_new_file() {
    kill_while_checkpoints_are_written(8);
    kill_while_recordings_are_written(8);
    kill_while_results_are_written(8);
}

#[test]
#[ignore = "500 kills take minutes"]
fn five_hundred_killed_checkpoints() {
    kill_while_checkpoints_are_written(500);
}

#[test]
#[ignore = "500 kills take minutes"]
fn five_hundred_killed_recordings() {
    kill_while_recordings_are_written(500);
}

#[test]
#[ignore = "500 kills take minutes"]
fn five_hundred_killed_results() {
    kill_while_results_are_written(500);
}

#[test]
fn files_of_another_version_are_refused_by_name_and_version() {
    let folder = Folder::new();
    let out = folder.train("run", "--task hear-see --steps 1000 --in-process");
    for (name, words) in [
        ("policy.safetensors", format!("spawn --task hear-see --policy {}", out.display())),
        (
            "checkpoint.safetensors",
            format!("train --resume --steps 2000 --in-process --out {}", out.display()),
        ),
    ] {
        let path = out.join(name);
        let good = fs::read(&path).unwrap();
        let (from, to) = (&b"\"version\":\"1\""[..], b"\"version\":\"9\"");
        let at = good.windows(from.len()).position(|window| window == from).unwrap();
        let mut other = good.clone();
        other[at..at + to.len()].copy_from_slice(to);
        fs::write(&path, other).unwrap();
        fail(&words, 2, &[name, "version 9", "version 1"]);
        fs::write(&path, good).unwrap();
    }
    let policy = crate::common::data("traces/hear-see/policy.safetensors");
    let report = folder.path("report");
    let evaluate = format!("evaluate {} --episodes 2 --report {}", policy.display(), report.display());
    succeed(&evaluate);
    let cells = report.join("cells.jsonl");
    let text = fs::read_to_string(&cells).unwrap();
    fs::write(&cells, text.replacen("\"version\":2", "\"version\":9", 1)).unwrap();
    fail(&evaluate, 2, &["cells.jsonl", "version 9", "version 2"]);
    assert!(run("--version").status.success());
}
