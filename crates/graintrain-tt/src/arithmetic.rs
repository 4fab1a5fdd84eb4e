//! Sums, entrywise and Kronecker products, inner products, and products with trains of matrices.
//!
//! Ranks add in a sum and multiply in a product; round afterwards.

use crate::round::keep_memory;
use crate::scale::levelled;
use crate::vector::Core;
use crate::{TtError, TtMatrix, TtVector};
use graintrain_linalg::dense::{Matrix, View, ViewMut, multiply, product};

/// Modes of at least this size are contracted by matrix products.
const GEMM_MODE: usize = 8;

impl Core {
    /// The core of a sum of two trains: both on the diagonal; one row of two cores at the first of a train,
    /// one column at the last, where the outer rank stays that of the terms.
    pub(crate) fn direct_sum(&self, other: &Self, first: bool, last: bool) -> Self {
        let left = if first { self.left } else { self.left + other.left };
        let right = if last { self.right } else { self.right + other.right };
        let mut data = vec![0.0; left * self.mode * right];
        let mut place = |core: &Self, row: usize, column: usize| {
            for (fibre, source) in core.data.chunks_exact(core.left.max(1)).enumerate() {
                let at = row + left * (fibre + column * core.mode);
                data[at..at + core.left].iter_mut().zip(source).for_each(|(to, from)| *to += from);
            }
        };
        place(self, 0, 0);
        place(other, left - other.left, right - other.right);
        Self { left, mode: self.mode, right, data }
    }
}

impl TtVector {
    /// a * self, the factor going into the first core.
    pub fn scale(&self, a: f64) -> Self {
        let mut train = self.clone();
        train.cores[0].data.iter_mut().for_each(|x| *x *= a);
        train
    }

    /// self + other: block-diagonal cores, ranks add. (Powers of two of extreme cores are shared among all of
    /// them first.)
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn add(&self, other: &Self) -> Result<Self, TtError> {
        self.check_same_modes(other)?;
        let d = self.num_cores();
        let mut cores = Vec::with_capacity(d);
        let (first, second) = (levelled(self), levelled(other));
        for (k, (x, y)) in first.cores.iter().zip(&second.cores).enumerate() {
            cores.push(x.direct_sum(y, k == 0, k + 1 == d));
        }
        Ok(Self { cores })
    }

    /// self - other.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn subtract(&self, other: &Self) -> Result<Self, TtError> {
        self.add(&other.scale(-1.0))
    }

    /// Entrywise (Hadamard) product: Kronecker products of the slices, ranks multiply.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn hadamard(&self, other: &Self) -> Result<Self, TtError> {
        self.check_same_modes(other)?;
        let multiply_cores = |(x, y): (&Core, &Core)| {
            let mut data = Vec::with_capacity(x.data.len() * y.data.len() / x.mode);
            for beta in 0..x.right * y.right {
                for i in 0..x.mode {
                    let column = |core: &Core, beta: usize| core.left * (i + core.mode * beta);
                    let from = column(x, beta % x.right);
                    let xs = &x.data[from..from + x.left];
                    let from = column(y, beta / x.right);
                    y.data[from..from + y.left].iter().for_each(|y| data.extend(xs.iter().map(|x| x * y)));
                }
            }
            Core { left: x.left * y.left, mode: x.mode, right: x.right * y.right, data }
        };
        Ok(Self { cores: self.cores.iter().zip(&other.cores).map(multiply_cores).collect() })
    }

    /// other (x) self: the cores of `self` are the fine digits, those of `other` the coarse ones.
    pub fn kronecker(&self, other: &Self) -> Self {
        Self { cores: self.cores.iter().chain(&other.cores).cloned().collect() }
    }

    /// The digits in reverse order: core k becomes core d + 1 - k.
    pub fn reverse(&self) -> Self {
        let turn = |core: &Core| {
            Core::from_fn(core.right, core.mode, core.left, |alpha, i, beta| core.get(beta, i, alpha))
        };
        Self { cores: self.cores.iter().rev().map(turn).collect() }
    }

    /// Inner product <self, other> by a sweep of interfaces; O(d n r^3).
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes differ.
    pub fn dot(&self, other: &Self) -> Result<f64, TtError> {
        self.check_same_modes(other)?;
        keep_memory(other);
        let (mut interface, mut memory) = (Matrix::identity(1), Vec::new());
        for (x, y) in self.cores.iter().zip(&other.cores) {
            (interface, memory) = push_dot_in(&interface, x, y, memory);
        }
        Ok(interface[(0, 0)])
    }
}

/// The interface P' = sum_i X(i)^T P Y(i) of two trains, one core further to the right.
pub(crate) fn push_dot(interface: &Matrix, x: &Core, y: &Core) -> Matrix {
    push_dot_in(interface, x, y, Vec::new()).0
}

/// [`push_dot`] in the given memory for P Y, which comes back.
fn push_dot_in(interface: &Matrix, x: &Core, y: &Core, memory: Vec<f64>) -> (Matrix, Vec<f64>) {
    let carried = y.multiply_left_in(interface.view(), 0, memory);
    let next = product(x.left_unfolding().t(), carried.left_unfolding());
    (next, carried.data)
}

impl TtMatrix {
    /// a * self.
    pub fn scale(&self, a: f64) -> Self {
        self.map(|train| train.scale(a))
    }

    /// self + other, ranks add.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes differ.
    pub fn add(&self, other: &Self) -> Result<Self, TtError> {
        self.check_same_sizes(other)?;
        let sum = self.train.add(&other.train)?;
        Ok(self.map(|_| sum))
    }

    /// self - other, ranks add.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes differ.
    pub fn subtract(&self, other: &Self) -> Result<Self, TtError> {
        self.add(&other.scale(-1.0))
    }

    /// Entrywise product, ranks multiply.
    ///
    /// # Errors
    /// [`TtError::Shape`] if the sizes differ.
    pub fn hadamard(&self, other: &Self) -> Result<Self, TtError> {
        self.check_same_sizes(other)?;
        let entrywise = self.train.hadamard(&other.train)?;
        Ok(self.map(|_| entrywise))
    }

    /// other (x) self: the digits of `self` stay the fine ones.
    pub fn kronecker(&self, other: &Self) -> Self {
        Self {
            rows: [&self.rows[..], &other.rows].concat(),
            columns: [&self.columns[..], &other.columns].concat(),
            train: self.train.kronecker(&other.train),
        }
    }

    /// (A + A^T) / 2, ranks double.
    ///
    /// # Errors
    /// [`TtError::Shape`] if a core is not square.
    pub fn symmetric_part(&self) -> Result<Self, TtError> {
        self.check_square()?;
        Ok(self.add(&self.transpose())?.scale(0.5))
    }

    /// A x: core k of the result is sum_j A_k(a, i, j, a') X_k(alpha, j, alpha'), ranks multiply.
    /// O(d n^2 R^2 r^2).
    ///
    /// # Errors
    /// [`TtError::Shape`] if the modes of x are not the columns of A.
    pub fn times_vector(&self, x: &TtVector) -> Result<TtVector, TtError> {
        self.check_columns(x)?;
        let cores = (0..self.num_cores()).map(|k| self.contract(k, &x.cores[k], 1, Vec::new())).collect();
        Ok(TtVector { cores })
    }

    /// y <- A x in the memory of y, which may be any train: where a product is formed again and again, asking
    /// the system for its memory costs as much as the product.
    ///
    /// # Errors
    /// As for [`TtMatrix::times_vector`].
    ///
    /// ```
    /// use graintrain_tt::{TtVector, qtt};
    /// let (a, x) = (qtt::laplacian(10)?, qtt::sine(10, 0.1, 0.3)?);
    /// let mut y = TtVector::constant(&[2; 10], 0.0)?;
    /// a.times_vector_into(&x, &mut y)?;
    /// assert_eq!(y, a.times_vector(&x)?);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn times_vector_into(&self, x: &TtVector, y: &mut TtVector) -> Result<(), TtError> {
        self.check_columns(x)?;
        y.cores.truncate(self.num_cores());
        for k in 0..self.num_cores() {
            let memory = y.cores.get_mut(k).map_or_else(Vec::new, |core| std::mem::take(&mut core.data));
            let core = self.contract(k, &x.cores[k], 1, memory);
            match y.cores.get_mut(k) {
                Some(place) => *place = core,
                None => y.cores.push(core),
            }
        }
        Ok(())
    }

    /// A B as a train, ranks multiply. O(d n^3 R^2 r^2).
    ///
    /// # Errors
    /// [`TtError::Shape`] if the columns of A are not the rows of B.
    ///
    /// ```
    /// use graintrain_tt::{TtMatrix, Truncation, qtt};
    /// let a = qtt::laplacian(4)?;
    /// let square = a.times_matrix(&a)?.round(&Truncation::to(1e-13))?.0;
    /// assert_eq!(square.ranks(), [1, 4, 5, 4, 1]); // 4 <= rank <= 5 for the biharmonic-like square
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn times_matrix(&self, other: &Self) -> Result<Self, TtError> {
        self.check_inner(other)?;
        let cores = (0..self.num_cores())
            .map(|k| self.contract(k, &other.cores()[k], other.columns[k], Vec::new()))
            .collect();
        Ok(Self { rows: self.rows.clone(), columns: other.columns.clone(), train: TtVector { cores } })
    }

    /// Fails unless rows and columns agree digit by digit.
    pub(crate) fn check_same_sizes(&self, other: &Self) -> Result<(), TtError> {
        if self.rows == other.rows && self.columns == other.columns {
            return Ok(());
        }
        Err(TtError::Shape {
            what: "sizes of two matrices",
            expected: [&self.rows[..], &self.columns].concat(),
            got: [&other.rows[..], &other.columns].concat(),
        })
    }

    /// Fails unless the rows of the other matrix are the columns of this one.
    pub(crate) fn check_inner(&self, other: &Self) -> Result<(), TtError> {
        if self.columns == other.rows {
            return Ok(());
        }
        let (expected, got) = (self.columns.clone(), other.rows.clone());
        Err(TtError::Shape { what: "rows of B in A B", expected, got })
    }

    /// Fails unless the modes of x are the columns of the matrix.
    pub(crate) fn check_columns(&self, x: &TtVector) -> Result<(), TtError> {
        let got = x.modes();
        if got == self.columns {
            return Ok(());
        }
        Err(TtError::Shape { what: "modes of A x", expected: self.columns.clone(), got })
    }

    /// sum_j A_k(a, i, j, a') X(alpha, j, s, alpha') as a core with left (a, alpha), mode (i, s), right (a',
    /// alpha'), in the given memory.
    ///
    /// For every (i, s, a', alpha') this is a product (a x j) (j x alpha) that lands in its place: a matrix
    /// product for large modes. For small ones both columns are first spread to the length of the result, a
    /// with its period and alpha in runs, so that the inner loop is as long as the result and not as short as
    /// a rank; every number is written once.
    fn contract(&self, k: usize, x: &Core, s: usize, mut data: Vec<f64>) -> Core {
        let (a, m, n) = (&self.cores()[k], self.rows[k], self.columns[k]);
        let (ra, rb, rx, ry) = (a.left, a.right, x.left, x.right);
        let length = ra * rx;
        data.clear();
        data.reserve_exact(length * m * s * rb * ry);
        let x_blocks = x.data.chunks_exact(rx * n * s);
        if n >= GEMM_MODE {
            data.resize(length * m * s * rb * ry, 0.0);
            for (x_block, out) in x_blocks.zip(data.chunks_exact_mut(length * m * s * rb)) {
                for (block, out) in out.chunks_exact_mut(length).enumerate() {
                    let (i, spectator, b) = (block % m, (block / m) % s, block / (m * s));
                    let a_columns = View::with_stride(&a.data[ra * (i + m * n * b)..], ra, n, ra * m);
                    let x_columns = View::new(&x_block[rx * n * spectator..][..rx * n], rx, n);
                    multiply(1.0, a_columns, x_columns.t(), ViewMut::new(out, ra, rx));
                }
            }
        } else {
            let periods: Vec<f64> = a.data.chunks_exact(ra).flat_map(|column| column.repeat(rx)).collect();
            let mut runs = vec![0.0; length * n * s];
            for x_block in x_blocks {
                runs.chunks_exact_mut(ra).zip(x_block).for_each(|(run, x)| run.fill(*x));
                for b in 0..rb {
                    for runs in runs.chunks_exact(length * n) {
                        for i in 0..m {
                            let period = |j: usize| &periods[length * (i + m * (j + n * b))..][..length];
                            let run = |j: usize| &runs[length * j..][..length];
                            let first = data.len();
                            if n == 1 {
                                data.extend(period(0).iter().zip(run(0)).map(|(a, x)| a * x));
                                continue;
                            }
                            let (zero, one) = (period(0).iter().zip(run(0)), period(1).iter().zip(run(1)));
                            data.extend(zero.zip(one).map(|((a, x), (b, y))| a * x + b * y));
                            for j in 2..n {
                                let terms = period(j).iter().zip(run(j));
                                data[first..].iter_mut().zip(terms).for_each(|(out, (a, x))| *out += a * x);
                            }
                        }
                    }
                }
            }
        }
        Core { left: length, mode: m * s, right: rb * ry, data }
    }
}
