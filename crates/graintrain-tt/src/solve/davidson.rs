//! The lowest eigenvectors of one local problem: dense while it is small, else by a basis that grows by the
//! residuals of all vectors that are not yet good enough (Davidson 1975 without a preconditioner: the space
//! of block Lanczos), restarted from its best vectors.

use super::interface::LocalOperator;
use crate::random::Random;
use graintrain_linalg::dense::{DenseError, Matrix, product, symmetric_eigen};

/// Local problems up to this size are solved densely.
const DENSE: usize = 300;
/// Vectors of a basis beyond those sought, and restarts.
const BASIS: usize = 40;
const RESTARTS: usize = 3;
/// What is left of a vector after it was made orthogonal to a basis is rounding below this part of it.
const DEPENDENT: f64 = 1e-10;

/// The lowest eigenvectors of a local problem, their values in ascending order, and the largest value met.
pub(super) struct Lowest {
    pub vectors: Vec<Vec<f64>>,
    pub values: Vec<f64>,
    pub largest: f64,
}

/// As many of the lowest eigenvectors as `starts` has, or as there are; iterated ones to residuals of
/// `tolerance` times the largest value.
pub(super) fn lowest_of(
    operator: &LocalOperator<'_>,
    starts: &[&[f64]],
    tolerance: f64,
) -> Result<Lowest, DenseError> {
    let n = operator.size();
    let count = starts.len().min(n);
    if n <= DENSE.max(2 * count) {
        let matrix = operator.to_matrix();
        let (values, vectors) = symmetric_eigen(matrix.view())?;
        if starts.len() == count
            && let Some(kept) = good_enough(&matrix, starts, &values, tolerance)?
        {
            return Ok(kept);
        }
        return Ok(Lowest {
            vectors: (0..count).map(|j| vectors.column(j).to_vec()).collect(),
            largest: values[n - 1],
            values: values[..count].to_vec(),
        });
    }
    let mut random = Random::new(n as u64);
    let mut basis = Basis { operator, vectors: Vec::new(), images: Vec::new() };
    for start in starts {
        basis.push(start.to_vec());
    }
    while basis.vectors.len() < count {
        basis.push((0..n).map(|_| random.symmetric()).collect());
    }
    let mut largest = f64::NEG_INFINITY;
    let mut restarts = 0;
    loop {
        let m = basis.vectors.len();
        let projected = Matrix::from_fn(m, m, |i, j| dot(&basis.vectors[i.min(j)], &basis.images[i.max(j)]));
        let (values, weights) = symmetric_eigen(projected.view())?;
        largest = f64::max(largest, values[m - 1]);
        let ritz = |list: &[Vec<f64>], j: usize| {
            let mut sum = vec![0.0; n];
            weights.column(j).iter().zip(list).for_each(|(w, v)| axpy(*w, v, &mut sum));
            sum
        };
        let size = largest.abs().max(values[0].abs());
        let mut rests = Vec::new();
        for (j, value) in values.iter().enumerate().take(count) {
            let mut rest = ritz(&basis.images, j);
            axpy(-value, &ritz(&basis.vectors, j), &mut rest);
            if dot(&rest, &rest).sqrt() > tolerance * size {
                rests.push(rest);
            }
        }
        let full = m + rests.len() > (count + BASIS.max(3 * count)).min(n);
        if rests.is_empty() || (full && restarts == RESTARTS) {
            let vectors = (0..count).map(|j| ritz(&basis.vectors, j)).collect();
            return Ok(Lowest { vectors, values: values[..count].to_vec(), largest });
        }
        if full {
            // Half as many again as are sought: what the next vectors were about to become is not thrown
            // away.
            let kept = (count + count / 2 + 1).min(m);
            let (vectors, images): (Vec<_>, Vec<_>) =
                (0..kept).map(|j| (ritz(&basis.vectors, j), ritz(&basis.images, j))).unzip();
            (basis.vectors, basis.images) = (vectors, images);
            restarts += 1;
        }
        let before = basis.vectors.len();
        rests.into_iter().for_each(|rest| basis.push(rest));
        if basis.vectors.len() == before {
            // All residuals lie in the basis: an invariant space.
            let vectors = if full {
                basis.vectors[..count].to_vec()
            } else {
                (0..count).map(|j| ritz(&basis.vectors, j)).collect()
            };
            return Ok(Lowest { vectors, values: values[..count].to_vec(), largest });
        }
    }
}

/// The starts, turned into Ritz vectors, where they span lowest eigenvectors already: of eigenvalues that lie
/// on each other (the identity) any vectors are eigenvectors, and others than before would only have other
/// ranks.
fn good_enough(
    matrix: &Matrix,
    starts: &[&[f64]],
    values: &[f64],
    tolerance: f64,
) -> Result<Option<Lowest>, DenseError> {
    let (n, count) = (matrix.rows(), starts.len());
    let block = Matrix::from_vec(n, count, starts.concat());
    let overlap = product(block.t(), block.view());
    let off = |e: (usize, &f64)| (e.1 - f64::from(e.0.is_multiple_of(count + 1))).abs();
    if overlap.data().iter().enumerate().map(off).fold(0.0, f64::max) > 1e-10 {
        return Ok(None);
    }
    let image = product(matrix.view(), block.view());
    let (ritz, weights) = symmetric_eigen(product(block.t(), image.view()).view())?;
    let (turned, mut rest) = (product(block.view(), weights.view()), product(image.view(), weights.view()));
    let largest = values[n - 1];
    let size = largest.abs().max(values[0].abs());
    for (j, value) in ritz.iter().enumerate() {
        let column = &mut rest.data_mut()[n * j..n * (j + 1)];
        column.iter_mut().zip(turned.column(j)).for_each(|(r, x)| *r -= value * x);
        if (value - values[j]).abs() > 1e-10 * size || dot(column, column).sqrt() > tolerance * size {
            return Ok(None);
        }
    }
    let vectors = (0..count).map(|j| turned.column(j).to_vec()).collect();
    Ok(Some(Lowest { vectors, values: ritz, largest }))
}

/// Orthonormal vectors and their images.
struct Basis<'a, 'b> {
    operator: &'a LocalOperator<'b>,
    vectors: Vec<Vec<f64>>,
    images: Vec<Vec<f64>>,
}

impl Basis<'_, '_> {
    /// Adds what of the vector is not in the basis, if it is more than rounding.
    fn push(&mut self, mut vector: Vec<f64>) {
        let before = dot(&vector, &vector).sqrt();
        if before.is_nan() || before <= 0.0 {
            return;
        }
        vector.iter_mut().for_each(|x| *x /= before);
        // Twice is enough.
        for _ in 0..2 {
            for v in &self.vectors {
                axpy(-dot(v, &vector), v, &mut vector);
            }
        }
        let left = dot(&vector, &vector).sqrt();
        if left <= DEPENDENT {
            return;
        }
        vector.iter_mut().for_each(|x| *x /= left);
        let mut image = vec![0.0; vector.len()];
        self.operator.apply(&vector, &mut image);
        self.vectors.push(vector);
        self.images.push(image);
    }
}

fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}
