//! What one task does of a pass over the contacts: velocities, the method's update, forces; over bodies, or over rows of N'.

use super::super::body_operator::{BodyOperator, BodyPair, Update};
use super::super::lanes::{Batch, Lanes, Vector, add, in_place, load, scale, store, sub, zero};
use super::super::sweep::{Tally, TaskWork};
use super::{Kernel, Relaxation, ScaledProblem};

/// Batches that a pass over bodies takes through its three stages together.
const GROUP: usize = 8;

/// The part of a pass over bodies that one chunk does.
pub(super) struct BodyPass<'a, const M: usize, const GATHER: bool, const SCATTER: bool, K> {
    pub(super) scaled: &'a ScaledProblem,
    pub(super) bodies: &'a BodyOperator,
    pub(super) velocity: &'a [BodyPair],
    pub(super) batches: std::ops::Range<usize>,
    pub(super) vectors: [&'a mut [Batch]; M],
    pub(super) slots: &'a mut [BodyPair],
    pub(super) tally: &'a mut Tally,
    pub(super) kernel: &'a K,
}

impl<const M: usize, const GATHER: bool, const SCATTER: bool, K> TaskWork
    for BodyPass<'_, M, GATHER, SCATTER, K>
where
    K: Kernel<M>,
{
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { scaled, bodies, velocity, batches, vectors, slots, tally: total, kernel } = self;
        if SCATTER {
            slots.fill(BodyPair::default());
        }
        let mut vectors = vectors.map(in_place::<V>);
        let mut tally = Tally::default();
        // Short loops over a few batches rather than one long one: the square root and the quotients of a projection take tens of
        // cycles, which the processor hides behind the next batch only where that is near enough.
        let group = if K::SHORT { 1 } else { GROUP };
        let (mut u, mut s) = ([zero::<V>(); GROUP], [zero::<V>(); GROUP]);
        let mut offset = 0;
        while offset < batches.len() {
            let count = group.min(batches.len() - offset);
            let first = batches.start + offset;
            if GATHER {
                for (k, u) in u[..count].iter_mut().enumerate() {
                    let batch = first + k;
                    *u = add(&bodies.relative_velocity(batch, velocity), &load(&scaled.r[batch]));
                }
            }
            for k in 0..count {
                if !K::SHORT {
                    bodies.prefetch::<V>(first + GROUP + k);
                }
                let mine = vectors.each_mut().map(|v| &mut v[offset + k]);
                s[k] = kernel.at(scaled.here(first + k), &u[k], mine, &mut tally);
            }
            if SCATTER {
                for (k, s) in s[..count].iter().enumerate() {
                    bodies.scatter(first + k, s, slots);
                }
            }
            offset += count;
        }
        *total = tally.store();
    }
}

/// A sweep of Gauss-Seidel over bodies.
pub(super) struct BodySweep<'a, K> {
    pub(super) scaled: &'a ScaledProblem,
    pub(super) bodies: &'a BodyOperator,
    pub(super) x: &'a mut [Batch],
    pub(super) image: &'a mut [Lanes],
    pub(super) kernel: &'a K,
}

impl<K: Relaxation> TaskWork for BodySweep<'_, K> {
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { scaled, bodies, x, image, kernel } = self;
        bodies.sweep::<V>(image, &mut Relaxing { scaled, x: in_place(x), kernel });
    }
}

/// The contacts' part of a sweep.
struct Relaxing<'a, V, K> {
    scaled: &'a ScaledProblem,
    x: &'a mut [Batch<V>],
    kernel: &'a K,
}

impl<V: Vector, K: Relaxation> Update<V> for Relaxing<'_, V, K> {
    #[inline(always)]
    fn at(&mut self, batch: usize, velocity: &Batch<V>, moves: V) -> Batch<V> {
        let here = self.scaled.here(batch);
        let u = add(velocity, &here.r);
        let x = &mut self.x[batch];
        let new = self.kernel.relaxed(batch, here, &u, x);
        let change = scale(moves, &sub(&new, x));
        *x = add(x, &change);
        change
    }
}

/// The part of a pass over rows that one chunk does before the product.
pub(super) struct RowPass<'a, const M: usize, K> {
    pub(super) scaled: &'a ScaledProblem,
    pub(super) product: &'a [Batch],
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
    fn run<V: Vector>(self) {
        let Self { scaled, product, batches, vectors, scattered, tally: total, kernel } = self;
        let mut vectors = vectors.map(in_place::<V>);
        let mut tally = Tally::default();
        for (offset, batch) in batches.enumerate() {
            let u = add(&load(&product[batch]), &load(&scaled.r[batch]));
            let mine = vectors.each_mut().map(|v| &mut v[offset]);
            scattered[offset] = store(&kernel.at(scaled.here(batch), &u, mine, &mut tally));
        }
        *total = tally.store();
    }
}
