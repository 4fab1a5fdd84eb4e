//! Solvers of the CCP: what they share, and the ones that production needs.
//!
//! | module | holds |
//! |---|---|
//! | [`interface`], [`settings`], [`report`] | what a solver is given and gives |
//! | [`history`] | the residual over iterations and seconds |
//! | [`driver`] | limits, best iterate, progress |
//! | [`lanes`], [`tasks`], [`dispatch`] | vector registers and parallel loops |
//! | [`scaling`], [`combination`], `body_pass` | the scaled problem and its passes |
//! | `mechanisms`, `cell_images`, `compliance` | coupled bodies, those across the boundary of a cell, compliant contacts |
//! | [`octet`], `single`, `slots` | the same in single precision; where passes leave forces |
//! | [`ranks`], `share` | processes that work on one problem, and the part of each |
//! | [`first_order`] | what the first-order methods share |
//! | [`cascade`], [`fixed_point`] | who solves one after the other within one budget; exact friction by relaxed problems |
//! | [`path_following`] | exact friction where gradients do not get on |
//! | [`ipm`], [`infeasible`] | the interior point, and the search for a proof that there is no solution |
//!
//! Solvers by name are in [`crate::registry`].

mod accelerated_sweeps;
mod apgd;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx2_single;
mod body_operator;
mod body_pass;
pub mod cascade;
mod cell_images;
pub mod combination;
mod compliance;
pub mod dispatch;
pub mod driver;
pub mod first_order;
pub mod fixed_point;
mod gauss_seidel;
pub mod history;
pub mod infeasible;
pub mod interface;
pub mod ipm;
pub mod lanes;
mod mechanisms;
mod momentum;
pub mod octet;
mod packing;
#[cfg(test)]
mod pages;
pub mod path_following;
pub mod ranks;
pub mod report;
mod row_operator;
pub mod scaling;
pub mod settings;
mod share;
mod single;
mod slots;
mod start;
pub mod tasks;

pub use accelerated_sweeps::AcceleratedSweeps;
pub use apgd::Apgd;
pub use cascade::Cascade;
pub use gauss_seidel::GaussSeidel;
pub use history::ResidualSample;
pub use interface::{Capabilities, CcpSolver, Cost, ExactState};
pub use momentum::Memory;
pub use path_following::PathFollowing;
pub use ranks::Ranks;
pub use report::{SolveReport, StageRecord, Status};
pub use settings::SolveSettings;
