//! Exact Coulomb friction by a sequence of relaxed problems, with any solver of these.
//!
//! Source: G. De Saxce, Z.-Q. Feng, "The bipotential method", Mathematical and Computer Modelling 28:225-245,
//! 1998; V. Acary, F. Cadoux, C. Lemarechal, J. Malick, "A formulation of the linear discrete Coulomb
//! friction problem via convex optimization", ZAMM 91(2):155-175, 2011.

use super::driver::{Best, Limits, check_start};
use super::history::History;
use super::interface::CcpSolver;
use super::report::{SolveReport, Status};
use super::settings::SolveSettings;
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};

/// Outer iterations allowed; the sequence needs 5 to 30 where it converges easily, some hundreds in settled
/// packings.
const OUTER_LIMIT: usize = 1000;
/// A relaxed solve is asked for this fraction of the exact residual: at first, and at the least.
const INNER_FRACTION: [f64; 2] = [0.3, 0.03];
/// Outer iterations without a better residual before the fraction is lowered to a third.
const SLOW: usize = 15;
/// Outer iterations without a better residual before giving up.
const PATIENCE: usize = 100;
/// Least and largest factor of the extrapolation; the largest is 1 as soon as the residual was slow to fall.
const FACTOR_RANGE: [f64; 2] = [0.3, 2.0];

/// Relaxed problems whose normal velocities are shifted by what exact friction adds, s_i = mu_i |(u_t)_i|
/// (with what rolling and spinning add where contacts resist turning, [`FrictionModel::Coulomb`]):
///
/// ```text
/// solve the CCP with r_n + s for g;   s <- mu |u_t(g)|
/// ```
///
/// until the residual of the exact problem is small. With s held each problem is convex; its impulses take
/// energy, and contacts part or close by
/// |s - mu |u_t|| at the most. N and mu stay, and the solver keeps what it prepared for them; every solve starts from the last impulses and is asked
/// for a fraction of the exact residual still there. Where the sequence converges slowly or swings, s is
/// extrapolated from its last two changes (Irons and Tuck 1969, vector Aitken), kept at or above zero. Where
/// the residual does not fall, the fraction is lowered and s no longer extrapolated, only damped: in settled
/// packings the map has slow modes (factors of 0.98) beside modes that swing (-1.1), and errors of the solves
/// hide the first. In dense shear it does not contract at all.
///
/// The best impulses are returned. `settings.max_iterations` bounds the relaxed iterations together.
///
/// # Errors
/// Those of the solver.
pub fn solve(
    relaxed: &mut dyn CcpSolver,
    problem: &Ccp,
    impulse: &mut [f64],
    settings: &SolveSettings,
) -> Result<SolveReport, CcpError> {
    let limits = Limits::start(settings, usize::MAX);
    check_start(problem, impulse)?;
    let contacts = problem.num_contacts();
    let scale = ResidualScale::new(problem);
    // The relaxed solver must measure with the V of this problem, not of the shifted one. Both share N.
    let mut shifted = Ccp { velocity_scale: Some(scale.velocity), ..problem.clone() };
    let (mut work, mut u) = (problem.delassus.work(), vec![0.0; problem.r.len()]);
    let mut shift = Shift::new(contacts);
    let (mut best, mut history) = (Best::default(), History::default());
    let mut progress = Progress { fraction: INNER_FRACTION[0], least: f64::INFINITY, since: 0 };
    let (mut sums, mut newton, mut last_inner) = ([0; 3], Vec::new(), None);
    let mut status = Status::IterationLimit;
    for outer in 0..=OUTER_LIMIT {
        problem.velocity(impulse, &mut u, &mut work);
        let exact = scale.residual(problem, impulse, &u, FrictionModel::Coulomb);
        history.record(sums[0], limits.seconds(), exact);
        let residual = limits.measured(exact);
        best.offer(impulse, residual);
        progress.count(residual, &mut shift);
        if let Some(stop) = limits.status(sums[0], residual) {
            status = stop;
            break;
        }
        if progress.since > PATIENCE {
            // The relaxed solver's own verdict tells more than "stalled" where it has one.
            status = if last_inner == Some(Status::IterationLimit) {
                Status::IterationLimit
            } else {
                Status::Stalled
            };
            break;
        }
        if outer > 0 || impulse.iter().any(|&g| g != 0.0) {
            shift.update((0..contacts).map(|i| problem.de_saxce(&u, i)));
        }
        for i in 0..contacts {
            shifted.r[3 * i] = problem.r[3 * i] + shift.value[i];
        }
        let inner = SolveSettings {
            tolerance: (progress.fraction * residual).min(0.1).max(progress.fraction * settings.tolerance),
            max_iterations: Some(limits.iterations_left(sums[0]).min(relaxed.iteration_limit())),
            max_time: limits.time_left(),
            friction: FrictionModel::Relaxed,
            ..settings.clone()
        };
        let mut report = relaxed.solve(&shifted, impulse, &inner)?;
        if report.status == Status::Infeasible && last_inner != Some(Status::Infeasible) {
            let without = SolveSettings { max_time: limits.time_left(), ..inner };
            let asked = relaxed.solve(&problem.frictionless(), &mut vec![0.0; problem.r.len()], &without)?;
            report = SolveReport { status: report.status, ..report.after(&asked) };
            if asked.status == Status::Infeasible {
                status = Status::Infeasible;
            }
        }
        let of_solve = [report.iterations, report.linear_iterations, report.products];
        sums.iter_mut().zip(of_solve).for_each(|(sum, own)| *sum += own);
        newton.append(&mut report.newton);
        last_inner = Some(report.status);
        if status == Status::Infeasible {
            break;
        }
    }
    best.restore(impulse);
    let report = limits.report(&relaxed.name(), problem, impulse, status, sums[0], sums[1]);
    Ok(SolveReport { products: sums[2], newton, history: history.into_samples(), ..report })
}

/// [`from_below`] raises s, once, to this fraction of mu |u_t|: with all of it most contacts would approach
/// in the next solve.
const FRACTION: f64 = 0.9;
/// Approach of a contact, over V, that is none.
const APPROACH: f64 = 0.1;
/// Relaxed problems at most.
const SOLVES: usize = 8;
/// Their tolerance.
const TOLERANCE: f64 = 1e-3;

/// Impulses that let no bodies approach, where exact friction is out of reach: relaxed problems with the
/// shift held at or below De Saxce's term.
///
/// With s held the normal velocity of the solution is u_n >= sigma - s, sigma = mu |u_t|: a contact parts by
/// sigma - s where s is below sigma, and bodies approach, by s - sigma, where it is above. So s, once raised,
/// only falls,
///
/// ```text
/// s_0 = 0,    s_1 = theta sigma(s_0),    s_(k+1) = min(s_k, theta sigma(s_k)),    theta < 1
/// ```
///
/// until s_i - sigma_i <= `APPROACH` V at every contact. Where the sequence does not get there, its iterate
/// of least approach is taken, and where that lets bodies approach by more than V, s_0, the relaxation of the
/// problem. Where not even that is solved the impulses stay as they are; otherwise they count for nothing,
/// the first solve begins from zero and every other one where the last ended.
///
/// Every problem is convex, and its impulses take energy. The error that is left is in the residual of the
/// report, whose status tells of the exact problem. `settings.max_iterations` bounds the iterations together.
/// Cost: one relaxed solve and up to `SOLVES` - 1 from near their solution. `impulse`: three entries per
/// contact, N s; s, sigma, V: m/s. Source: the relaxed problems are those of Acary et al. 2011; to bound s
/// from above is ours.
///
/// # Errors
/// Those of the solver.
pub fn from_below(
    relaxed: &mut dyn CcpSolver,
    problem: &Ccp,
    impulse: &mut [f64],
    settings: &SolveSettings,
) -> Result<SolveReport, CcpError> {
    let limits = Limits::start(settings, usize::MAX);
    let contacts = problem.num_contacts();
    let scale = ResidualScale::new(problem);
    // What the start of each solve costs counts; that of the first the caller has taken off.
    let cost = relaxed.cost(problem);
    let of_start = (cost.start / cost.iteration) as usize;
    let mut shifted = Ccp { velocity_scale: Some(scale.velocity), ..problem.clone() };
    let (mut work, mut u) = (problem.delassus.work(), vec![0.0; problem.r.len()]);
    let (mut g, mut shift, mut least) = (vec![0.0; problem.r.len()], vec![0.0; contacts], scale.velocity);
    let (mut sums, mut newton) = ([0; 3], Vec::new());
    for solve in 0..SOLVES {
        let inner = SolveSettings {
            tolerance: TOLERANCE,
            max_iterations: Some(
                limits.iterations_left(sums[0] + solve * of_start).min(relaxed.iteration_limit()),
            ),
            max_time: limits.time_left(),
            friction: FrictionModel::Relaxed,
            ..settings.clone()
        };
        let mut report = relaxed.solve(&shifted, &mut g, &inner)?;
        let of_solve = [report.iterations, report.linear_iterations, report.products];
        sums.iter_mut().zip(of_solve).for_each(|(sum, own)| *sum += own);
        newton.append(&mut report.newton);
        if !report.converged() {
            break;
        }
        problem.velocity(&g, &mut u, &mut work);
        let mut approach = 0.0_f64;
        for (i, shift) in shift.iter_mut().enumerate() {
            let sigma = problem.de_saxce(&u, i);
            approach = approach.max(*shift - sigma);
            let image = FRACTION * sigma;
            *shift = if solve == 0 { image } else { shift.min(image) };
            shifted.r[3 * i] = problem.r[3 * i] + *shift;
        }
        if solve == 0 || approach < least {
            impulse.copy_from_slice(&g);
        }
        if solve > 0 {
            least = approach.min(least);
            if approach <= APPROACH * scale.velocity {
                break;
            }
        }
    }
    let status = limits.status(sums[0], f64::MAX).unwrap_or(Status::IterationLimit);
    let report = limits.report(&relaxed.name(), problem, impulse, status, sums[0], sums[1]);
    let mut history = History::default();
    history.record(sums[0], limits.seconds(), report.residual);
    Ok(SolveReport { products: sums[2], newton, history: history.into_samples(), ..report })
}

/// How the residual falls, and what is asked of the next solve.
struct Progress {
    fraction: f64,
    least: f64,
    /// Outer iterations since the least residual fell by a tenth.
    since: usize,
}

impl Progress {
    fn count(&mut self, residual: f64, shift: &mut Shift) {
        self.since += 1;
        if residual < 0.9 * self.least {
            self.since = 0;
        }
        self.least = residual.min(self.least);
        if self.since > 0 && self.since.is_multiple_of(SLOW) {
            self.fraction = (self.fraction / 3.0).max(INNER_FRACTION[1]);
            shift.factor_range[1] = 1.0;
        }
    }
}

/// The shift s of r_n and its fixed-point acceleration.
struct Shift {
    value: Vec<f64>,
    /// The last two changes that were asked for, the newer one first.
    changes: [Vec<f64>; 2],
    updates: usize,
    factor: f64,
    factor_range: [f64; 2],
}

impl Shift {
    fn new(contacts: usize) -> Self {
        let zeros = || vec![0.0; contacts];
        let changes = [zeros(), zeros()];
        Self { value: zeros(), changes, updates: 0, factor: 1.0, factor_range: FACTOR_RANGE }
    }

    /// s <- max(0, s + factor (image - s)), the factor after Aitken from the last two changes, within its
    /// bounds.
    fn update(&mut self, image: impl Iterator<Item = f64>) {
        self.changes.swap(0, 1);
        let [change, last] = &mut self.changes;
        for ((change, value), image) in change.iter_mut().zip(&self.value).zip(image) {
            *change = image - value;
        }
        if self.updates > 0 {
            let (mut across, mut square) = (0.0, 0.0);
            for (new, old) in change.iter().zip(&*last) {
                across += old * (new - old);
                square += (new - old) * (new - old);
            }
            if square > 0.0 {
                self.factor =
                    (-self.factor * across / square).clamp(self.factor_range[0], self.factor_range[1]);
            }
        }
        for (value, change) in self.value.iter_mut().zip(&*change) {
            *value = (*value + self.factor * change).max(0.0);
        }
        self.updates += 1;
    }
}
