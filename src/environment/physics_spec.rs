//! Physics as text: `motor_noise=0.3,damping=0.3`.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Result};
use crate::base::nearest::did_you_mean;
use crate::usage;

/// The physics of point-mass tasks: the data from which [`Physics`](super::Physics) is made. The default is that of the
/// reference environments. Written down it is text, such as `motor_noise=0.3,damping=0.25,mass=1`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct PhysicsSpec {
    /// How unsteady motors are: in every step each axis of an agent's force gets a normal error of its own, with this
    /// standard deviation in units of a full push (5 N).
    pub motor_noise: f64,
    /// Share of its velocity that a body loses in a step.
    pub damping: f64,
    /// Mass of every agent, kg. All forces are divided by it.
    pub mass: f64,
    /// How strong the wind is, which pushes all agents alike: standard deviation of its force along each axis, in units of
    /// a full push (5 N).
    pub wind: f64,
}

/// One of its parameters.
struct Parameter {
    name: &'static str,
    range: RangeInclusive<f64>,
    of: fn(&mut PhysicsSpec) -> &mut f64,
}

const PARAMETERS: [Parameter; 4] = [
    Parameter { name: "motor_noise", range: 0.0..=10.0, of: |physics| &mut physics.motor_noise },
    Parameter { name: "damping", range: 0.0..=1.0, of: |physics| &mut physics.damping },
    Parameter { name: "mass", range: 0.01..=100.0, of: |physics| &mut physics.mass },
    Parameter { name: "wind", range: 0.0..=10.0, of: |physics| &mut physics.wind },
];

impl Default for PhysicsSpec {
    fn default() -> PhysicsSpec {
        PhysicsSpec { motor_noise: 0.0, damping: 0.25, mass: 1.0, wind: 0.0 }
    }
}

impl PhysicsSpec {
    /// Whether it is that of the reference environments.
    pub fn is_default(&self) -> bool {
        *self == PhysicsSpec::default()
    }

    /// The same for a sentence that goes on: ` with physics ..`, or nothing for the default.
    pub fn if_other(&self) -> String {
        if self.is_default() { String::new() } else { format!(" with physics {self}") }
    }
}

/// All parameters, as they are read. Those of old are always there; wind is, if there is any.
impl fmt::Display for PhysicsSpec {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let PhysicsSpec { motor_noise, damping, mass, wind } = self;
        write!(f, "motor_noise={motor_noise},damping={damping},mass={mass}")?;
        if *wind > 0.0 { write!(f, ",wind={wind}") } else { Ok(()) }
    }
}

impl FromStr for PhysicsSpec {
    type Err = Error;

    /// Reads parameters and their values, with commas between them. Those that are left out have their defaults.
    fn from_str(text: &str) -> Result<PhysicsSpec> {
        let mut physics = PhysicsSpec::default();
        let mut given: Vec<&str> = Vec::new();
        for part in text.split(',') {
            let Some((name, value)) = part.split_once('=') else {
                return Err(usage!("`{part}`: expected NAME=VALUE, such as motor_noise=0.3,damping=0.3"));
            };
            let (name, value) = (name.trim(), value.trim());
            let Parameter { range, of, .. } =
                PARAMETERS.iter().find(|known| known.name == name).ok_or_else(|| unknown(name))?;
            if given.contains(&name) {
                return Err(usage!("`{name}` is given twice"));
            }
            given.push(name);
            *of(&mut physics) = match value.parse::<f64>() {
                // Adding zero turns -0 into 0.
                Ok(number) if range.contains(&number) => number + 0.0,
                _ => {
                    return Err(usage!(
                        "`{name}` is {value:?}, expected a number from {} to {}",
                        range.start(),
                        range.end()
                    ));
                }
            };
        }
        Ok(physics)
    }
}

impl TryFrom<String> for PhysicsSpec {
    type Error = Error;

    fn try_from(text: String) -> Result<PhysicsSpec> {
        text.parse()
    }
}

impl From<PhysicsSpec> for String {
    fn from(physics: PhysicsSpec) -> String {
        physics.to_string()
    }
}

fn unknown(name: &str) -> Error {
    let names = PARAMETERS.map(|known| known.name);
    let meant = did_you_mean(name, names);
    usage!("physics has no `{name}`{meant}; there are {}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_comes_back_from_its_text() {
        let physics: PhysicsSpec = "mass=1.2, motor_noise=0.3".parse().unwrap();
        assert_eq!(physics, PhysicsSpec { motor_noise: 0.3, mass: 1.2, ..PhysicsSpec::default() });
        for physics in [physics, PhysicsSpec::default(), "wind=1.5,damping=1e-3".parse().unwrap()] {
            assert_eq!(physics.to_string().parse::<PhysicsSpec>().unwrap(), physics);
            let json = serde_json::to_string(&physics).unwrap();
            assert_eq!(json, format!("\"{physics}\""));
            assert_eq!(serde_json::from_str::<PhysicsSpec>(&json).unwrap(), physics);
        }
        assert_eq!(
            "motor_noise=-0".parse::<PhysicsSpec>().unwrap().to_string(),
            PhysicsSpec::default().to_string()
        );
    }

    #[test]
    fn every_parameter_is_read_from_its_own_name() {
        for (at, name) in ["motor_noise", "damping", "mass", "wind"].iter().enumerate() {
            let physics: PhysicsSpec = format!("{name}=0.5").parse().unwrap();
            let mut expected = [0.0, 0.25, 1.0, 0.0];
            expected[at] = 0.5;
            assert_eq!([physics.motor_noise, physics.damping, physics.mass, physics.wind], expected);
            assert!(!physics.is_default() && physics.if_other().contains(&format!("{name}=0.5")));
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (text, says) in [
            ("", "expected NAME=VALUE"),
            ("damping", "expected NAME=VALUE"),
            ("dampng=0.3", "did you mean `damping`?"),
            ("gravity=1", "physics has no `gravity`; there are motor_noise, damping, mass, wind"),
            ("damping=1.5", "`damping` is \"1.5\", expected a number from 0 to 1"),
            ("mass=0", "expected a number from 0.01 to 100"),
            ("motor_noise=NaN", "expected a number from 0 to 10"),
            ("motor_noise=much", "expected a number from 0 to 10"),
            ("mass=1,mass=2", "`mass` is given twice"),
        ] {
            let error = text.parse::<PhysicsSpec>().unwrap_err();
            assert!(matches!(error, Error::Usage(_)), "{error:?}");
            assert!(error.to_string().contains(says), "{text}: {error}");
        }
    }
}
