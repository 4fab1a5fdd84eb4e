//! An independent look at an answer: residuals and contact states, by code that no solver uses.
//!
//! Solvers work on N in whatever form they like and report their own residual. Here N is assembled,
//! multiplied row by row, and the natural map is written out again from its definition (see
//! [`graintrain_ccp::residual`]), so that a solver that fools itself is found out.

use graintrain_ccp::residual::objective_gap;
use graintrain_ccp::{Ccp, FrictionModel, Residual};
use graintrain_linalg::block3::BlockMatrix3;

/// A problem prepared for the evaluation of answers.
pub struct Yardstick<'a> {
    problem: &'a Ccp,
    matrix: BlockMatrix3,
    /// eta_i = trace(N_ii) / 3, 1/kg.
    eta: Vec<f64>,
    /// V, m/s.
    velocity_scale: f64,
}

/// What an answer is worth.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// u = N g + r, m/s.
    pub velocity: Vec<f64>,
    /// Residual as a relaxed CCP.
    pub relaxed: Residual,
    /// Residual as exact Coulomb friction.
    pub coulomb: Residual,
    /// 1/2 g^T N g + r^T g, J.
    pub objective: f64,
    /// How far the objective may lie above the optimum of the relaxed problem, relative to itself.
    pub gap: f64,
    /// Contacts without impulse.
    pub apart: usize,
    /// Contacts with an impulse inside the friction cone.
    pub sticking: usize,
    /// Contacts with an impulse on the mantle of the friction cone.
    pub sliding: usize,
}

impl Evaluation {
    /// Residual in one friction model.
    pub fn residual(&self, model: FrictionModel) -> Residual {
        match model {
            FrictionModel::Relaxed => self.relaxed,
            FrictionModel::Coulomb => self.coulomb,
        }
    }
}

impl<'a> Yardstick<'a> {
    /// Assembles N.
    pub fn new(problem: &'a Ccp) -> Self {
        let matrix = problem.delassus.assemble();
        let contacts = problem.num_contacts();
        let mut eta: Vec<f64> = (0..contacts)
            .map(|i| {
                let block = matrix.get(i, i);
                (block[0] + block[4] + block[8]) / 3.0
            })
            .collect();
        let smallest = eta.iter().copied().filter(|&eta| eta > 0.0).reduce(f64::min).unwrap_or(1.0);
        for eta in &mut eta {
            if *eta <= 0.0 {
                *eta = smallest;
            }
        }
        let velocity = problem.velocity_scale.unwrap_or_else(|| {
            let components = &problem.r[..3 * contacts];
            let largest = components.iter().fold(f64::MIN_POSITIVE, |largest, x| x.abs().max(largest));
            let squares = components.iter().map(|x| (x / largest).powi(2)).sum::<f64>();
            largest * (squares / contacts.max(1) as f64).sqrt()
        });
        let velocity_scale = if velocity > 0.0 && velocity.is_finite() { velocity } else { 1.0 };
        Self { problem, matrix, eta, velocity_scale }
    }

    /// Evaluates impulses `g`, N s, length of r.
    pub fn evaluate(&self, g: &[f64]) -> Evaluation {
        let contacts = self.problem.num_contacts();
        let mut velocity = self.problem.r.clone();
        let mut evaluation = Evaluation {
            velocity: Vec::new(),
            relaxed: Residual::default(),
            coulomb: Residual::default(),
            objective: 0.0,
            gap: 0.0,
            apart: 0,
            sticking: 0,
            sliding: 0,
        };
        for i in 0..contacts {
            let product = self.matrix.row_times(i, g);
            let (mu, eta) = (self.problem.friction[i], self.eta[i]);
            let impulse = [g[3 * i], g[3 * i + 1], g[3 * i + 2]];
            let turning = self.problem.turning_of(i);
            let mut turned = Turned::default();
            if let Some(k) = turning {
                let (own, first) = (self.problem.turning[k], 3 * (contacts + k));
                let product = self.matrix.row_times(contacts + k, g);
                turned.impulse = [g[first], g[first + 1], g[first + 2]];
                let w = &mut velocity[first..first + 3];
                for l in 0..3 {
                    evaluation.objective += turned.impulse[l] * (0.5 * product[l] + w[l]);
                    w[l] += product[l];
                }
                turned.velocity = [w[0], w[1], w[2]];
                turned.coefficients = [own.rolling, own.spinning];
            }
            let u = &mut velocity[3 * i..3 * i + 3];
            for k in 0..3 {
                evaluation.objective += impulse[k] * (0.5 * product[k] + u[k]);
                u[k] += product[k];
            }
            let slip = u[1].hypot(u[2]);
            let drive = mu * slip + turned.drive();
            // f64::max would lose a NaN.
            let raise = |max: &mut f64, x: f64| *max = if x.is_nan() || x > *max { x } else { *max };
            let sums = [&mut evaluation.relaxed, &mut evaluation.coulomb];
            for (sum, normal) in sums.into_iter().zip([u[0], u[0] + drive]) {
                let error = match turning {
                    None => natural_map(impulse, [normal, u[1], u[2]], mu, eta),
                    Some(_) => turned.natural_map(impulse, [normal, u[1], u[2]], mu, eta),
                };
                // As a velocity, by the contact's own effective mass. Divided before it is squared: the
                // squares of very small or large numbers are not numbers.
                let square = (eta * error / self.velocity_scale).powi(2);
                raise(&mut sum.max, square);
                sum.rms += square;
            }
            let tangential = impulse[1].hypot(impulse[2]);
            let noise = 1e-9 * self.velocity_scale / eta;
            if impulse[0] <= noise {
                evaluation.apart += 1;
            } else if tangential >= mu * impulse[0] * (1.0 - 1e-6) {
                evaluation.sliding += 1;
            } else {
                evaluation.sticking += 1;
            }
        }
        for residual in [&mut evaluation.relaxed, &mut evaluation.coulomb] {
            residual.max = residual.max.sqrt();
            residual.rms = (residual.rms / contacts.max(1) as f64).sqrt();
        }
        evaluation.gap = objective_gap(self.problem, g, &velocity);
        evaluation.velocity = velocity;
        evaluation
    }
}

/// |g - P(g - u / eta)|, N s, with P the projection on { |g_t| <= mu g_n }.
fn natural_map(g: [f64; 3], u: [f64; 3], mu: f64, eta: f64) -> f64 {
    let x = [g[0] - u[0] / eta, g[1] - u[1] / eta, g[2] - u[2] / eta];
    let tangential = x[1].hypot(x[2]);
    let projected = if x[0] >= 0.0 && tangential <= mu * x[0] {
        x
    } else {
        // The coordinate of x along the generator (1, mu) / sqrt(1 + mu^2) of the mantle; negative in the
        // polar cone.
        let along = ((x[0] + mu * tangential) / (1.0 + mu * mu)).max(0.0);
        let shrink = if tangential > 0.0 { mu * along / tangential } else { 0.0 };
        [along, shrink * x[1], shrink * x[2]]
    };
    // Impulses so large that their rounding swallows u prove nothing.
    let length = |x: [f64; 3]| x[0].hypot(x[1]).hypot(x[2]);
    let rounding = f64::EPSILON * length(g);
    let error = length(std::array::from_fn(|k| g[k] - projected[k]));
    if error < rounding { rounding } else { error }
}

/// The turning rows of one contact: (spinning, turning 1, turning 2).
#[derive(Default)]
struct Turned {
    impulse: [f64; 3],
    velocity: [f64; 3],
    /// Of rolling and of spinning.
    coefficients: [f64; 2],
}

impl Turned {
    /// What turning adds to the normal velocity of exact friction.
    fn drive(&self) -> f64 {
        let [spin, w1, w2] = self.velocity;
        self.coefficients[0] * w1.hypot(w2) + self.coefficients[1] * spin.abs()
    }

    /// |(g, h) - P((g, h) - (u, w) / eta)|, N s. The normal component of the projection is a zero of a
    /// growing function of pieces of lines, which is looked for from piece to piece.
    fn natural_map(&self, g: [f64; 3], u: [f64; 3], mu: f64, eta: f64) -> f64 {
        let moved = |g: [f64; 3], u: [f64; 3]| [g[0] - u[0] / eta, g[1] - u[1] / eta, g[2] - u[2] / eta];
        let (x, y) = (moved(g, u), moved(self.impulse, self.velocity));
        let parts = [
            (mu, x[1].hypot(x[2])),
            (self.coefficients[0], y[1].hypot(y[2])),
            (self.coefficients[1], y[0].abs()),
        ];
        // Ends of the pieces, from the largest normal component down; beyond the first no part is too long.
        let mut ends = parts.map(|(m, a)| if m > 0.0 { (a / m, m, a) } else { (0.0, 0.0, 0.0) });
        ends.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut above, mut below, mut normal) = (x[0], 1.0, x[0]);
        for (end, m, a) in ends {
            if normal >= end {
                break;
            }
            (above, below) = (above + m * a, below + m * m);
            normal = above / below;
        }
        let normal = if normal < 0.0 { 0.0 } else { normal };
        let shrink = parts.map(|(m, a)| if a > m * normal { m * normal / a } else { 1.0 });
        let errors = [
            g[0] - normal,
            g[1] - shrink[0] * x[1],
            g[2] - shrink[0] * x[2],
            self.impulse[0] - shrink[2] * y[0],
            self.impulse[1] - shrink[1] * y[1],
            self.impulse[2] - shrink[1] * y[2],
        ];
        let length = |all: &[f64]| all.iter().fold(0.0_f64, |length, x| length.hypot(*x));
        let rounding = f64::EPSILON * length(&g).hypot(length(&self.impulse));
        let error = length(&errors);
        if error < rounding { rounding } else { error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain_ccp::Delassus;

    /// One contact, N = eta I, r = (-1, 0, 0): solved by g_n = 1 / eta, and half of that has a residual of
    /// 1/2.
    #[test]
    fn impulses_at_the_ends_of_the_floats_are_distinguished_from_solutions() {
        for eta in [1e-300, 1.0, 1e300] {
            let matrix = BlockMatrix3::from_rows(
                vec![0, 1],
                vec![0],
                vec![[eta, 0.0, 0.0, 0.0, eta, 0.0, 0.0, 0.0, eta]],
            );
            let problem = Ccp::new(Delassus::Sparse(matrix), vec![-1.0, 0.0, 0.0], vec![0.5]).unwrap();
            let yardstick = Yardstick::new(&problem);
            let half = yardstick.evaluate(&[0.5 / eta, 0.0, 0.0]).relaxed.max;
            assert!((half - 0.5).abs() < 1e-12, "eta {eta:e}: {half}");
            assert!(yardstick.evaluate(&[1.0 / eta, 0.0, 0.0]).relaxed.max < 1e-12);
        }
    }
}
