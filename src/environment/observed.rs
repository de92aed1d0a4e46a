//! What the values of an observation are.

use serde::{Deserialize, Serialize};

use super::task::Family;
use super::{Task, hear_see, speaker_listener, spread};

/// What one value of an agent's own part of an observation is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// What it is measured in.
    pub unit: Unit,
    /// The dim of the same observation that holds its rate of change, and the sign with which it does: the
    /// place of something seen from an agent falls as the agent moves towards it.
    pub rate: Option<(usize, f32)>,
}

/// What a value is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Unit {
    /// Places, m.
    #[serde(rename = "m")]
    Metre,
    /// Velocities, m/s.
    #[serde(rename = "m/s")]
    MetrePerSecond,
    /// Colours and words.
    #[serde(rename = "1")]
    One,
}

impl Unit {
    /// All of them.
    pub const ALL: [Unit; 3] = [Unit::Metre, Unit::MetrePerSecond, Unit::One];

    /// Its symbol.
    pub fn symbol(self) -> &'static str {
        match self {
            Unit::Metre => "m",
            Unit::MetrePerSecond => "m/s",
            Unit::One => "1",
        }
    }
}

impl Observed {
    pub(super) const WORD: Observed = Observed { unit: Unit::One, rate: None };
    pub(super) const VELOCITY: Observed = Observed { unit: Unit::MetrePerSecond, rate: None };
    /// A place that does not move.
    pub(super) const FIXED: Observed = Observed { unit: Unit::Metre, rate: None };

    /// A place whose rate of change is dim `velocity`, times `sign`.
    pub(super) const fn moving(velocity: usize, sign: f32) -> Observed {
        Observed { unit: Unit::Metre, rate: Some((velocity, sign)) }
    }
}

impl Task {
    /// What the values in front of `agent`'s observation are that differ between agents; fewer than
    /// [`Task::unique_dim`] where the rest is padding.
    pub fn observed(&self, agent: usize) -> &'static [Observed] {
        match self.family {
            Family::HearSee => hear_see::OBSERVED[agent],
            Family::SpeakerListener => speaker_listener::OBSERVED[agent],
            Family::SpreadXy => &spread::OBSERVED_XY,
            Family::SpreadBlindfold => &spread::OBSERVED_BLINDFOLD,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::World;
    use super::*;

    /// One step of 0.1 s.
    const DT: f32 = 0.1;

    #[test]
    fn what_is_said_of_every_value_is_what_the_world_does() {
        for task in Task::all() {
            let n = task.n_agents();
            let mut world = World::new(&task);
            world.reset(3, 1);
            let mut before = vec![0.0; task.padded_obs_dim()];
            let mut after = before.clone();
            for step in 0..10 {
                let actions: Vec<u8> =
                    (0..n).map(|agent| ((step + agent) % task.available_actions(agent)) as u8).collect();
                let seen = world.clone();
                world.step(&actions);
                for agent in 0..n {
                    seen.observe(agent, &mut before);
                    world.observe(agent, &mut after);
                    let observed = task.observed(agent);
                    assert!(observed.len() <= task.unique_dim());
                    assert!(after[observed.len()..task.unique_dim()].iter().all(|padding| *padding == 0.0));
                    for (dim, what) in observed.iter().enumerate() {
                        // Velocities change first, so a place moves with that of the step's end.
                        let expected = match what.rate {
                            Some((velocity, sign)) => DT * sign * after[velocity],
                            None if what.unit == Unit::Metre => 0.0,
                            None => continue,
                        };
                        let moved = after[dim] - before[dim];
                        assert!((moved - expected).abs() < 1e-5, "{} agent {agent} dim {dim}", task.id());
                    }
                }
            }
        }
    }
}
