//! PyTorch state dicts: a zip archive with a pickle that names the tensors, and their values beside it.
//!
//! candle reads both, but trusts them. Damage is found before it looks: by the checksums of the archive, and by
//! the sizes of pickle and tensors. A sound archive whose pickle says something unforeseen can still make it
//! panic or recurse deeply; so it reads in a thread of its own with a large stack, and a panic there is an
//! error here (its words go to stderr all the same). A pickle built to exhaust memory is not guarded against.

use super::PolicyFile;
use crate::base::error::{Error, Result};
use crate::{failed, usage};
use candle_core::pickle::PthTensors;
use candle_core::{DType, Tensor};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use zip::ZipArchive;

/// The tensors of a state dict, by name.
#[derive(Debug)]
pub(super) struct StateDict {
    tensors: BTreeMap<String, Tensor>,
    /// What errors call the file.
    source: String,
}

impl StateDict {
    /// The state dict in the file at `path`.
    pub(super) fn read(path: &Path) -> Result<StateDict> {
        let source = path.display().to_string();
        check_archive(path, &source)?;
        // An object may be nested once per byte of pickle, and reading it recurses.
        let stack = MAX_PICKLE as usize * (2 << 10);
        let tensors = std::thread::scope(|scope| {
            let reader = std::thread::Builder::new().stack_size(stack);
            let reader = reader.spawn_scoped(scope, || read_tensors(path));
            reader.map_err(|error| failed!("cannot start a thread: {error}"))?.join().unwrap_or_else(|_| {
                Err(failed!("{source} is no PyTorch state dict: its pickle makes no sense"))
            })
        })?;
        Ok(StateDict { tensors, source })
    }

    /// Whether there is such a tensor (that has not been taken).
    pub(super) fn has(&self, key: &str) -> bool {
        self.tensors.contains_key(key)
    }

    /// The length of the vector `key`.
    pub(super) fn length(&self, key: &str) -> Result<usize> {
        let vector = self.tensors.get(key).ok_or_else(|| self.missing(key))?;
        Ok(vector.elem_count())
    }

    /// The number of inputs of the layer whose weights are `key`.
    pub(super) fn inputs(&self, key: &str) -> Result<usize> {
        let weights = self.tensors.get(key).ok_or_else(|| self.missing(key))?;
        Ok(weights.dims().last().copied().unwrap_or(0))
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
        if tensor.dims() != expected {
            return Err(failed!("{source}: tensor {key} is {:?}, expected {expected:?}", tensor.dims()));
        }
        if tensor.dtype() != DType::F32 {
            return Err(failed!("{source}: tensor {key} is {:?}, expected F32", tensor.dtype()));
        }
        let values = match expected.len() {
            2 => tensor.t().and_then(|tensor| tensor.flatten_all()),
            _ => tensor.flatten_all(),
        };
        let values: Vec<f32> = values
            .and_then(|values| values.to_vec1())
            .map_err(|error| failed!("{source}: cannot read tensor {key}: {error}"))?;
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

    fn missing(&self, key: &str) -> Error {
        failed!("{}: tensor {key} is missing", self.source)
    }
}

/// No pickle of a policy is larger: a tensor takes about 100 bytes in it, so this is for 1200 tensors.
const MAX_PICKLE: u64 = 1 << 17;

/// Checks that there is an archive at `path`, that its entries have the checksums they should have, and that
/// one of them is a pickle.
fn check_archive(path: &Path, source: &str) -> Result<()> {
    let about = std::fs::metadata(path).map_err(|error| usage!("cannot open {source}: {error}"))?;
    if !about.is_file() {
        return Err(usage!("{source} is not a file; expected a PyTorch state dict"));
    }
    let file = File::open(path).map_err(|error| Error::io("open", path, error))?;
    let mut archive = ZipArchive::new(file).map_err(|error| match PolicyFile::read(path) {
        Ok(_) => usage!("{source} is a policy file already; every command takes it as it is"),
        Err(_) => {
            failed!(
                "{source} is no PyTorch state dict, or saved by a PyTorch before 1.6, or damaged: {error}"
            )
        }
    })?;
    let mut pickles = 0;
    for at in 0..archive.len() {
        let damaged = |error: &dyn std::fmt::Display| failed!("{source} is damaged: {error}");
        let mut entry = archive.by_index(at).map_err(|error| damaged(&error))?;
        // Reading to the end compares the checksum.
        let size = std::io::copy(&mut entry, &mut std::io::sink()).map_err(|error| damaged(&error))?;
        if entry.name().is_ok_and(|name| name.ends_with("data.pkl")) {
            pickles += 1;
            if size > MAX_PICKLE {
                return Err(failed!("{source}: its pickle has {size} bytes, expected at most {MAX_PICKLE}"));
            }
        }
    }
    match pickles {
        1 => Ok(()),
        _ => Err(failed!("{source} is no PyTorch state dict: it has {pickles} files data.pkl, expected one")),
    }
}

fn read_tensors(path: &Path) -> Result<BTreeMap<String, Tensor>> {
    let unreadable = |error: &dyn std::fmt::Display| failed!("cannot read {}: {error}", path.display());
    let size = std::fs::metadata(path).map_err(|error| unreadable(&error))?.len();
    let file = PthTensors::new(path, None).map_err(|error| unreadable(&error))?;
    let mut tensors = BTreeMap::new();
    for (name, info) in file.tensor_infos() {
        let bytes =
            info.layout.dims().iter().try_fold(info.dtype.size_in_bytes(), |n, &dim| n.checked_mul(dim));
        if bytes.is_none_or(|bytes| bytes as u64 > size) {
            return Err(unreadable(&format!("tensor {name} is larger than the file")));
        }
        if let Some(tensor) = file.get(name).map_err(|error| unreadable(&error))? {
            tensors.insert(name.clone(), tensor);
        }
    }
    Ok(tensors)
}
