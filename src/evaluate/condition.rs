//! Conditions: how links behave in a cell, how agents are killed and stopped on purpose, and what that is called.

use std::fmt;
use std::path::Path;

use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};

use crate::base::error::Result;
use crate::link::{CommunicationMatrix, LinkSpec, RadioLog, Site};
use crate::supervisor::ChaosSpec;

/// How links behave in a cell, and how agents are killed and stopped on purpose.
#[derive(Clone, Debug, PartialEq)]
pub struct Condition {
    links: LinkSpec,
    chaos: Option<ChaosSpec>,
    /// `p=0.2`, or the text of the links.
    name: String,
}

impl Condition {
    /// Every link delivers with this probability p.
    ///
    /// # Errors
    /// `Usage` if it is not a probability.
    pub fn level(p: f64) -> Result<Condition> {
        // Adding zero turns -0 into 0.
        LinkSpec::level(p + 0.0).map(|links| Condition { name: format!("p={}", p + 0.0), links, chaos: None })
    }

    /// The links that a text says, as `spawn --links` takes it.
    ///
    /// # Errors
    /// `Usage` if it says none.
    pub fn parse(text: &str, site: impl Into<Site>) -> Result<Condition> {
        let (text, links) = (text.trim(), LinkSpec::parse(text, site)?);
        let name = match links.p() {
            Some(p) => return Condition::level(p),
            None if links.matrix().is_some() && Path::new(text).is_file() => format!("matrix({text})"),
            // Links do not know the files of their matrices.
            None if links.matrices().next().is_some() => text.to_owned(),
            None => links.to_string(),
        };
        Ok(Condition { links, chaos: None, name })
    }

    /// What befalls agents, as `spawn --chaos` takes it, where everything is delivered; with ` at ` behind it, where links
    /// behave as this text says: `kill=0.01 at p=0.2`, `kill=0.01 at dynamic`.
    ///
    /// # Errors
    /// `Usage` if it says nothing.
    pub fn parse_chaos(text: &str, site: impl Into<Site>) -> Result<Condition> {
        let (chaos, links) = text.split_once(" at ").unwrap_or((text, "p=1"));
        let chaos: ChaosSpec = chaos.parse()?;
        let level = links.trim().strip_prefix("p=").and_then(|p| p.trim().parse().ok());
        let condition = level.map_or_else(|| Condition::parse(links, site), Condition::level)?;
        let name = format!("{chaos} at {condition}");
        Ok(Condition { chaos: Some(chaos), name, ..condition })
    }

    /// The links that behave so.
    pub fn links(&self) -> &LinkSpec {
        &self.links
    }

    /// How agents are killed and stopped on purpose.
    pub fn chaos(&self) -> Option<ChaosSpec> {
        self.chaos
    }

    /// p, if all links share one and agents are left alone.
    pub fn p(&self) -> Option<f64> {
        self.links.p().filter(|_| self.chaos.is_none())
    }

    /// `level`, or the text of the links.
    pub fn name(&self) -> &str {
        if self.p().is_some() { "level" } else { &self.name }
    }

    /// Whether everything is delivered, always.
    pub fn is_lossless(&self) -> bool {
        self.p() == Some(1.0)
    }
}

/// `p=0.2`, or the text of the links.
impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.name)
    }
}

/// `{"level": 0.2}`, the text of the links and of what befalls the agents, or that and what tells its files apart: the
/// matrices themselves, and fingerprints of logs.
impl Serialize for Condition {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let matrices: Vec<_> = self.links.matrices().map(CommunicationMatrix::to_rows).collect();
        let logs: Vec<_> = self.links.logs().map(RadioLog::fingerprint).collect();
        if let Some(p) = self.p() {
            serializer.serialize_newtype_variant("Condition", 0, "level", &p)
        } else if matrices.is_empty() && logs.is_empty() {
            serializer.serialize_str(&self.name)
        } else {
            let mut object = serializer.serialize_struct("Condition", 3)?;
            object.serialize_field("links", &self.name)?;
            if !matrices.is_empty() {
                object.serialize_field("matrices", &matrices)?;
            }
            if !logs.is_empty() {
                object.serialize_field("logs", &logs)?;
            }
            object.end()
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{json, to_value};

    use super::*;

    fn parse(text: &str) -> Condition {
        Condition::parse(text, 2).unwrap()
    }

    #[test]
    fn links_that_behave_alike_are_one_condition_however_they_are_written() {
        assert_eq!(parse(" level( p=0.20 ) "), Condition::level(0.2).unwrap());
        assert_eq!(parse("gilbert(0.1,0.3)+delay(1)"), parse("gilbert(p=0.1, r=0.3) + delay(1, 0)"));
        assert_ne!(parse("delay(1)"), parse("delay(2)"));
        assert_eq!(Condition::level(-0.0).unwrap().to_string(), "p=0");
        assert!(Condition::level(1.5).is_err() && Condition::level(f64::NAN).is_err());
    }

    #[test]
    fn a_condition_is_called_and_written_by_its_level_or_its_links() {
        for (condition, shown, name, written) in [
            (parse("level(0.2)"), "p=0.2", "level", json!({"level": 0.2})),
            (parse("dynamic"), "dynamic", "dynamic", json!("dynamic")),
            (
                parse("uniform+delay(1)"),
                "uniform + delay(1, 0)",
                "uniform + delay(1, 0)",
                json!("uniform + delay(1, 0)"),
            ),
        ] {
            assert_eq!((&condition.to_string()[..], condition.name()), (shown, name));
            assert_eq!(to_value(condition).unwrap(), written);
        }
        assert!(parse("level(1)").is_lossless() && !parse("delay(0)").is_lossless());
    }

    #[test]
    fn chaos_comes_with_any_links_and_is_no_level() {
        let chaos = |text| Condition::parse_chaos(text, 2).unwrap();
        let alone = chaos("kill=0.01");
        assert_eq!((alone.p(), alone.is_lossless()), (None, false));
        assert_eq!(to_value(&alone).unwrap(), json!("kill=0.01:500ms at p=1"));
        assert_eq!(chaos("stop=0.1:1s at p=0.2").name(), "stop=0.1:1000ms at p=0.2");
        assert_eq!(
            chaos("kill=0.01, stop=0.1 at dynamic").to_string(),
            "kill=0.01:500ms,stop=0.1:200ms at dynamic"
        );
        assert_ne!(chaos("kill=0.01 at p=0.2"), alone);
        assert!(Condition::parse_chaos("kill=0.01 at often", 2).is_err());
    }

    #[test]
    fn a_matrix_is_told_apart_by_its_file_and_by_what_is_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("who.txt");
        let file = file.to_str().unwrap();
        let of = |rows: &str, text: &str| {
            std::fs::write(file, rows).unwrap();
            parse(text)
        };
        let before = of("1 0.5\n1 1\n", file);
        assert_eq!(before.name(), format!("matrix({file})"));
        assert_eq!(
            to_value(&before).unwrap(),
            json!({"links": format!("matrix({file})"), "matrices": [[[1.0, 0.5], [1.0, 1.0]]]})
        );
        assert_ne!(of("1 0\n1 1\n", file), before);
        assert_eq!(of("1 0.5\n1 1\n", &format!("matrix({file})")), before);
        assert_eq!(parse(&format!("matrix({file}) + delay(1)")).name(), format!("matrix({file}) + delay(1)"));
    }
}
