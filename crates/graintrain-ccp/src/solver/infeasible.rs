//! When a problem has no solution: the certificate, and how it is measured.
//!
//! By the lemma of Farkas for cones, no velocity change v of the bodies makes D^T v + r an element of the
//! dual cones if there are impulses g in the friction cones that move nothing and are asked for nevertheless,
//!
//! ```text
//! g_i in Y_i,    D g = 0,    r^T g < 0
//! ```
//!
//! (bodies that are wedged in, contacts between bodies that cannot move). Impulses of an iteration that has
//! no solution to converge to grow without limit, and their direction tends to such a ray; so do their
//! changes. Source: G. Banjac, P. Goulart, B. Stellato, S. Boyd, "Infeasibility detection in the alternating
//! direction method of multipliers for convex optimization", Journal of Optimization Theory and Applications
//! 183:490-519, 2019.
//!
//! No computed ray has D g = 0. What it proves all the same: D^T v + r in the dual cones and g in the cones
//! give g^T (D^T v + r) >= 0, hence
//!
//! ```text
//! max_b max(|u_b|, L_b |w_b|)  >=  V = -r^T g / sum_b ( |f_b| + |m_b| / L_b )
//! ```
//!
//! with f_b and m_b the sums of the impulses on body b and of their moments, L_b its longest arm or length of
//! turning rows. **A solution would have to change the velocity of some body by V.** The verdict is V in
//! units of the largest |r_i|: no masses enter, no units, no size of g. Where N is a matrix without bodies,
//! g^T (N g* + r) >= 0 for a solution g* gives in the same way, with any d,
//!
//! ```text
//! max_i max(|(N g*)_i|, 1e-6 eta_i |g*_i|)  >=  V = -r^T g / sum_i ( |d_i| + 1e6 |(N g - N d)_i| / eta_i ).
//! ```
//!
//! With N d = N g velocities alone count, as over bodies: impulses are large wherever a heavy body rests on a
//! light one. A ratio of masses of more than 1e10 is taken for a body that cannot move.
//!
//! The cones may be any: contacts that resist turning have a component more per row (`apart` says how they
//! are searched). Exact friction adds s >= 0 to u_n and has no solution where r has none without friction,
//! u_n >= 0; that the relaxation has none proves nothing about it.
//!
//! Bounds of the rounding errors are counted against the claim. [`certificate`] looks for a ray.
//!
//! Marginal problems: whether a V of 1e5 means "no solution" or "bodies thrown at 1e5 times the speed they
//! meet with" is a matter of taste, not of mathematics. A solver says
//! [`Status::Infeasible`] where V is at least [`CERTAIN`], or, after it failed in
//! every other way, at least [`PROBABLE`]; below that it says that it stalled.

mod apart;
mod certificate;
mod search;

pub(crate) use certificate::GOOD_ENOUGH;
pub use certificate::{CERTAIN, Certificate, PROBABLE};
pub(crate) use search::{is_suspicious, search};

use super::driver::Limits;
use super::ipm::scaled::Scaled;
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::newton::direct::Direct;
use crate::newton::driver::NewtonDriver;
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};
use certificate::Evaluator;
use std::borrow::Cow;

/// Looks for the impulses that prove most: for a problem with a solution `needed_velocity` is at most the
/// largest change of velocity of a body in that solution over max_i |r_i|, for one without there is no bound
/// but rounding. Costs 20 to 80 sparse factorisations.
///
/// # Errors
/// [`CcpError`] where the problem is not valid.
pub fn certificate(problem: &Ccp) -> Result<Certificate, CcpError> {
    found(problem, &SolveSettings::default(), &mut 0)
}

/// The report on the impulses of a solve that ended with `status`: [`Status::Infeasible`] where there is a
/// proof. `settings.max_iterations` bounds the Newton systems.
pub(crate) fn verdict(
    problem: &Ccp,
    impulse: &[f64],
    status: Status,
    settings: &SolveSettings,
) -> Result<SolveReport, CcpError> {
    let limits = Limits::start(settings, usize::MAX);
    let frictionless = (settings.friction == FrictionModel::Coulomb).then(|| problem.frictionless());
    let mut systems = 0;
    let found = found(frictionless.as_ref().unwrap_or(problem), settings, &mut systems)?;
    let status = if found.needed_velocity >= PROBABLE { Status::Infeasible } else { status };
    Ok(limits.report("certificate", problem, impulse, status, systems, 0))
}

fn found(problem: &Ccp, settings: &SolveSettings, systems: &mut usize) -> Result<Certificate, CcpError> {
    problem.validate()?;
    if problem.num_contacts() == 0 {
        return Ok(Certificate::default());
    }
    let problem = &measurable(problem);
    let apart = apart::apart(problem)?;
    let scaled = Scaled::new(&apart, &ResidualScale::new(&apart), &mut None);
    let mut newton = NewtonDriver::new(Box::new(Direct::default()));
    newton.begin(&scaled.problem);
    let settings = SolveSettings { tolerance: 0.0, ..settings.clone() };
    let limits = Limits::start(&settings, usize::MAX);
    Ok(search(&mut newton, problem, &scaled, &limits, systems))
}

/// The problem with N as a matrix where it is more than bodies that move one by one: V over bodies would know
/// nothing of joints, springs and cells.
fn measurable(problem: &Ccp) -> Cow<'_, Ccp> {
    problem.as_matrix_if(|rigid| !rigid.is_plain(), &mut None).map_or(Cow::Borrowed(problem), Cow::Owned)
}

/// V / max_i |r_i| for the projection of `g` on the cones.
///
/// # Errors
/// [`CcpError::Size`] where the length is not that of r.
pub fn needed_velocity(problem: &Ccp, g: &[f64]) -> Result<f64, CcpError> {
    let expected = problem.r.len();
    if g.len() != expected {
        return Err(CcpError::Size { what: "ray", got: g.len(), expected });
    }
    let problem = &measurable(problem);
    Ok(Evaluator::new(problem).needed_velocity(problem, g))
}
