//! Compliant contacts among those that passes see.
//!
//! With N = D^T M^-1 D + C an image of x has C x, one number per contact, behind all else: it is linear in x
//! like the velocities of bodies, and a pass adds it to the normal components of D^T v. What a pass over the
//! contacts makes of it is left behind the slots of their chunk.

use super::combination::Combination;
use super::lanes::{Batch, LANES, Lanes, Numbers};
use super::octet::{EIGHT, Octet};
use super::packing::EMPTY;
use super::slots::SlotTable;
use super::tasks::{Tally, Totals, for_each_task};
use crate::delassus::RigidDelassus;
use rayon::prelude::*;
use std::ops::Range;

/// One number of each contact of a batch, as it lies in memory.
pub(super) trait Row: Numbers + Send + Sync {
    /// Contacts of a batch.
    const CONTACTS: usize;
    /// How many of these a slot takes.
    const PER_SLOT: usize;

    /// Sets that of one contact.
    fn set(&mut self, lane: usize, x: f64);

    /// Sum over the contacts.
    fn total(self) -> f64;
}

impl Row for Lanes {
    const CONTACTS: usize = LANES;
    const PER_SLOT: usize = 2;

    fn set(&mut self, lane: usize, x: f64) {
        self.0[lane] = x;
    }

    fn total(self) -> f64 {
        self.sum()
    }
}

impl Row for Octet {
    const CONTACTS: usize = EIGHT;
    const PER_SLOT: usize = 1;

    fn set(&mut self, lane: usize, x: f64) {
        self.0[lane] = x as f32;
    }

    fn total(self) -> f64 {
        self.sum()
    }
}

/// C of the scaled problem; without batches where all contacts are rigid.
#[derive(Clone, Debug)]
pub(super) struct PackedCompliance<R> {
    /// c' of every batch.
    rows: Vec<R>,
    /// 1 / c', or zero.
    stiffness: Vec<R>,
    /// Where C x begins in an image.
    first: usize,
    /// Batches per chunk.
    chunk: usize,
}

impl<R: Row> PackedCompliance<R> {
    /// Of contacts in this order, with their factors; `first` is where C x begins in an image, `chunk` the
    /// number of batches of a chunk.
    pub(super) fn new(
        rigid: &RigidDelassus,
        order: &[u32],
        scaling: &[[f64; 2]],
        (first, chunk): (usize, usize),
    ) -> Self {
        let batches = if rigid.compliance().is_empty() { 0 } else { order.len().div_ceil(R::CONTACTS) };
        let (mut rows, mut stiffness) = (vec![R::default(); batches], vec![R::default(); batches]);
        for (place, &i) in order.iter().enumerate().filter(|&(_, &i)| batches > 0 && i != EMPTY) {
            let given = rigid.compliance().get(i as usize).copied().unwrap_or(0.0);
            let c = given * scaling[i as usize][0].powi(2);
            // Less than the precision has is none.
            let mut in_precision = R::default();
            in_precision.set(0, c);
            in_precision.set(1, c.recip());
            if c > 0.0 && in_precision.total().is_finite() {
                rows[place / R::CONTACTS].set(place % R::CONTACTS, c);
                stiffness[place / R::CONTACTS].set(place % R::CONTACTS, c.recip());
            }
        }
        Self { rows, stiffness, first, chunk }
    }

    /// c' of some batches.
    pub(super) fn of(&self, batches: Range<usize>) -> &[R] {
        if self.rows.is_empty() { &[] } else { &self.rows[batches] }
    }

    /// Number of vectors that C x takes in an image.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Slots that it takes behind those of a chunk.
    pub(super) fn per_chunk(rigid: &RigidDelassus, chunk: usize) -> usize {
        if rigid.compliance().is_empty() { 0 } else { chunk.div_ceil(R::PER_SLOT) }
    }

    /// C x of some batches in an image that has it.
    pub(super) fn within<'a>(&self, image: &'a [R], batches: Range<usize>) -> &'a [R] {
        if self.rows.is_empty() || image.is_empty() {
            return &[];
        }
        &image[self.first + batches.start..self.first + batches.end]
    }

    /// C x of all batches in an image.
    pub(super) fn all_within<'a>(&self, image: &'a mut [R]) -> &'a mut [R] {
        let first = self.first.min(image.len());
        let end = (first + self.len()).min(image.len());
        &mut image[first..end]
    }

    /// Combines what the contacts left in `slots` with images; its part of the quadratic form.
    pub(super) fn follow<const K: usize>(
        &self,
        (slots, table): (&[R], &SlotTable),
        images: [&mut [R]; K],
        tallies: &mut [Tally],
        combination: &impl Combination<K>,
    ) -> f64 {
        let images = images.map(|image| self.all_within(image));
        let chunks = 0..self.rows.len().div_ceil(self.chunk);
        let tallies = &mut tallies[chunks.clone()];
        let no_extra = &mut [] as &mut [()];
        for_each_task(
            chunks,
            self.chunk,
            images,
            no_extra,
            &|_| 0,
            tallies,
            &|chunk, mut images, _, tally| {
                let fresh = &slots[R::PER_SLOT * table.behind(chunk)..];
                let stiffness = &self.stiffness[chunk * self.chunk..];
                let mut quadratic = R::default();
                for batch in 0..images[0].len() {
                    let fresh = fresh[batch];
                    quadratic += fresh * fresh * stiffness[batch];
                    let known = images.each_ref().map(|image| image[batch]);
                    for (image, new) in images.iter_mut().zip(combination.of(fresh, known)) {
                        image[batch] = new;
                    }
                }
                tally.sum[0] = Lanes([quadratic.total(), 0.0, 0.0, 0.0]);
            },
        );
        Totals::of(tallies).sum[0]
    }

    /// C x in the image of x.
    pub(super) fn keep(&self, x: &[Batch<R>], image: &mut [R]) {
        let rows = self.all_within(image).par_iter_mut().zip(&self.rows).zip(x);
        rows.with_min_len(self.chunk).for_each(|((compression, row), x)| *compression = *row * x[0]);
    }
}
