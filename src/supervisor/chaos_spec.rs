//! Chaos as text: `kill=0.01:500ms, stop=0.005:200ms`.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Result};
use crate::base::nearest::did_you_mean;
use crate::usage;

/// How often agents are killed and stopped on purpose. Written down it is text, such as
/// `kill=0.01:500ms,stop=0.005:200ms`; the default does nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ChaosSpec {
    /// Agents are killed, and come back as new processes, which know nothing of the episode.
    pub kill: Option<Injection>,
    /// Agents are stopped, and go on from where they were.
    pub stop: Option<Injection>,
}

/// A fault that is injected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// With which probability an agent that is there meets it, at each tick.
    pub probability: f64,
    /// For how long the agent is then absent. Against the clock a killed agent is absent for as long as it takes.
    pub absence: Duration,
}

/// The absence of a fault whose text names none: about what a process takes to come back on a busy machine, or what it
/// sleeps when the machine swaps.
const ABSENCES: [(&str, Duration); 2] =
    [("kill", Duration::from_millis(500)), ("stop", Duration::from_millis(200))];

/// The longest absence that can be asked for.
const LONGEST: Duration = Duration::from_secs(60);

impl ChaosSpec {
    fn injections(&self) -> [(&'static str, Option<Injection>); 2] {
        [("kill", self.kill), ("stop", self.stop)]
    }
}

impl FromStr for ChaosSpec {
    type Err = Error;

    /// Reads faults with commas between them: NAME=PROBABILITY or NAME=PROBABILITY:TIME.
    fn from_str(text: &str) -> Result<ChaosSpec> {
        let mut spec = ChaosSpec::default();
        for part in text.split(',') {
            let Some((name, value)) = part.split_once('=') else {
                return Err(usage!("`{part}`: expected NAME=PROBABILITY[:TIME], such as kill=0.01:500ms"));
            };
            let name = name.trim();
            let Some((_, usual)) = ABSENCES.into_iter().find(|(known, _)| *known == name) else {
                let names = ABSENCES.map(|(known, _)| known);
                let meant = did_you_mean(name, names);
                return Err(usage!("chaos has no `{name}`{meant}; there are {}", names.join(", ")));
            };
            let slot = if name == "kill" { &mut spec.kill } else { &mut spec.stop };
            if slot.replace(Injection::parse(name, value, usual)?).is_some() {
                return Err(usage!("`{name}` is there twice"));
            }
        }
        Ok(spec)
    }
}

impl Injection {
    fn parse(name: &str, value: &str, usual: Duration) -> Result<Injection> {
        let (probability, time) =
            value.split_once(':').map_or((value, None), |(probability, time)| (probability, Some(time)));
        let probability = match probability.trim().parse::<f64>() {
            // Adding zero turns -0 into 0.
            Ok(probability) if (0.0..=1.0).contains(&probability) => probability + 0.0,
            _ => {
                return Err(usage!(
                    "`{name}` is {:?}, expected a probability from 0 to 1",
                    probability.trim()
                ));
            }
        };
        let absence = time.map_or(Ok(usual), |time| {
            parse_duration(time.trim()).filter(|time| !time.is_zero() && *time <= LONGEST).ok_or_else(|| {
                usage!(
                    "`{name}` is for {:?}, expected a time up to {LONGEST:?}, such as 200ms or 1.5s",
                    time.trim()
                )
            })
        })?;
        Ok(Injection { probability, absence })
    }

    /// The ticks that an agent misses, if one takes so long: one at least.
    pub(super) fn ticks(&self, tick: Duration) -> u32 {
        (self.absence.as_secs_f64() / tick.as_secs_f64()).round().max(1.0) as u32
    }
}

/// Reads a time such as `200ms` or `1.5s`.
pub(crate) fn parse_duration(text: &str) -> Option<Duration> {
    let units = [("ms", 1e-3), ("us", 1e-6), ("s", 1.0)];
    let (number, unit) =
        units.iter().find_map(|(unit, seconds)| Some((text.strip_suffix(unit)?, *seconds)))?;
    Duration::try_from_secs_f64(number.trim_end().parse::<f64>().ok()? * unit).ok()
}

impl fmt::Display for ChaosSpec {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let given = self.injections().into_iter().filter_map(|(name, injection)| Some((name, injection?)));
        let faults = given.map(|(name, Injection { probability, absence })| {
            format!("{name}={probability}:{}ms", absence.as_secs_f64() * 1e3)
        });
        f.write_str(&faults.collect::<Vec<_>>().join(","))
    }
}

impl TryFrom<String> for ChaosSpec {
    type Error = Error;

    fn try_from(text: String) -> Result<ChaosSpec> {
        text.parse()
    }
}

impl From<ChaosSpec> for String {
    fn from(chaos: ChaosSpec) -> String {
        chaos.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chaos_is_read_as_it_is_written() {
        let spec: ChaosSpec = "kill=0.01, stop = 0.005 : 1.5s".parse().unwrap();
        assert_eq!(spec.to_string(), "kill=0.01:500ms,stop=0.005:1500ms");
        assert_eq!(spec.to_string().parse::<ChaosSpec>().unwrap(), spec);
        let [kill, stop] = [spec.kill.unwrap(), spec.stop.unwrap()];
        let tick = Duration::from_millis(100);
        assert_eq!((kill.ticks(tick), stop.ticks(tick)), (5, 15));
        assert_eq!(kill.ticks(Duration::from_secs(10)), 1, "nobody is gone for no tick");
    }

    #[test]
    fn what_is_no_chaos_is_refused_by_name() {
        for (wrong, word) in [
            ("kill", "NAME=PROBABILITY"),
            ("", "NAME=PROBABILITY"),
            ("kil=0.1", "`kill`"),
            ("kill=2", "from 0 to 1"),
            ("stop=nan", "from 0 to 1"),
            ("stop=0.1:200", "200ms"),
            ("stop=0.1:0ms", "200ms"),
            ("stop=0.1:-1s", "200ms"),
            ("stop=0.1:2000s", "200ms"),
            ("kill=0.1,kill=0.2", "twice"),
        ] {
            let error = wrong.parse::<ChaosSpec>().unwrap_err().to_string();
            assert!(error.contains(word), "{wrong}: {error}");
        }
    }
}
