//! The registry: every model of links that has a name.

use std::path::Path;
use std::sync::Arc;

use super::{
    CommunicationMatrix, Link, RadioLog, asymmetric, budget, delay, gemodel, gilbert, jam, latency, level,
    matrix, range, tdma, trace, uniform,
};
use crate::base::error::Result;
#[cfg(feature = "cli")]
use crate::base::table::wrapped;
use crate::usage;

/// The models, in the order in which help and documentation name them. Two may share a name, with other parameters: the
/// first is meant unless only the second has the parameters that are given, and the second is written with their names.
pub static MODELS: &[Model] = &[
    level::MODEL,
    matrix::MODEL,
    uniform::MODEL,
    asymmetric::ASYMMETRIC,
    asymmetric::DYNAMIC,
    gilbert::MODEL,
    gilbert::BURSTS,
    gemodel::MODEL,
    delay::MODEL,
    latency::MODEL,
    range::MODEL,
    budget::MODEL,
    tdma::MODEL,
    jam::TIME,
    jam::PLACE,
    trace::MODEL,
];

/// A model of links as the registry knows it.
#[derive(Clone, Copy, Debug)]
pub struct Model {
    /// What it is called.
    pub name: &'static str,
    /// What it does, in one line.
    pub about: &'static str,
    /// Its parameters; those with a default come last.
    pub parameters: &'static [Parameter],
    /// Builds it from one argument for each parameter, each in its domain.
    ///
    /// # Errors
    /// `Usage` if the arguments do not go together.
    pub build: fn(&[Argument]) -> Result<Box<dyn Link>>,
}

/// A parameter of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// What it is called.
    pub name: &'static str,
    /// What it may be.
    pub domain: Domain,
    /// Its value if none is given, as one would write it.
    pub default: Option<&'static str>,
}

/// What a parameter may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain {
    /// A number of this kind, from the least to the most.
    Number(&'static str, f64, f64),
    /// A whole number of this kind, from the least to the most.
    Whole(&'static str, f64, f64),
    /// One of these words.
    Word(&'static [&'static str]),
    /// A file with a [`CommunicationMatrix`].
    Matrix,
    /// A file with a [`RadioLog`].
    Log,
}

/// What a parameter is.
#[derive(Clone, Debug, PartialEq)]
pub enum Argument {
    /// A number.
    Number(f64),
    /// One of the words of its domain.
    Word(&'static str),
    /// A matrix that has been read.
    Matrix(Arc<CommunicationMatrix>),
    /// A log that has been read.
    Log(Arc<RadioLog>),
}

impl Model {
    /// Whether another model is meant by its name where no parameters are named.
    pub(super) fn is_second(&self) -> bool {
        let first = MODELS.iter().find(|model| model.name == self.name).expect("it is a model");
        first.parameters != self.parameters
    }

    /// Whether these can be its arguments, as far as their number and names tell.
    pub(super) fn fits(&self, written: &[&str]) -> bool {
        let known = |name: &str| self.parameters.iter().any(|parameter| parameter.name == name.trim());
        let named = written.iter().filter_map(|argument| argument.split_once('='));
        written.len() <= self.parameters.len() && named.map(|(name, _)| name).all(known)
    }

    /// The name and its parameters: `gilbert(p, r)`.
    pub fn signature(&self) -> String {
        let parameters = self.parameters.iter().map(|parameter| match parameter.default {
            Some(default) => format!("{} = {default}", parameter.name),
            None => parameter.name.to_owned(),
        });
        match self.parameters {
            [] => self.name.to_owned(),
            _ => format!("{}({})", self.name, parameters.collect::<Vec<_>>().join(", ")),
        }
    }
}

impl Domain {
    /// A probability.
    pub const PROBABILITY: Domain = Domain::Number("probability", 0.0, 1.0);

    /// Reads an argument, for a team of so many.
    pub(super) fn read(&self, text: &str, agents: usize) -> Result<Argument> {
        match *self {
            Domain::Number(kind, least, most) => match text.parse() {
                Ok(value) if (least..=most).contains(&value) => Ok(Argument::Number(value)),
                _ => Err(usage!("`{text}` is not a {kind} from {least} to {most}")),
            },
            Domain::Whole(kind, least, most) => match text.parse::<u32>().map(f64::from) {
                Ok(value) if (least..=most).contains(&value) => Ok(Argument::Number(value)),
                _ => Err(usage!("`{text}` is not a whole number of {kind} from {least} to {most}")),
            },
            Domain::Word(words) => match words.iter().find(|word| **word == text) {
                Some(word) => Ok(Argument::Word(word)),
                None => Err(usage!("`{text}` is not {}", words.join(" or "))),
            },
            Domain::Matrix => CommunicationMatrix::read(Path::new(text), agents)
                .map(|matrix| Argument::Matrix(Arc::new(matrix))),
            Domain::Log => RadioLog::read(Path::new(text), agents).map(|log| Argument::Log(Arc::new(log))),
        }
    }

    /// Whether it is a file.
    pub(super) fn is_file(&self) -> bool {
        matches!(self, Domain::Matrix | Domain::Log)
    }
}

impl Argument {
    /// The number.
    ///
    /// # Panics
    /// If its parameter is of another kind.
    pub fn number(&self) -> f64 {
        match self {
            Argument::Number(value) => *value,
            other => panic!("the parameter is no number: {other:?}"),
        }
    }

    /// The word.
    ///
    /// # Panics
    /// If its parameter is of another kind.
    pub fn word(&self) -> &'static str {
        match self {
            Argument::Word(word) => word,
            other => panic!("the parameter is no word: {other:?}"),
        }
    }

    /// The matrix.
    ///
    /// # Panics
    /// If its parameter is of another kind.
    pub fn matrix(&self) -> &Arc<CommunicationMatrix> {
        match self {
            Argument::Matrix(matrix) => matrix,
            other => panic!("the parameter is no matrix: {other:?}"),
        }
    }

    /// The log.
    ///
    /// # Panics
    /// If its parameter is of another kind.
    pub fn log(&self) -> &Arc<RadioLog> {
        match self {
            Argument::Log(log) => log,
            other => panic!("the parameter is no log: {other:?}"),
        }
    }
}

/// What `--links` takes, for people.
#[cfg(feature = "cli")]
pub fn help() -> String {
    // Those with many parameters take a line for themselves.
    let widest = MODELS.iter().map(|model| model.signature().len()).filter(|width| *width < 30).max();
    let widest = widest.unwrap_or_default();
    let indent = widest + 4;
    let lines = MODELS.iter().map(|model| match model.signature() {
        long if long.len() > widest => {
            let about = format!("{:indent$}{}", "", model.about);
            format!("{}\n{}", wrapped(&format!("  {long}"), 4), wrapped(&about, indent))
        }
        short => wrapped(&format!("  {short:<widest$}  {}", model.about), indent),
    });
    let lines: Vec<String> = lines.collect();
    format!(
        "Links, alone or in a chain such as 'gilbert(0.1, 0.3) + delay(1, 1)'. A chain\ndelivers what all its links \
         deliver:\n{}\nOr netem's options, such as 'loss gemodel 10% 30% delay 20ms 5ms'.",
        lines.join("\n")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_model_can_be_told_from_others_and_its_defaults_come_last() {
        let signatures: BTreeSet<String> = MODELS.iter().map(Model::signature).collect();
        assert_eq!(signatures.len(), MODELS.len());
        for model in MODELS {
            let optional = model.parameters.iter().skip_while(|parameter| parameter.default.is_none());
            assert!(
                optional.into_iter().all(|parameter| parameter.default.is_some()),
                "{}",
                model.signature()
            );
        }
    }
}
