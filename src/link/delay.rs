//! Links that delay.

use super::{Context, Domain, Fates, LONGEST_DELAY, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::rng::Purpose;
use crate::usage;

/// `delay(ticks, jitter)`: an observation arrives k ticks after it was sent, k uniform on ticks - jitter to ticks +
/// jitter, and never below 0.
///
/// Each observation draws its own k, so one may arrive after a newer one. It is then outdated, and not shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delay {
    ticks: u8,
    jitter: u8,
}

const TICKS: Domain = Domain::Whole("ticks", 0.0, LONGEST_DELAY as f64);

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "delay",
    about: "observations arrive this many ticks later, plus or minus the jitter",
    parameters: &[
        Parameter { name: "ticks", domain: TICKS, default: None },
        Parameter { name: "jitter", domain: TICKS, default: Some("0") },
    ],
    build: |arguments| Ok(Box::new(Delay::new(arguments[0].number() as u8, arguments[1].number() as u8)?)),
};

impl Delay {
    /// Links that take this many ticks, give or take the jitter.
    ///
    /// # Errors
    /// `Usage` if the two together are more than [`LONGEST_DELAY`].
    pub fn new(ticks: u8, jitter: u8) -> Result<Delay> {
        let longest = u32::from(ticks) + u32::from(jitter);
        if longest > LONGEST_DELAY.into() {
            return Err(usage!(
                "ticks and jitter postpone by up to {longest} ticks, but messages are kept for {LONGEST_DELAY}"
            ));
        }
        Ok(Delay { ticks, jitter })
    }
}

impl Link for Delay {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let choices = 2 * usize::from(self.jitter) + 1;
        let mut draws = context.address.draws(Purpose::Delay);
        for receiver in 0..fates.agents() {
            draws.at(receiver, 0);
            for sender in 0..fates.agents() {
                let ticks = usize::from(self.ticks) + draws.below(choices);
                let ticks = ticks.saturating_sub(self.jitter.into());
                fates.postpone(receiver, sender, ticks as u8);
            }
        }
        Ok(())
    }

    fn longest_delay(&self) -> u8 {
        self.ticks + self.jitter
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{STEPS, check_delays, context, links};
    use super::*;

    #[test]
    fn delays_are_uniform_around_their_middle() {
        check_delays("delay(3)", &[0.0, 0.0, 0.0, 1.0]);
        check_delays("delay(2, 1)", &[0.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0]);
        // Never below 0: -1 and 0 are one.
        check_delays("delay(jitter=2, ticks=1)", &[0.4, 0.2, 0.2, 0.2]);
        // Two that are uniform on 0..=2 add up to a triangle.
        check_delays("delay(1, 1) + delay(1, 1)", &[1.0 / 9.0, 2.0 / 9.0, 3.0 / 9.0, 2.0 / 9.0, 1.0 / 9.0]);
    }

    #[test]
    fn what_is_lost_on_the_way_is_lost() {
        let (mut alone, mut both) = (links("level(0.5)"), links("level(0.5) + delay(2, 1)"));
        let [mut lossy, mut slow] = [0, 1].map(|_| Fates::new(5));
        for step in 1..STEPS {
            alone.deliveries(&context(3, step), &mut lossy).unwrap();
            both.deliveries(&context(3, step), &mut slow).unwrap();
            for (i, j) in (0..25).map(|link| (link / 5, link % 5)) {
                assert_eq!(lossy.delay(i, j).is_some(), slow.delay(i, j).is_some());
                assert!(slow.delay(i, j).is_none_or(|ticks| (1..=3).contains(&ticks) || i == j));
            }
        }
    }

    #[test]
    fn longer_than_messages_are_kept_is_refused() {
        assert_eq!(Delay::new(60, 40).unwrap().longest_delay(), 100);
        let error = Delay::new(60, 41).unwrap_err().to_string();
        assert!(error.contains("up to 101 ticks"), "{error}");
    }
}
