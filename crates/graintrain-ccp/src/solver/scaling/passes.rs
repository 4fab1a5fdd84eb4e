//! What one task does of a pass over the contacts: velocities, the method's update, forces; over bodies, or
//! over rows of N'.

use super::super::body_operator::{BodyOperator, BodyPair, Geometry, Update};
use super::super::gauss_seidel::take;
use super::super::lanes::{
    Batch, Lanes, TaskWork, Vector, add, in_place, load, store, tangential_length, zero,
};
use super::super::momentum::{extrapolate, extrapolated};
use super::super::tasks::{CHUNK, Tally};
use super::contacts::{ContactArrays, ContactBatch, TurningBatch};
use super::kernel::{Kernel, KernelInput, Relaxation};

/// So many batches ahead a pass over bodies asks for geometry.
const PREFETCH: usize = 8;

/// The part of a pass over bodies that one chunk does.
pub(super) struct BodyPass<'a, const M: usize, const GATHER: bool, const SCATTER: bool, K> {
    pub(super) contacts: ContactArrays<'a>,
    pub(super) bodies: &'a BodyOperator,
    pub(super) velocity: &'a [BodyPair],
    /// C y; empty where all contacts are rigid.
    pub(super) compression: &'a [Lanes],
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
        let Self { contacts, bodies, velocity, compression, batches, vectors, slots, tally: total, kernel } =
            self;
        let mut left = Left::of(&contacts, slots, SCATTER);
        let mut vectors = vectors.map(in_place::<V>);
        let mut tally = Tally::default();
        let following = &bodies.geometry()[batches.start..];
        let geometry = &following[..batches.len()];
        if !contacts.turning.is_empty() {
            let mut batch = 0;
            while let Some(own) = geometry.get(batch) {
                let contact = contacts.at(batch);
                let u = seen::<GATHER, M, K, V>(own, (velocity, compression.get(batch)), &contact);
                if let Some(turning) = contacts.turning_at::<V>(batch) {
                    let rows = &geometry[batch + 1];
                    let w = match (GATHER, K::GRADIENT) {
                        (false, _) => zero(),
                        (true, false) => rows.relative_spin(velocity),
                        (true, true) => add(&rows.relative_spin(velocity), &turning.rows.r),
                    };
                    let mine = vectors.each_mut().map(|v| pair_of(v, batch));
                    let [s, turn] = both(kernel, contact, &turning, [u, w], mine, &mut tally);
                    if SCATTER {
                        left.take(own, batch, &s);
                        rows.scatter_turning(&turn, left.slots);
                    }
                    batch += 2;
                } else {
                    let point = kernel.point(contact, &u, vectors.each_ref().map(|v| &v[batch]));
                    let projected = kernel.projected(contact, &u, &point, tangential_length(&point));
                    let mine = vectors.each_mut().map(|v| &mut v[batch]);
                    let s = kernel.at(contact, KernelInput { u, projected }, mine, &mut tally);
                    if SCATTER {
                        left.take(own, batch, &s);
                    }
                    batch += 1;
                }
            }
            *total = tally.store();
            return;
        }
        if K::SHORT {
            for (batch, geometry) in geometry.iter().enumerate() {
                let contact = contacts.at(batch);
                let u = seen::<GATHER, M, K, V>(geometry, (velocity, compression.get(batch)), &contact);
                let mine = vectors.each_mut().map(|v| &mut v[batch]);
                let s = kernel.at(contact, KernelInput { u, projected: zero() }, mine, &mut tally);
                if SCATTER {
                    left.take(geometry, batch, &s);
                }
            }
            *total = tally.store();
            return;
        }
        // Three batches are under way at once: the root of one, the quotient of the one before, the update of
        // the one before that. Roots and quotients take tens of cycles, which the processor hides only where
        // enough is at hand that does not wait for them.
        let ahead = Ahead { kernel, contacts, geometry, velocity, compression };
        let last = geometry.len() - 1;
        let mut input = ahead.input::<V, M>(0, &ahead.rooted::<GATHER, V, M>(0, &vectors));
        let mut rooted = ahead.rooted::<GATHER, V, M>(last.min(1), &vectors);
        for (batch, this_geometry) in geometry.iter().enumerate() {
            // The memory would have nothing to do here: this loop alone, in memory, takes 0.94 of the time.
            if let Some(later) = following.get(batch + PREFETCH) {
                V::prefetch(later);
            }
            let now = input;
            input = ahead.input::<V, M>(last.min(batch + 1), &rooted);
            rooted = ahead.rooted::<GATHER, V, M>(last.min(batch + 2), &vectors);
            let mine = vectors.each_mut().map(|v| &mut v[batch]);
            let s = kernel.at(contacts.at(batch), now, mine, &mut tally);
            if SCATTER {
                left.take(this_geometry, batch, &s);
            }
        }
        *total = tally.store();
    }
}

/// Where the contacts of a chunk leave what they do.
struct Left<'a> {
    slots: &'a mut [BodyPair],
    /// c' of compliant contacts, and where C s goes.
    compliance: &'a [Lanes],
    compression: &'a mut [Lanes],
}

impl<'a> Left<'a> {
    #[inline(always)]
    fn of(contacts: &ContactArrays<'a>, slots: &'a mut [BodyPair], clear: bool) -> Self {
        let behind = if contacts.compliance.is_empty() { 0 } else { CHUNK / 2 };
        let (slots, behind) = slots.split_at_mut(slots.len() - behind);
        if clear {
            slots.fill(BodyPair::default());
        }
        Self { slots, compliance: contacts.compliance, compression: behind.as_flattened_mut() }
    }

    /// The impulses of a batch of contacts.
    #[inline(always)]
    fn take<V: Vector>(&mut self, geometry: &Geometry, batch: usize, s: &Batch<V>) {
        geometry.scatter(s, self.slots);
        if let Some(compliance) = self.compliance.get(batch) {
            self.compression[batch] = (V::of(*compliance) * s[0]).lanes();
        }
    }
}

/// A batch of contacts that resist turning and the batch of their turning rows.
#[inline(always)]
fn pair_of<'a, V>(vector: &'a mut &mut [Batch<V>], batch: usize) -> &'a mut [Batch<V>; 2] {
    vector[batch..].first_chunk_mut().expect("turning rows follow their contacts in the same chunk")
}

/// All that a kernel does at contacts that resist turning and at their turning rows.
#[inline(always)]
fn both<const M: usize, K: Kernel<M>, V: Vector>(
    kernel: &K,
    contact: ContactBatch<V>,
    turning: &TurningBatch<V>,
    u: [Batch<V>; 2],
    mine: [&mut [Batch<V>; 2]; M],
    tally: &mut Tally<V>,
) -> [Batch<V>; 2] {
    let points = kernel.points(contact, turning, &u, mine.each_ref().map(|v| &**v));
    let projected = kernel.projected_both(contact, turning, points.each_ref());
    let inputs = [0, 1].map(|k| KernelInput { u: u[k], projected: projected[k] });
    kernel.at_both(contact, turning, inputs, mine, tally)
}

/// What a pass does at a batch before the update.
struct Ahead<'a, K> {
    kernel: &'a K,
    contacts: ContactArrays<'a>,
    geometry: &'a [Geometry],
    velocity: &'a [BodyPair],
    compression: &'a [Lanes],
}

/// A point to be projected and its tangential length, with u.
struct Rooted<V> {
    u: Batch<V>,
    point: Batch<V>,
    tangential: V,
}

impl<K> Ahead<'_, K> {
    #[inline(always)]
    fn rooted<const GATHER: bool, V: Vector, const M: usize>(
        &self,
        batch: usize,
        vectors: &[&mut [Batch<V>]; M],
    ) -> Rooted<V>
    where
        K: Kernel<M>,
    {
        let contact = self.contacts.at(batch);
        let image = (self.velocity, self.compression.get(batch));
        let u = seen::<GATHER, M, K, V>(&self.geometry[batch], image, &contact);
        let point = self.kernel.point(contact, &u, vectors.each_ref().map(|v| &v[batch]));
        Rooted { u, point, tangential: tangential_length(&point) }
    }

    #[inline(always)]
    fn input<V: Vector, const M: usize>(&self, batch: usize, rooted: &Rooted<V>) -> KernelInput<V>
    where
        K: Kernel<M>,
    {
        let Rooted { u, point, tangential } = rooted;
        KernelInput {
            u: *u,
            projected: self.kernel.projected(self.contacts.at(batch), u, point, *tangential),
        }
    }
}

/// The kernel's u.
#[inline(always)]
fn seen<const GATHER: bool, const M: usize, K: Kernel<M>, V: Vector>(
    geometry: &Geometry,
    (velocity, compression): (&[BodyPair], Option<&Lanes>),
    contact: &ContactBatch<V>,
) -> Batch<V> {
    if !GATHER {
        return zero();
    }
    let mut product = geometry.relative_velocity(velocity);
    if let Some(compression) = compression {
        product[0] += V::of(*compression);
    }
    if K::GRADIENT { add(&product, &contact.r) } else { product }
}

/// A sweep of Gauss-Seidel over bodies.
pub(super) struct BodySweep<'a, K> {
    pub(super) contacts: ContactArrays<'a>,
    pub(super) bodies: &'a BodyOperator,
    /// x and the x before.
    pub(super) vectors: [&'a mut [Batch]; 2],
    /// Their images.
    pub(super) images: [&'a mut [Lanes]; 2],
    pub(super) beta: f64,
    pub(super) kernel: &'a K,
    pub(super) tally: &'a mut Tally,
}

impl<K: Relaxation> TaskWork for BodySweep<'_, K> {
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { contacts, bodies, vectors, images: [image, previous_image], beta, kernel, tally } = self;
        extrapolate(V::of_slice(image), V::of_slice(previous_image), beta);
        let [x, previous] = vectors.map(in_place);
        let mut relaxing = Relaxing { contacts, x, previous, beta, kernel, tally: Tally::default() };
        bodies.sweep::<V>(image, &mut relaxing);
        *tally = relaxing.tally.store();
        let compression = bodies.compliance().all_within(image);
        for (batch, compression) in compression.iter_mut().enumerate() {
            *compression = (V::of(contacts.compliance[batch]) * relaxing.x[batch][0]).lanes();
        }
    }
}

/// The contacts' part of a sweep.
struct Relaxing<'a, V, K> {
    contacts: ContactArrays<'a>,
    x: &'a mut [Batch<V>],
    previous: &'a mut [Batch<V>],
    beta: f64,
    kernel: &'a K,
    tally: Tally<V>,
}

impl<V: Vector, K: Relaxation> Relaxing<'_, V, K> {
    /// y of a batch.
    #[inline(always)]
    fn point(&self, batch: usize) -> Batch<V> {
        extrapolated(&self.x[batch], &self.previous[batch], self.beta)
    }

    /// u + C y.
    #[inline(always)]
    fn with_compression(&self, batch: usize, mut u: Batch<V>, y: &Batch<V>) -> Batch<V> {
        if let Some(compliance) = self.contacts.compliance.get(batch) {
            u[0] += V::of(*compliance) * y[0];
        }
        u
    }

    /// As [`take`].
    #[inline(always)]
    fn take(&mut self, batch: usize, y: &Batch<V>, new: &Batch<V>, moves: V) -> Batch<V> {
        take([&mut self.x[batch], &mut self.previous[batch]], [y, new], moves, &mut self.tally.sum)
    }
}

impl<V: Vector, K: Relaxation> Update<V> for Relaxing<'_, V, K> {
    #[inline(always)]
    fn at(&mut self, batch: usize, velocity: &Batch<V>, moves: V) -> Batch<V> {
        let contact = self.contacts.at(batch);
        let y = self.point(batch);
        let u = self.with_compression(batch, add(velocity, &contact.r), &y);
        let new = self.kernel.relaxed(batch, contact, &u, &y);
        self.take(batch, &y, &new, moves)
    }

    #[inline(always)]
    fn at_turning(&mut self, batch: usize, [u, w]: [Batch<V>; 2], moves: V) -> [Batch<V>; 2] {
        let contact = self.contacts.at(batch);
        let turning = self.contacts.turning_at(batch).expect("the contacts resist turning");
        let y = [self.point(batch), self.point(batch + 1)];
        let u = [self.with_compression(batch, add(&u, &contact.r), &y[0]), add(&w, &turning.rows.r)];
        let new = self.kernel.relaxed_turning(batch, contact, turning, &u, y.each_ref());
        [self.take(batch, &y[0], &new[0], moves), self.take(batch + 1, &y[1], &new[1], moves)]
    }
}

/// The part of a pass over rows that one chunk does before the product.
pub(super) struct RowPass<'a, const M: usize, const GATHER: bool, K> {
    pub(super) contacts: ContactArrays<'a>,
    pub(super) product: &'a [Batch],
    pub(super) batches: std::ops::Range<usize>,
    pub(super) vectors: [&'a mut [Batch]; M],
    pub(super) scattered: &'a mut [Batch],
    pub(super) tally: &'a mut Tally,
    pub(super) kernel: &'a K,
}

impl<const M: usize, const GATHER: bool, K> TaskWork for RowPass<'_, M, GATHER, K>
where
    K: Kernel<M>,
{
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { contacts, product, batches, vectors, scattered, tally: total, kernel } = self;
        let mut vectors = vectors.map(in_place::<V>);
        let mut tally = Tally::default();
        if !contacts.turning.is_empty() {
            let u_of = |offset: usize, r: &Batch<V>| match (GATHER, K::GRADIENT) {
                (false, _) => zero(),
                (true, false) => load(&product[batches.start + offset]),
                (true, true) => add(&load(&product[batches.start + offset]), r),
            };
            let mut offset = 0;
            while offset < batches.len() {
                let contact = contacts.at(offset);
                let u = u_of(offset, &contact.r);
                if let Some(turning) = contacts.turning_at::<V>(offset) {
                    let w = u_of(offset + 1, &turning.rows.r);
                    let mine = vectors.each_mut().map(|v| pair_of(v, offset));
                    let [s, turn] = both(kernel, contact, &turning, [u, w], mine, &mut tally);
                    (scattered[offset], scattered[offset + 1]) = (store(&s), store(&turn));
                    offset += 2;
                } else {
                    let point = kernel.point(contact, &u, vectors.each_ref().map(|v| &v[offset]));
                    let projected = kernel.projected(contact, &u, &point, tangential_length(&point));
                    let mine = vectors.each_mut().map(|v| &mut v[offset]);
                    scattered[offset] =
                        store(&kernel.at(contact, KernelInput { u, projected }, mine, &mut tally));
                    offset += 1;
                }
            }
            *total = tally.store();
            return;
        }
        for (offset, (batch, scattered)) in batches.zip(scattered).enumerate() {
            let contact = contacts.at(offset);
            let u = match (GATHER, K::GRADIENT) {
                (false, _) => zero(),
                (true, false) => load(&product[batch]),
                (true, true) => add(&load(&product[batch]), &contact.r),
            };
            let point = kernel.point(contact, &u, vectors.each_ref().map(|v| &v[offset]));
            let projected = kernel.projected(contact, &u, &point, tangential_length(&point));
            let mine = vectors.each_mut().map(|v| &mut v[offset]);
            *scattered = store(&kernel.at(contact, KernelInput { u, projected }, mine, &mut tally));
        }
        *total = tally.store();
    }
}
