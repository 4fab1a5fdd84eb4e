//! What an iterative solver of a Newton system costs, from a few of its iterations: in operations, not in
//! seconds, so that choices do not depend on clocks.

use super::body_matrix::BodyMatrix;
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, flexible_conjugate_gradient};
use graintrain_linalg::real;

/// Unknowns per body.
const BODY: usize = 6;

/// Iterations that are made to measure a rate.
pub const SAMPLE: usize = 10;

/// Reduction of the residual that a solve is taken to be asked for.
pub const ASKED: f64 = 1e-6;

/// A right-hand side without structure: multiples of the golden ratio modulo 1.
pub fn unstructured(size: usize) -> Vec<f64> {
    (0..size).map(|k| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5).collect()
}

/// How fast an iteration converges, and what it costs.
#[derive(Clone, Copy, Debug)]
pub struct ConvergenceRate {
    /// Mean decrease of the logarithm of the residual per iteration; not positive where it does not fall.
    decay: f64,
    /// Floating-point operations per iteration.
    flops: f64,
}

impl ConvergenceRate {
    /// From what some iterations did to the residual, 1 at first.
    pub fn new(iterations: usize, residual: f64, flops: f64) -> Self {
        let fallen = if residual.is_finite() { -real::ln(residual.max(f64::MIN_POSITIVE)) } else { 0.0 };
        Self { decay: fallen / iterations.max(1) as f64, flops }
    }

    /// Operations of a solve.
    pub fn solve_flops(&self) -> f64 {
        if self.decay > 0.0 { (-real::ln(ASKED) / self.decay).max(1.0) * self.flops } else { f64::INFINITY }
    }
}

/// Operations of a product with K and with its diagonal blocks.
pub fn product_flops(matrix: &BodyMatrix) -> f64 {
    let block = (2 * BODY * BODY) as f64;
    block * (2.0 * matrix.columns().len() as f64 + matrix.num_bodies() as f64)
}

/// A few conjugate gradient iterations on K: how many, and the residual they leave.
pub fn few_iterations(
    matrix: &BodyMatrix,
    precondition: &mut dyn FnMut(&[f64], &mut [f64]),
    krylov: &mut KrylovWork,
) -> (usize, f64) {
    let b = unstructured(BODY * matrix.num_bodies());
    let mut x = vec![0.0; b.len()];
    let settings = KrylovSettings { relative_tolerance: 0.0, max_iterations: SAMPLE };
    let product = &mut |x: &[f64], y: &mut [f64]| matrix.multiply(x, y);
    let report = flexible_conjugate_gradient(product, precondition, &b, &mut x, settings, krylov);
    (report.iterations, report.residual)
}
