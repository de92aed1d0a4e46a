//! Traces as MCAP: what a compact trace holds, readable to the last whole episode, and nothing believed of a damaged file.

use std::ops::Range;
use std::path::PathBuf;
use std::process::Stdio;
use std::time::{Duration, Instant};

use vamaro_swarm::recording::Recording;

use crate::common::{command, fail, run, stderr, succeed};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn at(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    fn record(&self, words: &str, name: &str) -> Recording {
        succeed(&format!("spawn {words} --record {}", self.at(name)));
        self.read(name).unwrap()
    }

    fn read(&self, name: &str) -> Result<Recording, String> {
        Recording::read(&self.path(name)).map_err(|e| e.to_string())
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).unwrap();
    }
}

const CHAOS: &str = "--task hear-see --p 0.5 --episodes 6 --seed 2 --chaos kill=0.05:300ms,stop=0.05:200ms";

#[test]
fn they_are_the_same_trace_and_are_seen_and_verified_alike() {
    let folder = Folder::new();
    for words in [
        CHAOS,
        "--task speaker-listener --p 0.4 --episodes 3 --imputer hold",
        "--task spread-xy-4 --links delay(1,2) --episodes 4 --worlds 2",
    ] {
        let words = format!("{words} --in-process");
        let (compact, mcap) = (folder.record(&words, "a.trace"), folder.record(&words, "a.mcap"));
        assert!(compact.episodes == mcap.episodes, "{words}");
        for name in ["a.trace", "a.mcap"] {
            succeed(&format!("replay {} --html {}.html", folder.at(name), folder.at(name)));
        }
        assert!(folder.bytes("a.trace.html") == folder.bytes("a.mcap.html"), "{words}");
        let listed = |name: &str| succeed(&format!("inspect {} --json", folder.at(name)));
        assert_eq!(listed("a.trace"), listed("a.mcap"));
        let verified = succeed(&format!("verify {}", folder.at("a.mcap")));
        assert!(verified.contains("all 6 comparisons hold"), "{words}: {verified}");
        assert!(!verified.contains("no end"), "{verified}");
    }
}

#[test]
fn processes_write_the_same_bytes() {
    let folder = Folder::new();
    folder.record(&format!("{CHAOS} --in-process"), "own.mcap");
    folder.record(&format!("{CHAOS} --on-failure continue"), "processes.mcap");
    assert!(folder.bytes("own.mcap") == folder.bytes("processes.mcap"));
}

#[test]
fn what_a_killed_run_leaves_is_read_to_its_last_whole_episode() {
    let folder = Folder::new();
    folder.write("a.mcap", b"an older file");
    let words = format!(
        "spawn --task hear-see --p 0.5 --episodes 100000 --in-process --record {}",
        folder.at("a.mcap")
    );
    let mut child = command(&words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let begun = Instant::now();
    while folder.path("a.mcap").metadata().unwrap().len() < 500_000 {
        assert!(begun.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let left = folder.read("a.mcap").unwrap().episodes;
    let again =
        folder.record(&format!("--task hear-see --p 0.5 --episodes {} --in-process", left.len()), "b.mcap");
    assert!(left.len() > 2 && left == again.episodes);
    let verified = succeed(&format!("verify {}", folder.at("a.mcap")));
    assert!(verified.contains("comparisons hold") && verified.contains("it has no end"), "{verified}");
    for command in [&format!("replay --html {}", folder.at("a.html"))[..], "inspect"] {
        let output = run(&format!("{command} {}", folder.at("a.mcap")));
        assert!(output.status.success() && stderr(&output).contains("note: "), "{}", stderr(&output));
        assert!(stderr(&output).contains("it has no end"), "{}", stderr(&output));
    }
}

/// The records of a file, each its opcode and where its content is.
fn records(bytes: &[u8]) -> Vec<(u8, Range<usize>)> {
    let (mut records, mut at) = (Vec::new(), 8);
    while at < bytes.len() - 8 {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        records.push((bytes[at], at + 9..at + 9 + length));
        at += 9 + length;
    }
    records
}

const METADATA: u8 = 0x0c;
const ATTACHMENT: u8 = 0x09;
const CHUNK: u8 = 0x06;

#[test]
fn what_is_cut_damaged_newer_or_of_others_is_told_apart() {
    let folder = Folder::new();
    folder.record("--task hear-see --p 0.5 --episodes 3 --in-process", "a.mcap");
    let whole = folder.bytes("a.mcap");
    let records = records(&whole);
    let of = |opcode: u8| records.iter().filter(move |(of, _)| *of == opcode).map(|(_, range)| range.clone());
    let refuse = |bytes: &[u8], says: &str| {
        folder.write("b.mcap", bytes);
        let error = folder.read("b.mcap").unwrap_err();
        assert!(error.contains("b.mcap") && error.contains(says), "{says}: {error}");
    };
    let episodes = |bytes: &[u8]| {
        folder.write("b.mcap", bytes);
        folder.read("b.mcap").unwrap().episodes.len()
    };
    let (header, attachments) = (of(METADATA).next().unwrap(), of(ATTACHMENT).collect::<Vec<_>>());
    assert_eq!(attachments.len(), 3);
    // Cut anywhere: what is whole counts.
    for length in [8, 20, header.start, header.end - 1] {
        refuse(&whole[..length], "cut off");
    }
    assert_eq!(episodes(&whole[..header.end]), 0);
    for (number, attachment) in attachments.iter().enumerate() {
        assert_eq!(episodes(&whole[..attachment.end - 1]), number);
        assert_eq!(episodes(&whole[..attachment.end]), number + 1);
    }
    assert_eq!(episodes(&whole[..whole.len() - 1]), 3);
    let with = |at: usize, bytes: &[u8]| {
        let mut changed = whole.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        changed
    };
    let episode = attachments[1].clone();
    refuse(&with(episode.end - 40, &[77]), "episode 1 of those in the file: it is damaged");
    // An attachment that says it is longer, or has a name that is.
    refuse(&with(episode.start + 16, &u32::MAX.to_le_bytes()), "shorter than it says");
    refuse(&with(episode.start - 8, &3u64.to_le_bytes()), "shorter than it says");
    refuse(&with(episode.start - 8, &u64::MAX.to_le_bytes()), "it is damaged");
    // A chunk that is not what it was: nothing of the trace, but found.
    refuse(&with(of(CHUNK).nth(1).unwrap().start + 100, &[0]), "damaged");
    refuse(&[&whole[..], b"more"].concat(), "damaged");
    let text = String::from_utf8_lossy(&whole[header.clone()]);
    let version = header.start + text.find("\"format_version\":1").unwrap() + 17;
    refuse(&with(version, b"9"), "version 9, written by vamaro-swarm 0.1.0");
    // Others call their records otherwise, or have none.
    let name = header.start + text.find("vamaro-swarm").unwrap();
    refuse(&with(name, b"another-tool"), "an MCAP of another program");
    refuse(&[&whole[..header.start - 9], &whole[header.end..]].concat(), "an MCAP of another program");
    for command in ["verify", "inspect", "replay --html x.html"] {
        fail(&format!("{command} {}", folder.at("b.mcap")), 1, &["b.mcap", "an MCAP of another program"]);
    }
}

#[test]
fn no_byte_of_a_record_makes_anybody_panic() {
    let folder = Folder::new();
    folder.record("--task hear-see --p 0.5 --episodes 1 --in-process --imputer zero", "a.mcap");
    let whole = folder.bytes("a.mcap");
    let (mut read, mut refused) = (0, 0);
    for (number, (_, range)) in records(&whole).into_iter().enumerate().filter(|(_, (of, _))| *of != CHUNK) {
        // Its opcode, its length, and the lengths at its beginning.
        let places = range.start - 9..range.end.min(range.start + 40);
        for at in places.skip(number % 5).step_by(5) {
            let mut changed = whole.clone();
            changed[at] = changed[at].wrapping_add(200);
            folder.write("b.mcap", &changed);
            *if folder.read("b.mcap").is_ok() { &mut read } else { &mut refused } += 1;
        }
    }
    assert!(read > 10 && refused > 10, "{read} were read, {refused} refused");
}
