//! One model with its arguments, as it is written: `gilbert(0.1, r=0.3)`.

use std::fmt;
use std::path::Path;

use super::registry::{Argument, MODELS, Model, Parameter};
use super::{Link, Links};
use crate::base::error::{Error, Result};
use crate::usage;

/// A model of the registry, and one argument for each of its parameters.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub model: &'static Model,
    pub arguments: Vec<Argument>,
}

impl Part {
    /// Reads a name, and arguments in parentheses, for a team of so many.
    pub fn read(text: &str, agents: usize) -> Result<Part> {
        let (name, inside) = match text.split_once('(') {
            None => (text, None),
            Some((name, rest)) => match rest.strip_suffix(')') {
                Some(inside) => (name.trim_end(), Some(inside)),
                None => return Err(usage!("links `{text}`: a `)` is missing at the end")),
            },
        };
        let inside = inside.unwrap_or_default();
        let named: Vec<&Model> = MODELS.iter().filter(|model| model.name == name).collect();
        let fits = named.iter().find(|model| model.fits(&split(inside, ',')));
        let model = *fits.or(named.first()).ok_or_else(|| unknown(name))?;
        let arguments = read(model, inside, agents).map_err(|e| {
            let signatures: Vec<String> = named.iter().map(|model| model.signature()).collect();
            usage!("links `{text}`: {e}; expected {}: {}", signatures.join(" or "), model.about)
        })?;
        let part = Part { model, arguments };
        let alone = part.build().and_then(|link| Links::chain(vec![link]));
        alone.map_err(|e| usage!("links `{text}`: {e}"))?;
        Ok(part)
    }

    /// The link, as it is before the first episode.
    pub fn build(&self) -> Result<Box<dyn Link>> {
        (self.model.build)(&self.arguments)
    }
}

impl PartialEq for Part {
    fn eq(&self, other: &Part) -> bool {
        let signature = |part: &Part| (part.model.name, part.model.parameters);
        signature(self) == signature(other) && self.arguments == other.arguments
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Part { model, arguments } = self;
        let written = model.parameters.iter().zip(arguments).filter_map(|(parameter, argument)| {
            let value = match argument {
                Argument::Number(value) => value.to_string(),
                Argument::Word(word) => (*word).to_owned(),
                Argument::Log(log) => log.path().to_owned(),
                Argument::Matrix(_) => return None,
            };
            let named = || format!("{}={value}", parameter.name);
            Some(model.is_second().then(named).unwrap_or(value))
        });
        let written: Vec<String> = written.collect();
        f.write_str(model.name)?;
        if written.is_empty() { Ok(()) } else { write!(f, "({})", written.join(", ")) }
    }
}

/// The arguments of a model: one for each parameter, in order.
fn read(model: &Model, text: &str, agents: usize) -> Result<Vec<Argument>> {
    let mut found: Vec<Option<&str>> = vec![None; model.parameters.len()];
    let written = match model.parameters {
        _ if text.trim().is_empty() => Vec::new(),
        // A path may hold anything.
        [Parameter { domain, .. }] if domain.is_file() => vec![text.trim()],
        _ if text.contains('[') => {
            return Err(usage!("a list of values, as in `{text}`, is for `evaluate --links` alone"));
        }
        _ => split(text, ','),
    };
    for (at, written) in written.into_iter().enumerate() {
        let named = written.split_once('=').map(|(name, value)| (name.trim(), value.trim()));
        let position = |name: &str| model.parameters.iter().position(|parameter| parameter.name == name);
        let (at, value) = match named.map(|(name, value)| (position(name), name, value)) {
            Some((Some(at), _, value)) => (at, value),
            Some((None, name, _)) if !Path::new(written).is_file() => {
                return Err(usage!("there is no parameter `{name}`"));
            }
            _ => (at, written),
        };
        match found.get_mut(at) {
            None => return Err(usage!("`{value}` is one argument too many")),
            Some(Some(_)) => return Err(usage!("`{}` is given twice", model.parameters[at].name)),
            Some(free) => *free = Some(value),
        }
    }
    let argument =
        |(Parameter { name, domain, default }, text): (&Parameter, Option<&str>)| match (text, default) {
            (Some(text), _) => domain.read(text, agents).map_err(|e| usage!("{name}: {e}")),
            (None, Some(default)) => domain.read(default, agents),
            (None, None) => Err(usage!("`{name}` is missing")),
        };
    model.parameters.iter().zip(found).map(argument).collect()
}

/// The parts between separators that do not stand in parentheses, without blanks around them.
pub(super) fn split(text: &str, separator: char) -> Vec<&str> {
    let mut depth = 0usize;
    let parts = text.split(move |character| {
        match character {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            _ => {}
        }
        character == separator && depth == 0
    });
    parts.map(str::trim).collect()
}

fn unknown(name: &str) -> Error {
    let signatures: Vec<String> = MODELS.iter().map(Model::signature).collect();
    let signatures = signatures.join(", ");
    if name.is_empty() {
        return usage!("a model of links is missing; there are {signatures}, or give a file with a matrix");
    }
    let likeness = |model: &&Model| strsim::jaro_winkler(name, model.name);
    let nearest = MODELS.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b))).expect("there are models");
    usage!(
        "there are no links `{name}`, and no file of that name; the nearest is `{}`, and there are {signatures}",
        nearest.name
    )
}
