//! Links that fade with the distance.

use super::{Context, Domain, Fates, Link, Model, Parameter};
use crate::base::error::Result;
use crate::base::rng::Purpose;

/// `range(max, exponent, l0, sigma, tx_power, noise_floor)`: the radio of Gazebo's `RFComms`.
///
/// Beyond `max` nothing is received. Up to there, a distance of d metres costs `l0 + 10 exponent log10(d)` dB. The
/// received power is normal with the variance sigma around what is left of the transmitted power. Its ratio to the noise
/// floor gives the probability that a bit is wrong, erfc(sqrt(ratio)) as for QPSK. An observation of n bytes is delivered
/// with the n-th power of 1 minus that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    max: f64,
    exponent: f64,
    /// Loss at one metre, dB.
    l0: f64,
    /// Variance of the received power, dB squared: `RFComms` gives it the name of a standard deviation.
    sigma: f64,
    /// dBm.
    tx_power: f64,
    /// dBm.
    noise_floor: f64,
}

const POWER: Domain = Domain::Number("number of dBm", -300.0, 300.0);

/// Its line in the registry. The defaults are those of `RFComms`.
pub(super) const MODEL: Model = Model {
    name: "range",
    about: "nothing beyond max metres, log-distance fading below, as in Gazebo's RFComms",
    parameters: &[
        Parameter { name: "max", domain: Domain::Number("number of metres", 0.0, 1e6), default: None },
        Parameter { name: "exponent", domain: Domain::Number("number", 0.0, 20.0), default: Some("2.5") },
        Parameter { name: "l0", domain: Domain::Number("number of dB", -300.0, 300.0), default: Some("40") },
        Parameter {
            name: "sigma",
            domain: Domain::Number("variance in dB squared", 0.0, 1e4),
            default: Some("10"),
        },
        Parameter { name: "tx_power", domain: POWER, default: Some("27") },
        Parameter { name: "noise_floor", domain: POWER, default: Some("-90") },
    ],
    build: |arguments| {
        let [max, exponent, l0, sigma, tx_power, noise_floor] =
            [0, 1, 2, 3, 4, 5].map(|at| arguments[at].number());
        Ok(Box::new(Range { max, exponent, l0, sigma, tx_power, noise_floor }))
    },
};

impl Range {
    /// The probability that so many bytes are received over this distance, if the power is off by `fading` dB.
    fn delivers(&self, distance: f64, fading: f64, bytes: usize) -> f64 {
        if distance > self.max {
            return 0.0;
        }
        let loss = self.l0 + 10.0 * self.exponent * distance.log10();
        let above_noise = self.tx_power - loss + fading - self.noise_floor;
        let wrong = erfc(10f64.powf(above_noise / 10.0).sqrt());
        (1.0 - wrong).powf(bytes as f64)
    }
}

impl Link for Range {
    fn deliveries(&mut self, context: &Context, fates: &mut Fates) -> Result<()> {
        let places = context.places()?;
        let deviation = self.sigma.sqrt();
        let [mut luck, mut fading] = [Purpose::Link, Purpose::Fading].map(|of| context.address.draws(of));
        for receiver in 0..fates.agents() {
            luck.at(receiver, 0);
            // Each takes two draws.
            fading.at(2 * receiver, 0);
            for sender in 0..fates.agents() {
                let distance = places[receiver].distance(places[sender]);
                let fading = deviation * fading.normal().x;
                if luck.uniform() >= self.delivers(distance, fading, context.bytes) {
                    fates.lose(receiver, sender);
                }
            }
        }
        Ok(())
    }
}

/// The complementary error function of what is not negative, to 1.5e-7 (Abramowitz and Stegun, 7.1.26).
fn erfc(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let factors = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let polynomial = factors.into_iter().fold(0.0, |sum, factor| (sum + factor) * t);
    polynomial * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, dvec2};

    use super::super::testing::{STEPS, context, links};
    use super::*;

    /// The share that agent 0 receives of agent 1, which is this far away.
    fn share(text: &str, distance: f64) -> f64 {
        let (mut links, mut fates) = (links(text), Fates::new(2));
        let places = [dvec2(0.3, 0.0), dvec2(0.3, distance)];
        let mut delivered = 0u32;
        for (episode, step) in (0..400).flat_map(|episode| (1..STEPS).map(move |step| (episode, step))) {
            let context = super::super::Context { positions: Some(&places), ..context(episode, step) };
            links.deliveries(&context, &mut fates).unwrap();
            delivered += u32::from(fates.delay(0, 1).is_some());
        }
        f64::from(delivered) / DRAWS
    }

    const DRAWS: f64 = 400.0 * (STEPS - 1) as f64;

    fn check(text: &str, distance: f64, expected: f64) {
        let (share, sigma) = (share(text, distance), (expected * (1.0 - expected) / DRAWS).sqrt());
        assert!(
            (share - expected).abs() <= 5.0 * sigma + 1e-5,
            "{text} at {distance} m: {share}, not {expected}"
        );
    }

    #[test]
    fn erfc_is_what_tables_say() {
        for (x, expected) in [(0.0, 1.0), (0.5, 0.479_500_122), (1.0, 0.157_299_207), (2.0, 0.004_677_735)] {
            assert!((erfc(x) - expected).abs() < 1.5e-7, "{x}");
        }
        assert_eq!(erfc(f64::INFINITY), 0.0);
    }

    #[test]
    fn without_fading_the_distance_decides() {
        // 7 dB above the noise at one metre, which is 5.0119: a bit is wrong with erfc(2.2387) = 0.001546, one of 32
        // bytes with 0.0483.
        let text = "range(1.5, sigma=0, noise_floor=-20)";
        check(text, 1.0, 0.9517);
        // 2.5 log10(1.4^10) = 3.653 dB less: erfc(1.4701) = 0.037614.
        check(text, 1.4, 0.2933);
        assert_eq!(share(text, 1.51), 0.0);
        assert_eq!(share(text, 0.0), 1.0);
        // As in Gazebo, 77 dB are enough for all that is near.
        assert_eq!(share("range(50)", 2.0), 1.0);
    }

    #[test]
    fn fading_is_normal_with_the_variance_sigma() {
        let text = "range(5, 2.5, 40, 9, 27, -20)";
        let range =
            Range { max: 5.0, exponent: 2.5, l0: 40.0, sigma: 9.0, tx_power: 27.0, noise_floor: -20.0 };
        for distance in [0.7, 1.0, 1.4, 2.0] {
            // The mean over the normal distribution, in steps of a hundredth of its standard deviation.
            let nodes = (-600..=600).map(|node| f64::from(node) / 100.0);
            let weighted = nodes.map(|z| ((-z * z / 2.0).exp(), range.delivers(distance, 3.0 * z, 32)));
            let (all, delivered) = weighted.fold((0.0, 0.0), |(a, d), (w, p)| (a + w, d + w * p));
            check(text, distance, delivered / all);
        }
    }

    #[test]
    fn more_power_delivers_what_less_does() {
        let masks = |power: f64| -> Vec<bool> {
            let mut links = links(&format!("range(5, tx_power={power}, noise_floor=-20)"));
            let places = [DVec2::ZERO, dvec2(1.0, 0.0), dvec2(0.0, 1.5), dvec2(-0.5, -0.5)];
            let mut fates = Fates::new(4);
            let of_step = |step| {
                let context = super::super::Context { positions: Some(&places), ..context(0, step) };
                links.deliveries(&context, &mut fates).unwrap();
                fates.ticks().iter().map(|ticks| *ticks == 0).collect::<Vec<_>>()
            };
            (0..STEPS).flat_map(of_step).collect()
        };
        let [less, more] = [25.0, 28.0].map(masks);
        assert!(less.iter().zip(&more).all(|(less, more)| !less | more));
        assert_ne!(less, more);
    }

    #[test]
    fn it_needs_places() {
        let error = links("range(1)").deliveries(&context(0, 1), &mut Fates::new(2)).unwrap_err().to_string();
        assert!(error.contains("no places"), "{error}");
    }
}
