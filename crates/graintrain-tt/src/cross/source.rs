//! Where the entries come from.

use crate::sparse::QuadtreeMatrix;
use std::sync::{Mutex, PoisonError};

/// Tensors of more entries than this are read again where they are asked for again.
const MOST_REMEMBERED: usize = 1 << 21;

/// Entries of a tensor on demand, many at a time.
pub trait EntrySource: Sync {
    /// Mode sizes.
    fn modes(&self) -> Vec<usize>;

    /// Writes the entries at `indices` (d indices per entry, one entry after the other) to `values`.
    fn entries(&self, indices: &[usize], values: &mut [f64]);
}

/// A function of one multi-index as an [`EntrySource`].
#[derive(Clone, Debug)]
pub struct Function<F> {
    modes: Vec<usize>,
    function: F,
}

impl<F: Fn(&[usize]) -> f64 + Sync> Function<F> {
    /// The tensor of these modes with entries `function(index)`.
    pub fn new(modes: &[usize], function: F) -> Self {
        Self { modes: modes.to_vec(), function }
    }
}

impl<F: Fn(&[usize]) -> f64 + Sync> EntrySource for Function<F> {
    fn modes(&self) -> Vec<usize> {
        self.modes.clone()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        for (index, value) in indices.chunks_exact(self.modes.len()).zip(values) {
            *value = (self.function)(index);
        }
    }
}

/// A source that reads no entry of a small tensor twice: sweeps ask for many entries again, and a complete
/// confirmation for all of them.
pub(super) struct Memory<'a> {
    source: &'a dyn EntrySource,
    modes: Vec<usize>,
    read: Mutex<Read>,
}

/// What has been read.
struct Read {
    /// The inverted bits of every entry: 0, which would be a NaN, where it was not read. (Zeros cost nothing
    /// until they are touched.) Empty for large tensors.
    bits: Vec<u64>,
    evaluations: usize,
}

impl<'a> Memory<'a> {
    pub(super) fn new(source: &'a dyn EntrySource) -> Self {
        let modes = source.modes();
        let entries = modes.iter().fold(1usize, |product, &n| product.saturating_mul(n));
        let bits = vec![0; if entries <= MOST_REMEMBERED { entries } else { 0 }];
        Self { source, modes, read: Mutex::new(Read { bits, evaluations: 0 }) }
    }

    /// Entries that the source was asked for.
    pub(super) fn evaluations(&self) -> usize {
        self.read.lock().unwrap_or_else(PoisonError::into_inner).evaluations
    }
}

impl EntrySource for Memory<'_> {
    fn modes(&self) -> Vec<usize> {
        self.modes.clone()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let Read { bits, evaluations } = &mut *read;
        if bits.is_empty() {
            *evaluations += values.len();
            return self.source.entries(indices, values);
        }
        let d = self.modes.len();
        let place =
            |index: &[usize]| index.iter().zip(&self.modes).rev().fold(0, |place, (i, n)| i + n * place);
        let places: Vec<usize> = indices.chunks_exact(d).map(place).collect();
        let (mut asked, mut new) = (Vec::new(), Vec::new());
        for (&place, index) in places.iter().zip(indices.chunks_exact(d)) {
            if bits[place] == 0 {
                // (Any other number: asked for once.)
                bits[place] = 1;
                new.push(place);
                asked.extend_from_slice(index);
            }
        }
        let mut answers = vec![0.0; new.len()];
        if !new.is_empty() {
            self.source.entries(&asked, &mut answers);
        }
        *evaluations += new.len();
        new.iter().zip(answers).for_each(|(&place, x)| bits[place] = !x.to_bits());
        values.iter_mut().zip(places).for_each(|(x, place)| *x = f64::from_bits(!bits[place]));
    }
}

/// A sparse matrix over paired modes n_1^2, 4, ..., 4.
impl EntrySource for QuadtreeMatrix {
    fn modes(&self) -> Vec<usize> {
        QuadtreeMatrix::modes(self).iter().map(|n| n * n).collect()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let sizes = QuadtreeMatrix::modes(self);
        for (index, value) in indices.chunks_exact(sizes.len()).zip(values) {
            let (mut row, mut column, mut step) = (0, 0, 1);
            for (b, n) in index.iter().zip(&sizes) {
                row += step * (b % n);
                column += step * (b / n);
                step *= n;
            }
            *value = self.entry(row, column);
        }
    }
}
