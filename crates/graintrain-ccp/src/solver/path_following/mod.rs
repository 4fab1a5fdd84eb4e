//! `path`: the contact problem with exact Coulomb friction by following a smoothed path through its folds.
//!
//! **Equations.** With x = S g, S = diag(mu, 1, 1) per contact, the friction cones become second-order cones,
//! which are their own dual; N' = S^-1 N S^-1, r' = S^-1 r. With a metric eta_i per contact (geometric mean
//! of the diagonal of N'_ii) and x = P(w), y = eta (x - w), where P is the projection on the cones, x and y
//! are in the cones and perpendicular, whatever w is. Exact friction is N' x + r' + |y_t| e_n = y (De Saxce's
//! term). P is smoothed by P_tau: on the eigenvalues l = w_n +- |w_t| of w it acts as
//!
//! ```text
//! phi(l) = (l + sqrt(l^2 + 4 tau_i^2)) / 2,      tau_i = tau V / eta_i
//! G(w, tau) = N' P_tau(w) + r' + |y_t|_delta e_n - y = 0,      |y_t|_delta = sqrt(|y_t|^2 + delta^2),  delta = kappa eta_i tau_i
//! ```
//!
//! (Chen, Harker 1993; Kanzow 1996; Smale 1987: CHKS; for cones Fukushima, Luo, Tseng, "Smoothing functions
//! for second-order-cone complementarity problems", SIAM J. Optim. 12:436-460, 2001.) For large tau there is
//! one solution; as tau falls to 0 its path leads to a solution of the exact problem, of error O(tau), where
//! it leads anywhere.
//!
//! **Folds.** The exact problem is not monotone, and the path may turn back: there det J = 0 with J = dG/dw,
//! and no method that only lowers tau, or any measure of G, passes. Where tau does not fall any more the path
//! is followed by pseudo-arclength (H. Keller 1977). Its sense is given by the sign of det J, tau falling
//! where it is that of the beginning and rising where it is not: the orientation of the curve, which a scalar
//! product with the last step loses at sharp bends (Allgower, Georg, "Numerical Continuation Methods", 1990,
//! chapter 2).
//!
//! **Linear algebra.** One sparse LU ([`graintrain_linalg::lu`]) of J per step gives Newton's direction and
//! the tangent, over bodies as I + D~ A B^-1 D~^T (A = dP/dw, B the rest of J; the contact graph), over
//! contacts as N' A + B, whichever is cheaper; a bare matrix, symmetric or not, over contacts. I - A is kept
//! from vanishing (`LEAST_COMPLEMENT`): where impulses are not unique J would be singular.
//!
//! **Walks.** One walk goes down from large tau; which turns the path takes depends on kappa and on how
//! closely it is followed, so several are tried with other such settings, and from impulses that are nearly
//! right short ones at small tau. Iterations are factorisations, a report has a record of each (figures
//! `log10_tau`, `determinant_sign`, `folds`).
//!
//! **Limits.** A path that passes many folds near each other (W of low rank with large mu) may be lost: the
//! arclength then ends with steps of no length, and the solve [stalls](super::Status::Stalled); that tells
//! nothing about whether there is a solution. Coefficients of friction far below 1e-3 (but not 0) make N'
//! badly scaled. It proves no infeasibility. In relaxed mode De Saxce's term is left out, and the path is
//! monotone. Memory: the factors, twice those of a Cholesky factorisation.

mod follower;
mod jacobian;
mod smoothing;

use super::driver::{Limits, check_start};
use super::interface::{CcpSolver, Cost};
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::delassus::{Delassus, DelassusIdentity};
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};
use follower::{Follower, systems};
use jacobian::Jacobian;
use smoothing::SmoothedProblem;

/// Factorisations without which a walk is not worth a start.
const LEAST_SYSTEMS: usize = 10;

/// The solver.
#[derive(Default)]
pub struct PathFollowing {
    /// Pattern and symbolic factorisation of the last problem.
    prepared: Option<Prepared>,
}

/// What depends on N and the coefficients of friction alone.
struct Prepared {
    source: DelassusIdentity,
    friction: Vec<f64>,
    jacobian: Jacobian,
}

impl PathFollowing {
    /// The Jacobian of a problem, its symbolic part made once.
    fn prepare(&mut self, problem: &Ccp, smoothed: &SmoothedProblem<'_>) -> &mut Prepared {
        let kept = self
            .prepared
            .take()
            .filter(|kept| kept.source.is(&problem.delassus) && kept.friction == problem.friction);
        self.prepared.insert(kept.unwrap_or_else(|| Prepared {
            source: DelassusIdentity::of(&problem.delassus),
            friction: problem.friction.clone(),
            jacobian: Jacobian::new(problem, smoothed),
        }))
    }

    /// How many iterations of a first-order method cost as much as one factorisation for this problem: at
    /// least 1.
    fn iterations_per_system(&mut self, problem: &Ccp) -> f64 {
        let scale = ResidualScale::new(problem);
        let smoothed = SmoothedProblem::new(problem, &scale, FrictionModel::Coulomb);
        let factorisation = self.prepare(problem, &smoothed).jacobian.flops();
        let product = match &*problem.delassus {
            Delassus::Rigid(_) => RIGID_FLOPS * problem.num_contacts() as f64,
            Delassus::Sparse(matrix) => BLOCK_FLOPS * matrix.num_blocks() as f64,
        };
        (factorisation / product.max(1.0)).max(1.0)
    }

    fn follow(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, systems());
        check_start(problem, impulse)?;
        if problem.num_contacts() == 0 {
            return Ok(limits.report(NAME, problem, impulse, Status::Converged, 0, 0));
        }
        let scale = ResidualScale::new(problem);
        let smoothed = SmoothedProblem::new(problem, &scale, settings.friction);
        let prepared = self.prepare(problem, &smoothed);
        let mut follower =
            Follower::new(problem, &scale, &limits, settings.friction, smoothed, &mut prepared.jacobian);
        let status = follower.run(impulse);
        follower.best.restore(impulse);
        let story = follower.story;
        let history = story.history.into_samples();
        let mut report = limits.report(NAME, problem, impulse, status, story.systems, 0);
        if !report.converged() {
            report.remark = Some(format!(
                "the path was followed to tau = {:.1e} V / eta in {} walks and through {} folds",
                story.least_tau, story.walks, story.folds
            ));
        }
        Ok(SolveReport { newton: story.records, history, ..report })
    }
}

/// Floating point operations of an iteration per contact of rigid bodies, and per block of an explicit
/// matrix.
const RIGID_FLOPS: f64 = 200.0;
const BLOCK_FLOPS: f64 = 20.0;

/// Name on the command line.
const NAME: &str = "path";

impl CcpSolver for PathFollowing {
    fn name(&self) -> String {
        NAME.to_string()
    }

    fn iteration_limit(&self) -> usize {
        systems()
    }

    fn cost(&mut self, problem: &Ccp) -> Cost {
        Cost { start: 0.0, iteration: self.iterations_per_system(problem), least: LEAST_SYSTEMS }
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        self.capabilities().require(&self.name(), problem)?;
        self.follow(problem, impulse, settings)
    }
}
