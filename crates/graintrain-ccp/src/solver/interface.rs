//! What every solver of the CCP offers.

use super::path_following::PathFollowing;
use super::report::SolveReport;
use super::settings::SolveSettings;
use crate::problem::{Ccp, CcpError};

/// Iterations that a first-order method is allowed where the settings name no limit.
pub(crate) const ITERATION_LIMIT: usize = 100_000;

/// Contacts across the boundary of a cell that gives way up to which methods that need N as a matrix, with a block for each two of them, are tried.
pub(crate) const CELL_CONTACTS: usize = 200;

/// A method for the CCP. A solver may keep work memory and what it learned between solves: whatever depends on N alone is
/// used again for a problem that shares N with the last one (see [`Ccp::delassus`]).
pub trait CcpSolver: Send {
    /// Name as given on the command line.
    fn name(&self) -> String;

    /// Iterations that a relaxed solve is allowed where its settings name no limit.
    fn iteration_limit(&self) -> usize {
        ITERATION_LIMIT
    }

    /// Whether the solver takes bodies in a periodic cell that gives way ([`CellModes`](crate::CellModes)). Others return an error: they are to be given
    /// N as a matrix.
    fn takes_cells(&self) -> bool {
        false
    }

    /// Improves `impulse` (length 3 N_c, N s; the start on entry, e.g. last step's impulses or zero; the best iterate
    /// on exit, also where the solver did not converge).
    ///
    /// # Errors
    /// Only for a problem that the solver cannot treat; not converging is a [`Status`](super::Status).
    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError>;

    /// Exact Coulomb friction without the outer iteration of [`CoulombIteration`](super::CoulombIteration), where the method can; `None` where it
    /// cannot. `settings.friction` is [`FrictionModel::Coulomb`](crate::FrictionModel::Coulomb).
    ///
    /// The iterates begin at `last` (length 3 N_c); on exit it is where they ended, and `impulse` the best of them. The next call
    /// goes on from there: on their way to a solution of the exact problem residuals have to rise now and then, and from the best
    /// iterate the way between would be gone again and again.
    ///
    /// # Errors
    /// As [`Self::solve`].
    fn solve_exact(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        last: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<Option<SolveReport>, CcpError> {
        let _ = (problem, impulse, last, settings);
        Ok(None)
    }

    /// The solver that exact friction goes to where [`Self::solve_exact`] does not get on; `None` for methods that stay by themselves.
    fn path_following(&mut self) -> Option<&mut PathFollowing> {
        None
    }
}
