//! What a run must keep to: `spawn --require 'missed<=0.001'`.

use std::fmt;
use std::str::FromStr;

use super::summary::Outcome;
use crate::base::error::{Error, Result};
use crate::base::nearest::did_you_mean;
use crate::usage;

/// `METRIC<=BOUND` or `METRIC>=BOUND`.
#[derive(Clone, Debug)]
pub(super) struct Requirement {
    metric: &'static Metric,
    relation: Relation,
    bound: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Relation {
    AtMost,
    AtLeast,
}

/// What can be looked at, in a run in which it means something.
#[derive(Debug)]
struct Metric {
    name: &'static str,
    of: fn(&Outcome) -> Option<f64>,
}

const METRICS: [Metric; 8] = [
    Metric { name: "return", of: |outcome| Some(outcome.statistics.return_mean()) },
    Metric { name: "delivered", of: |outcome| outcome.statistics.delivery_rate() },
    Metric { name: "late", of: |outcome| outcome.statistics.late_rate() },
    Metric { name: "missed", of: |outcome| Some(outcome.statistics.missed_rate()) },
    Metric { name: "absent", of: |outcome| Some(outcome.statistics.absent_rate()) },
    Metric { name: "deaths", of: |outcome| outcome.faults.map(|faults| faults.deaths as f64) },
    Metric { name: "hangs", of: |outcome| outcome.faults.map(|faults| faults.hangs as f64) },
    Metric { name: "rate", of: |outcome| outcome.punctuality.map(|clock| clock.achieved_rate()) },
];

impl FromStr for Requirement {
    type Err = Error;

    fn from_str(text: &str) -> Result<Requirement> {
        let wrong =
            || usage!("{text:?} is not a requirement; write one like 'missed<=0.001' or 'return>=-40'");
        let relations = [("<=", Relation::AtMost), (">=", Relation::AtLeast)];
        let parts = relations.into_iter().find_map(|(sign, relation)| {
            text.split_once(sign).map(|(name, bound)| (name.trim(), relation, bound))
        });
        let (name, relation, bound) = parts.ok_or_else(wrong)?;
        let metric = METRICS.iter().find(|metric| metric.name == name).ok_or_else(|| {
            let names = METRICS.map(|metric| metric.name);
            usage!(
                "{text:?}: there is no `{name}`{}; choose from {}",
                did_you_mean(name, names),
                names.join(", ")
            )
        })?;
        let bound = bound.trim().parse().ok().filter(|bound: &f64| bound.is_finite()).ok_or_else(wrong)?;
        Ok(Requirement { metric, relation, bound })
    }
}

impl Requirement {
    /// Why a run does not keep to it; `None` if it does.
    pub(super) fn failure(&self, outcome: &Outcome) -> Option<String> {
        let Some(found) = (self.metric.of)(outcome) else {
            return Some(format!("{self}: not met, this run has no `{}`", self.metric.name));
        };
        let met = match self.relation {
            Relation::AtMost => found <= self.bound,
            Relation::AtLeast => found >= self.bound,
        };
        (!met).then(|| format!("{self}: not met, {found:.4}"))
    }
}

/// An error that names what a run does not keep to, if there is anything.
pub(super) fn check(requirements: &[Requirement], outcome: &Outcome) -> Result<()> {
    let failures: Vec<String> = requirements.iter().filter_map(|one| one.failure(outcome)).collect();
    if failures.is_empty() { Ok(()) } else { Err(Error::Unmet(failures.join("; "))) }
}

impl fmt::Display for Requirement {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let sign = match self.relation {
            Relation::AtMost => "<=",
            Relation::AtLeast => ">=",
        };
        write!(f, "{}{sign}{}", self.metric.name, self.bound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::supervisor::{Faults, Statistics};

    #[test]
    fn requirements_are_read_as_they_are_written() {
        for text in ["missed<=0.001", "return>=-40", "deaths<=0", "rate>=99.5"] {
            assert_eq!(text.parse::<Requirement>().unwrap().to_string(), text);
        }
        assert_eq!(" late <= 0.10 ".parse::<Requirement>().unwrap().to_string(), "late<=0.1");
        for (wrong, word) in [
            ("missed", "not a requirement"),
            ("missed<0.1", "not a requirement"),
            ("missed<=often", "not a requirement"),
            ("misses<=1", "`missed`"),
        ] {
            let error = wrong.parse::<Requirement>().unwrap_err().to_string();
            assert!(error.contains(word), "{wrong}: {error}");
        }
    }

    #[test]
    fn what_is_not_kept_to_is_named_with_what_was_found() {
        let statistics = Statistics::default();
        let faults = Faults { deaths: 2, ..Faults::default() };
        let outcome = Outcome {
            statistics: &statistics,
            audit: None,
            punctuality: None,
            faults: Some(&faults),
            hosts: &[],
            injected: None,
            steered: None,
        };
        let requirements = ["deaths<=1", "hangs<=0", "rate>=100"].map(|text| text.parse().unwrap());
        let error = check(&requirements, &outcome).unwrap_err();
        assert!(matches!(error, Error::Unmet(_)));
        assert_eq!(
            error.to_string(),
            "deaths<=1: not met, 2.0000; rate>=100: not met, this run has no `rate`"
        );
        assert!(check(&requirements[1..2], &outcome).is_ok());
    }
}
