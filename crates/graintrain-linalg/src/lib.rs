//! Linear algebra for contact problems.
//!
//! | module | holds |
//! |---|---|
//! | [`parallel`] | loops and sums whose bits do not depend on the number of threads |
//! | [`block3`] | [`BlockMatrix3`](block3::BlockMatrix3): sparse matrices of 3x3 blocks, one block row per contact |
//! | [`dense`] | dense column-major kernels for small and medium matrices: products, QR, SVD, Cholesky, LU |
//!
//! This is the only crate that names `faer`.

pub mod block3;
pub mod dense;
pub mod parallel;
