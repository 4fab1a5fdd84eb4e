//! Parallel loops over all contacts, with sums whose bits do not depend on the number of threads.

use super::lanes::{Batch, Lanes, Vector};
use std::ops::Range;

/// Batches per chunk: the unit of parallel work and of the order of sums.
pub const CHUNK: usize = 256;

/// Sums that a pass may gather.
pub const SUMS: usize = 6;

/// What a pass gathers over the contacts: sums and one maximum, meant by the kernel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally<V = Lanes> {
    /// Sums over contacts, lane by lane.
    pub sum: [V; SUMS],
    /// Largest value met.
    pub max: V,
}

impl<V: Vector> Tally<V> {
    /// The tally for memory.
    #[inline(always)]
    pub fn store(&self) -> Tally {
        Tally { sum: self.sum.map(V::lanes), max: self.max.lanes() }
    }
}

impl Tally {
    /// What the lanes of one chunk add up to.
    pub(super) fn totals(&self) -> Totals {
        Totals { sum: self.sum.map(|sum| sum.sum()), max: self.max.largest() }
    }
}

/// The sums and the maximum over all contacts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Totals {
    /// Sums.
    pub sum: [f64; SUMS],
    /// Maximum; NaN if one was met.
    pub max: f64,
}

impl Totals {
    /// Adds the chunks in their order.
    pub fn of(tallies: &[Tally]) -> Self {
        let mut totals = Self::default();
        tallies.iter().for_each(|tally| totals.add(&tally.totals()));
        totals
    }

    /// Adds the next chunk.
    pub(super) fn add(&mut self, chunk: &Self) {
        for (total, sum) in self.sum.iter_mut().zip(chunk.sum) {
            *total += sum;
        }
        if chunk.max.is_nan() || chunk.max > self.max {
            self.max = chunk.max;
        }
    }
}

/// Runs `work` for every task with its part of every vector (`unit` entries per task, the last one maybe
/// fewer), its part of `extra` (`extra_len` of a range of tasks) and its tally. Splits in halves over the
/// threads of rayon; nothing is allocated.
pub fn for_each_task<T: Send, U: Send, const M: usize>(
    tasks: Range<usize>,
    unit: usize,
    mut vectors: [&mut [T]; M],
    mut extra: &mut [U],
    extra_len: &(impl Fn(Range<usize>) -> usize + Sync),
    tallies: &mut [Tally],
    work: &(impl Fn(usize, [&mut [T]; M], &mut [U], &mut Tally) + Sync),
) {
    if tasks.len() <= 1 || rayon::current_num_threads() == 1 {
        for (task, tally) in tasks.zip(tallies) {
            let mine = vectors.each_mut().map(|vector| {
                let rest = std::mem::take(vector);
                let (head, tail) = rest.split_at_mut(unit.min(rest.len()));
                *vector = tail;
                head
            });
            let (head, tail) = extra.split_at_mut(extra_len(task..task + 1));
            extra = tail;
            *tally = Tally::default();
            work(task, mine, head, tally);
        }
        return;
    }
    let half = tasks.len() / 2;
    let middle = tasks.start + half;
    let (tallies_low, tallies_high) = tallies.split_at_mut(half);
    let (extra_low, extra_high) = extra.split_at_mut(extra_len(tasks.start..middle));
    let mut high: [&mut [T]; M] = std::array::from_fn(|_| Default::default());
    let low = std::array::from_fn(|m| {
        let (low, rest) = std::mem::take(&mut vectors[m]).split_at_mut(half * unit);
        high[m] = rest;
        low
    });
    rayon::join(
        || for_each_task(tasks.start..middle, unit, low, extra_low, extra_len, tallies_low, work),
        || for_each_task(middle..tasks.end, unit, high, extra_high, extra_len, tallies_high, work),
    );
}

/// One pass over vectors of batches without a product: `kernel(batch, [vectors at batch], tally)`.
pub fn for_each_batch<const M: usize>(
    vectors: [&mut [Batch]; M],
    tallies: &mut [Tally],
    kernel: impl Fn(usize, [&mut Batch; M], &mut Tally) + Sync,
) -> Totals {
    let batches = vectors[0].len();
    let chunks = batches.div_ceil(CHUNK);
    let tallies = &mut tallies[..chunks];
    for_each_task(
        0..chunks,
        CHUNK,
        vectors,
        &mut [] as &mut [()],
        &|_| 0,
        tallies,
        &|chunk, mut vectors, _, tally| {
            for offset in 0..vectors[0].len() {
                kernel(chunk * CHUNK + offset, vectors.each_mut().map(|v| &mut v[offset]), tally);
            }
        },
    );
    Totals::of(tallies)
}
