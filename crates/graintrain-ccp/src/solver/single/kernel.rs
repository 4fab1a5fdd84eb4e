//! What a pass in single precision does at eight contacts.

use super::super::lanes::{Batch, dot, project_given, scale, sub, tangential_length};
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

/// What is done at eight contacts, given mu' and u = N' y + r'; returns the batch whose image the pass computes.
pub trait SingleKernel<const M: usize>: Sync {
    /// See the trait.
    fn at<V: SingleVector>(
        &self,
        batch: usize,
        mu: V,
        u: &Batch<V>,
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
        _: usize,
        _: V,
        _: &Batch<V>,
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
        batch: usize,
        _: V,
        u: &Batch<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut SingleTally<V>,
    ) -> Batch<V> {
        *x = scale(V::splat(self.factor), &sub(u, &load(&self.contacts[batch].r)));
        tally.sum[0] += dot(x, x);
        *x
    }
}

/// Tallies sum and maximum of (eta_i |d_i| / V)^2 of the natural map in the original metric, and the sum of (eta_i |g_i| / V)^2, which
/// says what the rounding of impulses makes of it.
pub(super) struct NaturalMap<'a> {
    pub(super) metric: &'a [Metric<Octet>],
    pub(super) exact: bool,
}

impl SingleKernel<1> for NaturalMap<'_> {
    #[inline(always)]
    fn at<V: SingleVector>(
        &self,
        batch: usize,
        scaled_mu: V,
        u: &Batch<V>,
        [x]: [&mut Batch<V>; 1],
        tally: &mut SingleTally<V>,
    ) -> Batch<V> {
        let Metric { normal, tangential, along, across, mu } = &self.metric[batch];
        let (normal, tangential, along, across) =
            (V::of(*normal), V::of(*tangential), V::of(*along), V::of(*across));
        let mut drive = u[0];
        if self.exact {
            drive += scaled_mu * tangential_length(u);
        }
        let impulse = [normal * x[0], tangential * x[1], tangential * x[2]];
        let point = sub(&impulse, &[along * drive, across * u[1], across * u[2]]);
        let d = sub(&impulse, &project_given(V::of(*mu), &point, tangential_length(&point)));
        let square = dot(&d, &d);
        tally.sum[0] += square;
        tally.sum[1] += dot(&impulse, &impulse);
        tally.max = tally.max.max(square);
        d
    }
}
