//! What one task does of a pass over the contacts: velocities, the method's update, forces; over bodies, or over rows of N'.

use super::super::body_operator::{BodyOperator, Update};
use super::super::lanes::{Batch, LANES, Lanes, ZERO, add, scale, sub};
use super::super::row_operator::batch_of;
use super::super::sweep::{Tally, TaskWork};
use super::{Kernel, Relaxation, ScaledProblem};

/// Batches that a pass over bodies takes through its three stages together.
const GROUP: usize = 8;

/// The part of a pass over bodies that one chunk does.
pub(super) struct BodyPass<'a, const M: usize, const GATHER: bool, const SCATTER: bool, K> {
    pub(super) scaled: &'a ScaledProblem,
    pub(super) bodies: &'a BodyOperator,
    pub(super) velocity: &'a [[f64; 6]],
    pub(super) batches: std::ops::Range<usize>,
    pub(super) vectors: [&'a mut [Batch]; M],
    pub(super) slots: &'a mut [[f64; 6]],
    pub(super) tally: &'a mut Tally,
    pub(super) kernel: &'a K,
}

impl<const M: usize, const GATHER: bool, const SCATTER: bool, K> TaskWork
    for BodyPass<'_, M, GATHER, SCATTER, K>
where
    K: Kernel<M>,
{
    #[inline(always)]
    fn run(mut self) {
        if SCATTER {
            self.slots.fill([0.0; 6]);
        }
        let mut tally = Tally::default();
        // Four short loops over a few batches rather than one long one: the square root and the quotients of a projection
        // take tens of cycles, which the processor hides behind the next batch only where that is near enough.
        let (mut u, mut s, mut world) = ([ZERO; GROUP], [ZERO; GROUP], [[ZERO; 3]; GROUP]);
        let mut offset = 0;
        while offset < self.batches.len() {
            let count = GROUP.min(self.batches.len() - offset);
            let first = self.batches.start + offset;
            if GATHER {
                for (k, u) in u[..count].iter_mut().enumerate() {
                    let batch = first + k;
                    *u = add(&self.bodies.relative_velocity(batch, self.velocity), &self.scaled.r[batch]);
                }
            }
            for k in 0..count {
                let mine = self.vectors.each_mut().map(|v| &mut v[offset + k]);
                s[k] = self.kernel.at(self.scaled.here(first + k), &u[k], mine, &mut tally);
            }
            for k in 0..count {
                let mine = self.vectors.each_mut().map(|v| &mut v[offset + k]);
                s[k] = self.kernel.finish(self.scaled.here(first + k), &u[k], s[k], mine, &mut tally);
            }
            if SCATTER {
                for (k, world) in world[..count].iter_mut().enumerate() {
                    *world = self.bodies.world_impulses(first + k, &s[k]);
                }
                for (k, world) in world[..count].iter().enumerate() {
                    self.bodies.scatter(first + k, world, self.slots);
                }
            }
            offset += count;
        }
        *self.tally = tally;
    }
}

/// A sweep of Gauss-Seidel over bodies.
pub(super) struct BodySweep<'a, K> {
    pub(super) scaled: &'a ScaledProblem,
    pub(super) bodies: &'a BodyOperator,
    pub(super) x: &'a mut [Batch],
    pub(super) image: &'a mut [f64],
    pub(super) kernel: &'a K,
}

impl<K: Relaxation> TaskWork for BodySweep<'_, K> {
    #[inline(always)]
    fn run(self) {
        let Self { scaled, bodies, x, image, kernel } = self;
        bodies.sweep(image, &mut Relaxing { scaled, x, kernel });
    }
}

/// The contacts' part of a sweep.
struct Relaxing<'a, K> {
    scaled: &'a ScaledProblem,
    x: &'a mut [Batch],
    kernel: &'a K,
}

impl<K: Relaxation> Update for Relaxing<'_, K> {
    #[inline(always)]
    fn at(&mut self, batch: usize, velocity: &Batch, moves: Lanes) -> Batch {
        let u = add(velocity, &self.scaled.r[batch]);
        let x = &mut self.x[batch];
        let new = self.kernel.relaxed(batch, self.scaled.here(batch), &u, x);
        let change = scale(moves, &sub(&new, x));
        *x = add(x, &change);
        change
    }
}

/// The part of a pass over rows that one chunk does before the product.
pub(super) struct RowPass<'a, const M: usize, K> {
    pub(super) scaled: &'a ScaledProblem,
    pub(super) product: &'a [[f64; 3 * LANES]],
    pub(super) batches: std::ops::Range<usize>,
    pub(super) vectors: [&'a mut [Batch]; M],
    pub(super) scattered: &'a mut [Batch],
    pub(super) tally: &'a mut Tally,
    pub(super) kernel: &'a K,
}

impl<const M: usize, K> TaskWork for RowPass<'_, M, K>
where
    K: Kernel<M>,
{
    #[inline(always)]
    fn run(mut self) {
        for (offset, batch) in self.batches.enumerate() {
            let u = add(&batch_of(&self.product[batch]), &self.scaled.r[batch]);
            let mine = self.vectors.each_mut().map(|v| &mut v[offset]);
            let s = self.kernel.at(self.scaled.here(batch), &u, mine, self.tally);
            let mine = self.vectors.each_mut().map(|v| &mut v[offset]);
            self.scattered[offset] = self.kernel.finish(self.scaled.here(batch), &u, s, mine, self.tally);
        }
    }
}
