//! `--compare`: what got slower since an earlier result of the same command.

use std::collections::BTreeMap;
use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use crate::base::error::Result;
use crate::base::regular;
use crate::cli::{print, print_json, table};
use crate::usage;

/// The most bytes an earlier result may have.
const LARGEST: u64 = 1 << 26;

/// How a result is printed.
#[derive(Debug, Args)]
pub struct Output {
    /// Print the figures as one JSON object
    #[arg(long)]
    json: bool,

    /// Say what got slower since an earlier result, the output of the same command with --json
    #[arg(long, value_name = "FILE", value_parser = Earlier::read)]
    compare: Option<Earlier>,
}

/// The figures of an earlier result.
#[derive(Clone, Debug)]
struct Earlier {
    name: String,
    figures: Figures,
}

/// What is measured, by what it is measured of.
type Figures = BTreeMap<String, f64>;

/// A figure that is not what it was.
#[derive(Clone, Debug, PartialEq)]
struct Change {
    figure: String,
    before: f64,
    now: f64,
    /// How many times worse it is.
    times: f64,
}

/// Figures drift by a tenth from run to run.
const DRIFT: f64 = 1.1;

/// What says of which case an object is.
const LABELS: [&str; 11] =
    ["task", "actor", "medium", "host", "hosts", "agents", "worlds", "wait", "payload", "p", "rate"];

/// The ends of the names of figures that are the better the smaller, and those that are the better the larger.
const SMALLER: [&str; 3] = ["_us", "_ms", "_mib"];
const LARGER: [&str; 1] = ["_per_s"];

/// What one event decides is different in every run.
const EVENTS: [&str; 2] = ["max_us", "p999_us"];

impl Output {
    /// Prints a result as JSON or as text. What was measured is printed also if it cannot be compared.
    pub(super) fn print(&self, mut result: Value, text: impl FnOnce() -> String) -> Result<()> {
        let earlier = self.compare.as_ref();
        let slower = earlier.map(|earlier| earlier.slower(&figures(&result))).transpose();
        if self.json {
            if let Ok(Some((slower, _))) = &slower {
                result["slower"] = slower.iter().map(Change::json).collect();
            }
            print_json(&result)?;
            return slower.map(drop);
        }
        print(&text())?;
        match (slower?, earlier) {
            (Some((slower, compared)), Some(earlier)) => print(&earlier.text(&slower, compared)),
            _ => Ok(()),
        }
    }
}

impl Earlier {
    fn read(path: &str) -> std::result::Result<Earlier, String> {
        let bytes = regular::read(Path::new(path), LARGEST).map_err(|e| e.to_string())?;
        let result =
            serde_json::from_slice(&bytes).map_err(|e| format!("it is not the output of --json: {e}"))?;
        Ok(Earlier { name: path.to_owned(), figures: figures(&result) })
    }

    /// What is slower now, the worst first, and how many figures were compared.
    fn slower(&self, now: &Figures) -> Result<(Vec<Change>, usize)> {
        let both = now.iter().filter_map(|(figure, now)| Some((figure, self.figures.get(figure)?, now)));
        let both: Vec<_> = both.collect();
        if both.is_empty() {
            return Err(usage!(
                "nothing measured here is in {}; was it made by the same command with --json?",
                self.name
            ));
        }
        let changes = both.iter().map(|(figure, before, now)| {
            let larger_is_better = LARGER.iter().any(|end| figure.ends_with(end));
            let times = if larger_is_better { *before / *now } else { *now / *before };
            Change { figure: (*figure).clone(), before: **before, now: **now, times }
        });
        let mut slower: Vec<Change> = changes.filter(|change| change.times > DRIFT).collect();
        slower.sort_by(|a, b| b.times.total_cmp(&a.times));
        Ok((slower, both.len()))
    }

    fn text(&self, slower: &[Change], compared: usize) -> String {
        let worse = format!("by more than {:.0} %", 100.0 * (DRIFT - 1.0));
        if slower.is_empty() {
            return format!("\nnone of {compared} figures got worse {worse} since {}\n", self.name);
        }
        let number = |value: f64| match value {
            100.0.. => format!("{value:.0}"),
            _ => format!("{value:.3}"),
        };
        let rows = slower.iter().map(|change| {
            let numbers = [number(change.before), number(change.now), format!("{:.2}", change.times)];
            [vec![change.figure.clone()], numbers.to_vec()].concat()
        });
        let table = table(&["figure", "before", "now", "times worse"], rows);
        format!("\n{} of {compared} figures got worse {worse} since {}\n{table}", slower.len(), self.name)
    }
}

impl Change {
    fn json(&self) -> Value {
        json!({ "figure": self.figure, "before": self.before, "now": self.now, "times": self.times })
    }
}

/// The figures of a result.
fn figures(result: &Value) -> Figures {
    let mut figures = Figures::new();
    collect(result, String::new(), &mut figures);
    figures
}

fn collect(value: &Value, of: String, figures: &mut Figures) {
    match value {
        Value::Array(list) => list.iter().for_each(|value| collect(value, of.clone(), figures)),
        Value::Object(object) => {
            let plain = |label: &Value| label.as_str().map_or(label.to_string(), str::to_owned);
            let labels = LABELS.iter().filter_map(|key| Some(format!("{key} {}", plain(object.get(*key)?))));
            let of =
                std::iter::once(of).filter(|of| !of.is_empty()).chain(labels).collect::<Vec<_>>().join(", ");
            for (key, value) in object.iter().filter(|(key, _)| !LABELS.contains(&key.as_str())) {
                let name = if of.is_empty() { key.clone() } else { format!("{of}: {key}") };
                match value.as_f64() {
                    Some(number) if is_figure(key) => _ = figures.insert(name, number),
                    _ => collect(value, name, figures),
                }
            }
        }
        _ => {}
    }
}

fn is_figure(key: &str) -> bool {
    SMALLER.iter().chain(&LARGER).any(|end| key.ends_with(end)) && !EVENTS.contains(&key)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(p50: f64, rate: f64) -> Value {
        let hop = |medium: &str, p50: f64| json!({ "medium": medium, "payload": 64, "hop": { "p50_us": p50, "max_us": p50 * p50, "count": p50 } });
        json!({ "hops": [hop("bus", p50), hop("pipe", 3.0)], "env_steps_per_s": rate })
    }

    fn slower(before: &Value, now: &Value) -> Result<(Vec<Change>, usize)> {
        Earlier { name: "before.json".to_owned(), figures: figures(before) }.slower(&figures(now))
    }

    #[test]
    fn what_got_worse_is_found_whichever_way_is_better() {
        let change =
            |figure: &str, before, now, times| Change { figure: figure.to_owned(), before, now, times };
        let (found, compared) = slower(&result(2.0, 800.0), &result(3.0, 100.0)).unwrap();
        let bus = "hops, medium bus, payload 64: hop: p50_us";
        assert_eq!(found, [change("env_steps_per_s", 800.0, 100.0, 8.0), change(bus, 2.0, 3.0, 1.5)]);
        assert_eq!(compared, 3);
        assert_eq!(slower(&result(2.0, 100.0), &result(2.1, 800.0)).unwrap().0, []);
    }

    #[test]
    fn results_of_another_command_cannot_be_compared() {
        assert!(slower(&json!({ "tasks": [] }), &result(1.0, 1.0)).is_err());
        assert!(slower(&json!([1, "two"]), &result(1.0, 1.0)).is_err());
    }
}
