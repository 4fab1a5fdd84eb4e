//! Linear algebra for contact problems.
//!
//! | module | holds |
//! |---|---|
//! | [`parallel`] | loops and sums whose bits do not depend on the number of threads |
//! | [`cholesky`] | sparse Cholesky factorisation of block matrices, analysed once per pattern |
//! | [`lu`] | sparse LU factorisation of nonsymmetric block matrices on the same analysis |
//! | [`krylov`] | conjugate gradients, flexible conjugate gradients, BiCGSTAB |
//! | [`precond`] | block Jacobi, ILU(0), IC(0) |
//! | [`block_ops`] | small dense blocks |
//! | [`ordering`] | fill-reducing orderings: minimum degree, nested dissection |
//! | [`block3`] | [`BlockMatrix3`](block3::BlockMatrix3): sparse matrices of 3x3 blocks, one block row per contact |
//! | [`patience`] | how long a computation may go on |
//! | [`vectorised`] | loops compiled for the vector instructions of the processor |
//! | [`real`] | sin, exp, hypot and the like with the same bits on every machine |
//! | [`triangles`] | products of which half is known: with triangles, and of a matrix with itself |
//! | [`dense`] | dense column-major kernels for small and medium matrices: products, QR, SVD, Cholesky, LU |
//!
//! This is the only crate that names `faer`.

// The C library has other bits on other machines: `graintrain_linalg::real`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]
#![warn(clippy::too_many_lines)]

mod bisection;
pub mod block3;
pub mod block_ops;
pub mod cholesky;
pub mod dense;
pub mod krylov;
pub mod lu;
pub mod ordering;
pub mod parallel;
pub mod patience;
pub mod precond;
pub mod real;
mod supernodes;
pub mod triangles;
pub mod vectorised;
