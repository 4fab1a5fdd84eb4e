//! Sparse Cholesky factorisation of S~, and the choice between S~ and K.

use super::body::BodyCholesky;
use super::body_matrix::BodyMatrix;
use super::refinement::{REFINEMENTS, ShiftedCholesky};
use super::system::{LinearReport, NewtonError, NewtonSolver, NewtonSystem, multiply_scaled};
use crate::delassus::{Delassus, DelassusWork, RigidDelassus};
use graintrain_linalg::cholesky::{SparseCholesky, predicted_cost};
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, conjugate_gradient};
use graintrain_linalg::ordering::Ordering;
use std::collections::BTreeMap;

/// Sparse Cholesky factorisation of S~, analysed once per pattern; solutions are refined by conjugate
/// gradients with the factor as preconditioner until the residual of the true matrix reaches the tolerance.
#[derive(Default)]
pub struct SchurCholesky {
    factor: ShiftedCholesky,
    row_start: Vec<usize>,
    column: Vec<u32>,
    work: KrylovWork,
    product: DelassusWork,
    scratch: Vec<f64>,
}

impl NewtonSolver for SchurCholesky {
    fn name(&self) -> &'static str {
        "schur-cholesky"
    }

    fn needs_matrix(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let Some(matrix) = system.matrix else {
            return Err(NewtonError::Unsupported { solver: self.name(), reason: "S~ was not assembled" });
        };
        if self.row_start != matrix.row_starts() || self.column != matrix.columns() {
            self.row_start = matrix.row_starts().to_vec();
            self.column = matrix.columns().to_vec();
            self.factor.factor =
                Some(SparseCholesky::new(3, &self.row_start, &self.column, Ordering::NestedDissection));
        }
        if system.new_delassus {
            self.product = system.problem.delassus.work();
        }
        let diagonal = (0..matrix.num_rows()).filter_map(|i| matrix.position(i, i));
        self.factor.factorize(("schur-cholesky", 3), matrix.blocks().as_flattened(), diagonal)
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let Self { factor: ShiftedCholesky { factor: Some(factor), .. }, product, scratch, work, .. } = self
        else {
            return LinearReport { residual: 1.0, ..Default::default() };
        };
        work.patience = system.patience.clone();
        let settings = KrylovSettings { relative_tolerance, max_iterations: REFINEMENTS };
        z.copy_from_slice(b);
        factor.solve(z);
        let report = conjugate_gradient(
            &mut |x, y| match &*system.problem.delassus {
                Delassus::Rigid(_) => {
                    multiply_scaled(system.problem, system.blocks.factor, x, y, product, scratch);
                }
                Delassus::Sparse(_) => {
                    if let Some(matrix) = system.matrix {
                        matrix.multiply(x, y);
                    }
                }
            },
            &mut |r, z| {
                z.copy_from_slice(r);
                factor.solve(z);
            },
            b,
            z,
            settings,
            work,
        );
        report.into()
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        self.factor.figures(figures);
    }
}

/// Contacts per body above which body space is taken without counting operations.
const CLEARLY_BODY: f64 = 2.2;
/// Contacts per body below which contact space is taken without counting operations.
const CLEARLY_CONTACT: f64 = 0.8;

/// Whether a factorisation over the bodies needs fewer operations than one over the contacts.
pub(crate) fn in_body_space(rigid: &RigidDelassus) -> bool {
    let touched = (0..rigid.num_bodies()).filter(|&body| !rigid.sides(body).is_empty()).count();
    let ratio = rigid.num_contacts() as f64 / touched.max(1) as f64;
    if ratio > CLEARLY_BODY {
        return true;
    }
    if ratio < CLEARLY_CONTACT {
        return false;
    }
    let body = BodyMatrix::new(rigid);
    let pattern = rigid.assemble();
    let ordering = Ordering::MinimumDegree;
    let in_body = predicted_cost(6, body.row_starts(), body.columns(), ordering).flops;
    in_body <= predicted_cost(3, pattern.row_starts(), pattern.columns(), ordering).flops
}

/// Sparse Cholesky in contact space or in body space, whichever needs fewer operations for the pattern at
/// hand.
#[derive(Default)]
pub struct Direct {
    schur: SchurCholesky,
    body: BodyCholesky,
    in_body_space: bool,
}

impl NewtonSolver for Direct {
    fn name(&self) -> &'static str {
        "cholesky"
    }

    fn prepare(&mut self, system: &NewtonSystem<'_>) {
        self.in_body_space =
            matches!(&*system.problem.delassus, Delassus::Rigid(rigid) if in_body_space(rigid));
    }

    fn needs_matrix(&self) -> bool {
        !self.in_body_space
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        if self.in_body_space { self.body.refresh(system) } else { self.schur.refresh(system) }
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        if self.in_body_space {
            self.body.solve(system, b, z, relative_tolerance)
        } else {
            self.schur.solve(system, b, z, relative_tolerance)
        }
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        if self.in_body_space {
            self.body.figures(figures)
        } else {
            self.schur.figures(figures)
        }
        figures.insert("in_body_space".to_string(), f64::from(u8::from(self.in_body_space)));
    }
}
