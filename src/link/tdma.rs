//! A channel that is divided into time slots.

use super::{Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::rng::MAX_AGENTS;

/// `tdma(slots)`: at step t only those are heard whose number leaves the same rest as t when divided by the number of
/// slots.
///
/// With as many slots as agents each is heard once a round; with fewer, several share a slot; with more, nobody is heard
/// in some.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tdma {
    slots: usize,
}

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "tdma",
    about: "agents are heard in turn: agent i at the steps i, i + slots, i + 2 slots, ..",
    parameters: &[Parameter {
        name: "slots",
        domain: Domain::Whole("slots", 1.0, MAX_AGENTS as f64),
        default: None,
    }],
    build: |arguments| Ok(Box::new(Tdma { slots: arguments[0].number() as usize })),
};

impl Link for Tdma {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let slot = (context.address.step % self.slots as u64) as usize;
        fates.silence(|sender| sender % self.slots != slot);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, rows};

    #[test]
    fn each_is_heard_once_a_round() {
        for slots in [1, 2, 3, 5] {
            for step in 1..STEPS {
                for (i, row) in rows(&format!("tdma({slots})"), 2, step, 4).into_iter().enumerate() {
                    let heard = |j: usize| i == j || j as u64 % slots == step % slots;
                    assert!((0..4).all(|j| (row >> j & 1 == 1) == heard(j)), "{slots} slots, step {step}");
                }
            }
        }
    }
}
