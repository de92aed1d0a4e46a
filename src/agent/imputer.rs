//! The imputer: completes what was received to an estimate of the joint observation.

use super::{Inbox, Past};
use crate::bus::NOT_ARRIVED;
use crate::environment::Spec;
use crate::nn::{LstmState, Predictor, Scratch};

/// Where the parts of the joint observation are: `unique_1 .. unique_n, common`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JointLayout {
    /// Size of the team.
    pub agents: usize,
    /// Values that are an agent's own.
    pub unique: usize,
    /// Values behind them in each observation that are the same for all, and always known.
    pub common: usize,
}

impl JointLayout {
    /// That of an environment.
    pub fn of(spec: &Spec) -> JointLayout {
        JointLayout { agents: spec.n_agents(), unique: spec.unique_dim(), common: spec.common_dim() }
    }

    /// Length of the joint observation.
    pub fn joint(&self) -> usize {
        self.predicted() + self.common
    }

    /// Length of its predicted part.
    pub fn predicted(&self) -> usize {
        self.agents * self.unique
    }

    /// Puts `joint` together: the unique part of each agent from the front of what `known` knows of it, and the
    /// common part from `observation`, which may be anybody's.
    pub fn join<'a>(
        &self,
        mut known: impl FnMut(usize) -> &'a [f32],
        observation: &[f32],
        joint: &mut [f32],
    ) {
        let (parts, common) = joint.split_at_mut(self.predicted());
        for (agent, part) in parts.chunks_exact_mut(self.unique).enumerate() {
            part.copy_from_slice(&known(agent)[..self.unique]);
        }
        common.copy_from_slice(&observation[self.unique..self.unique + self.common]);
    }
}

/// One agent's imputer, with its memory in each parallel world.
#[derive(Debug)]
pub struct Imputer {
    layout: JointLayout,
    rule: Rule,
    /// What stands for the unique parts that are not received, `[worlds, predicted]`. Zero when an
    /// episode starts: then nothing is known.
    carried: Vec<f32>,
}

/// How the unique parts are carried over from one step to the next.
#[derive(Debug)]
enum Rule {
    /// Not at all: what is not received counts as zero.
    Zero,
    /// As they are: what is not received counts as what was received last.
    Hold,
    /// Places by their velocity, which stays as it is; the rest as with `Hold`.
    Velocity(Vec<Motion>),
    /// By the predictor's mean delta.
    Predict(Box<Prediction>),
}

/// A place that moves with a velocity; both are dims of the joint observation.
#[derive(Debug)]
struct Motion {
    place: usize,
    velocity: usize,
    /// What a step adds to the place, per unit of velocity: plus or minus the length of a step, s.
    factor: f32,
}

#[derive(Debug)]
struct Prediction {
    predictor: Predictor,
    state: LstmState,
    scratch: Scratch,
    /// What the predictor says, `[worlds, 2, predicted]`: mean delta and raw log-std.
    out: Vec<f32>,
    past: Past,
}

impl Imputer {
    /// Counts what is not received as zero.
    pub fn zero(layout: JointLayout, worlds: usize) -> Imputer {
        Imputer { layout, rule: Rule::Zero, carried: vec![0.0; worlds * layout.predicted()] }
    }

    /// Holds what was received last.
    pub fn hold(layout: JointLayout, worlds: usize) -> Imputer {
        Imputer { rule: Rule::Hold, ..Imputer::zero(layout, worlds) }
    }

    /// Moves what was received last on with the velocity that was received with it.
    pub fn velocity(spec: &Spec, worlds: usize) -> Imputer {
        let layout = JointLayout::of(spec);
        let motions = (0..layout.agents).flat_map(|agent| {
            let front = agent * layout.unique;
            spec.agents[agent].observation.iter().enumerate().filter_map(move |(dim, value)| {
                let (velocity, sign) = value.rate?;
                let factor = sign * spec.dt as f32;
                Some(Motion { place: front + dim, velocity: front + velocity, factor })
            })
        });
        Imputer { rule: Rule::Velocity(motions.collect()), ..Imputer::zero(layout, worlds) }
    }

    /// Imagines it with a predictor.
    pub fn predict_with(
        predictor: Predictor,
        layout: JointLayout,
        worlds: usize,
        longest_delay: u8,
    ) -> Imputer {
        let state = predictor.state(worlds);
        let out = vec![0.0; worlds * 2 * layout.predicted()];
        let prediction = Box::new(Prediction {
            predictor,
            state,
            scratch: Scratch::default(),
            out,
            past: Past::new(layout, worlds, longest_delay),
        });
        Imputer { rule: Rule::Predict(prediction), ..Imputer::zero(layout, worlds) }
    }

    /// Gives its predictor, if it has one, new values.
    pub fn renew(&mut self, values: &[f32]) {
        if let Rule::Predict(prediction) = &mut self.rule {
            prediction.predictor.renew(values);
        }
    }

    /// Forgets everything: an episode starts in this many worlds.
    pub fn begin_episode(&mut self, worlds: usize) {
        self.carried.fill(0.0);
        if let Rule::Predict(prediction) = &mut self.rule {
            prediction.state.start(&prediction.predictor, worlds);
            prediction.past.begin_episode();
        }
    }

    /// Writes the joint estimate of `agent` in one world: its own observation and the delivered ones as
    /// they are, the carried estimate for the others. What was made earlier and arrives only now is carried here.
    pub fn fuse(&mut self, world: usize, agent: usize, own: &[f32], inbox: &Inbox, estimate: &mut [f32]) {
        let (unique, predicted) = (self.layout.unique, self.layout.predicted());
        let carried = &self.carried[world * predicted..(world + 1) * predicted];
        let known = |sender| {
            let received = match sender == agent {
                true => Some(own),
                false => inbox.from(sender).map(|received| received.observation),
            };
            received.unwrap_or(&carried[sender * unique..])
        };
        self.layout.join(known, own, estimate);
        for sender in (0..self.layout.agents).filter(|sender| *sender != agent) {
            let age = inbox.age(sender);
            if age == 0 || age == NOT_ARRIVED {
                continue;
            }
            let (carried, part) =
                (&carried[sender * unique..][..unique], sender * unique..(sender + 1) * unique);
            match &mut self.rule {
                Rule::Zero => estimate[part].fill(0.0),
                Rule::Hold => {}
                Rule::Velocity(motions) => (0..age).for_each(|_| {
                    motions.iter().filter(|motion| part.contains(&motion.place)).for_each(|motion| {
                        estimate[motion.place] += motion.factor * estimate[motion.velocity];
                    });
                }),
                Rule::Predict(prediction) => {
                    prediction.past.correct(world, sender, age, carried, &mut estimate[part]);
                }
            }
        }
    }

    /// Carries the joint estimates `[worlds, joint]` over to the next step.
    pub fn predict(&mut self, worlds: usize, estimates: &[f32]) {
        let (joint, predicted) = (self.layout.joint(), self.layout.predicted());
        let carried = self.carried.chunks_exact_mut(predicted).zip(estimates.chunks_exact(joint));
        match &mut self.rule {
            Rule::Zero => {}
            Rule::Hold => {
                carried.for_each(|(carried, estimate)| carried.copy_from_slice(&estimate[..predicted]))
            }
            Rule::Velocity(motions) => {
                for (carried, estimate) in carried {
                    carried.copy_from_slice(&estimate[..predicted]);
                    for Motion { place, velocity, factor } in &*motions {
                        carried[*place] += factor * estimate[*velocity];
                    }
                }
            }
            Rule::Predict(prediction) => {
                prediction.past.keep(estimates);
                let deltas = prediction.step(worlds, estimates, predicted);
                for ((carried, estimate), delta) in carried.zip(deltas) {
                    for ((carried, value), delta) in carried.iter_mut().zip(estimate).zip(delta) {
                        *carried = value + delta;
                    }
                }
            }
        }
    }
}

impl Prediction {
    /// The mean delta of each world.
    fn step(&mut self, worlds: usize, estimates: &[f32], predicted: usize) -> impl Iterator<Item = &[f32]> {
        let out = &mut self.out[..worlds * 2 * predicted];
        self.predictor.step(worlds, estimates, &mut self.state, &mut self.scratch, out);
        out.chunks_exact(2 * predicted).map(move |row| &row[..predicted])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Task;

    /// What a listener's observation is taken for one step after it was received.
    #[test]
    fn places_move_on_with_the_velocity_and_the_rest_stays() {
        let task = Task::parse("speaker-listener").unwrap();
        let mut imputer = Imputer::velocity(task.spec(), 1);
        imputer.begin_episode(1);
        let speaker = [0.15, 0.65, 0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let listener = [1.0, -2.0, 0.5, 0.5, 0.0, 0.0, -0.5, 0.5, 0.0, 1.0, 0.0];
        imputer.predict(1, &[speaker, listener].concat());
        let mut estimate = [0.0; 22];
        imputer.fuse(0, 0, &speaker, &Inbox::of(2, |_| None), &mut estimate);
        // Landmarks are seen from the listener: they come nearer as it moves towards them.
        let moved = [1.0, -2.0, 0.4, 0.7, -0.1, 0.2, -0.6, 0.7, 0.0, 1.0, 0.0];
        let close = |(a, b): (&f32, &f32)| (a - b).abs() < 1e-6;
        assert!(estimate[11..].iter().zip(&moved).all(close), "{estimate:?}");
    }
}
