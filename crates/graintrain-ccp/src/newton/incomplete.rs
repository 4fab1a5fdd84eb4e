//! `ic`: incomplete Cholesky conjugate gradients in body space or in contact space, whichever needs fewer
//! operations.
//!
//! Early in an interior-point run the factor of K is by far the better one: K is smaller, and elimination of
//! a body drops less. As weights H^-1 spread, a residual rho of K means a residual A^T rho of S~ that is
//! larger by up to the root of the largest weight, and pivots of K have to be enlarged; the factor of S~ does
//! not suffer. So every problem begins in body space and goes over once contact space is found to be cheaper,
//! for good. S~ is not assembled before.

use super::body::{BodyCg, LIMIT};
use super::convergence::ConvergenceRate;
use super::krylov::{self, SchurKrylov};
use super::schur::SchurComplement;
use super::system::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use crate::delassus::Delassus;
use graintrain_linalg::real;
use std::collections::BTreeMap;

/// Iterations in body space, per factor e of the residual asked for, after which contact space is tried.
const COMPARE: f64 = 20.0;
/// A solve in body space gives up after so many times the iterations of the last one.
const GIVE_UP: usize = 2;
/// Iterations in body space that are always granted.
const GRANTED: usize = 150;

/// Both solvers, and which of them is in use.
pub struct IncompleteCholeskyCg {
    body: BodyCg,
    contact: SchurKrylov,
    /// S~, where contact space was asked.
    schur: Option<SchurComplement>,
    /// Whether S~ and its factor belong to the present blocks H.
    contact_is_fresh: bool,
    in_body_space: bool,
    /// Iterations of the last solve in body space, and that number per factor e asked for.
    last: usize,
    last_rate: f64,
    /// Iterations in body space, per factor e, that need the operations of contact space; `COMPARE` until a
    /// solve was made there, infinite after one that failed.
    worth: f64,
    /// Where the last answer comes from.
    answered_in_body_space: bool,
    best: Vec<f64>,
}

impl Default for IncompleteCholeskyCg {
    fn default() -> Self {
        Self {
            body: BodyCg::incomplete_cholesky(),
            contact: SchurKrylov::incomplete_cholesky(),
            schur: None,
            contact_is_fresh: false,
            in_body_space: false,
            last: 0,
            last_rate: 0.0,
            worth: COMPARE,
            answered_in_body_space: false,
            best: Vec::new(),
        }
    }
}

impl IncompleteCholeskyCg {
    /// What a solve costs, from a few iterations.
    pub fn measure(&mut self, system: &NewtonSystem<'_>) -> Option<ConvergenceRate> {
        if self.in_body_space {
            return self.body.measure(system);
        }
        let matrix = self.schur.as_ref().map(SchurComplement::matrix);
        self.contact.measure(&NewtonSystem { matrix, ..*system })
    }

    /// Assembles S~ and its factor, where that has not been done for the present blocks.
    fn refresh_contact(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        if self.contact_is_fresh {
            return Ok(());
        }
        let new_delassus = self.schur.is_none();
        let schur = self.schur.get_or_insert_with(|| SchurComplement::new(system.problem, Form::Scaled));
        schur.update(system.blocks);
        self.contact.refresh(&NewtonSystem { matrix: Some(schur.matrix()), new_delassus, ..*system })?;
        self.contact_is_fresh = true;
        Ok(())
    }

    fn solve_in_contact_space(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        if self.refresh_contact(system).is_err() {
            z.fill(0.0);
            return LinearReport { residual: 1.0, ..LinearReport::default() };
        }
        let matrix = self.schur.as_ref().map(SchurComplement::matrix);
        self.contact.solve(&NewtonSystem { matrix, ..*system }, b, z, relative_tolerance)
    }

    fn solve_in_body_space(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
        max_iterations: usize,
    ) -> LinearReport {
        self.body.set_max_iterations(max_iterations);
        let report = self.body.solve(system, b, z, relative_tolerance);
        self.last = report.iterations;
        self.last_rate = report.iterations as f64 / factors_asked(relative_tolerance);
        self.answered_in_body_space = true;
        report
    }
}

/// How many factors of e the residual is to be reduced by, at least one.
fn factors_asked(relative_tolerance: f64) -> f64 {
    (-real::ln(relative_tolerance)).max(1.0)
}

impl NewtonSolver for IncompleteCholeskyCg {
    fn name(&self) -> &'static str {
        "ic"
    }

    fn needs_matrix(&self) -> bool {
        false
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        self.contact_is_fresh = false;
        if system.new_delassus {
            self.schur = None;
        }
        // Another solve begins with weights that are alike, also where N has stayed.
        if system.new_delassus || system.iteration == 0 {
            self.in_body_space = matches!(*system.problem.delassus, Delassus::Rigid(_));
            (self.last, self.last_rate, self.worth) = (0, 0.0, COMPARE);
        }
        if self.in_body_space {
            self.in_body_space = self.body.refresh(system).is_ok();
        }
        if !self.in_body_space {
            self.refresh_contact(system)?;
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
        self.answered_in_body_space = false;
        if !self.in_body_space {
            return self.solve_in_contact_space(system, b, z, relative_tolerance);
        }
        let mut spent = 0;
        if self.last_rate < self.worth {
            let granted = if self.worth.is_finite() { GRANTED.max(GIVE_UP * self.last) } else { LIMIT };
            let report = self.solve_in_body_space(system, b, z, relative_tolerance, granted);
            if report.converged || granted == LIMIT || system.patience.is_over() {
                return report;
            }
            spent = report.iterations;
        }
        let mut report = self.solve_in_contact_space(system, b, z, relative_tolerance);
        report.iterations += spent;
        self.answered_in_body_space = false;
        if report.converged {
            let blocks = self.schur.as_ref().map_or(0, |schur| schur.matrix().num_blocks());
            let flops = (report.iterations - spent) as f64 * krylov::iteration_flops(system.problem, blocks);
            self.worth = flops / self.body.iteration_flops().max(1.0) / factors_asked(relative_tolerance);
            self.in_body_space = self.last_rate < self.worth;
        } else if !system.patience.is_over() {
            // Not to be tried again.
            self.worth = f64::INFINITY;
            self.best.clear();
            self.best.extend_from_slice(z);
            let again = self.solve_in_body_space(system, b, z, relative_tolerance, LIMIT);
            report = if again.residual <= report.residual {
                LinearReport { iterations: report.iterations + again.iterations, ..again }
            } else {
                z.copy_from_slice(&self.best);
                self.answered_in_body_space = false;
                LinearReport { iterations: report.iterations + again.iterations, ..report }
            };
        }
        report
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        figures.insert("in_body_space".to_string(), f64::from(u8::from(self.answered_in_body_space)));
        if self.answered_in_body_space {
            self.body.figures(figures);
        }
    }
}
