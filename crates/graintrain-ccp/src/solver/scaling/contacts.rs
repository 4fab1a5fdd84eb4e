//! What a pass knows about four contacts: friction, r', and what the residual in the original metric needs.

use super::super::lanes::{
    Batch, Lanes, Vector, load, project_given, project_turning, tangential_length, within_disc, within_discs,
};
use super::super::octet::Octet;

/// What the residual in the original metric needs of four contacts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Metric<V = Lanes> {
    /// Normal and tangential impulse per unit of x, in units of V / eta_i.
    pub normal: V,
    /// See `normal`.
    pub tangential: V,
    /// Impulse, in units of V / eta_i, by which a unit of u_n or u_t moves the natural map's argument: u in
    /// units of V.
    pub along: V,
    /// See `along`.
    pub across: V,
    /// mu.
    pub mu: V,
}

impl Metric<f64> {
    /// Of a contact: c, c / sqrt(e_n) and c / sqrt(e_t), eta, V, mu.
    pub(in super::super) fn of(
        size: f64,
        [normal, tangential]: [f64; 2],
        eta: f64,
        velocity: f64,
        mu: f64,
    ) -> Self {
        Self {
            normal: eta * normal / velocity,
            tangential: eta * tangential / velocity,
            // u = c^2 u' / unit, and u / eta_i is u / V of these units.
            along: size / normal * (size / velocity),
            across: size / tangential * (size / velocity),
            mu,
        }
    }
}

impl Metric {
    /// Puts the numbers of one contact into its lane.
    pub(super) fn set(&mut self, lane: usize, own: &Metric<f64>) {
        let numbers = [own.normal, own.tangential, own.along, own.across, own.mu];
        let Self { normal, tangential, along, across, mu } = self;
        for (to, from) in [normal, tangential, along, across, mu].into_iter().zip(numbers) {
            to.0[lane] = from;
        }
    }
}

impl Metric<Octet> {
    /// Puts the numbers of one contact into its lane.
    pub(in super::super) fn set(&mut self, lane: usize, own: &Metric<f64>) {
        let numbers = [own.normal, own.tangential, own.along, own.across, own.mu];
        let Self { normal, tangential, along, across, mu } = self;
        for (to, from) in [normal, tangential, along, across, mu].into_iter().zip(numbers) {
            to.0[lane] = from as f32;
        }
    }
}

impl<V: Vector> Metric<V> {
    /// Impulses in units of V / eta_i.
    #[inline(always)]
    pub fn impulse(&self, x: &Batch<V>) -> Batch<V> {
        [self.normal * x[0], self.tangential * x[1], self.tangential * x[2]]
    }
}

/// What is known about a contact inside a pass.
#[derive(Clone, Copy, Debug)]
pub struct ContactBatch<V> {
    /// Coefficients of friction mu' of the scaled problem.
    pub mu: V,
    /// For the residual.
    pub metric: Metric<V>,
    /// r'.
    pub r: Batch<V>,
    /// Whether friction is exact.
    exact: bool,
}

impl<V: Vector> ContactBatch<V> {
    /// The velocity that the natural map of the residual takes: u itself, or with mu' |u_t| added to the
    /// normal component where friction is exact. The two factors per contact turn mu |u_t| into mu' |u'_t|.
    #[inline(always)]
    pub fn drive(&self, u: &Batch<V>) -> Batch<V> {
        if self.exact { [u[0] + self.mu * (u[1] * u[1] + u[2] * u[2]).sqrt(), u[1], u[2]] } else { *u }
    }

    /// The impulse that a step to `point`, whose tangential length is known, may have: the nearest one in the
    /// friction cone, or where friction is exact the one of [`within_disc`].
    #[inline(always)]
    pub fn allowed(&self, point: &Batch<V>, tangential: V) -> Batch<V> {
        if self.exact {
            within_disc(self.mu, point, tangential)
        } else {
            project_given(self.mu, point, tangential)
        }
    }
}

/// What is known about the turning rows of the contacts of a batch.
#[derive(Clone, Copy, Debug)]
pub struct TurningBatch<V> {
    /// The rows as a batch: `mu` is mu_r', the factors of the metric are those of spinning (normal) and of
    /// rolling.
    pub rows: ContactBatch<V>,
    /// mu_s'.
    pub spinning: V,
    /// mu_s.
    pub given_spinning: V,
}

impl<V: Vector> TurningBatch<V> {
    /// As [`ContactBatch::drive`]: the normal velocity that the natural map takes, with what turning adds
    /// where friction is exact.
    #[inline(always)]
    pub fn drive(&self, contact: &ContactBatch<V>, [u, turning]: [&Batch<V>; 2]) -> Batch<V> {
        let [normal, t1, t2] = contact.drive(u);
        if !contact.exact {
            return [normal, t1, t2];
        }
        let spin = turning[0].max(-turning[0]);
        [normal + self.rows.mu * tangential_length(turning) + self.spinning * spin, t1, t2]
    }

    /// Projection on the scaled cones; `mu` is mu' of the contacts.
    #[inline(always)]
    pub fn project(&self, mu: V, [point, turning]: [&Batch<V>; 2]) -> [Batch<V>; 2] {
        project_turning([mu, self.rows.mu, self.spinning], point, turning)
    }

    /// As [`ContactBatch::allowed`].
    #[inline(always)]
    pub fn allowed(&self, contact: &ContactBatch<V>, [point, turning]: [&Batch<V>; 2]) -> [Batch<V>; 2] {
        if contact.exact {
            within_discs([contact.mu, self.rows.mu, self.spinning], point, turning)
        } else {
            self.project(contact.mu, [point, turning])
        }
    }
}

/// What [`ContactBatch`] is taken from, for some batches.
#[derive(Clone, Copy)]
pub(super) struct ContactArrays<'a> {
    /// c' of compliant contacts; empty where all are rigid.
    pub(super) compliance: &'a [Lanes],
    pub(super) friction: &'a [Lanes],
    pub(super) metric: &'a [Metric],
    pub(super) r: &'a [Batch],
    /// Empty where nothing resists turning, like `spinning`.
    pub(super) turning: &'a [bool],
    pub(super) spinning: &'a [[Lanes; 2]],
    pub(super) exact: bool,
}

impl ContactArrays<'_> {
    /// The turning rows of the contacts of a batch, which are the next batch, where they have any.
    #[inline(always)]
    pub(super) fn turning_at<V: Vector>(&self, batch: usize) -> Option<TurningBatch<V>> {
        if self.turning.get(batch + 1) != Some(&true) {
            return None;
        }
        let [spinning, given_spinning] = self.spinning[batch + 1].map(V::of);
        Some(TurningBatch { rows: self.at(batch + 1), spinning, given_spinning })
    }

    #[inline(always)]
    pub(super) fn at<V: Vector>(&self, batch: usize) -> ContactBatch<V> {
        let Metric { normal, tangential, along, across, mu } = &self.metric[batch];
        ContactBatch {
            mu: V::of(self.friction[batch]),
            metric: Metric {
                normal: V::of(*normal),
                tangential: V::of(*tangential),
                along: V::of(*along),
                across: V::of(*across),
                mu: V::of(*mu),
            },
            r: load(&self.r[batch]),
            exact: self.exact,
        }
    }
}
