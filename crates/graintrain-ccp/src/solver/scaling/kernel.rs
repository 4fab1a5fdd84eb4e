//! What a pass does at four contacts: the interface of a method's update, and the updates that the scaled
//! problem needs itself.

use super::super::lanes::{Batch, Vector, dot, project_given, project_turning, scale, sub, zero};
use super::super::tasks::Tally;
use super::contacts::{ContactBatch, Metric, TurningBatch};

/// What a method does at four contacts in a pass. A type rather than a closure, because only
/// `#[inline(always)]` functions are sure to be compiled for the processor's vector instructions.
pub trait Kernel<const M: usize>: Sync {
    /// Whether the update takes no root and no quotient, whose tens of cycles the pass has to hide.
    const SHORT: bool = false;
    /// Whether u is the gradient N' y + r', or only N' y.
    const GRADIENT: bool = true;

    /// The point whose projection on the cones the update wants, given u and the method's vectors at this
    /// batch. Its tangential length, a root, is taken two batches ahead of the update, the projection, with
    /// its quotient, one batch ahead.
    #[inline(always)]
    fn point<V: Vector>(
        &self,
        _contact: ContactBatch<V>,
        _u: &Batch<V>,
        _vectors: [&Batch<V>; M],
    ) -> Batch<V> {
        zero()
    }

    /// The projection of the point, given its tangential length, or whatever else is to be made of them by a
    /// quotient.
    #[inline(always)]
    fn projected<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        _u: &Batch<V>,
        point: &Batch<V>,
        tangential: V,
    ) -> Batch<V> {
        project_given(contact.mu, point, tangential)
    }

    /// Given u and the projection of the point, updates the method's vectors at this batch, adds to the tally
    /// and returns the batch whose image the pass computes.
    fn at<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        input: KernelInput<V>,
        vectors: [&mut Batch<V>; M],
        tally: &mut Tally<V>,
    ) -> Batch<V>;

    /// [`Self::point`] of contacts that resist turning, and of their turning rows.
    #[inline(always)]
    fn points<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        [u, w]: &[Batch<V>; 2],
        vectors: [&[Batch<V>; 2]; M],
    ) -> [Batch<V>; 2] {
        let of_turning = vectors.map(|v| &v[1]);
        [self.point(contact, u, vectors.map(|v| &v[0])), self.point(turning.rows, w, of_turning)]
    }

    /// [`Self::projected`] of both, whose cones are one.
    #[inline(always)]
    fn projected_both<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        [point, turned]: [&Batch<V>; 2],
    ) -> [Batch<V>; 2] {
        turning.project(contact.mu, [point, turned])
    }

    /// [`Self::at`] of both.
    #[inline(always)]
    fn at_both<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        [input, turned]: [KernelInput<V>; 2],
        mut vectors: [&mut [Batch<V>; 2]; M],
        tally: &mut Tally<V>,
    ) -> [Batch<V>; 2] {
        let first = self.at(contact, input, vectors.each_mut().map(|v| &mut v[0]), tally);
        [first, self.at(turning.rows, turned, vectors.map(|v| &mut v[1]), tally)]
    }
}

/// What a kernel is given at four contacts.
#[derive(Clone, Copy)]
pub struct KernelInput<V> {
    /// u = N' y + r', or N' y where the kernel wants only that.
    pub u: Batch<V>,
    /// What [`Kernel::projected`] has made of [`Kernel::point`].
    pub projected: Batch<V>,
}

/// What Gauss-Seidel makes of the impulses of four contacts, given their velocities.
pub trait Relaxation: Sync {
    /// The new impulses.
    fn relaxed<V: Vector>(
        &self,
        batch: usize,
        contact: ContactBatch<V>,
        u: &Batch<V>,
        x: &Batch<V>,
    ) -> Batch<V>;

    /// The same for contacts that resist turning and their turning rows.
    fn relaxed_turning<V: Vector>(
        &self,
        batch: usize,
        contact: ContactBatch<V>,
        turning: TurningBatch<V>,
        u: &[Batch<V>; 2],
        x: [&Batch<V>; 2],
    ) -> [Batch<V>; 2];
}

/// Returns the vector: its image is wanted.
pub(super) struct Identity;

impl Kernel<1> for Identity {
    const SHORT: bool = true;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        _: KernelInput<V>,
        [x]: [&mut Batch<V>; 1],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        *x
    }
}

/// x <- factor N' x; tallies |x|^2.
pub(super) struct PowerStep {
    pub(super) factor: f64,
}

impl Kernel<1> for PowerStep {
    const SHORT: bool = true;
    const GRADIENT: bool = false;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { u, .. }: KernelInput<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        *x = scale(V::splat(self.factor), &u);
        tally.sum[0] += dot(x, x);
        *x
    }
}

/// Tallies the maximum and the sum of (eta_i |d_i| / V)^2 of the natural map in the original metric, no less
/// than the rounding of the impulse (as
/// [`ResidualScale::residual`](crate::residual::ResidualScale::residual)); gives d.
/// The vectors are x and, where no pass has computed it, u.
pub(super) struct NaturalMap;

impl<const M: usize> Kernel<M> for NaturalMap {
    #[inline(always)]
    fn point<V: Vector>(&self, contact: ContactBatch<V>, u: &Batch<V>, vectors: [&Batch<V>; M]) -> Batch<V> {
        let u = contact.drive(vectors.get(1).unwrap_or(&u));
        let Metric { along, across, .. } = contact.metric;
        sub(&contact.metric.impulse(vectors[0]), &[along * u[0], across * u[1], across * u[2]])
    }

    #[inline(always)]
    fn projected<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        _: &Batch<V>,
        point: &Batch<V>,
        tangential: V,
    ) -> Batch<V> {
        project_given(contact.metric.mu, point, tangential)
    }

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        KernelInput { projected, .. }: KernelInput<V>,
        vectors: [&mut Batch<V>; M],
        tally: &mut Tally<V>,
    ) -> Batch<V> {
        let impulse = contact.metric.impulse(vectors[0]);
        let d = sub(&impulse, &projected);
        let rounding = V::splat(f64::EPSILON * f64::EPSILON) * dot(&impulse, &impulse);
        // The second one where one is NaN.
        let square = rounding.max(dot(&d, &d));
        tally.sum[0] += square;
        tally.max = tally.max.max(square);
        d
    }

    #[inline(always)]
    fn points<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        u: &[Batch<V>; 2],
        vectors: [&[Batch<V>; 2]; M],
    ) -> [Batch<V>; 2] {
        let (x, [u, w]) = (vectors[0], vectors.get(1).unwrap_or(&u));
        let moved = |contact: &ContactBatch<V>, u: &Batch<V>, x: &Batch<V>| {
            let Metric { along, across, .. } = contact.metric;
            sub(&contact.metric.impulse(x), &[along * u[0], across * u[1], across * u[2]])
        };
        [moved(&contact, &turning.drive(&contact, [u, w]), &x[0]), moved(&turning.rows, w, &x[1])]
    }

    #[inline(always)]
    fn projected_both<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        [point, turned]: [&Batch<V>; 2],
    ) -> [Batch<V>; 2] {
        let coefficient = [contact.metric.mu, turning.rows.metric.mu, turning.given_spinning];
        project_turning(coefficient, point, turned)
    }

    #[inline(always)]
    fn at_both<V: Vector>(
        &self,
        contact: ContactBatch<V>,
        turning: &TurningBatch<V>,
        [input, turned]: [KernelInput<V>; 2],
        vectors: [&mut [Batch<V>; 2]; M],
        tally: &mut Tally<V>,
    ) -> [Batch<V>; 2] {
        let impulse = [contact.metric.impulse(&vectors[0][0]), turning.rows.metric.impulse(&vectors[0][1])];
        let d = [sub(&impulse[0], &input.projected), sub(&impulse[1], &turned.projected)];
        let square_of = |[a, b]: &[Batch<V>; 2]| dot(a, a) + dot(b, b);
        let rounding = V::splat(f64::EPSILON * f64::EPSILON) * square_of(&impulse);
        let square = rounding.max(square_of(&d));
        tally.sum[0] += square;
        tally.max = tally.max.max(square);
        d
    }
}

/// out <- N' x + r', or N' x.
pub(super) struct Store<const GRADIENT: bool>;

impl<const GRADIENT: bool> Kernel<1> for Store<GRADIENT> {
    const SHORT: bool = true;
    const GRADIENT: bool = GRADIENT;

    #[inline(always)]
    fn at<V: Vector>(
        &self,
        _: ContactBatch<V>,
        KernelInput { u, .. }: KernelInput<V>,
        [out]: [&mut Batch<V>; 1],
        _: &mut Tally<V>,
    ) -> Batch<V> {
        *out = u;
        zero()
    }
}
