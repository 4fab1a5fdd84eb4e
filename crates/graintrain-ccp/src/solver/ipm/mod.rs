//! `ipm`: a primal-dual interior point with Nesterov-Todd scaling for the CCP.
//!
//! With T_i = diag(1/mu_i, 1, 1) (up to a factor) the friction cones become second-order cones: g = T x and, for the
//! velocities y = N g + r of the dual cones, s = T y. The central path x o s = tau e is followed by Mehrotra's
//! predictor and corrector from an infeasible start. With the scaling W of each cone, W s = W^-1 x = lambda, Newton's
//! step solves
//!
//! ```text
//! (N + H) dg = -r_d + T^-1 W^-1 q,    H = T^-1 W^-2 T^-1,    r_d = N g + r - y,    lambda o q = -d_c
//! W ds = q - W^-1 dx
//! predictor:  d_c = lambda o lambda          corrector: d_c = lambda o lambda + (W^-1 dx_a) o (W ds_a) - sigma tau e
//! ```
//!
//! and d_c grows by Gondzio's correctors where they lengthen the step. Sources: Nesterov, Todd (1997); Mehrotra (1992);
//! Gondzio (1996); Vandenberghe, "The CVXOPT linear and quadratic cone program solvers" (2010), for the scaling.
//! A contact without friction is the half line g_n >= 0 with g_t = 0.
//!
//! **The last digits.** Where an impulse and its velocity both vanish or both lie on the boundary, the distance of the
//! central path from the solution is sqrt(tau), and rounding ends the method at residuals of 1e-7 to 1e-8. There a few
//! projected gradient steps (`apgd`) from the best iterate put impulses on the boundary where they belong.
//!
//! **Infeasible problems.** Where the bodies are jammed, impulses exist that change no velocity and yet are asked for:
//! N g -> 0, r^T g < 0, and the objective has no lower bound. The ratio (r^T g)^2 / (g^T N g), which bounds twice the
//! optimal value from below, then grows without limit. The answer returned is that of N + `COMPLIANCE` diag(eta), a
//! little give in every contact, with [`Status::Infeasible`].

pub(super) mod cone;
pub(super) mod scaled;

use super::driver::{Best, Limits, check_start};
use super::{CcpSolver, SolveReport, SolveSettings, Status};
use crate::newton::driver::{NewtonDriver, ScaledBlocks};
use crate::newton::{apply_blocks_in_place, linear_solver};
use crate::problem::{Ccp, CcpError};
use crate::residual::ResidualScale;
use cone::{Point, Scaling, product};
use graintrain_linalg::block_ops::apply3;
use graintrain_linalg::block3::Block;
use graintrain_linalg::parallel::dot;
use scaled::Scaled;

/// Iterations allowed where the settings name no limit.
const ITERATIONS: usize = 100;
/// Coefficients of friction below this are taken as zero.
const FRICTIONLESS: f64 = 1e-9;
/// H of the tangential components of a frictionless contact, relative to eta: they are held at zero.
const HELD: f64 = 1e8;
/// (r^T g)^2 / (g^T N g) relative to |r|^2 (scaled) above which the problem is taken as infeasible.
pub(super) const UNBOUNDED: f64 = 1e9;
/// Compliance relative to eta that makes an infeasible problem solvable.
const COMPLIANCE: f64 = 1e-6;
/// Gondzio correctors tried per iteration.
const CORRECTORS: usize = 2;
/// Complementarity products are pulled into this range around their target.
const PRODUCTS: [f64; 2] = [0.1, 10.0];
/// Proximal term of Newton's matrix, relative to eta: steps minimise the objective plus PROXIMAL / 2 |dg|^2, which
/// bounds the condition number of stiff contacts and leaves the solution as it is.
const PROXIMAL: f64 = 1e-9;
/// Entries of r_d below this many units of rounding (of the largest impulse or velocity, scaled) are noise and no
/// longer corrected: next to the boundary their correction would shorten every step to nothing.
const NOISE: f64 = 32.0 * f64::EPSILON;
/// Barrier of a cold start: impulses in force chains are a few times larger than those of single contacts.
const COLD_BARRIER: f64 = 1e3;
/// Projected gradient iterations per round after the method has stalled: 10 to 20 are enough for 1e-8.
const FINISH: usize = 100;
/// A round that does not lower the residual to this fraction is the last one.
const FINISH_GAIN: f64 = 0.9;
/// Smallest barrier of a warm start.
const WARM_BARRIER: f64 = 1e-4;

/// The interior point.
pub struct Ipm {
    newton: NewtonDriver,
}

impl Ipm {
    /// With the linear solver of this name (see [`crate::newton`]).
    ///
    /// # Errors
    /// [`CcpError::UnknownSolver`].
    pub fn new(linear: &str) -> Result<Self, CcpError> {
        Ok(Self { newton: NewtonDriver::new(linear_solver("ipm", linear)?) })
    }
}

pub(super) fn build(linear: Option<&str>) -> Result<Box<dyn CcpSolver>, CcpError> {
    Ok(Box::new(Ipm::new(linear.unwrap_or("cholesky"))?))
}

/// One contact: its primal-dual pair in cone coordinates, or the half lines of a frictionless one.
#[derive(Clone, Copy)]
pub(super) enum Pair {
    Cone { x: Point, s: Point },
    Line { x: f64, s: f64 },
}

/// Scaling of a pair, or that of a half line: sqrt(x / s) and lambda = sqrt(x s).
#[derive(Clone, Copy)]
pub(super) enum PairScaling {
    Cone(Scaling),
    Line { w: f64, lambda: f64 },
}

/// Diagonal of T.
pub(super) fn cone_map(mu: f64) -> [f64; 3] {
    if mu <= FRICTIONLESS { [1.0, 0.0, 0.0] } else { [mu.recip().min(1.0), mu.min(1.0), mu.min(1.0)] }
}

pub(super) fn componentwise(t: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    [t[0] * v[0], t[1] * v[1], t[2] * v[2]]
}

pub(super) fn divide_by(t: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| if t[k] > 0.0 { v[k] / t[k] } else { 0.0 })
}

impl Pair {
    pub fn start(mu: f64, z: [f64; 3], barrier: f64) -> Self {
        if mu <= FRICTIONLESS {
            let root = (z[0] * z[0] + 4.0 * barrier).sqrt();
            let x = if z[0] >= 0.0 { 0.5 * (z[0] + root) } else { 2.0 * barrier / (root - z[0]) };
            Self::Line { x, s: barrier / x }
        } else {
            let (x, s) = Point::smoothed_pair(z, barrier);
            Self::Cone { x, s }
        }
    }

    /// x and s as vectors.
    pub fn vectors(&self) -> ([f64; 3], [f64; 3]) {
        match self {
            Self::Cone { x, s } => (x.vector(), s.vector()),
            Self::Line { x, s } => ([*x, 0.0, 0.0], [*s, 0.0, 0.0]),
        }
    }

    pub fn complementarity(&self) -> f64 {
        match self {
            Self::Cone { x, s } => x.dot(s),
            Self::Line { x, s } => x * s,
        }
    }

    pub fn scaling(&self) -> PairScaling {
        match self {
            Self::Cone { x, s } => PairScaling::Cone(Scaling::new(x, s)),
            Self::Line { x, s } => PairScaling::Line { w: (x / s).sqrt(), lambda: (x * s).sqrt() },
        }
    }

    pub fn advance(&mut self, alpha: f64, dx: [f64; 3], ds: [f64; 3]) {
        match self {
            Self::Cone { x, s } => {
                *x = x.advance(alpha, dx);
                *s = s.advance(alpha, ds);
            }
            Self::Line { x, s } => {
                *x = (*x + alpha * dx[0]).max(1e-6 * *x);
                *s = (*s + alpha * ds[0]).max(1e-6 * *s);
            }
        }
    }
}

impl PairScaling {
    pub fn lambda(&self) -> [f64; 3] {
        match self {
            Self::Cone(w) => w.lambda,
            Self::Line { lambda, .. } => [*lambda, 0.0, 0.0],
        }
    }

    pub fn inverse_times(&self, v: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Cone(scaling) => scaling.inverse_times(v),
            Self::Line { w, .. } => [v[0] / w, 0.0, 0.0],
        }
    }

    pub fn divide(&self, d: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Cone(scaling) => scaling.divide(d),
            Self::Line { lambda, .. } => [d[0] / lambda, 0.0, 0.0],
        }
    }

    pub fn longest_step(&self, d: [f64; 3]) -> f64 {
        match self {
            Self::Cone(scaling) => scaling.longest_step(d),
            Self::Line { lambda, .. } => {
                if d[0] < 0.0 {
                    -lambda / d[0]
                } else {
                    f64::INFINITY
                }
            }
        }
    }

    /// The blocks of Newton's matrix with E = W^-2 + delta I, delta = proximal T_n^2:
    /// H = T^-1 E T^-1, F = T E^(-1/2), and what turns the scaled unknown z = F^-1 dg into W^-1 dx = C z.
    pub fn blocks(&self, t: [f64; 3], proximal: f64) -> Blocks {
        match self {
            Self::Cone(scaling) => {
                let delta = proximal * t[0] * t[0];
                let h = scaling.function(|e| e + delta);
                let (root, inverse_root) = (
                    scaling.function(|e| (e + delta).sqrt()),
                    scaling.function(|e| (e + delta).sqrt().recip()),
                );
                Blocks {
                    added: std::array::from_fn(|k| h[k] / (t[k / 3] * t[k % 3])),
                    factor: std::array::from_fn(|k| inverse_root[k] * t[k / 3]),
                    factor_inverse: std::array::from_fn(|k| root[k] / t[k % 3]),
                    to_step: inverse_root,
                    to_scaled: scaling.function(|e| (e / (e + delta)).sqrt()),
                }
            }
            Self::Line { w, .. } => {
                let e = 1.0 / (w * w);
                let h = e + proximal;
                let diagonal = |a: f64, b: f64| [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, b];
                Blocks {
                    added: diagonal(h, HELD),
                    factor: diagonal(1.0 / h.sqrt(), 1.0 / HELD.sqrt()),
                    factor_inverse: diagonal(h.sqrt(), HELD.sqrt()),
                    to_step: diagonal(1.0 / h.sqrt(), 0.0),
                    to_scaled: diagonal((e / h).sqrt(), 0.0),
                }
            }
        }
    }
}

/// See [`PairScaling::blocks`].
pub(super) struct Blocks {
    pub added: Block,
    pub factor: Block,
    pub factor_inverse: Block,
    /// E^(-1/2): dx from z.
    pub to_step: Block,
    /// C = W^-1 E^(-1/2): W^-1 dx from z.
    pub to_scaled: Block,
}

/// Vectors of one solve, allocated once.
struct Work {
    pairs: Vec<Pair>,
    scalings: Vec<PairScaling>,
    t: Vec<[f64; 3]>,
    added: Vec<Block>,
    factor: Vec<Block>,
    factor_inverse: Vec<Block>,
    to_step: Vec<Block>,
    to_scaled: Vec<Block>,
    g: Vec<f64>,
    /// N g (with compliance).
    ng: Vec<f64>,
    residual_dual: Vec<f64>,
    rhs: Vec<f64>,
    /// The scaled unknown z = F^-1 dg.
    z: Vec<f64>,
    /// q of the last right-hand side, per contact.
    q: Vec<[f64; 3]>,
    /// W^-1 dx and W ds.
    scaled_dx: Vec<[f64; 3]>,
    scaled_ds: Vec<[f64; 3]>,
}

impl Work {
    fn new(problem: &Ccp) -> Self {
        let contacts = problem.num_contacts();
        let size = 3 * contacts;
        let line = PairScaling::Line { w: 1.0, lambda: 1.0 };
        Self {
            pairs: vec![Pair::Line { x: 1.0, s: 1.0 }; contacts],
            scalings: vec![line; contacts],
            t: problem.friction.iter().map(|&mu| cone_map(mu)).collect(),
            added: vec![[0.0; 9]; contacts],
            factor: vec![[0.0; 9]; contacts],
            factor_inverse: vec![[0.0; 9]; contacts],
            to_step: vec![[0.0; 9]; contacts],
            to_scaled: vec![[0.0; 9]; contacts],
            g: vec![0.0; size],
            ng: vec![0.0; size],
            residual_dual: vec![0.0; size],
            rhs: vec![0.0; size],
            z: vec![0.0; size],
            q: vec![[0.0; 3]; contacts],
            scaled_dx: vec![[0.0; 3]; contacts],
            scaled_ds: vec![[0.0; 3]; contacts],
        }
    }

    fn contacts(&self) -> usize {
        self.pairs.len()
    }

    fn blocks(&self) -> ScaledBlocks<'_> {
        ScaledBlocks { added: &self.added, factor: &self.factor, factor_inverse: &self.factor_inverse }
    }

    /// g = T x.
    fn impulses_from_pairs(&mut self) {
        for (i, pair) in self.pairs.iter().enumerate() {
            self.g[3 * i..3 * i + 3].copy_from_slice(&componentwise(self.t[i], pair.vectors().0));
        }
    }

    /// r_d = N g + r - y with y = T^-1 s; the tangential velocity of a frictionless contact is free.
    fn update_dual_residual(&mut self, r: &[f64]) {
        let largest = |v: &[f64]| v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let noise = NOISE * (largest(&self.g) + largest(r));
        for (i, pair) in self.pairs.iter().enumerate() {
            let y = divide_by(self.t[i], pair.vectors().1);
            for k in 0..3 {
                let free = self.t[i][k] == 0.0;
                let defect = self.ng[3 * i + k] + r[3 * i + k] - y[k];
                self.residual_dual[3 * i + k] = if free || defect.abs() <= noise { 0.0 } else { defect };
            }
        }
    }

    /// Mean of x^T s over the contacts.
    fn barrier(&self) -> f64 {
        self.pairs.iter().map(Pair::complementarity).sum::<f64>() / self.contacts() as f64
    }

    /// Right-hand side F^T (-(1 - sigma) r_d) + C q with lambda o q = -d_c.
    fn right_hand_side(&mut self, dual_factor: f64, complementarity: impl Fn(usize) -> [f64; 3]) {
        for i in 0..self.contacts() {
            self.q[i] = self.scalings[i].divide(complementarity(i).map(|x| -x));
        }
        self.combine_right_hand_side(dual_factor);
    }

    /// The right-hand side of the predictor, d_c = lambda o lambda: q = -lambda.
    fn affine_right_hand_side(&mut self) {
        for i in 0..self.contacts() {
            self.q[i] = self.scalings[i].lambda().map(|x| -x);
        }
        self.combine_right_hand_side(1.0);
    }

    fn combine_right_hand_side(&mut self, dual_factor: f64) {
        for k in 0..self.rhs.len() {
            self.rhs[k] = -dual_factor * self.residual_dual[k];
        }
        apply_blocks_in_place(&self.factor, &mut self.rhs, true);
        for i in 0..self.contacts() {
            let push = apply3(&self.to_scaled[i], self.q[i]);
            for k in 0..3 {
                self.rhs[3 * i + k] += push[k];
            }
        }
    }

    /// W^-1 dx and W ds from z.
    fn scaled_directions(&mut self) {
        for i in 0..self.contacts() {
            let z = [self.z[3 * i], self.z[3 * i + 1], self.z[3 * i + 2]];
            let dx = apply3(&self.to_scaled[i], z);
            self.scaled_dx[i] = dx;
            self.scaled_ds[i] = std::array::from_fn(|k| self.q[i][k] - dx[k]);
        }
    }

    /// Largest step that keeps every x and s in its cone.
    fn longest_step(&self) -> f64 {
        let mut alpha = f64::INFINITY;
        for (scaling, (dx, ds)) in self.scalings.iter().zip(self.scaled_dx.iter().zip(&self.scaled_ds)) {
            alpha = alpha.min(scaling.longest_step(*dx)).min(scaling.longest_step(*ds));
        }
        alpha
    }

    /// Mean of x^T s after a step.
    fn barrier_after(&self, alpha: f64) -> f64 {
        let mut sum = 0.0;
        for (scaling, (dx, ds)) in self.scalings.iter().zip(self.scaled_dx.iter().zip(&self.scaled_ds)) {
            let l = scaling.lambda();
            sum += (0..3).map(|k| (l[k] + alpha * dx[k]) * (l[k] + alpha * ds[k])).sum::<f64>();
        }
        sum / self.contacts() as f64
    }

    fn advance(&mut self, alpha: f64) {
        for i in 0..self.contacts() {
            let z = [self.z[3 * i], self.z[3 * i + 1], self.z[3 * i + 2]];
            let dx = apply3(&self.to_step[i], z);
            let ds = self.scalings[i].inverse_times(self.scaled_ds[i]);
            self.pairs[i].advance(alpha, dx, ds);
        }
    }
}

/// What one run of the method ended with.
struct Outcome {
    status: Status,
    iterations: usize,
}

impl Ipm {
    /// Runs on the scaled problem with some compliance added to N. `impulse` (physical) gets the best iterate.
    fn run(
        &mut self,
        problem: &Ccp,
        scaled: &Scaled,
        residual_scale: &ResidualScale,
        impulse: &mut [f64],
        limits: &Limits<'_>,
        settings: &SolveSettings,
        compliance: f64,
    ) -> Outcome {
        let inner = &scaled.problem;
        let mut work = Work::new(inner);
        let contacts = work.contacts();
        let mut product_work = inner.delassus.work();
        // Compliance in the metric of the cone coordinates, compliance T_n^2 T^-2, so that it only adds to delta.
        let give: Vec<[f64; 3]> = work
            .t
            .iter()
            .map(|t| t.map(|x| if x > 0.0 { compliance * (t[0] / x).powi(2) } else { 0.0 }))
            .collect();
        let mut multiply = |g: &[f64], ng: &mut [f64]| {
            inner.delassus.multiply(g, ng, &mut product_work);
            for ((ng, g), give) in ng.iter_mut().zip(g).zip(give.as_flattened()) {
                *ng += give * g;
            }
        };
        let unbounded = UNBOUNDED * dot(&inner.r, &inner.r);

        // The start: the smoothed projection of g - u, from zero or from the impulses handed over.
        let warm = impulse.iter().any(|&g| g != 0.0);
        for i in 0..contacts {
            let g = std::array::from_fn(|k| impulse[3 * i + k] / scaled.impulse_unit[i]);
            let inside = inner.cone(i).project(g);
            work.g[3 * i..3 * i + 3].copy_from_slice(&inside);
        }
        multiply(&work.g, &mut work.ng);
        let mut distance = 0.0;
        for i in 0..contacts {
            let g = [work.g[3 * i], work.g[3 * i + 1], work.g[3 * i + 2]];
            let image = inner
                .cone(i)
                .project(std::array::from_fn(|k| g[k] - work.ng[3 * i + k] - inner.r[3 * i + k]));
            distance += (0..3).map(|k| (g[k] - image[k]).powi(2)).sum::<f64>();
        }
        let distance = (distance / contacts as f64).sqrt();
        let barrier = if warm { distance.clamp(WARM_BARRIER, 1.0) } else { COLD_BARRIER };
        for i in 0..contacts {
            let t = work.t[i];
            let z = std::array::from_fn(|k| {
                let (g, u) = (work.g[3 * i + k], work.ng[3 * i + k] + inner.r[3 * i + k]);
                if t[k] > 0.0 { g / t[k] - u * t[k] } else { 0.0 }
            });
            work.pairs[i] = Pair::start(inner.friction[i], z, barrier);
        }

        let mut best = Best::default();
        let (mut physical, mut velocity) = (vec![0.0; 3 * contacts], vec![0.0; 3 * contacts]);
        let mut iterations = 0;
        let (mut least, mut since_better) = (f64::INFINITY, 0);
        let status = loop {
            work.impulses_from_pairs();
            multiply(&work.g, &mut work.ng);
            work.update_dual_residual(&inner.r);
            for k in 0..3 * contacts {
                physical[k] = scaled.impulse_unit[k / 3] * work.g[k];
                velocity[k] = scaled.velocity_unit[k / 3] * (work.ng[k] + inner.r[k]);
            }
            let residual = residual_scale.residual(problem, &physical, &velocity, settings.friction).max;
            best.offer(&physical, residual);
            if let Some(status) = limits.status(iterations, residual) {
                break status;
            }
            if residual < 0.9 * least {
                (least, since_better) = (residual, 0);
            } else {
                since_better += 1;
                if since_better > 15 {
                    break Status::Stalled;
                }
            }
            let along = dot(&inner.r, &work.g);
            if along < 0.0 && along * along > unbounded * dot(&work.g, &work.ng) {
                break Status::Infeasible;
            }

            for i in 0..contacts {
                work.scalings[i] = work.pairs[i].scaling();
                let blocks = work.scalings[i].blocks(work.t[i], PROXIMAL + compliance);
                work.added[i] = blocks.added;
                work.factor[i] = blocks.factor;
                work.factor_inverse[i] = blocks.factor_inverse;
                work.to_step[i] = blocks.to_step;
                work.to_scaled[i] = blocks.to_scaled;
            }
            if self.newton.refresh(inner, work.blocks(), iterations, residual).is_err() {
                break Status::Stalled;
            }
            // Errors of the linear solves must stay below the residual reached, more so near the end.
            let linear_tolerance = (1e-3 * residual).clamp(1e-13, 1e-6);
            let barrier = work.barrier();

            work.affine_right_hand_side();
            self.linear_solve(inner, &mut work, linear_tolerance);
            let affine_step = work.longest_step().min(1.0);
            let sigma = (work.barrier_after(affine_step) / barrier).clamp(0.0, 1.0).powi(3);
            let target = sigma * barrier;
            // Second-order terms of the affine direction.
            let second: Vec<[f64; 3]> =
                work.scaled_dx.iter().zip(&work.scaled_ds).map(|(dx, ds)| product(*dx, *ds)).collect();
            let mut complementarity: Vec<[f64; 3]> = (0..contacts)
                .map(|i| {
                    let l = work.scalings[i].lambda();
                    let square = product(l, l);
                    [square[0] + second[i][0] - target, square[1] + second[i][1], square[2] + second[i][2]]
                })
                .collect();
            work.right_hand_side(1.0 - sigma, |i| complementarity[i]);
            self.linear_solve(inner, &mut work, linear_tolerance);
            let mut step = work.longest_step();

            // Gondzio's correctors: pull outlying complementarity products of a longer step back.
            for _ in 0..CORRECTORS {
                if step >= 1.0 {
                    break;
                }
                let aim = (1.5 * step + 0.1).min(1.0);
                let saved = (work.z.clone(), work.scaled_dx.clone(), work.scaled_ds.clone(), work.q.clone());
                let trial: Vec<[f64; 3]> = (0..contacts)
                    .map(|i| {
                        let correction = outlying(
                            work.scalings[i].lambda(),
                            aim,
                            work.scaled_dx[i],
                            work.scaled_ds[i],
                            target,
                        );
                        std::array::from_fn(|k| complementarity[i][k] + correction[k])
                    })
                    .collect();
                work.right_hand_side(1.0 - sigma, |i| trial[i]);
                self.linear_solve(inner, &mut work, linear_tolerance);
                let longer = work.longest_step();
                if longer < step + 0.1 * (aim - step) {
                    (work.z, work.scaled_dx, work.scaled_ds, work.q) = saved;
                    break;
                }
                step = longer;
                complementarity = trial;
            }
            let fraction = (1.0 - 0.1 * barrier.sqrt()).clamp(0.9, 0.9995);
            let alpha = (fraction * step).min(1.0);
            work.advance(alpha);
            self.newton.end_iteration(alpha);
            iterations += 1;
            if !alpha.is_finite() || alpha < 1e-10 {
                break Status::Stalled;
            }
        };
        best.restore(impulse);
        Outcome { status, iterations }
    }

    fn linear_solve(&mut self, inner: &Ccp, work: &mut Work, tolerance: f64) {
        let Work { added, factor, factor_inverse, rhs, z, .. } = work;
        let blocks = ScaledBlocks { added, factor, factor_inverse };
        self.newton.solve(inner, blocks, rhs, z, tolerance);
        work.scaled_directions();
    }
}

/// Rounds of projected gradient steps from the best iterate, as long as they gain; the status they end with and the
/// iterations they took. Every round starts from a fresh N g: within a round its rounding errors add up.
fn finish(
    problem: &Ccp,
    impulse: &mut [f64],
    limits: &Limits<'_>,
    settings: &SolveSettings,
    iterations: usize,
) -> Result<(Status, usize), CcpError> {
    let mut solver = super::apgd::build(None)?;
    let mut trial = impulse.to_vec();
    let start = limits.report("ipm", problem, impulse, Status::Stalled, iterations, 0);
    let (mut count, mut least) = (0, start.residual.max);
    loop {
        let left = settings.max_iterations.map_or(FINISH, |_| limits.iterations_left(iterations + count));
        let round = SolveSettings {
            max_iterations: Some(left.min(FINISH)),
            max_time: limits.time_left(),
            ..settings.clone()
        };
        let report = solver.solve(problem, &mut trial, &round)?;
        count += report.iterations;
        let residual = report.residual.max;
        if residual < least {
            impulse.copy_from_slice(&trial);
        }
        if report.converged() || report.status == Status::Stopped {
            return Ok((report.status, count));
        }
        let gained = residual <= FINISH_GAIN * least;
        if !gained || left == 0 {
            return Ok((Status::Stalled, count));
        }
        least = least.min(residual);
    }
}

/// Gondzio's correction of d_c: what the products of the step `aim` exceed the range around the target by, per
/// eigenvalue of (lambda + aim dx) o (lambda + aim ds), bounded below by minus the upper end of the range.
fn outlying(lambda: [f64; 3], aim: f64, dx: [f64; 3], ds: [f64; 3], target: f64) -> [f64; 3] {
    let x: [f64; 3] = std::array::from_fn(|k| lambda[k] + aim * dx[k]);
    let s: [f64; 3] = std::array::from_fn(|k| lambda[k] + aim * ds[k]);
    let v = product(x, s);
    let length = v[1].hypot(v[2]);
    let [low, high] = PRODUCTS.map(|factor| factor * target);
    let excess = |l: f64| (l - l.clamp(low, high)).min(high);
    let (a, b) = (excess(v[0] - length), excess(v[0] + length));
    let (mean, half) = (0.5 * (a + b), 0.5 * (b - a));
    if length > 0.0 { [mean, half * v[1] / length, half * v[2] / length] } else { [mean, 0.0, 0.0] }
}

impl CcpSolver for Ipm {
    fn name(&self) -> String {
        match self.newton.linear_name() {
            "cholesky" => "ipm".to_string(),
            linear => format!("ipm+{linear}"),
        }
    }

    fn solve(
        &mut self,
        problem: &Ccp,
        impulse: &mut [f64],
        settings: &SolveSettings,
    ) -> Result<SolveReport, CcpError> {
        let limits = Limits::start(settings, ITERATIONS);
        check_start(problem, impulse)?;
        let residual_scale = ResidualScale::new(problem);
        let mut status = Status::Converged;
        let mut iterations = 0;
        let (mut linear_iterations, mut records) = (0, Vec::new());
        if problem.num_contacts() > 0 {
            let scaled = Scaled::new(problem, &residual_scale);
            self.newton.begin(&scaled.problem);
            let outcome = self.run(problem, &scaled, &residual_scale, impulse, &limits, settings, 0.0);
            (status, iterations) = (outcome.status, outcome.iterations);
            linear_iterations = self.newton.linear_iterations();
            records = self.newton.take_records();
            if status == Status::Stalled {
                let (finished, count) = finish(problem, impulse, &limits, settings, iterations)?;
                (status, iterations) = (finished, iterations + count);
            }
            if status == Status::Infeasible {
                impulse.fill(0.0);
                self.newton.begin(&scaled.problem);
                let outcome =
                    self.run(problem, &scaled, &residual_scale, impulse, &limits, settings, COMPLIANCE);
                iterations += outcome.iterations;
                linear_iterations += self.newton.linear_iterations();
                records.append(&mut self.newton.take_records());
            }
        }
        let mut report = limits.report(&self.name(), problem, impulse, status, iterations, linear_iterations);
        report.newton = records;
        Ok(report)
    }
}
