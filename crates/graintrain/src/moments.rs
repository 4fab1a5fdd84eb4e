//! Volume, centre and second moments of bodies.

use crate::math::{Mat3, Vec3};

/// Volume and its first and second moments about the origin: integrals of 1, p and p p^T; m^3, m^4, m^5.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moments {
    pub volume: f64,
    pub first: Vec3,
    pub second: Mat3,
}

impl Moments {
    pub(crate) const ZERO: Self = Self { volume: 0.0, first: Vec3::ZERO, second: Mat3::ZERO };

    pub(crate) fn add(&mut self, other: &Self) {
        self.volume += other.volume;
        self.first += other.first;
        self.second += other.second;
    }

    /// Inertia about `centre` per unit density, m^5: tr(S) 1 - S with S the second moment about the centre.
    pub(crate) fn inertia(&self, centre: Vec3) -> Mat3 {
        let about = self.second - outer(self.first, centre) - outer(centre, self.first)
            + self.volume * outer(centre, centre);
        let trace = about.x_axis.x + about.y_axis.y + about.z_axis.z;
        Mat3::from_diagonal(Vec3::splat(trace)) - about
    }

    /// The same body moved by `shift`.
    pub(crate) fn moved(&self, shift: Vec3) -> Self {
        Self {
            volume: self.volume,
            first: self.first + self.volume * shift,
            second: self.second
                + outer(self.first, shift)
                + outer(shift, self.first)
                + self.volume * outer(shift, shift),
        }
    }
}

/// a b^T.
pub(crate) fn outer(a: Vec3, b: Vec3) -> Mat3 {
    Mat3::from_cols(a * b.x, a * b.y, a * b.z)
}
