//! What the relaxation of friction does to a step: the gaps that it opens, and how far the answer is from that of exact friction.
//!
//! The relaxed law asks for `u_n >= mu |u_t|` where Coulomb's asks for `u_n >= 0` (u: relative velocity at a contact with force, gap / dt
//! included): sliding contacts part at mu times their slip.
//!
//! Source: M. Anitescu, "Optimization-based simulation of nonsmooth rigid multibody dynamics", Mathematical Programming 105:113-143, 2006;
//! H. Mazhar, D. Melanz, M. Ferris, D. Negrut, "An analysis of several methods for handling hard-sphere frictional contact in rigid
//! multibody dynamics", University of Wisconsin-Madison, TR-2014-11, 2014.

use graintrain_ccp::residual::velocity_scale;
use graintrain_ccp::{Ccp, CcpError, Delassus, FrictionModel, SolveSettings, SolverSpec, Status};
use graintrain_linalg::parallel::fold_chunks;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Contacts are counted as opened where the relaxation parts them by more than this fraction of the smaller body's size in a step.
pub const OPENED: f64 = 1e-3;

/// What the relaxed law opened in a step: nothing where friction is exact or absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Opening {
    /// Largest `dt mu |u_t|` (and the same of rolling and spinning) of a contact with force, over the size of the smaller body.
    pub largest_over_size: f64,
    /// Contacts with force that part by more than [`OPENED`] of the size in the step.
    pub opened: usize,
}

impl Opening {
    /// That of impulses of a relaxed problem, with the sizes of the smaller bodies of its contacts (m) and the velocities u at them after
    /// the step (length of r); contacts with a normal impulse above `threshold` (N s) count, but for `wedged` ones, whose friction is exact.
    pub(crate) fn of(
        size: &[f64],
        (problem, impulse, threshold): (&Ccp, &[f64], f64),
        u: &[f64],
        (step, wedged): (f64, &[usize]),
    ) -> Self {
        let of_chunk = |range: Range<usize>| {
            let mut opening = Self::default();
            for k in range {
                if impulse[3 * k] > threshold && !wedged.contains(&k) {
                    let parted = step * problem.de_saxce(u, k) / size[k];
                    opening.largest_over_size = opening.largest_over_size.max(parted);
                    opening.opened += usize::from(parted > OPENED);
                }
            }
            opening
        };
        fold_chunks(size.len(), Self::default(), of_chunk, |all, chunk| Self {
            largest_over_size: all.largest_over_size.max(chunk.largest_over_size),
            opened: all.opened + chunk.opened,
        })
    }
}

/// How far the relaxed answer of a step is from the exact one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// Root mean square over the bodies with mass of the difference of their velocities after the step, m/s.
    pub velocity_rms: f64,
    /// The same relative to the root mean square of their velocities, or to |g| dt where that is more.
    pub velocity_relative: f64,
    /// Whether the exact answer reached the tolerance within the iterations that it was given.
    pub is_decided: bool,
}

/// The problem with exact friction in the state that it would have led to: steps of the relaxed law keep sliding contacts open by
/// `dt mu |u_t|`, and the exact law would spend the step on closing them. `gap` (m) are those of the contacts at the start of the step:
///
/// ```text
/// r_n <- r_n - min( max(gap, 0) / dt, s ),     s = mu |u_t| + ... of u = N g + r with the relaxed impulses g
/// ```
fn without_standing_gaps(problem: &Ccp, relaxed: &[f64], gap: &[f64], step: f64) -> Ccp {
    let mut u = vec![0.0; relaxed.len()];
    problem.velocity(relaxed, &mut u, &mut problem.delassus.work());
    let mut r = problem.r.clone();
    for (k, gap) in gap.iter().enumerate() {
        let opening = problem.de_saxce(&u, k);
        if relaxed[3 * k] > 0.0 {
            r[3 * k] -= opening.min(gap.max(0.0) / step);
        }
    }
    Ccp { r, velocity_scale: Some(velocity_scale(problem)), ..problem.clone() }
}

/// Solves the step's problem with exact friction from the relaxed impulses (length of r, contact frames), and compares the velocities of
/// the bodies, of which the relaxed ones have this root mean square (m/s). The gaps that earlier relaxed steps left are taken out first.
/// `None` where the solve was stopped.
///
/// # Errors
/// As the solver's.
pub(crate) fn difference(
    problem: &Ccp,
    relaxed: &[f64],
    gap: &[f64],
    (step, speed): (f64, f64),
    settings: SolveSettings,
) -> Result<Option<Difference>, CcpError> {
    let Delassus::Rigid(rigid) = &*problem.delassus else { return Ok(None) };
    let posed = without_standing_gaps(problem, relaxed, gap, step);
    let settings = SolveSettings { friction: FrictionModel::Coulomb, ..settings };
    let mut exact = relaxed.to_vec();
    // What is asked for is one method with a limit: `auto` would go on with slower ones.
    let found = "apgd".parse::<SolverSpec>()?.build()?.solve(&posed, &mut exact, &settings)?;
    if found.status == Status::Stopped {
        return Ok(None);
    }
    let change: Vec<f64> = relaxed.iter().zip(&exact).map(|(relaxed, exact)| relaxed - exact).collect();
    let mut work = problem.delassus.work();
    problem.delassus.multiply(&change, &mut vec![0.0; change.len()], &mut work);
    let dv = work.body_velocity();
    let movable = rigid.inverse_mass().iter().filter(|mass| mass.linear != [0.0; 3]).count();
    let sum: f64 = dv.chunks_exact(6).flat_map(|dv| &dv[..3]).map(|dv| dv * dv).sum();
    let velocity_rms = (sum / movable.max(1) as f64).sqrt();
    let scale = speed.max(velocity_scale(problem));
    let velocity_relative = if scale > 0.0 { velocity_rms / scale } else { 0.0 };
    Ok(Some(Difference { velocity_rms, velocity_relative, is_decided: found.status == Status::Converged }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain_ccp::{BodyInverseMass, FIXED, RigidContact, RigidDelassus};

    const MASS: f64 = 2.0;
    const MU: f64 = 0.5;
    /// |g| dt, m/s.
    const FALL: f64 = 0.1;
    const STEP: f64 = 0.01;

    /// A block (no rotation) on a fixed floor that slides, at this gap.
    fn block(slip: f64, gap: f64) -> Ccp {
        let body = BodyInverseMass { linear: [1.0 / MASS; 3], angular: [0.0; 9] };
        let contact = RigidContact {
            body_a: FIXED,
            body_b: 0,
            frame: [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            arm_a: [0.0; 3],
            arm_b: [0.0; 3],
        };
        let delassus = Delassus::Rigid(RigidDelassus::new(vec![contact], vec![body]));
        let r = vec![gap / STEP - FALL, slip, 0.0];
        Ccp { velocity_scale: Some(FALL), ..Ccp::new(delassus, r, vec![MU]).unwrap() }
    }

    /// The relaxed answer by hand: g_t = -mu g_n, u_n = mu u_t.
    fn relaxed(slip: f64, gap: f64) -> [f64; 3] {
        let normal = MASS * (FALL - gap / STEP + MU * slip) / (1.0 + MU * MU);
        [normal, -MU * normal, 0.0]
    }

    fn compared(slip: f64, gap: f64) -> Difference {
        let settings = SolveSettings { tolerance: 1e-9, ..SolveSettings::default() };
        let (problem, g) = (block(slip, gap), relaxed(slip, gap));
        difference(&problem, &g, &[gap], (STEP, slip), settings).unwrap().unwrap()
    }

    /// A slip that begins: the relaxed block hops, the exact one has g_n = m fall.
    #[test]
    fn a_sudden_slip_differs_by_the_hop() {
        let found = compared(1.0, 0.0);
        let change = (1.0 + MU * MU).sqrt() * (relaxed(1.0, 0.0)[0] / MASS - FALL);
        assert!(found.is_decided);
        assert!((found.velocity_rms - change).abs() < 1e-8, "{found:?} {change}");
        assert!((found.velocity_relative - change).abs() < 1e-8, "{found:?}");
    }

    /// A slip that lasts, at the gap of dt mu |u_t| that the relaxed law keeps: both laws carry the weight.
    #[test]
    fn a_steady_slip_shows_none() {
        let slip_after = 1.0 - MU * FALL;
        let found = compared(1.0, STEP * MU * slip_after);
        assert!(found.is_decided && found.velocity_rms < 1e-8, "{found:?}");
    }

    #[test]
    fn a_block_at_rest_shows_none() {
        let settings = SolveSettings { tolerance: 1e-9, ..SolveSettings::default() };
        let at_rest = [MASS * FALL, 0.0, 0.0];
        let found = difference(&block(0.0, 0.0), &at_rest, &[0.0], (STEP, 0.0), settings).unwrap().unwrap();
        assert!(found.is_decided && found.velocity_relative < 1e-9, "{found:?}");
    }
}
