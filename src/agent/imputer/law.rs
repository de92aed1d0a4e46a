//! What an agent learns of the law of motion from what it sees of anybody's, within an episode.

use crate::dynamics::Law;

/// How many observed changes of a velocity a law has to explain.
const ROWS: usize = 4;

/// How many changes are remembered, or four of each velocity that is seen, if that is more.
const MEMORY: usize = 16;

/// How many velocities are worth looking at.
pub(super) const MOST_SEEN: usize = 8;

/// How well a law has to explain each, m/s. Observations are exact to the rounding of f32; a motor that is unsteady is not.
const EXACT: f64 = 1e-5;

/// How far another law is from the fitted one at least, in either parameter. The faint push of an agent that almost touches
/// makes no other law.
const OTHER: f64 = 1e-2;

/// By how much velocities of two changes differ, m/s, so that both tell something, unless one is at rest: one body that pushes
/// another steadily changes alike in every step.
const UNLIKE: f64 = 1e-3;

/// How much motion there must be to learn from: the squared velocity or push, m2/s2, and how much of both is not the same.
const LEAST: f64 = 1e-2;

/// The law of motion in each world: the fitted one, until motion follows another one *exactly*. So damping or mass that
/// changed is found within some steps, and noise is not mistaken for either.
#[derive(Debug)]
pub(super) struct Learner {
    fitted: Law,
    /// By velocity that is seen, what pushes there may be along its axis, m/s: none if they are known.
    pushes: Vec<Vec<f64>>,
    worlds: Vec<World>,
}

#[derive(Debug)]
struct World {
    law: Law,
    /// Of each velocity that is seen: what it was at the last step, and the push since, if that is known. `None` after a
    /// contact.
    pending: Vec<Option<(f64, Option<f64>)>>,
    /// The last changes, the newest first.
    rows: Vec<Row>,
    steps: u32,
}

/// A velocity, the push in the step that follows, if it is known, and the velocity after it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row {
    step: u32,
    seen: usize,
    before: f64,
    push: Option<f64>,
    after: f64,
}

impl Row {
    /// Whether it tells no more than another one.
    fn is_like(&self, other: &Row) -> bool {
        (self.before - other.before).abs() < UNLIKE && self.before.abs() > UNLIKE
    }
}

impl Learner {
    /// For velocities that are seen, along whose axes there may be these pushes, or which ones is known.
    pub(super) fn new(fitted: Law, pushes: Vec<Vec<f64>>, worlds: usize) -> Learner {
        let world = |_| World {
            law: fitted,
            pending: vec![None; pushes.len()],
            rows: Vec::with_capacity(MEMORY.max(ROWS * pushes.len()) + 1),
            steps: 0,
        };
        Learner { fitted, worlds: (0..worlds).map(world).collect(), pushes }
    }

    /// Nothing has been seen.
    pub(super) fn begin_episodes(&mut self) {
        for world in &mut self.worlds {
            (world.law, world.steps) = (self.fitted, 0);
            world.pending.fill(None);
            world.rows.clear();
        }
    }

    /// The law in a world.
    pub(super) fn law(&self, world: usize) -> Law {
        self.worlds[world].law
    }

    /// A velocity before a step, and the push in it if that is known. `None` if nothing can be learned from what follows,
    /// because another body pushes too.
    pub(super) fn expect(&mut self, world: usize, seen: usize, before_and_push: Option<(f64, Option<f64>)>) {
        self.worlds[world].pending[seen] = before_and_push;
    }

    /// The velocities when the step is over. Learns from them.
    pub(super) fn observe(&mut self, world: usize, velocities: impl Iterator<Item = f64>) {
        let Learner { fitted, pushes, worlds } = self;
        let World { law, pending, rows, steps } = &mut worlds[world];
        let (step, mut news) = (*steps, 0);
        let memory = MEMORY.max(ROWS * pushes.len());
        *steps += 1;
        for (seen, (pending, after)) in pending.iter_mut().zip(velocities).enumerate() {
            if let Some((before, push)) = pending.take() {
                rows.insert(0, Row { step, seen, before, push, after });
                rows.truncate(memory);
                news += 1;
            }
        }
        let evidence = Evidence { rows, pushes };
        let news = 0..news;
        if news.clone().all(|at| evidence.push(*law, &rows[at]).is_some()) {
            return;
        }
        let is_new = |law: &Law| {
            let differs = (law.keep - fitted.keep).abs().max((law.gain - fitted.gain).abs()) > OTHER;
            differs && law.gain > OTHER && (0.0..=1.0).contains(&law.keep)
        };
        let others = news.flat_map(|at| evidence.with_one_changed(*law, at));
        let others = others.chain(evidence.with_both_changed()).filter(is_new);
        let counted = others.chain([*fitted]).map(|other| (evidence.explained(other), other));
        let (explained, best) =
            counted.max_by_key(|(explained, _)| *explained).expect("there is the fitted law");
        if explained >= ROWS && explained > evidence.explained(*law) {
            *law = best;
        }
    }
}

/// What has been seen in one world.
struct Evidence<'a> {
    /// The newest first.
    rows: &'a [Row],
    /// By velocity that is seen.
    pushes: &'a [Vec<f64>],
}

impl Evidence<'_> {
    /// The pushes that may have been in a row.
    fn pushes<'a>(&'a self, row: &'a Row) -> &'a [f64] {
        row.push.as_ref().map_or(&self.pushes[row.seen], std::slice::from_ref)
    }

    /// The push with which a law explains a row.
    fn push(&self, law: Law, row: &Row) -> Option<f64> {
        let fits = |push: &&f64| (law.keep * row.before + law.gain * **push - row.after).abs() < EXACT;
        self.pushes(row).iter().find(fits).copied()
    }

    /// How many rows a law explains.
    fn explained(&self, law: Law) -> usize {
        self.rows.iter().filter(|row| self.push(law, row).is_some()).count()
    }

    /// The laws with which another gain, or another share of the velocity that is kept, explains row `at` and another one of
    /// another step: an unforeseen contact would pass for either otherwise.
    fn with_one_changed(&self, law: Law, at: usize) -> impl Iterator<Item = Law> {
        let row = &self.rows[at];
        let of_push = move |push: f64| {
            let with_gain = Law { gain: (row.after - law.keep * row.before) / push, ..law };
            let with_keep = Law { keep: (row.after - law.gain * push) / row.before, ..law };
            let confirmed = |law: &Law, moves: fn(&Row, f64) -> f64| {
                let tells = |other: &Row| {
                    let push = self.push(*law, other).filter(|push| moves(other, *push).powi(2) > LEAST);
                    other.step != row.step && !row.is_like(other) && push.is_some()
                };
                moves(row, push).powi(2) > LEAST && self.rows.iter().any(tells)
            };
            [
                Some(with_gain).filter(|law| confirmed(law, |_, push| push)),
                Some(with_keep).filter(|law| confirmed(law, |row, _| row.before)),
            ]
        };
        self.pushes(row).iter().copied().flat_map(of_push).flatten()
    }

    /// The law that explains the last rows whose push is known, by least squares, if they determine it, and would without any
    /// one of them.
    fn with_both_changed(&self) -> Option<Law> {
        let mut known = self.rows.iter().filter_map(|row| Some([row.before, row.push?, row.after]));
        let mut rows = [[0.0; 3]; ROWS];
        for row in &mut rows {
            *row = known.next()?;
        }
        let sum = |a: usize, b: usize| rows.iter().map(|row| row[a] * row[b]).sum::<f64>();
        let (vv, vu, uu, va, ua) = (sum(0, 0), sum(0, 1), sum(1, 1), sum(0, 2), sum(1, 2));
        let without = |row: &[f64; 3]| [vv - row[0] * row[0], vu - row[0] * row[1], uu - row[1] * row[1]];
        let is_determined =
            |[vv, vu, uu]: [f64; 3]| vv > LEAST && uu > LEAST && vv * uu - vu * vu > LEAST * vv * uu;
        let determinant = vv * uu - vu * vu;
        let law = Law { keep: (va * uu - ua * vu) / determinant, gain: (ua * vv - va * vu) / determinant };
        let determined = rows.iter().map(without).all(is_determined);
        let explained = rows
            .iter()
            .all(|[before, push, after]| (law.keep * before + law.gain * push - after).abs() < EXACT);
        Some(law).filter(|_| determined && explained)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FITTED: Law = Law { keep: 0.75, gain: 1.0 };
    const PUSHES: [f64; 3] = [-0.5, 0.0, 0.5];

    /// What is taken for the law by somebody who sees bodies that are pushed like this step by step, the first by itself,
    /// while another law holds and errors are added to the first velocity.
    fn learned(truth: Law, pushes: &[&[f64]], errors: &[f64]) -> Law {
        let n_bodies = pushes[0].len();
        let mut learner = Learner::new(FITTED, vec![PUSHES.to_vec(); n_bodies], 2);
        learner.begin_episodes();
        let mut velocities = vec![0.0; n_bodies];
        for (pushes, error) in pushes.iter().zip(errors) {
            for (body, (velocity, push)) in velocities.iter_mut().zip(*pushes).enumerate() {
                learner.expect(1, body, Some((*velocity, Some(*push).filter(|_| body == 0))));
                *velocity = truth.keep * *velocity + truth.gain * push + if body == 0 { *error } else { 0.0 };
                *velocity = f64::from(*velocity as f32);
            }
            learner.observe(1, velocities.iter().copied());
        }
        assert_eq!(learner.law(0), FITTED);
        learner.law(1)
    }

    fn assert_near(found: Law, truth: Law) {
        let near = (found.keep - truth.keep).abs() < 1e-5 && (found.gain - truth.gain).abs() < 1e-5;
        assert!(near, "{found:?} {truth:?}");
    }

    #[test]
    fn damping_and_mass_follow_from_four_steps() {
        let truth = Law { keep: 0.7, gain: 1.25 };
        let pushes: [&[f64]; 4] = [&[0.5], &[0.0], &[-0.5], &[0.5]];
        assert_near(learned(truth, &pushes, &[0.0; 4]), truth);
        assert_eq!(learned(truth, &pushes[..3], &[0.0; 3]), FITTED, "too early");
        assert_eq!(learned(FITTED, &pushes, &[0.0; 4]), FITTED, "to the bit");
    }

    #[test]
    fn one_of_them_follows_from_two_steps_of_others() {
        let pushes: [&[f64]; 3] = [&[0.0, 0.5, 0.0], &[0.0, -0.5, 0.5], &[0.0, 0.0, 0.0]];
        for truth in [Law { gain: 1.25, ..FITTED }, Law { keep: 0.8, ..FITTED }] {
            let n_steps = if truth.gain == 1.0 { 3 } else { 2 };
            assert_near(learned(truth, &pushes[..n_steps], &[0.0; 3]), truth);
            assert_eq!(learned(truth, &pushes[..n_steps - 1], &[0.0; 3]), FITTED, "too early");
        }
    }

    #[test]
    fn two_that_push_each_other_make_no_other_law() {
        // Between the second and the third body, as long as they touch; the first rests.
        let mut learner = Learner::new(FITTED, vec![PUSHES.to_vec(); 3], 1);
        learner.begin_episodes();
        let mut velocity = 0.0;
        for contact in [0.3, 0.2, 0.15, 0.1] {
            let before = [0.0, velocity, -velocity];
            velocity = f64::from((0.75 * velocity + contact) as f32);
            before
                .iter()
                .enumerate()
                .for_each(|(body, before)| learner.expect(0, body, Some((*before, None))));
            learner.observe(0, [0.0, velocity, -velocity].into_iter());
            assert_eq!(learner.law(0), FITTED);
        }
    }

    #[test]
    fn one_that_pushes_another_for_long_makes_no_other_law() {
        // Two bodies along a line, the second behind the first, which a third sees.
        let mut learner = Learner::new(FITTED, vec![PUSHES.to_vec(); 2], 1);
        learner.begin_episodes();
        let (mut places, mut velocities) = ([0.0f64, 0.15], [0.0; 2]);
        for step in 0..500 {
            let contact = 10.0 * (0.2 - (places[1] - places[0])).max(0.0);
            (0..2).for_each(|body| learner.expect(0, body, Some((velocities[body], None))));
            for (body, push) in [0.5 - contact, contact].into_iter().enumerate() {
                velocities[body] = f64::from((0.75 * velocities[body] + push) as f32);
                places[body] += 0.1 * velocities[body];
            }
            learner.observe(0, velocities.into_iter());
            assert_eq!(learner.law(0), FITTED, "step {step}");
        }
    }

    #[test]
    fn what_is_not_exact_teaches_nothing() {
        let truth = Law { keep: 0.7, gain: 1.1 };
        let pushes: [&[f64]; 8] = [&[0.5], &[0.0], &[-0.5], &[0.5], &[0.0], &[0.5], &[-0.5], &[0.0]];
        let noise = [0.05, -0.03, 0.02, -0.04, 0.01, 0.03, -0.05, 0.04];
        assert_eq!(learned(truth, &pushes, &noise), FITTED);
        // A contact that nobody foresaw is forgotten when four steps have passed since.
        let mut contact = [0.0; 8];
        contact[2] = 0.2;
        assert_eq!(learned(truth, &pushes[..6], &contact[..6]), FITTED);
        assert_near(learned(truth, &pushes, &contact), truth);
    }

    #[test]
    fn without_a_push_only_the_damping_is_known() {
        let pushes: [&[f64]; 5] = [&[0.5], &[0.0], &[0.0], &[0.0], &[0.0]];
        let truth = Law { keep: 0.8, gain: 1.25 };
        // The first push is unlike any that keeps the gain, and nobody knows yet what keeps it.
        assert_near(learned(truth, &pushes, &[0.0; 5]), Law { keep: 0.8, gain: 1.0 });
    }
}
