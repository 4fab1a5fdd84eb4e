//! The smoothed problem: the CHKS projection on the cones, De Saxce's term, and their derivatives contact by
//! contact.

use crate::delassus::DelassusWork;
use crate::problem::Ccp;
use crate::residual::{FrictionModel, ResidualScale};
use graintrain_linalg::block_ops::multiply3;
use graintrain_linalg::block3::Block;
use graintrain_linalg::real;

/// phi(l) = (l + sqrt(l^2 + 4 tau^2)) / 2 with its derivatives.
#[derive(Clone, Copy, Debug, Default)]
struct Smoothed {
    value: f64,
    /// phi(-l) = phi(l) - l.
    rest: f64,
    /// d phi / d l.
    slope: f64,
    /// 1 - slope.
    complement: f64,
    /// d phi / d tau.
    rate: f64,
}

/// Without cancellation for either sign of l.
fn smoothed(l: f64, tau: f64) -> Smoothed {
    let root = real::hypot(l, 2.0 * tau);
    if root == 0.0 {
        return Smoothed { slope: 0.5, complement: 0.5, rate: 1.0, ..Smoothed::default() };
    }
    let large = 0.5 * (l.abs() + root);
    let small = tau * (tau / large);
    let rate = 2.0 * tau / root;
    let (steep, flat) = (large / root, small / root);
    if l >= 0.0 {
        Smoothed { value: large, rest: small, slope: steep, complement: flat, rate }
    } else {
        Smoothed { value: small, rest: large, slope: flat, complement: steep, rate }
    }
}

/// a on (1, d), b on (1, -d), c across: the symmetric matrix with these eigenvalues.
fn spectral(d: [f64; 2], a: f64, b: f64, c: f64) -> Block {
    let (mean, half) = (0.5 * (a + b), 0.5 * (a - b));
    let mixed = (mean - c) * d[0] * d[1];
    let (first, second) = (mean * d[0] * d[0] + c * d[1] * d[1], mean * d[1] * d[1] + c * d[0] * d[0]);
    [mean, half * d[0], half * d[1], half * d[0], first, mixed, half * d[1], mixed, second]
}

/// What the Jacobian of the smoothed problem, J = N' A + B, needs of one contact.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ContactBlocks {
    /// A = dP/dw.
    pub derivative: Block,
    /// B = eta (I - e_n s^T) (I - A), with I - A bounded from below.
    pub defect: Block,
    /// B^-1.
    pub defect_inverse: Block,
    /// A B^-1.
    pub weight: Block,
}

/// Point w of the smoothed problem with everything that follows from it; see the equations of [`super`].
#[derive(Clone, Debug, Default)]
pub(super) struct Point {
    /// x = P_tau(w), N s.
    pub x: Vec<f64>,
    /// G, m/s.
    pub defect: Vec<f64>,
    /// dx/dtau_i of every contact, per unit of its own tau.
    x_rate: Vec<f64>,
    /// y = eta (x - w), m/s.
    y: Vec<f64>,
    /// |y_t|_delta.
    speed: Vec<f64>,
}

/// Least eigenvalue of I - A in the Jacobian.
const LEAST_COMPLEMENT: f64 = 1e-10;

/// The smoothed problem of one contact problem.
pub(super) struct SmoothedProblem<'a> {
    problem: &'a Ccp,
    /// S: 1 / mu_i, or 1 without friction; x_n = g_n / unit_n.
    pub normal_unit: Vec<f64>,
    /// eta_i of the cones' own metric, 1/kg.
    pub eta: Vec<f64>,
    /// tau_i = tau tau_unit_i, N s.
    pub tau_unit: Vec<f64>,
    /// V, m/s.
    pub velocity: f64,
    /// r' = S^-1 r, m/s.
    free: Vec<f64>,
    /// 1 with De Saxce's term, 0 without it.
    theta: f64,
    /// kappa of delta_i = kappa eta_i tau_i.
    pub rounding: f64,
    work: DelassusWork,
    scratch: Vec<f64>,
}

impl<'a> SmoothedProblem<'a> {
    pub fn new(problem: &'a Ccp, scale: &ResidualScale, model: FrictionModel) -> Self {
        let contacts = problem.num_contacts();
        let normal_unit: Vec<f64> =
            problem.friction.iter().map(|&mu| if mu > 0.0 { 1.0 / mu } else { 1.0 }).collect();
        let eta: Vec<f64> = (0..contacts)
            .map(|i| {
                let block = problem.delassus.diagonal_block(i);
                let normal = block[0] * normal_unit[i] * normal_unit[i];
                let mean = if problem.friction[i] > 0.0 {
                    real::cbrt(normal.max(0.0) * block[4].max(0.0) * block[8].max(0.0))
                } else {
                    normal
                };
                // A contact that cannot move in one direction has no geometric mean; one that cannot move at
                // all has no mean.
                if mean > 1e-3 * scale.eta[i] && mean.is_finite() { mean } else { scale.eta[i] }
            })
            .collect();
        let velocity = scale.velocity;
        let free =
            (0..3 * contacts).map(|k| problem.r[k] * if k % 3 == 0 { normal_unit[k / 3] } else { 1.0 });
        Self {
            problem,
            tau_unit: eta.iter().map(|eta| velocity / eta).collect(),
            velocity,
            free: free.collect(),
            normal_unit,
            eta,
            theta: if model == FrictionModel::Coulomb { 1.0 } else { 0.0 },
            rounding: 0.0,
            work: problem.delassus.work(),
            scratch: vec![0.0; 3 * contacts],
        }
    }

    pub fn num_contacts(&self) -> usize {
        self.eta.len()
    }

    /// N' x = S^-1 N S^-1 x.
    pub fn multiply(&mut self, x: &[f64], image: &mut [f64]) {
        for (k, (scratch, x)) in self.scratch.iter_mut().zip(x).enumerate() {
            *scratch = if k % 3 == 0 { x * self.normal_unit[k / 3] } else { *x };
        }
        self.problem.delassus.multiply(&self.scratch, image, &mut self.work);
        for (image, unit) in image.iter_mut().step_by(3).zip(&self.normal_unit) {
            *image *= unit;
        }
    }

    /// De Saxce's factor of a contact.
    fn theta(&self, i: usize) -> f64 {
        if self.problem.friction[i] > 0.0 { self.theta } else { 0.0 }
    }

    /// x, y and their rates at w, then G.
    pub fn evaluate(&mut self, w: &[f64], tau: f64, point: &mut Point) {
        let contacts = self.num_contacts();
        for field in [&mut point.x, &mut point.y, &mut point.x_rate, &mut point.defect] {
            field.resize(3 * contacts, 0.0);
        }
        point.speed.resize(contacts, 0.0);
        for i in 0..contacts {
            let k = 3 * i;
            let own = tau * self.tau_unit[i];
            let (x, y, rate) = if self.problem.friction[i] > 0.0 {
                let (d, [plus, minus], _) = self.spectrum(w, i, own);
                let vector = |a: f64, b: f64| {
                    let half = 0.5 * (a - b);
                    [0.5 * (a + b), half * d[0], half * d[1]]
                };
                (
                    vector(plus.value, minus.value),
                    vector(plus.rest, minus.rest),
                    vector(plus.rate, minus.rate),
                )
            } else {
                let plus = smoothed(w[k], own);
                ([plus.value, 0.0, 0.0], [plus.rest, -w[k + 1], -w[k + 2]], [plus.rate, 0.0, 0.0])
            };
            let y = y.map(|y| self.eta[i] * y);
            point.x[k..k + 3].copy_from_slice(&x);
            point.y[k..k + 3].copy_from_slice(&y);
            point.x_rate[k..k + 3].copy_from_slice(&rate);
            point.speed[i] = real::hypot(real::hypot(y[1], y[2]), self.rounding * self.eta[i] * own);
        }
        let mut defect = std::mem::take(&mut point.defect);
        self.multiply(&point.x, &mut defect);
        for k in 0..3 * contacts {
            defect[k] += self.free[k] - point.y[k];
        }
        for i in 0..contacts {
            defect[3 * i] += self.theta(i) * point.speed[i];
        }
        point.defect = defect;
    }

    /// rms_i |G_i| / V.
    pub fn size_of(&self, defect: &[f64]) -> f64 {
        let sum: f64 = defect.iter().map(|x| (x / self.velocity).powi(2)).sum();
        (sum / self.num_contacts() as f64).sqrt()
    }

    /// dG / d ln tau at the point.
    pub fn rate(&mut self, tau: f64, point: &Point, rate: &mut [f64]) {
        let contacts = self.num_contacts();
        let x_rate: Vec<f64> =
            (0..3 * contacts).map(|k| point.x_rate[k] * tau * self.tau_unit[k / 3]).collect();
        self.multiply(&x_rate, rate);
        for i in 0..contacts {
            let k = 3 * i;
            let eta = self.eta[i];
            for c in 0..3 {
                rate[k + c] -= eta * x_rate[k + c];
            }
            let s = slip(point, i);
            let rounding = self.rounding * eta * tau * self.tau_unit[i];
            let along = eta * (s[0] * x_rate[k + 1] + s[1] * x_rate[k + 2]);
            if point.speed[i] > 0.0 {
                rate[k] += self.theta(i) * (along + rounding * rounding / point.speed[i]);
            }
        }
    }

    /// Direction of w_t, phi on both eigenvalues of w, and |w_t|.
    fn spectrum(&self, w: &[f64], i: usize, tau: f64) -> ([f64; 2], [Smoothed; 2], f64) {
        let k = 3 * i;
        let length = real::hypot(w[k + 1], w[k + 2]);
        let d = if length > 0.0 { [w[k + 1] / length, w[k + 2] / length] } else { [1.0, 0.0] };
        (d, [smoothed(w[k] + length, tau), smoothed(w[k] - length, tau)], length)
    }

    /// The blocks of the Jacobian at the point.
    pub fn blocks(&self, w: &[f64], tau: f64, point: &Point, blocks: &mut Vec<ContactBlocks>) {
        let cap = |b: f64| b.max(LEAST_COMPLEMENT);
        blocks.clear();
        for i in 0..self.num_contacts() {
            let (eta, own) = (self.eta[i], tau * self.tau_unit[i]);
            blocks.push(if self.problem.friction[i] > 0.0 {
                let (d, [plus, minus], length) = self.spectrum(w, i, own);
                // Across w_t: (phi+ - phi-) / 2 |w_t|, and phi' where that is 0 / 0.
                let (across, rest) = if length > 1e-9 * own && length > 0.0 {
                    let across = (plus.value - minus.value) / (2.0 * length);
                    (across, (minus.rest - plus.rest) / (2.0 * length))
                } else {
                    (plus.slope, plus.complement)
                };
                let complement = [cap(plus.complement), cap(minus.complement), cap(rest)];
                let slope = [plus.slope, minus.slope, across];
                let of = |e: [f64; 3]| spectral(d, e[0], e[1], e[2]);
                let s = slip(point, i).map(|s| self.theta(i) * s);
                let inverse: [f64; 3] = std::array::from_fn(|k| 1.0 / (eta * complement[k]));
                let shear = [1.0, s[0], s[1], 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
                let back = [1.0, -s[0], -s[1], 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
                ContactBlocks {
                    derivative: of(slope),
                    defect: multiply3(&back, &of(complement.map(|b| eta * b))),
                    defect_inverse: multiply3(&of(inverse), &shear),
                    weight: multiply3(&of(std::array::from_fn(|k| slope[k] * inverse[k])), &shear),
                }
            } else {
                let plus = smoothed(w[3 * i], own);
                let normal = cap(plus.complement);
                let diagonal = |n: f64, t: f64| [n, 0.0, 0.0, 0.0, t, 0.0, 0.0, 0.0, t];
                ContactBlocks {
                    derivative: diagonal(plus.slope, 0.0),
                    defect: diagonal(eta * normal, eta),
                    defect_inverse: diagonal(1.0 / (eta * normal), 1.0 / eta),
                    weight: diagonal(plus.slope / (eta * normal), 0.0),
                }
            });
        }
    }

    /// g = S^-1 x projected on its cones.
    pub fn impulse(&self, x: &[f64], g: &mut [f64]) {
        for i in 0..self.num_contacts() {
            let k = 3 * i;
            let physical = [self.normal_unit[i] * x[k], x[k + 1], x[k + 2]];
            g[k..k + 3].copy_from_slice(&self.problem.cone(i).project(physical));
        }
    }

    /// w = x - y / eta of impulses g with relative velocities u = N g + r.
    pub fn point_of(&self, g: &[f64], u: &[f64], w: &mut [f64]) {
        for i in 0..self.num_contacts() {
            let k = 3 * i;
            let slip = self.theta(i) * real::hypot(u[k + 1], u[k + 2]);
            w[k] = g[k] / self.normal_unit[i] - (self.normal_unit[i] * u[k] + slip) / self.eta[i];
            for c in 1..3 {
                w[k + c] = g[k + c] - u[k + c] / self.eta[i];
            }
        }
    }
}

/// s = y_t / |y_t|_delta.
fn slip(point: &Point, i: usize) -> [f64; 2] {
    let speed = point.speed[i];
    if speed > 0.0 { [point.y[3 * i + 1] / speed, point.y[3 * i + 2] / speed] } else { [0.0; 2] }
}
