//! N' over rigid bodies in single precision: one pass over contacts, one over bodies.

use super::super::body_pass::{num_body_tasks, over_bodies};
use super::super::cell_images::PackedCell;
use super::super::combination::Combination;
use super::super::compliance::PackedCompliance;
use super::super::dispatch::vectorised;
use super::super::lanes::{Batch, add, tangential_length, zero};
use super::super::mechanisms::PackedMechanisms;
use super::super::octet::{EIGHT, InSingle, Octet, SingleVector, SingleWork};
use super::super::share::{Buffers, Share, part_of};
use super::super::slots::SlotTable;
use super::super::tasks::{Tally, Totals, for_each_task};
use super::geometry::{General, Geometry, Radial, load};
use super::kernel::{Seen, SingleKernel, SingleTally};
use std::ops::Range;

/// Batches per chunk of contacts: as many contacts as a chunk in double precision.
pub(super) const CHUNK: usize = 128;
/// So many batches ahead a pass asks for geometry.
pub(super) const PREFETCH: usize = 6;

/// The geometry of all batches, in the cheaper of its forms.
#[derive(Clone, Debug)]
pub(super) enum Arrangement {
    Radial(Vec<Radial>),
    General(Vec<General>),
}

/// Friction and free velocities of eight contacts.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ContactNumbers {
    pub(super) r: Batch<Octet>,
    /// mu'
    pub(super) mu: Octet,
}

/// Inverse masses of bodies: of u and w the factors of (x, y, z), and those of (y, z, x) and (z, x, y).
#[derive(Clone, Debug)]
pub(super) struct InverseMasses {
    pub(super) diagonal: Vec<Octet>,
    /// Empty where no body has any.
    pub(super) others: Vec<[Octet; 2]>,
}

impl InverseMasses {
    /// Whether every body is moved alike by forces along all axes, and turned alike.
    pub(super) fn are_isotropic(&self) -> bool {
        let alike =
            |diagonal: &Octet| diagonal.0.as_chunks::<4>().0.iter().all(|[x, y, z, _]| x == y && x == z);
        self.others.is_empty() && self.diagonal.iter().all(alike)
    }

    /// Those of a range of places.
    pub(super) fn within(&self, places: Range<usize>) -> Masses<'_> {
        let others = if self.others.is_empty() { &[] } else { &self.others[places.clone()] };
        Masses { diagonal: &self.diagonal[places], others }
    }
}

/// Inverse masses of the bodies of a range of places.
#[derive(Clone, Copy)]
pub(super) struct Masses<'a> {
    diagonal: &'a [Octet],
    others: &'a [[Octet; 2]],
}

impl Masses<'_> {
    /// M^-1 of a force and a moment on the body at a place; none on what is fixed.
    #[inline(always)]
    pub(super) fn times<V: SingleVector>(&self, place: usize, force: V) -> V {
        let Some(diagonal) = self.diagonal.get(place) else { return V::default() };
        let mut velocity = V::of(*diagonal) * force;
        if let Some([next, last]) = self.others.get(place) {
            let rotated = force.rotated();
            velocity += V::of(*next) * rotated + V::of(*last) * rotated.rotated();
        }
        velocity
    }
}

/// Scratch of passes.
#[derive(Clone, Debug)]
pub struct SingleScratch {
    slots: Vec<Octet>,
    /// For what mechanisms make in a pass.
    room: Vec<Octet>,
    tallies: Vec<Tally>,
    buffers: Buffers,
}

/// N' and r'.
#[derive(Clone, Debug)]
pub(super) struct SingleOperator {
    pub(super) arrangement: Arrangement,
    pub(super) contacts: Vec<ContactNumbers>,
    pub(super) masses: InverseMasses,
    pub(super) slots: SlotTable,
    /// Number of places of bodies and of images; that after the last one is the fixed body's.
    pub(super) num_places: usize,
    /// A stress-controlled periodic cell.
    pub(super) cell: Option<PackedCell>,
    /// Bodies that joints couple: their inverse masses are zero here.
    pub(super) mechanisms: Option<PackedMechanisms<Octet>>,
    /// Compliant contacts.
    pub(super) compliance: PackedCompliance<Octet>,
    /// What this rank does of a pass, where there are several.
    pub(super) share: Option<Box<Share>>,
}

/// Batches, of so many, of the chunks that a share has; all of them where there is none.
pub(super) fn own_batches(share: Option<&Share>, batches: usize) -> Range<usize> {
    let bound = |chunk: usize| (chunk * CHUNK).min(batches);
    share.map_or(0..batches, |share| bound(share.chunks().start)..bound(share.chunks().end))
}

impl SingleOperator {
    /// Vectors of an image: one per body and image, a zero for the fixed body, a cell's L, the q of
    /// mechanisms, and C x.
    pub(super) fn image_len(&self) -> usize {
        let mechanisms = self.mechanisms.as_ref().map_or(0, PackedMechanisms::len);
        self.num_places + 1 + usize::from(self.cell.is_some()) + mechanisms + self.compliance.len()
    }

    pub(super) fn scratch(&self) -> SingleScratch {
        let tasks = self.contacts.len().div_ceil(CHUNK).max(num_body_tasks(self.masses.diagonal.len()));
        SingleScratch {
            slots: vec![Octet::default(); self.slots.len()],
            room: self.mechanisms.as_ref().map_or_else(Vec::new, PackedMechanisms::room),
            tallies: vec![Tally::default(); tasks],
            buffers: Buffers::default(),
        }
    }

    /// Whether scaled blocks N'_ii of contacts with arms along their normals are unit matrices: of balls.
    pub(super) fn blocks_are_units(&self) -> bool {
        self.mechanisms.is_none() && self.compliance.len() == 0 && self.masses.are_isotropic()
    }

    /// Batches of the chunks of this rank.
    pub(super) fn own_batches(&self) -> Range<usize> {
        own_batches(self.share.as_deref(), self.contacts.len())
    }

    /// One pass over the contacts: the kernel sees u = N' y + r' with the image of y where GATHER, else with
    /// zeros; what it returns is left in the slots where SCATTER.
    pub(super) fn contact_pass<const M: usize, const GATHER: bool, const SCATTER: bool>(
        &self,
        image: &[Octet],
        vectors: [&mut [Batch<Octet>]; M],
        scratch: &mut SingleScratch,
        kernel: &impl SingleKernel<M>,
    ) -> Totals {
        match &self.arrangement {
            Arrangement::Radial(all) => {
                self.pass_over::<_, M, GATHER, SCATTER>(all, image, vectors, scratch, kernel)
            }
            Arrangement::General(all) => {
                self.pass_over::<_, M, GATHER, SCATTER>(all, image, vectors, scratch, kernel)
            }
        }
    }

    #[inline(always)]
    fn pass_over<G: Geometry, const M: usize, const GATHER: bool, const SCATTER: bool>(
        &self,
        geometry: &[G],
        image: &[Octet],
        vectors: [&mut [Batch<Octet>]; M],
        scratch: &mut SingleScratch,
        kernel: &impl SingleKernel<M>,
    ) -> Totals {
        let chunks = geometry.len().div_ceil(CHUNK);
        let SingleScratch { slots, tallies, buffers, .. } = scratch;
        let tallies = &mut tallies[..chunks];
        let len = |chunks| self.slots.of_chunks(chunks).len();
        let own = self.share.as_deref().map_or(0..chunks, Share::chunks);
        let vectors = part_of(vectors, &own, CHUNK);
        let own_slots = &mut slots[self.slots.of_chunks(own.clone())];
        let own_tallies = &mut tallies[own.clone()];
        for_each_task(own, CHUNK, vectors, own_slots, &len, own_tallies, &|chunk, vectors, slots, tally| {
            let first = chunk * CHUNK;
            let contacts = &self.contacts[first..];
            let geometry = &geometry[first..];
            let batches = first..first + vectors[0].len();
            vectorised(InSingle(ContactPass::<G, M, GATHER, SCATTER, _> {
                geometry,
                contacts,
                compliance: self.compliance.of(batches.clone()),
                compression: self.compliance.within(image, batches),
                first,
                image,
                vectors,
                slots,
                tally,
                kernel,
            }));
        });
        let Some(share) = &self.share else { return Totals::of(tallies) };
        share.passed(EIGHT * self.own_batches().len());
        share.end_pass(SCATTER.then_some(&mut slots[..]), tallies, buffers)
    }

    /// Combines the image of what the contacts left in the slots with images; the quadratic form, force dot
    /// velocity.
    pub(super) fn body_pass<const K: usize>(
        &self,
        images: [&mut [Octet]; K],
        scratch: &mut SingleScratch,
        combination: &impl Combination<K>,
    ) -> f64 {
        let bodies = self.masses.diagonal.len();
        let mut all = images;
        let images = all.each_mut().map(|image| &mut image[..bodies]);
        let SingleScratch { slots, room, tallies, buffers } = scratch;
        let slots = &slots[..];
        let work = |first: usize, images: [&mut [Octet]; K], tally: &mut Tally| {
            vectorised(InSingle(BodyPass { operator: self, first, slots, images, tally, combination }));
        };
        let mut sum = over_bodies(self.share.as_deref(), images, tallies, buffers, &work);
        if let Some(mechanisms) = &self.mechanisms {
            let all = all.each_mut().map(|image| &mut **image);
            sum += mechanisms.follow((slots, &self.slots), room, all, combination);
        }
        let whole = all.each_mut().map(|image| &mut **image);
        sum += self.compliance.follow((slots, &self.slots), whole, tallies, combination);
        match &self.cell {
            Some(cell) => sum + cell.follow((slots, &self.slots), all, combination),
            None => sum,
        }
    }
}

/// What one task does of a pass over contacts.
struct ContactPass<'a, G, const M: usize, const GATHER: bool, const SCATTER: bool, K> {
    geometry: &'a [G],
    contacts: &'a [ContactNumbers],
    /// c' and C y of compliant contacts; empty where all are rigid.
    compliance: &'a [Octet],
    compression: &'a [Octet],
    first: usize,
    image: &'a [Octet],
    vectors: [&'a mut [Batch<Octet>]; M],
    slots: &'a mut [Octet],
    tally: &'a mut Tally,
    kernel: &'a K,
}

impl<G, const M: usize, const GATHER: bool, const SCATTER: bool, K> SingleWork
    for ContactPass<'_, G, M, GATHER, SCATTER, K>
where
    G: Geometry,
    K: SingleKernel<M>,
{
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let Self {
            geometry,
            contacts,
            compliance,
            compression,
            first,
            image,
            vectors,
            slots,
            tally: total,
            kernel,
        } = self;
        let behind = if compliance.is_empty() { 0 } else { CHUNK };
        let (slots, left) = slots.split_at_mut(slots.len() - behind);
        if SCATTER {
            slots.fill(Octet::default());
        }
        let batches = vectors[0].len();
        let mut vectors = vectors.map(V::of_batches);
        let mut tally = SingleTally::<V>::default();
        let ahead = Ahead::<GATHER, G, K> { geometry, contacts, compression, first, image, kernel };
        // Three batches are under way at once, so that the processor has something to do while it waits for
        // roots and quotients.
        let last = batches - 1;
        let mut ready = ahead.projected::<V, M>(ahead.rooted::<V, M>(0, &vectors));
        let mut rooted = ahead.rooted::<V, M>(last.min(1), &vectors);
        for (batch, own) in geometry[..batches].iter().enumerate() {
            if let Some(later) = geometry.get(batch + PREFETCH) {
                V::prefetch(later);
            }
            let (seen, projected) = ready;
            ready = ahead.projected::<V, M>(rooted);
            rooted = ahead.rooted::<V, M>(last.min(batch + 2), &vectors);
            let mine = vectors.each_mut().map(|v| &mut v[batch]);
            let s = kernel.at(&seen, projected, mine, &mut tally);
            if SCATTER {
                own.scatter(&s, slots);
                if let Some(compliance) = compliance.get(batch) {
                    left[batch] = (V::of(*compliance) * s[0]).octet();
                }
            }
        }
        for (sum, own) in total.sum.iter_mut().zip(tally.sum) {
            sum.0[0] = own.octet().sum();
        }
        total.max.0[0] = f64::from(tally.max.octet().largest());
    }
}

/// What a pass does at a batch before the update.
struct Ahead<'a, const GATHER: bool, G, K> {
    geometry: &'a [G],
    contacts: &'a [ContactNumbers],
    compression: &'a [Octet],
    first: usize,
    image: &'a [Octet],
    kernel: &'a K,
}

impl<const GATHER: bool, G: Geometry, K> Ahead<'_, GATHER, G, K> {
    /// What the kernel is given at a batch of the chunk, with the point to be projected and its tangential
    /// length.
    #[inline(always)]
    fn rooted<V: SingleVector, const M: usize>(
        &self,
        batch: usize,
        vectors: &[&mut [Batch<V>]; M],
    ) -> (Seen<V>, Batch<V>, V)
    where
        K: SingleKernel<M>,
    {
        let numbers = &self.contacts[batch];
        let mut u = zero();
        if GATHER {
            u = add(&self.geometry[batch].relative_velocity(self.image), &load(&numbers.r));
            if let Some(compression) = self.compression.get(batch) {
                u[0] += V::of(*compression);
            }
        }
        let seen = Seen { batch: self.first + batch, mu: V::of(numbers.mu), u };
        let point = self.kernel.point(&seen, vectors.each_ref().map(|v| &v[batch]));
        (seen, point, tangential_length(&point))
    }

    /// The same with the projection of the point.
    #[inline(always)]
    fn projected<V: SingleVector, const M: usize>(
        &self,
        (seen, point, tangential): (Seen<V>, Batch<V>, V),
    ) -> (Seen<V>, Batch<V>)
    where
        K: SingleKernel<M>,
    {
        (seen, self.kernel.projected(&seen, &point, tangential))
    }
}

/// Velocities of some bodies from the slots.
struct BodyPass<'a, const K: usize, C> {
    operator: &'a SingleOperator,
    first: usize,
    slots: &'a [Octet],
    images: [&'a mut [Octet]; K],
    tally: &'a mut Tally,
    combination: &'a C,
}

impl<const K: usize, C: Combination<K>> SingleWork for BodyPass<'_, K, C> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let Self { operator, first, slots, mut images, tally, combination } = self;
        let masses = operator.masses.within(0..operator.masses.diagonal.len());
        let mut quadratic = V::default();
        let mechanisms = operator.mechanisms.as_ref();
        for offset in 0..images[0].len() {
            let body = first + offset;
            if mechanisms.is_some_and(|mechanisms| mechanisms.has(body as u32)) {
                continue;
            }
            let mut force = V::default();
            for &slot in operator.slots.of_body(body) {
                force += V::of(slots[slot as usize]);
            }
            let velocity = masses.times(body, force);
            quadratic += force * velocity;
            // Loops, because closures need not be compiled for the processor's vector instructions.
            let mut known = [V::default(); K];
            for (known, image) in known.iter_mut().zip(&images) {
                *known = V::of(image[offset]);
            }
            for (image, new) in images.iter_mut().zip(combination.of(velocity, known)) {
                image[offset] = new.octet();
            }
        }
        tally.sum[0].0[0] = quadratic.octet().sum();
    }
}
