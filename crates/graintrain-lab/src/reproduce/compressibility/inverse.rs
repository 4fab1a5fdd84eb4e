//! Approximate inverses in tensor-train form: the exact inverse truncated, the paper's iteration, and two
//! that are definite.

use super::system::{Slots, System};
use crate::reproduce::ReproduceError;
use graintrain_ccp::paper::tensor_train::inverse::mean_rank;
use graintrain_ccp::paper::tensor_train::padded::PaddedOperator;
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_linalg::dense::{Cholesky, Matrix};
use graintrain_tt::apply::FullOperator;
use graintrain_tt::definite::extreme_eigenvalues;
use graintrain_tt::inverse::{InverseForm, inverse_within};
use graintrain_tt::solve::SolveSettings;
use graintrain_tt::sparse::QuadtreeMatrix;
use graintrain_tt::symmetric::SymmetricTrain;
use graintrain_tt::{Stop, Truncation, TtError, TtMatrix};

/// Most unknowns of a matrix that is inverted exactly: O(n^3) operations, n^2 entries of 24 bytes.
pub const EXACT: usize = 3600;

/// Steps of Lanczos for the smallest eigenvalue.
const LANCZOS: usize = 40;

/// Smallest eigenvalue that the shifted inverse of a block-scaled matrix keeps. That of the exact inverse is
/// 1 over the largest one of the matrix, about 1/10 here.
const FLOOR: f64 = 0.02;

/// What stands for S^-1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The exact inverse, truncated: the best X of its rank, up to the square root of the number of cores.
    Truncated,
    /// AMEn on T X = I for the train T of the matrix, at most so many sweeps: the paper's.
    Iterated(usize),
    /// The exact inverse, truncated, and a multiple of the identity added where eigenvalues would be below
    /// 0.02: of use for block-scaled matrices.
    Shifted,
    /// W^T W with W the truncated inverse of the Cholesky factor: definite by construction, at two
    /// applications.
    Factor,
}

impl Kind {
    /// Name in the table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Truncated => "truncated",
            Self::Iterated(_) => "amen",
            Self::Shifted => "shifted",
            Self::Factor => "factor",
        }
    }
}

/// An approximate inverse.
pub struct Approximate {
    /// Mean and largest rank of its train.
    pub ranks: (f64, usize),
    /// Relative truncation error; of [`Kind::Iterated`] ||T X - I||_F / ||I||_F.
    pub error: f64,
    /// Whether no eigenvalue of its symmetric part is negative; a negative one is proven by a Rayleigh
    /// quotient, its absence is the estimate of 40 Lanczos steps.
    pub definite: bool,
    operator: PaddedOperator,
    /// The transpose, for W^T W.
    transposed: Option<PaddedOperator>,
    /// Whether it belongs to the block-scaled matrix.
    scaled: bool,
    half: Vec<f64>,
}

/// How the train of an inverse is made.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Which.
    pub kind: Kind,
    /// Of the block-scaled matrix instead of S.
    pub scaled: bool,
    /// Relative accuracy and largest rank.
    pub truncation: Truncation,
}

impl Approximate {
    /// Makes it from the exact inverse of the matrix, or (iterated) from its train. `None` where the exact
    /// inverse is wanted and absent.
    ///
    /// # Errors
    /// [`ReproduceError`] for a breakdown or an end of patience.
    pub fn new(
        wanted: Wanted,
        exact: Option<&Exact>,
        train: &TtMatrix,
        slots: &Slots,
        stop: Stop<'_>,
    ) -> Result<Option<Self>, ReproduceError> {
        let Wanted { kind, scaled, truncation } = wanted;
        let (x, error) = match (kind, exact) {
            (Kind::Iterated(max_sweeps), _) => {
                let Truncation { tolerance, max_rank } = truncation;
                let settings = SolveSettings { tolerance, max_rank, max_sweeps, ..SolveSettings::default() };
                let (x, report) = inverse_within(train, InverseForm::Energy, None, &settings, stop)?;
                (x, report.residual)
            }
            (_, None) => return Ok(None),
            (Kind::Truncated, Some(exact)) => {
                let (x, report) = augmented(&exact.inverse, slots)?.to_train(&truncation)?;
                (x, report.error)
            }
            (Kind::Shifted, Some(exact)) => {
                let (x, report) =
                    augmented(&exact.inverse, slots)?.to_definite_train(&truncation, FLOOR, LANCZOS)?;
                (x, report.error)
            }
            (Kind::Factor, Some(exact)) => {
                let (x, report) =
                    augmented(&exact.factor.inverse_of_lower(), slots)?.to_train(&truncation)?;
                (x, report.error)
            }
        };
        let factored = kind == Kind::Factor;
        Ok(Some(Self {
            ranks: (mean_rank(&x), x.max_rank()),
            error,
            definite: factored || is_definite(&x)?,
            operator: PaddedOperator::new(&x)?,
            transposed: if factored { Some(PaddedOperator::new(&x.transpose())?) } else { None },
            scaled,
            half: Vec::new(),
        }))
    }

    /// z <- X r, with the scaling where it is that of the scaled matrix.
    pub fn apply(&mut self, system: &System, slots: &Slots, r: &[f64], z: &mut [f64]) {
        let Self { operator, transposed, scaled, half, .. } = self;
        half.clear();
        half.extend_from_slice(r);
        if *scaled {
            system.jacobi.solve_lower(half);
        }
        operator.apply(3, &slots.place, half, z);
        if let Some(transposed) = transposed {
            half.copy_from_slice(z);
            transposed.apply(3, &slots.place, half, z);
        }
        if *scaled {
            system.jacobi.solve_upper(z);
        }
    }
}

/// Whether Lanczos finds no negative eigenvalue of (X + X^T) / 2. A Ritz value is a Rayleigh quotient: a
/// negative one is a proof.
fn is_definite(x: &TtMatrix) -> Result<bool, TtError> {
    let symmetric = SymmetricTrain::symmetric_part(x)?.round(&Truncation::to(1e-14))?.0.to_matrix();
    Ok(extreme_eigenvalues(&FullOperator::new(&symmetric)?, LANCZOS, 1)?.0.value > 0.0)
}

/// A matrix of at most 3 600 unknowns, factored and inverted as a full one.
pub struct Exact {
    factor: Cholesky,
    inverse: Matrix,
}

impl Exact {
    /// Of this matrix; `None` where it is too large. O(n^3).
    ///
    /// # Errors
    /// [`ReproduceError::Linear`] where it is not positive definite in floating point.
    pub fn new(matrix: &BlockMatrix3) -> Result<Option<Self>, ReproduceError> {
        let n = 3 * matrix.num_rows();
        if n > EXACT {
            return Ok(None);
        }
        let mut full = Matrix::zeros(n, n);
        for (i, j, block) in matrix.iter() {
            for (e, &value) in block.iter().enumerate() {
                full[(3 * i + e / 3, 3 * j + e % 3)] = value;
            }
        }
        let factor = Cholesky::new(full).map_err(|error| ReproduceError::Linear(error.to_string()))?;
        let mut inverse = Matrix::identity(n);
        factor.solve_in_place(inverse.view_mut());
        Ok(Some(Self { factor, inverse }))
    }
}

/// A full matrix over the unknowns among the slots. Free slots, which no product reads, have the mean
/// diagonal entry: ones would drown an inverse of small entries.
fn augmented(matrix: &Matrix, slots: &Slots) -> Result<QuadtreeMatrix, TtError> {
    let unknowns = matrix.rows();
    let position = |i: usize| 3 * slots.place[i / 3] + i % 3;
    let entries = (0..unknowns)
        .flat_map(|j| (0..unknowns).map(move |i| (i, j)))
        .filter(|&(i, j)| matrix[(i, j)] != 0.0);
    let own = entries.map(|(i, j)| (position(i), position(j), matrix[(i, j)]));
    let mut free = vec![true; slots.unknowns()];
    (0..unknowns).for_each(|i| free[position(i)] = false);
    let mean = (0..unknowns).map(|i| matrix[(i, i)]).sum::<f64>() / unknowns as f64;
    let dummies = (0..free.len()).filter(|&i| free[i]).map(|i| (i, i, mean));
    QuadtreeMatrix::from_entries(3 * slots.capacity, slots.depth, own.chain(dummies))
}
