//! Solvers in body space: K = I + D~ H^-1 D~^T by sparse Cholesky or by conjugate gradients.

use super::body_matrix::BodyMatrix;
use super::direct::{REFINEMENTS, SHIFTS};
use super::train_body::TrainCorrection;
use super::{
    LinearReport, NewtonError, NewtonSolver, NewtonSystem, apply_blocks, apply_blocks_in_place,
    multiply_scaled, multiply_system,
};
use crate::delassus::{Delassus, DelassusWork};
use graintrain_linalg::block_ops::apply3;
use graintrain_linalg::block3::Block;
use graintrain_linalg::cholesky::SparseCholesky;
use graintrain_linalg::krylov::{
    KrylovReport, KrylovSettings, KrylovWork, conjugate_gradient, flexible_conjugate_gradient,
};
use graintrain_linalg::ordering::Ordering;
use graintrain_linalg::precond::{BlockJacobi, Preconditioner};
use std::collections::BTreeMap;

/// Cap on conjugate gradient iterations.
const LIMIT: usize = 5000;

/// Makes `matrix` fit the problem and assembles K. True where the pattern is a new one.
fn refresh_matrix(
    matrix: &mut Option<BodyMatrix>,
    system: &NewtonSystem<'_>,
    solver: &'static str,
) -> Result<bool, NewtonError> {
    let Delassus::Rigid(rigid) = &system.problem.delassus else {
        return Err(NewtonError::Unsupported {
            solver,
            reason: "it needs the bodies, and the problem gives N as a matrix",
        });
    };
    let mut new_pattern = false;
    if system.new_delassus || matrix.is_none() {
        new_pattern = !matrix.as_ref().is_some_and(|old| old.fits(rigid));
        // The frames and arms change even where the pattern does not.
        *matrix = Some(BodyMatrix::new(rigid));
    }
    if let Some(matrix) = matrix {
        matrix.assemble(system.inverse_added);
    }
    Ok(new_pattern)
}

/// x <- H^-1 (b - D~^T K^-1 D~ H^-1 b): the solution in contact space by way of a solver of K.
fn by_bodies(
    matrix: &BodyMatrix,
    inverse_added: &[Block],
    b: &[f64],
    x: &mut [f64],
    y: &mut Vec<f64>,
    solve: impl FnOnce(&mut Vec<f64>),
) {
    for (i, w) in inverse_added.iter().enumerate() {
        x[3 * i..3 * i + 3].copy_from_slice(&apply3(w, [b[3 * i], b[3 * i + 1], b[3 * i + 2]]));
    }
    y.resize(6 * matrix.num_bodies(), 0.0);
    matrix.gather(x, y);
    solve(y);
    for (i, w) in inverse_added.iter().enumerate() {
        let u = matrix.contact_velocity(i, y);
        let rest = std::array::from_fn(|k| b[3 * i + k] - u[k]);
        x[3 * i..3 * i + 3].copy_from_slice(&apply3(w, rest));
    }
}

/// Sparse Cholesky factorisation of K; solutions are refined by conjugate gradients on S with the factor as
/// preconditioner, which removes the rounding errors that large weights H^-1 bring in.
#[derive(Default)]
pub struct BodyCholesky {
    matrix: Option<BodyMatrix>,
    factor: Option<SparseCholesky>,
    shifted: Vec<f64>,
    krylov: KrylovWork,
    product: DelassusWork,
    velocity: Vec<f64>,
    scratch: Vec<f64>,
    shift: f64,
}

impl NewtonSolver for BodyCholesky {
    fn name(&self) -> &'static str {
        "body-cholesky"
    }

    fn needs_schur(&self) -> bool {
        false
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let new_pattern = refresh_matrix(&mut self.matrix, system, "body-cholesky")?;
        if system.new_delassus {
            self.product = system.problem.delassus.work();
        }
        let Some(matrix) = &self.matrix else { return Ok(()) };
        if new_pattern || self.factor.is_none() {
            let ordering = Ordering::NestedDissection;
            self.factor = Some(SparseCholesky::new(6, matrix.row_starts(), matrix.columns(), ordering));
        }
        let Some(factor) = &mut self.factor else { return Ok(()) };
        let mut last = None;
        for shift in SHIFTS {
            self.shift = shift;
            let attempt = if shift == 0.0 {
                factor.factorize(matrix.blocks().as_flattened())
            } else {
                self.shifted.clear();
                self.shifted.extend_from_slice(matrix.blocks().as_flattened());
                for end in &matrix.row_starts()[1..] {
                    for d in 0..6 {
                        self.shifted[36 * (end - 1) + 7 * d] *= 1.0 + shift;
                    }
                }
                factor.factorize(&self.shifted)
            };
            match attempt {
                Ok(()) => return Ok(()),
                Err(error) => last = Some(error),
            }
        }
        let reason = last.map(|error| error.to_string()).unwrap_or_default();
        Err(NewtonError::Breakdown { solver: "body-cholesky", reason })
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        x: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let (Some(matrix), Some(factor)) = (&self.matrix, &mut self.factor) else {
            return LinearReport { residual: 1.0, ..Default::default() };
        };
        let (product, velocity) = (&mut self.product, &mut self.velocity);
        by_bodies(matrix, system.inverse_added, b, x, velocity, |y| factor.solve(y));
        let settings = KrylovSettings { relative_tolerance, max_iterations: REFINEMENTS };
        let report = conjugate_gradient(
            &mut |x, y| multiply_system(system.problem, system.added, x, y, product),
            &mut |r, z| by_bodies(matrix, system.inverse_added, r, z, velocity, |y| factor.solve(y)),
            b,
            x,
            settings,
            &mut self.krylov,
        );
        LinearReport {
            iterations: report.iterations,
            residual: report.residual,
            converged: report.converged(),
        }
    }

    fn solve_scaled(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> Option<LinearReport> {
        let (Some(matrix), Some(factor)) = (&self.matrix, &mut self.factor) else { return None };
        let Self { product, velocity, scratch, krylov, .. } = self;
        let settings = KrylovSettings { relative_tolerance, max_iterations: REFINEMENTS };
        let mut impulse = vec![0.0; b.len()];
        // z = b - F^T D~^T K^-1 D~ F b.
        let mut precondition = |r: &[f64], z: &mut [f64]| {
            apply_blocks(system.factor, r, &mut impulse, false);
            velocity.resize(6 * matrix.num_bodies(), 0.0);
            matrix.gather(&impulse, velocity);
            factor.solve(velocity);
            for i in 0..system.factor.len() {
                z[3 * i..3 * i + 3].copy_from_slice(&matrix.contact_velocity(i, velocity));
            }
            apply_blocks_in_place(system.factor, z, true);
            for (z, r) in z.iter_mut().zip(r) {
                *z = r - *z;
            }
        };
        precondition(b, z);
        let report = conjugate_gradient(
            &mut |x, y| multiply_scaled(system.problem, system.factor, x, y, product, scratch),
            &mut precondition,
            b,
            z,
            settings,
            krylov,
        );
        Some(LinearReport {
            iterations: report.iterations,
            residual: report.residual,
            converged: report.converged(),
        })
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        if let Some(factor) = &self.factor {
            figures.insert("factor_entries".to_string(), factor.cost().entries as f64);
            figures.insert("factor_flops".to_string(), factor.cost().flops);
            figures.insert("factor_shift".to_string(), self.shift);
        }
    }
}

/// Conjugate gradients on K with its 6x6 diagonal blocks as preconditioner, and on request a tensor-train correction
/// where that pays.
pub struct BodyCg {
    name: &'static str,
    matrix: Option<BodyMatrix>,
    preconditioner: BlockJacobi,
    correction: Option<TrainCorrection>,
    krylov: KrylovWork,
    product: DelassusWork,
    velocity: Vec<f64>,
    start: Vec<f64>,
    residual: Vec<f64>,
}

impl BodyCg {
    /// Block Jacobi alone.
    pub fn block_jacobi() -> Self {
        Self::new("body-cg", None)
    }

    /// Block Jacobi, corrected by a tensor train where that pays.
    pub fn tensor_train() -> Self {
        Self::new("tt", Some(TrainCorrection::default()))
    }

    fn new(name: &'static str, correction: Option<TrainCorrection>) -> Self {
        Self {
            name,
            matrix: None,
            preconditioner: BlockJacobi::new(6),
            correction,
            krylov: KrylovWork::default(),
            product: DelassusWork::default(),
            velocity: Vec::new(),
            start: Vec::new(),
            residual: Vec::new(),
        }
    }
}

impl NewtonSolver for BodyCg {
    fn name(&self) -> &'static str {
        self.name
    }

    fn needs_schur(&self) -> bool {
        false
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        refresh_matrix(&mut self.matrix, system, self.name)?;
        if system.new_delassus {
            self.product = system.problem.delassus.work();
        }
        let Some(matrix) = &self.matrix else { return Ok(()) };
        self.preconditioner
            .refresh_blocks((0..matrix.num_bodies()).map(|body| matrix.diagonal(body).as_slice()))
            .map_err(|error| NewtonError::Breakdown { solver: self.name, reason: error.to_string() })?;
        let Some(correction) = &mut self.correction else { return Ok(()) };
        correction
            .refresh(matrix, &self.preconditioner, system)
            .map_err(|error| NewtonError::Breakdown { solver: self.name, reason: error.to_string() })
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        x: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let Some(matrix) = &self.matrix else { return LinearReport { residual: 1.0, ..Default::default() } };
        let Self { preconditioner, correction, krylov, product, velocity, start, residual, .. } = self;
        let size = graintrain_linalg::parallel::norm(b);
        let mut iterations = 0;
        residual.resize(b.len(), 0.0);
        let mut relative = f64::INFINITY;
        // The residual of S follows that of K only roughly: the tolerance in body space is tightened until S agrees.
        let mut tolerance = relative_tolerance;
        for _ in 0..4 {
            by_bodies(matrix, system.inverse_added, b, x, velocity, |y| {
                let rhs = y.clone();
                if start.len() == y.len() {
                    y.copy_from_slice(start);
                } else {
                    y.fill(0.0);
                }
                let settings = KrylovSettings { relative_tolerance: tolerance, max_iterations: LIMIT };
                // A truncated train is symmetric only nearly.
                let report: KrylovReport = flexible_conjugate_gradient(
                    &mut |x, y| matrix.multiply(x, y),
                    &mut |r, z| match correction {
                        Some(correction) if correction.is_active() => correction.apply(preconditioner, r, z),
                        _ => preconditioner.apply(r, z),
                    },
                    &rhs,
                    y,
                    settings,
                    krylov,
                );
                iterations += report.iterations;
                start.resize(y.len(), 0.0);
                start.copy_from_slice(y);
            });
            multiply_system(system.problem, system.added, x, residual, product);
            for (residual, b) in residual.iter_mut().zip(b) {
                *residual = b - *residual;
            }
            let before = relative;
            relative = graintrain_linalg::parallel::norm(residual) / size.max(f64::MIN_POSITIVE);
            if relative <= relative_tolerance || relative > 0.9 * before {
                break;
            }
            tolerance *= (0.3 * relative_tolerance / relative).max(1e-4);
        }
        start.clear();
        LinearReport { iterations, residual: relative, converged: relative <= relative_tolerance }
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        if let Some(correction) = &self.correction {
            correction.figures(figures);
        }
    }
}
