//! Where weights live: flat memory, owned or mapped, that tensors are ranges of.

use super::file::Precision;
use super::kernels::Nibbles;
use half::f16;
use memmap2::Mmap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

// Policy files are little-endian, and mapped weights are used as they lie there.
const _: () = assert!(cfg!(target_endian = "little"), "policy files need a little-endian machine");

/// One weight matrix or vector: a range of shared memory. Clones share it.
#[derive(Clone, Debug)]
pub struct Tensor {
    pub(super) storage: Arc<Storage>,
    /// Counted in values.
    range: Range<usize>,
    precision: Precision,
    /// The values of f16 as f32, once somebody has asked for them.
    widened: Arc<OnceLock<Storage>>,
    /// Whether products need no more than the nearest values of four bits.
    is_rough: bool,
    /// Those, once somebody has asked for them.
    nibbles: Arc<OnceLock<Nibbles>>,
}

impl Tensor {
    /// The tensor in `range` (counted in values) of `storage`, which must hold it.
    pub(super) fn new(storage: Arc<Storage>, range: Range<usize>, precision: Precision) -> Tensor {
        assert!(range.end * precision.bytes() <= storage.bytes().len(), "a tensor lies inside its storage");
        let (widened, nibbles) = Default::default();
        Tensor { storage, range, precision, widened, is_rough: false, nibbles }
    }

    /// The same tensor, of which products take the nearest values of four bits.
    pub(super) fn roughly(&self) -> Tensor {
        Tensor { is_rough: true, ..self.clone() }
    }

    /// The number of values.
    pub(super) fn len(&self) -> usize {
        self.range.len()
    }

    /// The values, row-major. Those that are stored as f16 are converted when they are first asked for.
    pub fn values(&self) -> &[f32] {
        match self.halves() {
            None => &bytemuck::cast_slice(self.storage.bytes())[self.range.clone()],
            Some(halves) => {
                bytemuck::cast_slice(self.widened.get_or_init(|| Storage::widened(halves)).bytes())
            }
        }
    }

    /// The bits of the values, if they are stored as f16.
    pub(super) fn halves(&self) -> Option<&[u16]> {
        let is_half = self.precision == Precision::Half;
        is_half.then(|| &bytemuck::cast_slice(self.storage.bytes())[self.range.clone()])
    }

    /// The nearest values of four bits of a weight with so many columns, if it is [rough](Tensor::roughly). They are made when
    /// they are first asked for.
    pub(super) fn nibbles(&self, columns: usize) -> Option<&Nibbles> {
        let nearest = || {
            let mut values = vec![0.0; self.len()];
            self.copy_to(&mut values);
            Nibbles::nearest(&values, columns)
        };
        self.is_rough.then(|| self.nibbles.get_or_init(nearest))
    }

    /// Copies the values, converted if they are stored as f16.
    pub(super) fn copy_to(&self, out: &mut [f32]) {
        match self.halves() {
            None => out.copy_from_slice(self.values()),
            Some(halves) => widen(halves).zip(out).for_each(|(value, out)| *out = value),
        }
    }

    /// Where the first value is that is not finite, and the value.
    pub(super) fn find_not_finite(&self) -> Option<(usize, f32)> {
        let not_finite = |(_, value): &(usize, f32)| !value.is_finite();
        match self.halves() {
            None => self.values().iter().copied().enumerate().find(not_finite),
            Some(halves) => widen(halves).enumerate().find(not_finite),
        }
    }

    /// Takes its new values from the front of `values`: in place if the memory is this tensor's alone, else in new
    /// memory that is, so that others keep their values.
    pub(super) fn renew(&mut self, values: &mut &[f32]) {
        let new = values.split_off(..self.range.len()).expect("there are values for every tensor");
        match Arc::get_mut(&mut self.storage) {
            Some(Storage::Owned { lines, bytes })
                if self.precision == Precision::Full && *bytes == size_of_val(new) =>
            {
                bytemuck::cast_slice_mut(lines)[self.range.clone()].copy_from_slice(new);
                Arc::get_mut(&mut self.nibbles).expect("what shares it shares the memory").take();
            }
            _ => {
                let (storage, _) = Storage::copy(std::iter::once(new));
                let tensor = Tensor::new(Arc::new(storage), 0..new.len(), Precision::Full);
                *self = Tensor { is_rough: self.is_rough, ..tensor };
            }
        }
    }
}

/// Flat memory full of values.
#[derive(Debug)]
pub(super) enum Storage {
    /// Memory of this process. So many `bytes`, the rest is padding.
    Owned { lines: Vec<Line>, bytes: usize },
    /// A file's pages, shared with every process that maps it; values start at byte `start`.
    Mapped { map: Mmap, start: usize },
    /// Values that are part of the program.
    Static(&'static [u8]),
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
        (Storage::Owned { lines, bytes: len * size_of::<f32>() }, ranges)
    }

    /// The values from byte `start` of a mapped file; copied if they do not lie where such values may lie.
    pub(super) fn mapped(map: Mmap, start: usize, precision: Precision) -> Storage {
        if precision.fits(&map[start..]) {
            Storage::Mapped { map, start }
        } else {
            Storage::copy_of_bytes(&map[start..])
        }
    }

    /// The values in `bytes`; copied if they do not lie where such values may lie.
    pub(super) fn from_static(bytes: &'static [u8], precision: Precision) -> Storage {
        if precision.fits(bytes) { Storage::Static(bytes) } else { Storage::copy_of_bytes(bytes) }
    }

    /// Whether it is in memory once, however many processes use it.
    pub(super) fn is_shared(&self) -> bool {
        !matches!(self, Storage::Owned { .. })
    }

    fn copy_of_bytes(bytes: &[u8]) -> Storage {
        let mut lines = vec![Line::ZERO; bytes.len().div_ceil(Line::BYTES)];
        bytemuck::cast_slice_mut(&mut lines)[..bytes.len()].copy_from_slice(bytes);
        Storage::Owned { lines, bytes: bytes.len() }
    }

    /// These values of f16 as f32.
    fn widened(halves: &[u16]) -> Storage {
        let values: Vec<f32> = widen(halves).collect();
        Storage::copy(std::iter::once(&values[..])).0
    }

    fn bytes(&self) -> &[u8] {
        match self {
            Storage::Owned { lines, bytes } => &bytemuck::cast_slice(lines)[..*bytes],
            Storage::Mapped { map, start } => &map[*start..],
            Storage::Static(bytes) => bytes,
        }
    }
}

/// The values of these f16.
fn widen(halves: &[u16]) -> impl Iterator<Item = f32> {
    halves.iter().map(|bits| f16::from_bits(*bits).to_f32())
}

impl Precision {
    /// The size of a value.
    pub(super) fn bytes(self) -> usize {
        match self {
            Precision::Full => size_of::<f32>(),
            Precision::Half => size_of::<f16>(),
        }
    }

    /// Whether such values may lie where these bytes do.
    fn fits(self, bytes: &[u8]) -> bool {
        match self {
            Precision::Full => bytemuck::try_cast_slice::<u8, f32>(bytes).is_ok(),
            Precision::Half => bytemuck::try_cast_slice::<u8, u16>(bytes).is_ok(),
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
