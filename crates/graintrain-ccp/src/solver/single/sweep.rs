//! Sweeps of Gauss-Seidel over rigid bodies in single precision, eight contacts at a time.

use super::super::apgd::extrapolated;
use super::super::dispatch::vectorised;
use super::super::lanes::{Batch, add, dot, project_given, scale, sub, tangential_length, within_disc};
use super::super::octet::{EIGHT, InSingle, Octet, SingleVector, SingleWork};
use super::super::packing::Block;
use super::geometry::{Bodies, Geometry, load};
use super::kernel::SingleTally;
use super::operator::{Arrangement, CHUNK, PREFETCH, SingleOperator};
use crate::delassus::Delassus;
use crate::residual::FrictionModel;
use crate::solver::gauss_seidel::largest_eigenvalue;
use rayon::prelude::*;
use std::ops::Range;

/// What sweeps need beside the operator.
#[derive(Clone, Debug)]
pub(super) struct Sweeps {
    /// 1 / lambda_i, lambda_i the largest eigenvalue of N'_ii.
    step: Vec<Octet>,
    /// Which contacts of a batch move at once, 1 where they do: those of batch b at `first[b]..first[b + 1]`. Contacts that share a body that moves come one after the other.
    moves: Vec<Octet>,
    first: Vec<u32>,
    /// Bodies as places in the range of the block.
    bodies: Vec<Bodies>,
    /// Lists of blocks, one after the other; those of one list share no body, and a single one has all bodies.
    lists: Vec<Vec<Block>>,
}

impl Sweeps {
    /// Of contacts in this order and these blocks, with their factors c / sqrt(e) over c.
    pub(super) fn new(
        delassus: &Delassus,
        (order, mut lists): (&[u32], Vec<Vec<Block>>),
        scaling: &[[f64; 2]],
        operator: &SingleOperator,
    ) -> Self {
        let step_of = |batch: &[u32]| {
            let mut step = Octet::default();
            for (step, &i) in step.0.iter_mut().zip(batch) {
                let [n, t] = scaling[i as usize];
                let factor = [n, t, t];
                let mut block = delassus.diagonal_block(i as usize);
                for (k, entry) in block.iter_mut().enumerate() {
                    *entry *= factor[k / 3] * factor[k % 3];
                }
                let largest = largest_eigenvalue(&block);
                // A contact between immovable bodies: any positive step leads to its solution or to infinity.
                *step = if largest > 0.0 { largest.recip() as f32 } else { 1.0 };
            }
            step
        };
        let step = match &operator.arrangement {
            // Scaled blocks of balls are unit matrices.
            Arrangement::Radial(all) if operator.masses.are_isotropic() => vec![Octet::splat(1.0); all.len()],
            _ => order.par_chunks(EIGHT).with_min_len(CHUNK).map(step_of).collect(),
        };
        let fixed = operator.num_places as u32;
        let bodies_of = |batch: usize| match &operator.arrangement {
            Arrangement::Radial(all) => &all[batch].bodies,
            Arrangement::General(all) => &all[batch].bodies,
        };
        let (mut moves, mut first, mut bodies) = (Vec::new(), vec![0], Vec::new());
        for list in &mut lists {
            if let [only] = &mut list[..] {
                only.bodies = 0..operator.num_places;
            }
            for block in list {
                for batch in batches_of(block) {
                    one_after_the_other(bodies_of(batch), fixed, &mut moves);
                    first.push(moves.len() as u32);
                    bodies.push(bodies_of(batch).within(&block.bodies));
                }
            }
        }
        Self { step, moves, first, bodies, lists }
    }

    /// One sweep with this over-relaxation from y = x + beta (x - previous): x becomes its end, `previous` the x before, their images follow. Blocks of a list are swept side by side: what
    /// comes of it does not depend on threads. Returns |d|^2 and d^T (x+ - x) with d = x+ - y.
    pub(super) fn sweep(
        &self,
        operator: &SingleOperator,
        [x, previous]: [&mut [Batch<Octet>]; 2],
        [image, previous_image]: [&mut [Octet]; 2],
        windows: &mut Vec<Octet>,
        (beta, relaxation): (f64, f64),
        model: FrictionModel,
    ) -> [f64; 2] {
        vectorised(InSingle(Extrapolating { images: [image, previous_image], beta }));
        let mut sums = [0.0; 2];
        for list in &self.lists {
            let [mut x, mut previous] = [&mut *x, &mut *previous].map(Rest::of);
            let mut image = Rest::of(&mut *image);
            let is_single = list.len() == 1;
            let places = if is_single { 0 } else { list.iter().map(|block| block.bodies.len() + 1).sum() };
            windows.resize(places, Octet::default());
            let mut window = Rest::of(&mut windows[..]);
            let part_of = |block: &Block| {
                let batches = batches_of(block);
                // What is fixed comes last.
                let bodies = block.bodies.start..block.bodies.end + usize::from(is_single);
                let own_window = window.from..window.from + if is_single { 0 } else { bodies.len() + 1 };
                Part {
                    sweeps: self,
                    operator,
                    vectors: [x.cut(&batches), previous.cut(&batches)],
                    image: image.cut(&bodies),
                    window: window.cut(&own_window),
                    batches,
                    bodies: block.bodies.clone(),
                    beta,
                    relaxation,
                    sums: [0.0; 2],
                }
            };
            let mut parts: Vec<Part<'_>> = list.iter().map(part_of).collect();
            parts.par_iter_mut().for_each(|part| part.sweep(model));
            for part in parts {
                sums = [sums[0] + part.sums[0], sums[1] + part.sums[1]];
            }
        }
        sums
    }
}

/// Batches of a block.
fn batches_of(block: &Block) -> Range<usize> {
    block.contacts.start / EIGHT..block.contacts.end.div_ceil(EIGHT)
}

/// Appends which contacts of a batch move at once, so that those that share a body do so one after the other.
fn one_after_the_other(bodies: &Bodies, fixed: u32, moves: &mut Vec<Octet>) {
    let begin = moves.len();
    let of = |lane: usize| bodies.place.map(|side| side[lane]).into_iter().filter(|&body| body != fixed);
    for lane in 0..EIGHT {
        let meets = |with: &Octet| {
            (0..lane).any(|l| with.0[l] == 1.0 && of(l).any(|body| of(lane).any(|own| own == body)))
        };
        let free = (begin..moves.len()).find(|&k| !meets(&moves[k]));
        let k = free.unwrap_or_else(|| {
            moves.push(Octet::default());
            moves.len() - 1
        });
        moves[k].0[lane] = 1.0;
    }
}

/// What is left of a slice, from this place on.
struct Rest<'a, T> {
    slice: &'a mut [T],
    from: usize,
}

impl<'a, T> Rest<'a, T> {
    fn of(slice: &'a mut [T]) -> Self {
        Self { slice, from: 0 }
    }

    /// Takes a range out.
    fn cut(&mut self, range: &Range<usize>) -> &'a mut [T] {
        let (_, later) = std::mem::take(&mut self.slice).split_at_mut(range.start - self.from);
        let (own, later) = later.split_at_mut(range.len());
        (self.slice, self.from) = (later, range.end);
        own
    }
}

/// image <- image + beta (image - previous), previous <- image.
struct Extrapolating<'a> {
    images: [&'a mut [Octet]; 2],
    beta: f64,
}

impl SingleWork for Extrapolating<'_> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let [image, previous] = self.images;
        for (image, previous) in V::of_slice(image).iter_mut().zip(V::of_slice(previous)) {
            let now = *image;
            *image = now + V::splat(self.beta) * (now - *previous);
            *previous = now;
        }
    }
}

/// The part of a sweep in one block.
struct Part<'a> {
    sweeps: &'a Sweeps,
    operator: &'a SingleOperator,
    batches: Range<usize>,
    bodies: Range<usize>,
    vectors: [&'a mut [Batch<Octet>]; 2],
    /// Of the bodies; with what is fixed where there is a single block.
    image: &'a mut [Octet],
    /// Where there are several blocks, room for the same with what is fixed.
    window: &'a mut [Octet],
    beta: f64,
    relaxation: f64,
    sums: [f64; 2],
}

impl Part<'_> {
    fn sweep(&mut self, model: FrictionModel) {
        match (&self.operator.arrangement, model) {
            (Arrangement::Radial(all), FrictionModel::Coulomb) => self.over::<_, true>(all),
            (Arrangement::Radial(all), FrictionModel::Relaxed) => self.over::<_, false>(all),
            (Arrangement::General(all), FrictionModel::Coulomb) => self.over::<_, true>(all),
            (Arrangement::General(all), FrictionModel::Relaxed) => self.over::<_, false>(all),
        }
    }

    fn over<G: Geometry, const EXACT: bool>(&mut self, geometry: &[G]) {
        let geometry = &geometry[self.batches.clone()];
        vectorised(InSingle(PartOver::<G, EXACT> { part: self, geometry }));
    }
}

/// The same over contacts of this geometry.
struct PartOver<'a, 'b, G, const EXACT: bool> {
    part: &'a mut Part<'b>,
    geometry: &'a [G],
}

impl<G: Geometry, const EXACT: bool> SingleWork for PartOver<'_, '_, G, EXACT> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let Part { sweeps, operator, batches, bodies, vectors, image, window, beta, relaxation, sums } =
            self.part;
        let masses = operator.masses.within(bodies.clone());
        if let Some((fixed, own)) = window.split_last_mut() {
            own.copy_from_slice(image);
            *fixed = Octet::default();
        }
        let is_single = window.is_empty();
        let velocities = if is_single { &mut image[..] } else { &mut window[..] };
        let [x, previous] = vectors;
        let (x, previous) = (of_batches::<V>(x), of_batches::<V>(previous));
        let mut tally = SingleTally::<V>::default();
        for (offset, own) in self.geometry.iter().enumerate() {
            if let Some(later) = self.geometry.get(offset + PREFETCH) {
                V::prefetch(later);
            }
            let batch = batches.start + offset;
            let numbers = &operator.contacts[batch];
            let step = V::splat(*relaxation) * V::of(sweeps.step[batch]);
            let (mu, r) = (V::of(numbers.mu), load(&numbers.r));
            let (x, previous) = (&mut x[offset], &mut previous[offset]);
            let bodies = &sweeps.bodies[batch];
            for moves in &sweeps.moves[sweeps.first[batch] as usize..sweeps.first[batch + 1] as usize] {
                let moves = V::of(*moves);
                let u = own.relative([bodies.velocities(0, velocities), bodies.velocities(1, velocities)]);
                let y = extrapolated(x, previous, *beta);
                let point = sub(&y, &scale(step, &add(&u, &r)));
                let tangential = tangential_length(&point);
                let new = match EXACT {
                    true => within_disc(mu, &point, tangential),
                    false => project_given(mu, &point, tangential),
                };
                let change = scale(moves, &sub(&new, &y));
                tally.sum[0] += dot(&change, &change);
                tally.sum[1] += dot(&change, &sub(&new, x));
                for k in 0..3 {
                    let now = x[k];
                    x[k] = moves.at_most(V::default(), now, new[k]);
                    previous[k] = moves.at_most(V::default(), previous[k], now);
                }
                let [p, on_a, on_b] = own.impulses(&change);
                bodies.push(&p, [&on_a, &on_b], masses, velocities);
            }
            if offset % CHUNK == CHUNK - 1 || offset + 1 == self.geometry.len() {
                for (total, own) in sums.iter_mut().zip(&mut tally.sum) {
                    *total += own.octet().sum();
                    *own = V::default();
                }
            }
        }
        if !is_single {
            image.copy_from_slice(&window[..image.len()]);
        }
    }
}

/// Numbers in memory, to change in place.
#[inline(always)]
fn of_batches<'a, V: SingleVector>(vector: &'a mut [Batch<Octet>]) -> &'a mut [Batch<V>] {
    V::of_slice(vector.as_flattened_mut()).as_chunks_mut().0
}
