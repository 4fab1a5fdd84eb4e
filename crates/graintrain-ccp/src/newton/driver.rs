//! What an outer Newton method needs around its linear solver: S kept up to date, records of every iteration.

use super::{
    LinearReport, NewtonError, NewtonRecord, NewtonSolver, NewtonSystem, SchurComplement,
    apply_blocks_in_place, multiply_scaled,
};
use crate::delassus::{Delassus, DelassusWork};
use crate::problem::Ccp;
use graintrain_linalg::block3::Block;
use graintrain_linalg::parallel::norm;
use std::time::Instant;

/// Steps of refinement around a solver of the unscaled system.
const REFINEMENTS: usize = 6;

/// The blocks of a Newton matrix with the factors of their inverses, H^-1 = F F^T.
#[derive(Clone, Copy)]
pub struct ScaledBlocks<'a> {
    /// H.
    pub added: &'a [Block],
    /// H^-1.
    pub inverse_added: &'a [Block],
    /// F.
    pub factor: &'a [Block],
    /// F^-1.
    pub factor_inverse: &'a [Block],
}

/// A linear solver together with the Schur complement it may need and the history of what it did.
///
/// Between solves of problems with the same N (only r or mu changed) nothing that depends on N is made anew.
pub struct NewtonDriver {
    solver: Box<dyn NewtonSolver>,
    schur: Option<SchurComplement>,
    delassus: Option<Delassus>,
    new_delassus: bool,
    records: Vec<NewtonRecord>,
    current: NewtonRecord,
    product: DelassusWork,
    scratch: [Vec<f64>; 3],
}

impl NewtonDriver {
    /// With this linear solver.
    pub fn new(solver: Box<dyn NewtonSolver>) -> Self {
        let current = NewtonRecord::default();
        Self {
            solver,
            schur: None,
            delassus: None,
            new_delassus: true,
            records: Vec::new(),
            current,
            product: DelassusWork::default(),
            scratch: Default::default(),
        }
    }

    /// Name of the linear solver.
    pub fn linear_name(&self) -> &'static str {
        self.solver.name()
    }

    /// Begins the solve of a problem.
    pub fn begin(&mut self, problem: &Ccp) {
        self.records.clear();
        let same = self.delassus.as_ref().is_some_and(|old| same_delassus(old, &problem.delassus));
        if same {
            return;
        }
        self.delassus = Some(problem.delassus.clone());
        self.product = problem.delassus.work();
        self.new_delassus = true;
        self.schur = None;
        self.solver.prepare(&NewtonSystem {
            problem,
            added: &[],
            inverse_added: &[],
            factor: &[],
            schur: None,
            new_delassus: true,
            iteration: 0,
        });
        if self.solver.needs_schur() {
            self.schur = Some(SchurComplement::new(problem));
        }
    }

    /// Prepares the linear solver for the blocks H of a Newton iteration. `residual` is that of the contact problem,
    /// for the record.
    ///
    /// # Errors
    /// As [`NewtonSolver::refresh`].
    pub fn refresh(
        &mut self,
        problem: &Ccp,
        added: &[Block],
        inverse_added: &[Block],
        iteration: usize,
        residual: f64,
    ) -> Result<(), NewtonError> {
        self.current =
            NewtonRecord { iteration, residual, linear_converged: true, ..NewtonRecord::default() };
        let start = Instant::now();
        if let Some(schur) = &mut self.schur {
            schur.update(added);
        }
        let system = NewtonSystem {
            problem,
            added,
            inverse_added,
            factor: &[],
            schur: self.schur.as_ref().map(SchurComplement::matrix),
            new_delassus: self.new_delassus,
            iteration,
        };
        let refreshed = self.solver.refresh(&system);
        self.new_delassus = self.new_delassus && refreshed.is_err();
        self.current.precompute_seconds = start.elapsed().as_secs_f64();
        refreshed
    }

    /// Solves (N + H) x = b; see [`NewtonSolver::solve`]. The blocks are those of the last refresh.
    pub fn solve(
        &mut self,
        problem: &Ccp,
        added: &[Block],
        inverse_added: &[Block],
        b: &[f64],
        x: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let start = Instant::now();
        let system = NewtonSystem {
            problem,
            added,
            inverse_added,
            factor: &[],
            schur: self.schur.as_ref().map(SchurComplement::matrix),
            new_delassus: false,
            iteration: self.current.iteration,
        };
        let report = self.solver.solve(&system, b, x, relative_tolerance);
        self.current.apply_seconds += start.elapsed().as_secs_f64();
        self.current.inner_iterations += report.iterations;
        self.current.linear_residual = self.current.linear_residual.max(report.residual);
        self.current.linear_converged &= report.converged;
        report
    }

    /// Solves (I + F^T N F) z = b in the scaled variable; see [`NewtonSolver::solve_scaled`]. Solvers that only know
    /// the unscaled system are refined around: x = F z, S x = F^-T b.
    pub fn solve_scaled(
        &mut self,
        problem: &Ccp,
        blocks: ScaledBlocks<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let start = Instant::now();
        let system = NewtonSystem {
            problem,
            added: blocks.added,
            inverse_added: blocks.inverse_added,
            factor: blocks.factor,
            schur: self.schur.as_ref().map(SchurComplement::matrix),
            new_delassus: false,
            iteration: self.current.iteration,
        };
        let report = self.solver.solve_scaled(&system, b, z, relative_tolerance).unwrap_or_else(|| {
            let [residual, correction, scratch] = &mut self.scratch;
            residual.resize(b.len(), 0.0);
            correction.resize(b.len(), 0.0);
            z.fill(0.0);
            residual.copy_from_slice(b);
            let size = norm(b).max(f64::MIN_POSITIVE);
            let mut report =
                LinearReport { iterations: 0, residual: norm(residual) / size, converged: false };
            for _ in 0..REFINEMENTS {
                if report.residual <= relative_tolerance {
                    report.converged = true;
                    break;
                }
                apply_blocks_in_place(blocks.factor_inverse, residual, true);
                correction.fill(0.0);
                let inner = self.solver.solve(&system, residual, correction, 0.1 * relative_tolerance);
                report.iterations += inner.iterations;
                apply_blocks_in_place(blocks.factor_inverse, correction, false);
                for (z, correction) in z.iter_mut().zip(correction.iter()) {
                    *z += correction;
                }
                multiply_scaled(problem, blocks.factor, z, residual, &mut self.product, scratch);
                for (residual, b) in residual.iter_mut().zip(b) {
                    *residual = b - *residual;
                }
                let before = report.residual;
                report.residual = norm(residual) / size;
                if report.residual > before {
                    for (z, correction) in z.iter_mut().zip(correction.iter()) {
                        *z -= correction;
                    }
                    report.residual = before;
                    break;
                }
            }
            report
        });
        self.current.apply_seconds += start.elapsed().as_secs_f64();
        self.current.inner_iterations += report.iterations;
        self.current.linear_residual = self.current.linear_residual.max(report.residual);
        self.current.linear_converged &= report.converged;
        report
    }

    /// Ends a Newton iteration, whose step had this length.
    pub fn end_iteration(&mut self, step: f64) {
        let mut record = std::mem::take(&mut self.current);
        record.step = step;
        self.solver.figures(&mut record.figures);
        self.records.push(record);
    }

    /// Iterations of the linear solver since [`Self::begin`].
    pub fn linear_iterations(&self) -> usize {
        self.records.iter().map(|record| record.inner_iterations).sum::<usize>()
            + self.current.inner_iterations
    }

    /// The records since [`Self::begin`], which are handed over.
    pub fn take_records(&mut self) -> Vec<NewtonRecord> {
        std::mem::take(&mut self.records)
    }
}

fn same_delassus(a: &Delassus, b: &Delassus) -> bool {
    match (a, b) {
        (Delassus::Rigid(a), Delassus::Rigid(b)) => {
            a.contacts() == b.contacts() && a.inverse_mass() == b.inverse_mass()
        }
        (Delassus::Sparse(a), Delassus::Sparse(b)) => a == b,
        _ => false,
    }
}
