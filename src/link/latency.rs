//! Links that take a time that need not be a whole number of ticks.

use super::{Context, Domain, Fates, LONGEST_DELAY, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::rng::Purpose;
use crate::usage;

/// `latency(ticks, jitter)`: an observation takes a time that is uniform on ticks - jitter to ticks + jitter, and never
/// below 0. It arrives at the tick that is nearest.
///
/// Agents decide halfway through a tick: what takes less than half a tick is there in time, what takes longer waits for
/// the next one. [`Delay`](super::Delay) draws whole ticks instead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Latency {
    ticks: f64,
    jitter: f64,
}

const TICKS: Domain = Domain::Number("number of ticks", 0.0, LONGEST_DELAY as f64);

/// Its line in the registry.
pub(super) const MODEL: Model = Model {
    name: "latency",
    about: "observations take this many ticks, plus or minus the jitter, rounded to whole ticks",
    parameters: &[
        Parameter { name: "ticks", domain: TICKS, default: None },
        Parameter { name: "jitter", domain: TICKS, default: Some("0") },
    ],
    build: |arguments| Ok(Box::new(Latency::new(arguments[0].number(), arguments[1].number())?)),
};

impl Latency {
    /// Links that take so many ticks, give or take the jitter.
    ///
    /// # Errors
    /// `Usage` if the two together are more than [`LONGEST_DELAY`].
    pub fn new(ticks: f64, jitter: f64) -> Result<Latency> {
        let longest = ticks + jitter;
        if longest > LONGEST_DELAY.into() {
            return Err(usage!(
                "ticks and jitter postpone by up to {longest} ticks, but messages are kept for {LONGEST_DELAY}"
            ));
        }
        Ok(Latency { ticks, jitter })
    }
}

impl Link for Latency {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let mut draws = context.address.draws(Purpose::Delay);
        for receiver in 0..fates.agents() {
            draws.at(receiver, 0);
            for sender in 0..fates.agents() {
                let ticks = draws.between(self.ticks - self.jitter, self.ticks + self.jitter);
                fates.postpone(receiver, sender, ticks.max(0.0).round() as u8);
            }
        }
        Ok(())
    }

    fn longest_delay(&self) -> u8 {
        (self.ticks + self.jitter).round() as u8
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::check_delays;
    use super::*;

    #[test]
    fn delays_are_those_of_a_uniform_time() {
        // Less than half a tick is no delay.
        check_delays("latency(0.4, 0.05)", &[1.0]);
        check_delays("latency(0.5)", &[0.0, 1.0]);
        // Of 1.5 to 3.5 half are nearest to 2, half to 3.
        check_delays("latency(2.5, 1)", &[0.0, 0.0, 0.5, 0.5, 0.0]);
        // Of 1 to 3 a quarter is nearest to 1, a quarter to 3.
        check_delays("latency(2, 1)", &[0.0, 0.25, 0.5, 0.25]);
        // Below 0 there is nothing: -1 to 0.5 is 0, 0.5 to 1.5 is 1.
        check_delays("latency(0.25, 1.25)", &[0.6, 0.4, 0.0]);
    }

    #[test]
    fn longer_than_messages_are_kept_is_refused() {
        assert_eq!(Latency::new(60.5, 39.5).unwrap().longest_delay(), 100);
        let error = Latency::new(60.0, 40.5).unwrap_err().to_string();
        assert!(error.contains("up to 100.5 ticks"), "{error}");
    }
}
