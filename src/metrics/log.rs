//! The files of a run that grow row by row.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::{Metrics, events, table};
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::base::regular;
use crate::{failed, usage};

/// The metrics of a run in training, as `metrics.csv` and as an event file of TensorBoard.
///
/// The CSV file holds nothing that depends on the clock, so a run that was interrupted and resumed ends with the
/// very bytes of one that was not. Each row is one write, so readers see whole rows.
#[derive(Debug)]
pub struct MetricsLog {
    csv: Growing,
    events: Growing,
    tags: Vec<String>,
    rows: usize,
    last: Option<u64>,
}

impl MetricsLog {
    /// Starts the files of a new run.
    ///
    /// # Errors
    /// [`Error::Usage`] if the folder holds metrics, or if a name cannot be that of a column.
    pub fn create(folder: &Path, columns: &[String]) -> Result<MetricsLog> {
        let header = table::header(columns)?;
        let [csv, events] = paths(folder);
        if csv.exists() || events.exists() {
            return Err(usage!(
                "there are metrics in {} already; resume that run, or give this one another folder",
                folder.display()
            ));
        }
        // No run can go on with a file without its header.
        AtomicFile::write(&csv, header.as_bytes())?;
        let (csv, mut events) = (Growing::open(csv)?, Growing::open(events)?);
        events.append(&events::first_record())?;
        Ok(MetricsLog { csv, events, tags: tags(columns), rows: 0, last: None })
    }

    /// Opens the files of a run that goes on after its first `rows` rows. Later rows are dropped, and so are
    /// their events; what comes before them stays as it is, byte for byte. Events end where their file is
    /// damaged, and begin anew if it is missing, since the CSV file has everything that was in it.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is no CSV file; [`Error::Failed`] if it has fewer rows or other columns, or if
    /// one of these rows is damaged.
    pub fn resume(folder: &Path, columns: &[String], rows: usize) -> Result<MetricsLog> {
        let [csv, events] = paths(folder);
        let bytes = regular::read(&csv, table::LARGEST)?;
        let mut lines = bytes.split_inclusive(|byte| *byte == b'\n').filter(|line| line.ends_with(b"\n"));
        let length = lines.by_ref().take(rows + 1).map(<[u8]>::len).sum();
        let kept = Metrics::parse(&bytes[..length], &csv)?;
        if kept.timesteps.len() < rows {
            return Err(failed!(
                "{} holds {} whole rows, but the run continues after row {rows}: it is not the file of this run, \
                 or was cut",
                csv.display(),
                kept.timesteps.len()
            ));
        }
        if !kept.columns.iter().map(|column| &column.name).eq(columns) {
            return Err(failed!(
                "{} has other columns than this run would write: its header must be {}",
                csv.display(),
                table::header(columns)?.trim_end()
            ));
        }
        cut(&csv, &bytes, length)?;

        let last = kept.timesteps.last().copied();
        let bytes = match regular::read(&events, events::LARGEST) {
            Err(_) if !events.exists() => Vec::new(),
            read => read?,
        };
        let length = events::length_until(&bytes, last);
        cut(&events, &bytes, length)?;

        let (csv, mut events) = (Growing::open(csv)?, Growing::open(events)?);
        if length == 0 {
            events.append(&events::first_record())?;
        }
        Ok(MetricsLog { csv, events, tags: tags(columns), rows, last })
    }

    /// Writes a row: one value per column, `None` for an empty cell. After an error the last row may be torn;
    /// `resume` drops it.
    ///
    /// # Panics
    /// If there is not one value per column.
    pub fn push(&mut self, timestep: u64, values: &[Option<f64>]) -> Result<()> {
        assert_eq!(values.len(), self.tags.len(), "one value per column");
        if self.last >= Some(timestep) {
            let path = self.csv.path.display();
            return Err(failed!("{path} already has a row of timestep {timestep} or later; it was changed"));
        }
        self.csv.append(table::row(timestep, values).as_bytes())?;
        let tagged = self.tags.iter().zip(values);
        let scalars: Vec<_> = tagged.filter_map(|(tag, value)| Some((tag.as_str(), (*value)?))).collect();
        if !scalars.is_empty() {
            self.events.append(&events::scalars(timestep, &scalars))?;
        }
        self.rows += 1;
        self.last = Some(timestep);
        Ok(())
    }

    /// Returns when all rows are on the disk. A checkpoint that counts them may be put in its place then.
    pub fn sync(&mut self) -> Result<()> {
        self.csv.sync()?;
        self.events.sync()
    }

    /// The timestep of the last row.
    pub fn last(&self) -> Option<u64> {
        self.last
    }

    /// Rows written, those before a resumption included.
    pub fn rows(&self) -> usize {
        self.rows
    }
}

fn tags(columns: &[String]) -> Vec<String> {
    columns.iter().map(|column| events::tag(column)).collect()
}

fn paths(folder: &Path) -> [PathBuf; 2] {
    [table::FILE, events::FILE].map(|name| folder.join(name))
}

/// Drops all but the first `length` of a file's `bytes`.
fn cut(path: &Path, bytes: &[u8], length: usize) -> Result<()> {
    if length == bytes.len() {
        return Ok(());
    }
    let mut file = AtomicFile::create(path)?;
    file.write_all(&bytes[..length]).map_err(|e| Error::io("write", path, e))?;
    file.commit()
}

/// A file that is written at its end.
#[derive(Debug)]
struct Growing {
    file: File,
    path: PathBuf,
}

impl Growing {
    fn open(path: PathBuf) -> Result<Growing> {
        Ok(Growing { file: regular::append(&path)?, path })
    }

    fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|e| Error::io("write", &self.path, e))
    }

    fn sync(&mut self) -> Result<()> {
        self.file.sync_all().map_err(|e| Error::io("write", &self.path, e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns() -> Vec<String> {
        vec!["return_mean".to_owned(), "maro/test_p=0.2_return_mean".to_owned()]
    }

    /// Row `k` of every run in these tests; the second column has a value in every other row.
    fn push(log: &mut MetricsLog, k: u64) {
        log.push(250 * (k + 1), &[Some(-100.0 / (k + 3) as f64), (k % 2 == 1).then_some(-0.1 * k as f64)])
            .unwrap();
    }

    /// The files of a run of `rows` rows.
    fn run(rows: u64) -> (tempfile::TempDir, MetricsLog) {
        let folder = tempfile::tempdir().unwrap();
        let mut log = MetricsLog::create(folder.path(), &columns()).unwrap();
        (0..rows).for_each(|k| push(&mut log, k));
        (folder, log)
    }

    fn contents(folder: &tempfile::TempDir) -> [Vec<u8>; 2] {
        paths(folder.path()).map(|path| std::fs::read(path).unwrap())
    }

    #[test]
    fn a_resumed_run_ends_with_the_bytes_of_an_uninterrupted_one() {
        let [uninterrupted, _] = contents(&run(9).0);
        for rows in [0, 1, 5, 7] {
            let (folder, log) = run(7);
            drop(log);
            let [_, events_before] = contents(&folder);
            let mut log = MetricsLog::resume(folder.path(), &columns(), rows).unwrap();
            assert_eq!(log.rows(), rows);
            let [_, events] = contents(&folder);
            assert!(events_before.starts_with(&events));
            assert_eq!(events.len(), events::length_until(&events_before, log.last));
            (rows as u64..9).for_each(|k| push(&mut log, k));
            log.sync().unwrap();
            let [csv, events] = contents(&folder);
            assert_eq!(csv, uninterrupted);
            assert_eq!(events::length_until(&events, Some(250 * 9)), events.len());
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
        }
    }

    #[test]
    fn tensorboard_gets_tags_in_groups_and_the_csv_file_columns() {
        let (folder, log) = run(2);
        drop(log);
        let [csv, events] = contents(&folder).map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        assert!(csv.starts_with("timestep,return_mean,maro/test_p=0.2_return_mean\n"), "{csv}");
        assert!(events.contains("train/return_mean") && events.contains("test/return_mean/maro/p=0.2"));
        assert!(!events.contains("test_p="), "{events:?}");
    }

    #[test]
    fn torn_ends_are_dropped() {
        let (folder, log) = run(3);
        drop(log);
        let whole = contents(&folder);
        for path in paths(folder.path()) {
            File::options().append(true).open(path).unwrap().write_all(b"1000,-2").unwrap();
        }
        MetricsLog::resume(folder.path(), &columns(), 3).unwrap();
        assert_eq!(contents(&folder), whole);
    }

    #[test]
    fn events_that_are_missing_begin_anew() {
        let (folder, log) = run(3);
        drop(log);
        let [csv, events] = paths(folder.path());
        std::fs::remove_file(&events).unwrap();
        let mut log = MetricsLog::resume(folder.path(), &columns(), 3).unwrap();
        push(&mut log, 3);
        let bytes = std::fs::read(&events).unwrap();
        assert_eq!(bytes.len(), events::length_until(&bytes, Some(1000)));
        assert!(events::length_until(&bytes, None) > 0);
        assert_eq!(Metrics::read(&csv).unwrap().timesteps, [250, 500, 750, 1000]);
    }

    #[test]
    fn another_run_is_not_continued() {
        let (folder, log) = run(3);
        drop(log);
        let before = contents(&folder);
        let refuse = |columns: &[String], rows, saying: &str| {
            let error = MetricsLog::resume(folder.path(), columns, rows).unwrap_err();
            assert!(!matches!(error, Error::Usage(_)) && error.to_string().contains(saying), "{error}");
        };
        refuse(&columns(), 4, "holds 3 whole rows");
        refuse(&columns()[..1], 3, "header must be timestep,return_mean");
        refuse(&[], 3, "other columns");
        let error = MetricsLog::create(folder.path(), &columns()).unwrap_err();
        assert!(error.to_string().contains("already"), "{error}");
        assert_eq!(contents(&folder), before);
        let elsewhere = tempfile::tempdir().unwrap();
        assert!(matches!(MetricsLog::resume(elsewhere.path(), &columns(), 0), Err(Error::Usage(_))));
        assert_eq!(std::fs::read_dir(elsewhere.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_damaged_row_is_no_ground_to_go_on_from() {
        let (folder, log) = run(3);
        drop(log);
        let [csv, _] = paths(folder.path());
        let text = std::fs::read_to_string(&csv).unwrap().replace("\n500,", "\n500x,");
        std::fs::write(&csv, &text).unwrap();
        let error = MetricsLog::resume(folder.path(), &columns(), 3).unwrap_err();
        assert!(error.to_string().contains("line 3"), "{error}");
        assert_eq!(MetricsLog::resume(folder.path(), &columns(), 1).unwrap().rows(), 1);
    }

    #[test]
    fn a_full_disk_is_an_error() {
        let (_folder, mut log) = run(1);
        log.csv.file = File::options().write(true).open("/dev/full").unwrap();
        let error = log.push(500, &[None, None]).unwrap_err();
        assert!(!matches!(error, Error::Usage(_)) && error.to_string().contains("No space left"), "{error}");
        assert_eq!(log.rows(), 1);
    }
}
