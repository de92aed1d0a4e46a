//! The cells that are finished, in a file that grows with each, so that an interrupted sweep can go on.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::evaluation::{Outcome, Settings};
use crate::base::error::{Error, Result};
use crate::base::regular;
use crate::nn::kernels;
use crate::usage;

/// Name of the file in the folder of a report.
const CELLS: &str = "cells.jsonl";

/// The most bytes it may have.
const LARGEST: u64 = 1 << 30;

/// What to do where a record cannot be used.
const ELSEWHERE: &str = "choose another --report, or remove the file";

/// Finished cells, in a file that is locked as long as this lives. A line counts once it has ended.
#[derive(Debug)]
pub struct Record {
    file: File,
    path: PathBuf,
    cells: HashMap<String, Outcome>,
}

/// The first line.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct FirstLine {
    format: String,
    version: u32,
    /// Version of the program: others may compute other last bits.
    program: String,
    /// The instruction set, with which sums are grouped.
    simd: String,
    settings: Settings,
}

/// What tells a cell from others with the same settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Key {
    /// That of the policy.
    pub(super) fingerprint: String,
    /// As it is written: the links of a condition may hold a matrix, whose file is no longer what it was.
    pub(super) condition: Value,
    /// `None` where everything is delivered, so that nobody imputes.
    pub(super) imputer: Option<String>,
}

/// Every line behind it.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    #[serde(flatten)]
    key: Key,
    outcome: Outcome,
}

impl FirstLine {
    fn of(settings: &Settings) -> FirstLine {
        FirstLine {
            format: "vamaro-swarm cells".to_owned(),
            // Version 1 told policies apart by how their networks were spelt in memory.
            version: 2,
            program: env!("CARGO_PKG_VERSION").to_owned(),
            simd: kernels::instruction_set().to_owned(),
            settings: settings.clone(),
        }
    }
}

impl Key {
    fn text(&self) -> String {
        format!("{} {} {}", self.fingerprint, self.condition, self.imputer.as_deref().unwrap_or_default())
    }
}

impl Record {
    /// Opens the record in `folder`, which it creates if missing, and reads what is finished.
    ///
    /// # Errors
    /// `Failed` if it cannot be written; `Usage` if another evaluation uses it, or it was made with other
    /// settings or by another version of this program.
    pub fn open(folder: &Path, settings: &Settings) -> Result<Record> {
        std::fs::create_dir_all(folder).map_err(|e| Error::io("create the folder", folder, e))?;
        let path = folder.join(CELLS);
        let file = regular::append(&path)?;
        flock(&file, FlockOperation::NonBlockingLockExclusive).map_err(|e| match e {
            rustix::io::Errno::WOULDBLOCK => {
                usage!(
                    "{} is in use by another evaluation; wait for it, or choose another --report",
                    folder.display()
                )
            }
            other => Error::io("lock", &path, other),
        })?;
        let text = regular::read(&path, LARGEST)?;
        // What is behind the last line that ended was being written when the program was killed.
        let whole = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        let mut record = Record { file, path, cells: HashMap::new() };
        let torn_header =
            || serde_json::to_vec(&FirstLine::of(settings)).is_ok_and(|all| all.starts_with(&text));
        if whole == 0 && !torn_header() {
            return Err(record.foreign());
        }
        record.read(&text[..whole], settings)?;
        record.file.set_len(whole as u64).map_err(|e| Error::io("write", &record.path, e))?;
        record.file.seek(SeekFrom::End(0)).map_err(|e| Error::io("write", &record.path, e))?;
        if whole == 0 {
            record.append(&FirstLine::of(settings))?;
        }
        Ok(record)
    }

    fn read(&mut self, text: &[u8], settings: &Settings) -> Result<()> {
        let mut lines = text.split(|byte| *byte == b'\n').filter(|line| !line.is_empty());
        let Some(first) = lines.next() else { return Ok(()) };
        let (path, elsewhere) = (self.path.display(), ELSEWHERE);
        let header: FirstLine = serde_json::from_slice(first).map_err(|_| self.foreign())?;
        let expected = FirstLine::of(settings);
        if header.format != expected.format {
            return Err(self.foreign());
        }
        if (header.version, &header.program, &header.simd)
            != (expected.version, &expected.program, &expected.simd)
        {
            return Err(usage!(
                "{path} (version {}) was written by version {} of this program with SIMD {}, this is {} (version {}) \
                 with SIMD {}; {elsewhere}",
                header.version,
                header.program,
                header.simd,
                expected.program,
                expected.version,
                expected.simd
            ));
        }
        if header.settings != *settings {
            return Err(usage!(
                "{path} holds cells of {}, this evaluation has {}; give the same settings to continue, or {elsewhere}",
                words(&header.settings),
                words(settings)
            ));
        }
        for (number, line) in lines.enumerate() {
            let line: Line = serde_json::from_slice(line)
                .map_err(|e| usage!("{path}, line {}: {e}; {elsewhere}", number + 2))?;
            if line.outcome.returns.len() as u64 != settings.episodes {
                return Err(usage!(
                    "{path}, line {}: not {} returns; {elsewhere}",
                    number + 2,
                    settings.episodes
                ));
            }
            self.cells.insert(line.key.text(), line.outcome);
        }
        Ok(())
    }

    fn foreign(&self) -> Error {
        usage!(
            "{} does not begin like a file of finished cells of an evaluation; {ELSEWHERE}",
            self.path.display()
        )
    }

    /// The outcome of a cell, if it is finished.
    pub(super) fn get(&self, key: &Key) -> Option<&Outcome> {
        self.cells.get(&key.text())
    }

    /// Keeps the outcome of a cell.
    pub(super) fn keep(&mut self, key: &Key, outcome: &Outcome) -> Result<()> {
        self.append(&Line { key: key.clone(), outcome: outcome.clone() })
    }

    fn append(&mut self, line: &impl Serialize) -> Result<()> {
        let mut text = serde_json::to_vec(line).map_err(|e| Error::io("write", &self.path, e))?;
        text.push(b'\n');
        let whole = self.file.metadata().map_err(|e| Error::io("read", &self.path, e))?.len();
        self.file.write_all(&text).map_err(|e| {
            // Half a line, of a full disk, would spoil the next one.
            let _ = self.file.set_len(whole);
            Error::io("write", &self.path, e)
        })
    }
}

fn words(settings: &Settings) -> String {
    let Settings { episodes, seed, greedy, comm_at_t0, .. } = settings;
    format!(
        "{episodes} episodes{}, seed {seed}, {} actions{}",
        settings.if_other(),
        if *greedy { "greedy" } else { "sampled" },
        if *comm_at_t0 { "" } else { ", losses at t = 0" }
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(imputer: &str) -> Key {
        Key {
            fingerprint: "0123456789abcdef".to_owned(),
            condition: serde_json::json!({"level": 0.2}),
            imputer: Some(imputer.to_owned()),
        }
    }

    fn settings(episodes: u64) -> Settings {
        Settings { episodes, comm_at_t0: true, ..Settings::default() }
    }

    #[test]
    fn what_is_finished_is_there_the_next_time_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let outcome = Outcome { returns: vec![-1.0 / 3.0, 1e-300], errors: Vec::new() };
        let mut record = Record::open(folder.path(), &settings(2)).unwrap();
        record.keep(&key("hold"), &outcome).unwrap();
        record.keep(&Key { imputer: None, ..key("hold") }, &outcome).unwrap();
        assert!(matches!(Record::open(folder.path(), &settings(2)), Err(Error::Usage(_))), "locked");
        drop(record);
        // A third cell was being written when the power went.
        let mut file = File::options().append(true).open(folder.path().join(CELLS)).unwrap();
        file.write_all(b"{\"fingerprint\":\"01").unwrap();
        drop(file);
        let mut record = Record::open(folder.path(), &settings(2)).unwrap();
        assert_eq!(record.get(&key("hold")), Some(&outcome));
        assert_eq!(record.get(&Key { imputer: None, ..key("hold") }), Some(&outcome));
        assert_eq!(record.get(&key("zero")), None);
        record.keep(&key("zero"), &outcome).unwrap();
        drop(record);
        let record = Record::open(folder.path(), &settings(2)).unwrap();
        assert_eq!(record.get(&key("zero")), Some(&outcome));
        drop(record);
        // Killed while the first line was written.
        let header = std::fs::read(folder.path().join(CELLS)).unwrap();
        std::fs::write(folder.path().join(CELLS), &header[..9]).unwrap();
        assert_eq!(Record::open(folder.path(), &settings(2)).unwrap().get(&key("zero")), None);
    }

    #[test]
    fn other_settings_versions_and_files_are_refused() {
        let refused = |content: &str, says: &str| {
            let folder = tempfile::tempdir().unwrap();
            std::fs::write(folder.path().join(CELLS), content).unwrap();
            let error = Record::open(folder.path(), &settings(2)).unwrap_err();
            assert!(matches!(error, Error::Usage(_)), "{error:?}");
            assert!(error.to_string().contains(says), "{error}");
            assert_eq!(
                std::fs::read_to_string(folder.path().join(CELLS)).unwrap(),
                content,
                "nothing is lost"
            );
        };
        let header = |settings: &Settings| serde_json::to_string(&FirstLine::of(settings)).unwrap() + "\n";
        refused(&header(&settings(3)), "3 episodes");
        let physics = "damping=0.3".parse().unwrap();
        refused(
            &header(&Settings { physics, ..settings(2) }),
            "2 episodes with physics motor_noise=0,damping=0.3",
        );
        refused(&header(&settings(2)).replace(env!("CARGO_PKG_VERSION"), "0.0.9"), "version 0.0.9");
        refused(&header(&settings(2)).replace("\"version\":2", "\"version\":1"), "cells.jsonl (version 1)");
        for foreign in ["{}\n", "something else", "something else\n"] {
            refused(foreign, "does not begin");
        }
        refused(&(header(&settings(2)) + "{}\n"), "line 2");
        let short = Line { key: key("hold"), outcome: Outcome { returns: vec![0.0], errors: Vec::new() } };
        refused(&(header(&settings(2)) + &serde_json::to_string(&short).unwrap() + "\n"), "2 returns");
    }
}
