//! The iterate of an interior point, its Newton directions and everything they need, allocated once per
//! solve.

use super::pair::{Pair, PairScaling, componentwise, cone_map, divide_by};
use crate::delassus::DelassusWork;
use crate::newton::system::ScaledBlocks;
use crate::newton::system::apply_blocks_in_place;
use crate::problem::Ccp;
use graintrain_linalg::block_ops::apply3;
use graintrain_linalg::block3::Block;

/// Entries of r_d below this many units of rounding (of the largest impulse or velocity, scaled) are noise
/// and no longer corrected: next to the boundary their correction would shorten every step to nothing.
const NOISE: f64 = 32.0 * f64::EPSILON;
/// Proximal term of Newton's matrix, relative to eta: steps minimise the objective plus PROXIMAL / 2 |dg|^2,
/// which bounds the condition number of stiff contacts and leaves the solution as it is.
const PROXIMAL: f64 = 1e-9;

/// Vectors of one solve, allocated once.
pub(crate) struct Work {
    pub pairs: Vec<Pair>,
    pub scalings: Vec<PairScaling>,
    /// Diagonals of T.
    t: Vec<[f64; 3]>,
    /// See [`PROXIMAL`] and [`NOISE`].
    pub proximal: f64,
    pub noise: f64,
    /// Compliance relative to eta, and the diagonal that it adds to N.
    compliance: f64,
    give: Vec<[f64; 3]>,
    added: Vec<Block>,
    factor: Vec<Block>,
    factor_inverse: Vec<Block>,
    to_step: Vec<Block>,
    to_scaled: Vec<Block>,
    pub g: Vec<f64>,
    /// N g (with compliance).
    pub ng: Vec<f64>,
    product: DelassusWork,
    pub residual_dual: Vec<f64>,
    rhs: Vec<f64>,
    /// The scaled unknown z = F^-1 dg.
    z: Vec<f64>,
    /// q of the last right-hand side, per contact.
    q: Vec<[f64; 3]>,
    /// W^-1 dx and W ds.
    pub scaled_dx: Vec<[f64; 3]>,
    pub scaled_ds: Vec<[f64; 3]>,
    /// d_c of the direction taken, and of the one that a corrector tries.
    pub complementarity: [Vec<[f64; 3]>; 2],
    /// z, q, W^-1 dx and W ds while a corrector is tried.
    saved: (Vec<f64>, [Vec<[f64; 3]>; 3]),
}

impl Work {
    /// For a scaled problem (trace N_ii = 3) with some compliance, relative to eta, added to N.
    pub fn new(problem: &Ccp, compliance: f64) -> Self {
        let contacts = problem.num_contacts();
        let size = 3 * contacts;
        let line = PairScaling::Line { w: 1.0, lambda: 1.0 };
        let t: Vec<[f64; 3]> = problem.friction.iter().map(|&mu| cone_map(mu)).collect();
        // In the metric of the cone coordinates, compliance T_n^2 T^-2, so that it only adds to delta.
        let give = |t: &[f64; 3]| t.map(|x| if x > 0.0 { compliance * (t[0] / x).powi(2) } else { 0.0 });
        Self {
            pairs: vec![Pair::Line { x: 1.0, s: 1.0 }; contacts],
            scalings: vec![line; contacts],
            proximal: PROXIMAL,
            noise: NOISE,
            compliance,
            give: t.iter().map(give).collect(),
            t,
            added: vec![[0.0; 9]; contacts],
            factor: vec![[0.0; 9]; contacts],
            factor_inverse: vec![[0.0; 9]; contacts],
            to_step: vec![[0.0; 9]; contacts],
            to_scaled: vec![[0.0; 9]; contacts],
            g: vec![0.0; size],
            ng: vec![0.0; size],
            product: problem.delassus.work(),
            residual_dual: vec![0.0; size],
            rhs: vec![0.0; size],
            z: vec![0.0; size],
            q: vec![[0.0; 3]; contacts],
            scaled_dx: vec![[0.0; 3]; contacts],
            scaled_ds: vec![[0.0; 3]; contacts],
            complementarity: [vec![[0.0; 3]; contacts], vec![[0.0; 3]; contacts]],
            saved: (vec![0.0; size], std::array::from_fn(|_| vec![[0.0; 3]; contacts])),
        }
    }

    /// Keeps the direction; what is in its place afterwards has to be overwritten.
    pub fn save_direction(&mut self) {
        self.exchange_direction();
        // The linear solver may start from the last solution.
        self.z.copy_from_slice(&self.saved.0);
    }

    /// Exchanges the direction and the one kept.
    pub fn exchange_direction(&mut self) {
        let (z, [q, dx, ds]) = &mut self.saved;
        std::mem::swap(z, &mut self.z);
        std::mem::swap(q, &mut self.q);
        std::mem::swap(dx, &mut self.scaled_dx);
        std::mem::swap(ds, &mut self.scaled_ds);
    }

    pub fn contacts(&self) -> usize {
        self.pairs.len()
    }

    /// N g of the impulses, with compliance.
    pub fn multiply(&mut self, problem: &Ccp) {
        problem.delassus.multiply(&self.g, &mut self.ng, &mut self.product);
        for ((ng, g), give) in self.ng.iter_mut().zip(&self.g).zip(self.give.as_flattened()) {
            *ng += give * g;
        }
    }

    /// Projects the impulses on their cones.
    pub fn project(&mut self, problem: &Ccp) {
        for (i, g) in self.g.chunks_exact_mut(3).enumerate() {
            let inside = problem.cone(i).project([g[0], g[1], g[2]]);
            g.copy_from_slice(&inside);
        }
    }

    /// (sum over contacts of |g - P(g - u)|^2 / N_c)^(1/2), u = N g + r: how far impulses are from the
    /// solution.
    pub fn distance(&self, problem: &Ccp, r: &[f64]) -> f64 {
        let mut square = 0.0;
        for i in 0..self.contacts() {
            let at = std::array::from_fn(|k| self.g[3 * i + k] - self.ng[3 * i + k] - r[3 * i + k]);
            let image = problem.cone(i).project(at);
            square += (0..3).map(|k| (self.g[3 * i + k] - image[k]).powi(2)).sum::<f64>();
        }
        (square / self.contacts() as f64).sqrt()
    }

    /// The pairs at the smoothed projection of g - u, u = N g + r: centred, x o s = barrier e, whatever g is.
    pub fn start(&mut self, problem: &Ccp, r: &[f64], barrier: f64) {
        for i in 0..self.contacts() {
            let t = self.t[i];
            let z = std::array::from_fn(|k| {
                let (g, u) = (self.g[3 * i + k], self.ng[3 * i + k] + r[3 * i + k]);
                if t[k] > 0.0 { g / t[k] - u * t[k] } else { 0.0 }
            });
            self.pairs[i] = Pair::start(problem.friction[i], z, barrier);
        }
    }

    /// The scalings of the pairs and the blocks of Newton's matrix.
    pub fn update_blocks(&mut self) {
        for i in 0..self.contacts() {
            self.scalings[i] = self.pairs[i].scaling();
            let blocks = self.scalings[i].blocks(self.t[i], self.proximal + self.compliance);
            self.added[i] = blocks.added;
            self.factor[i] = blocks.factor;
            self.factor_inverse[i] = blocks.factor_inverse;
            self.to_step[i] = blocks.to_step;
            self.to_scaled[i] = blocks.to_scaled;
        }
    }

    /// z from the right-hand side by `solve`, then W^-1 dx and W ds.
    pub fn solve(&mut self, mut solve: impl FnMut(ScaledBlocks<'_>, &[f64], &mut [f64])) {
        let Self { added, factor, factor_inverse, rhs, z, .. } = self;
        solve(ScaledBlocks { added, factor, factor_inverse }, rhs, z);
        self.scaled_directions();
    }

    pub fn blocks(&self) -> ScaledBlocks<'_> {
        ScaledBlocks { added: &self.added, factor: &self.factor, factor_inverse: &self.factor_inverse }
    }

    /// g = T x.
    pub fn impulses_from_pairs(&mut self) {
        for (i, pair) in self.pairs.iter().enumerate() {
            self.g[3 * i..3 * i + 3].copy_from_slice(&componentwise(self.t[i], pair.vectors().0));
        }
    }

    /// r_d = N g + r - y with y = T^-1 s; the tangential velocity of a frictionless contact is free.
    pub fn update_dual_residual(&mut self, r: &[f64]) {
        let largest = |v: &[f64]| v.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let noise = self.noise * (largest(&self.g) + largest(r));
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
    pub fn barrier(&self) -> f64 {
        self.pairs.iter().map(Pair::complementarity).sum::<f64>() / self.contacts() as f64
    }

    /// Right-hand side F^T (-(1 - sigma) r_d) + C q with lambda o q = -d_c.
    /// d_c is given the contact and its lambda.
    pub fn right_hand_side(
        &mut self,
        dual_factor: f64,
        complementarity: impl Fn(usize, [f64; 3]) -> [f64; 3],
    ) {
        for i in 0..self.contacts() {
            let defect = complementarity(i, self.scalings[i].lambda());
            self.q[i] = self.scalings[i].divide(defect.map(|x| -x));
        }
        self.combine_right_hand_side(dual_factor);
    }

    /// The right-hand side of the predictor, d_c = lambda o lambda: q = -lambda.
    pub fn affine_right_hand_side(&mut self) {
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
    pub fn longest_step(&self) -> f64 {
        let mut alpha = f64::INFINITY;
        for (scaling, (dx, ds)) in self.scalings.iter().zip(self.scaled_dx.iter().zip(&self.scaled_ds)) {
            alpha = alpha.min(scaling.longest_step(*dx)).min(scaling.longest_step(*ds));
        }
        alpha
    }

    /// Mean of x^T s after a step.
    pub fn barrier_after(&self, alpha: f64) -> f64 {
        let mut sum = 0.0;
        for (scaling, (dx, ds)) in self.scalings.iter().zip(self.scaled_dx.iter().zip(&self.scaled_ds)) {
            let l = scaling.lambda();
            sum += (0..3).map(|k| (l[k] + alpha * dx[k]) * (l[k] + alpha * ds[k])).sum::<f64>();
        }
        sum / self.contacts() as f64
    }

    pub fn advance(&mut self, alpha: f64) {
        for i in 0..self.contacts() {
            let z = [self.z[3 * i], self.z[3 * i + 1], self.z[3 * i + 2]];
            let dx = apply3(&self.to_step[i], z);
            let ds = self.scalings[i].inverse_times(self.scaled_ds[i]);
            self.pairs[i].advance(alpha, dx, ds);
        }
    }
}
