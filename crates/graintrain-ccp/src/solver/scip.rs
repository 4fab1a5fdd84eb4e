//! `scip`: the symmetric cone interior point.
//!
//! Source: J. Kleinert, B. Simeon, M. Obermayr, "An inexact interior point method for the large-scale simulation of
//! granular material", Computer Methods in Applied Mechanics and Engineering 278:567-598, 2014. The Jordan algebra behind
//! it: S. Schmieta, F. Alizadeh, "Extension of primal-dual interior point algorithms to symmetric cones", Mathematical
//! Programming 96:409-438, 2003; the wide neighbourhood for infeasible iterates: B. Rangarajan, "Polynomial convergence of
//! infeasible-interior-point methods over symmetric cones", SIAM Journal on Optimization 16:1211-1229, 2006.
//!
//! With g = T x and y = N g + r = T^-1 s the friction cones become second-order cones, the cones of squares of the Jordan
//! product x o s = (x^T s, x_0 s_t + s_0 x_t). The central path x o s = tau e is followed with **one** Newton step per
//! iteration, aimed at sigma tau:
//!
//! ```text
//! r_d = N g + r - y,                                      W s = W^-1 x = lambda   (Nesterov and Todd's scaling)
//! lambda o (W^-1 dx + W ds) = sigma tau e - lambda o lambda,       N dg - dy = -r_d
//! (N + T^-1 W^-2 T^-1) dg = -r_d + T^-1 W^-1 (sigma tau lambda^-1 - lambda)
//! ```
//!
//! Steps end in the wide neighbourhood of the path, where every eigenvalue of P(x^(1/2)) s (P the quadratic representation) is
//! at least gamma tau; for a second-order cone these are x^T s -+ sqrt((x^T s)^2 - det x det s). The linear systems are solved
//! *inexactly*, to a fraction of the residual of the problem: what is left of them only adds to r_d. What sets the method apart
//! from [`ipm`](super::ipm): one right-hand side per matrix, no predictor, no second-order corrector, no polishing.

use super::driver::{Best, Limits, check_start};
use super::ipm::cone::product;
use super::ipm::pair::{Pair, PairScaling, componentwise, cone_map, divide_by};
use super::ipm::path::UNBOUNDED;
use super::ipm::scaled::Scaled;
use super::{CcpSolver, SolveReport, SolveSettings, Status};
use crate::newton::driver::{NewtonDriver, ScaledBlocks};
use crate::newton::linear_solver;
use crate::problem::{Ccp, CcpError};
use crate::residual::{FrictionModel, ResidualScale};
use graintrain_linalg::block_ops::apply3;
use graintrain_linalg::block3::Block;
use graintrain_linalg::parallel::dot;

/// Iterations allowed where the settings name no limit.
const ITERATIONS: usize = 200;
/// gamma of the neighbourhood.
const NEIGHBOURHOOD: f64 = 1e-2;
/// Part of the way to the boundary that a step may go at most.
const FRACTION: f64 = 0.99;
/// Bounds of sigma: the shorter the last step, the more the next one goes back to the central path.
const CENTRING: [f64; 2] = [0.05, 0.9];
/// Iterations without a better residual before giving up.
const PATIENCE: usize = 20;
/// Steps shorter than this lead nowhere.
const SHORTEST: f64 = 1e-8;
/// Proximal term of Newton's matrix relative to eta, and noise level of r_d: as in `ipm`.
const PROXIMAL: f64 = 1e-9;
const NOISE: f64 = 32.0 * f64::EPSILON;
/// Barrier of a start from zero, and bounds of that of a warm start, in the scaled problem.
const COLD_BARRIER: f64 = 1e4;
const WARM_BARRIER: [f64; 2] = [1e-4, 1.0];

/// The symmetric cone interior point, see the [module](self).
///
/// Jammed bodies (no bounded solution) are reported as [`Status::Infeasible`], with the iterate of least residual.
pub struct Scip {
    newton: NewtonDriver,
}

impl Scip {
    /// With the linear solver of this name (see [`crate::newton`]).
    ///
    /// # Errors
    /// [`CcpError::UnknownSolver`].
    pub fn new(linear: &str) -> Result<Self, CcpError> {
        Ok(Self { newton: NewtonDriver::new(linear_solver("scip", linear)?) })
    }
}

/// Makes the solver by name and linear solver.
pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError> {
    Ok(Box::new(Scip::new(linear.unwrap_or("cholesky"))?))
}

/// The smaller eigenvalue of P(x^(1/2)) s; both are tau on the central path.
fn least_eigenvalue(pair: &Pair) -> f64 {
    match pair {
        Pair::Cone { x, s } => {
            let (half_sum, product) = (x.dot(s), x.determinant() * s.determinant());
            product / (half_sum + (half_sum * half_sum - product).max(0.0).sqrt())
        }
        Pair::Line { x, s } => x * s,
    }
}

/// sigma tau e - lambda o lambda, divided by lambda.
fn towards(scaling: &PairScaling, target: f64) -> [f64; 3] {
    let lambda = scaling.lambda();
    let square = product(lambda, lambda);
    scaling.divide([target - square[0], -square[1], -square[2]])
}

/// The primal-dual iterate in cone coordinates and Newton's step, allocated once per solve.
struct Iterate {
    pairs: Vec<Pair>,
    /// The pairs after a trial step.
    trial: Vec<Pair>,
    scalings: Vec<PairScaling>,
    /// Diagonals of T.
    t: Vec<[f64; 3]>,
    added: Vec<Block>,
    factor: Vec<Block>,
    factor_inverse: Vec<Block>,
    to_step: Vec<Block>,
    to_scaled: Vec<Block>,
    g: Vec<f64>,
    /// N g.
    product: Vec<f64>,
    rhs: Vec<f64>,
    /// The scaled unknown z = F^-1 dg.
    z: Vec<f64>,
    /// dx and ds.
    dx: Vec<[f64; 3]>,
    ds: Vec<[f64; 3]>,
}

impl Iterate {
    /// The smoothed projection of g - u: centred, with x o s = barrier e, whatever g is.
    fn new(problem: &Ccp, g: Vec<f64>, product: Vec<f64>, barrier: f64) -> Self {
        let contacts = problem.num_contacts();
        let t: Vec<[f64; 3]> = problem.friction.iter().map(|&mu| cone_map(mu)).collect();
        let pairs: Vec<Pair> = (0..contacts)
            .map(|i| {
                let z = std::array::from_fn(|k| {
                    let (g, u) = (g[3 * i + k], product[3 * i + k] + problem.r[3 * i + k]);
                    if t[i][k] > 0.0 { g / t[i][k] - u * t[i][k] } else { 0.0 }
                });
                Pair::start(problem.friction[i], z, barrier)
            })
            .collect();
        Self {
            trial: pairs.clone(),
            scalings: pairs.iter().map(Pair::scaling).collect(),
            pairs,
            t,
            added: vec![[0.0; 9]; contacts],
            factor: vec![[0.0; 9]; contacts],
            factor_inverse: vec![[0.0; 9]; contacts],
            to_step: vec![[0.0; 9]; contacts],
            to_scaled: vec![[0.0; 9]; contacts],
            g,
            product,
            rhs: vec![0.0; 3 * contacts],
            z: vec![0.0; 3 * contacts],
            dx: vec![[0.0; 3]; contacts],
            ds: vec![[0.0; 3]; contacts],
        }
    }

    /// tau, the mean of x^T s over the contacts.
    fn barrier(pairs: &[Pair]) -> f64 {
        pairs.iter().map(Pair::complementarity).sum::<f64>() / pairs.len() as f64
    }

    /// The scalings of the pairs and the blocks of Newton's matrix.
    fn update_scalings(&mut self) {
        for i in 0..self.pairs.len() {
            self.scalings[i] = self.pairs[i].scaling();
            let blocks = self.scalings[i].blocks(self.t[i], PROXIMAL);
            self.added[i] = blocks.added;
            self.factor[i] = blocks.factor;
            self.factor_inverse[i] = blocks.factor_inverse;
            self.to_step[i] = blocks.to_step;
            self.to_scaled[i] = blocks.to_scaled;
        }
    }

    /// Right-hand side F^T (-r_d) + C q of the scaled system, q = sigma tau lambda^-1 - lambda. Entries of r_d that are
    /// rounding errors, and the free tangential velocities of frictionless contacts, count as zero.
    fn update_right_hand_side(&mut self, r: &[f64], target: f64) {
        let largest = |v: &[f64]| v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let noise = NOISE * (largest(&self.g) + largest(r));
        for i in 0..self.pairs.len() {
            let y = divide_by(self.t[i], self.pairs[i].vectors().1);
            let push: [f64; 3] = std::array::from_fn(|k| {
                let defect = self.product[3 * i + k] + r[3 * i + k] - y[k];
                if self.t[i][k] == 0.0 || defect.abs() <= noise { 0.0 } else { -defect }
            });
            let q = apply3(&self.to_scaled[i], towards(&self.scalings[i], target));
            let f = &self.factor[i];
            for k in 0..3 {
                self.rhs[3 * i + k] = f[k] * push[0] + f[3 + k] * push[1] + f[6 + k] * push[2] + q[k];
            }
        }
    }

    /// dx and ds from z, and the longest step that keeps every x and s in its cone.
    fn update_direction(&mut self, target: f64) -> f64 {
        let mut longest = f64::INFINITY;
        for i in 0..self.pairs.len() {
            let scaling = &self.scalings[i];
            let z = [self.z[3 * i], self.z[3 * i + 1], self.z[3 * i + 2]];
            let (scaled_dx, q) = (apply3(&self.to_scaled[i], z), towards(scaling, target));
            let scaled_ds = std::array::from_fn(|k| q[k] - scaled_dx[k]);
            longest = longest.min(scaling.longest_step(scaled_dx)).min(scaling.longest_step(scaled_ds));
            self.dx[i] = apply3(&self.to_step[i], z);
            self.ds[i] = scaling.inverse_times(scaled_ds);
        }
        longest
    }

    /// Goes as far as `longest` allows, at most 1, and back until the neighbourhood is met; returns the step, 0 where
    /// none was found.
    fn advance(&mut self, longest: f64) -> f64 {
        let mut alpha = (FRACTION * longest).min(1.0);
        while alpha > SHORTEST {
            for (i, trial) in self.trial.iter_mut().enumerate() {
                *trial = self.pairs[i];
                trial.advance(alpha, self.dx[i], self.ds[i]);
            }
            let bound = NEIGHBOURHOOD * Self::barrier(&self.trial);
            if self.trial.iter().all(|pair| least_eigenvalue(pair) >= bound) {
                std::mem::swap(&mut self.pairs, &mut self.trial);
                return alpha;
            }
            alpha *= 0.8;
        }
        0.0
    }
}

/// (sum over contacts of |g - P(g - u)|^2 / N_c)^(1/2) of the scaled problem: how far a warm start is from its solution.
fn distance(problem: &Ccp, g: &[f64], product: &[f64]) -> f64 {
    let mut square = 0.0;
    for i in 0..problem.num_contacts() {
        let image = problem
            .cone(i)
            .project(std::array::from_fn(|k| g[3 * i + k] - product[3 * i + k] - problem.r[3 * i + k]));
        square += (0..3).map(|k| (g[3 * i + k] - image[k]).powi(2)).sum::<f64>();
    }
    (square / problem.num_contacts() as f64).sqrt()
}

impl Scip {
    /// Runs on the scaled problem; `impulse` (in the problem's units) gets the best iterate. Returns the status and the
    /// number of iterations.
    fn run(
        &mut self,
        problem: &Ccp,
        scaled: &Scaled,
        scale: &ResidualScale,
        impulse: &mut [f64],
        limits: &Limits<'_>,
    ) -> (Status, usize) {
        let inner = &scaled.problem;
        let contacts = inner.num_contacts();
        let mut work = inner.delassus.work();
        let mut g = vec![0.0; 3 * contacts];
        for i in 0..contacts {
            let start = std::array::from_fn(|k| impulse[3 * i + k] / scaled.impulse_unit[i]);
            g[3 * i..3 * i + 3].copy_from_slice(&inner.cone(i).project(start));
        }
        let mut product = vec![0.0; 3 * contacts];
        inner.delassus.multiply(&g, &mut product, &mut work);
        let barrier = if g.iter().any(|&g| g != 0.0) {
            distance(inner, &g, &product).clamp(WARM_BARRIER[0], WARM_BARRIER[1])
        } else {
            COLD_BARRIER
        };
        let physical = |units: &[f64], x: &[f64]| -> Vec<f64> {
            x.iter().enumerate().map(|(k, x)| units[k / 3] * x).collect()
        };
        let started = physical(&scaled.impulse_unit, &g);
        let velocities: Vec<f64> = product.iter().zip(&inner.r).map(|(product, r)| product + r).collect();
        let started_velocity = physical(&scaled.velocity_unit, &velocities);
        let mut it = Iterate::new(inner, g, product, barrier);
        let unbounded = UNBOUNDED * dot(&inner.r, &inner.r);
        let (mut physical, mut velocity) = (vec![0.0; 3 * contacts], vec![0.0; 3 * contacts]);
        let mut best = Best::default();
        // The path starts inside the cones: impulses handed over that are better must not be lost on the way.
        best.offer(
            &started,
            scale.residual(problem, &started, &started_velocity, FrictionModel::Relaxed).max,
        );
        let (mut iterations, mut least, mut since_better, mut last_step) = (0, f64::INFINITY, 0, 0.0_f64);
        let status = loop {
            for (i, pair) in it.pairs.iter().enumerate() {
                it.g[3 * i..3 * i + 3].copy_from_slice(&componentwise(it.t[i], pair.vectors().0));
            }
            inner.delassus.multiply(&it.g, &mut it.product, &mut work);
            for k in 0..3 * contacts {
                physical[k] = scaled.impulse_unit[k / 3] * it.g[k];
                velocity[k] = scaled.velocity_unit[k / 3] * (it.product[k] + inner.r[k]);
            }
            let residual = scale.residual(problem, &physical, &velocity, FrictionModel::Relaxed).max;
            best.offer(&physical, residual);
            if let Some(status) = limits.status(iterations, residual) {
                break status;
            }
            since_better += 1;
            if residual < 0.9 * least {
                (least, since_better) = (residual, 0);
            } else if since_better > PATIENCE {
                break Status::Stalled;
            }
            let along = dot(&inner.r, &it.g);
            if along < 0.0 && along * along > unbounded * dot(&it.g, &it.product) {
                break Status::Infeasible;
            }
            it.update_scalings();
            let blocks =
                ScaledBlocks { added: &it.added, factor: &it.factor, factor_inverse: &it.factor_inverse };
            if self.newton.refresh(inner, blocks, iterations, residual).is_err() {
                break Status::Stalled;
            }
            let sigma = (1.0 - last_step).powi(2).clamp(CENTRING[0], CENTRING[1]);
            let target = sigma * Iterate::barrier(&it.pairs);
            it.update_right_hand_side(&inner.r, target);
            let blocks =
                ScaledBlocks { added: &it.added, factor: &it.factor, factor_inverse: &it.factor_inverse };
            self.newton.solve(inner, blocks, &it.rhs, &mut it.z, (1e-2 * residual).clamp(1e-12, 1e-3));
            let longest = it.update_direction(target);
            last_step = it.advance(longest);
            self.newton.end_iteration(last_step);
            iterations += 1;
            if last_step == 0.0 {
                break Status::Stalled;
            }
        };
        best.restore(impulse);
        (status, iterations)
    }
}

impl CcpSolver for Scip {
    fn name(&self) -> String {
        match self.newton.linear_name().as_str() {
            "cholesky" => "scip".to_string(),
            linear => format!("scip+{linear}"),
        }
    }

    fn iteration_limit(&self) -> usize {
        ITERATIONS
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, ITERATIONS);
        check_start(problem, impulse)?;
        let scale = ResidualScale::new(problem);
        let (mut status, mut iterations) = (Status::Converged, 0);
        if problem.num_contacts() > 0 {
            let scaled = Scaled::new(problem, &scale);
            self.newton.set_patience(limits.patience());
            self.newton.begin(&scaled.problem);
            (status, iterations) = self.run(problem, &scaled, &scale, impulse, &limits);
        }
        limits.report_with(&self.name(), problem, impulse, status, iterations, &mut self.newton)
    }
}
