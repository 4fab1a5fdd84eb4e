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
