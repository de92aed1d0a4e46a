//! Axes: links of which one parameter takes several values.

use std::path::Path;

use serde::Serialize;

use super::condition::Condition;
use super::grouping::distinct;
use crate::base::error::Result;
use crate::link::{LinkSpec, Site};
use crate::usage;

/// Links of which one parameter takes several values, such as `gilbert(loss=0.8, burst=[5, 10, 20])`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// The links, as they were given.
    pub links: String,
    /// What the parameter is called.
    pub parameter: String,
    /// Value by value, in the order in which they were given. Others are compared with the first.
    pub points: Vec<AxisPoint>,
}

/// A value of the parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisPoint {
    /// The value.
    pub value: f64,
    /// The links that have it.
    pub condition: Condition,
}

impl Axis {
    /// The axis that a text says; `None` for links without a list of values.
    ///
    /// # Errors
    /// `Usage` if there are several lists, a list of anything but two or more different numbers, or links that do not
    /// exist.
    pub fn parse(text: &str, site: impl Into<Site>) -> Result<Option<Axis>> {
        let (text, site) = (text.trim(), site.into());
        // A path may hold anything.
        if !text.contains('[') || Path::new(text).is_file() || LinkSpec::parse(text, site).is_ok() {
            return Ok(None);
        }
        Axis::of_list(text, site).map(Some).map_err(|e| usage!("links `{text}`: {e}"))
    }

    fn of_list(text: &str, site: Site) -> Result<Axis> {
        let list = text.split_once('[').and_then(|(before, rest)| {
            let (list, behind) = rest.split_once(']')?;
            Some((before, list, behind))
        });
        let (before, list, behind) =
            list.ok_or_else(|| usage!("a `]` is missing after the list of values"))?;
        if behind.contains('[') {
            return Err(usage!("only one parameter may have a list of values"));
        }
        let condition = |value: &str| Condition::parse(&format!("{before}{}{behind}", value.trim()), site);
        let conditions: Vec<Condition> = list.split(',').map(condition).collect::<Result<_>>()?;
        let numbers: Vec<_> = conditions.iter().map(|condition| condition.links().numbers()).collect();
        // The one in which they differ. A list may hold models instead, which have other parameters.
        let names = |of: &[(&'static str, f64)]| of.iter().map(|(name, _)| *name).collect::<Vec<_>>();
        let alike = numbers.iter().all(|of| names(of) == names(&numbers[0]));
        let different = distinct(conditions.iter()).len() == conditions.len();
        let varies = |at: &usize| numbers.iter().any(|of| of[*at] != numbers[0][*at]);
        let at = (alike && different).then(|| (0..numbers[0].len()).find(varies)).flatten();
        let at = at.ok_or_else(|| usage!("`[{list}]` is not a list of two or more different numbers"))?;
        let points = conditions.into_iter().zip(&numbers);
        Ok(Axis {
            links: text.to_owned(),
            parameter: numbers[0][at].0.to_owned(),
            points: points.map(|(condition, of)| AxisPoint { value: of[at].1, condition }).collect(),
        })
    }

    /// The same axis for two teams.
    ///
    /// # Errors
    /// `Usage` if the links differ between them.
    pub(crate) fn and(self, other: Axis) -> Result<Axis> {
        if self == other {
            return Ok(self);
        }
        Err(usage!(
            "{} means different links for these teams, since their sizes or step lengths differ",
            self.links
        ))
    }

    /// Whether these links are on it.
    pub fn has(&self, condition: &Condition) -> bool {
        self.points.iter().any(|point| point.condition == *condition)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(text: &str) -> Axis {
        Axis::parse(text, Site { agents: 2, tick: Some(0.1) }).unwrap().unwrap()
    }

    fn values(text: &str) -> (String, Vec<f64>) {
        let axis = axis(text);
        (axis.parameter, axis.points.into_iter().map(|point| point.value).collect())
    }

    #[test]
    fn one_parameter_may_be_a_list() {
        for (text, parameter, found) in [
            ("gilbert(loss=0.8, burst=[5,10, 20])", "burst", vec![5.0, 10.0, 20.0]),
            ("delay([0,2,8], 0) + level(0.5)", "ticks", vec![0.0, 2.0, 8.0]),
            ("range([0.5,2], noise_floor=-20)", "max", vec![0.5, 2.0]),
            ("level([1, 0.2])", "p", vec![1.0, 0.2]),
            // In ticks of 100 ms.
            ("loss 20% delay [0,50,300]ms", "ticks", vec![0.0, 0.5, 3.0]),
        ] {
            assert_eq!(values(text), (parameter.to_owned(), found), "{text}");
        }
        let axis = axis("gilbert(loss=0.8, burst=[5,10])");
        assert_eq!(axis.points[1].condition.to_string(), "gilbert(loss=0.8, burst=10)");
        assert!(axis.has(&Condition::parse("gilbert(burst=5, loss=0.8)", 2).unwrap()));
        assert_eq!(Axis::parse("delay(2)", 2).unwrap(), None);
    }

    #[test]
    fn lists_that_are_no_axis_are_refused() {
        for (text, words) in [
            ("gilbert(loss=[0.5,0.8], burst=[5,10])", "only one parameter may have a list"),
            ("delay([1,2)", "a `]` is missing"),
            ("delay([1])", "`[1]` is not a list of two or more different numbers"),
            ("delay([1,1.0])", "`1.0` is not a whole number"),
            ("latency([1,1.0])", "`[1,1.0]` is not a list"),
            ("budget(64, [turns,priority])", "is not a list of two or more different numbers"),
            ("gilbert(loss=0.8, burst=[2,10])", "burst must be at least"),
            ("delay([])", "`ticks` is missing"),
            ("[level(0.5),uniform]", "is not a list of two or more different numbers"),
            ("[level(0.5),delay(2)]", "is not a list of two or more different numbers"),
            ("delay(1) + [level(0.5),uniform]", "is not a list of two or more different numbers"),
            ("delei([1,2])", "nearest is `delay`"),
        ] {
            let error = Axis::parse(text, 2).unwrap_err().to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
