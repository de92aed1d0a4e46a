//! Which dims of a joint observation tell where an agent is and how fast it moves.

use glam::DVec2;

use crate::base::error::Result;
use crate::environment::{About, Axis, Spec, Unit, Value};
use crate::usage;

/// The dims of a joint observation that tell of agents' motion, agent by agent. One agent may stand in several
/// observations, also in those of others alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Bodies {
    agents: Vec<Body>,
    /// Dims that tell of landmarks, which stay as they are for an episode.
    constants: Vec<usize>,
}

#[derive(Clone, Debug, Default, PartialEq)]
struct Body {
    velocities: Vec<(usize, Axis)>,
    places: Vec<Place>,
    /// Dims that are its place along x and y.
    spot: [Option<usize>; 2],
}

/// A dim that is a place which changes at a rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub dim: usize,
    pub axis: Axis,
    /// The dim of its rate of change, a velocity of the same agent.
    pub rate: usize,
    pub sign: f32,
}

impl Bodies {
    /// What an environment says of itself.
    ///
    /// # Errors
    /// `Usage` if no dim is the velocity of an agent along an axis.
    pub fn of(spec: &Spec) -> Result<Bodies> {
        let (mut bodies, mut constants) = (vec![Body::default(); spec.n_agents()], Vec::new());
        for (observer, agent) in spec.agents.iter().enumerate() {
            let first = observer * spec.unique_dim();
            for (dim, value) in agent.observation.iter().enumerate() {
                if value.about == About::Landmark {
                    constants.push(first + dim);
                }
                let (About::Agent(about), Some(axis)) = (value.about, value.axis) else { continue };
                let Some(body) = bodies.get_mut(about) else { continue };
                match (value.unit, value.rate) {
                    (Unit::MetrePerSecond, _) => body.velocities.push((first + dim, axis)),
                    (Unit::Metre, Some((rate, sign)))
                        if agent.observation.get(rate) == Some(&Value::velocity(value.about, axis)) =>
                    {
                        body.places.push(Place { dim: first + dim, axis, rate: first + rate, sign });
                        if sign == 1.0 {
                            body.spot[axis as usize].get_or_insert(first + dim);
                        }
                    }
                    _ => {}
                }
            }
        }
        if bodies.iter().all(|body| body.velocities.is_empty()) {
            return Err(usage!(
                "{} says of no observed value that it is an agent's velocity along an axis, so no dynamics can be \
                 fitted; label them in its `Spec` (`Value::velocity`, `Value::moving`)",
                spec.id
            ));
        }
        Ok(Bodies { agents: bodies, constants })
    }

    /// Size of the team.
    pub fn n_agents(&self) -> usize {
        self.agents.len()
    }

    /// The dims that stay as they are for an episode.
    pub fn constants(&self) -> &[usize] {
        &self.constants
    }

    /// The dims that are velocities of an agent, and along which axis.
    pub fn velocities(&self, agent: usize) -> impl Iterator<Item = (usize, Axis)> {
        self.agents[agent].velocities.iter().copied()
    }

    pub(super) fn places(&self, agent: usize) -> &[Place] {
        &self.agents[agent].places
    }

    /// Where an agent is, m, if both coordinates stand in the joint observation.
    pub(super) fn spot(&self, agent: usize, joint: &[f32]) -> Option<DVec2> {
        let [x, y] = self.agents[agent].spot;
        Some(DVec2::new(joint[x?].into(), joint[y?].into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::{ActionSpace, AgentSpec};

    #[test]
    fn a_rate_of_change_that_is_not_there_moves_nothing() {
        let bodies = |rate| {
            let about = About::Agent(0);
            let observation = vec![Value::moving(about, Axis::X, rate, 1.0), Value::velocity(about, Axis::X)];
            let agent = AgentSpec { name: "left".into(), observation, actions: ActionSpace::Discrete(1) };
            Bodies::of(&Spec::of("drift", vec![agent])).unwrap()
        };
        assert_eq!(bodies(1).places(0).len(), 1);
        assert!(bodies(7).places(0).is_empty());
    }
}
