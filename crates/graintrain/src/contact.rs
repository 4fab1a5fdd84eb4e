//! Contacts: where two bodies touch or may touch within the step, and the impulses found there.

use crate::math::Vec3;
use serde::{Deserialize, Serialize};

/// A contact between bodies A and B with gap at most the envelope delta.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// Index of body A.
    pub body_a: u32,
    /// Index of body B.
    pub body_b: u32,
    /// Stays the same from step to step while the contact persists: made of the bodies' indices and the
    /// features (part, face, edge, vertex) that touch.
    pub identity: u64,
    /// Contact point in the world, m: midway between the two surfaces.
    pub point: Vec3,
    /// Unit normal from B to A.
    pub normal: Vec3,
    /// Signed distance, m; negative where the bodies overlap. Of bodies that meet only after a way, the
    /// distance that they have to close along the normal (see [`Self::lead`]).
    pub gap: f64,
    /// Half the way from B's surface point to A's, m, where the arms of the impulse are those of
    /// `point + lead` on A and `point - lead` on B: in impacts that still have a gap to close, and where
    /// bodies are so fast that they meet elsewhere than they are nearest now (normal and surface points are
    /// then those of the impact, carried back with the bodies). Zero for all other contacts, whose arms both
    /// reach to `point`.
    pub lead: Vec3,
    /// In a periodic cell, by how many of its edges the image of body B that touches A is away from B; zero
    /// otherwise. Contact point and normal are beside A.
    pub image: [i32; 3],
}

impl Contact {
    /// Its bodies, the lower index first.
    pub(crate) fn unordered(&self) -> [u32; 2] {
        [self.body_a.min(self.body_b), self.body_a.max(self.body_b)]
    }
}

impl Contact {
    /// Points of the bodies A and B from whose centres the arms of the impulse reach, m.
    pub fn surface_points(&self) -> [Vec3; 2] {
        [self.point + self.lead, self.point - self.lead]
    }
}

/// Contacts of one step, with what the solver found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ContactSet {
    /// The contacts, in an order that does not depend on threads.
    pub contacts: Vec<Contact>,
    /// Impulse on body A (minus that on B) in world axes, N s; one per contact.
    pub impulse: Vec<Vec3>,
    /// Coefficient of friction; one per contact.
    pub friction: Vec<f64>,
    /// Moment impulse of rolling and spinning friction on body A (minus that on B) in world axes, N m s; one
    /// per contact, or empty where no pair of materials resists turning.
    pub moment: Vec<Vec3>,
    /// Whether a contact bounced: impacts gave it all of its impulse; one per contact, or empty where there
    /// was no impact.
    pub bounced: Vec<bool>,
    /// What the solver remembers for the next step,
    /// [`SolveReport::curvature`](graintrain_ccp::SolveReport::curvature).
    pub curvature: Option<f64>,
}
