//! The Newton systems: matrix, right-hand sides, what a linear solver offers and tells.

use crate::delassus::DelassusWork;
use crate::problem::Ccp;
use graintrain_linalg::block_ops::apply3;
use graintrain_linalg::block3::{Block, BlockMatrix3};
use graintrain_linalg::krylov::KrylovReport;
use graintrain_linalg::patience::Patience;
use std::collections::BTreeMap;

/// The blocks of a Newton matrix with the factors of their inverses, H^-1 = F F^T.
#[derive(Clone, Copy, Default)]
pub struct ScaledBlocks<'a> {
    /// H_i, symmetric positive definite, 1/kg.
    pub added: &'a [Block],
    /// F_i.
    pub factor: &'a [Block],
    /// F_i^-1.
    pub factor_inverse: &'a [Block],
}

/// Which of the two equivalent systems a solver takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// S~ = I + F^T N F.
    Scaled,
    /// S = N + H.
    Plain,
}

/// One Newton matrix.
#[derive(Clone, Copy)]
pub struct NewtonSystem<'a> {
    /// The problem: N, contact points, identities of the contacts.
    pub problem: &'a Ccp,
    /// H and its factors.
    pub blocks: ScaledBlocks<'a>,
    /// S~ or S as a sparse matrix whose pattern persists while the problem does; present for solvers that ask
    /// for it ([`NewtonSolver::needs_matrix`]), in the form they ask for.
    pub matrix: Option<&'a BlockMatrix3>,
    /// Whether N is another one than at the last refresh (then everything that depends on N has to be made
    /// anew).
    pub new_delassus: bool,
    /// Newton iteration of the outer method, from 0.
    pub iteration: usize,
    /// Long loops end where this does, with the best that there is.
    pub patience: &'a Patience,
}

/// What one linear solve did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinearReport {
    /// Iterations of the linear solver; steps of refinement for direct ones.
    pub iterations: usize,
    /// |b - S~ z| / |b|, or |b - S x| / |b| in the plain form.
    pub residual: f64,
    /// Whether the tolerance asked for was reached.
    pub converged: bool,
}

impl From<KrylovReport> for LinearReport {
    fn from(report: KrylovReport) -> Self {
        let converged = report.converged();
        Self { iterations: report.iterations, residual: report.residual, converged }
    }
}

/// Why a linear solver could not prepare itself for a matrix.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NewtonError {
    /// The solver cannot treat this problem at all.
    #[error("linear solver {solver} cannot treat this problem: {reason}")]
    Unsupported {
        /// Name of the linear solver.
        solver: &'static str,
        /// Why not.
        reason: &'static str,
    },
    /// The factorisation or preconditioner broke down on these values.
    #[error("linear solver {solver} broke down: {reason}")]
    Breakdown {
        /// Name of the linear solver.
        solver: &'static str,
        /// What happened.
        reason: String,
    },
}

/// A solver of S~ z = b, or of S x = b where it asks for the plain form, that is prepared once per H. It may
/// keep what it learned between matrices and between problems (symbolic factorisations, hot starts).
pub trait NewtonSolver: Send {
    /// Name as given after the `+`.
    fn name(&self) -> &'static str;

    /// The name with the settings that can be given in it, where they are not the usual ones.
    fn full_name(&self) -> String {
        self.name().to_string()
    }

    /// The system that this solver solves.
    fn form(&self) -> Form {
        Form::Scaled
    }

    /// Looks at a new problem before its first matrix, e.g. to choose a form; matrix and blocks are not there
    /// yet.
    fn prepare(&mut self, system: &NewtonSystem<'_>) {
        let _ = system;
    }

    /// Whether [`NewtonSystem::matrix`] has to be there. Asked after [`Self::prepare`].
    fn needs_matrix(&self) -> bool;

    /// Adapts to new blocks H.
    ///
    /// # Errors
    /// [`NewtonError`]; the solver then must not be used until the next success.
    fn refresh(&mut self, system: &NewtonSystem<'_>) -> Result<(), NewtonError>;

    /// Solves the system to a relative residual; `z` gets the best iterate found. `system` is that of the
    /// last refresh.
    fn solve(
        &mut self,
        system: &NewtonSystem<'_>,
        b: &[f64],
        z: &mut [f64],
        relative_tolerance: f64,
    ) -> LinearReport;

    /// Named figures of the last refresh and of the solves since (ranks, compression error, fill, ...).
    fn figures(&self, figures: &mut BTreeMap<String, f64>) {
        let _ = figures;
    }
}

/// What the linear solver did in one Newton iteration.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NewtonRecord {
    /// Newton iteration, from 0.
    pub iteration: usize,
    /// Iterations of the linear solver, summed over the right-hand sides.
    pub inner_iterations: usize,
    /// Seconds in [`NewtonSolver::refresh`], and in making the matrix it asks for. The first of a problem
    /// includes [`NewtonSolver::prepare`], the assembly of N and the pattern.
    pub precompute_seconds: f64,
    /// Seconds in [`NewtonSolver::solve`].
    pub apply_seconds: f64,
    /// Largest relative residual of the linear solves.
    pub linear_residual: f64,
    /// Whether every linear solve reached its tolerance.
    pub linear_converged: bool,
    /// Estimate of the condition number of S~ from below: its largest eigenvalue by power iteration (none is
    /// below 1).
    pub condition: f64,
    /// Residual of the contact problem before the iteration, where the outer method evaluates it.
    pub residual: f64,
    /// Step length taken.
    pub step: f64,
    /// What [`NewtonSolver::figures`] reported.
    pub figures: BTreeMap<String, f64>,
}

/// y <- z + F^T N F z.
pub(crate) fn multiply_scaled(
    problem: &Ccp,
    factor: &[Block],
    z: &[f64],
    y: &mut [f64],
    work: &mut DelassusWork,
    scratch: &mut Vec<f64>,
) {
    scratch.resize(z.len(), 0.0);
    apply_blocks(factor, z, scratch, false);
    problem.delassus.multiply(scratch, y, work);
    apply_blocks_in_place(factor, y, true);
    for (y, z) in y.iter_mut().zip(z) {
        *y += z;
    }
}

fn times(block: &Block, x: [f64; 3], transposed: bool) -> [f64; 3] {
    if transposed {
        std::array::from_fn(|k| block[k] * x[0] + block[3 + k] * x[1] + block[6 + k] * x[2])
    } else {
        apply3(block, x)
    }
}

/// y_i <- B_i x_i, or B_i^T x_i.
pub(crate) fn apply_blocks(blocks: &[Block], x: &[f64], y: &mut [f64], transposed: bool) {
    for (i, block) in blocks.iter().enumerate() {
        let k = 3 * i;
        y[k..k + 3].copy_from_slice(&times(block, [x[k], x[k + 1], x[k + 2]], transposed));
    }
}

/// x_i <- B_i x_i, or B_i^T x_i.
pub(crate) fn apply_blocks_in_place(blocks: &[Block], x: &mut [f64], transposed: bool) {
    for (i, block) in blocks.iter().enumerate() {
        let k = 3 * i;
        let product = times(block, [x[k], x[k + 1], x[k + 2]], transposed);
        x[k..k + 3].copy_from_slice(&product);
    }
}
