//! How bodies move: a law of motion fitted to play, and what it predicts for the next step.
//!
//! All that is given by hand is what a [`Spec`] says of each observed value: its unit, its axis, whom it is about, and
//! which value is its rate of change.

mod bodies;
mod fit;
mod least;

pub(crate) use bodies::Bodies;
pub(crate) use fit::{Fitted, fit};

use serde::{Deserialize, Serialize};

use crate::environment::{Axis, Spec};

/// The law by which all bodies of an environment move. With `v` a velocity along an axis, `x` a place whose rate of change
/// is `v`, and `a` the action of the agent that they tell of, a step does
///
/// ```text
/// v' = keep v + pushes[agent][a][axis] + contacts
/// x' = x + before v + after v'
/// ```
///
/// Contacts push two agents apart along the line between them, by `stiffness (distance - d)` if they are nearer than
/// `distance`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dynamics {
    /// The share of its velocity that a body keeps in a step.
    pub keep: f64,
    /// What an action adds to an agent's velocity along x and y, m/s: `[agent][action]`.
    pub pushes: Vec<Vec<[f64; 2]>>,
    /// How long a step moves places by the velocity before it, s.
    pub before: f64,
    /// How long a step moves places by the velocity after it, s.
    pub after: f64,
    /// How agents push each other, if that was seen.
    pub contact: Option<Contact>,
}

/// How agents push each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// What a metre of overlap adds to the velocity of each in a step, 1/s.
    pub stiffness: f64,
    /// Between whose centres there is less than this touch, m.
    pub distance: f64,
}

impl Dynamics {
    /// Whether these are the dynamics of such an environment, as far as sizes tell.
    pub(crate) fn fits(&self, spec: &Spec) -> bool {
        let sizes = self.pushes.iter().zip(&spec.agents);
        self.pushes.len() == spec.n_agents()
            && sizes.enumerate().all(|(agent, (pushes, _))| pushes.len() == spec.available_actions(agent))
            && [self.keep, self.before, self.after].iter().all(|value| value.is_finite())
    }

    /// What an action adds to the velocity of `agent`, m/s along x and y; nothing if it has no such action.
    pub(crate) fn push(&self, agent: usize, action: usize) -> [f64; 2] {
        self.pushes[agent].get(action).copied().unwrap_or_default()
    }

    /// What the others add to the velocity of `agent` in a step that begins as `joint` says, m/s along x and y.
    pub(crate) fn contact_push(&self, bodies: &Bodies, agent: usize, joint: &[f32]) -> [f64; 2] {
        self.contact.map_or([0.0; 2], |contact| contact.push(bodies, agent, joint))
    }

    /// What a push of `agent` in a step does to the dims that tell of it.
    pub(crate) fn effects(&self, bodies: &Bodies, agent: usize) -> impl Iterator<Item = Effect> {
        let of_velocities = bodies.velocities(agent).map(|(dim, axis)| (dim, axis, 1.0));
        let places = bodies.places(agent).iter();
        let of_places = places.map(|place| (place.dim, place.axis, f64::from(place.sign) * self.after));
        of_velocities.chain(of_places).map(move |(dim, axis, gain)| Effect { dim, agent, axis, gain })
    }

    /// The law as it was fitted.
    pub(crate) fn law(&self) -> Law {
        Law { keep: self.keep, gain: 1.0 }
    }

    /// Moves what a joint observation `before` says of `agent` on by a step in which it is pushed like this: writes those
    /// dims of `after`, both `[predicted]` or longer, and no other.
    pub(crate) fn advance(
        &self,
        bodies: &Bodies,
        agent: usize,
        push: [f64; 2],
        before: &[f32],
        after: &mut [f32],
    ) {
        let contact = self.contact_push(bodies, agent, before);
        self.advance_by(self.law(), bodies, agent, [push, contact], before, after);
    }

    /// The same by another law, if it is pushed like this by itself and by others.
    pub(crate) fn advance_by(
        &self,
        law: Law,
        bodies: &Bodies,
        agent: usize,
        [push, contact]: [[f64; 2]; 2],
        before: &[f32],
        after: &mut [f32],
    ) {
        for (dim, axis) in bodies.velocities(agent) {
            let axis = axis as usize;
            let pushed = law.keep * f64::from(before[dim]) + law.gain * push[axis];
            after[dim] = (pushed + law.gain * contact[axis]) as f32;
        }
        for place in bodies.places(agent) {
            let (old, new) = (f64::from(before[place.rate]), f64::from(after[place.rate]));
            let moved = f64::from(place.sign) * (self.before * old + self.after * new);
            after[place.dim] = (f64::from(before[place.dim]) + moved) as f32;
        }
    }

    /// Moves the derivatives of what tells of `agent`, in a parameter of the law, on by a step: `slopes` `[predicted]`.
    /// `forced` is what the parameter itself does to a velocity, by its dim and axis.
    pub(crate) fn advance_slopes(
        &self,
        law: Law,
        bodies: &Bodies,
        agent: usize,
        forced: impl Fn(usize, usize) -> f64,
        slopes: &mut [f32],
    ) {
        let carry = |slopes: &mut [f32], seconds: f64| {
            for place in bodies.places(agent) {
                slopes[place.dim] += (f64::from(place.sign) * seconds * f64::from(slopes[place.rate])) as f32;
            }
        };
        carry(slopes, self.before);
        for (dim, axis) in bodies.velocities(agent) {
            slopes[dim] = (law.keep * f64::from(slopes[dim]) + forced(dim, axis as usize)) as f32;
        }
        carry(slopes, self.after);
    }
}

/// The part of dynamics that damping and mass decide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Law {
    /// The share of its velocity that a body keeps in a step.
    pub keep: f64,
    /// How many times as much a push does to a velocity as when the dynamics were fitted, whoever pushes.
    pub gain: f64,
}

/// What a push of an agent does to a dim of the joint observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Effect {
    /// The dim.
    pub dim: usize,
    /// Whose push it is.
    pub agent: usize,
    axis: Axis,
    gain: f64,
}

impl Effect {
    /// What is added to the dim by a push, m/s along x and y.
    pub fn of(self, push: [f64; 2]) -> f64 {
        self.gain * push[self.axis as usize]
    }
}

impl Contact {
    /// What the others add to the velocity of `agent` in a step that begins as `joint` says, m/s along x and y.
    fn push(&self, bodies: &Bodies, agent: usize, joint: &[f32]) -> [f64; 2] {
        let Some(own) = bodies.spot(agent, joint) else { return [0.0; 2] };
        let mut push = [0.0; 2];
        let others = (0..bodies.n_agents()).filter(|other| *other != agent);
        for other in others.filter_map(|other| bodies.spot(other, joint)) {
            let (apart, distance) = (own - other, own.distance(other));
            let depth = self.distance - distance;
            // Of agents in one place nobody can say which way they are pushed.
            if depth > 0.0 && distance > 0.0 {
                let force = apart * (self.stiffness * depth / distance);
                push = [push[0] + force.x, push[1] + force.y];
            }
        }
        push
    }
}
