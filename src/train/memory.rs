//! Flat f32 memory on cache lines: buffers that grow once, and the tensors of a network one behind the other.

use std::ops::{Deref, DerefMut, Range};

use crate::nn::{Line, TensorSpec};

/// Values on cache lines. It allocates when it becomes longer than it ever was, and not otherwise.
#[derive(Clone, Debug, Default)]
pub struct Buffer {
    lines: Vec<Line>,
    len: usize,
}

impl Buffer {
    /// Makes it `len` values long, with arbitrary content.
    pub fn resize(&mut self, len: usize) -> &mut [f32] {
        let lines = len.div_ceil(Line::VALUES);
        if self.lines.len() < lines {
            self.lines.resize(lines, Line::ZERO);
        }
        self.len = len;
        self
    }
}

impl Deref for Buffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
    }
}

/// The tensors of one network in one piece of memory, each from a cache line on. What lies between is zero.
#[derive(Clone, Debug)]
pub struct Flat {
    all: Buffer,
    ranges: Vec<Range<usize>>,
}

impl Flat {
    /// Zeros for these tensors.
    pub fn zeros(tensors: &[TensorSpec]) -> Flat {
        let (mut end, mut ranges) = (0, Vec::new());
        for tensor in tensors {
            ranges.push(end..end + tensor.n_values());
            end = (end + tensor.n_values()).next_multiple_of(Line::VALUES);
        }
        let mut all = Buffer::default();
        all.resize(end);
        Flat { all, ranges }
    }

    /// All values, with the zeros between the tensors.
    pub fn all(&self) -> &[f32] {
        &self.all
    }

    /// All values, with the zeros between the tensors, which must stay zero.
    pub(crate) fn all_mut(&mut self) -> &mut [f32] {
        &mut self.all
    }

    /// Tensor number `at`.
    pub fn tensor(&self, at: usize) -> &[f32] {
        &self.all[self.ranges[at].clone()]
    }

    /// Tensor number `at`.
    pub(crate) fn tensor_mut(&mut self, at: usize) -> &mut [f32] {
        &mut self.all[self.ranges[at].clone()]
    }

    /// Every tensor, one after the other.
    pub fn each_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        let (mut rest, mut passed) = (&mut self.all[..], 0);
        self.ranges.iter().map(move |range| {
            let (tensor, behind) =
                std::mem::take(&mut rest)[range.start - passed..].split_at_mut(range.len());
            (rest, passed) = (behind, range.end);
            tensor
        })
    }

    /// `N` tensors, from number `first` on.
    pub fn tensors<const N: usize>(&self, first: usize) -> [&[f32]; N] {
        std::array::from_fn(|at| self.tensor(first + at))
    }

    /// `N` tensors, from number `first` on.
    pub(crate) fn tensors_mut<const N: usize>(&mut self, first: usize) -> [&mut [f32]; N] {
        let mut tensors = self.each_mut().skip(first);
        std::array::from_fn(|_| tensors.next().expect("there are N tensors"))
    }
}
