//! The scaled problem, its iterate and Newton's direction.

use super::contact::Constraints;
use crate::delassus::DelassusWork;
use crate::newton::NewtonError;
use crate::newton::driver::NewtonDriver;
use crate::newton::system::{ScaledBlocks, apply_blocks, apply_blocks_in_place};
use crate::problem::Ccp;
use crate::residual::ResidualScale;
use crate::solver::infeasible;
use graintrain_linalg::block3::Block;
use graintrain_linalg::parallel::dot;
use graintrain_linalg::real;

/// Smallest mu used: with mu = 0 the cone has no interior. The error is a tangential impulse of this size.
const SMALLEST_FRICTION: f64 = 1e-7;

/// A scaled problem with an iterate, and the memory that Newton's method needs.
///
/// ```text
/// g_i = c x_i / e_i,   u_i = c e_i u'_i,   N' = E^-1 N E^-1,   e_i = sqrt(eta_i),   c = V sqrt(mean 1/eta)
/// ```
///
/// One factor per contact leaves cones as they are and makes trace(N'_ii) = 3 however different the masses
/// are.
pub(super) struct Iterate<'a> {
    problem: &'a Ccp,
    pub(super) friction: Vec<f64>,
    /// c; e_i.
    size: f64,
    root: Vec<f64>,
    /// x: impulses, strictly inside their cones.
    pub(super) g: Vec<f64>,
    /// Weight of the proximal term 1/2 proximal |x_n - anchor|^2, and its centre.
    pub(super) proximal: f64,
    pub(super) anchor: Vec<f64>,
    /// Multipliers, two per contact, positive.
    pub(super) lambda: Vec<f64>,
    /// u' = N' x + r'.
    pub(super) u: Vec<f64>,
    product: DelassusWork,
    added: Vec<Block>,
    factor: Vec<Block>,
    factor_inverse: Vec<Block>,
    gradient: Vec<[f64; 2]>,
    /// Vectors in the problem's own units, divided by c.
    image: Vec<f64>,
    rhs: Vec<f64>,
    z: Vec<f64>,
}

/// Newton's direction.
pub(super) struct Direction {
    pub(super) g: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    /// N' dx.
    pub(super) u: Vec<f64>,
    /// dx^T rhs with Newton's right-hand side: the negative slope of the barrier function along dx.
    pub(super) decrease: f64,
}

impl Direction {
    pub(super) fn new(contacts: usize) -> Self {
        let zero = |n| vec![0.0; n * contacts];
        Self { g: zero(3), lambda: zero(2), u: zero(3), decrease: 0.0 }
    }
}

impl<'a> Iterate<'a> {
    /// Starts from normal impulses x_n (given the unit of impulse, N s, of a contact) without tangential
    /// ones, lambda = barrier / -f where `barrier` is given the mean of |x| |u'| over contacts.
    pub(super) fn new(
        problem: &'a Ccp,
        scale: &ResidualScale,
        proximal: f64,
        normal: impl Fn(usize, f64) -> f64,
        barrier: impl FnOnce(f64) -> f64,
    ) -> Self {
        let contacts = problem.num_contacts();
        let zero = |n| vec![0.0; n * contacts];
        let mut it = Self {
            problem,
            friction: problem.friction.iter().map(|mu| mu.max(SMALLEST_FRICTION)).collect(),
            size: scale.size(),
            root: scale.eta.iter().map(|eta| eta.sqrt()).collect(),
            image: zero(3),
            g: zero(3),
            proximal,
            anchor: zero(1),
            lambda: zero(2),
            u: zero(3),
            product: problem.delassus.work(),
            added: vec![[0.0; 9]; contacts],
            factor: vec![[0.0; 9]; contacts],
            factor_inverse: vec![[0.0; 9]; contacts],
            gradient: vec![[0.0; 2]; contacts],
            rhs: zero(3),
            z: zero(3),
        };
        for i in 0..contacts {
            it.g[3 * i] = normal(i, it.size / it.root[i]);
        }
        it.move_anchor();
        it.refresh_velocity();
        let speed = |i: usize| real::hypot(real::hypot(it.u[3 * i], it.u[3 * i + 1]), it.u[3 * i + 2]);
        let mean = (0..contacts).map(|i| it.g[3 * i] * speed(i)).sum::<f64>() / contacts.max(1) as f64;
        let barrier = barrier(mean);
        for i in 0..contacts {
            let f = it.constraints(i).f;
            for k in 0..2 {
                it.lambda[2 * i + k] = -barrier / f[k];
            }
        }
        it
    }

    pub(super) fn num_contacts(&self) -> usize {
        self.friction.len()
    }

    pub(super) fn constraints(&self, i: usize) -> Constraints {
        Constraints::new(self.friction[i], &self.g[3 * i..3 * i + 3])
    }

    /// The proximal term is centred at the current impulses from now on.
    pub(super) fn move_anchor(&mut self) {
        for (i, anchor) in self.anchor.iter_mut().enumerate() {
            *anchor = self.g[3 * i];
        }
    }

    /// u' <- N' x + r' from scratch.
    pub(super) fn refresh_velocity(&mut self) {
        for (k, image) in self.image.iter_mut().enumerate() {
            *image = self.g[k] / self.root[k / 3];
        }
        self.problem.delassus.multiply(&self.image, &mut self.u, &mut self.product);
        for (k, u) in self.u.iter_mut().enumerate() {
            *u = (*u + self.problem.r[k] / self.size) / self.root[k / 3];
        }
    }

    /// g and u in the problem's own units.
    pub(super) fn physical(&self, g: &mut [f64], u: &mut [f64]) {
        for k in 0..g.len() {
            g[k] = self.size * self.g[k] / self.root[k / 3];
            u[k] = self.size * self.u[k] * self.root[k / 3];
        }
    }

    /// Mean of -lambda_k f_k.
    pub(super) fn mean_complementarity(&self) -> f64 {
        let sum: f64 = (0..self.num_contacts())
            .map(|i| {
                let f = self.constraints(i).f;
                -f[0] * self.lambda[2 * i] - f[1] * self.lambda[2 * i + 1]
            })
            .sum();
        sum / (2 * self.num_contacts()) as f64
    }

    /// Whether the impulses grow out of proportion, as where there is no solution.
    pub(super) fn runs_away(&self) -> bool {
        let (mut along, mut energy, mut free) = (0.0, 0.0, 0.0);
        for (k, (g, u)) in self.g.iter().zip(&self.u).enumerate() {
            let r = self.problem.r[k] / self.size / self.root[k / 3];
            along += r * g;
            energy += g * (u - r);
            free += r * r;
        }
        infeasible::is_suspicious(along, energy, free)
    }

    /// Newton's matrix and right-hand side for r_c = -lambda f - barrier.
    pub(super) fn refresh(
        &mut self,
        newton: &mut NewtonDriver,
        barrier: f64,
        iteration: usize,
        residual: f64,
    ) -> Result<(), NewtonError> {
        for i in 0..self.num_contacts() {
            let constraints = self.constraints(i);
            let (g, lambda) = (&self.g[3 * i..3 * i + 3], &self.lambda[2 * i..2 * i + 2]);
            let blocks = constraints.newton_blocks(self.friction[i], g, lambda, self.proximal);
            // H in units of N; F^T N F is then without units, and z that of the scaled problem.
            let root = self.root[i];
            self.added[i] = blocks.added.map(|x| x * root * root);
            self.factor[i] = blocks.factor.map(|x| x / root);
            self.factor_inverse[i] = blocks.factor_inverse.map(|x| x * root);
            self.gradient[i] = blocks.gradient;
            // -r_d + sum_k grad f_k r_c,k / (-f_k), with r_c,k / (-f_k) = lambda_k + barrier / f_k: lambda
            // cancels.
            let mut push = constraints.combine(constraints.f.map(|f| barrier / f));
            push[0] -= self.proximal * (self.g[3 * i] - self.anchor[i]);
            for k in 0..3 {
                self.rhs[3 * i + k] = root * (push[k] - self.u[3 * i + k]);
            }
        }
        apply_blocks_in_place(&self.factor, &mut self.rhs, true);
        let Self { added, factor, factor_inverse, .. } = &*self;
        newton.refresh(self.problem, ScaledBlocks { added, factor, factor_inverse }, iteration, residual)
    }

    /// Newton's direction for the matrix of the last [`Self::refresh`].
    pub(super) fn direction(
        &mut self,
        newton: &mut NewtonDriver,
        barrier: f64,
        tolerance: f64,
        direction: &mut Direction,
    ) {
        let Self { problem, added, factor, factor_inverse, rhs, z, product, image, root, .. } = self;
        newton.solve(problem, ScaledBlocks { added, factor, factor_inverse }, rhs, z, tolerance);
        direction.decrease = dot(rhs, z);
        apply_blocks(factor, z, image, false);
        problem.delassus.multiply(image, &mut direction.u, product);
        for (k, image) in image.iter().enumerate() {
            direction.g[k] = image * root[k / 3];
            direction.u[k] /= root[k / 3];
        }
        for i in 0..self.num_contacts() {
            let f = self.constraints(i).f;
            let cone = self.gradient[i][0] * self.z[3 * i] + self.gradient[i][1] * self.z[3 * i + 1];
            let along = [cone, -direction.g[3 * i]];
            for k in 0..2 {
                let lambda = self.lambda[2 * i + k];
                direction.lambda[2 * i + k] = -lambda - barrier / f[k] - lambda * along[k] / f[k];
            }
        }
    }

    /// g <- g + step dg with the velocities that belong to it.
    pub(super) fn advance_impulses(&mut self, step: f64, direction: &Direction) {
        for (g, d) in self.g.iter_mut().zip(&direction.g) {
            *g += step * d;
        }
        for (u, d) in self.u.iter_mut().zip(&direction.u) {
            *u += step * d;
        }
    }

    /// lambda <- lambda + step dlambda.
    pub(super) fn advance_multipliers(&mut self, step: f64, direction: &Direction) {
        for (lambda, d) in self.lambda.iter_mut().zip(&direction.lambda) {
            *lambda += step * d;
        }
    }

    /// Longest step, at most 1, that keeps lambda + step dlambda at least (1 - fraction) lambda.
    pub(super) fn longest_for_multipliers(&self, fraction: f64, direction: &Direction) -> f64 {
        let mut longest = 1.0_f64;
        for (lambda, change) in self.lambda.iter().zip(&direction.lambda) {
            if *change < 0.0 {
                longest = longest.min(-fraction * lambda / change);
            }
        }
        longest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::delassus::Delassus;
    use crate::newton::direct::Direct;
    use graintrain_linalg::block3::BlockMatrix3;

    /// Two coupled contacts, away from the central path: r_d and r_c are linear along the direction and
    /// vanish at its end.
    #[test]
    fn the_direction_solves_the_linearised_optimality_conditions() {
        let block = [2.0, 0.3, -0.1, 0.3, 3.0, 0.2, -0.1, 0.2, 1.5];
        let across = [0.4, -0.2, 0.1, 0.3, 0.5, -0.4, 0.0, 0.2, 0.3];
        let transposed = std::array::from_fn(|e| across[3 * (e % 3) + e / 3]);
        let matrix =
            BlockMatrix3::from_rows(vec![0, 2, 4], vec![0, 1, 0, 1], vec![block, across, transposed, block]);
        let r = vec![-1.0, 0.4, 0.1, -0.5, 0.0, -0.3];
        let problem = Ccp::new(Delassus::Sparse(matrix), r, vec![0.4, 0.7]).unwrap();
        let scale = ResidualScale::new(&problem);
        let barrier = 0.02;
        let mut it = Iterate::new(&problem, &scale, 0.0, |i, _| 1.0 + i as f64, |_| barrier);
        it.g.copy_from_slice(&[1.2, 0.3, -0.2, 0.8, -0.1, 0.4]);
        it.lambda.copy_from_slice(&[0.7, 0.2, 0.3, 0.9]);
        it.refresh_velocity();
        let mut newton = NewtonDriver::new(Box::new(Direct::default()));
        newton.begin(&problem);
        it.refresh(&mut newton, barrier, 0, 0.0).unwrap();
        let mut d = Direction::new(2);
        it.direction(&mut newton, barrier, 1e-14, &mut d);
        assert!(d.g.iter().any(|x| x.abs() > 1e-2));
        // The velocities that belong to the step, from scratch.
        let mut moved = Iterate::new(&problem, &scale, 0.0, |_, _| 1.0, |_| barrier);
        for k in 0..6 {
            moved.g[k] = it.g[k] + d.g[k];
        }
        moved.refresh_velocity();
        for i in 0..2 {
            let (g, dg) = (&it.g[3 * i..3 * i + 3], &d.g[3 * i..3 * i + 3]);
            let (l, dl) = (&it.lambda[2 * i..2 * i + 2], &d.lambda[2 * i..2 * i + 2]);
            let m = problem.friction[i] * problem.friction[i];
            let f = [0.5 * (g[1] * g[1] + g[2] * g[2] - m * g[0] * g[0]), -g[0]];
            let gradient = [[-m * g[0], g[1], g[2]], [-1.0, 0.0, 0.0]];
            let hessian = [-m, 1.0, 1.0];
            for k in 0..3 {
                let push: f64 = (0..2).map(|c| (l[c] + dl[c]) * gradient[c][k]).sum();
                let dual = moved.u[3 * i + k] + push + l[0] * hessian[k] * dg[k];
                assert!(dual.abs() < 1e-12, "contact {i}, row {k}: {dual:e}");
            }
            for c in 0..2 {
                let along: f64 = (0..3).map(|k| gradient[c][k] * dg[k]).sum();
                let complementarity = -l[c] * f[c] - barrier - dl[c] * f[c] - l[c] * along;
                assert!(complementarity.abs() < 1e-12, "contact {i}, f_{c}: {complementarity:e}");
            }
        }
    }
}
