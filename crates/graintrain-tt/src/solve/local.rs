//! Local systems B u = b of one site: dense Cholesky or LU while they are small, else preconditioned Krylov
//! methods.

use super::interface::LocalOperator;
use crate::{Stop, TtError};
use graintrain_linalg::dense::{Cholesky, Lu, Matrix, Svd, View, ViewMut, product, thin_svd};

/// Singular values below this part of the largest are taken for zero.
const SINGULAR: f64 = 1e-14;
/// Vectors of one GMRES cycle.
const RESTART: usize = 40;

/// How a site solves its system.
#[derive(Clone, Copy)]
pub(crate) struct LocalSettings<'a> {
    /// Asked before every right-hand side of a Krylov method.
    pub stop: Stop<'a>,
    /// Largest system that is factored densely.
    pub direct_limit: usize,
    /// Most iterations of the Krylov method per right-hand side.
    pub iterations: usize,
    /// Residual at which the Krylov method stops, relative to the right-hand side.
    pub tolerance: f64,
    /// The operator is symmetric: try Cholesky first, else conjugate gradients.
    pub symmetric: bool,
}

/// Improves `u` towards B u = b for all spectators; where a dense B is singular, the shortest u of the
/// smallest residual.
///
/// # Errors
/// [`TtError::Stopped`] where `stop` says so.
pub(crate) fn solve(
    operator: &LocalOperator<'_>,
    b: &[f64],
    u: &mut [f64],
    settings: &LocalSettings<'_>,
) -> Result<(), TtError> {
    let size = operator.size();
    if size <= settings.direct_limit {
        let matrix = operator.to_matrix();
        let columns = b.len() / size;
        let mut solved = b.to_vec();
        if settings.symmetric
            && let Ok(factor) = Cholesky::new(matrix.clone())
        {
            factor.solve_in_place(ViewMut::new(&mut solved, size, columns));
        } else if let Ok(factor) = Lu::new(matrix.clone()) {
            factor.solve_in_place(ViewMut::new(&mut solved, size, columns));
        } else {
            solved.fill(f64::NAN);
        }
        // A solution so large that A u loses all digits of b belongs to a singular matrix.
        if norm(&solved) * norm(matrix.data()) * SINGULAR <= norm(b) {
            u.copy_from_slice(&solved);
        } else if let Some(shortest) = least_squares(&matrix, b) {
            u.copy_from_slice(&shortest);
        }
        return Ok(());
    }
    let preconditioner = BlockJacobi::new(operator);
    for (u, b) in u.chunks_exact_mut(size).zip(b.chunks_exact(size)) {
        crate::go_on(settings.stop)?;
        // A symmetric operator need not be definite: conjugate gradients notice and hand over.
        if !settings.symmetric || !conjugate_gradients(operator, &preconditioner, b, u, settings) {
            gmres(operator, &preconditioner, b, u, settings);
        }
    }
    Ok(())
}

/// The shortest u of all that minimise |B u - b| for every column of b, singular values below [`SINGULAR`] of
/// the largest being taken for zero; none if B is not finite.
fn least_squares(matrix: &Matrix, b: &[f64]) -> Option<Vec<f64>> {
    let Svd { u, s, v } = thin_svd(matrix.view()).ok()?;
    let rank = s.iter().take_while(|&&x| x > SINGULAR * s[0]).count();
    let mut weights =
        product(u.first_columns(rank).t(), View::new(b, matrix.rows(), b.len() / matrix.rows()));
    for column in weights.data_mut().chunks_exact_mut(rank.max(1)) {
        column.iter_mut().zip(&s).for_each(|(x, s)| *x /= s);
    }
    Some(product(v.first_columns(rank), weights.view()).into_vec())
}

/// The n x n diagonal blocks of B, factored; blocks that cannot be factored are left out.
struct BlockJacobi {
    left: usize,
    n: usize,
    blocks: Vec<Option<Lu>>,
}

impl BlockJacobi {
    fn new(operator: &LocalOperator<'_>) -> Self {
        let blocks = operator.diagonal_blocks().into_iter().map(|block| Lu::new(block).ok()).collect();
        Self { left: operator.left.trial, n: operator.core.n, blocks }
    }

    /// z <- P^-1 r.
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        let mut fibre = vec![0.0; self.n];
        for (block, factor) in self.blocks.iter().enumerate() {
            let start = block % self.left + self.left * self.n * (block / self.left);
            fibre.iter_mut().enumerate().for_each(|(i, x)| *x = r[start + self.left * i]);
            if let Some(factor) = factor {
                factor.solve_in_place(ViewMut::new(&mut fibre, self.n, 1));
            }
            fibre.iter().enumerate().for_each(|(i, x)| z[start + self.left * i] = *x);
        }
    }
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// r <- b - B u.
fn residual(operator: &LocalOperator<'_>, b: &[f64], u: &[f64], r: &mut [f64]) {
    operator.apply(u, r);
    r.iter_mut().zip(b).for_each(|(r, b)| *r = b - *r);
}

/// Preconditioned conjugate gradients. False where the operator or the preconditioner proves not to be
/// positive definite; `u` then holds the last iterate.
fn conjugate_gradients(
    operator: &LocalOperator<'_>,
    preconditioner: &BlockJacobi,
    b: &[f64],
    u: &mut [f64],
    settings: &LocalSettings<'_>,
) -> bool {
    let size = b.len();
    let (mut r, mut z, mut q) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
    residual(operator, b, u, &mut r);
    let stop = settings.tolerance * norm(b);
    preconditioner.apply(&r, &mut z);
    let mut p = z.clone();
    let mut rz = dot(&r, &z);
    for _ in 0..settings.iterations {
        if norm(&r) <= stop {
            return true;
        }
        operator.apply(&p, &mut q);
        let curvature = dot(&p, &q);
        if curvature <= 0.0 || rz <= 0.0 {
            return false;
        }
        let step = rz / curvature;
        axpy(step, &p, u);
        axpy(-step, &q, &mut r);
        preconditioner.apply(&r, &mut z);
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + beta * *p);
    }
    true
}

/// GMRES with right preconditioning and restarts (Saad and Schultz 1986), modified Gram-Schmidt.
fn gmres(
    operator: &LocalOperator<'_>,
    preconditioner: &BlockJacobi,
    b: &[f64],
    u: &mut [f64],
    settings: &LocalSettings<'_>,
) {
    let size = b.len();
    let stop = settings.tolerance * norm(b);
    let (mut r, mut z) = (vec![0.0; size], vec![0.0; size]);
    let mut left = settings.iterations;
    while left > 0 {
        residual(operator, b, u, &mut r);
        let beta = norm(&r);
        if beta <= stop || beta == 0.0 {
            return;
        }
        let steps = RESTART.min(left).min(size);
        let mut basis = vec![r.iter().map(|x| x / beta).collect::<Vec<_>>()];
        let mut h = Matrix::zeros(steps + 1, steps);
        let mut rotations: Vec<(f64, f64)> = Vec::with_capacity(steps);
        let mut g = vec![0.0; steps + 1];
        g[0] = beta;
        let mut done = 0;
        for k in 0..steps {
            preconditioner.apply(&basis[k], &mut z);
            let mut w = vec![0.0; size];
            operator.apply(&z, &mut w);
            for (i, v) in basis.iter().enumerate() {
                h[(i, k)] = dot(v, &w);
                axpy(-h[(i, k)], v, &mut w);
            }
            let length = norm(&w);
            for (i, &(c, s)) in rotations.iter().enumerate() {
                let (x, y) = (h[(i, k)], h[(i + 1, k)]);
                h[(i, k)] = c * x + s * y;
                h[(i + 1, k)] = c * y - s * x;
            }
            let radius = h[(k, k)].hypot(length);
            if radius == 0.0 {
                break;
            }
            let (c, s) = (h[(k, k)] / radius, length / radius);
            rotations.push((c, s));
            h[(k, k)] = radius;
            g[k + 1] = -s * g[k];
            g[k] *= c;
            done = k + 1;
            if g[done].abs() <= stop || length == 0.0 {
                break;
            }
            basis.push(w.iter().map(|x| x / length).collect());
        }
        left = left.saturating_sub(steps);
        for i in (0..done).rev() {
            g[i] = (g[i] - (i + 1..done).map(|j| h[(i, j)] * g[j]).sum::<f64>()) / h[(i, i)];
        }
        r.fill(0.0);
        (0..done).for_each(|i| axpy(g[i], &basis[i], &mut r));
        preconditioner.apply(&r, &mut z);
        axpy(1.0, &z, u);
        if done < steps {
            return;
        }
    }
}
