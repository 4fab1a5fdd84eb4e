//! Full matrices of the crate as dense matrices of the linear algebra that the tests compute with, and back.

use graintrain_linalg::dense::Matrix;
use graintrain_tt::{FullMatrix, TtMatrix};

/// The full matrix of a train.
pub fn dense(train: &TtMatrix) -> Matrix {
    let full = train.to_full().unwrap();
    Matrix::from_vec(full.rows(), full.columns(), full.into_vec())
}

/// A dense matrix as the crate takes it.
pub fn full(matrix: &Matrix) -> FullMatrix {
    FullMatrix::new(matrix.rows(), matrix.columns(), matrix.data().to_vec()).unwrap()
}
