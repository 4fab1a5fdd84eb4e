//! Parts of trains: ranges of digits, fixed digits, and modes of size one removed.

use crate::vector::Core;
use crate::{TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, View, product};
use std::ops::Range;

impl TtVector {
    /// The entries whose digit k lies in `ranges[k]`, for every k; ranks stay, so round afterwards. A fixed
    /// digit is a range of length one: see [`TtVector::squeeze`].
    ///
    /// # Errors
    /// [`TtError::Shape`] unless there is one range per mode, none of them empty; [`TtError::Index`] if one
    /// ends outside.
    ///
    /// ```
    /// use graintrain_tt::qtt;
    /// // Every second entry of the first half of an exponential: digits are fine to coarse.
    /// let x = qtt::exponential(5, 0.1, 0.0)?;
    /// let part = x.sub_tensor(&[0..1, 0..2, 0..2, 0..2, 0..1])?.squeeze();
    /// assert_eq!(part.modes(), [2, 2, 2]);
    /// assert!((part.to_full()?[3] - 0.6_f64.exp()).abs() < 1e-14);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn sub_tensor(&self, ranges: &[Range<usize>]) -> Result<Self, TtError> {
        let modes = self.modes();
        check_ranges(ranges, &modes)?;
        let part = |(core, range): (&Core, &Range<usize>)| {
            Core::from_fn(core.left, range.len(), core.right, |alpha, i, beta| {
                core.get(alpha, range.start + i, beta)
            })
        };
        Ok(Self { cores: self.cores.iter().zip(ranges).map(part).collect() })
    }

    /// The same tensor without its modes of size one (but for one if there is no other): their cores are
    /// multiplied into a neighbour.
    pub fn squeeze(&self) -> Self {
        let mut cores: Vec<Core> = Vec::with_capacity(self.num_cores());
        // The product of the matrices of modes of size one before the first other mode.
        let mut before = Matrix::identity(1);
        for core in &self.cores {
            let slice = || View::new(&core.data, core.left, core.right);
            match cores.last_mut() {
                _ if core.mode > 1 => {
                    cores.push(if cores.is_empty() {
                        core.multiply_left(before.view())
                    } else {
                        core.clone()
                    });
                }
                Some(last) => *last = last.multiply_right(slice()),
                None => before = product(before.view(), slice()),
            }
        }
        if cores.is_empty() {
            cores.push(Core { left: 1, mode: 1, right: 1, data: before.into_vec() });
        }
        Self { cores }
    }
}

impl TtMatrix {
    /// The block of entries whose row digit k lies in `rows[k]` and column digit k in `columns[k]`; ranks
    /// stay, so round afterwards.
    ///
    /// # Errors
    /// As for [`TtVector::sub_tensor`].
    ///
    /// ```
    /// use graintrain_tt::qtt;
    /// // The coupling of the upper half of a line to its lower half: the coarsest digit fixed.
    /// let line = qtt::laplacian(4)?;
    /// let (all, low, high) = (vec![0..2; 3], 0..1, 1..2);
    /// let rows = [&all[..], &[high]].concat();
    /// let columns = [&all[..], &[low]].concat();
    /// let coupling = line.sub_matrix(&rows, &columns)?;
    /// assert_eq!(coupling.to_full()?.data().iter().sum::<f64>(), -1.0);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn sub_matrix(&self, rows: &[Range<usize>], columns: &[Range<usize>]) -> Result<Self, TtError> {
        check_ranges(rows, &self.rows)?;
        check_ranges(columns, &self.columns)?;
        let part = |k: usize| {
            let (core, m, row, column) = (&self.cores()[k], self.rows[k], &rows[k], &columns[k]);
            Core::from_fn(core.left, row.len() * column.len(), core.right, |alpha, b, beta| {
                let (i, j) = (row.start + b % row.len(), column.start + b / row.len());
                core.get(alpha, i + m * j, beta)
            })
        };
        let lengths = |ranges: &[Range<usize>]| ranges.iter().map(Range::len).collect();
        let train = TtVector { cores: (0..self.num_cores()).map(part).collect() };
        Ok(Self { rows: lengths(rows), columns: lengths(columns), train })
    }
}

/// Fails unless there is one range that is not empty inside every mode.
fn check_ranges(ranges: &[Range<usize>], modes: &[usize]) -> Result<(), TtError> {
    if ranges.len() != modes.len() || ranges.iter().any(Range::is_empty) {
        return Err(TtError::Shape {
            what: "ranges of digits, one per mode and none empty",
            expected: modes.to_vec(),
            got: ranges.iter().map(Range::len).collect(),
        });
    }
    match (0..modes.len()).find(|&k| ranges[k].end > modes[k]) {
        Some(mode) => Err(TtError::Index { mode, index: ranges[mode].end - 1, size: modes[mode] }),
        None => Ok(()),
    }
}
