//! Assembly of the cone complementarity problem of a step.

use crate::cell::{self, Cell};
use crate::collide::identity::PreviousContacts;
use crate::contact::{Contact, ContactSet};
use crate::elasticity::{bias, compliances};
use crate::integrate::SLOWEST;
use crate::math::{Vec3, tangents};
use crate::turning::{frame_moment, turning, turning_velocities};
use crate::world::World;
use graintrain_ccp::{BodyInverseMass, Ccp, CoupledBodies, Delassus, FIXED, RigidContact, RigidDelassus};
use graintrain_linalg::parallel::fold_chunks;
use graintrain_linalg::real;
use rayon::prelude::*;
use std::sync::Arc;

/// Contacts per parallel task.
const TASK: usize = 4096;

/// What becomes of overlap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OverlapCorrection {
    /// Bodies that overlap may not approach; positions are corrected apart from velocities (see
    /// [`crate::overlap`]), so that no energy is made.
    #[default]
    Position,
    /// Bodies that overlap have to part with the velocity that removes the overlap within the step, -Phi /
    /// dt, and keep it: the scheme of the paper, for states without overlap. A shorter step throws harder.
    Velocity,
}

/// Rows of D for every contact: frames and arms. Fully prescribed bodies are [`FIXED`].
pub fn contact_rows(world: &World, contacts: &[Contact]) -> Vec<RigidContact> {
    contacts
        .par_iter()
        .with_min_len(TASK)
        .map(|contact| {
            let (t1, t2) = tangents(contact.normal);
            let side = |body: u32, point: Vec3| {
                let arm = point - world.bodies.position[body as usize];
                (if world.is_prescribed(body as usize) { FIXED } else { body }, arm.to_array())
            };
            let [(_, on_a), (_, on_b)] = cell::ends(world.cell(), contact);
            let ((body_a, arm_a), (body_b, arm_b)) = (side(contact.body_a, on_a), side(contact.body_b, on_b));
            let frame = [contact.normal.to_array(), t1.to_array(), t2.to_array()];
            RigidContact { body_a, body_b, frame, arm_a, arm_b }
        })
        .collect()
}

/// D^T v in the contacts' frames (n, t1, t2), m/s, length 3 N_c, of velocities of all bodies (six numbers
/// each), prescribed ones included; across the boundary of a periodic cell, relative to the image of body B.
pub fn relative_velocities(
    cell: Option<&Cell>,
    contacts: &[Contact],
    rows: &[RigidContact],
    velocity: &[f64],
) -> Vec<f64> {
    let mut u = vec![0.0; 3 * contacts.len()];
    u.par_chunks_mut(3).zip(contacts).zip(rows).with_min_len(TASK).for_each(|((u, contact), row)| {
        let mut relative = relative_velocity(contact, row, |body| velocity_of(velocity, body));
        if contact.image != [0; 3] {
            relative -= cell::image_velocity(cell, contact);
        }
        u.copy_from_slice(&to_frame(row, relative));
    });
    u
}

/// The contact problem of a step: with the velocities `free` that bodies would have without contact (six
/// numbers per body, [`crate::integrate::free_velocity`], of jointed bodies what their joints make of them),
///
/// ```text
/// r_i = b_i + D_i^T free,   N = D^T M^-1 D with the masked inverse mass (W of coupled bodies),   b_i = (Phi_i / dt, 0, 0)
/// ```
///
/// with three more rows for every contact that resists turning ([`crate::turning`]), whose b is zero; where
/// Phi_i > 0. Where bodies overlap, b_i = 0 or, after the paper, Phi_i / dt: see [`OverlapCorrection`]. What
/// the frames of contacts turn by in the step comes to b_i, too: `turned` (`frame_turn`; empty: none).
/// Elastic contacts have a b of their own and a diagonal beside D^T M^-1 D: see [`crate::elasticity`]. The
/// velocity of prescribed bodies enters r. Restitution is not here but in [`crate::impact`].
///
/// V, which makes residuals dimensionless, is |gravity| dt; without gravity the root mean square of |r_i|
/// over contacts that do not part by themselves.
pub fn assemble(
    world: &World,
    contacts: &[Contact],
    rows: Vec<RigidContact>,
    (inverse_mass, coupled): (Vec<BodyInverseMass>, Vec<CoupledBodies>),
    (free, turned): (&[f64], &[f64]),
    step: f64,
    overlap: OverlapCorrection,
) -> Ccp {
    let mut r = relative_velocities(world.cell(), contacts, &rows, free);
    r.iter_mut().zip(turned).for_each(|(r, turned)| *r += turned);
    r.par_chunks_exact_mut(3).zip(contacts).with_min_len(TASK).for_each(|(u, contact)| {
        u[0] += bias(world, contact, step).unwrap_or_else(|| match overlap {
            OverlapCorrection::Velocity => contact.gap / step,
            OverlapCorrection::Position => contact.gap.max(0.0) / step,
        });
    });
    let friction = pair_property(world, contacts, |a, b| world.materials.pair_friction(a, b));
    let velocity_scale = scale_under(world.gravity.length(), step, &r, &friction);
    let (turning_rows, turning) = turning(world, contacts);
    r.extend(turning_velocities(contacts, &rows, &turning_rows, free));
    let rigid = RigidDelassus::new(rows, inverse_mass).with_turning(turning_rows).with_coupled(coupled);
    let rigid = rigid.with_compliance(compliances(world, contacts, step));
    Ccp {
        velocity_scale,
        delassus: Arc::new(Delassus::Rigid(rigid)),
        r,
        friction,
        turning,
        points: of_each(contacts, |contact| contact.point.to_array()),
        identity: of_each(contacts, |contact| contact.identity),
    }
}

/// A property of the two materials of every contact.
pub(crate) fn pair_property(
    world: &World,
    contacts: &[Contact],
    property: impl Fn(usize, usize) -> f64 + Sync,
) -> Vec<f64> {
    let material = |body: u32| world.bodies.material[body as usize].index();
    of_each(contacts, |contact| property(material(contact.body_a), material(contact.body_b)))
}

/// A number, or what else there is, of every item of a list; threads share long lists.
pub(crate) fn of_each<T: Sync, U: Send>(items: &[T], of: impl Fn(&T) -> U + Sync) -> Vec<U> {
    items.par_iter().with_min_len(TASK).map(&of).collect()
}

pub(crate) fn velocity_of(velocities: &[f64], body: usize) -> [Vec3; 2] {
    let v = &velocities[6 * body..6 * body + 6];
    [Vec3::new(v[0], v[1], v[2]), Vec3::new(v[3], v[4], v[5])]
}

/// u_A + w_A x r_A - u_B - w_B x r_B.
fn relative_velocity(contact: &Contact, rigid: &RigidContact, velocity: impl Fn(usize) -> [Vec3; 2]) -> Vec3 {
    let [u_a, w_a] = velocity(contact.body_a as usize);
    let [u_b, w_b] = velocity(contact.body_b as usize);
    let (r_a, r_b) = (Vec3::from_array(rigid.arm_a), Vec3::from_array(rigid.arm_b));
    u_a + w_a.cross(r_a) - u_b - w_b.cross(r_b)
}

/// Components (n, t1, t2) of a world vector.
pub(crate) fn to_frame(rigid: &RigidContact, v: Vec3) -> [f64; 3] {
    rigid.frame.map(|axis| Vec3::from_array(axis).dot(v))
}

/// V of contacts where gravity sets none, m/s: the root mean square of |r_i| over those that do not part by
/// themselves, r_n < mu |r_t|. In those that do, r holds Phi / dt, which grows without limit as steps get
/// shorter. `None` where all part; 1 where they are nothing ([`SLOWEST`]).
pub(crate) fn velocity_scale(r: &[f64], friction: &[f64]) -> Option<f64> {
    let of_chunk = |range: std::ops::Range<usize>| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (r, mu) in r[3 * range.start..3 * range.end].chunks_exact(3).zip(&friction[range]) {
            if r[0] < mu * real::hypot(r[1], r[2]) {
                sum += r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
                count += 1.0;
            }
        }
        (sum, count)
    };
    let both = |all: (f64, f64), chunk: (f64, f64)| (all.0 + chunk.0, all.1 + chunk.1);
    let (sum, count) = fold_chunks(friction.len(), (0.0, 0.0), of_chunk, both);
    let scale = (count > 0.0).then(|| (sum / count).sqrt());
    scale.map(|scale| if scale > SLOWEST { scale } else { 1.0 })
}

/// Below this fraction of the velocities of the contacts themselves |gravity| dt is none to measure by.
const FAINT: f64 = 1e-9;

/// V of a problem under gravity, m/s: |gravity| dt, and where that is nothing beside the contacts' own
/// velocities, theirs.
pub(crate) fn scale_under(gravity: f64, step: f64, r: &[f64], friction: &[f64]) -> Option<f64> {
    let fall = gravity * step;
    match velocity_scale(r, friction) {
        Some(own) if fall <= FAINT * own => Some(own),
        _ => Some(fall).filter(|&fall| fall > 0.0),
    }
}

/// Impulses to start the solver from: those of the last step at the contacts that persist, turned with the
/// contact's frame; zero at new contacts. `pulls` (empty, or one per contact) are the cohesive impulses that
/// those of the last step are less than the surfaces' push. Length of r, N s.
pub(crate) fn warm_start(
    problem: &Ccp,
    contacts: &[Contact],
    pulls: &[f64],
    last: &ContactSet,
    bodies: usize,
) -> Vec<f64> {
    let mut impulse = vec![0.0; problem.r.len()];
    let Delassus::Rigid(rigid) = &*problem.delassus else { return impulse };
    let previous = PreviousContacts::new(last, bodies);
    let (forces, moments) = impulse.split_at_mut(3 * contacts.len());
    forces.par_chunks_mut(3).zip(contacts).zip(rigid.contacts()).enumerate().with_min_len(TASK).for_each(
        |(i, ((g, contact), rigid))| {
            let mut frame_impulse = to_frame(rigid, previous.impulse(contact));
            frame_impulse[0] += pulls.get(i).copied().unwrap_or(0.0);
            // Friction may have changed, or rounding left the cone.
            g.copy_from_slice(&problem.cone(i).project(frame_impulse));
        },
    );
    for (h, rows) in moments.chunks_exact_mut(3).zip(rigid.turning()) {
        let i = rows.contact as usize;
        let moment = previous.moment(&contacts[i]);
        h.copy_from_slice(&frame_moment(&rigid.contacts()[i], rows.length, moment));
    }
    if !problem.turning.is_empty() {
        problem.project(&mut impulse);
    }
    impulse
}
