//! Tensor trains (TT) and quantized tensor trains (QTT).
//!
//! A tensor with d indices is kept as a product of d small cores, A(i_1, ..., i_d) = G_1(i_1) ... G_d(i_d)
//! with G_k(i_k) an r_{k-1} x r_k matrix; a matrix has paired indices (i_k, j_k). The first index is the
//! fastest.
//!
//! ```text
//!        i_1            i_2                  i_d          j = i_1 + n_1 (i_2 + n_2 (i_3 + ...))
//!      (fine)            |                (coarse)
//!         |              |                    |           quantized: n_k = 2, i_k is bit k - 1 of j
//!   1 --[G_1]-- r_1 --[G_2]-- r_2 -- ... --[G_d]-- 1
//!
//!        i_1            i_2                  i_d          rows
//!         |              |                    |
//!   1 --[A_1]-- R_1 --[A_2]-- R_2 -- ... --[A_d]-- 1
//!         |              |                    |
//!        j_1            j_2                  j_d          columns
//! ```
//!
//! | module | holds |
//! |---|---|
//! | [`vector`], [`matrix`] | [`TtVector`], [`TtMatrix`]: the types, entries, full form |
//! | [`arithmetic`] | sums, entrywise, Kronecker and inner products, TT-matrix times TT-vector and TT-matrix |
//! | [`product`] | products within a tolerance, without their full-rank cores |
//! | [`round`] | orthogonalisation, norm, rounding |
//! | [`svd`] | TT-SVD: the train of a full tensor, by sketches where it is large |
//! | [`symmetric`] | symmetric matrices with even and odd bonds: half the numbers, symmetric to the last bit |
//! | [`apply`] | TT-matrix times full vector in O(r^2 N log N) |
//! | [`cross`], [`maxvol`] | a train from some of the entries: AMEn-cross, confirmed on fresh points |
//! | [`solve`] | linear systems by AMEn, ALS and DMRG; lowest eigenpairs |
//! | [`inverse`] | the inverse of a TT-matrix, Newton-Schulz |
//! | [`qtt`] | quantized trains with known ranks |
//! | [`quantics`] | functions of several variables on named grids: evaluation, integrals, interpolation |
//! | [`operator_sum`] | sums of products of local operators (Hamiltonians of chains) with the smallest ranks |
//! | [`sparse`] | sparse matrix to TT by one exact bottom-up pass over its nonzero blocks |
//! | [`definite`] | keeping a truncated positive definite matrix positive definite |
//! | [`extremes`] | largest and smallest entry with bounds; samples from a train as a density |
//! | [`functions`] | functions of entries: any by cross, reciprocals and roots with residuals over all entries |
//! | [`mod@fit`] | a train through scattered data, validated |
//! | [`complex`] | complex vectors and matrices: a mode for real and imaginary part |
//! | [`mod@fourier`] | Fourier transform of quantized trains, convolution |
//! | [`mod@slice`] | ranges of digits, fixed digits |
//! | [`toolbox`] | trains from and to the files of TT-Toolbox, ttpy and tt-fort |
//! | [`sketch`] | streaming approximation from random sketches |

#![warn(clippy::too_many_lines)]

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;

pub mod apply;
pub mod arithmetic;
#[cfg(feature = "ndarray")]
mod arrays;
pub mod complex;
mod confidence;
mod cores;
pub mod cross;
pub mod definite;
mod error;
mod exact;
pub mod extremes;
mod factor;
pub mod fit;
pub mod fourier;
mod full;
pub mod functions;
#[cfg(feature = "hdf5")]
mod hdf5;
pub mod inverse;
mod io;
pub mod matrix;
pub mod maxvol;
mod modes;
pub mod operator_sum;
mod operators;
pub mod product;
pub mod qtt;
pub mod quantics;
mod random;
mod range;
pub mod round;
mod scale;
pub mod sketch;
pub mod slice;
pub mod solve;
pub mod sparse;
pub mod svd;
pub mod symmetric;
pub mod toolbox;
pub mod vector;

pub use error::{DenseFailure, TtError};
pub use full::FullMatrix;
pub use matrix::TtMatrix;
pub use round::{Measured, Truncation, TruncationReport};
pub use vector::{Core, TtVector};

/// Asked between the parts of a long computation: true ends it with [`TtError::Stopped`].
///
/// ```
/// use graintrain_tt::{TtError, inverse::{InverseForm, inverse_within}, qtt};
/// use std::time::{Duration, Instant};
/// let deadline = Instant::now() + Duration::from_millis(0);
/// let stopped = inverse_within(&qtt::laplacian(10)?, InverseForm::Energy, None, &Default::default(), &|| Instant::now() >= deadline);
/// assert!(matches!(stopped, Err(TtError::Stopped)));
/// # Ok::<(), TtError>(())
/// ```
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// Fails where the caller's [`Stop`] says so.
pub(crate) fn go_on(stop: Stop<'_>) -> Result<(), TtError> {
    if stop() { Err(TtError::Stopped) } else { Ok(()) }
}
