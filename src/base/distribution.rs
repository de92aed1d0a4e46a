//! How long something took, again and again.

use std::time::Duration;

use hdrhistogram::Histogram;
use serde_json::{Map, Value, json};

/// What takes longer counts as an overrun: the period of a control loop of 1 kHz.
pub const OVERRUN: Duration = Duration::from_millis(1);

/// The quantiles that are said of a distribution, and their names.
pub(crate) const QUANTILES: [(&str, f64); 4] = [("p50", 0.5), ("p90", 0.9), ("p99", 0.99), ("p999", 0.999)];

/// A distribution of times, to three digits.
#[derive(Clone, Debug)]
pub struct Distribution {
    /// Nanoseconds.
    times: Histogram<u64>,
    overruns: u64,
}

impl Default for Distribution {
    fn default() -> Distribution {
        const LONGEST: u64 = 60_000_000_000;
        let times = Histogram::new_with_bounds(1, LONGEST, 3).expect("the bounds are in order");
        Distribution { times, overruns: 0 }
    }
}

impl Distribution {
    /// Takes a time in, in nanoseconds.
    pub fn record(&mut self, ns: u64) {
        self.times.saturating_record(ns);
        self.overruns += u64::from(u128::from(ns) > OVERRUN.as_nanos());
    }

    /// How many were taken in.
    pub fn count(&self) -> u64 {
        self.times.len()
    }

    /// How many of them took longer than [`OVERRUN`].
    pub fn overruns(&self) -> u64 {
        self.overruns
    }

    /// A quantile in microseconds; 1 is the longest.
    pub fn quantile_us(&self, quantile: f64) -> f64 {
        self.times.value_at_quantile(quantile) as f64 / 1e3
    }

    /// The share of times that are longer, for each time there is one of, in microseconds. The longest, which
    /// nothing exceeds, is left out.
    pub fn tail(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let mut longer = self.count();
        let steps = self.times.iter_recorded().map(move |step| {
            longer -= step.count_at_value();
            (step.value_iterated_to() as f64 / 1e3, longer as f64 / self.count() as f64)
        });
        steps.filter(|(_, share)| *share > 0.0)
    }

    /// Its quantiles and the longest; nulls if there is nothing.
    pub(crate) fn times_json(&self) -> Map<String, Value> {
        let quantiles = QUANTILES.map(|(name, quantile)| (format!("{name}_us"), self.quantile_us(quantile)));
        let times = quantiles.into_iter().chain([("max_us".to_owned(), self.quantile_us(1.0))]);
        // Nothing took no time.
        times.map(|(name, us)| (name, json!((self.count() > 0).then_some(us)))).collect()
    }

    /// The same, the count and the overruns.
    pub fn json(&self) -> Map<String, Value> {
        let counts = [("count", self.count()), ("overruns", self.overruns)];
        let counts = counts.map(|(name, count)| (name.to_owned(), json!(count)));
        self.times_json().into_iter().chain(counts).collect()
    }

    /// Its quantiles, and the longest, as multiples of another's.
    pub fn ratios(&self, to: &Distribution) -> Map<String, Value> {
        let all = QUANTILES.into_iter().chain([("max", 1.0)]);
        let ratio = |quantile| self.quantile_us(quantile) / to.quantile_us(quantile);
        all.map(|(name, quantile)| (name.to_owned(), json!(ratio(quantile)))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(times: impl IntoIterator<Item = u64>) -> Distribution {
        let mut distribution = Distribution::default();
        times.into_iter().for_each(|ns| distribution.record(ns));
        distribution
    }

    #[test]
    fn quantiles_counts_and_overruns_are_those_of_the_times() {
        // A thousandth of a value is what three digits keep.
        let distribution = of((1..=1000).map(|i| i * 2000));
        let json = distribution.json();
        for (name, us) in [("p50_us", 1000.0), ("p90_us", 1800.0), ("p99_us", 1980.0), ("max_us", 2000.0)] {
            let found = json[name].as_f64().unwrap();
            assert!((found / us - 1.0).abs() < 2e-3, "{name}: {found}");
        }
        assert_eq!((&json["count"], &json["overruns"]), (&1000.into(), &500.into()));
    }

    #[test]
    fn ratios_are_of_like_to_like() {
        let (slow, fast) = (of([200, 200, 200, 9000]), of([100, 100, 100, 1000]));
        let ratios = slow.ratios(&fast);
        assert_eq!(ratios["p50"], 2.0);
        assert!((ratios["max"].as_f64().unwrap() - 9.0).abs() < 0.02, "{ratios:?}");
    }

    #[test]
    fn a_tail_falls_from_what_is_longer_than_the_shortest() {
        let tail: Vec<_> = of([100, 100, 200, 400]).tail().collect();
        assert_eq!(tail, [(0.1, 0.5), (0.2, 0.25)]);
    }
}
