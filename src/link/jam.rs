//! A jammer: for a time, or around a place.

use std::ops::Range;

use glam::{DVec2, dvec2};

use super::{Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::usage;

/// `jam(from, until)` or `jam(x, y, radius)`: who is jammed receives nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum Jam {
    /// Everybody, at these steps.
    Time(Range<u64>),
    /// Those who are not further from a place than this, always.
    Place {
        /// The place, m.
        centre: DVec2,
        /// Its surroundings, m.
        radius: f64,
    },
}

const STEP: Domain = Domain::Whole("steps", 0.0, 1e9);
const METRES: Domain = Domain::Number("number of metres", -1e6, 1e6);

/// The line of `jam(from, until)` in the registry.
pub(super) const TIME: Model = Model {
    name: "jam",
    about: "everything sent from step `from` on and before step `until` is lost",
    parameters: &[
        Parameter { name: "from", domain: STEP, default: None },
        Parameter { name: "until", domain: STEP, default: None },
    ],
    build: |arguments| Ok(Box::new(Jam::during(arguments[0].number() as u64, arguments[1].number() as u64)?)),
};

/// The line of `jam(x, y, radius)` in the registry.
pub(super) const PLACE: Model = Model {
    name: "jam",
    about: "agents within this radius of (x, y) receive nothing",
    parameters: &[
        Parameter { name: "x", domain: METRES, default: None },
        Parameter { name: "y", domain: METRES, default: None },
        Parameter { name: "radius", domain: Domain::Number("number of metres", 0.0, 1e6), default: None },
    ],
    build: |arguments| {
        let [x, y, radius] = [0, 1, 2].map(|at| arguments[at].number());
        Ok(Box::new(Jam::Place { centre: dvec2(x, y), radius }))
    },
};

impl Jam {
    /// Jams everybody from this step on until before that one.
    ///
    /// # Errors
    /// `Usage` if there is no step in between.
    pub fn during(from: u64, until: u64) -> Result<Jam> {
        if until <= from {
            return Err(usage!(
                "until must be above from = {from}, not {until}: it is the first step after the jam"
            ));
        }
        Ok(Jam::Time(from..until))
    }
}

impl Link for Jam {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        match self {
            Jam::Time(steps) if steps.contains(&context.address.step) => fates.silence(|_| true),
            Jam::Time(_) => {}
            Jam::Place { centre, radius } => {
                let places = context.places()?;
                for receiver in (0..fates.agents()).filter(|at| places[*at].distance(*centre) <= *radius) {
                    (0..fates.agents()).for_each(|sender| fates.lose(receiver, sender));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, context, links, rows};
    use super::*;

    #[test]
    fn for_a_time_nobody_receives_anything() {
        for step in 1..STEPS {
            let expected = if (5..9).contains(&step) { [0b001, 0b010, 0b100] } else { [0b111; 3] };
            assert_eq!(rows("jam(5, 9)", 1, step, 3), expected, "step {step}");
        }
        let error = Jam::during(9, 9).unwrap_err().to_string();
        assert!(error.contains("until must be above from = 9, not 9"), "{error}");
    }

    #[test]
    fn around_a_place_nobody_receives_but_all_are_heard() {
        let places = [dvec2(0.5, 0.0), dvec2(1.0, 0.0), dvec2(1.5, 0.2)];
        let mut fates = Fates::new(3);
        let context = Context { positions: Some(&places), ..context(0, 1) };
        links("jam(1, 0, 0.5)").deliveries(&context, &mut fates).unwrap();
        let received = |i: usize| (0..3).filter(|j| fates.delay(i, *j).is_some()).count();
        assert_eq!([0, 1, 2].map(received), [1, 1, 3], "the edge is jammed, the last one is 0.54 m away");
        let error =
            links("jam(x=0, y=0, radius=1)").deliveries(&super::super::testing::context(0, 1), &mut fates);
        assert!(error.unwrap_err().to_string().contains("no places"));
    }
}
