//! Solvers against other solvers and by their own promises, in one program: linking it once is most of the
//! cost.

mod common;
#[cfg(feature = "paper")]
mod first_order;
#[cfg(feature = "paper")]
mod impossible;
#[cfg(feature = "paper")]
mod infeasible;
mod invariance;
#[cfg(feature = "paper")]
mod measure;
mod mechanisms;
#[cfg(feature = "paper")]
mod newton;
mod path_following;
mod ranks;
#[cfg(feature = "paper")]
mod scip;
mod single;
#[cfg(feature = "paper")]
mod threads;
#[cfg(feature = "paper")]
mod turning;
