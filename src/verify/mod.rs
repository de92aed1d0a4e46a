//! Recomputing recorded episodes and updates: what was recorded, what comes out here, and how far apart.

mod kind;
mod masks;
mod trace;
mod update;
mod world;

use std::fs::DirEntry;
use std::path::{Path, PathBuf};

pub use kind::FileKind;
use masks::Masks;
use trace::Agents;
use world::Worlds;

use crate::agent::PolicySource;
use crate::base::error::{Error, Result};
use crate::recording::Reader;

/// What verification found.
#[derive(Debug, Default)]
pub struct Report {
    /// One entry per file and thing compared.
    pub comparisons: Vec<Comparison>,
    /// Files of a kind that is not verified, and parts that cannot be, and what they are.
    pub skipped: Vec<(PathBuf, String)>,
    /// Files in folders that could not be verified, and why.
    pub failed: Vec<(PathBuf, Error)>,
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
    /// Episode and step of the largest deviation, if there is one.
    pub worst: Option<(usize, usize)>,
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
        !self.comparisons.is_empty()
            && self.failed.is_empty()
            && self.comparisons.iter().all(Comparison::holds)
    }
}

/// Verifies recordings, traces and updates, in files or below folders. Traces are run with `policy`, or with
/// the policy beside them.
pub fn verify(paths: &[PathBuf], policy: Option<&PolicySource>) -> Result<Report> {
    let mut report = Report::default();
    for path in paths {
        if path.is_dir() {
            verify_folder(path, policy, &mut report)?;
        } else {
            let kind = FileKind::of(path)?;
            if kind == FileKind::Unknown {
                report.skipped.push((path.clone(), "not a recording, trace or update".to_owned()));
            }
            verify_file(path, kind, policy, &mut report)?;
        }
    }
    Ok(report)
}

/// Verifies all below a folder, in order. A file that cannot be read does not hide the others.
fn verify_folder(folder: &Path, policy: Option<&PolicySource>, report: &mut Report) -> Result<()> {
    let unreadable = |e: std::io::Error| Error::io("read", folder, e);
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut entries: Vec<DirEntry> = entries.collect::<std::io::Result<_>>().map_err(unreadable)?;
    entries.sort_by_key(DirEntry::path);
    for entry in entries {
        let path = entry.path();
        // A link to a folder may lead back up.
        let verified = if entry.file_type().map_err(unreadable)?.is_dir() {
            verify_folder(&path, policy, report)
        } else if path.is_file() {
            FileKind::of(&path).and_then(|kind| verify_file(&path, kind, policy, report))
        } else {
            Ok(())
        };
        if let Err(error) = verified {
            report.failed.push((path, error));
        }
    }
    Ok(())
}

fn verify_file(
    file: &Path,
    kind: FileKind,
    policy: Option<&PolicySource>,
    report: &mut Report,
) -> Result<()> {
    let mut skip = |what: &str| report.skipped.push((file.to_owned(), what.to_owned()));
    match kind {
        FileKind::Recording => verify_recording(file, policy, report)?,
        FileKind::Updates => report.comparisons.extend(update::compare(file)?),
        FileKind::Json(Some(kind)) => skip(&format!("{kind}: not verified by this version")),
        FileKind::Json(None) => skip("JSON, but not a recording, trace or update"),
        // Updates are verified along with the settings beside them.
        FileKind::Tensors if update::is_update(file) => {}
        FileKind::Tensors => skip("tensors, but no policy or update"),
        // Policies are verified along with the trace beside them.
        FileKind::Policy | FileKind::StateDict | FileKind::Unknown => {}
    }
    Ok(())
}

/// Verifies a recording or a trace, episode by episode.
fn verify_recording(file: &Path, policy: Option<&PolicySource>, report: &mut Report) -> Result<()> {
    let mut recording = Reader::open(file)?;
    let mut worlds = Worlds::of(file, &recording)?;
    let mut masks = recording.is_trace().then(|| Masks::of(&recording)).transpose().unwrap_or_else(|error| {
        report.failed.push((file.to_owned(), error));
        None
    });
    let mut agents = recording.is_trace().then(|| Agents::of(file, &recording, policy));
    for (number, episode) in recording.by_ref().enumerate() {
        let episode = episode?;
        worlds.compare(file, number, &episode)?;
        masks.as_mut().map_or(Ok(()), |masks| masks.compare(number, &episode))?;
        // What is wrong with the agents does not hide the worlds.
        let compared = match &mut agents {
            Some(Ok(agents)) => agents.compare(file, number, &episode),
            _ => Ok(()),
        };
        if let Err(error) = compared {
            agents = Some(Err(error));
        }
    }
    if let Some(what) = recording.unfinished() {
        report.skipped.push((file.to_owned(), what.to_owned()));
    }
    report.comparisons.extend(worlds.compared(file));
    report.comparisons.extend(masks.and_then(|masks| masks.compared(file)));
    let Some(agents) = agents.transpose()? else { return Ok(()) };
    let (comparisons, left_out) = agents.compared(file);
    report.comparisons.extend(comparisons);
    if left_out > 0 {
        let what = format!(
            "{left_out} decisions after missed ones: whether an agent saw a tick that it missed is not known"
        );
        report.skipped.push((file.to_owned(), what));
    }
    Ok(())
}

/// Collects deviations of one kind.
#[derive(Default)]
struct Deviations {
    number: usize,
    sum: f64,
    /// All of them, where their median is asked for.
    all: Option<Vec<f64>>,
    largest: f64,
    worst: Option<(usize, usize)>,
    /// Episode and step that are being compared, where there are such.
    place: Option<(usize, usize)>,
}

impl Deviations {
    /// Deviations whose median is asked for.
    fn with_median() -> Deviations {
        Deviations { all: Some(Vec::new()), ..Deviations::default() }
    }

    /// Says which episode and step the next values are from.
    fn at(&mut self, episode: usize, step: usize) -> &mut Deviations {
        self.place = Some((episode, step));
        self
    }

    fn add(&mut self, found: impl Into<f64>, recorded: impl Into<f64>) {
        self.push((found.into() - recorded.into()).abs());
    }

    /// Values whose numbers differ deviate infinitely.
    fn add_all<T: Into<f64> + Copy>(&mut self, found: &[T], recorded: &[T]) {
        if found.len() != recorded.len() {
            self.push(f64::INFINITY);
        }
        found.iter().zip(recorded).for_each(|(found, recorded)| self.add(*found, *recorded));
    }

    fn push(&mut self, deviation: f64) {
        // Not `f64::max`, which passes over a NaN.
        if deviation > self.largest || deviation.is_nan() {
            (self.largest, self.worst) = (deviation, self.place);
        }
        self.number += 1;
        self.sum += deviation;
        if let Some(all) = &mut self.all {
            all.push(deviation);
        }
    }

    fn largest(&self, file: &Path, what: &'static str, tolerance: f64) -> Comparison {
        self.compared(file, what, self.largest, tolerance)
    }

    fn median(&self, file: &Path, what: &'static str, tolerance: f64) -> Comparison {
        let mut sorted = self.all.clone().expect("the median is of those that are kept");
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
        self.compared(file, what, median, tolerance)
    }

    fn mean(&self, file: &Path, what: &'static str, tolerance: f64) -> Comparison {
        self.compared(file, what, self.sum / self.number as f64, tolerance)
    }

    fn compared(&self, file: &Path, what: &'static str, deviation: f64, tolerance: f64) -> Comparison {
        let (file, values, worst) = (file.to_owned(), self.number, self.worst);
        Comparison { file, what, values, deviation, tolerance, worst }
    }
}
