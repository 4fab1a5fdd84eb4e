//! Assembly of the cone complementarity problem of a step.

use crate::collide::identity::PreviousContacts;
use crate::contact::{Contact, ContactSet};
use crate::integrate::inverse_mass;
use crate::math::{Vec3, tangents};
use crate::world::World;
use graintrain_ccp::{Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use rayon::prelude::*;

/// Contacts per parallel task.
const TASK: usize = 4096;

/// The problem of a step: with the velocities `free` that bodies would have without contact (six numbers per body,
/// [`crate::integrate::free_velocity`]),
///
/// ```text
/// r_i = b_i + D_i^T free,   N = D^T M^-1 D with the masked inverse mass,
/// b_i = (Phi_i / dt, 0, 0), and for a touching, approaching contact with restitution e (Newton)
/// b_i,n = min(Phi_i / dt, e D_i,n^T v),  v before the step.
/// ```
///
/// Touching means that the gap closes within the step, Phi_i + dt D_i,n^T v <= 0, so that a body rebounds with e times
/// the velocity with which it arrives. Fully prescribed bodies are [`FIXED`] in D; their velocity enters r.
///
/// V, which makes residuals dimensionless, is |gravity| dt; without gravity it is left to the problem (from r, as for a bare
/// problem). J of the former measure is the mean mass of the bodies that have a dynamic degree of freedom, times V.
pub fn assemble(world: &World, contacts: &[Contact], free: &[f64], step: f64) -> Ccp {
    let rigid: Vec<RigidContact> = contacts
        .par_iter()
        .with_min_len(TASK)
        .map(|contact| {
            let (t1, t2) = tangents(contact.normal);
            let side = |body: u32| {
                let arm = contact.point - world.bodies.position[body as usize];
                (if world.is_prescribed(body as usize) { FIXED } else { body }, arm.to_array())
            };
            let ((body_a, arm_a), (body_b, arm_b)) = (side(contact.body_a), side(contact.body_b));
            let frame = [contact.normal.to_array(), t1.to_array(), t2.to_array()];
            RigidContact { body_a, body_b, frame, arm_a, arm_b }
        })
        .collect();
    let mut r = vec![0.0; 3 * contacts.len()];
    r.par_chunks_mut(3).zip(contacts).zip(&rigid).with_min_len(TASK).for_each(|((r, contact), rigid)| {
        let u = to_frame(rigid, relative_velocity(contact, rigid, |body| velocity_of(free, body)));
        r.copy_from_slice(&[stabilisation(world, contact, rigid, free, step) + u[0], u[1], u[2]]);
    });
    let friction = contacts
        .iter()
        .map(|contact| {
            let [a, b] = materials(world, contact);
            world.materials.pair_friction(a, b)
        })
        .collect();
    Ccp {
        delassus: Delassus::Rigid(RigidDelassus::new(rigid, inverse_mass(world))),
        r,
        friction,
        velocity_scale: velocity_scale(world, step),
        impulse_scale: impulse_scale(world, step),
        points: contacts.iter().map(|contact| contact.point.to_array()).collect(),
        identity: contacts.iter().map(|contact| contact.identity).collect(),
    }
}

/// b_i,n: the approach velocity that would close the gap in one step, or the rebound.
fn stabilisation(world: &World, contact: &Contact, rigid: &RigidContact, free: &[f64], step: f64) -> f64 {
    let closing = contact.gap / step;
    let [a, b] = materials(world, contact);
    let restitution = world.materials.pair_restitution(a, b);
    if restitution == 0.0 {
        return closing;
    }
    let before = relative_velocity(contact, rigid, |body| velocity_before(world, free, body));
    let approach = to_frame(rigid, before)[0];
    if approach < 0.0 && closing + approach <= 0.0 { closing.min(restitution * approach) } else { closing }
}

fn materials(world: &World, contact: &Contact) -> [usize; 2] {
    [contact.body_a, contact.body_b].map(|body| world.bodies.material[body as usize] as usize)
}

fn velocity_of(velocities: &[f64], body: usize) -> [Vec3; 2] {
    let v = &velocities[6 * body..6 * body + 6];
    [Vec3::new(v[0], v[1], v[2]), Vec3::new(v[3], v[4], v[5])]
}

/// Velocity before the step; prescribed degrees of freedom already have the velocity of this step.
fn velocity_before(world: &World, free: &[f64], body: usize) -> [Vec3; 2] {
    let dynamic = world.free_degrees(body);
    let now = [world.bodies.velocity[body], world.bodies.angular_velocity[body]];
    let driven = velocity_of(free, body);
    std::array::from_fn(|part| {
        let pick = |k: usize| if dynamic[3 * part + k] { now[part][k] } else { driven[part][k] };
        Vec3::new(pick(0), pick(1), pick(2))
    })
}

/// u_A + w_A x r_A - u_B - w_B x r_B.
fn relative_velocity(contact: &Contact, rigid: &RigidContact, velocity: impl Fn(usize) -> [Vec3; 2]) -> Vec3 {
    let [u_a, w_a] = velocity(contact.body_a as usize);
    let [u_b, w_b] = velocity(contact.body_b as usize);
    let (r_a, r_b) = (Vec3::from_array(rigid.arm_a), Vec3::from_array(rigid.arm_b));
    u_a + w_a.cross(r_a) - u_b - w_b.cross(r_b)
}

/// Components (n, t1, t2) of a world vector.
fn to_frame(rigid: &RigidContact, v: Vec3) -> [f64; 3] {
    rigid.frame.map(|axis| Vec3::from_array(axis).dot(v))
}

/// |gravity| dt, m/s: what every body would gain in a step without contact.
fn velocity_scale(world: &World, step: f64) -> Option<f64> {
    Some(world.gravity.length() * step).filter(|&scale| scale > 0.0)
}

fn impulse_scale(world: &World, step: f64) -> Option<f64> {
    let mut mass = 0.0;
    let mut count = 0.0;
    for body in (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body)) {
        mass += world.bodies.mass[body];
        count += 1.0;
    }
    let scale = mass / f64::max(count, 1.0) * world.gravity.length() * step;
    (scale > 0.0).then_some(scale)
}

/// Impulses to start the solver from: those of the last step at the contacts that persist, turned with the contact's
/// frame; zero at new contacts. Length 3 N_c, N s.
pub(crate) fn warm_start(problem: &Ccp, contacts: &[Contact], last: &ContactSet, bodies: usize) -> Vec<f64> {
    let mut impulse = vec![0.0; 3 * contacts.len()];
    let Delassus::Rigid(rigid) = &problem.delassus else { return impulse };
    let previous = PreviousContacts::new(last, bodies);
    impulse.par_chunks_mut(3).zip(contacts).zip(rigid.contacts()).enumerate().with_min_len(TASK).for_each(
        |(i, ((g, contact), rigid))| {
            let frame_impulse = to_frame(rigid, previous.impulse(contact));
            // Friction may have changed, or rounding left the cone.
            g.copy_from_slice(&problem.cone(i).project(frame_impulse));
        },
    );
    impulse
}
