//! Sweeps of Gauss-Seidel over rigid bodies in single precision, eight contacts at a time.

use super::super::dispatch::vectorised;
use super::super::gauss_seidel::{step_of_block, take};
use super::super::lanes::{Batch, add, project_given, scale, sub, tangential_length, within_disc};
use super::super::momentum::{extrapolate, extrapolated};
use super::super::octet::{EIGHT, InSingle, Octet, SingleVector, SingleWork};
use super::super::packing::{Block, Packing};
use super::geometry::{Geometry, Places, bring, load, push, push_coupled, velocities, within};
use super::kernel::SingleTally;
use super::operator::{Arrangement, CHUNK, PREFETCH, SingleOperator};
use crate::delassus::Delassus;
use crate::residual::FrictionModel;
use rayon::prelude::*;
use std::ops::Range;

/// What sweeps need beside the operator.
#[derive(Clone, Debug)]
pub(super) struct Sweeps {
    /// 1 / lambda_i, lambda_i the largest eigenvalue of N'_ii.
    step: Vec<Octet>,
    /// Which contacts of a batch move at once, 1 where they do: those of batch b at `first[b]..first[b + 1]`.
    /// Contacts that share a body that moves come one after the other.
    moves: Vec<Octet>,
    first: Vec<u32>,
    /// Bodies A and B of each batch as places in the range of its block.
    places: Vec<Places>,
    /// Whether joints couple bodies of a batch: it is in the list with the block of all bodies.
    coupled: Vec<bool>,
    /// Lists of blocks, one after the other; those of one list share no body, and a single one has all
    /// bodies.
    lists: Vec<Vec<Block>>,
}

/// Scratch of sweeps.
#[derive(Clone, Debug, Default)]
pub(super) struct SweepScratch {
    /// Velocities of the bodies of each block, followed by those of what is fixed.
    windows: Vec<Octet>,
    /// Sums of each block of a list.
    sums: Vec<[f64; 2]>,
    /// Sweeps that each batch is still passed over.
    rests: Vec<u8>,
}

/// A batch whose contacts a sweep leaves without impulses is passed over in so many: most stay open. What
/// presses all the same shows in the residual, which has every contact.
const REST: u8 = 7;

/// How a sweep is made.
#[derive(Clone, Copy)]
pub(super) struct Sweep {
    pub(super) beta: f64,
    /// omega
    pub(super) relaxation: f64,
    pub(super) model: FrictionModel,
}

impl Sweeps {
    /// Of contacts in this order and these blocks, with their factors c / sqrt(e) over c.
    pub(super) fn new(
        delassus: &Delassus,
        (packing, mut lists): (&Packing, Vec<Vec<Block>>),
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
                *step = step_of_block(&block) as f32;
            }
            step
        };
        let step = match &operator.arrangement {
            Arrangement::Radial(all) if operator.blocks_are_units() => vec![Octet::splat(1.0); all.len()],
            _ => packing.contacts.par_chunks(EIGHT).with_min_len(CHUNK).map(step_of).collect(),
        };
        let places_of = |batch: usize| match &operator.arrangement {
            Arrangement::Radial(all) => &all[batch].bodies.place,
            Arrangement::General(all) => &all[batch].bodies.place,
        };
        let still = Octet::default();
        let is_coupled = |body: u32| packing.is_coupled(body);
        let moved = |body: u32| {
            let by_itself = operator.masses.diagonal.get(body as usize).is_some_and(|mass| *mass != still);
            (by_itself || is_coupled(body)).then(|| packing.mover(body))
        };
        let (mut moves, mut first, mut places) = (Vec::new(), vec![0], Vec::new());
        let mut coupled = Vec::new();
        for list in &mut lists {
            if let [only] = &mut list[..] {
                only.bodies = 0..operator.num_places;
            }
            for block in list {
                for batch in batches_of(block) {
                    one_after_the_other(places_of(batch), moved, &mut moves);
                    coupled.push(places_of(batch).as_flattened().iter().any(|&body| is_coupled(body)));
                    first.push(moves.len() as u32);
                    places.push(within(places_of(batch), &block.bodies));
                }
            }
        }
        Self { step, moves, first, places, coupled, lists }
    }

    /// For all sweeps of a solve.
    pub(super) fn scratch(&self, operator: &SingleOperator) -> SweepScratch {
        let most = self.lists.iter().map(Vec::len).max().unwrap_or_default();
        SweepScratch {
            windows: vec![Octet::default(); operator.num_places + most],
            sums: vec![[0.0; 2]; most],
            rests: vec![0; self.step.len()],
        }
    }

    /// One sweep from y = x + beta (x - previous): x becomes its end, `previous` the x before, their images
    /// follow. Blocks of a list are swept side by side: what comes of it does not depend on threads. Returns
    /// |d|^2 and d^T (x+ - x) with d = x+ - y.
    pub(super) fn sweep(
        &self,
        operator: &SingleOperator,
        [x, previous]: [&mut [Batch<Octet>]; 2],
        images: [&mut [Octet]; 2],
        scratch: &mut SweepScratch,
        sweep: Sweep,
    ) -> [f64; 2] {
        let [image, previous_image] = images;
        vectorised(InSingle(Extrapolating { images: [image, previous_image], beta: sweep.beta }));
        let mut total = [0.0; 2];
        for list in &self.lists {
            let sums = &mut scratch.sums[..list.len()];
            let slices = Slices {
                x: Rest::of(x),
                previous: Rest::of(previous),
                image: Rest::of(image),
                window: Rest::of(&mut scratch.windows),
                rests: Rest::of(&mut scratch.rests),
                sums,
            };
            match &list[..] {
                // What is fixed is in the image itself.
                [only] => {
                    let all = 0..operator.image_len();
                    slices.part(self, operator, only, all, 0..0).sweep(sweep);
                }
                blocks => slices.over(self, operator, (blocks, 0), sweep),
            }
            for own in &scratch.sums[..list.len()] {
                total = [total[0] + own[0], total[1] + own[1]];
            }
        }
        if let Some(mechanisms) = &operator.mechanisms {
            mechanisms.bring_all::<Octet>(image);
        }
        operator.compliance.keep(x, image);
        total
    }
}

/// Batches of a block.
fn batches_of(block: &Block) -> Range<usize> {
    block.contacts.start / EIGHT..block.contacts.end.div_ceil(EIGHT)
}

/// Appends which contacts of a batch move at once, so that those that share what is `moved` do so one after
/// the other.
fn one_after_the_other(places: &Places, moved: impl Fn(u32) -> Option<u32>, moves: &mut Vec<Octet>) {
    let begin = moves.len();
    let of = |lane: usize| [places[0][lane], places[1][lane]].into_iter().filter_map(&moved);
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

/// A part of a slice, from this place on.
struct Rest<'a, T> {
    slice: &'a mut [T],
    from: usize,
}

impl<'a, T> Rest<'a, T> {
    fn of(slice: &'a mut [T]) -> Self {
        Self { slice, from: 0 }
    }

    /// What comes before a place and what comes from it on.
    fn split_at(self, place: usize) -> (Self, Self) {
        let (low, high) = self.slice.split_at_mut(place - self.from);
        (Self { slice: low, from: self.from }, Self { slice: high, from: place })
    }

    fn range(self, range: &Range<usize>) -> &'a mut [T] {
        &mut self.slice[range.start - self.from..range.end - self.from]
    }
}

/// The parts of vectors, images and scratch that some blocks have.
struct Slices<'a> {
    x: Rest<'a, Batch<Octet>>,
    previous: Rest<'a, Batch<Octet>>,
    image: Rest<'a, Octet>,
    window: Rest<'a, Octet>,
    rests: Rest<'a, u8>,
    sums: &'a mut [[f64; 2]],
}

impl<'a> Slices<'a> {
    /// Sweeps blocks, of which so many come before them in the list, in halves over the threads of rayon;
    /// nothing is allocated.
    fn over(
        self,
        sweeps: &Sweeps,
        operator: &SingleOperator,
        (blocks, before): (&[Block], usize),
        sweep: Sweep,
    ) {
        let window_start = |k: usize| blocks[k].bodies.start + before + k;
        match blocks {
            [] => {}
            [block] => {
                let window = window_start(0)..block.bodies.end + before + 1;
                self.part(sweeps, operator, block, block.bodies.clone(), window).sweep(sweep);
            }
            _ => {
                let middle = blocks.len() / 2;
                let (low, high) = blocks.split_at(middle);
                let (batch, body) = (batches_of(&high[0]).start, high[0].bodies.start);
                let (x, more_x) = self.x.split_at(batch);
                let (previous, more_previous) = self.previous.split_at(batch);
                let (image, more_image) = self.image.split_at(body);
                let (window, more_window) = self.window.split_at(window_start(middle));
                let (rests, more_rests) = self.rests.split_at(batch);
                let (sums, more_sums) = self.sums.split_at_mut(middle);
                let first = Slices { x, previous, image, window, rests, sums };
                let second = Slices {
                    x: more_x,
                    previous: more_previous,
                    image: more_image,
                    window: more_window,
                    rests: more_rests,
                    sums: more_sums,
                };
                rayon::join(
                    || first.over(sweeps, operator, (low, before), sweep),
                    || second.over(sweeps, operator, (high, before + middle), sweep),
                );
            }
        }
    }

    /// One block, with these places of its image and of its window.
    fn part<'b>(
        self,
        sweeps: &'b Sweeps,
        operator: &'b SingleOperator,
        block: &Block,
        image: Range<usize>,
        window: Range<usize>,
    ) -> Part<'b>
    where
        'a: 'b,
    {
        let batches = batches_of(block);
        Part {
            sweeps,
            operator,
            vectors: [self.x.range(&batches), self.previous.range(&batches)],
            image: self.image.range(&image),
            window: self.window.range(&window),
            rests: self.rests.range(&batches),
            batches,
            bodies: block.bodies.clone(),
            sum: &mut self.sums[0],
        }
    }
}

/// See [`extrapolate`].
struct Extrapolating<'a> {
    images: [&'a mut [Octet]; 2],
    beta: f64,
}

impl SingleWork for Extrapolating<'_> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let [image, previous] = self.images;
        extrapolate(V::of_slice(image), V::of_slice(previous), self.beta);
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
    rests: &'a mut [u8],
    sum: &'a mut [f64; 2],
}

impl Part<'_> {
    fn sweep(self, sweep: Sweep) {
        match &self.operator.arrangement {
            Arrangement::Radial(all) => self.over_all(all, sweep),
            Arrangement::General(all) => self.over_all(all, sweep),
        }
    }

    /// Code of its own where bodies move one by one and contacts are rigid: it takes 0.95 of the time.
    fn over_all<G: Geometry>(self, geometry: &[G], sweep: Sweep) {
        let is_coupled = self.operator.mechanisms.is_some() || self.operator.compliance.len() > 0;
        match (sweep.model, is_coupled) {
            (FrictionModel::Coulomb, false) => self.over::<_, true, false>(geometry, sweep),
            (FrictionModel::Coulomb, true) => self.over::<_, true, true>(geometry, sweep),
            (FrictionModel::Relaxed, false) => self.over::<_, false, false>(geometry, sweep),
            (FrictionModel::Relaxed, true) => self.over::<_, false, true>(geometry, sweep),
        }
    }

    fn over<G: Geometry, const EXACT: bool, const COUPLED: bool>(self, geometry: &[G], sweep: Sweep) {
        let geometry = &geometry[self.batches.clone()];
        vectorised(InSingle(PartOver::<G, EXACT, COUPLED> { part: self, geometry, sweep }));
    }
}

/// The same over contacts of this geometry.
struct PartOver<'a, 'b, G, const EXACT: bool, const COUPLED: bool> {
    part: Part<'a>,
    geometry: &'b [G],
    sweep: Sweep,
}

impl<G: Geometry, const EXACT: bool, const COUPLED: bool> SingleWork for PartOver<'_, '_, G, EXACT, COUPLED> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let Sweep { beta, relaxation, .. } = self.sweep;
        let Part { sweeps, operator, batches, bodies, vectors, image, window, rests, sum } = self.part;
        let masses = operator.masses.within(bodies);
        if let Some((fixed, own)) = window.split_last_mut() {
            own.copy_from_slice(image);
            *fixed = Octet::default();
        }
        let has_window = !window.is_empty();
        let known = if has_window { &mut window[..] } else { &mut image[..] };
        let compliance = if COUPLED { operator.compliance.of(batches.clone()) } else { &[] };
        let [x, previous] = vectors;
        let (x, previous) = (V::of_batches(x), V::of_batches(previous));
        let mut tally = SingleTally::<V>::default();
        *sum = [0.0; 2];
        for (offset, own) in self.geometry.iter().enumerate() {
            let flushes = offset % CHUNK == CHUNK - 1 || offset + 1 == self.geometry.len();
            if let Some(left) = rests[offset].checked_sub(1) {
                rests[offset] = left;
            } else {
                if let Some(later) = self.geometry.get(offset + PREFETCH) {
                    V::prefetch(later);
                }
                let batch = batches.start + offset;
                let numbers = &operator.contacts[batch];
                let step = V::splat(relaxation) * V::of(sweeps.step[batch]);
                let (mu, r) = (V::of(numbers.mu), load(&numbers.r));
                let (x, previous) = (&mut x[offset], &mut previous[offset]);
                let places = &sweeps.places[batch];
                let mechanisms = operator.mechanisms.as_ref().filter(|_| COUPLED && sweeps.coupled[batch]);
                for moves in &sweeps.moves[sweeps.first[batch] as usize..sweeps.first[batch + 1] as usize] {
                    if let Some(mechanisms) = mechanisms {
                        bring::<V>(places, moves, mechanisms, known);
                    }
                    let mut u = own.relative([velocities(&places[0], known), velocities(&places[1], known)]);
                    let y = extrapolated(x, previous, beta);
                    if let Some(compliance) = compliance.get(offset) {
                        u[0] += V::of(*compliance) * y[0];
                    }
                    let point = sub(&y, &scale(step, &add(&u, &r)));
                    let tangential = tangential_length(&point);
                    let new = match EXACT {
                        true => within_disc(mu, &point, tangential),
                        false => project_given(mu, &point, tangential),
                    };
                    let change = take([x, previous], [&y, &new], V::of(*moves), &mut tally.sum);
                    let [p, on_a, on_b] = own.impulses(&change);
                    push(places, &p, [&on_a, &on_b], masses, known);
                    if let Some(mechanisms) = mechanisms {
                        push_coupled((places, moves), &p, [&on_a, &on_b], mechanisms, known);
                    }
                }
                let is_open = |normal: V| normal.octet().0.iter().all(|g| *g == 0.0);
                if is_open(x[0]) && is_open(previous[0]) {
                    rests[offset] = REST;
                }
            }
            if flushes {
                for (total, own) in sum.iter_mut().zip(&mut tally.sum) {
                    *total += own.octet().sum();
                    *own = V::default();
                }
            }
        }
        if has_window {
            image.copy_from_slice(&window[..image.len()]);
        }
    }
}
