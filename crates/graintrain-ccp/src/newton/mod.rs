//! The linear systems of Newton's method for contact problems, (N + H) x = b, and their solvers.
//!
//! Both interior points ([`ipm`](crate::solver::ipm), `pdip` of the paper) meet the same matrix in every
//! iteration: S = N + H with the Delassus matrix N, which stays, and one symmetric positive definite 3x3
//! block H_i per contact, which changes. S is the Schur complement of the Newton system in contact space.
//! Near a solution the blocks H_i spread over 20 decades, also inside one block. So the system is scaled from
//! both sides: with factors H_i^-1 = F_i F_i^T from the closed form of the outer method,
//!
//! ```text
//! S~ z = F^T b,    S~ = F^T S F = I + F^T N F,    x = F z.
//! ```
//!
//! No eigenvalue of S~ is below 1. In body space, with A = D~ F, D~ = M^(-1/2) D, S~ = I + A^T A and
//! S~^-1 = I - A^T K^-1 A, K = I + A A^T ([`body_matrix`]).
//!
//! A solver of such systems is a [`NewtonSolver`]: [`refresh`](NewtonSolver::refresh) takes new blocks H,
//! [`solve`](NewtonSolver::solve) a right-hand side. Nothing in it is about contact: any convex quadratic
//! program over cones of dimension 3 has systems of this form (see `examples/conic_qp.rs`).
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
//! `none` and `tt-cross` are the paper's: they see S as it is. Preconditioners that commute with block
//! scaling (ILU(0), IC(0), block Jacobi) make the same iterates on both; only rounding and the norm of the
//! residual differ.
//!
//! `tt`, `tt-schur` and `tt-cross` need the feature `paper` (module `paper`); the names belong to
//! [`crate::registry`].

pub mod body;
pub mod body_matrix;
pub mod convergence;
pub mod direct;
pub mod driver;
pub mod incomplete;
pub mod krylov;
mod refinement;
mod schur;
pub mod system;

pub use convergence::ConvergenceRate;
pub use schur::SchurComplement;
pub use system::{Form, LinearReport, NewtonError, NewtonRecord, NewtonSolver, NewtonSystem, ScaledBlocks};
