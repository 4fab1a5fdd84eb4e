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
    /// Stays the same from step to step while the contact persists: made of the bodies' indices and the features
    /// (part, face, edge, vertex) that touch.
    pub identity: u64,
    /// Contact point in the world, m: midway between the two surfaces.
    pub point: Vec3,
    /// Unit normal from B to A.
    pub normal: Vec3,
    /// Signed distance, m; negative where the bodies overlap.
    pub gap: f64,
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
}
