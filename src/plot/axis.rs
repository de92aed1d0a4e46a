//! An axis: its range, and ticks at round numbers.

/// How far apart values lie on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scale {
    /// As far as they differ.
    Linear,
    /// As far as their logarithms differ. Only positive values have a place.
    Logarithmic,
}

/// A range of values, with ticks.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    scale: Scale,
    low: f64,
    high: f64,
    /// The tick values and what stands beside them.
    pub(super) ticks: Vec<(f64, String)>,
}

impl Axis {
    /// The axis of these values (those that have a place), with at most `n_ticks` + 1 ticks, or two more if it is
    /// logarithmic.
    pub(super) fn new(scale: Scale, values: impl Iterator<Item = f64>, n_ticks: usize) -> Axis {
        match scale {
            Scale::Linear => Axis::linear(values, n_ticks),
            Scale::Logarithmic => Axis::logarithmic(values, n_ticks),
        }
    }

    fn linear(values: impl Iterator<Item = f64>, n_ticks: usize) -> Axis {
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
        let label = |value: f64| {
            if value == 0.0 { "0".to_owned() } else { format!("{:.decimals$}{letter}", value / unit) }
        };
        let ticks = values.map(|value| (value, label(value))).collect();
        Axis { scale: Scale::Linear, low, high, ticks }
    }

    /// Ticks are at powers of ten; at 1, 2 and 5 times them if there are few.
    fn logarithmic(values: impl Iterator<Item = f64>, n_ticks: usize) -> Axis {
        let places = values.filter(|value| value.is_finite() && *value > 0.0).map(f64::log10);
        let (low, high) =
            places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let decades = low.floor() as i32 - 1..=high.ceil() as i32 + 1;
        // From the last round number that nothing is below to the first that nothing is above.
        let ticks_at = |steps: &[f64]| -> Vec<f64> {
            let round =
                decades.clone().flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
            let round: Vec<f64> = round.collect();
            let first =
                round.iter().rposition(|tick| tick.log10() <= low + SLACK).expect("a decade was added");
            let last =
                round.iter().position(|tick| tick.log10() >= high - SLACK).expect("a decade was added");
            round[first..=last.max(first + 1)].to_vec()
        };
        let mut round = ticks_at(&[1.0, 2.0, 5.0]);
        if round.len() > n_ticks + 2 {
            round = ticks_at(&[1.0]);
        }
        let every = (round.len() - 1).div_ceil(n_ticks + 1);
        let ticks = round.iter().step_by(every).map(|tick| (*tick, power(*tick))).collect();
        let (low, high) = (round[0].log10(), round[round.len() - 1].log10());
        Axis { scale: Scale::Logarithmic, low, high, ticks }
    }

    /// The same range, with ticks at these values.
    pub(super) fn with_ticks(self, values: &[f64]) -> Axis {
        let mut values = values.to_vec();
        values.sort_by(f64::total_cmp);
        Axis { ticks: values.into_iter().map(|value| (value, value.to_string())).collect(), ..self }
    }

    /// Where a value is: 0 at the low end, 1 at the high end. Not finite if it has no place.
    pub(super) fn position(&self, value: f64) -> f64 {
        let value = match self.scale {
            Scale::Linear => value,
            Scale::Logarithmic => value.log10(),
        };
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

/// What stands beside a tick of a logarithmic axis.
fn power(tick: f64) -> String {
    let (unit, letter) = unit(tick);
    let decimals = (-(tick.log10() + SLACK).floor()).clamp(0.0, 12.0) as usize;
    format!("{:.decimals$}{letter}", tick / unit)
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
        Axis::new(Scale::Linear, [low, high].into_iter(), 5)
            .ticks
            .into_iter()
            .map(|(_, label)| label)
            .collect()
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
            let axis = Axis::new(Scale::Linear, [low, high].into_iter(), 5);
            assert!((2..=6).contains(&axis.ticks.len()), "{axis:?}");
            assert!((-1e-6..0.11).contains(&axis.position(low)), "{axis:?}");
            assert!((0.89..1.0 + 1e-6).contains(&axis.position(high)), "{axis:?}");
        }
        for value in [7.0, 0.0, -1e-9, 3e15] {
            let axis = Axis::new(Scale::Linear, [value].into_iter(), 5);
            assert!(axis.ticks.len() > 1 && (0.3..0.7).contains(&axis.position(value)), "{axis:?}");
        }
    }

    #[test]
    fn logarithmic_ticks_are_round_too() {
        let axis = |low: f64, high: f64| Axis::new(Scale::Logarithmic, [low, 0.0, high, -1.0].into_iter(), 5);
        let labels = |low, high| -> Vec<String> {
            axis(low, high).ticks.into_iter().map(|(_, label)| label).collect()
        };
        assert_eq!(labels(64.0, 65536.0), ["10", "100", "1000", "10k", "100k"]);
        assert_eq!(labels(0.3, 2.0), ["0.2", "0.5", "1", "2"]);
        assert_eq!(labels(0.3, 32.0), ["0.1", "1", "10", "100"]);
        assert_eq!(labels(0.002, 1.0), ["0.001", "0.01", "0.1", "1"]);
        assert_eq!(labels(1.0, 1e9).len(), 5);
        assert!((axis(1.0, 100.0).position(10.0) - 0.5).abs() < 1e-12);
        assert!(!axis(1.0, 100.0).position(0.0).is_finite());
        assert!(axis(7.0, 7.0).ticks.len() > 1);
    }

    #[test]
    fn ticks_can_be_given() {
        let axis = Axis::new(Scale::Linear, [0.0, 1.0].into_iter(), 5).with_ticks(&[1.0, 0.25, 0.0]);
        let ticks: Vec<(f64, &str)> = axis.ticks.iter().map(|(value, text)| (*value, &text[..])).collect();
        assert_eq!(ticks, [(0.0, "0"), (0.25, "0.25"), (1.0, "1")]);
        assert_eq!(axis.position(0.25), 0.25);
    }

    #[test]
    fn an_axis_of_nothing_is_still_an_axis() {
        let axis = Axis::new(Scale::Linear, [f64::NAN, f64::INFINITY].into_iter(), 5);
        assert_eq!(axis.ticks.len(), 6);
    }
}
