//! Beliefs about where everybody is: moved on by dynamics, put right by what is observed.

use super::hold::Hold;
use super::law::{Learner, MOST_SEEN};
use super::past::Past;
use super::slopes::Slopes;
use super::{Imputer, JointLayout, Setup, Step};
use crate::agent::{Inbox, Received};
use crate::base::error::{Error, Result};
use crate::dynamics::{Bodies, Dynamics, Effect, Law};
use crate::environment::Axis;
use crate::usage;

/// What an agent believes of those whom the dynamics move, and of landmarks, which stay where they are. It may have several
/// beliefs side by side about each world; its estimate is their weighted mean.
#[derive(Debug)]
pub(super) struct Motion {
    dynamics: Dynamics,
    bodies: Bodies,
    layout: JointLayout,
    agent: usize,
    /// Who is moved.
    moved: Vec<usize>,
    /// Every dim that is not left to others, and what of it is only known when a step is over.
    dims: Vec<(usize, Option<Effect>)>,
    /// About each world.
    n_beliefs: usize,
    /// `[worlds, n_beliefs, joint]`.
    beliefs: Vec<f32>,
    /// The joint estimates that were made of them, `[worlds, joint]`.
    written: Vec<f32>,
    /// What follows from them, `[worlds, n_beliefs, predicted]`. Dims that are not moved mean nothing.
    expected: Vec<f32>,
    past: Past,
    /// By which law, unless it stays the one of the dynamics, and what is to be put right if another is found.
    learning: Option<(Learner, Slopes)>,
    /// Velocities that the agent observes itself, and learns the law from: of whom, which dim, and along which axis.
    seen: Vec<(usize, usize, Axis)>,
    /// The last step that was made in this episode, after which something is expected.
    last: Option<u32>,
}

impl Motion {
    /// By dynamics that move these agents.
    ///
    /// # Errors
    /// `Usage` if nobody's velocity is observed.
    pub(super) fn new(
        setup: &Setup,
        dynamics: Dynamics,
        moved: Vec<usize>,
        n_beliefs: usize,
    ) -> Result<Motion> {
        let (layout, bodies) = (JointLayout::of(setup.spec), Bodies::of(setup.spec)?);
        let of_agent = |agent: &usize| {
            let own = *agent == setup.agent;
            let effects = dynamics.effects(&bodies, *agent);
            effects.map(move |effect| (effect.dim, Some(effect).filter(|_| !own))).collect::<Vec<_>>()
        };
        let dims = moved.iter().flat_map(of_agent);
        let dims = dims.chain(bodies.constants().iter().map(|dim| (*dim, None)));
        let is_observed_by_itself = |dim: usize| dim / layout.unique == setup.agent;
        let rows = setup.worlds * n_beliefs;
        let everybody = 0..setup.spec.n_agents();
        let seen =
            everybody.flat_map(|agent| bodies.velocities(agent).map(move |(dim, axis)| (agent, dim, axis)));
        let mut seen: Vec<_> = seen.filter(|(_, dim, _)| is_observed_by_itself(*dim)).collect();
        // Its own before those of others.
        seen.sort_by_key(|(agent, ..)| *agent != setup.agent);
        seen.truncate(MOST_SEEN);
        seen.sort_by_key(|(agent, ..)| *agent);
        Ok(Motion {
            dims: dims.filter(|(dim, _)| !is_observed_by_itself(*dim)).collect(),
            dynamics,
            bodies,
            layout,
            agent: setup.agent,
            moved,
            n_beliefs,
            beliefs: vec![0.0; rows * layout.joint()],
            written: vec![0.0; setup.worlds * layout.joint()],
            expected: vec![0.0; rows * layout.predicted()],
            past: Past::new(layout, setup.worlds, setup.longest_delay),
            learning: None,
            seen,
            last: None,
        })
    }

    /// By dynamics that are known in this way. Fitted ones give way to what the agent sees of motion.
    ///
    /// # Errors
    /// `Usage` if they are not known, or nobody's velocity is observed.
    pub(super) fn of(setup: &Setup, known: Known, moved: Vec<usize>, n_beliefs: usize) -> Result<Motion> {
        let motion = Motion::new(setup, known.dynamics(setup)?, moved, n_beliefs)?;
        Ok(match known {
            Known::Fitted => motion.learning(),
            Known::Given => motion,
        })
    }

    /// The imputer that is left what this does not move: `others`, or the least there is if that is nothing. Of what arrives
    /// late this may know too little to put it right, so then `others` stay.
    pub(super) fn rest(&self, setup: &Setup, others: Box<dyn Imputer>) -> Box<dyn Imputer> {
        let lost = self.layout.predicted() - self.layout.unique;
        if self.dims.len() == lost && setup.longest_delay == 0 { Box::new(Hold::new(setup)) } else { others }
    }

    /// The same, with a law that follows what the agent sees of motion.
    fn learning(mut self) -> Motion {
        let rows = self.beliefs.len() / self.layout.joint();
        let pushes = self.seen.iter().map(|&(agent, _, axis)| {
            let mut pushes: Vec<f64> =
                self.dynamics.pushes[agent].iter().map(|push| push[axis as usize]).collect();
            pushes.sort_by(f64::total_cmp);
            pushes.dedup();
            pushes
        });
        let learner = Learner::new(self.dynamics.law(), pushes.collect(), rows / self.n_beliefs);
        self.learning = Some((learner, Slopes::new(rows, self.layout.predicted())));
        self
    }

    /// Nothing is believed: an episode starts.
    pub(super) fn begin_episodes(&mut self) {
        self.last = None;
        self.past.begin_episode();
        if let Some((learner, slopes)) = &mut self.learning {
            learner.begin_episodes();
            slopes.begin_episodes();
        }
    }

    /// Takes in what was acted on. What arrives late is held against it, and where somebody knew better than what was
    /// [written](Motion::correct), that is believed. The velocities that the agent sees say by which law bodies move.
    pub(super) fn keep(&mut self, step: &Step) {
        let estimates = step.estimates;
        self.past.keep(estimates);
        let (joint, n_beliefs) = (self.layout.joint(), self.n_beliefs);
        let beliefs = self.beliefs.chunks_exact_mut(n_beliefs * joint);
        let worlds = estimates.chunks_exact(joint).zip(self.written.chunks_exact(joint)).zip(beliefs);
        for ((estimate, written), beliefs) in worlds.filter(|((estimate, written), _)| estimate != written) {
            for dim in (0..joint).filter(|&dim| estimate[dim] != written[dim]) {
                beliefs.chunks_exact_mut(joint).for_each(|belief| belief[dim] = estimate[dim]);
            }
        }
        // Against the clock steps may have been missed: of those that passed since, nobody knows what made them.
        if self.last == step.step.checked_sub(1) {
            (0..step.actions.len()).for_each(|world| self.learn(world));
        }
        self.last = Some(step.step);
    }

    /// What is believed of so many worlds, `[worlds, n_beliefs, joint]`.
    pub(super) fn beliefs(&self, worlds: usize) -> &[f32] {
        &self.beliefs[..worlds * self.n_beliefs * self.layout.joint()]
    }

    /// Moves everybody on by a step in which the agent itself does this in each world, and the others nothing. What those
    /// did counts when the outcome is [put right](Motion::correct).
    pub(super) fn advance(&mut self, actions: &[u32]) {
        if let Some((_, slopes)) = &mut self.learning {
            slopes.remember();
        }
        self.move_on(actions);
    }

    /// Takes the last [`advance`](Motion::advance) back and does it again with what was carried out.
    pub(super) fn revise(&mut self, actions: &[u32]) {
        if let Some((_, slopes)) = &mut self.learning {
            slopes.take_back();
        }
        self.move_on(actions);
    }

    fn move_on(&mut self, actions: &[u32]) {
        self.foresee(actions);
        let Motion { dynamics, bodies, layout, agent, moved, n_beliefs, beliefs, expected, learning, .. } =
            self;
        let rows = beliefs.chunks_exact(layout.joint()).zip(expected.chunks_exact_mut(layout.predicted()));
        for (row, (belief, expected)) in rows.take(actions.len() * *n_beliefs).enumerate() {
            let world = row / *n_beliefs;
            let law = learning.as_ref().map_or(dynamics.law(), |(learner, _)| learner.law(world));
            for &other in moved.iter() {
                let own = other == *agent;
                let push = if own { dynamics.push(other, actions[world] as usize) } else { [0.0; 2] };
                let contact = dynamics.contact_push(bodies, other, belief);
                dynamics.advance_by(law, bodies, other, [push, contact], belief, expected);
                if let Some((_, slopes)) = learning {
                    let [of_velocity, of_push] = slopes.of(row);
                    let pushed = |_, axis: usize| push[axis] + contact[axis];
                    dynamics.advance_slopes(law, bodies, other, |dim, _| belief[dim].into(), of_velocity);
                    dynamics.advance_slopes(law, bodies, other, pushed, of_push);
                }
            }
            bodies.constants().iter().for_each(|&dim| expected[dim] = belief[dim]);
        }
    }

    /// Notes what the velocities that the agent sees will follow from.
    fn foresee(&mut self, actions: &[u32]) {
        let Motion { dynamics, bodies, layout, agent, n_beliefs, beliefs, learning, seen, .. } = self;
        let Some((learner, _)) = learning else { return };
        let firsts = beliefs.chunks_exact(layout.joint()).step_by(*n_beliefs);
        for (world, (belief, action)) in firsts.zip(actions).enumerate() {
            let push = dynamics.push(*agent, *action as usize);
            let is_free = dynamics.contact_push(bodies, *agent, belief) == [0.0; 2];
            for (at, &(other, dim, axis)) in seen.iter().enumerate() {
                let own = other == *agent;
                let row = (f64::from(belief[dim]), Some(push[axis as usize]).filter(|_| own));
                learner.expect(world, at, Some(row).filter(|_| is_free || !own));
            }
        }
    }

    /// How much faster an agent is seen to move than a belief, by its row, expects of one that did nothing: along each axis
    /// along which it is seen, m/s.
    pub(super) fn seen_push(
        &self,
        row: usize,
        agent: usize,
        inbox: &Inbox,
        estimate: &[f32],
    ) -> [Option<f64>; 2] {
        let mut seen = [None; 2];
        if self.last.is_some() {
            let expected = &self.expected[row * self.layout.predicted()..];
            let is_seen = |sender: usize| sender == self.agent || inbox.age(sender) == 0;
            for (dim, axis) in self.bodies.velocities(agent) {
                if is_seen(dim / self.layout.unique) {
                    let faster = f64::from(estimate[dim]) - f64::from(expected[dim]);
                    seen[axis as usize] = Some(faster / self.law(row / self.n_beliefs).gain);
                }
            }
        }
        seen
    }

    /// Believes in the place of the row `to` what it believes by the row `from`.
    pub(super) fn copy(&mut self, from: usize, to: usize) {
        let joint = self.layout.joint();
        self.beliefs.copy_within(from * joint..(from + 1) * joint, to * joint);
        if let Some((_, slopes)) = &mut self.learning {
            slopes.copy(from, to);
        }
    }

    /// Writes what is believed of those who are moved and of landmarks into the estimate of a world, where nothing better
    /// is known. What was observed at this step is true. What arrives late says how wrong the estimate of that step was.
    /// `pushes` says by row and agent what the others did in the step that is over, m/s; `shares` how much each belief
    /// about this world counts.
    pub(super) fn correct(
        &mut self,
        world: usize,
        inbox: &Inbox,
        estimate: &mut [f32],
        shares: &[f64],
        pushes: impl Fn(usize, usize) -> [f64; 2],
    ) {
        let Motion { layout, dims, n_beliefs, beliefs, expected, past, learning, .. } = self;
        let (unique, joint, predicted) = (layout.unique, layout.joint(), layout.predicted());
        let rows = world * *n_beliefs..(world + 1) * *n_beliefs;
        let beliefs = &mut beliefs[rows.start * joint..rows.end * joint];
        beliefs.chunks_exact_mut(joint).for_each(|belief| belief.copy_from_slice(estimate));
        let gain = learning.as_ref().map_or(1.0, |(learner, _)| learner.law(world).gain);
        for (dim, effect) in dims.iter().filter(|_| self.last.is_some()) {
            let received = inbox.from(dim / unique);
            if let (Some(_), Some((_, slopes))) = (received, &mut *learning) {
                rows.clone().for_each(|row| slopes.forget(row, *dim));
            }
            let wrong = match received {
                None => Some(0.0),
                Some(Received { age: 0, .. }) => None,
                Some(Received { age, observation }) => {
                    past.put_right(world, *dim, age, observation[dim % unique])
                }
            };
            let Some(wrong) = wrong else { continue };
            let mut sum = 0.0;
            for ((belief, row), share) in beliefs.chunks_exact_mut(joint).zip(rows.clone()).zip(shares) {
                let pushed = effect.map_or(0.0, |effect| effect.of(pushes(row, effect.agent)));
                if let Some((_, slopes)) = learning {
                    slopes.push(row, *dim, pushed);
                }
                let expected = f64::from(expected[row * predicted + dim]);
                belief[*dim] = (expected + gain * pushed) as f32 + wrong;
                sum += share * f64::from(belief[*dim]);
            }
            estimate[*dim] = sum as f32;
        }
        self.written[world * joint..][..joint].copy_from_slice(estimate);
    }

    /// Learns from the velocities that the agent sees in a world. Should they follow another law than before, what is believed
    /// is put right; what was estimated so far is no measure for late news any more.
    fn learn(&mut self, world: usize) {
        let Motion { layout, dims, n_beliefs, beliefs, past, learning, seen, .. } = self;
        let Some((learner, slopes)) = learning else { return };
        let before = learner.law(world);
        let rows = world * *n_beliefs..(world + 1) * *n_beliefs;
        let velocity = |(_, dim, _): &(usize, usize, Axis)| beliefs[rows.start * layout.joint() + dim].into();
        learner.observe(world, seen.iter().map(velocity));
        let law = learner.law(world);
        if law != before {
            past.forget(world);
            for row in rows {
                for (dim, _) in dims.iter() {
                    beliefs[row * layout.joint() + dim] += slopes.change(row, *dim, before, law);
                }
            }
        }
    }

    /// The law in a world.
    fn law(&self, world: usize) -> Law {
        self.learning.as_ref().map_or(self.dynamics.law(), |(learner, _)| learner.law(world))
    }
}

/// How an imputer knows the dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Known {
    /// They are in the policy file, and it sees for itself whether another law holds.
    Fitted,
    /// It is told those of the physics that is played: a ceiling.
    Given,
}

impl Known {
    /// The dynamics it knows.
    ///
    /// # Errors
    /// `Usage` if the policy has none, or not of this environment.
    pub(super) fn dynamics(self, setup: &Setup) -> Result<Dynamics> {
        let (dynamics, none) = match self {
            Known::Fitted => (setup.policy.dynamics(), no_dynamics as fn(&str) -> Error),
            Known::Given => (setup.policy.given(), not_given as fn(&str) -> Error),
        };
        let dynamics = dynamics.filter(|dynamics| dynamics.fits(setup.spec));
        dynamics.cloned().ok_or_else(|| none(&setup.spec.id))
    }
}

/// What an imputer that is told the physics is told where nobody can tell it.
pub(super) fn not_given(task: &str) -> Error {
    usage!(
        "nobody knows the physics of {task} here; `spawn` and `evaluate` tell imputers that of tasks of this program"
    )
}

/// What an imputer that moves things is told of a policy without dynamics.
pub(super) fn no_dynamics(task: &str) -> Error {
    usage!(
        "this policy holds no dynamics of {task}; `vamaro-swarm fit POLICY --out FILE` fits them and writes a policy \
         file that does"
    )
}
