//! Contacts with a normal stiffness and damping, and contacts that pull.
//!
//! An elastic contact presses with the spring and dashpot f = -k Phi - d Phi' where bodies overlap (Phi < 0),
//! never pulls, and is evaluated at the end of the step: with Phi+ = Phi + dt u_n and the impulse g_n = dt f,
//!
//! ```text
//! 0 <= g_n  perp  u_n + c g_n + b >= 0,   c = 1 / (dt (k dt + d)),   b = Phi k / (k dt + d)
//! ```
//!
//! which is the rigid condition with the diagonal c added to N, the same convex problem, and the rigid
//! condition itself for k to infinity (M. Anitescu, G. D. Hart, Int. J. Numer. Methods Eng. 60(14):2335-2371,
//! 2004; A. M. Castro et al., IEEE Transactions on Robotics 39(2):1301-1320, 2023). Where bodies are still
//! apart, b = Phi / dt: spring and dashpot begin where they touch. This is implicit Euler: stable for every
//! step, and it takes energy from oscillations that the step does not resolve.
//!
//! Cohesion pulls with the constant force F as long as bodies touch. With the push g_n' of the surfaces,
//! friction bounded by mu g_n' (B. V. Derjaguin, V. M. Muller, Y. P. Toporov, J. Colloid Interface Sci.
//! 53(2):314-326, 1975, with constant adhesion), the force between the bodies is g_n' - dt F: a load on both
//! in the same problem.

use crate::contact::Contact;
use crate::material::Elasticity;
use crate::world::World;
use graintrain_ccp::{BodyInverseMass, RigidContact};
use hashbrown::HashMap;

/// Bodies touch where their gap is below this fraction of the smaller one's size, m/m: somewhat more than
/// what corrections of overlap leave.
const TOUCHING: f64 = 1e-3;

/// Largest compliance, 1/kg: softer springs do nothing, and their products with impulses have to stay finite.
const SOFTEST: f64 = 1e100;

/// c, 1/kg.
fn compliance(law: Elasticity, step: f64) -> f64 {
    if law.is_rigid() { 0.0 } else { (1.0 / (step * (law.stiffness * step + law.damping))).min(SOFTEST) }
}

/// Whether a contact is elastic: what it overlaps is its own affair.
pub(crate) fn gives(world: &World, contact: &Contact) -> bool {
    let [a, b] = world.materials_of(contact);
    !world.materials.pair_elasticity(a, b).is_rigid()
}

/// Compliance of every contact, 1/kg; empty where all are rigid.
pub(crate) fn compliances(world: &World, contacts: &[Contact], step: f64) -> Vec<f64> {
    if !world.materials.has_elastic_pairs() {
        return Vec::new();
    }
    let of = |contact: &Contact| {
        let [a, b] = world.materials_of(contact);
        compliance(world.materials.pair_elasticity(a, b), step)
    };
    contacts.iter().map(of).collect()
}

/// b_n of a contact that overlaps and is elastic, m/s; `None` of others, whose b_n is that of rigid ones.
pub(crate) fn bias(world: &World, contact: &Contact, step: f64) -> Option<f64> {
    let [a, b] = world.materials_of(contact);
    let Elasticity { stiffness, damping } = world.materials.pair_elasticity(a, b);
    let presses = stiffness > 0.0 && contact.gap < 0.0;
    let bias = contact.gap * stiffness / (stiffness * step + damping);
    // The smallest numbers times the step are zero, and such a spring is none.
    presses.then_some(if bias.is_finite() { bias } else { 0.0 })
}

/// Impulse dt F with which every contact pulls, N s; empty where nothing does. Contacts of the same two
/// bodies share the force. `size` is that of the smaller body, m.
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
    let mut count = HashMap::new();
    for (contact, _) in contacts.iter().zip(&touches).filter(|(_, touches)| **touches) {
        *count.entry(pair(contact)).or_insert(0_u32) += 1;
    }
    let of = |(contact, touches): (&Contact, bool)| {
        let [a, b] = world.materials_of(contact);
        let force = world.materials.pair_cohesion(a, b);
        if touches { step * force / f64::from(count[&pair(contact)]) } else { 0.0 }
    };
    contacts.iter().zip(touches).map(of).collect()
}

/// Adds what pulling contacts do to the velocities of bodies (six numbers each), where the response of both
/// bodies to an impulse is given.
pub(crate) fn apply_pulls(
    rows: &[RigidContact],
    pulls: &[f64],
    inverse_mass: &[BodyInverseMass],
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
