//! The registry: every model of links that has a name.

use std::path::Path;
use std::sync::Arc;

use super::{CommunicationMatrix, Link, asymmetric, delay, gilbert, level, matrix, uniform};
use crate::base::error::Result;
#[cfg(feature = "cli")]
use crate::base::table::wrapped;
use crate::usage;

/// The models, in the order in which help and documentation name them.
pub static MODELS: &[Model] = &[
    level::MODEL,
    matrix::MODEL,
    uniform::MODEL,
    asymmetric::ASYMMETRIC,
    asymmetric::DYNAMIC,
    gilbert::MODEL,
    delay::MODEL,
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
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// What it is called.
    pub name: &'static str,
    /// What it may be.
    pub domain: Domain,
    /// Its value if none is given.
    pub default: Option<f64>,
}

/// What a parameter may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain {
    /// A number of this kind, from the least to the most.
    Number(&'static str, f64, f64),
    /// A whole number of this kind, from the least to the most.
    Whole(&'static str, f64, f64),
    /// A file with a [`CommunicationMatrix`].
    Matrix,
}

/// What a parameter is.
#[derive(Clone, Debug, PartialEq)]
pub enum Argument {
    /// A number.
    Number(f64),
    /// A matrix that has been read.
    Matrix(Arc<CommunicationMatrix>),
}

impl Model {
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
            Domain::Matrix => CommunicationMatrix::read(Path::new(text), agents)
                .map(|matrix| Argument::Matrix(Arc::new(matrix))),
        }
    }
}

impl Argument {
    /// The number.
    ///
    /// # Panics
    /// If its parameter is none.
    pub fn number(&self) -> f64 {
        match self {
            Argument::Number(value) => *value,
            Argument::Matrix(_) => panic!("the parameter is a matrix"),
        }
    }

    /// The matrix.
    ///
    /// # Panics
    /// If its parameter is none.
    pub fn matrix(&self) -> &Arc<CommunicationMatrix> {
        match self {
            Argument::Matrix(matrix) => matrix,
            Argument::Number(_) => panic!("the parameter is a number"),
        }
    }
}

/// What `--links` takes, for people.
#[cfg(feature = "cli")]
pub fn help() -> String {
    let widest = MODELS.iter().map(|model| model.signature().len()).max().unwrap_or_default();
    let line = |model: &Model| format!("  {:<widest$}  {}", model.signature(), model.about);
    let lines: Vec<String> = MODELS.iter().map(|model| wrapped(&line(model), widest + 4)).collect();
    format!(
        "Links, alone or in a chain such as 'gilbert(0.1, 0.3) + delay(1, 1)', which\ndelivers what all its links \
         deliver:\n{}",
        lines.join("\n")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_model_is_named_once_and_its_defaults_come_last() {
        let names: BTreeSet<&str> = MODELS.iter().map(|model| model.name).collect();
        assert_eq!(names.len(), MODELS.len());
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
