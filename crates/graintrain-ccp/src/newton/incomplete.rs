//! `ic`: incomplete Cholesky conjugate gradients in body space or in contact space, whichever needs fewer operations.
//!
//! Early in an interior-point run the factor of K is by far the better one: K is smaller, and elimination of a body drops
//! less. As weights H^-1 spread, a residual rho of K means a residual A^T rho of S~ that is larger by the root of the largest
//! weight, and pivots of K have to be enlarged; the factor of S~ does not suffer. So every problem begins in body space and
//! goes over once contact space is found to be cheaper, for good.

use super::body::BodyCg;
use super::krylov::{self, SchurKrylov};
use super::train_body::Rival;
use super::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use crate::delassus::Delassus;
use std::collections::BTreeMap;

/// Iterations in body space after which contact space is tried on the next system.
const COMPARE: f64 = 100.0;
/// A solve in body space gives up after so many times the iterations of the last one.
const GIVE_UP: usize = 2;
/// Iterations in body space that are always granted.
const GRANTED: usize = 150;

/// Both solvers, and which of them is in use.
pub struct IncompleteCholeskyCg {
    body: BodyCg,
    schur: SchurKrylov,
    in_body_space: bool,
    /// Whether the factor of S~ belongs to the present matrix.
    schur_is_fresh: bool,
    /// Whether the solver in contact space has not been told of the present N yet.
    schur_is_new: bool,
    /// Iterations of the last solve in body space.
    last: usize,
    /// Iterations in body space that need the operations of a solve in contact space; [`COMPARE`] until one was made.
    worth: f64,
}

impl Default for IncompleteCholeskyCg {
    fn default() -> Self {
        Self {
            body: BodyCg::incomplete_cholesky(),
            schur: SchurKrylov::incomplete_cholesky(),
            in_body_space: false,
            schur_is_fresh: false,
            schur_is_new: true,
            last: 0,
            worth: COMPARE,
        }
    }
}

impl IncompleteCholeskyCg {
    /// What a solve costs, from a few iterations.
    pub(super) fn measure(&mut self, system: &NewtonSystem<'_>) -> Option<Rival> {
        if self.in_body_space { self.body.measure() } else { self.schur.measure(system) }
    }

    fn refresh_schur(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        if !self.schur_is_fresh {
            self.schur.refresh(&NewtonSystem { new_delassus: self.schur_is_new, ..*system })?;
            (self.schur_is_fresh, self.schur_is_new) = (true, false);
        }
        Ok(())
    }

    /// In contact space, whose factor is made where it is not there yet.
    fn solve_schur(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        match self.refresh_schur(system) {
            Ok(()) => self.schur.solve(system, b, z, relative_tolerance),
            Err(_) => LinearReport { residual: 1.0, ..LinearReport::default() },
        }
    }
}

impl NewtonSolver for IncompleteCholeskyCg {
    fn name(&self) -> &'static str {
        "ic"
    }

    fn needs_matrix(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        self.schur_is_fresh = false;
        if system.new_delassus {
            self.schur_is_new = true;
            self.in_body_space = matches!(system.problem.delassus, Delassus::Rigid(_));
            (self.last, self.worth) = (0, COMPARE);
        }
        if self.in_body_space && self.body.refresh(system).is_err() {
            self.in_body_space = false;
        }
        if !self.in_body_space {
            self.refresh_schur(system)?;
        }
        Ok(())
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        if !self.in_body_space {
            return self.schur.solve(system, b, z, relative_tolerance);
        }
        let mut spent = 0;
        if (self.last as f64) < self.worth {
            self.body.set_max_iterations(GRANTED.max(GIVE_UP * self.last));
            let report = self.body.solve(system, b, z, relative_tolerance);
            if report.converged || system.patience.is_over() {
                self.last = report.iterations;
                return report;
            }
            self.in_body_space = false;
            spent = report.iterations;
        }
        let report = self.solve_schur(system, b, z, relative_tolerance);
        let flops = report.iterations as f64 * krylov::iteration_flops(system);
        self.worth = flops / self.body.iteration_flops().max(1.0);
        self.in_body_space &= !report.converged || (self.last as f64) < self.worth;
        LinearReport { iterations: report.iterations + spent, ..report }
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        figures.insert("in_body_space".to_string(), f64::from(u8::from(self.in_body_space)));
    }
}
