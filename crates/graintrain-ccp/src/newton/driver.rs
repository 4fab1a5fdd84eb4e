//! What an outer Newton method needs around its linear solver: S kept up to date, records of every iteration.

use super::{LinearReport, NewtonError, NewtonRecord, NewtonSolver, NewtonSystem, SchurComplement};
use crate::delassus::Delassus;
use crate::problem::Ccp;
use graintrain_linalg::block3::Block;
use std::time::Instant;

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
}

impl NewtonDriver {
    /// With this linear solver.
    pub fn new(solver: Box<dyn NewtonSolver>) -> Self {
        let current = NewtonRecord::default();
        Self { solver, schur: None, delassus: None, new_delassus: true, records: Vec::new(), current }
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
        self.new_delassus = true;
        self.schur = None;
        self.solver.prepare(&NewtonSystem {
            problem,
            added: &[],
            inverse_added: &[],
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
