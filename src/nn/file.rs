//! The policy file, version 1: safetensors with a description in its metadata. See `docs/policy-file.md`.

use super::meta::Meta;
use super::networks::{ActorKind, Input, Networks, PredictorSpec};
use super::onnx::{Description, LARGEST_GRAPH, OnnxSpec};
use super::weights::Line;
use crate::base::error::{Error, Result};
use crate::base::file::AtomicFile;
use crate::dynamics::Dynamics;
use crate::{failed, usage};
use half::f16;
use memmap2::Mmap;
use safetensors::{Dtype, SafeTensors};
use serde::de::{DeserializeOwned, IntoDeserializer};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

const FORMAT: &str = "vamaro-swarm policy";
const VERSION: &str = "1";

/// What a policy file says of itself, read without its weights and without knowing the task.
#[derive(Clone, Debug)]
pub struct PolicyFile {
    /// Where it comes from.
    pub meta: Meta,
    /// What networks it holds.
    pub networks: Networks,
    /// The dynamics of the environment, if they have been fitted.
    pub dynamics: Option<Dynamics>,
    /// The dynamics of the physics that is played, where imputers are told them.
    pub(super) given: Option<Dynamics>,
    /// What its actors see and say, if they are ONNX files.
    pub onnx: Option<OnnxSpec>,
    /// Names, shapes and places of its tensors, by name.
    pub(crate) tensors: Vec<FileTensor>,
    /// Names and places of the ONNX files in it, by name; places in bytes from the first byte of all values.
    pub(crate) graphs: Vec<(String, Range<usize>)>,
    /// Where the values start, in bytes from the start of the file.
    pub(super) data: usize,
}

/// A tensor in a policy file.
#[derive(Clone, Debug, PartialEq)]
pub struct FileTensor {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// How its values are stored.
    pub precision: Precision,
    /// Its first byte, counted from the first byte of all values.
    pub(super) start: usize,
}

/// How values are stored. Networks always calculate in f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// f32: mapped, and used where it is.
    Full,
    /// f16: half the size, for keeping; mapped, and used where it is or converted, depending on the machine.
    Half,
}

impl PolicyFile {
    /// Reads the description in the policy file at `path`, or that of ONNX files, as if they were in one.
    ///
    /// # Errors
    /// `Usage` if there is no such file or it is not a policy of version 1, `Failed` if it is damaged.
    pub fn read(path: &Path) -> Result<PolicyFile> {
        match Description::read(path)? {
            Some(description) => Ok(PolicyFile {
                meta: description.meta(),
                networks: description.networks(),
                dynamics: None,
                given: None,
                onnx: Some(description.actor),
                tensors: Vec::new(),
                graphs: Vec::new(),
                data: 0,
            }),
            None => PolicyFile::parse(&map(path)?, &path.display().to_string()),
        }
    }

    /// Whether it is not a policy file itself, but describes ONNX files.
    pub(crate) fn is_description(&self) -> bool {
        self.onnx.is_some() && self.graphs.is_empty()
    }

    /// How all its values are stored, if they are stored alike, and no ONNX files behind them.
    pub(super) fn precision(&self) -> Option<Precision> {
        if !self.graphs.is_empty() {
            return None;
        }
        let mut precisions = self.tensors.iter().map(|tensor| tensor.precision);
        let first = precisions.next()?;
        precisions.all(|other| other == first).then_some(first)
    }

    /// The description in `bytes`, the content of a file that errors call `source`.
    pub(super) fn parse(bytes: &[u8], source: &str) -> Result<PolicyFile> {
        let (header, content) = SafeTensors::read_metadata(bytes)
            .map_err(|error| failed!("{source} is damaged, or not a policy file: {error}"))?;
        let none = HashMap::new();
        let words = Words { words: content.metadata().as_ref().unwrap_or(&none), source };
        let (meta, networks) = words.read()?;
        let (dynamics, given) = (words.json("dynamics")?, words.json("given")?);
        let onnx = match networks.actor {
            ActorKind::Onnx => Some(OnnxSpec::from_json(words.text("onnx")?, source)?),
            ActorKind::Mlp | ActorKind::Gru => None,
        };

        let (mut tensors, mut graphs) = (Vec::new(), Vec::new());
        for (name, info) in content.tensors() {
            let precision = match info.dtype {
                Dtype::U8 if onnx.is_some() => {
                    graphs.push((name, info.data_offsets.0..info.data_offsets.1));
                    continue;
                }
                Dtype::F32 => Precision::Full,
                Dtype::F16 => Precision::Half,
                other => return Err(failed!("{source}: tensor {name} is {other}, expected F32 or F16")),
            };
            tensors.push(FileTensor {
                name,
                shape: info.shape.clone(),
                precision,
                start: info.data_offsets.0,
            });
        }
        tensors.sort_by(|a, b| a.name.cmp(&b.name));
        graphs.sort_by(|(a, _), (b, _)| a.cmp(b));
        Ok(PolicyFile {
            meta,
            networks,
            dynamics,
            given,
            onnx,
            tensors,
            graphs,
            data: size_of::<u64>() + header,
        })
    }

    /// The ONNX files among all its `bytes`, in the order of [`Networks::graph_names`].
    pub(super) fn graphs(&self, bytes: &[u8], names: &[String], source: &str) -> Result<Vec<Vec<u8>>> {
        if let Some((extra, _)) = self.graphs.iter().find(|(name, _)| !names.contains(name)) {
            return Err(failed!("{source}: unexpected ONNX file {extra}"));
        }
        let graph = |name: &String| {
            let found = self.graphs.iter().find(|(found, _)| found == name);
            let (_, range) = found.ok_or_else(|| failed!("{source}: the ONNX file {name} is missing"))?;
            if range.len() as u64 > LARGEST_GRAPH {
                return Err(failed!(
                    "{source}: the ONNX file {name} has {} bytes, at most {LARGEST_GRAPH} are read",
                    range.len()
                ));
            }
            Ok(bytes[self.data..][range.clone()].to_vec())
        };
        names.iter().map(graph).collect()
    }
}

impl FileTensor {
    /// Its values, in the bytes of all values.
    pub(super) fn values(&self, data: &[u8]) -> Vec<f32> {
        let bytes = &data[self.start..];
        match self.precision {
            Precision::Full => {
                let values = bytes.chunks_exact(size_of::<f32>()).take(self.n_values());
                values.map(|bytes| f32::from_le_bytes(bytes.try_into().expect("four bytes"))).collect()
            }
            Precision::Half => {
                let values = bytes.chunks_exact(size_of::<f16>()).take(self.n_values());
                values
                    .map(|bytes| f16::from_le_bytes(bytes.try_into().expect("two bytes")).to_f32())
                    .collect()
            }
        }
    }

    /// The number of values.
    pub fn n_values(&self) -> usize {
        self.shape.iter().product()
    }
}

/// The content of the file at `path`, not copied.
pub(crate) fn map(path: &Path) -> Result<Mmap> {
    let about = std::fs::metadata(path).map_err(|error| Error::open(path, error))?;
    if !about.is_file() {
        return Err(usage!("{} is not a file; expected a safetensors file", path.display()));
    }
    let file = File::open(path).map_err(|error| Error::io("open", path, error))?;
    // SAFETY: the bytes must not change while they are mapped. Our files are replaced by a rename and
    // never written in place (`write_tensors` below), so that a mapping keeps the file it was made from. Somebody
    // who overwrites one in place all the same breaks this, as with any mapped file.
    unsafe { Mmap::map(&file) }.map_err(|error| Error::io("map", path, error))
}

/// What a policy file says of itself.
pub(super) struct About<'a> {
    pub meta: &'a Meta,
    pub networks: &'a Networks,
    pub dynamics: Option<&'a Dynamics>,
    pub given: Option<&'a Dynamics>,
    pub onnx: Option<&'a OnnxSpec>,
}

/// Writes a policy file. Tensors that fill whole cache lines come first, so that those start on one when the
/// file is mapped; ONNX files come last.
pub(super) fn write<'a>(
    path: &Path,
    about: &About,
    precision: Precision,
    tensors: impl Iterator<Item = (&'a str, &'a [usize], &'a [f32])>,
    graphs: &[(String, &[u8])],
) -> Result<()> {
    let (mut tensors, others): (Vec<_>, Vec<_>) =
        tensors.partition(|(_, _, values)| values.len() % Line::VALUES == 0);
    tensors.extend(others);
    write_all(path, &words(about), precision, &tensors, graphs)
}

/// Writes a safetensors file of tensors (name, shape, values) in this order: beside `path` first, and then
/// renamed, so that there is always a whole one. The header is padded to whole cache lines.
pub(crate) fn write_tensors(
    path: &Path,
    metadata: &BTreeMap<&str, String>,
    precision: Precision,
    tensors: &[(&str, &[usize], &[f32])],
) -> Result<()> {
    write_all(path, metadata, precision, tensors, &[])
}

/// As [`write_tensors`], with bytes behind the tensors.
fn write_all(
    path: &Path,
    metadata: &BTreeMap<&str, String>,
    precision: Precision,
    tensors: &[(&str, &[usize], &[f32])],
    graphs: &[(String, &[u8])],
) -> Result<()> {
    let (dtype, size) = match precision {
        Precision::Full => ("F32", size_of::<f32>()),
        Precision::Half => ("F16", size_of::<f16>()),
    };
    let mut header = Map::new();
    header.insert("__metadata__".to_string(), json!(metadata));
    let mut offset = 0;
    for (name, shape, values) in tensors {
        let end = offset + values.len() * size;
        header
            .insert(name.to_string(), json!({"dtype": dtype, "shape": shape, "data_offsets": [offset, end]}));
        offset = end;
    }
    for (name, bytes) in graphs {
        let end = offset + bytes.len();
        header.insert(
            name.clone(),
            json!({"dtype": "U8", "shape": [bytes.len()], "data_offsets": [offset, end]}),
        );
        offset = end;
    }
    let mut header = Value::Object(header).to_string().into_bytes();
    let length = (size_of::<u64>() + header.len()).next_multiple_of(Line::BYTES) - size_of::<u64>();
    header.resize(length, b' ');

    let mut file = AtomicFile::create(path)?;
    let mut put = || -> std::io::Result<()> {
        file.write_all(&(length as u64).to_le_bytes())?;
        file.write_all(&header)?;
        tensors.iter().try_for_each(|(_, _, values)| match precision {
            Precision::Full => file.write_all(bytemuck::cast_slice(values)),
            Precision::Half => {
                let halves = values.iter().flat_map(|value| f16::from_f32(*value).to_le_bytes());
                file.write_all(&halves.collect::<Vec<u8>>())
            }
        })?;
        graphs.iter().try_for_each(|(_, bytes)| file.write_all(bytes))
    };
    put().map_err(|error| Error::io("write", path, std::io::Error::from(error.kind())))?;
    file.commit()
}

/// The metadata of a policy file.
fn words(about: &About) -> BTreeMap<&'static str, String> {
    let About { meta, networks, dynamics, given, onnx } = about;
    let mut words = BTreeMap::from([
        ("format", FORMAT.to_string()),
        ("version", VERSION.to_string()),
        ("task", meta.task.clone()),
        ("algorithm", meta.algorithm.clone()),
        ("steps", meta.steps.to_string()),
        ("seed", meta.seed.to_string()),
        ("program", meta.program.clone()),
        ("origin", meta.origin.clone()),
        ("actor", networks.actor.to_string()),
        ("sharing", networks.sharing.to_string()),
        ("hidden", networks.hidden.to_string()),
        ("predictors", json!(networks.predictors).to_string()),
    ]);
    if networks.actors_have_senses() {
        words.insert("actor_inputs", json!(networks.actor_inputs).to_string());
    }
    words.extend(meta.imputer.iter().map(|imputer| ("imputer", imputer.clone())));
    words.extend(dynamics.map(|dynamics| ("dynamics", json!(dynamics).to_string())));
    words.extend(given.map(|given| ("given", json!(given).to_string())));
    words.extend(onnx.map(|onnx| ("onnx", json!(onnx).to_string())));
    words
}

/// The metadata of a file that errors call `source`.
struct Words<'a> {
    words: &'a HashMap<String, String>,
    source: &'a str,
}

impl Words<'_> {
    fn read(&self) -> Result<(Meta, Networks)> {
        let source = self.source;
        if self.words.get("format").map(String::as_str) != Some(FORMAT) {
            return Err(usage!(
                "{source} is a safetensors file but no policy: its metadata does not say `format: {FORMAT}`"
            ));
        }
        let version = self.text("version")?;
        if version != VERSION {
            return Err(usage!(
                "{source} is a policy file of version {version}; this program reads version {VERSION}"
            ));
        }
        let meta = Meta {
            task: self.text("task")?.to_string(),
            algorithm: self.text("algorithm")?.to_string(),
            steps: self.number("steps")?,
            seed: self.number("seed")?,
            program: self.text("program")?.to_string(),
            origin: self.text("origin")?.to_string(),
            imputer: self.words.get("imputer").cloned(),
        };
        let predictors: Vec<PredictorSpec> = serde_json::from_str(self.text("predictors")?)
            .map_err(|error| failed!("{source}: cannot read `predictors` in its metadata: {error}"))?;
        let actor_inputs: Option<Vec<Input>> = self.json("actor_inputs")?;
        let networks = Networks {
            actor: self.actor()?,
            sharing: self.variant("sharing")?,
            hidden: self.number("hidden")?.try_into().unwrap_or(usize::MAX),
            actor_inputs: actor_inputs.unwrap_or_else(|| vec![Input::Estimate]),
            predictors,
        };
        networks.check().map_err(|error| failed!("{source}: {error}"))?;
        Ok((meta, networks))
    }

    fn actor(&self) -> Result<ActorKind> {
        match self.text("actor")? {
            "onnx" => Ok(ActorKind::Onnx),
            _ => self.variant("actor"),
        }
    }

    /// What is not in every file.
    fn json<T: DeserializeOwned>(&self, key: &str) -> Result<Option<T>> {
        let read = |text: &String| serde_json::from_str(text);
        let found = self.words.get(key).map(read).transpose();
        found.map_err(|error| failed!("{}: cannot read `{key}` in its metadata: {error}", self.source))
    }

    fn text(&self, key: &str) -> Result<&str> {
        let value =
            self.words.get(key).ok_or_else(|| failed!("{} has no `{key}` in its metadata", self.source));
        value.map(String::as_str)
    }

    fn number(&self, key: &str) -> Result<u64> {
        let text = self.text(key)?;
        text.parse().map_err(|_| {
            failed!("{}: `{key}` in its metadata is {text:?}, expected a whole number", self.source)
        })
    }

    fn variant<T: DeserializeOwned>(&self, key: &str) -> Result<T> {
        let text: serde::de::value::StrDeserializer<serde::de::value::Error> =
            self.text(key)?.into_deserializer();
        T::deserialize(text).map_err(|error| failed!("{}: `{key}` in its metadata: {error}", self.source))
    }
}
