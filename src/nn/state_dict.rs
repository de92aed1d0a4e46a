//! PyTorch state dicts: a zip archive with a pickle that names the tensors, and their values beside it.
//!
//! Damage is found by the checksums of the archive, and nothing larger than the file is read into memory.

use super::PolicyFile;
use super::pickle::{self, PickledTensor};
use crate::base::error::{Error, Result};
use crate::{failed, usage};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use zip::ZipArchive;

/// Values by the name of their file, as bytes.
type Files = BTreeMap<String, Vec<u8>>;

/// The tensors of a state dict, by name.
#[derive(Debug)]
pub(super) struct StateDict {
    tensors: BTreeMap<String, PickledTensor>,
    files: Files,
    /// What errors call the file.
    source: String,
}

impl StateDict {
    /// The state dict in the file at `path`.
    pub(super) fn read(path: &Path) -> Result<StateDict> {
        let source = path.display().to_string();
        let (pickle, files) = entries(path, &source)?;
        let tensors = pickle::tensors(&pickle)
            .map_err(|why| failed!("{source} is not a PyTorch state dict: cannot read its pickle: {why}"))?;
        let dict = StateDict { tensors: tensors.into_iter().collect(), files, source };
        for (name, tensor) in &dict.tensors {
            if tensor.storage == FLOATS && !dict.holds(tensor) {
                return Err(failed!(
                    "{}: tensor {name} is larger than the file with its values",
                    dict.source
                ));
            }
        }
        Ok(dict)
    }

    /// Whether there is such a tensor (that has not been taken).
    pub(super) fn has(&self, key: &str) -> bool {
        self.tensors.contains_key(key)
    }

    /// The length of the vector `key`.
    pub(super) fn length(&self, key: &str) -> Result<usize> {
        let vector = self.tensors.get(key).ok_or_else(|| self.missing(key))?;
        Ok(vector.shape.iter().product())
    }

    /// The number of inputs of the layer whose weights are `key`.
    pub(super) fn inputs(&self, key: &str) -> Result<usize> {
        let weights = self.tensors.get(key).ok_or_else(|| self.missing(key))?;
        Ok(weights.shape.last().copied().unwrap_or(0))
    }

    /// What errors call the file.
    pub(super) fn source(&self) -> &str {
        &self.source
    }

    /// Takes the values of tensor `key`, transposed to `shape`.
    pub(super) fn take(&mut self, key: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let tensor = self.tensors.remove(key).ok_or_else(|| self.missing(key))?;
        let source = &self.source;
        let expected: Vec<usize> = shape.iter().rev().copied().collect();
        if tensor.shape != expected {
            let layouts = match shape {
                [_, _] => {
                    format!(", [outputs, inputs], which a policy file keeps as {shape:?}, [inputs, outputs]")
                }
                _ => String::new(),
            };
            return Err(failed!(
                "{source}: tensor {key} is {:?}, expected {expected:?}{layouts}",
                tensor.shape
            ));
        }
        if tensor.storage != FLOATS {
            return Err(failed!("{source}: tensor {key} is a {}, expected a {FLOATS}", tensor.storage));
        }
        let values = self.transposed(&tensor);
        match values.iter().find(|value| !value.is_finite()) {
            Some(value) => Err(failed!("{source}: tensor {key} holds {value}, expected numbers")),
            None => Ok(values),
        }
    }

    /// Checks that every tensor has been taken.
    pub(super) fn finish(&self) -> Result<()> {
        match self.tensors.keys().next() {
            Some(key) => Err(failed!("{}: unexpected tensor {key}", self.source)),
            None => Ok(()),
        }
    }

    /// The values of a tensor of floats whose file holds them, by its last axis first.
    fn transposed(&self, tensor: &PickledTensor) -> Vec<f32> {
        let mut at = vec![tensor.offset];
        for (&length, &stride) in tensor.shape.iter().zip(&tensor.strides).rev() {
            at = at.iter().flat_map(|from| (0..length).map(move |step| from + step * stride)).collect();
        }
        let values = self.files.get(&tensor.file).map_or(&[][..], |bytes| bytes.as_chunks().0);
        at.iter().map(|at| f32::from_le_bytes(values[*at])).collect()
    }

    /// Whether the file of a tensor of floats has all its values, and at least as many as it has.
    fn holds(&self, tensor: &PickledTensor) -> bool {
        let there = self.files.get(&tensor.file).map_or(0, |bytes| bytes.len() / size_of::<f32>());
        let count = tensor.shape.iter().try_fold(1usize, |count, &length| count.checked_mul(length));
        let mut axes = tensor.shape.iter().zip(&tensor.strides);
        let last = axes.try_fold(tensor.offset, |at, (&length, &stride)| {
            at.checked_add(stride.checked_mul(length.saturating_sub(1))?)
        });
        count.is_some_and(|count| count <= there)
            && (count == Some(0) || last.is_some_and(|last| last < there))
    }

    fn missing(&self, key: &str) -> Error {
        failed!("{}: tensor {key} is missing", self.source)
    }
}

/// How the pickle calls values of 32 bits.
const FLOATS: &str = "FloatStorage";

/// No pickle of a policy is larger: a tensor takes about 100 bytes in it, so this is for 1200 tensors.
const MAX_PICKLE: u64 = 1 << 17;

/// The pickle in the archive at `path`, and its files of values by their names. All entries have the checksums they
/// should have.
fn entries(path: &Path, source: &str) -> Result<(Vec<u8>, Files)> {
    let about = std::fs::metadata(path).map_err(|error| usage!("cannot open {source}: {error}"))?;
    if !about.is_file() {
        return Err(usage!("{source} is not a file; expected a PyTorch state dict"));
    }
    let file = File::open(path).map_err(|error| Error::io("open", path, error))?;
    let mut archive = ZipArchive::new(file).map_err(|error| match PolicyFile::read(path) {
        Ok(_) => usage!("{source} is already a policy file; every command takes it as it is"),
        Err(_) => {
            failed!(
                "{source} is not a PyTorch state dict, or was saved by PyTorch before 1.6, or is damaged: {error}"
            )
        }
    })?;
    let (mut pickles, mut others, mut left) = (Vec::new(), Vec::new(), about.len());
    for at in 0..archive.len() {
        let damaged = |error: &dyn std::fmt::Display| failed!("{source} is damaged: {error}");
        let mut entry = archive.by_index(at).map_err(|error| damaged(&error))?;
        let (name, size) = (entry.name().unwrap_or_default().to_string(), entry.size());
        // Entries that share their bytes could be many times as large as the file.
        left = left.checked_sub(size).ok_or_else(|| damaged(&"its entries are larger than itself"))?;
        let folder = name.strip_suffix("data.pkl");
        if folder.is_some() && size > MAX_PICKLE {
            return Err(failed!("{source}: its pickle has {size} bytes, expected at most {MAX_PICKLE}"));
        }
        // Reading to the end compares the checksum.
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|error| damaged(&error))?;
        match folder {
            Some(folder) => pickles.push((format!("{folder}data/"), bytes)),
            None => others.push((name, bytes)),
        }
    }
    let [(folder, pickle)] = &mut pickles[..] else {
        let many = pickles.len();
        return Err(failed!(
            "{source} is not a PyTorch state dict: it has {many} files data.pkl, expected one"
        ));
    };
    let files =
        others.into_iter().filter_map(|(name, bytes)| Some((name.strip_prefix(&*folder)?.to_owned(), bytes)));
    Ok((std::mem::take(pickle), files.collect()))
}
