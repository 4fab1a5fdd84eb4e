//! What both sparse Cholesky solvers do where rounding gets in the way.

/// Steps of refinement after which a direct solve gives up improving.
pub(super) const REFINEMENTS: usize = 30;

/// Diagonal shifts, relative to the diagonal, tried one after the other where the factorisation breaks down.
/// The solve is refined against the matrix itself, so that a shift costs iterations, not accuracy.
pub(super) const SHIFTS: [f64; 4] = [0.0, 1e-13, 1e-10, 1e-7];
