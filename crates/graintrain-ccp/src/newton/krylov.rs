//! Krylov methods in contact space: on S~, and the paper's baseline on S.

use super::train_body::{RACE, Rival, unstructured};
use super::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, bicgstab, conjugate_gradient};
use graintrain_linalg::precond::{BlockJacobi, IncompleteCholesky, IncompleteLu, Preconditioner};

/// The paper's cap on iterations of the unpreconditioned method.
const PLAIN_LIMIT: usize = 1000;
/// Cap on iterations of the preconditioned methods.
const LIMIT: usize = 5000;

/// BiCGSTAB or conjugate gradients with a preconditioner.
pub struct SchurKrylov {
    name: &'static str,
    preconditioner: Option<Box<dyn Preconditioner>>,
    symmetric: bool,
    max_iterations: usize,
    work: KrylovWork,
}

impl SchurKrylov {
    fn new(
        name: &'static str,
        preconditioner: Option<Box<dyn Preconditioner>>,
        symmetric: bool,
        max_iterations: usize,
    ) -> Self {
        Self { name, preconditioner, symmetric, max_iterations, work: KrylovWork::default() }
    }

    /// BiCGSTAB on S without preconditioner.
    pub fn plain() -> Self {
        Self::new("none", None, false, PLAIN_LIMIT)
    }

    /// BiCGSTAB with block ILU(0), its diagonal enlarged where a pivot block is not positive definite: without that it fails
    /// in the middle of every interior-point run.
    pub fn incomplete_lu() -> Self {
        Self::new("ilu", Some(Box::new(IncompleteLu::definite())), false, LIMIT)
    }

    /// Conjugate gradients with block IC(0).
    pub fn incomplete_cholesky() -> Self {
        Self::new("ic", Some(Box::new(IncompleteCholesky::default())), true, LIMIT)
    }

    /// Conjugate gradients with the inverse diagonal blocks.
    pub fn block_jacobi() -> Self {
        Self::new("block-jacobi", Some(Box::new(BlockJacobi::new(3))), true, LIMIT)
    }

    /// What a solve costs, from a few iterations; `None` for the plain form and where the matrix is missing or empty.
    pub(super) fn measure(&mut self, system: &NewtonSystem<'_>) -> Option<Rival> {
        let (matrix, preconditioner) = (system.matrix?, self.preconditioner.as_ref()?);
        let mut x = vec![0.0; 3 * matrix.num_rows()];
        let b = unstructured(x.len());
        let settings = KrylovSettings { relative_tolerance: 0.0, max_iterations: RACE };
        let report = conjugate_gradient(
            &mut |x, y| matrix.multiply(x, y),
            &mut |r, z| preconditioner.apply(r, z),
            &b,
            &mut x,
            settings,
            &mut self.work,
        );
        // The matrix, and both triangular factors, which have its pattern.
        let flops = (2 * 2 * 9 * matrix.columns().len()) as f64;
        Some(Rival::new(report.iterations, report.residual, flops))
    }
}

impl NewtonSolver for SchurKrylov {
    fn name(&self) -> &'static str {
        self.name
    }

    fn form(&self) -> Form {
        if self.preconditioner.is_some() { Form::Scaled } else { Form::Plain }
    }

    fn needs_matrix(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let (Some(matrix), Some(preconditioner)) = (system.matrix, &mut self.preconditioner) else {
            return Ok(());
        };
        preconditioner
            .refresh(matrix)
            .map_err(|error| NewtonError::Breakdown { solver: self.name, reason: error.to_string() })
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        z.fill(0.0);
        let Some(matrix) = system.matrix else { return LinearReport { residual: 1.0, ..Default::default() } };
        let settings = KrylovSettings { relative_tolerance, max_iterations: self.max_iterations };
        self.work.patience = system.patience.clone();
        let method = if self.symmetric { conjugate_gradient } else { bicgstab };
        let preconditioner = &self.preconditioner;
        let report = method(
            &mut |x, y| matrix.multiply(x, y),
            &mut |r, z| match preconditioner {
                Some(preconditioner) => preconditioner.apply(r, z),
                None => z.copy_from_slice(r),
            },
            b,
            z,
            settings,
            &mut self.work,
        );
        LinearReport {
            iterations: report.iterations,
            residual: report.residual,
            converged: report.converged(),
        }
    }
}
