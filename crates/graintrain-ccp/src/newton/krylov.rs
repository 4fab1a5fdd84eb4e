//! Krylov methods on the Schur complement S in contact space.

use super::{LinearReport, NewtonError, NewtonSolver, NewtonSystem};
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, bicgstab, conjugate_gradient};
use graintrain_linalg::precond::{BlockJacobi, IncompleteCholesky, IncompleteLu, Preconditioner};

/// The paper's cap on iterations of the unpreconditioned method.
const PLAIN_LIMIT: usize = 1000;
/// Cap on iterations of the preconditioned methods.
const LIMIT: usize = 5000;

/// BiCGSTAB or conjugate gradients on S with a preconditioner.
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

    /// BiCGSTAB without preconditioner.
    pub fn plain() -> Self {
        Self::new("none", None, false, PLAIN_LIMIT)
    }

    /// BiCGSTAB with block ILU(0).
    pub fn incomplete_lu() -> Self {
        Self::new("ilu", Some(Box::new(IncompleteLu::default())), false, LIMIT)
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

    fn needs_schur(&self) -> bool {
        true
    }

    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError> {
        let (Some(schur), Some(preconditioner)) = (system.schur, &mut self.preconditioner) else {
            return Ok(());
        };
        preconditioner
            .refresh(schur)
            .map_err(|error| NewtonError::Breakdown { solver: self.name, reason: error.to_string() })
    }

    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        x: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport {
        let Some(schur) = system.schur else { return LinearReport { residual: 1.0, ..Default::default() } };
        let settings = KrylovSettings { relative_tolerance, max_iterations: self.max_iterations };
        let method = if self.symmetric { conjugate_gradient } else { bicgstab };
        let preconditioner = &self.preconditioner;
        let report = method(
            &mut |x, y| schur.multiply(x, y),
            &mut |r, z| match preconditioner {
                Some(preconditioner) => preconditioner.apply(r, z),
                None => z.copy_from_slice(r),
            },
            b,
            x,
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
