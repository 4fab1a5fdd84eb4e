//! What every solver of the CCP offers.

use super::report::SolveReport;
use super::settings::SolveSettings;
use crate::delassus::{Delassus, RigidDelassus};
use crate::problem::{Ccp, CcpError};

/// Iterations that a first-order method is allowed where the settings name no limit.
pub(crate) const ITERATION_LIMIT: usize = 100_000;

/// Contacts across the boundary of a stress-controlled cell up to which methods that need N as a matrix, with
/// a block for each two of them, are tried.
const CELL_CONTACTS: usize = 200;

/// Which problems a method takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Contacts that resist turning ([`Ccp::turning`]).
    pub turning: bool,
    /// Bodies in a stress-controlled periodic cell ([`CellModes`](crate::CellModes)).
    pub cell: bool,
    /// Bodies that joints couple ([`CoupledBodies`](crate::CoupledBodies)), and compliant contacts.
    pub coupling: bool,
    /// Exact friction in its own iterations ([`CcpSolver::solve_exact`]).
    pub exact: bool,
}

impl Capabilities {
    /// Sliding friction over bodies that move one by one, by relaxed solves alone.
    pub const PLAIN: Self = Self { turning: false, cell: false, coupling: false, exact: false };

    /// Whether a method takes these bodies as they are. Who does not is given N as a matrix.
    pub(crate) fn take(self, rigid: &RigidDelassus) -> bool {
        let takes_cell = self.cell || rigid.cell().is_none();
        takes_cell && (self.coupling || rigid.coupled().is_empty() && rigid.compliance().is_empty())
    }

    /// # Errors
    /// [`CcpError::Unsupported`] for a problem that has to be another one for this solver.
    pub(crate) fn require(self, solver: &str, problem: &Ccp) -> Result<(), CcpError> {
        let reason = match &*problem.delassus {
            _ if !self.turning && !problem.turning.is_empty() => {
                "contacts have rolling or spinning friction, which auto, apgd, apgs, pgs and pj take"
            }
            Delassus::Rigid(rigid) if !self.take(rigid) => {
                "joints couple bodies, contacts are compliant or the periodic cell is stress-controlled; it takes the \
                 problem with N as a matrix"
            }
            _ => return Ok(()),
        };
        Err(CcpError::Unsupported { solver: solver.to_string(), reason: reason.to_string() })
    }

    /// Whether a problem is among them.
    pub fn fit(self, problem: &Ccp) -> bool {
        let takes_cell = self.cell || problem.contacts_across() <= CELL_CONTACTS;
        takes_cell && (self.turning || problem.turning.is_empty())
    }
}

/// What a method's work costs, in iterations of projected gradients ([`Apgd`](super::Apgd)).
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// Before its first iteration.
    pub start: f64,
    /// Per iteration.
    pub iteration: f64,
    /// Iterations without which it comes to nothing.
    pub least: usize,
}

impl Default for Cost {
    fn default() -> Self {
        Self { start: 0.0, iteration: 1.0, least: 1 }
    }
}

/// What goes from one turn of exact friction to the next.
#[derive(Clone, Debug, Default)]
pub struct ExactState {
    /// Where the iterates are (length 3 N_c).
    pub last: Vec<f64>,
    /// How long the momentum may last, of a method that has one and has found out.
    pub memory: Option<f64>,
}

/// A method for the CCP. A solver may keep work memory and what it learned between solves: whatever depends
/// on N alone is used again for a problem that shares N with the last one (see [`Ccp::delassus`]).
pub trait CcpSolver: Send {
    /// Name as given on the command line.
    fn name(&self) -> String;

    /// Iterations that a relaxed solve is allowed where its settings name no limit.
    fn iteration_limit(&self) -> usize {
        ITERATION_LIMIT
    }

    /// Which problems it takes; of others it returns an error.
    fn capabilities(&self) -> Capabilities {
        Capabilities::PLAIN
    }

    /// What its work on this problem costs.
    fn cost(&mut self, _problem: &Ccp) -> Cost {
        Cost::default()
    }

    /// Improves `impulse` (length 3 N_c, N s; the start on entry, e.g. last step's impulses or zero; the best
    /// iterate on exit, also where the solver did not converge).
    ///
    /// # Errors
    /// Only for a problem that the solver cannot treat; not converging is a [`Status`](super::Status).
    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError>;

    /// Exact Coulomb friction without the outer iteration of the [fixed point](super::fixed_point), where the
    /// method can; `None` where it cannot. `settings.friction` is
    /// [`FrictionModel::Coulomb`](crate::FrictionModel::Coulomb).
    ///
    /// The iterates begin at `state.last`; on exit it is where they ended, and `impulse` the best of them.
    /// The next call goes on from there: on their way to a solution of the exact problem residuals have to
    /// rise now and then, and from the best iterate the way between would be gone again and again.
    ///
    /// # Errors
    /// As [`Self::solve`].
    fn solve_exact(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        state: &mut ExactState,
        settings: &SolveSettings,
    ) -> Result<Option<SolveReport>, CcpError> {
        let _ = (problem, impulse, state, settings);
        Ok(None)
    }
}
