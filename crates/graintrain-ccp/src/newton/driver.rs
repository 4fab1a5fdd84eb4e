//! What an outer Newton method needs around its linear solver: S kept up to date, records of every iteration.

use super::schur::SchurComplement;
use super::system::{
    Form, LinearReport, NewtonError, NewtonRecord, NewtonSolver, NewtonSystem, ScaledBlocks, apply_blocks,
    apply_blocks_in_place, multiply_scaled,
};
use crate::delassus::{DelassusIdentity, DelassusWork};
use crate::problem::Ccp;
use graintrain_linalg::parallel::norm;
use graintrain_linalg::patience::Patience;
use std::time::Instant;

/// Steps of the power iteration per Newton matrix; each matrix goes on from the vector of the last.
const POWER_STEPS: usize = 2;

/// Records for which there is room before the first iteration.
const RECORDS: usize = 200;

/// A linear solver together with the Schur complement it may need and the history of what it did.
///
/// Between solves of problems that share N nothing that depends on N is made anew.
pub struct NewtonDriver {
    solver: Box<dyn NewtonSolver>,
    schur: Option<SchurComplement>,
    /// The N that the solver was prepared for.
    prepared: DelassusIdentity,
    new_delassus: bool,
    records: Vec<NewtonRecord>,
    current: NewtonRecord,
    /// Why the last refresh failed.
    failure: Option<NewtonError>,
    patience: Patience,
    /// Seconds of [`Self::begin`], which count as part of the first refresh.
    begin_seconds: f64,
    product: DelassusWork,
    scratch: Vec<f64>,
    /// Right-hand side and solution of a solver of the plain form.
    plain: [Vec<f64>; 2],
    /// The vector of the power iteration, and its image.
    power: [Vec<f64>; 2],
}

impl NewtonDriver {
    /// With this linear solver.
    pub fn new(solver: Box<dyn NewtonSolver>) -> Self {
        let current = NewtonRecord::default();
        Self {
            solver,
            schur: None,
            prepared: DelassusIdentity::default(),
            new_delassus: true,
            records: Vec::new(),
            current,
            failure: None,
            patience: Patience::default(),
            begin_seconds: 0.0,
            product: DelassusWork::default(),
            scratch: Vec::new(),
            plain: Default::default(),
            power: Default::default(),
        }
    }

    /// Name of the linear solver with its settings, as it was asked for.
    pub fn linear_name(&self) -> String {
        self.solver.full_name()
    }

    /// Which system the linear solver takes.
    pub fn form(&self) -> Form {
        self.solver.form()
    }

    /// Linear solvers stop where this ends. Holds until it is set again.
    pub fn set_patience(&mut self, patience: Patience) {
        self.patience = patience;
    }

    /// Begins the solve of a problem.
    pub fn begin(&mut self, problem: &Ccp) {
        self.records.clear();
        self.records.reserve(RECORDS);
        self.failure = None;
        self.change_problem(problem);
    }

    /// Goes on with another problem and keeps the records.
    pub fn change_problem(&mut self, problem: &Ccp) {
        let start = Instant::now();
        if self.prepared.is(&problem.delassus) {
            return;
        }
        self.prepared = DelassusIdentity::of(&problem.delassus);
        self.product = problem.delassus.work();
        self.new_delassus = true;
        self.schur = None;
        self.solver.prepare(&NewtonSystem {
            problem,
            blocks: ScaledBlocks::default(),
            matrix: None,
            new_delassus: true,
            iteration: 0,
            patience: &self.patience,
        });
        if self.solver.needs_matrix() {
            self.schur = Some(SchurComplement::new(problem, self.solver.form()));
        }
        // Any fixed vector without structure will do: multiples of the golden ratio modulo 1.
        let size = 3 * problem.num_contacts();
        self.power[0] = (0..size).map(|k| (k as f64 * 0.618_033_988_749_894_9).fract() - 0.5).collect();
        self.power[1] = vec![0.0; size];
        self.begin_seconds = start.elapsed().as_secs_f64();
    }

    /// Prepares the linear solver for the blocks H of a Newton iteration. `residual` is that of the contact
    /// problem, for the record.
    ///
    /// # Errors
    /// As [`NewtonSolver::refresh`].
    pub fn refresh(
        &mut self,
        problem: &Ccp,
        blocks: ScaledBlocks<'_>,
        iteration: usize,
        residual: f64,
    ) -> Result<(), NewtonError> {
        self.current =
            NewtonRecord { iteration, residual, linear_converged: true, ..NewtonRecord::default() };
        self.current.condition = self.largest_eigenvalue(problem, blocks);
        let start = Instant::now();
        if let Some(schur) = &mut self.schur {
            schur.update(blocks);
        }
        let system = NewtonSystem {
            problem,
            blocks,
            matrix: self.schur.as_ref().map(SchurComplement::matrix),
            new_delassus: self.new_delassus,
            iteration,
            patience: &self.patience,
        };
        let refreshed = self.solver.refresh(&system);
        self.new_delassus = self.new_delassus && refreshed.is_err();
        self.current.precompute_seconds =
            start.elapsed().as_secs_f64() + std::mem::take(&mut self.begin_seconds);
        self.failure = refreshed.as_ref().err().cloned();
        refreshed
    }

    /// Largest eigenvalue of S~ by power iteration, from below.
    fn largest_eigenvalue(&mut self, problem: &Ccp, blocks: ScaledBlocks<'_>) -> f64 {
        let [vector, image] = &mut self.power;
        let mut largest = 1.0;
        for _ in 0..POWER_STEPS {
            let size = norm(vector);
            if !(size > 0.0 && size.is_finite()) {
                break;
            }
            vector.iter_mut().for_each(|x| *x /= size);
            multiply_scaled(problem, blocks.factor, vector, image, &mut self.product, &mut self.scratch);
            largest = norm(image).max(1.0);
            std::mem::swap(vector, image);
        }
        largest
    }

    /// Solves (I + F^T N F) z = b; see [`NewtonSolver::solve`]. The blocks are those of the last refresh. A
    /// solver of the plain form gets S x = F^-T b, z = F^-1 x, and its residual is that of this system.
    pub fn solve(
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
            blocks,
            matrix: self.schur.as_ref().map(SchurComplement::matrix),
            new_delassus: false,
            iteration: self.current.iteration,
            patience: &self.patience,
        };
        let report = match self.solver.form() {
            Form::Scaled => self.solver.solve(&system, b, z, relative_tolerance),
            Form::Plain => {
                let [rhs, x] = &mut self.plain;
                rhs.resize(b.len(), 0.0);
                x.resize(b.len(), 0.0);
                apply_blocks(blocks.factor_inverse, b, rhs, true);
                let report = self.solver.solve(&system, rhs, x, relative_tolerance);
                z.copy_from_slice(x);
                apply_blocks_in_place(blocks.factor_inverse, z, false);
                report
            }
        };
        self.current.apply_seconds += start.elapsed().as_secs_f64();
        self.current.inner_iterations += report.iterations;
        self.current.linear_residual = self.current.linear_residual.max(report.residual);
        self.current.linear_converged &= report.converged;
        report
    }

    /// Why the last refresh failed, where it did.
    pub fn failure(&self) -> Option<&NewtonError> {
        self.failure.as_ref()
    }

    /// Ends a Newton iteration, whose step had this length.
    pub fn end_iteration(&mut self, step: f64) {
        self.end_iteration_with(step, &[]);
    }

    /// As [`Self::end_iteration`], with figures of the outer method.
    pub fn end_iteration_with(&mut self, step: f64, figures: &[(&str, f64)]) {
        let mut record = std::mem::take(&mut self.current);
        record.step = step;
        self.solver.figures(&mut record.figures);
        record.figures.extend(figures.iter().map(|&(name, value)| (name.to_string(), value)));
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
