//! What both sparse Cholesky solvers do where rounding gets in the way.

use super::system::NewtonError;
use graintrain_linalg::cholesky::SparseCholesky;
use std::collections::BTreeMap;

/// Steps of refinement after which a direct solve gives up improving.
pub(super) const REFINEMENTS: usize = 30;

/// Diagonal shifts, relative to the diagonal, tried one after the other where the factorisation breaks down.
/// The solve is refined against the matrix itself, so that a shift costs iterations, not accuracy.
const SHIFTS: [f64; 4] = [0.0, 1e-13, 1e-10, 1e-7];

/// A factor, and the shift that it took.
#[derive(Default)]
pub(super) struct ShiftedCholesky {
    pub factor: Option<SparseCholesky>,
    shifted: Vec<f64>,
    shift: f64,
}

impl ShiftedCholesky {
    /// Factorises the matrix of these blocks of `size` rows, whose diagonal blocks are at these places.
    pub fn factorize(
        &mut self,
        (solver, size): (&'static str, usize),
        blocks: &[f64],
        diagonal: impl Iterator<Item = usize> + Clone,
    ) -> Result<(), NewtonError> {
        let Self { factor: Some(factor), shifted, shift } = self else { return Ok(()) };
        let mut reason = String::new();
        for next in SHIFTS {
            *shift = next;
            let attempt = if next == 0.0 {
                factor.factorize(blocks)
            } else {
                shifted.clear();
                shifted.extend_from_slice(blocks);
                for place in diagonal.clone() {
                    for d in 0..size {
                        shifted[size * size * place + (size + 1) * d] *= 1.0 + next;
                    }
                }
                factor.factorize(shifted)
            };
            match attempt {
                Ok(()) => return Ok(()),
                Err(error) => reason = error.to_string(),
            }
        }
        Err(NewtonError::Breakdown { solver, reason })
    }

    pub fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        if let Some(factor) = &self.factor {
            figures.insert("factor_entries".to_string(), factor.entries() as f64);
            figures.insert("factor_shift".to_string(), self.shift);
        }
    }
}
