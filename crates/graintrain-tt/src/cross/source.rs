//! Where the entries come from.

use crate::sparse::QuadtreeMatrix;

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
