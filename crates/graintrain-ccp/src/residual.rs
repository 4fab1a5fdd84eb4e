//! The one accuracy measure: the natural map of the complementarity problem, dimensionless.

use crate::problem::Ccp;
use graintrain_linalg::parallel::sum_chunks;

/// Which problem an impulse is held against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FrictionModel {
    /// The convex relaxation of Anitescu and Tasora: the CCP itself.
    #[default]
    Relaxed,
    /// Exact Coulomb friction after De Saxce: u_n + mu |u_t| in place of u_n.
    Coulomb,
}

/// Distance of an impulse from solving the problem.
///
/// With u = N g + r (u_n + mu |u_t| in place of u_n in Coulomb mode) and eta_i = trace(N_ii) / 3,
/// `d_i = g_i - P_i(g_i - u_i / eta_i)`; the residual is max_i |d_i| / J and its root mean square over contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Residual {
    /// max_i |d_i|_2 / J.
    pub max: f64,
    /// sqrt(mean_i |d_i|_2^2) / J.
    pub rms: f64,
}

/// What residuals need besides g and u, computed once per problem.
#[derive(Clone, Debug)]
pub struct ResidualScale {
    /// eta_i = trace(N_ii) / 3, 1/kg.
    pub eta: Vec<f64>,
    /// J, N s.
    pub impulse: f64,
}

impl ResidualScale {
    /// eta and J of a problem. J is `problem.impulse_scale`, or sqrt(mean_i (|r_i| / eta_i)^2) for a bare problem
    /// (1 where that is zero: such a problem is solved by g = 0).
    pub fn new(problem: &Ccp) -> Self {
        let eta = problem.diagonal_scale();
        let impulse = problem.impulse_scale.unwrap_or_else(|| {
            let contacts = problem.num_contacts();
            // In units of the largest, so that no square overflows.
            let largest = (0..3 * contacts).map(|k| problem.r[k].abs() / eta[k / 3]).fold(0.0, f64::max);
            let unit = if largest > 0.0 { largest } else { 1.0 };
            let square = |k: usize| (problem.r[k] / eta[k / 3] / unit).powi(2);
            let sum = sum_chunks(contacts, |range| (3 * range.start..3 * range.end).map(square).sum());
            unit * (sum / contacts.max(1) as f64).sqrt()
        });
        Self { eta, impulse: if impulse > 0.0 { impulse } else { 1.0 } }
    }

    /// Residual of impulses g whose relative velocities are u = N g + r.
    pub fn residual(&self, problem: &Ccp, g: &[f64], u: &[f64], model: FrictionModel) -> Residual {
        let contacts = problem.num_contacts();
        if contacts == 0 {
            return Residual::default();
        }
        let square = |i: usize| {
            let mut velocity = [u[3 * i], u[3 * i + 1], u[3 * i + 2]];
            if model == FrictionModel::Coulomb {
                velocity[0] += problem.friction[i] * velocity[1].hypot(velocity[2]);
            }
            let impulse = [g[3 * i], g[3 * i + 1], g[3 * i + 2]];
            let step = 1.0 / self.eta[i];
            let image = problem.cone(i).project(std::array::from_fn(|k| impulse[k] - step * velocity[k]));
            // In units of J, so that no square overflows.
            let defect = (0..3).map(|k| ((impulse[k] - image[k]) / self.impulse).powi(2)).sum::<f64>();
            // Below the rounding of its impulse nothing is known: where impulses grow without limit (bodies that
            // cannot be kept apart) g - u / eta is g in the end, whatever u is.
            let rounding = impulse.iter().map(|x| (f64::EPSILON * x / self.impulse).powi(2)).sum::<f64>();
            if defect < rounding { rounding } else { defect }
        };
        let sum = sum_chunks(contacts, |range| range.map(square).sum());
        // A NaN must not hide in a maximum.
        let largest =
            (0..contacts).map(square).fold(0.0, |m: f64, s| if s.is_nan() || s > m { s } else { m });
        Residual { max: largest.sqrt(), rms: (sum / contacts as f64).sqrt() }
    }
}

/// How far the objective of impulses g, with velocities u = N g + r, may lie above the optimum of the relaxed problem, relative to
/// itself: sum_i (|g_i . u_i| + |g_i| dist(u_i, Y_i^*)) / |1/2 g^T N g + r^T g|.
///
/// By convexity f(g) - f(g*) <= u . (g - g*), and u_i . g*_i >= -dist(u_i, Y_i^*) |g*_i|: a bound where no impulse of the solution is
/// larger than that of g, else an estimate that may be too small (by a factor of 25 in the worst random problem met). A residual is relative to an impulse J that says nothing about this one: in a nearly
/// jammed heap, whose impulses are thousands of J at velocities of next to nothing, the objective may be off by per cents at a
/// residual of 1e-8.
pub fn objective_gap(problem: &Ccp, g: &[f64], u: &[f64]) -> f64 {
    let norm = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let sum: f64 = (0..problem.num_contacts())
        .map(|i| {
            let (gi, ui) = ([g[3 * i], g[3 * i + 1], g[3 * i + 2]], [u[3 * i], u[3 * i + 1], u[3 * i + 2]]);
            // Moreau: what lies outside the dual cone is the projection of -u on the cone itself.
            let outside = problem.cone(i).project(ui.map(|x| -x));
            (gi[0] * ui[0] + gi[1] * ui[1] + gi[2] * ui[2]).abs() + norm(gi) * norm(outside)
        })
        .sum();
    if sum > 0.0 { sum / problem.objective(g, u).abs() } else { 0.0 }
}
