//! Solvers in body space: K = I + A A^T by sparse Cholesky or by conjugate gradients.

use super::body_matrix::BodyMatrix;
use super::convergence::{ConvergenceRate, few_iterations, product_flops};
use super::refinement::{REFINEMENTS, ShiftedCholesky};
use super::system::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use crate::delassus::Delassus;
use graintrain_linalg::cholesky::SparseCholesky;
use graintrain_linalg::krylov::{
    KrylovSettings, KrylovWork, Measure, conjugate_gradient, conjugate_gradient_measured,
};
use graintrain_linalg::ordering::Ordering;
use graintrain_linalg::parallel::norm;
use graintrain_linalg::precond::{BlockJacobi, IncompleteCholesky, Preconditioner, PreconditionerError};
use std::collections::BTreeMap;

/// Cap on conjugate gradient iterations.
pub(super) const LIMIT: usize = 5000;

/// Makes `matrix` fit the problem and assembles K. True where the pattern is a new one.
fn refresh_matrix(
    matrix: &mut Option<BodyMatrix>,
    system: &NewtonSystem<'_>,
    solver: &'static str,
) -> Result<bool, NewtonError> {
    let Delassus::Rigid(rigid) = &*system.problem.delassus else {
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
        matrix.assemble(system.blocks.factor);
    }
    Ok(new_pattern)
}

/// y <- (I + A^T A) z; `velocity` is work memory.
fn multiply_scaled(matrix: &BodyMatrix, z: &[f64], y: &mut [f64], velocity: &mut [f64]) {
    matrix.gather(z, velocity);
    y.copy_from_slice(z);
    matrix.scatter(1.0, velocity, y);
}

/// Sparse Cholesky factorisation of K; solutions are refined by conjugate gradients on S~ with the factor as
/// preconditioner, which removes the rounding errors that large weights H^-1 bring in.
#[derive(Default)]
pub struct BodyCholesky {
    matrix: Option<BodyMatrix>,
    factor: ShiftedCholesky,
    krylov: KrylovWork,
    velocity: Vec<f64>,
    image: Vec<f64>,
}

impl NewtonSolver for BodyCholesky {
    fn name(&self) -> &'static str {
        "body-cholesky"
    }

    fn needs_matrix(&self) -> bool {
        false
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let new_pattern = refresh_matrix(&mut self.matrix, system, "body-cholesky")?;
        let Some(matrix) = &self.matrix else { return Ok(()) };
        if new_pattern || self.factor.factor.is_none() {
            let ordering = Ordering::NestedDissection;
            self.factor.factor =
                Some(SparseCholesky::new(6, matrix.row_starts(), matrix.columns(), ordering));
        }
        let diagonal = matrix.row_starts()[1..].iter().map(|end| end - 1);
        self.factor.factorize(("body-cholesky", 6), matrix.blocks().as_flattened(), diagonal)
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let Self {
            matrix: Some(matrix),
            factor: ShiftedCholesky { factor: Some(factor), .. },
            krylov,
            velocity,
            image,
        } = self
        else {
            return LinearReport { residual: 1.0, ..Default::default() };
        };
        krylov.patience = system.patience.clone();
        velocity.resize(6 * matrix.num_bodies(), 0.0);
        image.resize(6 * matrix.num_bodies(), 0.0);
        let settings = KrylovSettings { relative_tolerance, max_iterations: REFINEMENTS };
        let mut precondition = |r: &[f64], z: &mut [f64]| {
            matrix.gather(r, velocity);
            factor.solve(velocity);
            z.copy_from_slice(r);
            matrix.scatter(-1.0, velocity, z);
        };
        precondition(b, z);
        let report = conjugate_gradient(
            &mut |x, y| multiply_scaled(matrix, x, y, image),
            &mut precondition,
            b,
            z,
            settings,
            krylov,
        );
        report.into()
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        self.factor.figures(figures);
    }
}

/// A preconditioner of K.
enum BodyPreconditioner {
    /// 6x6 block Jacobi.
    Jacobi(BlockJacobi),
    /// 6x6 block IC(0).
    Incomplete(Box<IncompleteCholesky<6, 36>>),
}

impl BodyPreconditioner {
    fn refresh(&mut self, matrix: &BodyMatrix) -> Result<(), PreconditionerError> {
        match self {
            Self::Jacobi(jacobi) => {
                jacobi.refresh_blocks((0..matrix.num_bodies()).map(|body| matrix.diagonal(body).as_slice()))
            }
            Self::Incomplete(incomplete) => {
                let (starts, columns, blocks) = (matrix.row_starts(), matrix.columns(), matrix.blocks());
                let range = |i: usize| starts[i]..starts[i + 1];
                incomplete.refresh_lower(matrix.num_bodies(), |i| (&columns[range(i)], &blocks[range(i)]))
            }
        }
    }

    fn apply(&self, r: &[f64], z: &mut [f64]) {
        match self {
            Self::Jacobi(jacobi) => jacobi.apply(r, z),
            Self::Incomplete(incomplete) => incomplete.apply(r, z),
        }
    }
}

/// A correction of block Jacobi in body space: a preconditioner of K that approximates L^-T (L^-1 K L^-T)^-1
/// L^-1, L the Cholesky factors of the diagonal blocks.
pub trait BodyCorrection: Send {
    /// Adapts to new values of K, whose diagonal blocks `jacobi` has factorised. Without a `baseline` the
    /// correction is measured against conjugate gradients with these blocks, and what it costs to make does
    /// not count.
    ///
    /// # Errors
    /// [`NewtonError::Breakdown`] where it could not be made.
    fn refresh(
        &mut self,
        matrix: &BodyMatrix,
        jacobi: &BlockJacobi,
        system: &NewtonSystem<'_>,
        baseline: Option<ConvergenceRate>,
    ) -> Result<(), NewtonError>;

    /// Whether it is better than block Jacobi alone for the present matrix, and [`Self::apply`] is to be
    /// used.
    fn is_active(&self) -> bool;

    /// Whether, moreover, one solve pays for making it.
    fn has_paid(&self) -> bool;

    /// It proved to be of no use for the present matrix.
    fn give_up(&mut self);

    /// z <- the corrected preconditioner of r; symmetric, but only nearly.
    fn apply(&mut self, jacobi: &BlockJacobi, r: &[f64], z: &mut [f64]);

    /// Named figures of what the last refresh measured.
    fn figures(&self, figures: &mut BTreeMap<String, f64>);
}

/// Conjugate gradients on K with block Jacobi or block IC(0), and on request a correction of the former.
///
/// Where K y = A b - rho, z = b - A^T y has the residual -A^T rho of S~: it is what conjugate gradients are
/// asked to make small. Where weights H^-1 spread, |A^T rho| is larger than |rho| by many orders of
/// magnitude.
pub struct BodyCg {
    name: &'static str,
    matrix: Option<BodyMatrix>,
    preconditioner: BodyPreconditioner,
    correction: Option<Box<dyn BodyCorrection>>,
    krylov: KrylovWork,
    max_iterations: usize,
    velocity: Vec<f64>,
    rhs: Vec<f64>,
    residual: Vec<f64>,
    image: Vec<f64>,
    best: Vec<f64>,
}

/// What conjugate gradients are asked for, in tolerances.
const MARGIN: f64 = 0.8;
/// Solves for what is missing because the residual of conjugate gradients has drifted from the true one.
const ROUNDS: usize = 4;

impl BodyCg {
    /// Block Jacobi alone.
    pub fn block_jacobi() -> Self {
        Self::new("body-cg", BodyPreconditioner::Jacobi(BlockJacobi::new(6)), None)
    }

    /// Block IC(0).
    pub fn incomplete_cholesky() -> Self {
        Self::new("body-ic", BodyPreconditioner::Incomplete(Box::default()), None)
    }

    /// Block Jacobi, corrected where that pays.
    pub fn corrected(name: &'static str, correction: Box<dyn BodyCorrection>) -> Self {
        Self::new(name, BodyPreconditioner::Jacobi(BlockJacobi::new(6)), Some(correction))
    }

    /// The correction, where there is one.
    pub fn correction(&self) -> Option<&dyn BodyCorrection> {
        self.correction.as_deref()
    }

    /// Iterations per solve at most.
    pub(super) fn set_max_iterations(&mut self, max_iterations: usize) {
        self.max_iterations = max_iterations;
    }

    /// Operations of an iteration: K and, with the same pattern, the triangular factors of IC(0).
    pub(super) fn iteration_flops(&self) -> f64 {
        self.matrix.as_ref().map_or(0.0, |matrix| match self.preconditioner {
            BodyPreconditioner::Jacobi(_) => product_flops(matrix),
            BodyPreconditioner::Incomplete(_) => 2.0 * product_flops(matrix),
        })
    }

    /// What a solve costs, from a few iterations.
    pub fn measure(&mut self, system: &NewtonSystem<'_>) -> Option<ConvergenceRate> {
        let flops = self.iteration_flops();
        self.krylov.patience = system.patience.clone();
        let Self { matrix: Some(matrix), preconditioner, krylov, .. } = self else { return None };
        let (iterations, residual) = few_iterations(matrix, &mut |r, z| preconditioner.apply(r, z), krylov);
        Some(ConvergenceRate::new(iterations, residual, flops))
    }

    /// As [`NewtonSolver::refresh`], the correction measured against another solver than block Jacobi.
    ///
    /// # Errors
    /// As [`NewtonSolver::refresh`].
    pub fn refresh_against(
        &mut self,
        system: &NewtonSystem<'_>,
        baseline: Option<ConvergenceRate>,
    ) -> Result<(), NewtonError> {
        refresh_matrix(&mut self.matrix, system, self.name)?;
        let Some(matrix) = &self.matrix else { return Ok(()) };
        self.preconditioner
            .refresh(matrix)
            .map_err(|error| NewtonError::Breakdown { solver: self.name, reason: error.to_string() })?;
        let (Some(correction), BodyPreconditioner::Jacobi(jacobi)) =
            (&mut self.correction, &self.preconditioner)
        else {
            return Ok(());
        };
        correction.refresh(matrix, jacobi, system, baseline)
    }

    fn new(
        name: &'static str,
        preconditioner: BodyPreconditioner,
        correction: Option<Box<dyn BodyCorrection>>,
    ) -> Self {
        Self {
            name,
            matrix: None,
            preconditioner,
            correction,
            krylov: KrylovWork::default(),
            max_iterations: LIMIT,
            velocity: Vec::new(),
            rhs: Vec::new(),
            residual: Vec::new(),
            image: Vec::new(),
            best: Vec::new(),
        }
    }
}

impl NewtonSolver for BodyCg {
    fn name(&self) -> &'static str {
        self.name
    }

    fn needs_matrix(&self) -> bool {
        false
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        self.refresh_against(system, None)
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let Self {
            matrix: Some(matrix),
            preconditioner,
            correction,
            krylov,
            velocity,
            rhs,
            residual,
            image,
            best,
            max_iterations,
            ..
        } = self
        else {
            return LinearReport { residual: 1.0, ..Default::default() };
        };
        krylov.patience = system.patience.clone();
        velocity.resize(6 * matrix.num_bodies(), 0.0);
        rhs.resize(6 * matrix.num_bodies(), 0.0);
        for vector in [&mut *residual, &mut *image, &mut *best] {
            vector.resize(b.len(), 0.0);
        }
        z.fill(0.0);
        residual.copy_from_slice(b);
        let size = norm(b).max(f64::MIN_POSITIVE);
        let mut report = LinearReport { iterations: 0, residual: norm(b) / size, converged: false };
        for _ in 0..ROUNDS {
            report.converged = report.residual <= relative_tolerance;
            if report.converged || report.iterations >= *max_iterations {
                break;
            }
            // With a margin: where the residual of the recurrence drifts, another round is nearly another
            // solve.
            let settings = KrylovSettings {
                relative_tolerance: MARGIN * relative_tolerance,
                max_iterations: *max_iterations - report.iterations,
            };
            matrix.gather(residual, rhs);
            velocity.fill(0.0);
            let with_correction = correction.as_ref().is_some_and(|correction| correction.is_active());
            let inner = conjugate_gradient_measured(
                &mut |x, y| matrix.multiply(x, y),
                &mut |r, z| match (&mut *correction, &*preconditioner) {
                    (Some(correction), BodyPreconditioner::Jacobi(jacobi)) if correction.is_active() => {
                        correction.apply(jacobi, r, z);
                    }
                    _ => preconditioner.apply(r, z),
                },
                rhs,
                velocity,
                settings,
                krylov,
                Measure {
                    norm: &mut |rho| {
                        image.fill(0.0);
                        matrix.scatter(1.0, rho, image);
                        norm(image) / size
                    },
                    // A correction is symmetric only nearly.
                    flexible: with_correction,
                },
            );
            report.iterations += inner.iterations;
            // A correction need not be positive definite: then the iteration breaks down.
            let failed =
                correction.as_mut().filter(|correction| correction.is_active() && !inner.converged());
            let was_corrected = failed.map(|correction| correction.give_up()).is_some();
            best.copy_from_slice(z);
            add_solution(matrix, b, z, residual, velocity);
            let before = std::mem::replace(&mut report.residual, norm(residual) / size);
            if report.residual.is_nan() || report.residual >= before {
                // No better than nothing.
                z.copy_from_slice(best);
                report.residual = before;
                if !was_corrected {
                    break;
                }
                true_residual(matrix, b, z, residual, velocity);
            }
            if system.patience.is_over() {
                break;
            }
        }
        report.converged = report.residual <= relative_tolerance;
        report
    }

    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        if let BodyPreconditioner::Incomplete(incomplete) = &self.preconditioner {
            figures.insert("body_shift".to_string(), incomplete.shift());
        }
        if let Some(correction) = &self.correction {
            correction.figures(figures);
        }
    }
}

/// z <- z + residual - A^T velocity, and the residual of that.
fn add_solution(matrix: &BodyMatrix, b: &[f64], z: &mut [f64], residual: &mut [f64], velocity: &mut [f64]) {
    for (z, r) in z.iter_mut().zip(residual.iter()) {
        *z += r;
    }
    matrix.scatter(-1.0, velocity, z);
    true_residual(matrix, b, z, residual, velocity);
}

/// residual <- b - S~ z; `velocity` is work memory.
fn true_residual(matrix: &BodyMatrix, b: &[f64], z: &[f64], residual: &mut [f64], velocity: &mut [f64]) {
    multiply_scaled(matrix, z, residual, velocity);
    for (residual, b) in residual.iter_mut().zip(b) {
        *residual = b - *residual;
    }
}
