//! Krylov methods in contact space: on S~, and the paper's baseline on S.

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
