//! `metrics.csv`: a timestep and a value per column in each row.

use std::path::Path;

use crate::base::error::Result;
use crate::base::regular;
use crate::{failed, usage};

/// Its name in the folder of a run.
pub const FILE: &str = "metrics.csv";

/// The most bytes it may have: those of ten million rows.
pub(super) const LARGEST: u64 = 1 << 30;

/// The name of the first column.
const TIMESTEP: &str = "timestep";

/// The metrics of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Metrics {
    /// Environment steps when each row was written, increasing.
    pub timesteps: Vec<u64>,
    /// In the order of the file.
    pub columns: Vec<Column>,
}

/// One metric over a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Its name in the header.
    pub name: String,
    /// One value per row; `None` where there was nothing to report.
    pub values: Vec<Option<f64>>,
}

impl Metrics {
    /// Reads a file, also one that is still being written: a line counts once it has ended.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is no such file; [`Error::Failed`] with the number of the line if it is damaged.
    pub fn read(path: &Path) -> Result<Metrics> {
        let bytes = regular::read(path, LARGEST)?;
        Metrics::parse(&bytes, path)
    }

    /// Reads the text of a file at `path`.
    pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Metrics> {
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |newline| newline + 1);
        let text = std::str::from_utf8(&bytes[..whole]).map_err(|e| {
            let line = bytes[..e.valid_up_to()].iter().filter(|byte| **byte == b'\n').count() + 1;
            failed!("{}, line {line}: not text", path.display())
        })?;
        let mut lines = text.lines().enumerate();
        let mut names = lines.next().map_or("", |(_, header)| header).split(',');
        if names.next() != Some(TIMESTEP) {
            return Err(failed!(
                "{}, line 1: metrics begin with a header `{TIMESTEP},..`, and this file does not",
                path.display()
            ));
        }
        let columns = names.map(|name| Column { name: name.to_owned(), values: Vec::new() }).collect();
        let mut metrics = Metrics { timesteps: Vec::new(), columns };
        for (index, line) in lines {
            metrics.add(line).map_err(|what| failed!("{}, line {}: {what}", path.display(), index + 1))?;
        }
        Ok(metrics)
    }

    /// Adds a row, or says what is wrong with it.
    fn add(&mut self, line: &str) -> std::result::Result<(), String> {
        let cells: Vec<&str> = line.split(',').collect();
        if cells.len() != self.columns.len() + 1 {
            return Err(format!("{} cells under a header of {}", cells.len(), self.columns.len() + 1));
        }
        let timestep =
            cells[0].parse().map_err(|_| format!("the timestep `{}` is not a whole number", cells[0]))?;
        if self.timesteps.last().is_some_and(|last| *last >= timestep) {
            return Err(format!("timestep {timestep} is not after the one before"));
        }
        for (column, cell) in self.columns.iter_mut().zip(&cells[1..]) {
            let value = match *cell {
                "" => None,
                number => Some(number.parse().map_err(|_| format!("`{number}` is not a number"))?),
            };
            column.values.push(value);
        }
        self.timesteps.push(timestep);
        Ok(())
    }

    /// The values of a column, one per row.
    pub fn column(&self, name: &str) -> Option<&[Option<f64>]> {
        self.columns.iter().find(|column| column.name == name).map(|column| &column.values[..])
    }
}

/// The first line of a file.
pub(super) fn header(columns: &[String]) -> Result<String> {
    let mut line = TIMESTEP.to_owned();
    for (index, name) in columns.iter().enumerate() {
        let repeated = name == TIMESTEP || columns[..index].contains(name);
        if repeated || name.is_empty() || name.contains([',', '"', '\n', '\r']) {
            return Err(usage!(
                "`{name}` cannot be the name of a metric: it must be new, without `,` and `\"`"
            ));
        }
        line.push(',');
        line.push_str(name);
    }
    line.push('\n');
    Ok(line)
}

/// A line of a file. Equal bits give equal text, and the text gives the same bits.
pub(super) fn row(timestep: u64, values: &[Option<f64>]) -> String {
    let mut line = timestep.to_string();
    for value in values {
        line.push(',');
        if let Some(value) = value {
            line.push_str(&value.to_string());
        }
    }
    line.push('\n');
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::Error;

    fn parse(text: &str) -> Result<Metrics> {
        Metrics::parse(text.as_bytes(), Path::new("metrics.csv"))
    }

    #[test]
    fn what_was_written_is_read_bit_by_bit() {
        let values = [0.1 + 0.2, -0.0, 1e300, f64::MIN_POSITIVE / 3.0, f64::INFINITY, -24.0];
        let columns: Vec<String> = (0..7).map(|i| format!("m/{i}")).collect();
        let cells: Vec<_> = values.into_iter().map(Some).chain([None]).collect();
        let text = header(&columns).unwrap() + &row(250, &cells);
        let metrics = parse(&text).unwrap();
        assert_eq!(metrics.timesteps, [250]);
        for (name, value) in columns.iter().zip(&cells) {
            assert_eq!(metrics.column(name).unwrap()[0].map(f64::to_bits), value.map(f64::to_bits));
        }
        assert!(metrics.column("m/8").is_none());
        assert!(parse(&row(250, &cells)).is_err());
    }

    #[test]
    fn damage_is_reported_with_its_line() {
        let good = "timestep,a,b\n250,1,\n500,2,3\n";
        assert_eq!(parse(good).unwrap().column("b"), Some(&[None, Some(3.0)][..]));
        for (bad, line, saying) in [
            ("", 1, "header"),
            ("time,a\n", 1, "header"),
            ("timestep,a,b\n250,1\n", 2, "2 cells under a header of 3"),
            ("timestep,a,b\n250,1,2\n\n", 3, "1 cells"),
            ("timestep,a,b\n250,1,2\n250,1,2\n", 3, "not after"),
            ("timestep,a,b\n250,1,2\n300.5,1,2\n", 3, "whole number"),
            ("timestep,a,b\n250,1,2\n500,1,-1..4\n", 3, "`-1..4` is not a number"),
        ] {
            let error = parse(bad).unwrap_err().to_string();
            assert!(error.contains(&format!("line {line}")) && error.contains(saying), "{error}");
        }
        let error = Metrics::parse(b"timestep,a\n250,1\n500,\xff\n", Path::new("f")).unwrap_err();
        assert!(error.to_string().contains("line 3: not text"), "{error}");
    }

    #[test]
    fn a_line_that_has_not_ended_does_not_count() {
        assert_eq!(parse("timestep,a\n250,-123\n500,-1").unwrap().timesteps, [250]);
    }

    #[test]
    fn names_that_would_break_a_file_are_refused() {
        for names in [&["a,b"][..], &["a", "a"], &["timestep"], &[""], &["a\n"]] {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            assert!(matches!(header(&names), Err(Error::Usage(_))), "{names:?}");
        }
    }
}
