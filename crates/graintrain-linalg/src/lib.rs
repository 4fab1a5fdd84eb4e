//! Linear algebra for contact problems.
//!
//! | module | holds |
//! |---|---|
//! | [`parallel`] | loops and sums whose bits do not depend on the number of threads |
//! | [`block3`] | [`BlockMatrix3`](block3::BlockMatrix3): sparse matrices of 3x3 blocks, one block row per contact |
//!
//! This is the only crate that names `faer`.

pub mod block3;
pub mod parallel;
