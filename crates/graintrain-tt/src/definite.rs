//! Keeping a truncated symmetric positive definite matrix positive definite.
//!
//! Truncation moves eigenvalues by up to the spectral norm of the error, so the small ones may cross zero: a
//! truncated matrix is then useless in conjugate gradients. Here the smallest eigenvalue of the train is
//! estimated by Lanczos with products with full vectors, and where it lies below a floor a multiple of the
//! identity is added (one more rank). A shift by lambda costs lambda sqrt(N) of Frobenius error, which is
//! reported.

use crate::apply::{ApplyWork, FullOperator};
use crate::random::Random;
use crate::sparse::{QuadtreeMatrix, SparseReport};
use crate::symmetric::SymmetricTrain;
use crate::{Truncation, TtError, TtMatrix};
use graintrain_linalg::dense::{Matrix, symmetric_eigen};
use graintrain_linalg::parallel::{axpy, dot, norm};
use serde::{Deserialize, Serialize};

/// An extreme eigenvalue from Lanczos.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EigenvalueEstimate {
    /// The Ritz value: never below the smallest eigenvalue (never above the largest).
    pub value: f64,
    /// Norm of its residual: an eigenvalue lies within this distance. From a random start it is the extreme
    /// one except with very small probability.
    pub residual: f64,
}

/// Smallest and largest eigenvalue of a symmetric operator by Lanczos with full reorthogonalisation; O(steps)
/// products and O(steps^2 N) flops.
///
/// # Errors
/// [`TtError::Shape`] if the operator is not square, [`TtError::Dense`] if an entry is not finite.
pub fn extreme_eigenvalues(
    operator: &FullOperator,
    steps: usize,
    seed: u64,
) -> Result<(EigenvalueEstimate, EigenvalueEstimate), TtError> {
    let n = operator.num_rows();
    if operator.num_columns() != n {
        let (expected, got) = (vec![n], vec![operator.num_columns()]);
        return Err(TtError::Shape { what: "columns of a square operator", expected, got });
    }
    let mut random = Random::new(seed);
    let mut v: Vec<f64> = (0..n).map(|_| random.symmetric()).collect();
    let size = norm(&v);
    v.iter_mut().for_each(|x| *x /= size);
    let mut basis = vec![v];
    let (mut diagonal, mut off_diagonal) = (Vec::new(), Vec::new());
    let mut work = ApplyWork::default();
    for step in 0..steps.clamp(1, n) {
        let mut w = vec![0.0; n];
        operator.apply(&basis[step], &mut w, &mut work)?;
        diagonal.push(dot(&w, &basis[step]));
        // Twice is enough: Gram-Schmidt against the whole basis.
        for _ in 0..2 {
            for v in &basis {
                let overlap = dot(&w, v);
                axpy(-overlap, v, &mut w);
            }
        }
        let length = norm(&w);
        off_diagonal.push(length);
        let largest = diagonal.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        if length <= 1e-14 * largest.max(f64::MIN_POSITIVE) {
            break;
        }
        w.iter_mut().for_each(|x| *x /= length);
        basis.push(w);
    }
    let k = diagonal.len();
    let tridiagonal = Matrix::from_fn(k, k, |i, j| match i.abs_diff(j) {
        0 => diagonal[i],
        1 => off_diagonal[i.min(j)],
        _ => 0.0,
    });
    let (values, vectors) = symmetric_eigen(tridiagonal.view()).map_err(crate::error::at_core(0))?;
    let estimate = |e: usize| EigenvalueEstimate {
        value: values[e],
        residual: (off_diagonal[k - 1] * vectors[(k - 1, e)]).abs(),
    };
    Ok((estimate(0), estimate(k - 1)))
}

/// What [`QuadtreeMatrix::to_definite_train`] did.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DefiniteReport {
    /// The truncation before any shift.
    pub truncation: SparseReport,
    /// Multiple of the identity that was added.
    pub shift: f64,
    /// Bound on the error after the shift, relative to the norm of the given entries.
    pub error: f64,
    /// Smallest eigenvalue of the result.
    pub smallest: EigenvalueEstimate,
}

impl QuadtreeMatrix {
    /// As [`QuadtreeMatrix::to_train`] for a symmetric matrix, shifted where needed so that no eigenvalue of
    /// the result (by a Lanczos estimate with `steps` steps) lies below `floor` > 0. The shift adds one to
    /// the ranks.
    ///
    /// Of a matrix that is not symmetric the symmetric part is taken, and what this costs counted into the
    /// error. After four shifts the result is returned as it is: `smallest` of the report tells whether the
    /// floor was reached.
    ///
    /// Empty places need a positive dummy value, else the matrix has zero eigenvalues and all is shifted.
    ///
    /// # Errors
    /// As for [`QuadtreeMatrix::to_train`], [`TtError::Setting`] for a floor that is not positive, and
    /// [`TtError::TooLarge`] if full vectors do not fit.
    pub fn to_definite_train(
        &self,
        truncation: &Truncation,
        floor: f64,
        steps: usize,
    ) -> Result<(TtMatrix, DefiniteReport), TtError> {
        if !(floor > 0.0 && floor.is_finite()) {
            return Err(TtError::Setting { what: "floor", need: "positive", got: floor });
        }
        let (mut train, report) = self.to_train(truncation)?;
        let size = self.norm().max(f64::MIN_POSITIVE);
        let mut symmetrised = 0.0;
        if train.relative_distance(&train.transpose())? > 1e-12 {
            // A cut inside a cluster of equal singular values need not be symmetric.
            let cap = Truncation::capped(1e-14, truncation.max_rank);
            let symmetric = SymmetricTrain::symmetric_part(&train)?.round(&cap)?.0.to_matrix();
            symmetrised = train.subtract(&symmetric)?.norm() / size;
            train = symmetric;
        }
        let mut smallest = extreme_eigenvalues(&FullOperator::new(&train)?, steps, 1)?.0;
        let mut shift = 0.0;
        // The estimate can be too high: check again after the shift, at most a few times.
        for _ in 0..4 {
            let low = smallest.value - smallest.residual;
            if low >= floor {
                break;
            }
            // Each repetition goes a little further than the last estimate asks.
            let step = (floor - low) * 1.05;
            shift += step;
            train = train
                .add(&TtMatrix::identity(train.row_modes())?.scale(step))?
                .round(&Truncation::to(1e-15))?
                .0;
            smallest = extreme_eigenvalues(&FullOperator::new(&train)?, steps, 2)?.0;
        }
        let error =
            report.error + symmetrised + shift * (FullOperator::new(&train)?.num_rows() as f64).sqrt() / size;
        Ok((train, DefiniteReport { truncation: report, shift, error, smallest }))
    }
}
