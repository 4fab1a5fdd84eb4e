//! What one task does of a pass over the contacts: velocities, the method's update, forces; over bodies, or over rows of N'.

use super::super::body_operator::{BodyOperator, BodyPair, Update};
use super::super::lanes::{Batch, Lanes, Vector, add, in_place, load, scale, store, sub, zero};
use super::super::sweep::{Tally, TaskWork};
use super::{Kernel, Relaxation, ScaledProblem, Surroundings};

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
        let surroundings = scaled.surroundings(batches.clone());
        let ahead = &bodies.geometry()[batches.start..];
        let geometry = &ahead[..batches.len()];
        if K::SHORT {
            for (batch, geometry) in geometry.iter().enumerate() {
                let here = surroundings.at(batch);
                let u =
                    if GATHER { add(&geometry.relative_velocity(velocity), &here.r) } else { zero::<V>() };
                let mine = vectors.each_mut().map(|v| &mut v[batch]);
                let s = kernel.at(here, &u, mine, &mut tally);
                if SCATTER {
                    geometry.scatter(&s, slots);
                }
            }
            *total = tally.store();
            return;
        }
        // Short loops over a few batches rather than one long one: the square root and the quotients of a projection take tens of
        // cycles, which the processor hides behind the next batch only where that is near enough.
        let (mut u, mut s) = ([zero::<V>(); GROUP], [zero::<V>(); GROUP]);
        for first in (0..geometry.len()).step_by(GROUP) {
            let batches = first..(first + GROUP).min(geometry.len());
            let mine = &geometry[batches.clone()];
            if GATHER {
                for ((geometry, r), u) in mine.iter().zip(&surroundings.r[batches.clone()]).zip(&mut u) {
                    *u = add(&geometry.relative_velocity(velocity), &load(r));
                }
            }
            for (batch, (u, s)) in batches.zip(u.iter().zip(&mut s)) {
                // The memory would have nothing to do here: this loop alone, in memory, takes 0.94 of the time.
                if let Some(next) = ahead.get(batch + GROUP) {
                    V::prefetch(next);
                }
                let mine = vectors.each_mut().map(|v| &mut v[batch]);
                *s = kernel.at(surroundings.at(batch), u, mine, &mut tally);
            }
            if SCATTER {
                for (geometry, s) in mine.iter().zip(&s) {
                    geometry.scatter(s, slots);
                }
            }
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
        let surroundings = scaled.surroundings(0..x.len());
        bodies.sweep::<V>(image, &mut Relaxing { surroundings, x: in_place(x), kernel });
    }
}

/// The contacts' part of a sweep.
struct Relaxing<'a, V, K> {
    surroundings: Surroundings<'a>,
    x: &'a mut [Batch<V>],
    kernel: &'a K,
}

impl<V: Vector, K: Relaxation> Update<V> for Relaxing<'_, V, K> {
    #[inline(always)]
    fn at(&mut self, batch: usize, velocity: &Batch<V>, moves: V) -> Batch<V> {
        let here = self.surroundings.at(batch);
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
        let surroundings = scaled.surroundings(batches.clone());
        let mut tally = Tally::default();
        for (batch, (product, scattered)) in product[batches].iter().zip(scattered).enumerate() {
            let here = surroundings.at(batch);
            let u = add(&load(product), &here.r);
            let mine = vectors.each_mut().map(|v| &mut v[batch]);
            *scattered = store(&kernel.at(here, &u, mine, &mut tally));
        }
        *total = tally.store();
    }
}
