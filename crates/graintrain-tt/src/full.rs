//! A full matrix: what [`TtMatrix::to_full`](crate::TtMatrix::to_full) gives.

use crate::TtError;
use graintrain_linalg::dense::Matrix;
use std::ops::{Index, IndexMut};

/// A full matrix, column-major: entry (i, j) at `i + rows * j`.
///
/// ```
/// use graintrain_tt::{FullMatrix, qtt};
/// let a = qtt::laplacian(2)?.to_full()?;
/// assert_eq!((a.rows(), a.columns(), a[(1, 0)]), (4, 4, -1.0));
/// assert_eq!(a.column(0), [2.0, -1.0, 0.0, 0.0]);
/// assert_eq!(FullMatrix::new(4, 4, a.data().to_vec())?, a);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FullMatrix {
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    pub(crate) data: Vec<f64>,
}

impl FullMatrix {
    /// From its numbers, column by column.
    ///
    /// # Errors
    /// [`TtError::Shape`] unless there are rows * columns numbers.
    pub fn new(rows: usize, columns: usize, data: Vec<f64>) -> Result<Self, TtError> {
        if rows.checked_mul(columns) != Some(data.len()) {
            let (expected, got) = (vec![rows, columns], vec![data.len()]);
            return Err(TtError::Shape { what: "numbers of a full matrix", expected, got });
        }
        Ok(Self { rows, columns, data })
    }

    pub(crate) fn of(matrix: Matrix) -> Self {
        Self { rows: matrix.rows(), columns: matrix.columns(), data: matrix.into_vec() }
    }

    pub(crate) fn into_matrix(self) -> Matrix {
        Matrix::from_vec(self.rows, self.columns, self.data)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The numbers, column by column.
    pub fn data(&self) -> &[f64] {
        &self.data
    }

    /// The numbers, taken.
    pub fn into_vec(self) -> Vec<f64> {
        self.data
    }

    /// Column j.
    pub fn column(&self, j: usize) -> &[f64] {
        &self.data[j * self.rows..(j + 1) * self.rows]
    }
}

impl Index<(usize, usize)> for FullMatrix {
    type Output = f64;

    fn index(&self, (i, j): (usize, usize)) -> &f64 {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        &self.data[i + self.rows * j]
    }
}

impl IndexMut<(usize, usize)> for FullMatrix {
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut f64 {
        assert!(i < self.rows, "row {i} of {}", self.rows);
        &mut self.data[i + self.rows * j]
    }
}
