//! Direct elimination of bilateral rows.
//!
//! For rows B (m x n, each of length one) this holds the orthogonal factorisation with pivoting of its
//! transpose,
//!
//! ```text
//! B^T P = Q [ R11 R12 ]      R11 upper triangular of the rank of B
//!           [  0   0  ]
//! ```
//!
//! with which the nearest point to a given one on { z : B z = b }, the multipliers of the rows, and a basis
//! of the motions that the rows leave free are found without forming B B^T, whose condition is the square:
//! light and heavy bodies in one chain keep their digits. Rows that repeat others (a plane linkage of hinges
//! has three of them in every loop) are found by the rank, and multipliers are the shortest ones.
//!
//! Cost: about 2 n m^2 flops; meant for mechanisms of up to a few dozen bodies.
//!
//! Source: G. H. Golub, C. F. Van Loan, "Matrix Computations", 4th edition, 2013, sections 5.4 and 5.5
//! (complete orthogonal decomposition); for mechanisms: M. Géradin, A. Cardona, "Flexible Multibody
//! Dynamics", 2001, chapter on null-space elimination.

/// Rows whose part beyond those before them is shorter than this repeat them.
const DEPENDENT: f64 = 1e-11;

/// The factorisation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Elimination {
    /// n.
    length: usize,
    /// Per row, in the order of the pivots: above the diagonal R, from it on the reflector.
    columns: Vec<Vec<f64>>,
    /// Diagonal of R11; its length is the rank.
    diagonal: Vec<f64>,
    /// Which row stands where.
    pivots: Vec<usize>,
    /// Factorisation of [R11 R12], where rows repeat others.
    minimum: Option<Box<Elimination>>,
}

/// In eight sums, which the machine makes at once.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

fn subtract(x: &mut [f64], factor: f64, v: &[f64]) {
    x.iter_mut().zip(v).for_each(|(x, v)| *x -= factor * v);
}

impl Elimination {
    /// Of these rows of one length n. Rows of zeros are allowed.
    pub(crate) fn new(length: usize, rows: Vec<Vec<f64>>) -> Self {
        let mut own = Self::pivoted(length, rows);
        if own.rank() < own.columns.len() {
            let count = own.columns.len();
            let trapezoid = (0..own.rank())
                .map(|i| (0..count).map(|j| if j < i { 0.0 } else { own.entry(i, j) }).collect())
                .collect();
            own.minimum = Some(Box::new(Self::pivoted(count, trapezoid)));
        }
        own
    }

    fn pivoted(length: usize, rows: Vec<Vec<f64>>) -> Self {
        let (mut columns, mut diagonal) = (rows, Vec::new());
        let count = columns.len();
        let mut pivots: Vec<usize> = (0..count).collect();
        let largest = columns.iter().map(|c| dot(c, c)).fold(0.0, f64::max).sqrt();
        for k in 0..count.min(length) {
            let rest = |c: &Vec<f64>| dot(&c[k..], &c[k..]);
            let (mut pivot, mut most) = (k, rest(&columns[k]));
            for (j, column) in columns.iter().enumerate().skip(k + 1) {
                let square = rest(column);
                if square > most {
                    (pivot, most) = (j, square);
                }
            }
            let norm = most.sqrt();
            if norm.is_nan() || norm <= DEPENDENT * largest {
                break;
            }
            columns.swap(k, pivot);
            pivots.swap(k, pivot);
            // H = 1 - v v^T with |v|^2 = 2 sends the column to -sign norm e_k.
            let (head, tail) = columns.split_at_mut(k + 1);
            let reflector = &mut head[k][k..];
            let sign = 1.0_f64.copysign(reflector[0]);
            reflector[0] += sign * norm;
            let scale = (2.0 / dot(reflector, reflector)).sqrt();
            reflector.iter_mut().for_each(|x| *x *= scale);
            for column in tail {
                let factor = dot(reflector, &column[k..]);
                subtract(&mut column[k..], factor, reflector);
            }
            diagonal.push(-sign * norm);
        }
        Self { length, columns, diagonal, pivots, minimum: None }
    }

    /// Number of independent rows.
    pub(crate) fn rank(&self) -> usize {
        self.diagonal.len()
    }

    /// Entry of R.
    fn entry(&self, i: usize, j: usize) -> f64 {
        if i == j { self.diagonal[i] } else { self.columns[j][i] }
    }

    fn apply(&self, k: usize, x: &mut [f64]) {
        let reflector = &self.columns[k][k..];
        let factor = dot(reflector, &x[k..]);
        subtract(&mut x[k..], factor, reflector);
    }

    /// x <- Q^T x.
    fn reflect(&self, x: &mut [f64]) {
        (0..self.rank()).for_each(|k| self.apply(k, x));
    }

    /// x <- Q x.
    fn reflect_back(&self, x: &mut [f64]) {
        (0..self.rank()).rev().for_each(|k| self.apply(k, x));
    }

    /// z <- the nearest point to z with B z = b; of rows that repeat others the b does not count.
    pub(crate) fn project(&self, z: &mut [f64], b: &[f64]) {
        self.reflect(z);
        for k in 0..self.rank() {
            let before: f64 = (0..k).map(|i| self.columns[k][i] * z[i]).sum();
            z[k] = (b[self.pivots[k]] - before) / self.diagonal[k];
        }
        self.reflect_back(z);
    }

    /// The changes of b by which [`Self::project`] changes C z by `wanted`, for as many other rows C.
    pub(crate) fn changes(&self, mut others: Vec<Vec<f64>>, wanted: &[f64]) -> Vec<f64> {
        let rank = self.rank();
        for row in &mut others {
            self.reflect(row);
            row.truncate(rank);
        }
        let mut along = vec![0.0; rank];
        Self::new(rank, others).project(&mut along, wanted);
        let mut changes = vec![0.0; self.columns.len()];
        for (place, &row) in self.pivots.iter().enumerate() {
            changes[row] =
                along.iter().enumerate().take(place + 1).map(|(i, x)| self.entry(i, place) * x).sum();
        }
        changes
    }

    /// The shortest multipliers with B^T lambda = t, for t in the range of B^T.
    pub(crate) fn multipliers(&self, t: &[f64]) -> Vec<f64> {
        let (count, rank) = (self.columns.len(), self.rank());
        let mut x = t.to_vec();
        self.reflect(&mut x);
        let mut permuted = vec![0.0; count];
        if let Some(minimum) = &self.minimum {
            minimum.project(&mut permuted, &x[..rank]);
        } else {
            for i in (0..rank).rev() {
                let after: f64 = (i + 1..rank).map(|j| self.columns[j][i] * permuted[j]).sum();
                permuted[i] = (x[i] - after) / self.diagonal[i];
            }
        }
        let mut multipliers = vec![0.0; count];
        for (place, &row) in self.pivots.iter().enumerate() {
            multipliers[row] = permuted[place];
        }
        multipliers
    }

    /// Orthonormal vectors that span what the rows leave free.
    pub(crate) fn free_motions(&self) -> Vec<Vec<f64>> {
        let unit = |k: usize| {
            let mut x = vec![0.0; self.length];
            x[k] = 1.0;
            self.reflect_back(&mut x);
            x
        };
        (self.rank()..self.length).map(unit).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn random_rows(count: usize, length: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        (0..count).map(|_| (0..length).map(|_| random.random_range(-1.0..1.0)).collect()).collect()
    }

    /// Projection, multipliers and free motions by their definitions, with and without rows that repeat
    /// others.
    #[test]
    fn projections_obey_their_optimality_conditions() {
        for (independent, repeated, length) in [(4, 0, 9), (5, 3, 9), (7, 0, 7), (1, 4, 3), (0, 2, 4)] {
            let mut rows = random_rows(independent, length, 3 + length as u64);
            let mixing = random_rows(repeated, independent, 11);
            let z_of_rhs = random_rows(1, length, 5).remove(0);
            for mix in &mixing {
                let row =
                    (0..length).map(|k| mix.iter().zip(&rows).map(|(m, row)| m * row[k]).sum()).collect();
                rows.push(row);
            }
            let b: Vec<f64> = rows.iter().map(|row| dot(row, &z_of_rhs)).collect();
            let start = random_rows(1, length, 6).remove(0);
            let own = Elimination::new(length, rows.clone());
            assert_eq!(own.rank(), independent);
            let mut z = start.clone();
            own.project(&mut z, &b);
            for (row, b) in rows.iter().zip(&b) {
                assert!((dot(row, &z) - b).abs() < 1e-13);
            }
            let way: Vec<f64> = z.iter().zip(&start).map(|(z, start)| z - start).collect();
            let lambda = own.multipliers(&way);
            for k in 0..length {
                let sum: f64 = rows.iter().zip(&lambda).map(|(row, lambda)| row[k] * lambda).sum();
                assert!((sum - way[k]).abs() < 1e-12);
            }
            let free = own.free_motions();
            assert_eq!(free.len(), length - independent);
            for motion in &free {
                assert!(rows.iter().all(|row| dot(row, motion).abs() < 1e-13));
                assert!((dot(motion, motion) - 1.0).abs() < 1e-13);
            }
            // The shortest multipliers are in the range of B: orthogonal to every relation among the rows.
            for (mix, place) in mixing.iter().zip(independent..) {
                let relation: f64 = mix.iter().zip(&lambda).map(|(m, l)| m * l).sum::<f64>() - lambda[place];
                assert!(relation.abs() < 1e-12, "{relation}");
            }
        }
    }

    /// What other rows see of the changes is what was asked for, with and without rows that repeat others.
    #[test]
    fn other_rows_see_the_changes_that_they_ask_for() {
        for repeated in [0, 2] {
            let mixing = random_rows(repeated, 4, 11);
            let with_repeated = |mut rows: Vec<Vec<f64>>| {
                for mix in &mixing {
                    let sum = |k: usize| mix.iter().zip(&rows).map(|(m, row)| m * row[k]).sum();
                    rows.push((0..9).map(sum).collect());
                }
                rows
            };
            let [own, others] = [3, 7].map(|seed| with_repeated(random_rows(4, 9, seed)));
            let way = random_rows(1, 9, 5).remove(0);
            let wanted: Vec<f64> = others.iter().map(|row| dot(row, &way)).collect();
            let elimination = Elimination::new(9, own);
            let changes = elimination.changes(others.clone(), &wanted);
            let mut z = vec![0.0; 9];
            elimination.project(&mut z, &changes);
            for (row, wanted) in others.iter().zip(&wanted) {
                assert!((dot(row, &z) - wanted).abs() < 1e-12);
            }
        }
    }
}
