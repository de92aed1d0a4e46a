//! An axis: its range, and ticks at round numbers.

/// A range of values, with ticks.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    /// The tick values and what stands beside them.
    pub(super) ticks: Vec<(f64, String)>,
}

impl Axis {
    /// The axis of these values (those that are finite), with at most `n_ticks` + 1 ticks.
    pub(super) fn new(values: impl Iterator<Item = f64>, n_ticks: usize) -> Axis {
        let finite = values.filter(|value| value.is_finite());
        let (low, high) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = match (low <= high, low < high) {
            (false, _) => (0.0, 1.0),
            // One value alone gets some room; more than a rounding error, or ticks would collapse.
            (true, false) => (low - 0.5 * low.abs().max(1.0), high + 0.5 * high.abs().max(1.0)),
            (true, true) => (low, high),
        };
        let step = round_up((high - low) / n_ticks as f64);
        // The ends are multiples of a part of the step, so that little room is lost beyond the values.
        let part = step / 5.0;
        let (low, high) = ((low / part + SLACK).floor() * part, (high / part - SLACK).ceil() * part);
        let (first, last) = ((low / step - SLACK).ceil(), (high / step + SLACK).floor());
        let values = (0..=(last - first) as usize).map(|i| (first + i as f64) * step);
        let (unit, letter) = unit(f64::max(first.abs(), last.abs()) * step);
        let decimals = (-(step / unit).log10() - SLACK).ceil().clamp(0.0, 12.0) as usize;
        let label = |value: f64| match value == 0.0 {
            true => "0".to_owned(),
            false => format!("{:.decimals$}{letter}", value / unit),
        };
        Axis { low, high, ticks: values.map(|value| (value, label(value))).collect() }
    }

    /// Where a value is: 0 at the low end, 1 at the high end.
    pub(super) fn position(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }
}

/// Share of a step by which a value may lie beyond a tick and still count as on it.
const SLACK: f64 = 1e-9;

/// The next 1, 2 or 5 times a power of ten.
fn round_up(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power >= step * (1.0 - SLACK));
    factor.unwrap_or(10.0) * power
}

/// The unit of an axis that reaches `largest`, and its letter.
fn unit(largest: f64) -> (f64, &'static str) {
    match largest {
        1e9.. => (1e9, "G"),
        1e6.. => (1e6, "M"),
        1e4.. => (1e3, "k"),
        _ => (1.0, ""),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64) -> Vec<String> {
        Axis::new([low, high].into_iter(), 5).ticks.into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        assert_eq!(labels(-198.0, -24.0), ["-200", "-150", "-100", "-50"]);
        assert_eq!(labels(5_000.0, 1_000_000.0), ["0", "0.2M", "0.4M", "0.6M", "0.8M", "1.0M"]);
        assert_eq!(labels(0.0, 50_000.0), ["0", "10k", "20k", "30k", "40k", "50k"]);
        assert_eq!(labels(250.0, 9000.0), ["0", "2000", "4000", "6000", "8000"]);
        assert_eq!(labels(0.0, 1.0), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(0.0, 0.003), ["0", "0.001", "0.002", "0.003"]);
        assert_eq!(labels(-3.1e10, 0.0), ["-30G", "-20G", "-10G", "0"]);
    }

    #[test]
    fn an_axis_reaches_all_values_and_little_more() {
        let ranges = [(-198.0, -24.0), (0.1, 0.3), (-1e-7, 3e-7), (1e12, 1e12 + 1.0), (0.11, 1.9)];
        for (low, high) in ranges {
            let axis = Axis::new([low, high].into_iter(), 5);
            assert!((2..=6).contains(&axis.ticks.len()), "{axis:?}");
            assert!((-1e-6..0.11).contains(&axis.position(low)), "{axis:?}");
            assert!((0.89..1.0 + 1e-6).contains(&axis.position(high)), "{axis:?}");
        }
        for value in [7.0, 0.0, -1e-9, 3e15] {
            let axis = Axis::new([value].into_iter(), 5);
            assert!(axis.ticks.len() > 1 && (0.3..0.7).contains(&axis.position(value)), "{axis:?}");
        }
    }

    #[test]
    fn an_axis_of_nothing_is_still_an_axis() {
        let axis = Axis::new([f64::NAN, f64::INFINITY].into_iter(), 5);
        assert_eq!(axis.ticks.len(), 6);
    }
}
