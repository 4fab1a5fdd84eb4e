//! Complex trains: real trains with one more mode of size 2, real and imaginary part, before the finest
//! digit.
//!
//! A complex tensor of ranks r is such a real one of ranks up to 2 r, and everything real trains can do
//! (norms, rounding with its promise, TT-SVD, cross, solvers) holds for it with the same code: lengths of
//! complex vectors are lengths of real ones. A wave exp(i w j) has ranks 2. What is particular to complex
//! numbers is here: products, conjugates, inner products, matrices ([Re A, -Im A; Im A, Re A]), the Fourier
//! transform.

use crate::fourier::{Direction, fourier};
use crate::solve::{SolveReport, SolveSettings, solve_within};
use crate::vector::Core;
use crate::{Stop, Truncation, TruncationReport, TtError, TtMatrix, TtVector};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};

/// A complex tensor.
///
/// ```
/// use graintrain_tt::{Truncation, complex::ComplexVector, fourier::Direction};
/// use num_complex::Complex64;
/// // exp(i w j) on 2^30 points with w = 5 (2 pi) / 2^30: its transform is one entry, at 5.
/// let turn = 5.0 * std::f64::consts::TAU * 2f64.powi(-30);
/// let factor = |k: i32| vec![Complex64::new(1.0, 0.0), Complex64::cis(turn * 2f64.powi(k))];
/// let wave = ComplexVector::rank_one(&(0..30).map(factor).collect::<Vec<_>>())?;
/// let (spectrum, report) = wave.fourier(Direction::Forward, &Truncation::to(1e-10))?;
/// let mut five = vec![0; 30];
/// (five[0], five[2]) = (1, 1);
/// assert!((spectrum.entry(&five)? - Complex64::new(2f64.powi(15), 0.0)).norm() < 1e-4 && report.error <= 1e-10);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ComplexVector {
    /// Modes 2, n_1, ..., n_d.
    train: TtVector,
}

/// A complex matrix over paired modes, as the real matrix [Re A, -Im A; Im A, Re A] of the parts.
///
/// ```
/// use graintrain_tt::complex::{ComplexMatrix, ComplexVector};
/// use graintrain_tt::{TtMatrix, TtVector, qtt};
/// // (L - 0.01 + 0.02 i) x = 1 on a line of 2^8 points: waves that are absorbed.
/// let ones = TtMatrix::identity(&[2; 8])?;
/// let a = ComplexMatrix::new(&qtt::laplacian(8)?.add(&ones.scale(-0.01))?, &ones.scale(0.02))?;
/// let y = ComplexVector::from_real(&TtVector::constant(&[2; 8], 1.0)?)?;
/// let (x, report) = a.solve(&y, &Default::default())?;
/// assert!(report.residual < 1e-6);
/// assert!(a.times_vector(&x)?.subtract(&y)?.norm() < 2e-6 * y.norm());
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ComplexMatrix {
    matrix: TtMatrix,
}

impl ComplexVector {
    /// real + i imaginary.
    ///
    /// # Errors
    /// [`TtError::Shape`] if their modes differ.
    pub fn new(real: &TtVector, imaginary: &TtVector) -> Result<Self, TtError> {
        let part = |which: usize, x: &TtVector| -> Result<TtVector, TtError> {
            Ok(TtVector::unit(&[2], &[which])?.kronecker(x))
        };
        real.check_same_modes(imaginary)?;
        Ok(Self { train: part(0, real)?.add(&part(1, imaginary)?)? })
    }

    /// A real tensor as a complex one: the ranks stay.
    ///
    /// # Errors
    /// None for a train that is one.
    pub fn from_real(real: &TtVector) -> Result<Self, TtError> {
        Ok(Self { train: TtVector::unit(&[2], &[0])?.kronecker(real) })
    }

    /// The tensor of a real train whose first mode, of size 2, is real and imaginary part.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the first of at least two modes is not of size 2.
    pub fn from_parts(train: TtVector) -> Result<Self, TtError> {
        let modes = train.modes();
        if modes.len() < 2 || modes[0] != 2 {
            return Err(TtError::Shape {
                what: "first of the modes of a complex train",
                expected: vec![2],
                got: modes,
            });
        }
        Ok(Self { train })
    }

    /// The outer product of vectors, the first index the fastest: ranks 2.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no factor or an empty one.
    pub fn rank_one(factors: &[Vec<Complex64>]) -> Result<Self, TtError> {
        // A product of complex numbers is one of rotations: x + i y is [x y; -y x] from the left.
        let rotation = |z: Complex64, alpha: usize, beta: usize| match (alpha, beta) {
            (0, 1) => z.im,
            (1, 0) => -z.im,
            _ => z.re,
        };
        let d = factors.len();
        let mut cores = vec![Core::from_fn(1, 2, 2, |_, part, beta| f64::from(part == beta))];
        for (k, factor) in factors.iter().enumerate() {
            // The parts come in transposed and leave with the last factor: (1, 0) from its right.
            let right = if k + 1 == d { 1 } else { 2 };
            cores.push(Core::from_fn(2, factor.len(), right, |alpha, i, beta| {
                rotation(factor[i].conj(), alpha, beta)
            }));
        }
        if d == 0 {
            return Err(TtError::Shape { what: "factors", expected: vec![1], got: vec![0] });
        }
        Ok(Self { train: TtVector::from_cores(cores)? })
    }

    /// TT-SVD of a full tensor, first index fastest; as [`TtVector::from_full`], whose promise it keeps.
    ///
    /// # Errors
    /// As for [`TtVector::from_full`].
    pub fn from_full(
        full: &[Complex64],
        modes: &[usize],
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        if modes.is_empty() {
            return Err(TtError::Shape { what: "modes", expected: vec![1], got: vec![0] });
        }
        let parts: Vec<f64> = full.iter().flat_map(|z| [z.re, z.im]).collect();
        let (train, report) = TtVector::from_full(&parts, &[&[2], modes].concat(), truncation)?;
        Ok((Self { train }, report))
    }

    /// The real train behind it: modes 2, n_1, ..., n_d.
    pub fn as_parts(&self) -> &TtVector {
        &self.train
    }

    /// The sizes n_1, ..., n_d.
    pub fn modes(&self) -> Vec<usize> {
        self.train.modes().split_off(1)
    }

    /// Ranks of the real train from the bond before the first mode on: up to twice those of complex cores.
    pub fn ranks(&self) -> Vec<usize> {
        self.train.ranks().split_off(1)
    }

    /// Real part.
    pub fn real(&self) -> TtVector {
        self.part(0)
    }

    /// Imaginary part.
    pub fn imaginary(&self) -> TtVector {
        self.part(1)
    }

    fn part(&self, which: usize) -> TtVector {
        let (first, rest) = (&self.train.cores[0], &self.train.cores[1..]);
        let row = first.slice(which);
        let mut cores = rest.to_vec();
        let next = &rest[0];
        cores[0] = Core::from_fn(1, next.mode, next.right, |_, i, beta| {
            (0..next.left).map(|alpha| row.get(0, alpha) * next.get(alpha, i, beta)).sum()
        });
        TtVector { cores }
    }

    /// One entry; O(d r^2).
    ///
    /// # Errors
    /// [`TtError::Shape`] and [`TtError::Index`] for an index that does not fit.
    pub fn entry(&self, index: &[usize]) -> Result<Complex64, TtError> {
        let at = |part: usize| self.train.entry(&[&[part], index].concat());
        Ok(Complex64::new(at(0)?, at(1)?))
    }

    /// All entries, first index fastest.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] if they do not fit.
    pub fn to_full(&self) -> Result<Vec<Complex64>, TtError> {
        Ok(self.train.to_full()?.chunks_exact(2).map(|z| Complex64::new(z[0], z[1])).collect())
    }

    /// sqrt(sum |x|^2).
    pub fn norm(&self) -> f64 {
        self.train.norm()
    }

    /// sum conj(x_j) y_j.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn dot(&self, other: &Self) -> Result<Complex64, TtError> {
        let turned = self.scale(Complex64::I);
        Ok(Complex64::new(self.train.dot(&other.train)?, turned.train.dot(&other.train)?))
    }

    /// a x.
    pub fn scale(&self, a: Complex64) -> Self {
        self.with_first(|re, im| (a.re * re - a.im * im, a.re * im + a.im * re))
    }

    /// The conjugate.
    pub fn conjugate(&self) -> Self {
        self.with_first(|re, im| (re, -im))
    }

    /// The first core with its two numbers per column changed.
    fn with_first(&self, change: impl Fn(f64, f64) -> (f64, f64)) -> Self {
        let mut train = self.train.clone();
        for pair in train.cores[0].data.chunks_exact_mut(2) {
            (pair[0], pair[1]) = change(pair[0], pair[1]);
        }
        Self { train }
    }

    /// x + y: ranks add.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn add(&self, other: &Self) -> Result<Self, TtError> {
        Ok(Self { train: self.train.add(&other.train)? })
    }

    /// x - y.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn subtract(&self, other: &Self) -> Result<Self, TtError> {
        Ok(Self { train: self.train.subtract(&other.train)? })
    }

    /// The entrywise product x_j y_j: ranks multiply.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn hadamard(&self, other: &Self) -> Result<Self, TtError> {
        let mut train = self.train.hadamard(&other.train)?;
        // Of the parts the products are complex ones.
        let (x, y) = (&self.train.cores[0], &other.train.cores[0]);
        train.cores[0] = Core::from_fn(1, 2, x.right * y.right, |_, part, beta| {
            let (a, b) = (beta % x.right, beta / x.right);
            let z = Complex64::new(x.get(0, 0, a), x.get(0, 1, a))
                * Complex64::new(y.get(0, 0, b), y.get(0, 1, b));
            [z.re, z.im][part]
        });
        Ok(Self { train })
    }

    /// As [`TtVector::round`], with its promise.
    ///
    /// # Errors
    /// As for [`TtVector::round`].
    pub fn round(&self, truncation: &Truncation) -> Result<(Self, TruncationReport), TtError> {
        let (train, report) = self.train.round(truncation)?;
        Ok((Self { train }, report))
    }

    /// The unitary Fourier transform over 2^d numbers; see [`fourier`]. The report's error is a bound.
    ///
    /// # Errors
    /// As for [`fourier`].
    pub fn fourier(
        &self,
        direction: Direction,
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        // (The parts have the ranks of the whole: joined again they are rounded once more.)
        let most = Truncation { tolerance: 0.9 * truncation.tolerance, ..*truncation };
        let (real, imaginary, report) = fourier(&self.real(), Some(&self.imaginary()), direction, &most)?;
        let rest = Truncation { tolerance: 0.1 * truncation.tolerance, ..*truncation };
        let (whole, last) = Self::new(&real, &imaginary)?.round(&rest)?;
        let error = report.error + last.error;
        Ok((whole, TruncationReport { error, capped: report.capped || last.capped, ..report }))
    }
}

impl ComplexMatrix {
    /// real + i imaginary.
    ///
    /// # Errors
    /// [`TtError::Shape`] if their sizes differ.
    pub fn new(real: &TtMatrix, imaginary: &TtMatrix) -> Result<Self, TtError> {
        let of_parts = |numbers: [f64; 4]| TtMatrix::rank_one(&[numbers.to_vec()], &[2], &[2]);
        let whole = of_parts([1.0, 0.0, 0.0, 1.0])?.kronecker(real);
        let turned = of_parts([0.0, 1.0, -1.0, 0.0])?.kronecker(imaginary);
        Ok(Self { matrix: whole.add(&turned)? })
    }

    /// The real matrix of the parts: modes 2, n_1, ..., n_d.
    pub fn as_parts(&self) -> &TtMatrix {
        &self.matrix
    }

    /// A x: ranks multiply.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes do not fit.
    pub fn times_vector(&self, x: &ComplexVector) -> Result<ComplexVector, TtError> {
        Ok(ComplexVector { train: self.matrix.times_vector(&x.train)? })
    }

    /// A B: ranks multiply.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes do not fit.
    pub fn times_matrix(&self, other: &Self) -> Result<Self, TtError> {
        Ok(Self { matrix: self.matrix.times_matrix(&other.matrix)? })
    }

    /// The conjugate transpose.
    pub fn adjoint(&self) -> Self {
        Self { matrix: self.matrix.transpose() }
    }

    /// Solves A x = y; see [`solve`](crate::solve::solve). (The real matrix of a Hermitian one is symmetric.)
    ///
    /// # Errors
    /// As for [`solve`](crate::solve::solve).
    pub fn solve(
        &self,
        y: &ComplexVector,
        settings: &SolveSettings,
    ) -> Result<(ComplexVector, SolveReport), TtError> {
        self.solve_within(y, settings, &|| false)
    }

    /// As [`ComplexMatrix::solve`], as long as `stop` is false: it is asked at every site.
    ///
    /// # Errors
    /// As for [`ComplexMatrix::solve`], and [`TtError::Stopped`].
    pub fn solve_within(
        &self,
        y: &ComplexVector,
        settings: &SolveSettings,
        stop: Stop<'_>,
    ) -> Result<(ComplexVector, SolveReport), TtError> {
        let (train, report) = solve_within(&self.matrix, &y.train, None, settings, stop)?;
        Ok((ComplexVector { train }, report))
    }
}
