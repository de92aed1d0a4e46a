//! Compact traces: the same episodes in few bytes, and nothing believed of a damaged file.

use vamaro_swarm::recording::{Episode, Recording};

use crate::common::{fail, run, stderr, succeed};

struct Folder(tempfile::TempDir);

impl Folder {
    fn at(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    /// Records what `words` say under this name.
    fn record(&self, words: &str, name: &str) -> Recording {
        succeed(&format!("spawn {words} --record {}", self.at(name)));
        self.read(name).unwrap()
    }

    fn read(&self, name: &str) -> Result<Recording, String> {
        Recording::read(&self.0.path().join(name)).map_err(|e| e.to_string())
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.at(name)).unwrap()
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.at(name), bytes).unwrap();
    }
}

fn folder() -> Folder {
    Folder(tempfile::tempdir().unwrap())
}

const CHAOS: &str = "--task hear-see --p 0.5 --episodes 6 --seed 2 --chaos kill=0.05:300ms,stop=0.05:200ms";

#[test]
fn they_hold_what_json_holds_but_for_thoughts_and_those_come_again() {
    let folder = folder();
    for words in [
        CHAOS,
        "--task speaker-listener --p 0.4 --episodes 3 --imputer hold",
        "--task hear-see --links delay(1,2) --episodes 3 --greedy",
        "--task hear-see --p 0.3 --episodes 3 --imputer particles --physics motor_noise=0.3",
    ] {
        let words = format!("{words} --in-process");
        let (json, compact) = (folder.record(&words, "a.json"), folder.record(&words, "a.trace"));
        assert_eq!(json.episodes.len(), compact.episodes.len());
        for (json, compact) in json.episodes.into_iter().zip(compact.episodes) {
            let none = Vec::new;
            let thoughtless =
                Episode { joint_estimate: none(), logits: Vec::new(), agent_reward: Vec::new(), ..json };
            assert!(thoughtless == compact, "{words}");
        }
        let (large, small) = (folder.bytes("a.json").len(), folder.bytes("a.trace").len());
        assert!(5 * small < large, "{small} bytes, and {large} as JSON");
        for name in ["a.json", "a.trace"] {
            let table = succeed(&format!("verify {}", folder.at(name)));
            let expected = if name == "a.json" { 10 } else { 6 };
            assert!(table.contains(&format!("all {expected} comparisons hold")), "{words}: {table}");
            succeed(&format!("replay {} --html {}.html", folder.at(name), folder.at(name)));
        }
        // One sees the same, whichever it was.
        let page = |name: &str| String::from_utf8(folder.bytes(name)).unwrap();
        assert!(page("a.json.html") == page("a.trace.html"), "{words}");
        let listed = |name: &str| succeed(&format!("inspect {}", folder.at(name)));
        assert_eq!(listed("a.json"), listed("a.trace"));
    }
}

#[test]
fn processes_write_the_same_bytes() {
    let folder = folder();
    folder.record(&format!("{CHAOS} --in-process"), "own.trace");
    folder.record(&format!("{CHAOS} --on-failure continue"), "processes.trace");
    assert!(folder.bytes("own.trace") == folder.bytes("processes.trace"));
}

#[test]
fn a_step_of_four_takes_less_than_200_bytes() {
    let folder = folder();
    folder.record("--agents 4 --policy untrained --imputer zero --episodes 1 --in-process", "one.trace");
    folder.record("--agents 4 --policy untrained --imputer zero --episodes 2 --in-process", "two.trace");
    let each = folder.bytes("two.trace").len() - folder.bytes("one.trace").len();
    assert!(each < 25 * 200, "{each} bytes an episode");
}

#[test]
fn another_action_is_found() {
    let folder = folder();
    folder.record("--task hear-see --p 0.5 --episodes 2 --in-process", "a.trace");
    let mut bytes = folder.bytes("a.trace");
    // The last episode ends with actions, arrivals and presence; the file with twelve bytes.
    let first = bytes.len() - 12 - 25 * (2 + 4 + 2);
    bytes[first + 20] = (bytes[first + 20] + 1) % 5;
    folder.write("a.trace", &bytes);
    fail(&format!("verify {}", folder.at("a.trace")), 1, &["do not hold"]);
    let table = run(&format!("verify {}", folder.at("a.trace")));
    let table = String::from_utf8(table.stdout).unwrap();
    let differs = table.lines().find(|line| line.contains("share that differs")).unwrap();
    assert!(differs.contains("FAIL") && differs.contains("worst in episode 1, step 10"), "{table}");
}

#[test]
fn what_is_cut_damaged_or_newer_is_refused() {
    let folder = folder();
    folder.record("--task hear-see --p 0.5 --episodes 3 --in-process", "a.trace");
    let whole = folder.bytes("a.trace");
    let header = 16 + u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
    let episode = (whole.len() - 12 - header) / 3;
    let refuse = |bytes: &[u8], says: &str| {
        folder.write("b.trace", bytes);
        let error = folder.read("b.trace").unwrap_err();
        assert!(error.contains("b.trace") && error.contains(says), "{says}: {error}");
    };
    for length in [9, 15, 20, header - 1] {
        refuse(&whole[..length], "cut off");
    }
    // At the end of an episode, too.
    for length in
        [header, header + 3, header + episode, header + 2 * episode - 1, whole.len() - 9, whole.len() - 1]
    {
        refuse(&whole[..length], "cut off");
    }
    refuse(&[&whole[..], b"more"].concat(), "behind its end");
    let with = |at: usize, bytes: &[u8]| {
        let mut changed = whole.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        changed
    };
    refuse(&with(8, &2u32.to_le_bytes()), "version 2, written by vamaro-swarm 0.1.0");
    refuse(&with(12, &u32::MAX.to_le_bytes()), "is the most there can be");
    refuse(&with(header, &26u32.to_le_bytes()), "has 26 steps");
    refuse(&with(header + 24, &7u32.to_le_bytes()), "no goal");
    refuse(&with(header + 32, &f64::NAN.to_le_bytes()), "no number");
    refuse(&with(whole.len() - 13, &[9]), "a presence is 0 to 3");
    refuse(&with(whole.len() - 12 - 25 * 8, &[5]), "has no action 5");
    refuse(&with(whole.len() - 12 - 25 * 6, &[3]), "3 ticks old");
    refuse(&with(whole.len() - 8, &[2]), "says that it has 2");
    let other = String::from_utf8_lossy(&whole[16..header]).replace("[\"T + 1\",2,2]", "[\"T + 1\",2,3]");
    assert_ne!(other.as_bytes(), &whole[16..header]);
    refuse(&[&whole[..16], other.as_bytes(), &whole[header..]].concat(), "laid out otherwise");
    // Commands say the same.
    folder.write("b.trace", &whole[..whole.len() - 20]);
    for command in ["verify", "inspect", "replay --html x.html"] {
        let output = run(&format!("{command} {}", folder.at("b.trace")));
        assert_eq!(output.status.code(), Some(1), "{command}");
        assert!(stderr(&output).contains("cut off within episode 2"), "{command}: {}", stderr(&output));
    }
}
