//! Least absolute deviations: what most equations agree on, whatever the others say.

use crate::base::error::Result;

/// Linear equations `sum of coefficient * unknown = value`.
#[derive(Clone, Debug, Default)]
pub(super) struct Equations {
    rows: Vec<(Vec<(usize, f64)>, f64)>,
    unknowns: usize,
}

/// Rounds of reweighting. Each brings exact equations nearer to being satisfied exactly.
const ROUNDS: usize = 40;
/// Keeps weights finite, and unknowns that no equation speaks of at zero.
const TINY: f64 = 1e-9;

impl Equations {
    pub(super) fn of(unknowns: usize) -> Equations {
        Equations { rows: Vec::new(), unknowns }
    }

    pub(super) fn push(&mut self, row: Vec<(usize, f64)>, value: f64) {
        self.rows.push((row, value));
    }

    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// What minimises the sum of the absolute errors, by iteratively reweighted least squares; zero for an unknown that
    /// is in no equation. `go_on` is asked before each round, and its error is returned.
    pub(super) fn solve(&self, go_on: impl Fn() -> Result<()>) -> Result<Vec<f64>> {
        let n = self.unknowns;
        let mut solution = vec![0.0; n];
        for round in 0..ROUNDS {
            go_on()?;
            let (mut matrix, mut right) = (vec![vec![0.0; n]; n], vec![0.0; n]);
            for (row, value) in &self.rows {
                let weight = match round {
                    0 => 1.0,
                    _ => 1.0 / error(row, *value, &solution).abs().max(TINY),
                };
                for &(i, a) in row {
                    right[i] += weight * a * value;
                    row.iter().for_each(|&(j, b)| matrix[i][j] += weight * a * b);
                }
            }
            solution = eliminate(matrix, right);
        }
        Ok(solution)
    }

    /// The median of the absolute errors of a solution.
    pub(super) fn median_error(&self, solution: &[f64]) -> f64 {
        let errors = self.rows.iter().map(|(row, value)| error(row, *value, solution).abs());
        median(errors.collect())
    }
}

/// The middle one of some values; 0 if there are none.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// How far an equation is from holding.
fn error(row: &[(usize, f64)], value: f64, solution: &[f64]) -> f64 {
    value - row.iter().map(|&(at, coefficient)| coefficient * solution[at]).sum::<f64>()
}

/// Gauss's elimination of a symmetric matrix that is positive semi-definite: no pivot is negative, and an unknown
/// whose pivot is zero is zero.
fn eliminate(mut matrix: Vec<Vec<f64>>, mut right: Vec<f64>) -> Vec<f64> {
    let n = right.len();
    let scales: Vec<f64> = (0..n).map(|at| matrix[at][at]).collect();
    let determined = |pivot: f64, at: usize| pivot > 1e-12 * scales[at] && pivot > 0.0;
    for at in 0..n {
        let (pivot, behind) = matrix[at..].split_first_mut().expect("every unknown has a row");
        if !determined(pivot[at], at) {
            continue;
        }
        for (below, row) in behind.iter_mut().enumerate() {
            let factor = row[at] / pivot[at];
            row[at..].iter_mut().zip(&pivot[at..]).for_each(|(value, pivot)| *value -= factor * pivot);
            right[at + 1 + below] -= factor * right[at];
        }
    }
    for at in (0..n).rev() {
        let known: f64 = (at + 1..n).map(|later| matrix[at][later] * right[later]).sum();
        right[at] = if determined(matrix[at][at], at) { (right[at] - known) / matrix[at][at] } else { 0.0 };
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_most_equations_agree_on_is_found_exactly() {
        let mut equations = Equations::of(3);
        for at in 0..40 {
            let x = f64::from(at) / 7.0;
            let wrong = if at % 4 == 0 { x * x } else { 0.0 };
            equations.push(vec![(0, x), (1, 1.0)], 2.0 * x - 3.0 + wrong);
        }
        let solution = equations.solve(|| Ok(())).unwrap();
        assert!((solution[0] - 2.0).abs() < 1e-6 && (solution[1] + 3.0).abs() < 1e-6, "{solution:?}");
        assert_eq!(solution[2], 0.0, "no equation speaks of it");
        assert!(equations.median_error(&solution) < 1e-6);
    }
}
