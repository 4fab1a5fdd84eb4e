//! Candidates for a proof that a problem has no solution, and how much each of them proves.

use crate::delassus::{Delassus, DelassusWork, RigidDelassus, cross};
use crate::problem::Ccp;
use graintrain_linalg::parallel::dot;

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// V, in units of the largest |r_i|, from which on there is no solution.
pub const CERTAIN: f64 = 1e6;
/// V from which on there is none where a solver has failed as well.
pub const PROBABLE: f64 = 1e4;
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

/// Evaluators candidates for a certificate of one problem; its memory is allocated once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evaluator {
    eta: Vec<f64>,
    ray: Vec<f64>,
    image: Vec<f64>,
    work: DelassusWork,
}

impl Evaluator {
    pub fn new(problem: &Ccp) -> Self {
        let zeros = vec![0.0; 3 * problem.num_contacts()];
        Self {
            eta: problem.diagonal_scale(),
            ray: zeros.clone(),
            image: zeros,
            work: problem.delassus.work(),
        }
    }

    /// V / max_i |r_i| for the projection of `g` on the cones: the velocity that any solution needs; 0 where
    /// `g` proves nothing.
    pub fn needed_velocity(&mut self, problem: &Ccp, g: &[f64]) -> f64 {
        let size = g.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        let largest = problem.r.chunks_exact(3).map(norm).fold(0.0, f64::max);
        if !(size > 0.0 && size.is_finite() && largest > 0.0) {
            return 0.0;
        }
        let mut terms = 0.0;
        for i in 0..problem.num_contacts() {
            let [normal, t1, t2] = problem.cone(i).project(std::array::from_fn(|k| g[3 * i + k] / size));
            // Rounding of the projection must not leave it outside.
            let inside = 1.0 - 4.0 * f64::EPSILON;
            self.ray[3 * i..3 * i + 3].copy_from_slice(&[normal, inside * t1, inside * t2]);
            terms += (0..3).map(|k| (self.ray[3 * i + k] * problem.r[3 * i + k]).abs()).sum::<f64>();
        }
        let asked = -dot(&problem.r, &self.ray) - f64::EPSILON * self.ray.len() as f64 * terms;
        let moved = match &*problem.delassus {
            Delassus::Rigid(rigid) => {
                rigid.world_impulse(&self.ray, &mut self.image);
                moved_bodies(rigid, &self.image)
            }
            Delassus::Sparse(matrix) => {
                problem.delassus.multiply(&self.ray, &mut self.image, &mut self.work);
                let mut sum = 0.0;
                for i in 0..problem.num_contacts() {
                    let entries = matrix.row_starts()[i]..matrix.row_starts()[i + 1];
                    let terms: f64 = entries
                        .clone()
                        .map(|k| {
                            let j = 3 * matrix.columns()[k] as usize;
                            norm(&matrix.blocks()[k]) * norm(&self.ray[j..j + 3])
                        })
                        .sum();
                    let rounding = f64::EPSILON * (3 * entries.len()) as f64 * terms;
                    sum += (norm(&self.image[3 * i..3 * i + 3]) + rounding) / self.eta[i];
                }
                sum
            }
        };
        if asked > 0.0 { asked / moved / largest } else { 0.0 }
    }
}

/// sum_b ( |f_b| + |m_b| / L_b ) over what is free to move, with bounds of the rounding errors, of impulses
/// in world axes.
fn moved_bodies(rigid: &RigidDelassus, world_impulse: &[f64]) -> f64 {
    let mut sum = 0.0;
    for (body, inverse) in rigid.inverse_mass().iter().enumerate() {
        let (mut force, mut moment, mut arm, mut terms) = ([0.0; 3], [0.0; 3], 0.0_f64, 0.0);
        for side in rigid.sides(body) {
            let k = 3 * side.contact as usize;
            let p: [f64; 3] = std::array::from_fn(|axis| side.sign * world_impulse[k + axis]);
            let m = cross(side.arm, p);
            for axis in 0..3 {
                force[axis] += p[axis];
                moment[axis] += m[axis];
            }
            arm = arm.max(norm(&side.arm));
            terms += norm(&p);
        }
        for axis in 0..3 {
            if inverse.linear[axis] == 0.0 {
                force[axis] = 0.0;
            }
            if inverse.angular[3 * axis..3 * axis + 3].iter().all(|&x| x == 0.0) {
                moment[axis] = 0.0;
            }
        }
        let rotation = if arm > 0.0 { norm(&moment) / arm } else { 0.0 };
        let rounding = f64::EPSILON * (8 + rigid.sides(body).len()) as f64 * terms;
        sum += norm(&force) + rotation + 2.0 * rounding;
    }
    sum
}
