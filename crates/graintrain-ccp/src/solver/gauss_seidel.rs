//! `pgs`: projected Gauss-Seidel with over-relaxation (SOR).
//!
//! Sources: A. Tasora, M. Anitescu, "A matrix-free cone complementarity approach for solving large-scale,
//! nonsmooth, rigid body dynamics", Computer Methods in Applied Mechanics and Engineering 200:439-453, 2011;
//! for exact friction J. J. Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988,
//! and M. Jean, "The non-smooth contact dynamics method", Computer Methods in Applied Mechanics and
//! Engineering 177:235-257, 1999.

use super::first_order::{FirstOrderMethod, Iterate};
use super::lanes::{Batch, LANES, Lanes, Numbers, Vector, dot, scale, sub, tangential_length};
use super::scaling::{ContactBatch, Relaxation, ScaledProblem, TurningBatch};
use super::single::SingleIterate;
use graintrain_linalg::block3::Block;
use graintrain_linalg::real;

/// Projected Gauss-Seidel on the scaled problem: contacts one after the other,
///
/// ```text
/// x_i <- P_i( x_i - omega u_i / lambda_i ),   u_i = (N' x + r')_i with the newest x,   lambda_i = largest eigenvalue of N'_ii
/// ```
///
/// The objective falls at every contact for 0 < omega < 2. For exact Coulomb friction the normal impulse
/// comes first, and the tangential one is projected on the disc that it allows:
///
/// ```text
/// x_n <- max(0, x_n - omega u_n / lambda_i),   x_t <- projection of x_t - omega u_t / lambda_i on |x_t| <= mu' x_n
/// ```
///
/// whose fixed points are the solutions of the exact problem (no shift of the normal velocity is needed:
/// impulse and velocity are not looked for in dual cones). For balls N'_ii is the unit matrix and both are
/// the exact solution of the contact's own problem.
///
/// Over bodies the velocities v = M^-1 D g change with every contact, so that a sweep moves as much memory as
/// a product with N; with a sparse N a sweep is one pass over its rows. Contacts that share no body are
/// computed eight at a time; the result is that of one after the other in the order in which they are packed,
/// on one thread: it does not depend on threads.
#[derive(Clone, Debug)]
pub struct GaussSeidel {
    /// Over-relaxation omega in (0, 2); default 1. `pgs@1.3` on the command line.
    pub relaxation: f64,
}

impl Default for GaussSeidel {
    fn default() -> Self {
        Self { relaxation: 1.0 }
    }
}

/// omega / lambda_i per contact.
pub(super) struct Steps {
    step: Vec<Lanes>,
}

impl Steps {
    /// With this omega.
    pub(super) fn of(scaled: &ScaledProblem, relaxation: f64) -> Self {
        let mut step = vec![Lanes::default(); scaled.num_batches()];
        for place in 0..scaled.num_places() {
            let (batch, lane) = (place / LANES, place % LANES);
            let mut largest = largest_eigenvalue(&scaled.diagonal_block(place));
            if scaled.is_turning(batch + 1) {
                // At least the largest eigenvalue of all six rows of a contact that resists turning.
                largest += largest_eigenvalue(&scaled.diagonal_block(place + LANES));
            }
            step[batch].0[lane] = relaxation * step_for(largest);
        }
        Self { step }
    }
}

/// 1 / lambda.
fn step_for(largest: f64) -> f64 {
    // A contact between immovable bodies: any positive step leads to its solution or to infinity.
    if largest > 0.0 { largest.recip() } else { 1.0 }
}

/// 1 / lambda of N'_ii.
pub(super) fn step_of_block(block: &Block) -> f64 {
    step_for(largest_eigenvalue(block))
}

/// Takes new impulses in the place of y where `moves` is 1, x in that of the x before; adds |d|^2 and d^T (x+
/// - x) to the sums and returns d.
#[inline(always)]
pub(super) fn take<V: Numbers>(
    [x, previous]: [&mut Batch<V>; 2],
    [y, new]: [&Batch<V>; 2],
    moves: V,
    sums: &mut [V],
) -> Batch<V> {
    let change = scale(moves, &sub(new, y));
    sums[0] += dot(&change, &change);
    sums[1] += dot(&change, &sub(new, x));
    for k in 0..3 {
        let now = x[k];
        x[k] = moves.at_most(V::default(), now, new[k]);
        previous[k] = moves.at_most(V::default(), previous[k], now);
    }
    change
}

impl Relaxation for Steps {
    #[inline(always)]
    fn relaxed<V: Vector>(
        &self,
        batch: usize,
        contact: ContactBatch<V>,
        u: &Batch<V>,
        x: &Batch<V>,
    ) -> Batch<V> {
        let moved = sub(x, &scale(V::of(self.step[batch]), u));
        contact.allowed(&moved, tangential_length(&moved))
    }

    #[inline(always)]
    fn relaxed_turning<V: Vector>(
        &self,
        batch: usize,
        contact: ContactBatch<V>,
        turning: TurningBatch<V>,
        [u, w]: &[Batch<V>; 2],
        [x, h]: [&Batch<V>; 2],
    ) -> [Batch<V>; 2] {
        let step = V::of(self.step[batch]);
        turning.allowed(&contact, [&sub(x, &scale(step, u)), &sub(h, &scale(step, w))])
    }
}

impl FirstOrderMethod for GaussSeidel {
    const NAME: &'static str = "pgs";
    const EXACT: bool = true;
    const TURNING: bool = true;
    const SINGLE: bool = true;
    const SWEEPS: bool = true;

    fn run(&mut self, scaled: &ScaledProblem, it: &mut Iterate<'_>) {
        let steps = Steps::of(scaled, self.relaxation);
        sweep(scaled, it, &steps, |_| 0.0);
    }

    fn run_single(&mut self, it: &mut SingleIterate<'_>) {
        it.sweep(self.relaxation, |_| 0.0);
    }
}

/// Sweeps, each from x + beta (x - previous) with the beta that `next` makes of |d|^2 and d^T (x+ - x) of the
/// last one.
pub(super) fn sweep(
    scaled: &ScaledProblem,
    it: &mut Iterate<'_>,
    steps: &Steps,
    mut next: impl FnMut([f64; 2]) -> f64,
) {
    let (mut previous, mut previous_image) = (it.x.clone(), it.image.clone());
    let (mut beta, mut followed) = (0.0, true);
    while it.proceed(scaled) {
        let refreshed = it.was_refreshed();
        let Iterate { x, image, work, .. } = it;
        if followed && refreshed && beta != 0.0 {
            // The extrapolation would take the difference between a fresh and a drifted image for a motion.
            scaled.image_of(&mut previous, &mut previous_image, work);
        }
        let images = [&mut image[..], &mut previous_image];
        let sums;
        (sums, followed) = scaled.sweep([x, &mut previous], images, beta, work, steps);
        beta = next(sums);
        if !followed && it.checks_next() {
            it.refresh(scaled);
        }
    }
    it.met_curvature(0.0);
}

/// Largest eigenvalue of a symmetric 3x3 block, by the trigonometric formula for the roots of its
/// characteristic polynomial (Smith 1961); the antisymmetric part is ignored.
fn largest_eigenvalue(a: &Block) -> f64 {
    let mean = (a[0] + a[4] + a[8]) / 3.0;
    let (xy, xz, yz) = (0.5 * (a[1] + a[3]), 0.5 * (a[2] + a[6]), 0.5 * (a[5] + a[7]));
    let (x, y, z) = (a[0] - mean, a[4] - mean, a[8] - mean);
    let p = ((x * x + y * y + z * z + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0).sqrt();
    if p == 0.0 {
        return mean;
    }
    let determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz);
    let half = (determinant / (2.0 * p * p * p)).clamp(-1.0, 1.0);
    mean + 2.0 * p * real::cos(real::acos(half) / 3.0)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::body_operator::TOGETHER;
    use super::super::first_order::FirstOrder;
    use super::super::interface::{CcpSolver, ExactState};
    use super::super::packing::{Block, PackedBlocks, pack, pack_in_blocks};
    use super::super::settings::SolveSettings;
    use super::*;
    use crate::delassus::{BodyInverseMass, CoupledBodies, Delassus, FIXED, RigidContact, RigidDelassus};
    use crate::problem::Ccp;
    use crate::registry::SolverSpec;
    use crate::residual::FrictionModel;
    use std::sync::Arc;

    /// Contacts between neighbours of a row of bodies, and of every fourth body with a fixed one.
    pub(in crate::solver) fn row_of_bodies(bodies: u32) -> Ccp {
        let wave = |k: u32| (1.7 * f64::from(k)).sin();
        let contact = |i: u32, body_a: u32, body_b: u32| {
            let (c, s) = (wave(i), (1.0 - wave(i).powi(2)).sqrt());
            RigidContact {
                body_a,
                body_b,
                frame: [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]],
                arm_a: [-c, -s, 0.3 * wave(i + 1)],
                arm_b: [c, s, 0.3 * wave(i + 2)],
            }
        };
        let contacts: Vec<_> = (0..bodies)
            .flat_map(|b| [(b, (b + 1) % bodies), (b, if b % 4 == 0 { FIXED } else { (b + 7) % bodies })])
            .enumerate()
            .map(|(i, (a, b))| contact(i as u32, a, b))
            .collect();
        let inverse_mass = (0..bodies)
            .map(|b| BodyInverseMass {
                linear: [1.0 + 0.5 * wave(b); 3],
                angular: [2.0, 0.3 * wave(b), 0.0, 0.3 * wave(b), 1.5, 0.1, 0.0, 0.1, 1.0],
            })
            .collect();
        let r = (0..3 * contacts.len() as u32).map(|k| wave(3 * k + 1)).collect();
        let friction = (0..contacts.len() as u32).map(|i| 0.5 + 0.5 * wave(i)).collect();
        Ccp::new(Delassus::Rigid(RigidDelassus::new(contacts, inverse_mass)), r, friction).unwrap()
    }

    /// The same with every third body in one of two mechanisms, and two in three contacts compliant.
    pub(in crate::solver) fn jointed(problem: Ccp) -> Ccp {
        let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!() };
        let of = |first: u32, degrees: usize| {
            let bodies: Vec<u32> = (first..rigid.num_bodies() as u32).step_by(6).take(20).collect();
            let factor = (0..6 * bodies.len() * degrees).map(|k| (2.3 * k as f64 + 1.0).sin()).collect();
            CoupledBodies { bodies, degrees, factor }
        };
        let compliance = (0..rigid.num_contacts()).map(|i| f64::from((i % 3) as u32)).collect();
        let rigid = rigid.clone().with_coupled(vec![of(0, 3), of(4, 11)]).with_compliance(compliance);
        Ccp::new(Delassus::Rigid(rigid), problem.r, problem.friction).unwrap()
    }

    /// Sweeps over bodies, eight contacts at a time, are those of one contact after the other over the rows
    /// of N, also where few bodies leave no eight contacts apart from one another.
    #[test]
    fn a_sweep_over_bodies_is_one_contact_after_the_other() {
        for (bodies, is_jointed) in [(3, false), (9, false), (700, false), (9, true), (700, true)] {
            let mut problem = row_of_bodies(bodies);
            if is_jointed {
                problem = jointed(problem);
            }
            let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!() };
            let order = pack(rigid).contacts;
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..2 * bodies), "the packing is a permutation");
            let contacts = order.iter().map(|&i| rigid.contacts()[i as usize]).collect();
            let packed = RigidDelassus::new(contacts, rigid.inverse_mass().to_vec())
                .with_coupled(rigid.coupled().to_vec())
                .with_compliance(
                    order
                        .iter()
                        .map(|&i| rigid.compliance().get(i as usize).copied().unwrap_or(0.0))
                        .collect(),
                );
            let rows = Ccp {
                delassus: Arc::new(Delassus::Sparse(packed.assemble())),
                r: order.iter().flat_map(|&i| problem.r[3 * i as usize..][..3].to_vec()).collect(),
                friction: order.iter().map(|&i| problem.friction[i as usize]).collect(),
                ..problem.clone()
            };
            for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
                let settings = SolveSettings {
                    tolerance: 0.0,
                    max_iterations: Some(7),
                    friction,
                    ..SolveSettings::default()
                };
                let run = |problem: &Ccp| {
                    let mut g = vec![0.0; problem.r.len()];
                    let mut last = ExactState { last: g.clone(), memory: None };
                    let mut solver = FirstOrder::new(GaussSeidel { relaxation: 1.2 });
                    if friction == FrictionModel::Coulomb {
                        solver.solve_exact(problem, &mut g, &mut last, &settings).unwrap().unwrap();
                    } else {
                        solver.solve(problem, &mut g, &settings).unwrap();
                    }
                    g
                };
                let (by_bodies, by_rows) = (run(&problem), run(&rows));
                for (place, &i) in order.iter().enumerate() {
                    for k in 0..3 {
                        let (a, b) = (by_bodies[3 * i as usize + k], by_rows[3 * place + k]);
                        assert!((a - b).abs() < 1e-10 * (1.0 + b.abs()), "contact {i}: {a} {b}");
                    }
                }
            }
        }
    }

    /// Every contact is in one block, whose bodies are its own; those of one list share none.
    #[test]
    fn blocks_of_a_list_share_no_body() {
        let problem = row_of_bodies(40_000);
        let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!() };
        let PackedBlocks { packing, lists } = pack_in_blocks(rigid, 8, |_| false);
        let mut contacts = packing.contacts.clone();
        contacts.sort_unstable();
        assert!(contacts.into_iter().eq(0..80_000), "the packing is a permutation");
        assert!(lists[0].len() > 3 && lists[1].len() > 2, "{lists:?}");
        let mut next = 0;
        for list in &lists {
            let mut free = 0;
            for Block { contacts, bodies } in list {
                assert!(contacts.start == next && bodies.start >= free, "{lists:?}");
                (next, free) = (contacts.end, bodies.end);
                assert!(next.is_multiple_of(8) || next == 80_000);
                for &contact in &packing.contacts[contacts.clone()] {
                    let places = packing.places_of(rigid, contact);
                    let fixed = packing.num_places() as u32;
                    assert!(places.iter().all(|&place| place == fixed || bodies.contains(&(place as usize))));
                }
            }
        }
        assert_eq!(next, 80_000);
        let left: usize = lists[2].iter().map(|block| block.contacts.len()).sum();
        assert!(left < 80_000 / 5, "{left}");
    }

    /// Hardly any contacts of a large packing wait for one another.
    #[test]
    fn batches_computed_together_share_no_body() {
        let problem = row_of_bodies(700);
        let Delassus::Rigid(rigid) = &*problem.delassus else { unreachable!() };
        let order = pack(rigid).contacts;
        let apart = |group: &&[u32]| {
            let contacts = group.iter().map(|&i| rigid.contacts()[i as usize]);
            let mut bodies: Vec<u32> =
                contacts.flat_map(|c| [c.body_a, c.body_b]).filter(|&b| b != FIXED).collect();
            let count = bodies.len();
            bodies.sort_unstable();
            bodies.dedup();
            bodies.len() == count
        };
        let groups = order.chunks(TOGETHER * LANES);
        let count = groups.len();
        assert!(groups.filter(apart).count() * 10 > 9 * count);
    }

    #[test]
    fn over_relaxation_is_part_of_the_name() {
        let spec: SolverSpec = "pgs@1.3".parse().unwrap();
        assert_eq!(spec.to_string(), "pgs@1.3");
        for wrong in ["pgs@2", "pgs@0", "pgs@", "pgs@nan", "pgs@x", "apgd@1.3", "pgs@1.3+cholesky"] {
            assert!(wrong.parse::<SolverSpec>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn largest_eigenvalue_of_known_blocks() {
        // Eigenvalues 1, 2, 3 and (rotated by 45 degrees about z) 1, 3, 2.
        assert!((largest_eigenvalue(&[1.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 2.0]) - 3.0).abs() < 1e-14);
        assert!((largest_eigenvalue(&[2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 2.0]) - 3.0).abs() < 1e-14);
        assert_eq!(largest_eigenvalue(&[5.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 5.0]), 5.0);
    }
}
