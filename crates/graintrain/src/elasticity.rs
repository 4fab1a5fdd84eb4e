//! Contacts with a normal stiffness and damping, and contacts that pull.
//!
//! An elastic contact presses with the spring and dashpot f = -k Phi - d Phi' where bodies overlap (Phi < 0), never pulls, and is evaluated
//! at the end of the step: with Phi+ = Phi + dt u_n and the impulse g_n = dt f,
//!
//! ```text
//! 0 <= g_n  perp  u_n + c g_n + b >= 0,   c = 1 / (dt (k dt + d)),   b = Phi k / (k dt + d)
//! ```
//!
//! which is the rigid condition with the diagonal c added to N, the same convex problem, and the rigid condition itself for k to infinity
//! (M. Anitescu, G. D. Hart, Int. J. Numer. Methods Eng. 60(14):2335-2371, 2004; A. M. Castro et al., IEEE Transactions on Robotics
//! 39(2):1301-1320, 2023). Where bodies are still apart, b = Phi / dt: spring and dashpot begin where they touch. This is implicit Euler:
//! stable for every step, and it takes energy from oscillations that the step does not resolve.
//!
//! Cohesion pulls with the constant force F as long as bodies touch. With the push g_n' of the surfaces, friction bounded by mu g_n'
//! (B. V. Derjaguin, V. M. Muller, Y. P. Toporov, J. Colloid Interface Sci. 53(2):314-326, 1975, with constant adhesion), the force
//! between the bodies is g_n' - dt F: a load on both in the same problem.

use crate::assemble::{OverlapCorrection, pair_property};
use crate::contact::Contact;
use crate::error::{ModelError, positive};
use crate::world::World;
use graintrain_ccp::RigidContact;
use serde::{Deserialize, Serialize};

/// Bodies touch where their gap is below this fraction of the smaller one's size, m/m: somewhat more than what corrections of overlap leave.
const TOUCHING: f64 = 1e-3;

/// Largest compliance, 1/kg: softer springs do nothing, and their products with impulses have to stay finite.
const SOFTEST: f64 = 1e100;

/// Spring and dashpot of a contact along its normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Elasticity {
    /// k, N/m per contact; zero: rigid.
    pub stiffness: f64,
    /// d, N s/m per contact.
    pub damping: f64,
}

impl Elasticity {
    /// None: contacts do not give way.
    pub const RIGID: Self = Self { stiffness: 0.0, damping: 0.0 };

    /// Whether contacts do not give way.
    pub fn is_rigid(&self) -> bool {
        self.stiffness == 0.0
    }

    /// # Errors
    /// [`ModelError::Value`] unless both are finite and not negative, and there is a stiffness where there is damping.
    pub fn validate(&self, of: &str) -> Result<(), ModelError> {
        if self.stiffness != 0.0 || self.damping != 0.0 {
            positive(format!("the stiffness {of}"), self.stiffness)?;
        }
        if !(self.damping.is_finite() && self.damping >= 0.0) {
            let (what, value) = (format!("the damping {of}"), self.damping);
            return Err(ModelError::Value { what, value, expected: "finite and not negative" });
        }
        Ok(())
    }

    /// c, 1/kg.
    fn compliance(&self, step: f64) -> f64 {
        if self.is_rigid() {
            0.0
        } else {
            (1.0 / (step * (self.stiffness * step + self.damping))).min(SOFTEST)
        }
    }
}

/// Compliance of every contact, 1/kg; empty where all are rigid.
pub(crate) fn compliances(world: &World, contacts: &[Contact], step: f64) -> Vec<f64> {
    if !world.materials.has_elastic_pairs() {
        return Vec::new();
    }
    pair_property(world, contacts, |a, b| world.materials.pair_elasticity(a, b).compliance(step))
}

/// b_n of a contact, m/s.
pub(crate) fn bias(world: &World, contact: &Contact, step: f64, overlap: OverlapCorrection) -> f64 {
    let material = |body: u32| world.bodies.material[body as usize].index();
    let Elasticity { stiffness, damping } =
        world.materials.pair_elasticity(material(contact.body_a), material(contact.body_b));
    if stiffness > 0.0 && contact.gap < 0.0 {
        return contact.gap * stiffness / (stiffness * step + damping);
    }
    match overlap {
        OverlapCorrection::Velocity => contact.gap / step,
        OverlapCorrection::Position => contact.gap.max(0.0) / step,
    }
}

/// Impulse dt F with which every contact pulls, N s; empty where nothing does. Contacts of the same two bodies share the force.
pub(crate) fn pulls(
    world: &World,
    contacts: &[Contact],
    size: impl Fn(&Contact) -> f64,
    step: f64,
) -> Vec<f64> {
    if !world.materials.has_cohesive_pairs() {
        return Vec::new();
    }
    let pair = |c: &Contact| [c.body_a.min(c.body_b), c.body_a.max(c.body_b)];
    let touches: Vec<bool> = contacts.iter().map(|c| c.gap <= TOUCHING * size(c)).collect();
    let mut count = std::collections::HashMap::new();
    for (contact, _) in contacts.iter().zip(&touches).filter(|(_, touches)| **touches) {
        *count.entry(pair(contact)).or_insert(0_u32) += 1;
    }
    let force = pair_property(world, contacts, |a, b| world.materials.pair_cohesion(a, b));
    let of = |((contact, touches), force): ((&Contact, bool), f64)| {
        if touches { step * force / f64::from(count[&pair(contact)]) } else { 0.0 }
    };
    contacts.iter().zip(touches).zip(force).map(of).collect()
}

/// Adds what pulling contacts do to the velocities of bodies (six numbers each), where the response of both bodies to an impulse is given.
pub(crate) fn apply_pulls(
    rows: &[RigidContact],
    pulls: &[f64],
    inverse_mass: &[graintrain_ccp::BodyInverseMass],
    velocity: &mut [f64],
) {
    for (row, &pull) in rows.iter().zip(pulls).filter(|(_, pull)| **pull != 0.0) {
        for (body, sign, arm) in [(row.body_a, -1.0, row.arm_a), (row.body_b, 1.0, row.arm_b)] {
            let Some(inverse) = inverse_mass.get(body as usize) else { continue };
            let [n, _, _] = row.frame;
            let p = n.map(|x| sign * pull * x);
            let m =
                [arm[1] * p[2] - arm[2] * p[1], arm[2] * p[0] - arm[0] * p[2], arm[0] * p[1] - arm[1] * p[0]];
            let v = &mut velocity[6 * body as usize..6 * body as usize + 6];
            for k in 0..3 {
                v[k] += inverse.linear[k] * p[k];
                v[3 + k] += (0..3).map(|l| inverse.angular[3 * k + l] * m[l]).sum::<f64>();
            }
        }
    }
}
