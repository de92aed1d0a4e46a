//! Where weights live: flat f32 memory, owned or mapped, that tensors are ranges of.

use memmap2::Mmap;
use std::ops::Range;
use std::sync::Arc;

// Policy files are little-endian, and mapped weights are used as they lie there.
const _: () = assert!(cfg!(target_endian = "little"), "policy files need a little-endian machine");

/// One weight matrix or vector: a range of shared memory. Clones share it.
#[derive(Clone, Debug)]
pub struct Tensor {
    pub(super) storage: Arc<Storage>,
    range: Range<usize>,
}

impl Tensor {
    /// The tensor in `range` (counted in values) of `storage`, which must hold it.
    pub(super) fn new(storage: Arc<Storage>, range: Range<usize>) -> Tensor {
        assert!(range.end <= storage.values().len(), "a tensor lies inside its storage");
        Tensor { storage, range }
    }

    /// The values, row-major.
    pub fn values(&self) -> &[f32] {
        &self.storage.values()[self.range.clone()]
    }

    /// Takes its new values from the front of `values`: in place if the memory is this tensor's alone, else in new
    /// memory that is, so that others keep their values.
    pub(super) fn renew(&mut self, values: &mut &[f32]) {
        let new = values.split_off(..self.range.len()).expect("there are values for every tensor");
        match Arc::get_mut(&mut self.storage) {
            Some(Storage::Owned { lines, len }) if *len == new.len() => {
                bytemuck::cast_slice_mut(lines)[self.range.clone()].copy_from_slice(new);
            }
            _ => {
                let (storage, _) = Storage::copy(std::iter::once(new));
                *self = Tensor::new(Arc::new(storage), 0..new.len());
            }
        }
    }
}

/// Flat memory full of f32.
#[derive(Debug)]
pub(super) enum Storage {
    /// Memory of this process. `len` values, the rest is padding.
    Owned { lines: Vec<Line>, len: usize },
    /// A file's pages, shared with every process that maps it; values start at byte `start`.
    Mapped { map: Mmap, start: usize },
    /// Values that are part of the program.
    Static(&'static [f32]),
}

impl Storage {
    /// A copy of the tensors, each beginning on a cache line, and where each one lies.
    pub(super) fn copy<'a>(tensors: impl Iterator<Item = &'a [f32]>) -> (Storage, Vec<Range<usize>>) {
        let (mut lines, mut len, mut ranges) = (Vec::new(), 0, Vec::new());
        for values in tensors {
            let start = lines.len() * Line::VALUES;
            lines.resize(lines.len() + values.len().div_ceil(Line::VALUES), Line::ZERO);
            len = start + values.len();
            bytemuck::cast_slice_mut(&mut lines)[start..len].copy_from_slice(values);
            ranges.push(start..len);
        }
        (Storage::Owned { lines, len }, ranges)
    }

    /// The values from byte `start` of a mapped file; copied if they do not lie where f32 may lie.
    pub(super) fn mapped(map: Mmap, start: usize) -> Storage {
        match bytemuck::try_cast_slice::<u8, f32>(&map[start..]) {
            Ok(_) => Storage::Mapped { map, start },
            Err(_) => Storage::copy_of_bytes(&map[start..]),
        }
    }

    /// The values in `bytes`; copied if they do not lie where f32 may lie.
    pub(super) fn from_static(bytes: &'static [u8]) -> Storage {
        match bytemuck::try_cast_slice(bytes) {
            Ok(values) => Storage::Static(values),
            Err(_) => Storage::copy_of_bytes(bytes),
        }
    }

    /// Whether it is in memory once, however many processes use it.
    pub(super) fn is_shared(&self) -> bool {
        !matches!(self, Storage::Owned { .. })
    }

    /// A copy of the values in `bytes`.
    pub(super) fn copy_of_bytes(bytes: &[u8]) -> Storage {
        let mut lines = vec![Line::ZERO; bytes.len().div_ceil(Line::BYTES)];
        bytemuck::cast_slice_mut(&mut lines)[..bytes.len()].copy_from_slice(bytes);
        Storage::Owned { lines, len: bytes.len() / size_of::<f32>() }
    }

    fn values(&self) -> &[f32] {
        match self {
            Storage::Owned { lines, len } => &bytemuck::cast_slice(lines)[..*len],
            Storage::Mapped { map, start } => bytemuck::cast_slice(&map[*start..]),
            Storage::Static(values) => values,
        }
    }
}

/// A cache line of values. Weights start on one because a vector load that crosses lines costs two.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Line([f32; Line::VALUES]);

impl Line {
    pub(crate) const VALUES: usize = 16;
    pub(super) const BYTES: usize = 64;
    pub(crate) const ZERO: Line = Line([0.0; Line::VALUES]);
}

/// Bytes on a cache line, for policies embedded in a program: `include_bytes!` alone promises no alignment,
/// and misaligned weights are copied in every process that loads them.
#[derive(Debug)]
#[repr(C, align(64))]
pub struct Aligned<T: ?Sized>(pub T);
