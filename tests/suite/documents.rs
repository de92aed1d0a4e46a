//! The commands that README and docs give: all are understood, and those that one begins with run.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::training::SMALL;
use crate::common::{PROGRAM, stderr};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The commands of the program in the shell blocks of a document, without what others do with their output.
fn commands(document: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(document).unwrap();
    let blocks = text.split("```sh\n").skip(1).map(|rest| rest.split("```").next().unwrap());
    let lines =
        blocks.collect::<String>().replace("\\\n", " ").replace("cargo run --release --", "vamaro-swarm");
    let ours = lines.lines().filter(|line| line.starts_with("vamaro-swarm "));
    ours.map(alone).collect()
}

/// A command without what others do with its output.
pub fn alone(line: &str) -> String {
    [" #", " | ", " > "].iter().fold(line, |line, end| line.split(end).next().unwrap()).to_owned()
}

/// Has a shell run a command in a folder, which is home to it; what it wrote to stdout.
pub fn run_in(line: &str, folder: &Path) -> String {
    let line = line.replacen("vamaro-swarm", "\"$0\"", 1);
    let output = Command::new("sh")
        .args(["-c", &line, PROGRAM])
        .current_dir(folder)
        .env("HOME", folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{line}: {}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn all_are_understood() {
    let docs = std::fs::read_dir(root().join("docs")).unwrap().map(|entry| entry.unwrap().path());
    let pages: Vec<PathBuf> = docs.filter(|path| path.extension().is_some_and(|it| it == "md")).collect();
    // What only some builds have, only some understand.
    let pages = pages.iter().filter(|page| cfg!(feature = "hosts") || !page.ends_with("hosts.md"));
    let lines: Vec<String> = pages.flat_map(|page| commands(page)).collect();
    assert!(lines.len() > 20, "{lines:?}");
    for line in lines {
        // Options before this one are read first.
        assert!(run_in(&format!("{line} --help"), root()).contains("Usage: vamaro-swarm"), "{line}");
    }
}

#[test]
fn those_that_one_begins_with_run() {
    let folder = tempfile::tempdir().unwrap();
    let lines = ["README.md", "docs/installing.md"].map(|name| commands(&root().join(name))).concat();
    assert!(lines.len() > 10, "{lines:?}");
    for line in lines {
        // What takes long does less of the same.
        let line = match line.split(' ').nth(1) {
            Some("train") => line.replace("--steps 1M", "--steps 2000 --in-process") + " " + SMALL,
            Some("evaluate") => line + " --episodes 4 --levels 1,0 --in-process",
            _ => line,
        };
        assert!(!run_in(&line, folder.path()).is_empty(), "{line}");
    }
}
