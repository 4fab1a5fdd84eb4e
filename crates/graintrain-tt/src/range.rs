//! The columns of a large matrix of low rank in two reads: a random sketch finds their span, a projection
//! onto it follows and measures what the span leaves out.
//!
//! A (m x n, first index fastest) is taken to be of rank up to [`RANKS`]. First read: the columns are added,
//! with random signs, into [`BUCKETS`] random buckets (Clarkson and Woodruff, J. ACM 63, 2017), which costs
//! one addition per number, and the buckets are mixed by random signs to rank + [`TESTS`] columns Y = A
//! Omega. Q is an orthonormal basis of Y. Second read: B = Q^T A, so that A = Q B + what is left out (Halko,
//! Martinsson, Tropp, SIAM Review 53, 2011).
//!
//! What is left out is measured in the second read, so nothing rests on the luck of the sketch: a basis that
//! leaves out too much is discarded.

use crate::factor::SafeCholesky;
use crate::round::sum_of_squares;
use graintrain_linalg::dense::{
    Matrix, View, ViewMut, multiply, multiply_add, product, symmetric_eigen, thin_qr,
};
use graintrain_linalg::triangles::{gram, lower_gram};
use graintrain_linalg::vectorised::{Work, run_wide};
use rayon::prelude::*;

/// Most columns of the basis, and of the second attempt: ranks up to 32 and 100, and four to spare.
const RANKS: [usize; 2] = [36, 104];
/// Columns of the sketch that measure what the basis leaves out.
const TESTS: usize = 8;
/// The difference of ||A||^2 and ||B||^2, relative, is right to some 1e-15: it may decide on parts larger
/// than this.
const RESOLVED: f64 = 4e-14;
/// Singular values of the sketch whose squares are below this part of what may be left out belong to no
/// basis: their squares are about as many times those of A as the sketch has columns.
const FEW: f64 = 0.02;
/// Buckets of the first stage: enough that few columns that matter meet in one.
const BUCKETS: usize = 512;
/// Buckets that are filled before they are mixed (a divisor of [`BUCKETS`]).
const TOGETHER: usize = 128;
/// Numbers of a column that are added at a time.
const PIECE: usize = 1024;
/// Columns that are added at a time, and numbers of each.
const FOUR: usize = 4;
const LANES: usize = 8;
/// Columns of A per task of the second read.
const TASK: usize = 256;
/// Rows of the sketch per task.
const ROWS: usize = 256;

/// A = Q B within `left_out`.
pub(crate) struct Range {
    /// Orthonormal columns.
    pub(crate) basis: Matrix,
    /// Q^T A.
    pub(crate) coefficients: Matrix,
    /// ||A - Q B||_F^2.
    pub(crate) left_out: f64,
}

/// ||A||_F^2 and a basis of the columns of A that leaves out at most `allowed` times this of it; none if the rank is larger than [`RANKS`] as far as the
/// check can tell, or if A is too small for it. Two reads, 2 rank + 3 flops per number.
pub(crate) fn column_range(data: &[f64], m: usize, allowed: f64, seed: u64) -> (f64, Option<Range>) {
    let n = data.len() / m;
    let (first, norm_squared) = sketch(data, m, RANKS[0] + TESTS, seed);
    if !norm_squared.is_finite() || norm_squared == 0.0 {
        return (norm_squared, None);
    }
    let mut first = Some(first);
    for rank in RANKS.into_iter().filter(|rank| m.min(n) >= 4 * (rank + TESTS)) {
        let spanned = first.take().unwrap_or_else(|| sketch(data, m, rank + TESTS, seed).0);
        if let Some(basis) = promising_basis(&spanned, norm_squared, allowed) {
            let range = project(basis, data, norm_squared, allowed);
            if range.left_out <= allowed * norm_squared {
                return (norm_squared, Some(range));
            }
        }
    }
    (norm_squared, None)
}

/// The second read: B = Q^T A and what this leaves out, by the difference of the norms where that resolves
/// what may be left out, else by the norm of A - Q B.
fn project(basis: Matrix, data: &[f64], norm_squared: f64, allowed: f64) -> Range {
    let (m, columns) = (basis.rows(), basis.columns());
    let mut coefficients = Matrix::zeros(columns, data.len() / m);
    let explicit = allowed < RESOLVED;
    let task = |(to, from): (&mut [f64], &[f64])| {
        let width = from.len() / m;
        multiply(1.0, basis.t(), View::new(from, m, width), ViewMut::new(to, columns, width));
        if !explicit {
            // (Sums of sums: one long sum would lose the digits that the difference needs.)
            return to.chunks_exact(columns).map(sum_of_squares).sum();
        }
        let mut rest = from.to_vec();
        multiply_add(-1.0, basis.view(), View::new(to, columns, width), ViewMut::new(&mut rest, m, width));
        rest.iter().map(|x| x * x).sum::<f64>()
    };
    let tasks = coefficients.data_mut().par_chunks_mut(columns * TASK).zip(data.par_chunks(m * TASK));
    let squares: Vec<f64> = tasks.map(task).collect();
    let total: f64 = squares.iter().sum();
    let left_out = if explicit { total } else { (norm_squared - total).max(0.0) };
    Range { basis, coefficients, left_out }
}

/// An orthonormal basis of the sketch that seems to leave out at most `allowed` of the squared norm: it does
/// so of columns of the sketch that were set aside, E |(I - P) A omega|^2 = ||(I - P) A||^2. (Columns of A
/// that met in a bucket did so in all columns of the sketch, so this proves nothing: it saves reads that
/// would be in vain.)
fn promising_basis(spanned: &Spanned, norm_squared: f64, allowed: f64) -> Option<Matrix> {
    let tests = spanned.tests();
    let turned = spanned.turned()?;
    // As few columns as seem to do, by the sizes of the turned columns; all of them if the tests say that
    // they do not.
    let few = turned.squares.iter().take_while(|square| **square > FEW * allowed * norm_squared).count();
    for kept in [few, turned.squares.len()] {
        let basis = turned.basis(kept);
        // What the basis leaves of the tests. Twice: the first projection leaves rounding of the size of what
        // it takes away.
        let mut rest = tests.clone();
        for _ in 0..2 {
            let inside = product(basis.t(), rest.view());
            multiply_add(-1.0, basis.view(), inside.view(), rest.view_mut());
        }
        let left_out = rest.data().iter().map(|x| x * x).sum::<f64>() / TESTS as f64;
        // (The signs of a column of the sketch have variance one for every column of A.)
        if left_out <= allowed * norm_squared {
            return Some(basis);
        }
    }
    None
}

/// Y^T for the sketch Y = A Omega, so that rows of Y are tasks.
struct Spanned {
    /// rank + [`TESTS`] rows.
    transposed: Matrix,
}

/// Y V for the eigenvectors V of Y^T Y, largest first: columns that are orthogonal but for rounding, of all
/// sizes.
struct Turned {
    /// (Y V)^T.
    transposed: Matrix,
    /// Squared lengths of the columns.
    squares: Vec<f64>,
}

impl Spanned {
    /// The columns that are set aside.
    fn tests(&self) -> Matrix {
        let rank = self.transposed.rows() - TESTS;
        Matrix::from_fn(self.transposed.columns(), TESTS, |i, j| self.transposed[(rank + j, i)])
    }

    /// The other columns, turned; none where a number is not finite.
    fn turned(&self) -> Option<Turned> {
        let (all, m) = (self.transposed.rows(), self.transposed.columns());
        let rank = all - TESTS;
        let rows = View::with_stride(self.transposed.data(), rank, m, all);
        let (_, vectors) = symmetric_eigen(gram(rows.t()).view()).ok()?;
        let descending = Matrix::from_fn(rank, rank, |i, j| vectors[(i, rank - 1 - j)]);
        let mut transposed = Matrix::zeros(rank, m);
        let tasks = transposed.data_mut().par_chunks_mut(rank * ROWS);
        tasks.zip(self.transposed.data().par_chunks(all * ROWS)).for_each(|(to, from)| {
            let count = from.len() / all;
            let from = View::with_stride(from, rank, count, all);
            multiply(1.0, descending.t(), from, ViewMut::new(to, rank, count));
        });
        let mut squares = vec![0.0; rank];
        for row in transposed.data().chunks_exact(rank) {
            squares.iter_mut().zip(row).for_each(|(sum, x)| *sum += x * x);
        }
        Some(Turned { transposed, squares })
    }
}

impl Turned {
    /// An orthonormal basis of the first columns: by their Gram matrix (whose condition is that of columns
    /// brought to length one, see [`crate::factor`]) at the rate of products, else by reflections.
    fn basis(&self, kept: usize) -> Matrix {
        let (rank, m) = (self.transposed.rows(), self.transposed.columns());
        let columns = View::with_stride(self.transposed.data(), kept, m, rank).t();
        match SafeCholesky::new(&lower_gram(columns)) {
            Some(factor) => {
                // Twice: what a basis leaves out is a difference of norms, which no other rounding of the
                // basis may enter.
                let basis = factor.orthonormal(columns);
                let again = SafeCholesky::new(&lower_gram(basis.view()));
                again.map_or_else(|| basis.clone(), |factor| factor.orthonormal(basis.view()))
            }
            None => thin_qr(Matrix::from_fn(m, kept, |i, j| columns.get(i, j))).0,
        }
    }
}

/// `columns` signed sums of the columns of A, each by way of the buckets, and the sum of the squares of all
/// numbers. A bucket is one task; only [`TOGETHER`] buckets live at a time.
fn sketch(data: &[f64], m: usize, columns: usize, seed: u64) -> (Spanned, f64) {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); BUCKETS];
    for j in 0..data.len() / m {
        members[(mixed(seed, j as u64) >> 40) as usize % BUCKETS].push(j);
    }
    let (mut transposed, mut squares) = (Matrix::zeros(columns, m), 0.0);
    let mut sums = Matrix::zeros(m, TOGETHER);
    for (group, members) in members.chunks(TOGETHER).enumerate() {
        sums.data_mut().fill(0.0);
        let add = |(sum, members): (&mut [f64], &Vec<usize>)| {
            let mut lanes = [0.0; LANES];
            // In pieces that stay in the fastest cache, four columns at a time: the sums are then read and
            // written a fourth as often.
            for (piece, sum) in sum.chunks_mut(PIECE).enumerate() {
                for four in members.chunks(FOUR) {
                    let part = |j: &usize| &data[m * j + PIECE * piece..][..sum.len()];
                    let columns = std::array::from_fn(|c| four.get(c).map_or(&[][..], part));
                    let signs = std::array::from_fn(|c| four.get(c).map_or(0.0, |&j| sign(seed, j as u64)));
                    run_wide(AddSigned { columns, signs, sum, lanes: &mut lanes });
                }
            }
            lanes.iter().sum::<f64>()
        };
        let parts: Vec<f64> = sums.data_mut().par_chunks_mut(m).zip(members).map(add).collect();
        squares += parts.iter().sum::<f64>();
        let first = TOGETHER * group;
        let signs =
            Matrix::from_fn(columns, TOGETHER, |j, i| sign(seed ^ 0xA5A5, (first + i + BUCKETS * j) as u64));
        let tasks = transposed.data_mut().par_chunks_mut(columns * ROWS).enumerate();
        tasks.for_each(|(task, to)| {
            let rows = ROWS * task..ROWS * task + to.len() / columns;
            let to = ViewMut::new(to, columns, rows.len());
            multiply_add(1.0, signs.view(), sums.view().block(rows, 0..TOGETHER).t(), to);
        });
    }
    (Spanned { transposed }, squares)
}

/// sum += sum over columns of sign column; lanes += squares of all columns. Columns that are missing (empty)
/// come last.
struct AddSigned<'a> {
    columns: [&'a [f64]; FOUR],
    signs: [f64; FOUR],
    sum: &'a mut [f64],
    lanes: &'a mut [f64; LANES],
}

// Measured: 2^24 numbers in 13 to 19 ms, 22 to 30 one column after the other without AVX2 (a copy takes 12 to
// 16).
impl Work for AddSigned<'_> {
    #[inline(always)]
    fn run(self) {
        let Self { columns, signs, sum, lanes } = self;
        let whole = sum.len() - sum.len() % LANES;
        if columns.iter().all(|column| column.len() == sum.len()) {
            let [a, b, c, d] = columns;
            let [p, q, r, s] = signs;
            let parts = a.chunks_exact(LANES).zip(b.chunks_exact(LANES)).zip(c.chunks_exact(LANES));
            let parts = parts.zip(d.chunks_exact(LANES)).zip(sum.chunks_exact_mut(LANES));
            for ((((a, b), c), d), sum) in parts {
                for k in 0..LANES {
                    sum[k] += (p * a[k] + q * b[k]) + (r * c[k] + s * d[k]);
                    lanes[k] += (a[k] * a[k] + b[k] * b[k]) + (c[k] * c[k] + d[k] * d[k]);
                }
            }
        } else {
            for (column, sign) in columns.iter().zip(signs) {
                let parts = column.chunks_exact(LANES).zip(sum.chunks_exact_mut(LANES));
                for (column, sum) in parts {
                    for k in 0..LANES {
                        sum[k] += sign * column[k];
                        lanes[k] += column[k] * column[k];
                    }
                }
            }
        }
        for (column, sign) in columns.iter().zip(signs).filter(|(column, _)| !column.is_empty()) {
            for (k, (x, sum)) in column[whole..].iter().zip(&mut sum[whole..]).enumerate() {
                *sum += sign * x;
                lanes[k] += x * x;
            }
        }
    }
}

/// A number without pattern from a seed and a place (SplitMix64).
fn mixed(seed: u64, place: u64) -> u64 {
    crate::random::Random::new(seed.wrapping_add(place.wrapping_mul(0xD134_2543_DE82_EF95))).next()
}

/// 1 or -1.
fn sign(seed: u64, place: u64) -> f64 {
    if mixed(seed, place) & 1 == 0 { 1.0 } else { -1.0 }
}
