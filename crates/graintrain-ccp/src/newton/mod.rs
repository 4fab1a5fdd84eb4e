//! The linear systems of Newton's method for contact problems, (N + H) x = b, and their solvers.
//!
//! Both interior points ([`ipm`](crate::solver::ipm), [`pdip`](crate::solver::pdip)) meet the same matrix in every
//! iteration: S = N + H with the Delassus matrix N, which stays, and one symmetric positive definite 3x3 block H_i per
//! contact, which changes. S is the Schur complement of the Newton system in contact space. Near a solution the blocks
//! H_i spread over 20 decades, also inside one block. So the system is scaled from both sides: with factors
//! H_i^-1 = F_i F_i^T from the closed form of the outer method,
//!
//! ```text
//! S~ z = F^T b,    S~ = F^T S F = I + F^T N F,    x = F z.
//! ```
//!
//! No eigenvalue of S~ is below 1. In body space, with A = D~ F, D~ = M^(-1/2) D, S~ = I + A^T A and
//! S~^-1 = I - A^T K^-1 A, K = I + A A^T ([`body_matrix`]).
//!
//! A solver of such systems is a [`NewtonSolver`]: [`refresh`](NewtonSolver::refresh) takes new blocks H,
//! [`solve`](NewtonSolver::solve) a right-hand side. Nothing in it is about contact: any convex quadratic program over
//! cones of dimension 3 has systems of this form (see `examples/conic_qp.rs`).
//!
//! | name | solver | matrix |
//! |---|---|---|
//! | `none` | BiCGSTAB, at most 1000 iterations (the paper's baseline) | S |
//! | `ilu` | BiCGSTAB with block ILU(0) (the paper's second baseline) | S~ |
//! | `ic` | conjugate gradients with block IC(0), the cheaper of the two | S~ or K |
//! | `schur-ic` | conjugate gradients with 3x3 block IC(0) | S~ |
//! | `body-ic` | conjugate gradients with 6x6 block IC(0) | K |
//! | `block-jacobi` | conjugate gradients with 3x3 block Jacobi | S~ |
//! | `cholesky` | sparse Cholesky, the cheaper of the two | S~ or K |
//! | `schur-cholesky` | sparse Cholesky | S~ |
//! | `body-cholesky` | sparse Cholesky | K |
//! | `body-cg` | conjugate gradients with 6x6 block Jacobi | K |
//! | `tt` | `body-cg`, corrected by a tensor train, where that pays; else `ic` | K or S~ |
//! | `tt-schur` | BiCGSTAB with a tensor-train inverse, compressed exactly | S~ |
//! | `tt-cross` | BiCGSTAB with the paper's tensor-train inverse | S |
//!
//! `none` and `tt-cross` are the paper's: they see S as it is. Preconditioners that commute with block scaling (ILU(0),
//! IC(0), block Jacobi) make the same iterates on both; only rounding and the norm of the residual differ.

pub mod body;
pub mod body_matrix;
pub mod direct;
pub mod driver;
pub mod incomplete;
pub mod krylov;
pub mod schur;
pub mod train;
pub mod train_body;
pub mod train_schur;

pub use schur::SchurComplement;

use crate::problem::{Ccp, CcpError};
use graintrain_linalg::block3::{Block, BlockMatrix3};
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
    /// S~ or S as a sparse matrix whose pattern persists while the problem does; present for solvers that ask for it
    /// ([`NewtonSolver::needs_matrix`]), in the form they ask for.
    pub matrix: Option<&'a BlockMatrix3>,
    /// Whether N is another one than at the last refresh (then everything that depends on N has to be made anew).
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

/// A solver of S~ z = b, or of S x = b where it asks for the plain form, that is prepared once per H. It may keep what it
/// learned between matrices and between problems (symbolic factorisations, hot starts).
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

    /// Looks at a new problem before its first matrix, e.g. to choose a form; matrix and blocks are not there yet.
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

    /// Solves the system to a relative residual; `z` gets the best iterate found. `system` is that of the last refresh.
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
    /// Seconds in [`NewtonSolver::refresh`], and in making the matrix it asks for. The first of a problem includes
    /// [`NewtonSolver::prepare`], the assembly of N and the pattern.
    pub precompute_seconds: f64,
    /// Seconds in [`NewtonSolver::solve`].
    pub apply_seconds: f64,
    /// Largest relative residual of the linear solves.
    pub linear_residual: f64,
    /// Whether every linear solve reached its tolerance.
    pub linear_converged: bool,
    /// Estimate of the condition number of S~ from below: its largest eigenvalue by power iteration (none is below 1).
    pub condition: f64,
    /// Residual of the contact problem before the iteration, where the outer method evaluates it.
    pub residual: f64,
    /// Step length taken.
    pub step: f64,
    /// What [`NewtonSolver::figures`] told.
    pub figures: BTreeMap<String, f64>,
}

/// A linear solver that can be asked for by name.
pub struct LinearMethod {
    /// Name after the `+`.
    pub name: &'static str,
    /// One line for `--help`.
    pub about: &'static str,
    build: fn() -> Box<dyn NewtonSolver>,
}

/// Every linear solver, in the order of the documentation.
pub const LINEAR_METHODS: &[LinearMethod] = &[
    LinearMethod {
        name: "none",
        about: "BiCGSTAB on S, at most 1000 iterations",
        build: || Box::new(krylov::SchurKrylov::plain()),
    },
    LinearMethod {
        name: "ilu",
        about: "BiCGSTAB on S~ with block ILU(0), shifted where it is not definite",
        build: || Box::new(krylov::SchurKrylov::incomplete_lu()),
    },
    LinearMethod {
        name: "ic",
        about: "conjugate gradients with block IC(0) on K or S~, whichever needs fewer operations",
        build: || Box::new(incomplete::IncompleteCholeskyCg::default()),
    },
    LinearMethod {
        name: "schur-ic",
        about: "conjugate gradients on S~ (contact space) with 3x3 block IC(0)",
        build: || Box::new(krylov::SchurKrylov::incomplete_cholesky()),
    },
    LinearMethod {
        name: "body-ic",
        about: "conjugate gradients on K (body space) with 6x6 block IC(0)",
        build: || Box::new(body::BodyCg::incomplete_cholesky()),
    },
    LinearMethod {
        name: "block-jacobi",
        about: "conjugate gradients on S~ with 3x3 block Jacobi",
        build: || Box::new(krylov::SchurKrylov::block_jacobi()),
    },
    LinearMethod {
        name: "cholesky",
        about: "sparse Cholesky of S~ or K, whichever needs fewer operations",
        build: || Box::new(direct::Direct::default()),
    },
    LinearMethod {
        name: "schur-cholesky",
        about: "sparse Cholesky of S~ (contact space)",
        build: || Box::new(direct::SchurCholesky::default()),
    },
    LinearMethod {
        name: "body-cholesky",
        about: "sparse Cholesky of K (body space)",
        build: || Box::new(body::BodyCholesky::default()),
    },
    LinearMethod {
        name: "body-cg",
        about: "conjugate gradients on K with 6x6 block Jacobi",
        build: || Box::new(body::BodyCg::block_jacobi()),
    },
    LinearMethod {
        name: "tt",
        about: "conjugate gradients with a tensor train where that pays, with block IC(0) where not",
        build: || Box::new(train::TensorTrain::default()),
    },
    LinearMethod {
        name: "tt-schur",
        about: "BiCGSTAB on S~ with a tensor-train inverse, compressed exactly",
        build: || Box::new(train_schur::TrainSchur::scaled()),
    },
    LinearMethod {
        name: "tt-cross",
        about: "BiCGSTAB on S with the paper's tensor-train inverse (AMEn-cross, unscaled)",
        build: || Box::new(train_schur::TrainSchur::literal()),
    },
];

/// Accuracy and rank cap of `tt-cross@EPS:CAP`, 0 < EPS < 1 and CAP > 0. A comma or a slash will do as well, but lists of
/// solvers are split at commas.
fn literal_settings(name: &str) -> Option<(f64, usize)> {
    let (accuracy, cap) = name.strip_prefix("tt-cross@")?.split_once([':', ',', '/'])?;
    let (accuracy, cap) = (accuracy.parse::<f64>().ok()?, cap.parse::<usize>().ok()?);
    (accuracy > 0.0 && accuracy < 1.0 && cap > 0).then_some((accuracy, cap))
}

/// The linear solver of this name; `tt-cross@1e-3:100` is `tt-cross` at accuracy 1e-3 with ranks up to 100.
///
/// # Errors
/// [`CcpError::UnknownSolver`] naming the `method` it was asked for.
pub fn linear_solver(method: &str, name: &str) -> Result<Box<dyn NewtonSolver>, CcpError> {
    if let Some((accuracy, cap)) = literal_settings(name) {
        return Ok(Box::new(train_schur::TrainSchur::literal_at(accuracy, cap)));
    }
    LINEAR_METHODS.iter().find(|linear| linear.name == name).map(|linear| (linear.build)()).ok_or_else(|| {
        let mut known: Vec<String> =
            LINEAR_METHODS.iter().map(|linear| format!("{method}+{}", linear.name)).collect();
        known.push(format!("{method}+tt-cross@ACCURACY:RANK"));
        CcpError::UnknownSolver { name: format!("{method}+{name}"), known: known.join(", ") }
    })
}

/// y <- z + F^T N F z.
pub(crate) fn multiply_scaled(
    problem: &Ccp,
    factor: &[Block],
    z: &[f64],
    y: &mut [f64],
    work: &mut crate::delassus::DelassusWork,
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
        graintrain_linalg::block_ops::apply3(block, x)
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
