//! Candidates for a proof that a problem has no solution, and how much each of them proves.

use crate::delassus::{Delassus, RigidDelassus};
use crate::problem::Ccp;
use graintrain_linalg::block3::BlockMatrix3;
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, conjugate_gradient};
use graintrain_linalg::parallel::dot;

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// V, in units of the largest |r_i|, from which on there is no solution.
pub const CERTAIN: f64 = 1e6;
/// V from which on there is none where a solver has failed as well.
pub const PROBABLE: f64 = 1e4;
/// Impulses, in units of V / eta, that no solution of a problem without bodies can have.
const FIRM: f64 = 1e-6;
/// Conjugate gradients for d: iterations, and the part of N g that may be left.
const ITERATIONS: usize = 200;
const LEFT: f64 = 1e-6;
/// A problem that is solved to this residual is not said to have no solution.
pub(crate) const GOOD_ENOUGH: f64 = 1e-7;

/// Impulses in the cones, N s, and the V / max_i |r_i| that they prove.
#[derive(Clone, Debug, Default)]
pub struct Certificate {
    /// g_i in Y_i with D g = 0, nearly, and r^T g < 0; of any size.
    pub ray: Vec<f64>,
    /// V / max_i |r_i|; 0 where nothing is proved.
    pub needed_velocity: f64,
    /// Impulses that solve the problem, N s, as far as the search knows and where there are any; not checked.
    pub solution: Option<Vec<f64>>,
}

/// Evaluates candidates for a certificate of one problem; its memory is allocated once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evaluator {
    /// eta of every block row.
    eta: Vec<f64>,
    ray: Vec<f64>,
    image: Vec<f64>,
    /// d of a problem without bodies, and N d.
    change: [Vec<f64>; 2],
    krylov: KrylovWork,
}

impl Evaluator {
    pub fn new(problem: &Ccp) -> Self {
        let zeros = || vec![0.0; problem.r.len()];
        let of_contacts = problem.diagonal_scale();
        let of_turning = problem.turning.iter().map(|turning| of_contacts[turning.contact as usize]);
        let eta = of_contacts.iter().copied().chain(of_turning).collect();
        let change = [zeros(), zeros()];
        Self { eta, ray: zeros(), image: zeros(), change, krylov: KrylovWork::default() }
    }

    /// V / max_i |r_i| for the projection of `g` on the cones: the velocity that any solution needs; 0 where
    /// `g` proves nothing.
    pub fn needed_velocity(&mut self, problem: &Ccp, g: &[f64]) -> f64 {
        let size = g.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        let largest = problem.r.chunks_exact(3).map(norm).fold(0.0, f64::max);
        if !(size > 0.0 && size.is_finite() && largest > 0.0) {
            return 0.0;
        }
        self.ray.iter_mut().zip(g).for_each(|(ray, g)| *ray = g / size);
        problem.project(&mut self.ray);
        for (k, ray) in self.ray.iter_mut().enumerate() {
            // Rounding of the projection must not leave it outside.
            if k >= 3 * problem.num_contacts() || !k.is_multiple_of(3) {
                *ray *= 1.0 - 4.0 * f64::EPSILON;
            }
        }
        let terms: f64 = self.ray.iter().zip(&problem.r).map(|(ray, r)| (ray * r).abs()).sum();
        let asked = -dot(&problem.r, &self.ray) - f64::EPSILON * self.ray.len() as f64 * terms;
        if asked.is_nan() || asked <= 0.0 {
            return 0.0;
        }
        let moved = match &*problem.delassus {
            Delassus::Rigid(rigid) => {
                rigid.world_impulse(&self.ray, &mut self.image);
                moved_bodies(rigid, &self.image)
            }
            Delassus::Sparse(matrix) => self.moved_rows(matrix),
        };
        asked / moved / largest
    }

    /// sum_i ( |d_i| + |(N g - N d)_i| / (FIRM eta_i) ) with bounds of the rounding errors, d by conjugate
    /// gradients. Of a matrix that is not symmetric the rows of the transpose count.
    fn moved_rows(&mut self, matrix: &BlockMatrix3) -> f64 {
        let Self { eta, ray, image, change: [d, product], krylov } = self;
        let over_eta = |x: &[f64]| x.chunks_exact(3).zip(&*eta).map(|(x, eta)| norm(x) / eta).sum::<f64>();
        let rounding = transposed_times(matrix, eta, ray, image);
        // What is left of N g beside rounding is in the range of N, the rest is not.
        let relative_tolerance = (rounding / over_eta(image)).max(LEFT);
        d.fill(0.0);
        conjugate_gradient(
            &mut |x, y| {
                transposed_times(matrix, eta, x, y);
            },
            &mut |x, y| y.iter_mut().zip(x).enumerate().for_each(|(k, (y, x))| *y = x / eta[k / 3]),
            image,
            d,
            KrylovSettings { relative_tolerance, max_iterations: ITERATIONS },
            krylov,
        );
        let rounding = rounding + transposed_times(matrix, eta, d, product);
        product.iter_mut().zip(&*image).for_each(|(product, image)| *product -= *image);
        d.chunks_exact(3).map(norm).sum::<f64>() + (over_eta(product) + rounding) / FIRM
    }
}

/// y <- N^T x; the sum of bounds of its rounding errors over eta.
fn transposed_times(matrix: &BlockMatrix3, eta: &[f64], x: &[f64], y: &mut [f64]) -> f64 {
    y.fill(0.0);
    let mut rounding = 0.0;
    for (i, j, block) in matrix.iter() {
        for e in 0..9 {
            y[3 * j + e % 3] += block[e] * x[3 * i + e / 3];
        }
        let entries = matrix.row_starts()[j + 1] - matrix.row_starts()[j];
        rounding += (3 * entries) as f64 * norm(&block) * norm(&x[3 * i..3 * i + 3]) / eta[j];
    }
    f64::EPSILON * rounding
}

/// sum_b ( |f_b| + |m_b| / L_b ) over what is free to move, with bounds of the rounding errors, of impulses
/// in world axes.
fn moved_bodies(rigid: &RigidDelassus, world_impulse: &[f64]) -> f64 {
    let at =
        |block: usize| <[f64; 3]>::try_from(&world_impulse[3 * block..3 * block + 3]).unwrap_or_default();
    let mut sum = 0.0;
    for (body, inverse) in rigid.inverse_mass().iter().enumerate() {
        let [x, y, z, mx, my, mz] = rigid.body_impulse(world_impulse, body);
        let (mut force, mut moment) = ([x, y, z], [mx, my, mz]);
        let (mut arm, mut forces, mut moments) = (0.0_f64, 0.0, 0.0);
        for side in rigid.sides(body) {
            arm = arm.max(norm(&side.arm));
            forces += norm(&at(side.contact as usize));
        }
        for &(k, _) in rigid.turning_sides(body) {
            arm = arm.max(rigid.turning()[k as usize].length);
            moments += norm(&at(rigid.num_contacts() + k as usize));
        }
        for axis in 0..3 {
            if inverse.linear[axis] == 0.0 {
                force[axis] = 0.0;
            }
            if inverse.angular[3 * axis..3 * axis + 3].iter().all(|&x| x == 0.0) {
                moment[axis] = 0.0;
            }
        }
        let over_arm = |moment: f64| if arm > 0.0 { moment / arm } else { 0.0 };
        let terms = (8 + rigid.sides(body).len() + rigid.turning_sides(body).len()) as f64;
        let rounding = f64::EPSILON * terms * (forces + over_arm(moments));
        sum += norm(&force) + over_arm(norm(&moment)) + 2.0 * rounding;
    }
    sum
}
