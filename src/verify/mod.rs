//! Recomputing recorded episodes and updates: what was recorded, what comes out here, and how far apart they are.

mod trace;
mod update;
mod world;

use std::path::{Path, PathBuf};

use crate::agents::PolicySource;
use crate::error::{Error, Result};
use crate::recording::Recording;
use crate::usage;

/// What verification found.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// One entry per file and thing compared.
    pub comparisons: Vec<Comparison>,
    /// Files of a kind that is not verified, and what they are.
    pub skipped: Vec<(PathBuf, String)>,
}

/// A number of values compared with what was recorded.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Where they were recorded.
    pub file: PathBuf,
    /// What was compared.
    pub what: &'static str,
    /// How many values.
    pub values: usize,
    /// The deviation that counts: the largest, unless `what` says otherwise.
    pub deviation: f64,
    /// The largest deviation allowed.
    pub tolerance: f64,
}

impl Comparison {
    /// Whether something was compared and agreed. A deviation that is not a number does not.
    pub fn holds(&self) -> bool {
        self.values > 0 && self.deviation <= self.tolerance
    }
}

impl Report {
    /// Whether something was compared and all of it agreed.
    pub fn holds(&self) -> bool {
        !self.comparisons.is_empty() && self.comparisons.iter().all(Comparison::holds)
    }
}

/// Verifies recordings, traces and updates, in files or below folders. Traces are run with `policy`, or with the
/// policy beside them.
pub fn verify(paths: &[PathBuf], policy: Option<&PolicySource>) -> Result<Report> {
    let mut report = Report::default();
    for path in paths {
        for file in files_below(path)? {
            verify_file(&file, policy, &mut report)?;
        }
    }
    Ok(report)
}

fn verify_file(file: &Path, policy: Option<&PolicySource>, report: &mut Report) -> Result<()> {
    match kind_of(file)? {
        Kind::Recording => {
            let recording = Recording::read(file)?;
            report.comparisons.extend(world::compare(file, &recording)?);
            if recording.is_trace() {
                report.comparisons.extend(trace::compare(file, &recording, policy)?);
            }
        }
        Kind::Updates => report.comparisons.extend(update::compare(file)?),
        Kind::Other(what) => report.skipped.push((file.to_owned(), what)),
        Kind::Companion => {}
    }
    Ok(())
}

/// What a file is, told by its content.
enum Kind {
    Recording,
    /// What the updates beside it were made with.
    Updates,
    /// A policy or an update: verified along with the trace or the `config.json` beside it.
    Companion,
    Other(String),
}

fn kind_of(file: &Path) -> Result<Kind> {
    let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
    match extension {
        "json" => {
            let bytes = std::fs::read(file).map_err(|e| Error::io("read", file, e))?;
            let json: serde_json::Value = serde_json::from_slice(&bytes)
                .map_err(|e| Error::io("read", file, format!("not JSON: {e}")))?;
            Ok(match json.get("kind").and_then(|kind| kind.as_str()) {
                _ if json.get("episodes").is_some() => Kind::Recording,
                Some("update") => Kind::Updates,
                Some(kind) => Kind::Other(format!("{kind}: not verified by this version")),
                None => Kind::Other("not a recording, trace or update".to_owned()),
            })
        }
        "th" => Ok(Kind::Companion),
        "safetensors" if crate::nn::PolicyFile::read(file).is_ok() => Ok(Kind::Companion),
        "safetensors" if file.with_file_name("config.json").exists() => Ok(Kind::Companion),
        "safetensors" => Ok(Kind::Other("tensors without a config.json beside them".to_owned())),
        _ => Ok(Kind::Other("not a recording, trace or update".to_owned())),
    }
}

/// The file itself, or the files below a folder that could be of ours, in order.
fn files_below(path: &Path) -> Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return match path.exists() {
            true => Ok(vec![path.to_owned()]),
            false => Err(usage!("there is no file or folder {}", path.display())),
        };
    }
    let entries = std::fs::read_dir(path).map_err(|e| Error::io("read", path, e))?;
    let mut entries: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    entries.sort();
    let mut files = Vec::new();
    for entry in entries {
        let extension = entry.extension().and_then(|e| e.to_str());
        if entry.is_dir() {
            files.extend(files_below(&entry)?);
        } else if matches!(extension, Some("json" | "safetensors" | "th")) {
            files.push(entry);
        }
    }
    Ok(files)
}

/// Collects deviations of one kind.
#[derive(Default)]
struct Deviations(Vec<f64>);

impl Deviations {
    fn add(&mut self, found: impl Into<f64>, recorded: impl Into<f64>) {
        self.0.push((found.into() - recorded.into()).abs());
    }

    /// Notes values that cannot be compared because their numbers differ.
    fn add_all<T: Into<f64> + Copy>(&mut self, found: &[T], recorded: &[T]) {
        if found.len() != recorded.len() {
            self.0.push(f64::INFINITY);
        }
        found.iter().zip(recorded).for_each(|(found, recorded)| self.add(*found, *recorded));
    }

    fn largest(&self, file: &Path, what: &'static str, tolerance: f64) -> Comparison {
        // Not `f64::max`, which passes over a NaN.
        let deviation = self.0.iter().fold(0.0, |a: f64, &b| if b > a || b.is_nan() { b } else { a });
        Comparison { file: file.to_owned(), what, values: self.0.len(), deviation, tolerance }
    }

    fn median(&self, file: &Path, what: &'static str, tolerance: f64) -> Comparison {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let deviation = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
        Comparison { file: file.to_owned(), what, values: self.0.len(), deviation, tolerance }
    }
}
