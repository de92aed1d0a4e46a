//! Settings from one place, before they are a configuration.

use std::path::Path;

use toml::{Table, Value};

use crate::base::error::{Error, Result};
use crate::base::regular;
use crate::usage;

/// The most bytes a file of settings may have.
const LARGEST: u64 = 1 << 20;

/// Settings from one place: a file, or the command line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    pub(super) source: String,
    pub(super) table: Table,
}

impl Layer {
    /// An empty one; errors about its settings begin with `source`.
    pub fn new(source: &str) -> Layer {
        Layer { source: source.to_owned(), table: Table::new() }
    }

    /// The settings in a TOML file, or in a pipe.
    pub fn read(path: &Path) -> Result<Layer> {
        let text = regular::read_text_or_pipe(path, LARGEST)?;
        Layer::parse(&text, &path.display().to_string())
    }

    /// The settings in a TOML text.
    pub fn parse(text: &str, source: &str) -> Result<Layer> {
        let table = text.parse().map_err(|e| usage!("{source} is not TOML: {e}"))?;
        Ok(Layer { source: source.to_owned(), table })
    }

    /// Sets `key` to what `value` says in TOML; a word without quotes is one with quotes.
    pub fn set(&mut self, key: &str, value: &str) {
        let parsed = format!("value = {value}").parse::<Table>().ok();
        let parsed = parsed.and_then(|mut table| table.remove("value"));
        self.table.insert(key.to_owned(), parsed.unwrap_or_else(|| value.into()));
    }

    pub(super) fn refuse(&self, key: &str, error: &toml::de::Error) -> Error {
        // What the types of this program are called concerns nobody else.
        let mut words = error.message().to_owned();
        for (name, meaning) in [
            ("a boolean", "true or false"),
            ("f64", "a number"),
            ("u64", "a whole number, 0 or more"),
            ("usize", "a whole number, 0 or more"),
            ("a sequence", "a list"),
        ] {
            words = words.replace(&format!("expected {name}"), &format!("expected {meaning}"));
        }
        usage!("{}: `{key}`: {words}", self.source)
    }

    pub(super) fn unknown(&self, key: &str, known: &Table) -> Error {
        if self.table[key].is_table() {
            return usage!("{}: settings stand by themselves, not in a table like `[{key}]`", self.source);
        }
        let nearest = known
            .keys()
            .max_by(|a, b| strsim::jaro_winkler(key, a).total_cmp(&strsim::jaro_winkler(key, b)))
            .expect("there are settings");
        usage!("{}: there is no setting `{key}`; the nearest is `{nearest}`", self.source)
    }
}

/// A value in the type of the default, where there is one way to read it so: `1e6` is a whole number, `1` a
/// number, and `a,b` a list.
pub(super) fn like(default: &Value, value: Value) -> Value {
    match (default, value) {
        (Value::Integer(_), Value::Float(x)) if x.fract() == 0.0 && x.abs() < 9e15 => {
            Value::Integer(x as i64)
        }
        (Value::Float(_), Value::Integer(n)) => Value::Float(n as f64),
        (Value::Array(_), Value::String(list)) => {
            let list = if list == "none" { "" } else { &list };
            let items = list.split(',').map(str::trim).filter(|item| !item.is_empty());
            Value::Array(items.map(Value::from).collect())
        }
        (_, value) => value,
    }
}
