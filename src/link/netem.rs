//! What netem, the network emulator of Linux, takes: `loss gemodel 10% 30% delay 20ms 5ms`.
//!
//! It is read as our own models. What has no exact counterpart among them is refused.

use super::complement;
use crate::base::error::{Error, Result};
use crate::usage;

/// The first words of netem's options.
const OPTIONS: [&str; 9] =
    ["netem", "loss", "delay", "limit", "corrupt", "duplicate", "reorder", "rate", "slot"];

/// The links that netem's options mean, where a tick takes so many seconds; `None` for any other text.
///
/// # Errors
/// `Usage` for options that we have no model for, numbers without a unit, and times where no tick is known.
pub(super) fn translate(text: &str, tick: Option<f64>) -> Result<Option<String>> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let [first, second, ..] = words[..] else { return Ok(None) };
    if !OPTIONS.contains(&first) || second.starts_with('(') {
        return Ok(None);
    }
    let words = &words[usize::from(first == "netem")..];
    read(words, tick).map(Some).map_err(|e| usage!("links `{text}`: {e}"))
}

fn read(words: &[&str], tick: Option<f64>) -> Result<String> {
    let (mut loss, mut delay) = (None, None);
    let mut left = words;
    while let Some((option, behind)) = left.split_first() {
        let end = behind.iter().position(|word| OPTIONS.contains(word)).unwrap_or(behind.len());
        let (arguments, next) = behind.split_at(end);
        let before = match *option {
            "loss" => loss.replace(losses(arguments)?),
            "delay" => delay.replace(delays(arguments, tick)?),
            other => {
                return Err(usage!(
                    "netem's `{other}` has no counterpart here; there are `loss` and `delay`"
                ));
            }
        };
        if before.is_some() {
            return Err(usage!("`{option}` is given twice"));
        }
        left = next;
    }
    // netem loses before it delays.
    Ok([loss, delay].into_iter().flatten().collect::<Vec<_>>().join(" + "))
}

/// `20%`, `random 20%`, `gemodel P R 1-H 1-K`, or `state P13 P31` with nothing that takes more than two states.
fn losses(words: &[&str]) -> Result<String> {
    let (model, numbers) = match words {
        [model @ ("random" | "state" | "gemodel"), numbers @ ..] => (*model, numbers),
        numbers => ("random", numbers),
    };
    let most = match model {
        "random" => 1,
        "gemodel" => 4,
        _ => 5,
    };
    if numbers.is_empty() || numbers.len() > most {
        let correlated = if model == "random" { ": correlated losses have no counterpart here" } else { "" };
        return Err(usage!(
            "`loss {model}` takes 1 to {most} probabilities, not {}{correlated}",
            numbers.len()
        ));
    }
    let p: Vec<f64> = numbers.iter().map(|number| probability(number)).collect::<Result<_>>()?;
    let or = |at: usize, default: f64| p.get(at).copied().unwrap_or(default);
    let second = or(1, complement(p[0]));
    match model {
        "random" => Ok(format!("level({})", complement(p[0]))),
        "gemodel" => Ok(format!("gemodel({}, {second}, {}, {})", p[0], or(2, 1.0), or(3, 0.0))),
        // The states 1 and 3 are our good and bad ones; 2 and 4 are reached by p32 and p14 alone.
        _ if or(2, 0.0) == 0.0 && or(4, 0.0) == 0.0 => Ok(format!("gilbert({}, {second})", p[0])),
        _ => Err(usage!(
            "`loss state` with p32 or p14 above 0 has more than two states, for which there is no model here; with \
             both 0 it is gilbert(p13, p31)"
        )),
    }
}

/// `20ms`, and as much jitter.
fn delays(words: &[&str], tick: Option<f64>) -> Result<String> {
    let (time, jitter) = match words {
        [time] => (*time, "0ms"),
        [time, jitter] => (*time, *jitter),
        _ => {
            return Err(usage!(
                "`delay` takes a time and a jitter; correlated delays and other distributions have no counterpart here"
            ));
        }
    };
    let tick = tick.ok_or_else(|| {
        usage!("a delay of {time} needs the length of a tick, which is unknown here; use latency(TICKS)")
    })?;
    // Without the noise of the division, so that 300 ms of 100 ms are 3.
    let ticks = |seconds: f64| (seconds / tick * 1e9).round() / 1e9;
    Ok(format!("latency({}, {})", ticks(seconds(time)?), ticks(seconds(jitter)?)))
}

fn probability(text: &str) -> Result<f64> {
    let wrong = || usage!("`{text}` is not a percentage from 0% to 100%");
    let number: f64 = text.strip_suffix('%').and_then(|number| number.parse().ok()).ok_or_else(wrong)?;
    if (0.0..=100.0).contains(&number) { Ok(number / 100.0) } else { Err(wrong()) }
}

fn seconds(text: &str) -> Result<f64> {
    let wrong = || -> Error { usage!("`{text}` is not a time such as 20ms, with the unit s, ms or us") };
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match &text[digits.len()..] {
        "s" | "sec" | "secs" => 1.0,
        "ms" | "msec" | "msecs" => 1e-3,
        "us" | "usec" | "usecs" => 1e-6,
        _ => return Err(wrong()),
    };
    let number: f64 = digits.parse().map_err(|_| wrong())?;
    if number.is_finite() && number >= 0.0 { Ok(number * unit) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use super::super::{LinkSpec, Site};
    use super::*;

    fn read(text: &str, tick: f64) -> Result<String> {
        LinkSpec::parse(text, Site { agents: 2, tick: Some(tick) }).map(|links| links.to_string())
    }

    #[test]
    fn what_netem_takes_is_read_as_our_models() {
        for (text, tick, links) in [
            ("loss 20%", 0.1, "level(0.8)"),
            ("loss random 0.5%", 0.1, "level(0.995)"),
            ("loss gemodel 10%", 0.1, "gemodel(0.1, 0.9, 1, 0)"),
            ("netem loss gemodel 10% 30%", 0.1, "gemodel(0.1, 0.3, 1, 0)"),
            ("loss gemodel 10% 30% 90% 1%", 0.1, "gemodel(0.1, 0.3, 0.9, 0.01)"),
            ("loss state 10% 30%", 0.1, "gilbert(0.1, 0.3)"),
            ("loss state 20% 40% 0% 70% 0%", 0.1, "gilbert(0.2, 0.4)"),
            ("delay 300ms", 0.1, "latency(3, 0)"),
            ("loss gemodel 10% 30% delay 20ms 5ms", 0.1, "gemodel(0.1, 0.3, 1, 0) + latency(0.2, 0.05)"),
            ("delay 20ms 5ms loss 20%", 0.01, "level(0.8) + latency(2, 0.5)"),
            ("delay 1s + dynamic", 0.5, "latency(2, 0) + dynamic"),
            // Ours, with a blank.
            ("delay (2)", 0.1, "delay(2, 0)"),
        ] {
            assert_eq!(read(text, tick).unwrap(), links, "{text}");
        }
    }

    #[test]
    fn what_has_no_counterpart_is_refused() {
        for (text, words) in [
            ("loss 20% 25%", "correlated losses have no counterpart"),
            ("loss 0.2", "`0.2` is not a percentage"),
            ("loss 120%", "`120%` is not a percentage from 0% to 100%"),
            ("loss gemodel", "takes 1 to 4 probabilities, not 0"),
            ("loss state 10% 30% 5%", "more than two states"),
            ("loss 20% ecn", "correlated"),
            ("loss 20% loss 30%", "`loss` is given twice"),
            ("delay 20", "`20` is not a time such as 20ms"),
            ("delay -5ms", "`-5ms` is not a time"),
            ("delay 20ms 5ms 25%", "correlated delays and other distributions"),
            ("delay 20ms 5ms distribution normal", "other distributions"),
            ("duplicate 1%", "netem's `duplicate` has no counterpart"),
            ("delay 20s", "`200` is not a number of ticks from 0 to 100"),
        ] {
            let error = read(text, 0.1).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
        let error = LinkSpec::parse("delay 20ms", 2).unwrap_err().to_string();
        assert!(error.contains("needs the length of a tick"), "{error}");
    }
}
