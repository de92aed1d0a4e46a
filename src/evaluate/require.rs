//! Requirements: what a team must reach, for a CI to check.

use std::fmt;

use super::condition::Condition;
use super::summary::{CellSummary, Group, Interval, Summary};
use crate::base::error::Result;
use crate::link::Site;
use crate::usage;

/// `CONDITION [imputer=NAME] METRIC>=BOUND`, such as `p=0.2 score>=0.9`. It is met if the low end of the 95 %
/// interval reaches the bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Requirement {
    /// How links behave.
    pub condition: Condition,
    /// The imputer; `None` for that which a swarm uses by itself.
    pub imputer: Option<String>,
    /// What is looked at.
    pub metric: Metric,
    /// What it must reach.
    pub bound: f64,
}

/// What a requirement looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// Normalised score.
    Score,
    /// Mean return.
    Return,
    /// Interquartile mean of the returns.
    Iqm,
}

/// What came of a requirement for one group.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Task and label of the group.
    pub group: String,
    /// The requirement.
    pub requirement: Requirement,
    /// What was found; `None` if there is no score, as of policies that are no better than uniform actions.
    pub found: Option<Interval>,
}

impl Requirement {
    /// Reads a requirement of a team.
    ///
    /// # Errors
    /// `Usage` if it is none.
    pub fn parse(text: &str, site: impl Into<Site>) -> Result<Requirement> {
        let site = site.into();
        let wrong = |why: &str| {
            usage!(
                "{text:?} is not a requirement{why}; write one like 'p=0.2 score>=0.9' or 'dynamic imputer=maro return>=-40'"
            )
        };
        let (rest, bound) = text.rsplit_once(">=").ok_or_else(|| wrong(""))?;
        let (rest, metric) = rest.trim().rsplit_once(char::is_whitespace).ok_or_else(|| wrong(""))?;
        let metrics = [Metric::Score, Metric::Return, Metric::Iqm];
        let metric = metrics.into_iter().find(|known| known.name() == metric).ok_or_else(|| wrong(""))?;
        let bound = bound.trim().parse().ok().filter(|bound: &f64| bound.is_finite());
        let named = rest.rsplit_once("imputer").and_then(|(condition, name)| {
            Some((condition, name.trim_start().strip_prefix('=')?.trim().to_owned()))
        });
        let (condition, imputer) = named.map_or((rest, None), |(condition, name)| (condition, Some(name)));
        if imputer.as_ref().is_some_and(|name| name.is_empty() || name.contains(char::is_whitespace)) {
            return Err(wrong(""));
        }
        let condition = condition.trim();
        let level = condition.strip_prefix('p').and_then(|rest| rest.trim_start().strip_prefix('='));
        let condition = match level.unwrap_or(condition).trim().parse() {
            Ok(p) => Condition::level(p),
            Err(_) if ["kill=", "stop="].iter().any(|chaos| condition.starts_with(chaos)) => {
                Condition::parse_chaos(condition, site)
            }
            Err(_) => Condition::parse(condition, site),
        };
        let condition = condition.map_err(|error| wrong(&format!(": {error}")))?;
        Ok(Requirement { condition, imputer, metric, bound: bound.ok_or_else(|| wrong(""))? })
    }

    /// Whether it can only be checked where p = 1 was played.
    pub fn needs_lossless(&self) -> bool {
        self.metric == Metric::Score
    }

    /// Holds it against every group. It must say which imputer it is about.
    pub fn check(&self, summary: &Summary) -> Vec<Verdict> {
        let check = |group: &Group| {
            let mut imputers = group.imputers.iter();
            let imputer = imputers.find(|imputer| Some(&imputer.imputer) == self.imputer.as_ref());
            let cell = imputer
                .and_then(|imputer| imputer.cells.iter().find(|cell| cell.condition == self.condition));
            Verdict {
                group: format!("{} {}", group.task, group.label),
                requirement: self.clone(),
                found: cell.and_then(|cell| self.metric.of(cell)),
            }
        };
        summary.groups.iter().map(check).collect()
    }
}

impl Verdict {
    /// Whether the requirement is met.
    pub fn is_met(&self) -> bool {
        self.found.is_some_and(|found| found.low >= self.requirement.bound)
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Verdict { group, requirement, found } = self;
        match found {
            None => write!(f, "{group}: {requirement}: no score, no better than uniform actions at p = 1"),
            Some(Interval { value, low, high }) => {
                let verdict = if self.is_met() { "met" } else { "not met" };
                write!(f, "{group}: {requirement}: {verdict}, {value:.4} [{low:.4}, {high:.4}]")
            }
        }
    }
}

impl Metric {
    fn of(self, cell: &CellSummary) -> Option<Interval> {
        match self {
            Metric::Score => cell.score,
            Metric::Return => Some(cell.mean),
            Metric::Iqm => Some(cell.iqm),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Metric::Score => "score",
            Metric::Return => "return",
            Metric::Iqm => "iqm",
        }
    }
}

impl fmt::Display for Requirement {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} ", self.condition)?;
        if let Some(imputer) = &self.imputer {
            write!(f, "imputer={imputer} ")?;
        }
        write!(f, "{}>={}", self.metric.name(), self.bound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Requirement {
        Requirement::parse(text, 2).unwrap()
    }

    #[test]
    fn requirements_are_read_as_they_are_written() {
        let score = parse("p=0.2 score>=0.9");
        let expected = Requirement {
            condition: Condition::level(0.2).unwrap(),
            imputer: None,
            metric: Metric::Score,
            bound: 0.9,
        };
        assert_eq!(score, expected);
        assert_eq!(parse(" p = .2   score >= 0.90 "), expected);
        let mode = parse("dynamic imputer=maro return>=-40");
        assert_eq!((mode.condition.name(), mode.imputer.as_deref()), ("dynamic", Some("maro")));
        for text in [
            "p=0.2 score>=0.9",
            "dynamic imputer=maro return>=-40",
            "p=0 iqm>=-1.5",
            "gilbert(0.1, 0.3) + delay(1, 1) imputer=hold score>=0.5",
            "kill=0.1:500ms at p=0.2 imputer=hold score>=0.5",
        ] {
            assert_eq!(parse(text).to_string(), text);
        }
        for wrong in [
            "",
            "p=0.2",
            "p=2 score>=0",
            "p=x score>=0",
            "score>=0.9",
            "p=0.2 score>0.9",
            "p=0.2 luck>=1",
            "p=0.2 score>=nan",
            "p=0.2 score>=0.9 more",
            "p=0.2 imputer= score>=0.9",
            "often score>=1",
        ] {
            assert!(Requirement::parse(wrong, 2).is_err(), "{wrong}");
        }
    }

    #[test]
    fn wrong_links_say_what_would_be_right() {
        let error = Requirement::parse("gilbret(0.1, 0.3) score>=0.5", 2).unwrap_err().to_string();
        assert!(error.contains("is not a requirement") && error.contains("nearest is `gilbert`"), "{error}");
    }

    #[test]
    fn the_low_end_of_the_interval_decides() {
        let verdict = |low: f64| Verdict {
            group: "hear-see mappo".to_owned(),
            requirement: parse("p=0.2 imputer=maro score>=0.9"),
            found: Some(Interval { value: 0.95, low, high: 1.0 }),
        };
        assert!(verdict(0.9).is_met() && !verdict(0.899).is_met());
        assert_eq!(
            verdict(0.899).to_string(),
            "hear-see mappo: p=0.2 imputer=maro score>=0.9: not met, 0.9500 [0.8990, 1.0000]"
        );
        let nothing = Verdict { found: None, ..verdict(1.0) };
        assert!(!nothing.is_met());
    }
}
