//! The one accuracy measure: the natural map of the complementarity problem, dimensionless.

use crate::cone::tangential_length;
use crate::problem::Ccp;
use graintrain_linalg::parallel::{fold_chunks, sum_chunks};
use graintrain_linalg::real;

/// Which problem an impulse is held against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrictionModel {
    /// The convex relaxation of Anitescu and Tasora: the CCP itself.
    #[default]
    Relaxed,
    /// Exact Coulomb friction after De Saxce: u_n + mu |u_t| in place of u_n, and as much more for rolling
    /// and spinning.
    Coulomb,
}

impl FrictionModel {
    /// Both with their names in files and on the command line.
    pub const NAMES: &[(&str, Self)] = &[("relaxed", Self::Relaxed), ("coulomb", Self::Coulomb)];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Relaxed => "relaxed",
            Self::Coulomb => "coulomb",
        }
    }
}

impl std::fmt::Display for FrictionModel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// Distance of an impulse from solving the problem, dimensionless.
///
/// With u = N g + r (u_n + mu |u_t| in place of u_n in Coulomb mode), eta_i = trace(N_ii) / 3 (1/kg, the
/// inverse of the contact's effective mass) and a velocity V (m/s, see [`ResidualScale`]):
///
/// ```text
/// d_i = g_i - P_i(g_i - u_i / eta_i)                        natural map, N s
/// e_i = eta_i |d_i|                                         error of the contact as a velocity, m/s
/// max = max_i e_i / V,   rms = sqrt(mean_i e_i^2) / V
/// ```
///
/// A contact that resists turning has six components: with w its turning velocities and h its moments, each
/// over or times the length of its rows, d_i and P_i are those of (g_i, h_i) and
/// [`TurningCone`](crate::cone::TurningCone), with the same eta_i; in Coulomb mode u_n + mu |u_t| +
/// rolling |(w_1, w_2)| + spinning |w_n| (Acary, Bourrier 2021).
///
/// Each contact is measured by its own effective mass, so that neither a heavy body elsewhere nor a change of
/// the unit of mass changes what is asked of it. Source of the natural map: Facchinei, Pang,
/// "Finite-Dimensional Variational Inequalities and Complementarity Problems", 2003, section 1.5; the factor
/// eta_i is the preconditioner of projected Jacobi (Tasora, Anitescu 2011).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Residual {
    /// max_i e_i / V.
    pub max: f64,
    /// sqrt(mean_i e_i^2) / V.
    pub rms: f64,
}

/// Which number of a residual is held against the tolerance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Criterion {
    /// The worst contact: max <= tolerance. What solvers are compared by.
    #[default]
    Maximum,
    /// All contacts together, none of them far off: rms <= tolerance and max <= [`MIXED_MAXIMUM`] tolerance.
    /// What runs are measured by: the root mean square predicts the energy that errors put into a packing,
    /// while the maximum belongs to a few ordinary contacts and costs iterations in proportion to the size of
    /// the packing.
    Mixed,
}

/// Under [`Criterion::Mixed`] the worst contact may be off by so many tolerances.
pub const MIXED_MAXIMUM: f64 = 20.0;

impl Criterion {
    /// What the worst contact may be off by at this tolerance.
    pub fn maximum(self, tolerance: f64) -> f64 {
        match self {
            Self::Maximum => tolerance,
            Self::Mixed => MIXED_MAXIMUM * tolerance,
        }
    }
}

impl Residual {
    /// The larger of each number; NaN where one is.
    pub fn worse(self, other: Self) -> Self {
        Self { max: larger(self.max, other.max), rms: larger(self.rms, other.rms) }
    }

    /// The number that is held against the tolerance: max, or max(rms, max / [`MIXED_MAXIMUM`]); NaN where
    /// either is.
    pub fn measured(&self, criterion: Criterion) -> f64 {
        match criterion {
            Criterion::Maximum => self.max,
            // f64::max would lose a NaN.
            Criterion::Mixed if self.max.is_nan() => self.max,
            Criterion::Mixed if self.rms >= self.max / MIXED_MAXIMUM || self.rms.is_nan() => self.rms,
            Criterion::Mixed => self.max / MIXED_MAXIMUM,
        }
    }
}

/// What residuals need besides g and u, computed once per problem.
#[derive(Clone, Debug)]
pub struct ResidualScale {
    /// eta_i = trace(N_ii) / 3, 1/kg.
    pub eta: Vec<f64>,
    /// V, m/s.
    pub velocity: f64,
}

/// `scale`, or 1 where it tells nothing: such a problem is solved by g = 0, or by nothing.
fn or_one(scale: f64) -> f64 {
    if scale > 0.0 && scale.is_finite() { scale } else { 1.0 }
}

/// sqrt(mean_i |x_i|^2) over contacts of a vector of three components each.
fn mean_length(x: &[f64]) -> f64 {
    let contacts = x.len() / 3;
    // In units of the largest, so that no square overflows.
    let unit = or_one(x.iter().fold(0.0, |largest, x| f64::max(largest, x.abs())));
    let sum = sum_chunks(contacts, |range| {
        x[3 * range.start..3 * range.end].iter().map(|x| (x / unit).powi(2)).sum()
    });
    unit * (sum / contacts.max(1) as f64).sqrt()
}

/// V of a problem, m/s: `problem.velocity_scale`, or sqrt(mean_i |r_i|^2) for a bare problem; 1 where that is
/// zero or not finite.
pub fn velocity_scale(problem: &Ccp) -> f64 {
    or_one(problem.velocity_scale.unwrap_or_else(|| mean_length(&problem.r[..3 * problem.num_contacts()])))
}

impl ResidualScale {
    /// eta and V of a problem. V is `problem.velocity_scale`, or sqrt(mean_i |r_i|^2) for a bare problem; 1
    /// where that is zero or not finite.
    pub fn new(problem: &Ccp) -> Self {
        Self { eta: problem.diagonal_scale(), velocity: velocity_scale(problem) }
    }

    /// V sqrt(mean_i 1 / eta_i), sqrt(J): the size of sqrt(eta_i) g_i and of u_i / sqrt(eta_i), in which all
    /// contacts are alike.
    pub fn size(&self) -> f64 {
        let mean = self.eta.iter().map(|eta| 1.0 / eta).sum::<f64>() / self.eta.len().max(1) as f64;
        self.velocity * or_one(mean).sqrt()
    }

    /// d_i of a contact i that resists turning (entry k), N s: of its impulse and of its moment over the
    /// length.
    fn turning_map(
        &self,
        problem: &Ccp,
        g: &[f64],
        u: &[f64],
        model: FrictionModel,
        (i, k): (usize, usize),
    ) -> [[f64; 3]; 2] {
        let cone = problem.turning_cone(i, k);
        let places = [3 * i, 3 * (problem.num_contacts() + k)];
        let of = |all: &[f64], first: usize| [all[first], all[first + 1], all[first + 2]];
        let [mut velocity, spin] = places.map(|first| of(u, first));
        if model == FrictionModel::Coulomb {
            velocity[0] += cone.mu * real::hypot(velocity[1], velocity[2])
                + cone.rolling * real::hypot(spin[1], spin[2])
                + cone.spinning * spin[0].abs();
        }
        let step = 1.0 / self.eta[i];
        let [g, h] = places.map(|first| of(g, first));
        let moved = |g: [f64; 3], u: [f64; 3]| std::array::from_fn(|k| g[k] - step * u[k]);
        let [pg, ph] = cone.project(moved(g, velocity), moved(h, spin));
        [std::array::from_fn(|k| g[k] - pg[k]), std::array::from_fn(|k| h[k] - ph[k])]
    }

    /// d_i of contact i, N s, for impulses g whose relative velocities are u = N g + r.
    fn natural_map(&self, problem: &Ccp, g: &[f64], u: &[f64], model: FrictionModel, i: usize) -> [f64; 3] {
        let mut velocity = [u[3 * i], u[3 * i + 1], u[3 * i + 2]];
        if model == FrictionModel::Coulomb {
            velocity[0] += problem.friction[i] * tangential_length(velocity);
        }
        let step = 1.0 / self.eta[i];
        let image = problem.cone(i).project(std::array::from_fn(|k| g[3 * i + k] - step * velocity[k]));
        std::array::from_fn(|k| g[3 * i + k] - image[k])
    }

    /// Sum and maximum over the contacts of (eta_i |d_i| / V)^2, of each friction model asked for.
    fn squares<const M: usize>(
        &self,
        problem: &Ccp,
        g: &[f64],
        u: &[f64],
        models: [FrictionModel; M],
    ) -> [Squares; M] {
        let of_contact = |i: usize, model: FrictionModel| {
            // In units of V / eta_i, so that no square overflows.
            let measured = |impulse: f64| self.eta[i] * impulse / self.velocity;
            let square_of = |d: [f64; 3]| d.iter().map(|&d| measured(d).powi(2)).sum::<f64>();
            // Below the rounding of its impulse nothing is known: where impulses grow without limit (bodies
            // that cannot be kept apart) g - u / eta is g in the end, whatever u is.
            let rounding_of = |block: usize| {
                (0..3).map(|k| (f64::EPSILON * measured(g[3 * block + k])).powi(2)).sum::<f64>()
            };
            let (defect, rounding);
            if let Some(k) = problem.turning_of(i) {
                let [d, turning] = self.turning_map(problem, g, u, model, (i, k));
                defect = square_of(d) + square_of(turning);
                rounding = rounding_of(i) + rounding_of(problem.num_contacts() + k);
            } else {
                let d = self.natural_map(problem, g, u, model, i);
                (defect, rounding) = (square_of(d), rounding_of(i));
            }
            let square = if defect < rounding { rounding } else { defect };
            Squares { sum: square, max: square }
        };
        let none = [Squares::default(); M];
        let of_chunk = |range: std::ops::Range<usize>| {
            range.fold(none, |all, i| std::array::from_fn(|m| all[m].and(of_contact(i, models[m]))))
        };
        fold_chunks(problem.num_contacts(), none, of_chunk, |all, chunk| {
            std::array::from_fn(|m| all[m].and(chunk[m]))
        })
    }

    /// eta_i |d_i| / V of contact i alone, whose resistance to turning does not count.
    pub fn of_contact(&self, problem: &Ccp, g: &[f64], u: &[f64], model: FrictionModel, i: usize) -> f64 {
        let d = self.natural_map(problem, g, u, model, i);
        self.eta[i] / self.velocity * d.iter().map(|d| d * d).sum::<f64>().sqrt()
    }

    /// Residual of impulses g whose relative velocities are u = N g + r.
    pub fn residual(&self, problem: &Ccp, g: &[f64], u: &[f64], model: FrictionModel) -> Residual {
        let [squares] = self.squares(problem, g, u, [model]);
        squares.residual(problem.num_contacts())
    }

    /// All that is reported of impulses g whose relative velocities are u = N g + r.
    pub fn evaluate(&self, problem: &Ccp, g: &[f64], u: &[f64]) -> Evaluation {
        let contacts = problem.num_contacts();
        let models = [FrictionModel::Relaxed, FrictionModel::Coulomb];
        let [relaxed, coulomb] = self.squares(problem, g, u, models);
        Evaluation { relaxed: relaxed.residual(contacts), coulomb: coulomb.residual(contacts) }
    }
}

/// Residuals of impulses in both friction models, each evaluated afresh with the problem's own N.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evaluation {
    /// As a relaxed CCP.
    pub relaxed: Residual,
    /// As exact Coulomb friction.
    pub coulomb: Residual,
}

impl Evaluation {
    /// The residual in this friction model.
    pub fn residual(&self, model: FrictionModel) -> Residual {
        match model {
            FrictionModel::Relaxed => self.relaxed,
            FrictionModel::Coulomb => self.coulomb,
        }
    }
}

/// What contacts add up to on the way to a residual.
#[derive(Clone, Copy, Debug, Default)]
struct Squares {
    sum: f64,
    max: f64,
}

impl Squares {
    fn and(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, max: larger(self.max, other.max) }
    }

    fn residual(self, contacts: usize) -> Residual {
        if contacts == 0 {
            return Residual::default();
        }
        Residual { max: self.max.sqrt(), rms: (self.sum / contacts as f64).sqrt() }
    }
}

/// The larger number, or NaN where one is: `f64::max` would lose it.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// How far the objective of impulses g, with velocities u = N g + r, may lie above the optimum of the relaxed
/// problem, relative to itself: sum_i (|g_i . u_i| + |g_i| dist(u_i, Y_i^*)) / |1/2 g^T N g + r^T g|.
///
/// By convexity f(g) - f(g*) <= u . (g - g*), and u_i . g*_i >= -dist(u_i, Y_i^*) |g*_i|: a bound where no
/// impulse of the solution is larger than that of g, else an estimate that may be too small (by a factor of
/// 25 in the worst random problem met). A residual is relative to a velocity V that says nothing about
/// impulses: in a nearly jammed heap, whose impulses are thousands of V / eta_i at velocities of next to
/// nothing, the objective may be off by per cents at a residual of 1e-5.
pub fn objective_gap(problem: &Ccp, g: &[f64], u: &[f64]) -> f64 {
    let norm = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let sum: f64 = (0..problem.num_contacts())
        .map(|i| {
            let of = |all: &[f64], block: usize| [all[3 * block], all[3 * block + 1], all[3 * block + 2]];
            let (gi, ui) = (of(g, i), of(u, i));
            if let Some(k) = problem.turning_of(i) {
                let block = problem.num_contacts() + k;
                let (hi, wi) = (of(g, block), of(u, block));
                let outside = problem.turning_cone(i, k).project(ui.map(|x| -x), wi.map(|x| -x));
                let power = (0..3).map(|k| gi[k] * ui[k] + hi[k] * wi[k]).sum::<f64>();
                let both = |[a, b]: [[f64; 3]; 2]| real::hypot(norm(a), norm(b));
                return power.abs() + both([gi, hi]) * both(outside);
            }
            // Moreau: what lies outside the dual cone is the projection of -u on the cone itself.
            let outside = problem.cone(i).project(ui.map(|x| -x));
            (gi[0] * ui[0] + gi[1] * ui[1] + gi[2] * ui[2]).abs() + norm(gi) * norm(outside)
        })
        .sum();
    if sum > 0.0 { sum / problem.objective(g, u).abs() } else { 0.0 }
}
