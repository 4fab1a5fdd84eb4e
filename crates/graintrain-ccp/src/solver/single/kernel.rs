//! What a pass in single precision does at eight contacts.

use super::super::lanes::{Batch, dot, project_given, scale, sub, tangential_length, zero};
use super::super::octet::{Octet, SingleVector};
use super::super::scaling::Metric;
use super::geometry::load;
use super::operator::ContactNumbers;

/// Sums and a maximum over contacts, lane by lane.
#[derive(Clone, Copy, Default)]
pub struct SingleTally<V> {
    pub sum: [V; 2],
    pub max: V,
}

/// What a kernel is given at eight contacts.
#[derive(Clone, Copy)]
pub struct Seen<V> {
    pub batch: usize,
    /// mu'
    pub mu: V,
    /// u = N' y + r'
    pub u: Batch<V>,
}

/// What is done at eight contacts in three stages: roots and quotients take long, and what they are of is
/// known batches ahead.
pub trait SingleKernel<const M: usize>: Sync {
    /// The point that is to be projected.
    #[inline(always)]
    fn point<V: SingleVector>(&self, _: &Seen<V>, _: [&Batch<V>; M]) -> Batch<V> {
        zero()
    }

    /// The projection of the point, given its tangential length.
    #[inline(always)]
    fn projected<V: SingleVector>(&self, _: &Seen<V>, _: &Batch<V>, _tangential: V) -> Batch<V> {
        zero()
    }

    /// Given the projection, updates the method's vectors, adds to the tally and returns the batch whose
    /// image the pass computes.
    fn at<V: SingleVector>(
        &self,
        seen: &Seen<V>,
        projected: Batch<V>,
        vectors: [&mut Batch<V>; M],
        tally: &mut SingleTally<V>,
    ) -> Batch<V>;
}

/// Returns the vector: its image is wanted.
pub(super) struct Identity;

impl SingleKernel<1> for Identity {
    #[inline(always)]
    fn at<V: SingleVector>(
        &self,
        _: &Seen<V>,
        _: Batch<V>,
        [x]: [&mut Batch<V>; 1],
        _: &mut SingleTally<V>,
    ) -> Batch<V> {
        *x
    }
}

/// x <- factor (u - r'); tallies |x|^2.
pub(super) struct PowerStep<'a> {
    pub(super) factor: f64,
    pub(super) contacts: &'a [ContactNumbers],
}

impl SingleKernel<1> for PowerStep<'_> {
    #[inline(always)]
    fn at<V: SingleVector>(
        &self,
        seen: &Seen<V>,
        _: Batch<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut SingleTally<V>,
    ) -> Batch<V> {
        *x = scale(V::splat(self.factor), &sub(&seen.u, &load(&self.contacts[seen.batch].r)));
        tally.sum[0] += dot(x, x);
        *x
    }
}

/// Tallies sum and maximum of (eta_i |d_i| / V)^2 of the natural map in the original metric, and the sum of
/// (eta_i |g_i| / V)^2, which says what the rounding of impulses makes of it.
pub(super) struct NaturalMap<'a> {
    pub(super) metric: &'a [Metric<Octet>],
    pub(super) exact: bool,
}

impl NaturalMap<'_> {
    /// The impulse in units of V / eta_i.
    #[inline(always)]
    fn impulse<V: SingleVector>(&self, batch: usize, x: &Batch<V>) -> Batch<V> {
        let Metric { normal, tangential, .. } = &self.metric[batch];
        let tangential = V::of(*tangential);
        [V::of(*normal) * x[0], tangential * x[1], tangential * x[2]]
    }
}

impl SingleKernel<1> for NaturalMap<'_> {
    #[inline(always)]
    fn point<V: SingleVector>(&self, Seen { batch, mu, u }: &Seen<V>, [x]: [&Batch<V>; 1]) -> Batch<V> {
        let Metric { along, across, .. } = &self.metric[*batch];
        let across = V::of(*across);
        let mut drive = u[0];
        if self.exact {
            drive += *mu * tangential_length(u);
        }
        sub(&self.impulse(*batch, x), &[V::of(*along) * drive, across * u[1], across * u[2]])
    }

    #[inline(always)]
    fn projected<V: SingleVector>(&self, seen: &Seen<V>, point: &Batch<V>, tangential: V) -> Batch<V> {
        project_given(V::of(self.metric[seen.batch].mu), point, tangential)
    }

    #[inline(always)]
    fn at<V: SingleVector>(
        &self,
        seen: &Seen<V>,
        projected: Batch<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut SingleTally<V>,
    ) -> Batch<V> {
        let impulse = self.impulse(seen.batch, x);
        let d = sub(&impulse, &projected);
        let square = dot(&d, &d);
        tally.sum[0] += square;
        tally.sum[1] += dot(&impulse, &impulse);
        tally.max = tally.max.max(square);
        d
    }
}
