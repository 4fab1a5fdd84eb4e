//! Interfaces: everything left (or right) of one core of a linear system, contracted to small arrays.
//!
//! For test train P, operator A and trial train X the left interface is Phi_k(p, a, x) = sum Phi_{k-1}(p',
//! a', x') P(p', i, s, p) A(a', i, j, a) X(x', j, s, x), and for the right-hand side Y: phi_k(p, y) = sum
//! phi_{k-1}(p', y') P(p', i, s, p) Y(y', i, s, y). s is the spectator digit: a column index of a matrix
//! unknown that the operator does not touch (1 for vectors). Right interfaces are left interfaces of the
//! reversed trains, with the same layout.

use graintrain_linalg::dense::{Matrix, View, ViewMut, multiply, multiply_add};

/// A core G(alpha, i, s, beta) of a block vector, first index fastest.
#[derive(Clone, Debug)]
pub(crate) struct BlockCore {
    pub left: usize,
    pub n: usize,
    pub s: usize,
    pub right: usize,
    pub data: Vec<f64>,
}

impl BlockCore {
    /// The (left n s) x right unfolding.
    pub fn left_unfolding(&self) -> View<'_> {
        View::new(&self.data, self.left * self.n * self.s, self.right)
    }

    /// The left x (n s right) unfolding.
    pub fn right_unfolding(&self) -> View<'_> {
        View::new(&self.data, self.left, self.n * self.s * self.right)
    }

    /// G(beta, i, s, alpha): the core of the reversed train.
    pub fn reversed(&self) -> Self {
        let modes = self.n * self.s;
        let mut data = Vec::with_capacity(self.data.len());
        for alpha in 0..self.left {
            for mode in 0..modes {
                data.extend((0..self.right).map(|beta| self.data[alpha + self.left * (mode + modes * beta)]));
            }
        }
        Self { left: self.right, right: self.left, data, ..*self }
    }

    /// (alpha, i, s, beta) to (alpha, i, beta, s): one unknown vector per spectator.
    pub fn spectator_last(&self) -> Vec<f64> {
        let rows = self.left * self.n;
        let mut data = Vec::with_capacity(self.data.len());
        for s in 0..self.s {
            for beta in 0..self.right {
                let from = rows * (s + self.s * beta);
                data.extend_from_slice(&self.data[from..from + rows]);
            }
        }
        data
    }

    /// The inverse of [`BlockCore::spectator_last`].
    pub fn from_spectator_last(left: usize, n: usize, s: usize, right: usize, solved: &[f64]) -> Self {
        let rows = left * n;
        let mut data = Vec::with_capacity(solved.len());
        for beta in 0..right {
            for spectator in 0..s {
                let from = rows * (beta + right * spectator);
                data.extend_from_slice(&solved[from..from + rows]);
            }
        }
        Self { left, n, s, right, data }
    }

    /// M G.
    pub fn multiply_left(&self, m: View<'_>) -> Self {
        let mut data = vec![0.0; m.rows() * self.n * self.s * self.right];
        multiply(
            1.0,
            m,
            self.right_unfolding(),
            ViewMut::new(&mut data, m.rows(), self.n * self.s * self.right),
        );
        Self { left: m.rows(), data, ..*self }
    }
}

/// A core A(a, i, j, b) of the operator as the matrix [(a, j), (i, b)] that the contractions need.
#[derive(Clone, Debug)]
pub(crate) struct OperatorCore {
    pub left: usize,
    pub n: usize,
    pub right: usize,
    pub matrix: Matrix,
}

impl OperatorCore {
    /// From the numbers of a square core (a, i, j, b).
    pub fn new(left: usize, n: usize, right: usize, data: &[f64]) -> Self {
        let matrix = Matrix::from_fn(left * n, n * right, |row, column| {
            let (a, j, i, b) = (row % left, row / left, column % n, column / n);
            data[a + left * (i + n * (j + n * b))]
        });
        Self { left, n, right, matrix }
    }

    /// A(a, i, j, b).
    #[inline]
    pub fn get(&self, a: usize, i: usize, j: usize, b: usize) -> f64 {
        self.matrix[(a + self.left * j, i + self.n * b)]
    }

    /// A(b, i, j, a): the core of the reversed train.
    pub fn reversed(&self) -> Self {
        let (left, n, right) = (self.right, self.n, self.left);
        let matrix = Matrix::from_fn(left * n, n * right, |row, column| {
            self.get(column / n, column % n, row / left, row % left)
        });
        Self { left, n, right, matrix }
    }

    /// The two cores as one over the paired digit (i, i').
    pub fn merge(&self, next: &Self) -> Self {
        let n = self.n * next.n;
        let matrix = Matrix::from_fn(self.left * n, n * next.right, |row, column| {
            let (a, j) = (row % self.left, row / self.left);
            let (i, b) = (column % n, column / n);
            (0..self.right)
                .map(|c| self.get(a, i % self.n, j % self.n, c) * next.get(c, i / self.n, j / self.n, b))
                .sum()
        });
        Self { left: self.left, n, right: next.right, matrix }
    }
}

/// An interface Phi(p, a, x), p fastest: test rank, operator rank, trial rank.
#[derive(Clone, Debug)]
pub(crate) struct Interface {
    pub test: usize,
    pub operator: usize,
    pub trial: usize,
    pub data: Vec<f64>,
}

impl Interface {
    /// Beyond the end of the trains.
    pub fn one() -> Self {
        Self { test: 1, operator: 1, trial: 1, data: vec![1.0] }
    }

    /// The interface one core further.
    pub fn push(&self, test: &BlockCore, operator: &OperatorCore, trial: &BlockCore) -> Self {
        let through = self.through_operator(operator, &trial.data, trial.n, trial.s * trial.right);
        let (p, rows, b) = (test.right, test.left * test.n, operator.right);
        let mut data = vec![0.0; p * b * trial.right];
        for x in 0..trial.right {
            let to = &mut data[x * p * b..(x + 1) * p * b];
            for s in 0..trial.s {
                let from = rows * b * (s + trial.s * x);
                let columns = View::with_stride(&test.data[s * rows..], rows, p, rows * test.s);
                let carried = View::new(&through[from..from + rows * b], rows, b);
                multiply_add(1.0, columns.t(), carried, ViewMut::new(to, p, b));
            }
        }
        Self { test: p, operator: b, trial: trial.right, data }
    }

    /// sum over x, a, j of Phi(p, a, x) A(a, i, j, b) U(x, j, q) as [p, i, b, q].
    fn through_operator(&self, operator: &OperatorCore, u: &[f64], n: usize, rest: usize) -> Vec<f64> {
        let (p, a) = (self.test, self.operator);
        let mut carried = vec![0.0; p * a * n * rest];
        multiply(
            1.0,
            View::new(&self.data, p * a, self.trial),
            View::new(u, self.trial, n * rest),
            ViewMut::new(&mut carried, p * a, n * rest),
        );
        let (inner, wide) = (a * n, n * operator.right);
        let mut through = vec![0.0; p * wide * rest];
        for (from, to) in carried.chunks_exact(p * inner).zip(through.chunks_exact_mut(p * wide)) {
            multiply(1.0, View::new(from, p, inner), operator.matrix.view(), ViewMut::new(to, p, wide));
        }
        through
    }
}

/// An interface phi(p, y) with the right-hand side, p fastest.
pub(crate) fn push_right_hand_side(phi: &Matrix, test: &BlockCore, y: &BlockCore) -> Matrix {
    let carried = y.multiply_left(phi.view());
    let mut next = Matrix::zeros(test.right, y.right);
    multiply(1.0, test.left_unfolding().t(), carried.left_unfolding(), next.view_mut());
    next
}

/// The operator of one site between two interfaces, (x, j, x') to (p, i, p'):
/// sum Phi(p, a, x) A(a, i, j, b) Psi(p', b, x') U(x, j, x').
pub(crate) struct LocalOperator<'a> {
    pub left: &'a Interface,
    pub core: &'a OperatorCore,
    pub right: &'a Interface,
}

impl LocalOperator<'_> {
    /// Unknowns per spectator.
    pub fn size(&self) -> usize {
        self.left.trial * self.core.n * self.right.trial
    }

    /// Results per spectator.
    pub fn result_size(&self) -> usize {
        self.left.test * self.core.n * self.right.test
    }

    /// y <- B u for `u` of [x, j, x', s], giving [p, i, p', s].
    pub fn apply(&self, u: &[f64], y: &mut [f64]) {
        let spectators = u.len() / self.size();
        let n = self.core.n;
        let through = self.left.through_operator(self.core, u, n, self.right.trial * spectators);
        let (rows, inner) = (self.left.test * n, self.core.right * self.right.trial);
        let psi = View::new(&self.right.data, self.right.test, inner);
        for (from, to) in through.chunks_exact(rows * inner).zip(y.chunks_exact_mut(self.result_size())) {
            multiply(1.0, View::new(from, rows, inner), psi.t(), ViewMut::new(to, rows, self.right.test));
        }
    }

    /// The matrix B[(p, i, p'), (x, j, x')].
    pub fn to_matrix(&self) -> Matrix {
        let (p, x, n, a, b) = (self.left.test, self.left.trial, self.core.n, self.core.left, self.core.right);
        let (pp, xx) = (self.right.test, self.right.trial);
        // Phi as [(p, x), a] times A as [a, (j, i, b)].
        let phi = Matrix::from_fn(p * x, a, |row, a| {
            self.left.data[row % p + p * (a + self.left.operator * (row / p))]
        });
        let mut half = vec![0.0; p * x * n * n * b];
        let core = View::new(self.core.matrix.data(), a, n * n * b);
        multiply(1.0, phi.view(), core, ViewMut::new(&mut half, p * x, n * n * b));
        // [(p, x, j, i), b] times Psi as [b, (p', x')].
        let psi = Matrix::from_fn(b, pp * xx, |b, column| {
            self.right.data[column % pp + pp * (b + self.right.operator * (column / pp))]
        });
        let mut full = vec![0.0; p * x * n * n * pp * xx];
        multiply(
            1.0,
            View::new(&half, p * x * n * n, b),
            psi.view(),
            ViewMut::new(&mut full, p * x * n * n, pp * xx),
        );
        let mut matrix = Matrix::zeros(p * n * pp, x * n * xx);
        let rows = p * n * pp;
        let data = matrix.data_mut();
        let mut from = 0;
        for k in 0..pp * xx {
            let (test, trial) = (k % pp, k / pp);
            for i in 0..n {
                for j in 0..n {
                    for alpha in 0..x {
                        let to = p * (i + n * test) + rows * (alpha + x * (j + n * trial));
                        data[to..to + p].copy_from_slice(&full[from..from + p]);
                        from += p;
                    }
                }
            }
        }
        matrix
    }

    /// The n x n diagonal blocks B[(x, ., x'), (x, ., x')], one after the other.
    pub fn diagonal_blocks(&self) -> Vec<Matrix> {
        let n = self.core.n;
        let (rank, other) = (self.left.trial, self.right.trial);
        let phi = |alpha: usize, a: usize| {
            self.left.data[alpha + self.left.test * (a + self.left.operator * alpha)]
        };
        let psi = |gamma: usize, b: usize| {
            self.right.data[gamma + self.right.test * (b + self.right.operator * gamma)]
        };
        // Psi_diag as [b, gamma] times A as [(a, j, i), b].
        let psi_diagonal = Matrix::from_fn(self.core.right, other, |b, gamma| psi(gamma, b));
        let phi_diagonal = Matrix::from_fn(rank, self.core.left, phi);
        let height = self.core.left * n * n;
        let mut carried = Matrix::zeros(height, other);
        multiply(
            1.0,
            View::new(self.core.matrix.data(), height, self.core.right),
            psi_diagonal.view(),
            carried.view_mut(),
        );
        let mut blocks = Vec::with_capacity(rank * other);
        for gamma in 0..other {
            // [alpha, (j, i)]
            let mut all = Matrix::zeros(rank, n * n);
            multiply(
                1.0,
                phi_diagonal.view(),
                View::new(carried.column(gamma), self.core.left, n * n),
                all.view_mut(),
            );
            for alpha in 0..rank {
                blocks.push(Matrix::from_fn(n, n, |i, j| all[(alpha, j + n * i)]));
            }
        }
        blocks
    }
}

/// The right-hand side of one site, phi(p, y) Y(y, i, s, y') psi(p', y') as [p, i, p', s].
pub(crate) fn local_right_hand_side(phi: &Matrix, y: &BlockCore, psi: &Matrix) -> Vec<f64> {
    let carried = y.multiply_left(phi.view());
    let mut both = vec![0.0; carried.left * y.n * y.s * psi.rows()];
    multiply(
        1.0,
        carried.left_unfolding(),
        psi.t(),
        ViewMut::new(&mut both, carried.left * y.n * y.s, psi.rows()),
    );
    BlockCore { left: carried.left, n: y.n, s: y.s, right: psi.rows(), data: both }.spectator_last()
}
