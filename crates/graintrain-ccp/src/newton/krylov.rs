//! Krylov methods in contact space: on S~, and the paper's baseline on S.

use super::convergence::{ConvergenceRate, SAMPLE, unstructured};
use super::system::{Form, LinearReport, NewtonError, NewtonSolver, NewtonSystem, multiply_scaled};
use crate::delassus::{Delassus, DelassusWork};
use crate::problem::Ccp;
use graintrain_linalg::krylov::{KrylovReport, KrylovSettings, KrylovWork, bicgstab, conjugate_gradient};
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
    product: DelassusWork,
    scratch: Vec<f64>,
}

impl SchurKrylov {
    fn new(
        name: &'static str,
        preconditioner: Option<Box<dyn Preconditioner>>,
        symmetric: bool,
        max_iterations: usize,
    ) -> Self {
        Self {
            name,
            preconditioner,
            symmetric,
            max_iterations,
            work: KrylovWork::default(),
            product: DelassusWork::default(),
            scratch: Vec::new(),
        }
    }

    /// BiCGSTAB on S without preconditioner.
    pub fn plain() -> Self {
        Self::new("none", None, false, PLAIN_LIMIT)
    }

    /// BiCGSTAB with block ILU(0), its diagonal enlarged where a pivot block is not positive definite:
    /// without that it fails in the middle of every interior-point run.
    pub fn incomplete_lu() -> Self {
        Self::new("ilu", Some(Box::new(IncompleteLu::definite())), false, LIMIT)
    }

    /// Conjugate gradients with block IC(0).
    pub fn incomplete_cholesky() -> Self {
        Self::new("schur-ic", Some(Box::new(IncompleteCholesky::<3, 9>::default())), true, LIMIT)
    }

    /// Conjugate gradients with the inverse diagonal blocks.
    pub fn block_jacobi() -> Self {
        Self::new("block-jacobi", Some(Box::new(BlockJacobi::new(3))), true, LIMIT)
    }

    /// What a solve costs, from a few iterations; `None` for the plain form and where the matrix is missing
    /// or empty.
    pub fn measure(&mut self, system: &NewtonSystem<'_>) -> Option<ConvergenceRate> {
        let mut x = vec![0.0; 3 * system.problem.num_contacts()];
        let b = unstructured(x.len());
        let settings = KrylovSettings { relative_tolerance: 0.0, max_iterations: SAMPLE };
        let report = self.iterate(system, &b, &mut x, settings)?;
        let blocks = system.matrix.map_or(0, |matrix| matrix.columns().len());
        Some(ConvergenceRate::new(
            report.iterations,
            report.residual,
            iteration_flops(system.problem, blocks),
        ))
    }

    /// From x as it is; `None` where the matrix is missing.
    fn iterate(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        x: &mut [f64],
        settings: KrylovSettings,
    ) -> Option<KrylovReport> {
        let matrix = system.matrix?;
        let Self { preconditioner, symmetric, work, product, scratch, .. } = self;
        work.patience = system.patience.clone();
        let method = if *symmetric { conjugate_gradient } else { bicgstab };
        let report = method(
            &mut |x, y| match (&*system.problem.delassus, *symmetric) {
                // Through the bodies it reads a third of the memory. Symmetric methods are all of the scaled
                // form.
                (Delassus::Rigid(_), true) => {
                    multiply_scaled(system.problem, system.blocks.factor, x, y, product, scratch);
                }
                _ => matrix.multiply(x, y),
            },
            &mut |r, z| match preconditioner {
                Some(preconditioner) => preconditioner.apply(r, z),
                None => z.copy_from_slice(r),
            },
            b,
            x,
            settings,
            work,
        );
        Some(report)
    }
}

/// Operations of an iteration with IC(0): the product with S~, through the bodies where there are any, and
/// both triangular factors of S~, which has so many blocks.
pub(super) fn iteration_flops(problem: &Ccp, blocks: usize) -> f64 {
    let product = match *problem.delassus {
        Delassus::Rigid(_) => PRODUCT_FLOPS * problem.num_contacts(),
        Delassus::Sparse(_) => 2 * 9 * blocks,
    };
    (2 * 9 * blocks + product) as f64
}

/// Operations per contact of z + F^T D^T M^-1 D F z: F and its transpose 18 each; D and its transpose 15 for
/// the frame and for both bodies a cross product and sums, 15 each; M^-1, shared by the contacts of a
/// body, 20.
const PRODUCT_FLOPS: usize = 2 * (18 + 15 + 2 * 15) + 20;

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
        if system.new_delassus {
            self.product = system.problem.delassus.work();
        }
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
        let settings = KrylovSettings { relative_tolerance, max_iterations: self.max_iterations };
        let report = self.iterate(system, b, z, settings);
        report.map_or(LinearReport { residual: 1.0, ..Default::default() }, LinearReport::from)
    }
}
