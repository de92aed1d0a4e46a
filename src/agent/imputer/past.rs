//! What was estimated at the last steps, against which observations that arrive late are held.

use super::JointLayout;

/// The estimates of the last steps in each world.
///
/// An observation that was made k steps ago says how wrong the estimate of that step was. The predictions made since are
/// kept, and what they started from is put right: the estimates of that step and of all later ones move by what was wrong.
#[derive(Clone, Debug)]
pub struct Past {
    layout: JointLayout,
    /// Steps that are kept.
    kept: usize,
    /// `[worlds, kept, predicted]`, a step at its number modulo `kept`.
    estimates: Vec<f32>,
    /// Steps of the episode so far.
    steps: usize,
    /// The first step of each world that counts.
    since: Vec<usize>,
}

impl Past {
    /// Room for the last `longest_delay` steps.
    pub fn new(layout: JointLayout, worlds: usize, longest_delay: u8) -> Past {
        let kept = longest_delay.into();
        let estimates = vec![0.0; worlds * kept * layout.predicted()];
        Past { layout, kept, estimates, steps: 0, since: vec![0; worlds] }
    }

    /// An episode begins.
    pub fn begin_episode(&mut self) {
        self.steps = 0;
        self.since.fill(0);
    }

    /// The estimates of a world so far are worth nothing any more.
    pub fn forget(&mut self, world: usize) {
        self.since[world] = self.steps;
    }

    /// Keeps the joint estimates of a step, `[worlds, joint]`.
    pub fn keep(&mut self, estimates: &[f32]) {
        if self.kept == 0 {
            return;
        }
        let (joint, predicted) = (self.layout.joint(), self.layout.predicted());
        let place = self.steps % self.kept;
        let worlds = self.estimates.chunks_exact_mut(self.kept * predicted);
        for (world, estimate) in worlds.zip(estimates.chunks_exact(joint)) {
            world[place * predicted..][..predicted].copy_from_slice(&estimate[..predicted]);
        }
        self.steps += 1;
    }

    /// Turns what `sender` observed `age` steps ago, in `part`, into an estimate of what it observes now, of which `carried`
    /// was the estimate without it.
    ///
    /// If that step is not kept, since the agent has missed some against the clock, the observation is the estimate.
    pub fn correct(&mut self, world: usize, sender: usize, age: u8, carried: &[f32], part: &mut [f32]) {
        for ((dim, value), carried) in self.layout.part(sender).zip(part).zip(carried) {
            if let Some(wrong) = self.put_right(world, dim, age, *value) {
                *value = carried + wrong;
            }
        }
    }

    /// How much what was observed of a dim `age` steps ago is more than its estimate of that step, by which that estimate
    /// and all later ones move. `None` if that step is not kept.
    pub fn put_right(&mut self, world: usize, dim: usize, age: u8, observed: f32) -> Option<f32> {
        let (predicted, kept, age) = (self.layout.predicted(), self.kept, usize::from(age));
        if age > (self.steps - self.since[world]).min(kept) {
            return None;
        }
        let estimates = &mut self.estimates[world * kept * predicted..][..kept * predicted];
        let at = |step: usize| step % kept * predicted + dim;
        let then = self.steps - age;
        let wrong = observed - estimates[at(then)];
        (then..self.steps).for_each(|step| estimates[at(step)] += wrong);
        Some(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAYOUT: JointLayout = JointLayout { agents: 2, unique: 1, common: 1 };

    /// Agent 1's place is estimated with `drift` too much a step, starting from `wrong`; at each step an observation arrives
    /// that is `age` steps old. How far off the estimates are.
    fn errors(age: u8, wrong: f32, drift: f32) -> Vec<f32> {
        let mut past = Past::new(LAYOUT, 2, 5);
        past.begin_episode();
        let truth = |step: usize| step as f32;
        let mut carried = wrong;
        let mut errors = Vec::new();
        for step in 0..20 {
            let mut estimate = carried;
            if step >= usize::from(age) {
                let mut part = [truth(step - usize::from(age))];
                past.correct(1, 1, age, &[carried], &mut part);
                estimate = part[0];
            }
            errors.push(estimate - truth(step));
            past.keep(&[0.0, 0.0, 0.0, 0.0, estimate, 0.0]);
            carried = estimate + 1.0 + drift;
        }
        errors
    }

    #[test]
    fn what_was_wrong_is_put_right_once() {
        for age in 1..=5 {
            let errors = errors(age, 8.0, 0.0);
            let (before, after) = errors.split_at(age.into());
            assert!(
                before.iter().all(|error| *error == 8.0) && after.iter().all(|error| *error == 0.0),
                "{errors:?}"
            );
        }
    }

    #[test]
    fn what_is_left_is_what_was_wrongly_predicted_since() {
        for age in 1..=5 {
            let errors = errors(age, 0.0, 0.25);
            assert!(errors[age.into()..].iter().all(|error| *error == 0.25 * f32::from(age)), "{errors:?}");
        }
    }

    #[test]
    fn without_an_estimate_of_then_the_observation_counts() {
        let mut past = Past::new(LAYOUT, 1, 2);
        past.keep(&[0.0, 1.0, 0.0]);
        let mut part = [4.0];
        past.correct(0, 1, 2, &[9.0], &mut part);
        assert_eq!(part, [4.0]);
        past.begin_episode();
        past.correct(0, 1, 1, &[9.0], &mut part);
        assert_eq!(part, [4.0], "those of the last episode are over");
    }
}
