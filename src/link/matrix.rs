//! A probability for each link: the communication matrix and its text form.

use std::path::Path;
use std::sync::Arc;

use super::level::lose_by;
use super::{Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::regular;
use crate::usage;

/// The most bytes the file of a matrix may have.
const LARGEST: u64 = 1 << 20;

/// `matrix(FILE)`: a fixed communication matrix C, `C[i][j]` the probability that i receives j.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix(pub Arc<CommunicationMatrix>);

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "matrix",
    about: "links by a communication matrix (p = C[i][j], drop = 1 - p)",
    parameters: &[Parameter { name: "FILE", domain: Domain::Matrix, default: None }],
    build: |arguments| Ok(Box::new(Matrix(arguments[0].matrix().clone()))),
};

impl Link for Matrix {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        lose_by(context, fates, |receiver, sender| self.0.p(receiver, sender));
        Ok(())
    }
}

/// The communication matrix C: `p(i, j)` is the probability that agent i receives agent j.
#[derive(Clone, Debug, PartialEq)]
pub struct CommunicationMatrix {
    agents: usize,
    /// Row-major, `agents * agents`.
    p: Vec<f64>,
}

impl CommunicationMatrix {
    /// The probability that `receiver` receives `sender`.
    pub fn p(&self, receiver: usize, sender: usize) -> f64 {
        self.p[receiver * self.agents + sender]
    }

    /// The rows, one per receiver.
    pub(crate) fn to_rows(&self) -> Vec<Vec<f64>> {
        self.p.chunks_exact(self.agents).map(<[f64]>::to_vec).collect()
    }

    /// The matrix of a team of `agents` that has these rows, see [`CommunicationMatrix::parse`].
    pub(crate) fn of(rows: &[Vec<f64>], agents: usize) -> Result<CommunicationMatrix> {
        let row = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        CommunicationMatrix::parse(&rows.iter().map(row).collect::<Vec<_>>().join("\n"), agents)
    }

    /// Reads a matrix for a team of `agents` from a file, see [`CommunicationMatrix::parse`].
    pub fn read(path: &Path, agents: usize) -> Result<CommunicationMatrix> {
        let text = regular::read_text(path, LARGEST)?;
        CommunicationMatrix::parse(&text, agents)
            .map_err(|e| usage!("communication matrix {}: {e}", path.display()))
    }

    /// Parses one line per receiver, one number per sender, separated by blanks or commas; `#` starts
    /// a comment. The diagonal is 1: an agent always has its own observation.
    pub fn parse(text: &str, agents: usize) -> Result<CommunicationMatrix> {
        // Editors on some systems begin a file with a byte order mark.
        let lines = text
            .trim_start_matches('\u{feff}')
            .lines()
            .map(|line| line.split('#').next().unwrap_or_default().trim());
        let rows: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
        if rows.len() != agents {
            return Err(usage!("{agents} agents need {agents} rows of {agents}, found {} rows", rows.len()));
        }
        let mut p = Vec::with_capacity(agents * agents);
        for (i, row) in rows.iter().enumerate() {
            let entries = row.split([',', ' ', '\t']).filter(|entry| !entry.is_empty());
            for (j, entry) in entries.enumerate() {
                p.push(parse_entry(entry, i, j)?);
            }
            let found = p.len() - i * agents;
            if found != agents {
                return Err(usage!("row {i} has {found} entries, {agents} agents need {agents}"));
            }
        }
        Ok(CommunicationMatrix { agents, p })
    }
}

fn parse_entry(entry: &str, receiver: usize, sender: usize) -> Result<f64> {
    let place = format!("row {receiver}, column {sender}");
    let p: f64 = entry.parse().map_err(|_| usage!("{place}: `{entry}` is not a number"))?;
    if !(0.0..=1.0).contains(&p) {
        return Err(usage!("{place}: {entry} is not a probability in [0, 1]"));
    }
    if receiver == sender && p != 1.0 {
        return Err(usage!("{place}: the diagonal must be 1: an agent always has its own observation"));
    }
    Ok(p)
}

#[cfg(test)]
mod tests {
    use super::super::Links;
    use super::super::testing::{STEPS, rows_of};
    use super::*;

    #[test]
    fn realised_rates_follow_the_matrix() {
        let text = "1 0.9 0\n0.1 1 0.5\n1 0.3 1\n";
        let matrix = Arc::new(CommunicationMatrix::parse(text, 3).unwrap());
        let mut links = Links::chain(vec![Box::new(Matrix(matrix.clone()))]).unwrap();
        let (mut delivered, n) = ([[0u32; 3]; 3], 400 * (STEPS - 1));
        for episode in 0..400 {
            for step in 1..STEPS {
                for (i, row) in rows_of(&mut links, episode, step, 3).iter().enumerate() {
                    (0..3).for_each(|j| delivered[i][j] += (row >> j & 1) as u32);
                }
            }
        }
        for (i, row) in delivered.iter().enumerate() {
            for (j, count) in row.iter().enumerate() {
                let (p, rate) = (matrix.p(i, j), f64::from(*count) / n as f64);
                let sigma = (p * (1.0 - p) / n as f64).sqrt();
                assert!((rate - p).abs() <= 5.0 * sigma, "C[{i}][{j}] = {p}, realised {rate}");
            }
        }
    }

    #[test]
    fn blanks_commas_and_comments_are_read() {
        let text = "\u{feff}# who hears whom\n1, 0.5\n\n0.25 1 # second row\n";
        let matrix = CommunicationMatrix::parse(text, 2).unwrap();
        assert_eq!([matrix.p(0, 1), matrix.p(1, 0), matrix.p(1, 1)], [0.5, 0.25, 1.0]);
    }

    #[test]
    fn wrong_matrices_say_what_is_wrong() {
        for (text, agents, words) in [
            ("1 0.5\n0.5 1", 3, "found 2 rows"),
            ("1 0.5 1\n0.5 1", 2, "row 0 has 3 entries"),
            ("1\n0.5 1", 2, "row 0 has 1 entries"),
            ("1 1.5\n0.5 1", 2, "not a probability"),
            ("1 nan\n0.5 1", 2, "not a probability"),
            ("1 x\n0.5 1", 2, "not a number"),
            ("0.9 0.5\n0.5 1", 2, "diagonal"),
            ("", 2, "found 0 rows"),
        ] {
            let message = CommunicationMatrix::parse(text, agents).unwrap_err().to_string();
            assert!(message.contains(words), "{text:?}: {message}");
        }
    }
}
