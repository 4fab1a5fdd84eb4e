//! The tensor train of a matrix: modes are pairs (row digit, column digit).

use crate::vector::{Core, LARGEST_CORE, check_index};
use crate::{FullMatrix, TtError, TtVector};
use serde::{Deserialize, Serialize};

/// A matrix in tensor-train form: A(i, j) = G_1(i_1, j_1) G_2(i_2, j_2) ... G_d(i_d, j_d).
///
/// Row i = i_1 + m_1 i_2 + m_1 m_2 i_3 + ..., column j = j_1 + n_1 j_2 + ...; mode k is the pair b_k = i_k +
/// m_k j_k, so core k is G(alpha, i, j, beta) at `alpha + r (i + m (j + n beta))`, and every operation on
/// vectors (sum, rounding, norm, entries) holds for matrices through [`TtMatrix::as_vector`].
///
/// ```
/// use graintrain_tt::TtMatrix;
/// let a = TtMatrix::identity(&[3, 2, 2])?;
/// assert_eq!(a.entry(&[2, 0, 1], &[2, 0, 1])?, 1.0);
/// assert_eq!(a.trace()?, 12.0);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Stored", into = "Stored")]
pub struct TtMatrix {
    pub(crate) rows: Vec<usize>,
    pub(crate) columns: Vec<usize>,
    pub(crate) train: TtVector,
}

/// What serde sees; checked on the way in.
#[derive(Serialize, Deserialize)]
struct Stored {
    rows: Vec<usize>,
    columns: Vec<usize>,
    train: TtVector,
}

impl TryFrom<Stored> for TtMatrix {
    type Error = TtError;

    fn try_from(stored: Stored) -> Result<Self, TtError> {
        Self::from_vector(stored.train, &stored.rows, &stored.columns)
    }
}

impl From<TtMatrix> for Stored {
    fn from(matrix: TtMatrix) -> Self {
        Self { rows: matrix.rows, columns: matrix.columns, train: matrix.train }
    }
}

impl TtMatrix {
    /// A matrix from a train whose modes are m_k n_k, row digit fastest.
    ///
    /// # Errors
    /// [`TtError::Shape`] if mode k is not rows\[k\] * columns\[k\].
    pub fn from_vector(train: TtVector, rows: &[usize], columns: &[usize]) -> Result<Self, TtError> {
        let expected: Vec<usize> = rows.iter().zip(columns).map(|(m, n)| m.saturating_mul(*n)).collect();
        let got = train.modes();
        if expected != got || rows.len() != columns.len() {
            return Err(TtError::Shape {
                what: "mode sizes of a matrix (rows times columns)",
                expected,
                got,
            });
        }
        Ok(Self { rows: rows.to_vec(), columns: columns.to_vec(), train })
    }

    /// A matrix from cores of shape r x (m n) x r'.
    ///
    /// # Errors
    /// [`TtError::Shape`] as for [`TtVector::from_cores`] and [`TtMatrix::from_vector`].
    pub fn from_cores(cores: Vec<Core>, rows: &[usize], columns: &[usize]) -> Result<Self, TtError> {
        Self::from_vector(TtVector::from_cores(cores)?, rows, columns)
    }

    /// The Kronecker product A_d (x) ... (x) A_1 of small column-major matrices: rank one.
    ///
    /// # Errors
    /// [`TtError::Shape`] if a factor does not hold rows\[k\] * columns\[k\] numbers.
    pub fn rank_one(factors: &[Vec<f64>], rows: &[usize], columns: &[usize]) -> Result<Self, TtError> {
        Self::from_vector(TtVector::rank_one(factors)?, rows, columns)
    }

    /// The identity: rank one.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no mode or a mode is empty, [`TtError::TooLarge`] for a mode above
    /// 2^14.
    pub fn identity(modes: &[usize]) -> Result<Self, TtError> {
        if let Some(&n) = modes.iter().find(|&&n| n.saturating_mul(n) > LARGEST_CORE) {
            return Err(TtError::TooLarge { entries: (n as f64).powi(2) });
        }
        let eye = |&n: &usize| (0..n * n).map(|b| f64::from(b % (n + 1) == 0)).collect();
        Self::rank_one(&modes.iter().map(eye).collect::<Vec<_>>(), modes, modes)
    }

    /// diag(x), with the ranks of x.
    pub fn from_diagonal(x: &TtVector) -> Self {
        let modes = x.modes();
        let diagonal = |core: &Core| {
            let n = core.mode;
            let entry =
                |alpha, b: usize, beta| if b % n == b / n { core.get(alpha, b % n, beta) } else { 0.0 };
            Core::from_fn(core.left, n * n, core.right, entry)
        };
        let cores = x.cores.iter().map(diagonal).collect();
        Self { rows: modes.clone(), columns: modes, train: TtVector { cores } }
    }

    /// Ranks `rank` (where allowed) and uniform entries in the cores, from a seed.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes are empty or of different number.
    pub fn random(rows: &[usize], columns: &[usize], rank: usize, seed: u64) -> Result<Self, TtError> {
        let modes: Vec<usize> = rows.iter().zip(columns).map(|(m, n)| m.saturating_mul(*n)).collect();
        Self::from_vector(TtVector::random(&modes, rank, seed)?, rows, columns)
    }

    /// Row digits m_1, ..., m_d.
    pub fn row_modes(&self) -> &[usize] {
        &self.rows
    }

    /// Column digits n_1, ..., n_d.
    pub fn column_modes(&self) -> &[usize] {
        &self.columns
    }

    /// The train over paired modes.
    pub fn as_vector(&self) -> &TtVector {
        &self.train
    }

    /// The train over paired modes, taken.
    pub fn into_vector(self) -> TtVector {
        self.train
    }

    /// The same sizes with other values: `change` maps the train over paired modes.
    pub(crate) fn map(&self, change: impl FnOnce(&TtVector) -> TtVector) -> Self {
        Self { rows: self.rows.clone(), columns: self.columns.clone(), train: change(&self.train) }
    }

    /// The cores, of shape r x (m n) x r'.
    pub fn cores(&self) -> &[Core] {
        &self.train.cores
    }

    /// Number of cores d.
    pub fn num_cores(&self) -> usize {
        self.train.num_cores()
    }

    /// Ranks r_0 = 1, r_1, ..., r_d = 1.
    pub fn ranks(&self) -> Vec<usize> {
        self.train.ranks()
    }

    /// The largest rank.
    pub fn max_rank(&self) -> usize {
        self.train.max_rank()
    }

    /// Number of rows of the full matrix.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] if it exceeds an index.
    pub fn num_rows(&self) -> Result<usize, TtError> {
        checked_product(&self.rows)
    }

    /// Number of columns of the full matrix.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] if it exceeds an index.
    pub fn num_columns(&self) -> Result<usize, TtError> {
        checked_product(&self.columns)
    }

    /// A(i, j) from the digits of i and j.
    ///
    /// # Errors
    /// [`TtError::Index`] or [`TtError::Shape`] if a digit is outside or the numbers of digits are wrong.
    pub fn entry(&self, row: &[usize], column: &[usize]) -> Result<f64, TtError> {
        check_index(&self.rows, row)?;
        check_index(&self.columns, column)?;
        let pair: Vec<usize> = (0..row.len()).map(|k| row[k] + self.rows[k] * column[k]).collect();
        self.train.entry(&pair)
    }

    /// Many entries from (row, column) numbers of the full matrix.
    ///
    /// # Errors
    /// [`TtError::Index`] if a row or column is outside.
    pub fn entries(&self, positions: &[(usize, usize)]) -> Result<Vec<f64>, TtError> {
        let mut indices = Vec::with_capacity(positions.len() * self.num_cores());
        for &(row, column) in positions {
            self.push_pair_index(row, column, &mut indices)?;
        }
        self.train.entries(&indices)
    }

    /// Appends the paired mode indices of entry (row, column).
    pub(crate) fn push_pair_index(
        &self,
        row: usize,
        column: usize,
        out: &mut Vec<usize>,
    ) -> Result<(), TtError> {
        let (mut i, mut j) = (row, column);
        for (&m, &n) in self.rows.iter().zip(&self.columns) {
            out.push(i % m + m * (j % n));
            (i, j) = (i / m, j / n);
        }
        let outside = |mode, index, sizes: &[usize]| {
            let size = sizes.iter().fold(1usize, |product, &n| product.saturating_mul(n));
            Err(TtError::Index { mode, index, size })
        };
        if i > 0 {
            outside(0, row, &self.rows)
        } else if j > 0 {
            outside(1, column, &self.columns)
        } else {
            Ok(())
        }
    }

    /// The full matrix, column-major.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] above 2^31 entries.
    pub fn to_full(&self) -> Result<FullMatrix, TtError> {
        let paired = self.train.to_full()?;
        let (m, n) = (self.num_rows()?, self.num_columns()?);
        let mut full = FullMatrix::new(m, n, vec![0.0; paired.len()])?;
        let mut digits = vec![0; self.num_cores()];
        let modes = self.train.modes();
        for value in paired {
            let (mut i, mut j, mut row_step, mut column_step) = (0, 0, 1, 1);
            for (k, b) in digits.iter().enumerate() {
                i += row_step * (b % self.rows[k]);
                j += column_step * (b / self.rows[k]);
                row_step *= self.rows[k];
                column_step *= self.columns[k];
            }
            full[(i, j)] = value;
            for (digit, &size) in digits.iter_mut().zip(&modes) {
                *digit += 1;
                if *digit < size {
                    break;
                }
                *digit = 0;
            }
        }
        Ok(full)
    }

    /// The transpose: i and j of every core exchanged.
    pub fn transpose(&self) -> Self {
        let mut cores = Vec::with_capacity(self.num_cores());
        for (k, core) in self.cores().iter().enumerate() {
            let (m, n) = (self.rows[k], self.columns[k]);
            cores.push(Core::from_fn(core.left, m * n, core.right, |alpha, b, beta| {
                let (j, i) = (b % n, b / n);
                core.get(alpha, i + m * j, beta)
            }));
        }
        Self { rows: self.columns.clone(), columns: self.rows.clone(), train: TtVector { cores } }
    }

    /// The diagonal of a square matrix as a train, same ranks.
    ///
    /// # Errors
    /// [`TtError::Shape`] if a core is not square.
    pub fn diagonal(&self) -> Result<TtVector, TtError> {
        self.check_square()?;
        let diagonal = |core: &Core, n: usize| {
            Core::from_fn(core.left, n, core.right, |alpha, i, beta| core.get(alpha, i * (n + 1), beta))
        };
        let cores = self.cores().iter().zip(&self.rows).map(|(core, &n)| diagonal(core, n)).collect();
        Ok(TtVector { cores })
    }

    /// Sum of the diagonal; O(d n r^2).
    ///
    /// # Errors
    /// [`TtError::Shape`] if a core is not square.
    pub fn trace(&self) -> Result<f64, TtError> {
        Ok(self.diagonal()?.sum())
    }

    /// Fails unless every core is square.
    pub(crate) fn check_square(&self) -> Result<(), TtError> {
        if self.rows == self.columns {
            return Ok(());
        }
        Err(TtError::Shape {
            what: "column sizes of a square matrix",
            expected: self.rows.clone(),
            got: self.columns.clone(),
        })
    }
}

/// The product of sizes, or an error where it exceeds an index.
pub(crate) fn checked_product(sizes: &[usize]) -> Result<usize, TtError> {
    let too_large = TtError::TooLarge { entries: sizes.iter().map(|&n| n as f64).product() };
    sizes.iter().try_fold(1usize, |product, &n| product.checked_mul(n)).ok_or(too_large)
}
