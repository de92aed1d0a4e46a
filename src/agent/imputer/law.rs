//! What an agent learns of the law of motion from its own, within an episode.

use crate::dynamics::Law;

/// How many observed changes of a velocity a law has to explain.
const ROWS: usize = 4;

/// How well it has to explain each, m/s. Observations are exact to the rounding of f32; a motor that is unsteady is not.
const EXACT: f64 = 1e-5;

/// How far another law is from the fitted one at least, in either parameter. The faint push of an agent that almost touches
/// makes no other law.
const OTHER: f64 = 1e-2;

/// How much motion there must be to learn from: the sum of squared velocities or pushes, m2/s2, and how much of it is not
/// the same in both.
const LEAST: f64 = 1e-2;

/// The law of motion in each world: the fitted one, until the agent's own motion, as far as it sees that, follows another
/// one *exactly*. So damping or mass that changed is found within some steps, and noise is not mistaken for either.
#[derive(Debug)]
pub(super) struct Learner {
    fitted: Law,
    worlds: Vec<World>,
}

#[derive(Clone, Debug)]
struct World {
    law: Law,
    /// Of an axis along which it sees itself: the velocity at the last step and the push since. `None` after a contact.
    pending: [Option<[f64; 2]>; 2],
    /// The last changes: velocity, push, velocity one step later.
    rows: [[f64; 3]; ROWS],
    n_rows: usize,
}

impl Learner {
    pub(super) fn new(fitted: Law, worlds: usize) -> Learner {
        let world = World { law: fitted, pending: [None; 2], rows: [[0.0; 3]; ROWS], n_rows: 0 };
        Learner { fitted, worlds: vec![world; worlds] }
    }

    /// Nothing has been seen.
    pub(super) fn begin_episodes(&mut self) {
        for world in &mut self.worlds {
            (world.law, world.pending, world.n_rows) = (self.fitted, [None; 2], 0);
        }
    }

    /// The law in a world.
    pub(super) fn law(&self, world: usize) -> Law {
        self.worlds[world].law
    }

    /// What happens along an axis in the step that follows: nothing that could be learned from if another body pushes.
    pub(super) fn expect(&mut self, world: usize, axis: usize, velocity_and_push: Option<[f64; 2]>) {
        self.worlds[world].pending[axis] = velocity_and_push;
    }

    /// Learns from the velocity along an axis when the step is over.
    pub(super) fn observe(&mut self, world: usize, axis: usize, velocity: f64) {
        let World { law, pending, rows, n_rows } = &mut self.worlds[world];
        let Some([before, push]) = pending[axis].take() else { return };
        rows[*n_rows % ROWS] = [before, push, velocity];
        *n_rows += 1;
        let explains = |law: &Law| {
            rows.iter()
                .all(|[before, push, after]| (law.keep * before + law.gain * push - after).abs() < EXACT)
        };
        if *n_rows >= ROWS && !explains(law) {
            let other = solve(rows, law.gain).filter(|other| {
                let differs =
                    (other.keep - self.fitted.keep).abs().max((other.gain - self.fitted.gain).abs()) > OTHER;
                differs && other.gain > OTHER && (0.0..=1.0).contains(&other.keep)
            });
            let found = [Some(self.fitted), other].into_iter().flatten().find(explains);
            *law = found.unwrap_or(*law);
        }
    }
}

/// The law by least squares, if the rows determine it, and would without any one of them: an unforeseen contact in one step
/// would go unnoticed otherwise. Of rows without a push the gain cannot be known: it stays.
fn solve(rows: &[[f64; 3]; ROWS], gain: f64) -> Option<Law> {
    let sum = |a: usize, b: usize| rows.iter().map(|row| row[a] * row[b]).sum::<f64>();
    let (vv, vu, uu, va, ua) = (sum(0, 0), sum(0, 1), sum(1, 1), sum(0, 2), sum(1, 2));
    let without = |row: &[f64; 3]| [vv - row[0] * row[0], vu - row[0] * row[1], uu - row[1] * row[1]];
    if uu < LEAST {
        let determined = rows.iter().all(|row| without(row)[0] > LEAST);
        return determined.then(|| Law { keep: va / vv, gain });
    }
    let determined = rows
        .iter()
        .map(without)
        .all(|[vv, vu, uu]| vv > LEAST && uu > LEAST && vv * uu - vu * vu > LEAST * vv * uu);
    let determinant = vv * uu - vu * vu;
    determined
        .then(|| Law { keep: (va * uu - ua * vu) / determinant, gain: (ua * vv - va * vu) / determinant })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FITTED: Law = Law { keep: 0.75, gain: 1.0 };

    /// What is taken for the law after these pushes by another law, with errors of the velocity added.
    fn learned(truth: Law, pushes: &[f64], errors: &[f64]) -> Law {
        let mut learner = Learner::new(FITTED, 2);
        learner.begin_episodes();
        let mut velocity = 0.0;
        for (push, error) in pushes.iter().zip(errors) {
            learner.expect(1, 0, Some([velocity, *push]));
            velocity = truth.keep * velocity + truth.gain * push + error;
            learner.observe(1, 0, f64::from(velocity as f32));
        }
        assert_eq!(learner.law(0), FITTED);
        learner.law(1)
    }

    #[test]
    fn damping_and_mass_follow_from_four_steps() {
        let truth = Law { keep: 0.7, gain: 1.25 };
        let pushes = [0.5, 0.0, -0.5, 0.5];
        let found = learned(truth, &pushes, &[0.0; 4]);
        assert!((found.keep - 0.7).abs() < 1e-5 && (found.gain - 1.25).abs() < 1e-5, "{found:?}");
        assert_eq!(learned(truth, &pushes[..3], &[0.0; 3]), FITTED, "too early");
        assert_eq!(learned(FITTED, &pushes, &[0.0; 4]), FITTED, "to the bit");
    }

    #[test]
    fn what_is_not_exact_teaches_nothing() {
        let truth = Law { keep: 0.7, gain: 1.0 };
        let pushes = [0.5, 0.0, -0.5, 0.5, 0.0, 0.5, -0.5, 0.0];
        let noise = [0.05, -0.03, 0.02, -0.04, 0.01, 0.03, -0.05, 0.04];
        assert_eq!(learned(truth, &pushes, &noise), FITTED);
        // A contact that nobody foresaw is forgotten when four steps have passed since.
        let mut contact = [0.0; 8];
        contact[2] = 0.2;
        assert_eq!(learned(truth, &pushes[..6], &contact[..6]), FITTED);
        assert!((learned(truth, &pushes, &contact).keep - 0.7).abs() < 1e-5);
    }

    #[test]
    fn without_a_push_only_the_damping_is_known() {
        let coasting = [1.0, 0.8, 0.64, 0.512].map(|velocity| [velocity, 0.0, 0.8 * velocity]);
        let found = solve(&coasting, 1.0).unwrap();
        assert!((found.keep - 0.8).abs() < 1e-12 && found.gain == 1.0);
        assert_eq!(solve(&[[1.0, 0.5, 1.0]; ROWS], 1.0), None, "both or neither");
        // One push after that, against somebody who was not expected there, is no other gain.
        let [first, second, third, _] = coasting;
        assert_eq!(solve(&[first, second, third, [0.5, 0.5, 0.6]], 1.0), None);
        // Nor does it count to have been at rest.
        assert_eq!(solve(&[[0.0; 3], [0.0; 3], [0.0; 3], [0.5, 0.0, 0.2]], 1.0), None);
    }
}
