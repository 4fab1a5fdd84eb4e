//! Cone complementarity problems (CCP) of rigid bodies with frictional contact, and their solvers.
//!
//! With the Delassus matrix N = D^T M^-1 D (symmetric positive semi-definite, one 3x3 block row per contact),
//! the free relative velocity r and the friction cones Y_i = { g : |(g_1, g_2)| <= mu_i g_n }, find impulses
//! g with
//!
//! ```text
//! Y_i  contains  g_i  perpendicular to  (N g + r)_i  in  Y_i^*        for every contact i
//! ```
//!
//! which are the optimality conditions of `min 1/2 g^T N g + r^T g` over the cones. Contacts may resist
//! turning as well ([`Ccp::turning`]): N then has a second block row for each of them, and their cone is
//! [`TurningCone`].
//!
//! Impulses are in N s, velocities in m/s, components always ordered (normal, tangent 1, tangent 2).
//!
//! | module | holds |
//! |---|---|
//! | [`cone`] | the friction cone and its projection |
//! | [`delassus`] | N, matrix-free over bodies or as a sparse matrix |
//! | [`problem`] | the CCP: N, r, mu, also from plain arrays ([`Ccp::from_csc`], [`Ccp::from_triplets`]) |
//! | [`residual`] | the one accuracy measure |
//! | [`newton`] | Newton systems and their linear solvers |
//! | [`solver`] | settings, report, the solvers of production |
//! | `paper` | feature `paper`: the methods that the paper compares, its interior point, its tensor trains |
//! | [`registry`] | solvers by name |
//! | [`sensitivity`] | derivatives of the solution by r and mu |
//!
//! Each uses only what stands above it. Without the feature `paper` no tensor train is compiled: names of
//! solvers that need it give [`CcpError::NotCompiled`].

// The C library has other bits on other machines: `graintrain_linalg::real`.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]
#![warn(clippy::too_many_lines)]

mod arrays;
pub mod cone;
pub mod delassus;
pub mod newton;
#[cfg(feature = "paper")]
pub mod paper;
pub mod problem;
pub mod registry;
pub mod residual;
pub mod sensitivity;
pub mod solver;

pub use cone::{FrictionCone, TurningCone};
pub use delassus::{
    BodyInverseMass, CELL_COMPONENTS, CellModes, CoupledBodies, Delassus, FIXED, RigidContact, RigidDelassus,
    TurningRows,
};
pub use problem::{Ccp, CcpError, TurningFriction};
pub use registry::SolverSpec;
pub use residual::{Criterion, FrictionModel, Residual};
pub use solver::{CcpSolver, Ranks, ResidualSample, SolveReport, SolveSettings, Status};
