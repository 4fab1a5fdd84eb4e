//! How the frames of contacts turn within a step.

use crate::assemble::{to_frame, velocity_of};
use crate::cell;
use crate::contact::Contact;
use crate::joint::{Motor, PlacedJoint};
use crate::math::Vec3;
use crate::turning::ball_radius;
use crate::world::World;
use graintrain_ccp::RigidContact;
use rayon::prelude::*;

/// Contacts per parallel task.
const TASK: usize = 4096;

/// How the frame of a contact turns about its normal within a step, with the surface of a body that motions
/// or motors lead. What rides on a turntable moves by chords of its circle, of which those of velocities at
/// the start of steps are tangents: it would spiral outward by exp(w^2 dt t / 2). Two free bodies turn by
/// what their contacts do at that start; turned with them, those would take less energy the longer the step.
///
/// With theta = dt w_n / 2, k = theta / (1 + theta^2) (a step does not resolve what turns further) and the
/// relative velocity m = (u_A - u_B)_t of the centres before the step, which turns on until now, the slip in
/// the middle of the step is that at its start and -k n x (m + 2 k n x m).
pub(crate) struct FrameTurn {
    /// theta, rad.
    angle: f64,
    /// Of w_A and w_B in w.
    shares: [f64; 2],
    normal: Vec3,
    /// m, m/s.
    motion: Vec3,
    step: f64,
}

impl FrameTurn {
    /// That of a contact, with the velocities of bodies before the step and their angular velocities, where
    /// one is led by a surface that turns.
    pub(crate) fn of(
        world: &World,
        contact: &Contact,
        step: f64,
        is_led: impl Fn(usize) -> bool,
        velocity: impl Fn(usize) -> [Vec3; 2],
    ) -> Option<Self> {
        let bodies = [contact.body_a, contact.body_b].map(|body| body as usize);
        let led = bodies.map(is_led);
        if led == [false; 2] {
            return None;
        }
        let shares = frame_shares(world, bodies, led);
        let [[u_a, w_a], [u_b, w_b]] = bodies.map(velocity);
        let normal = contact.normal;
        let angle = 0.5 * step * normal.dot(shares[0] * w_a + shares[1] * w_b);
        let relative = u_a - u_b - cell::image_velocity(world.cell(), contact);
        let motion = relative - normal.dot(relative) * normal;
        Some(Self { angle, shares, normal, motion, step })
    }

    /// By how much the slip in the middle of the step differs from that at its start, m/s.
    pub(crate) fn slip(&self) -> Vec3 {
        let k = self.angle / (1.0 + self.angle * self.angle);
        2.0 * k * k * self.motion - k * self.normal.cross(self.motion)
    }

    /// Derivatives of slip . y by u_A (by u_B it is minus that), w_A and w_B.
    pub(crate) fn derivative(&self, y: Vec3) -> (Vec3, [Vec3; 2]) {
        let Self { angle, shares, normal, motion, step } = *self;
        let square = angle * angle;
        let k = angle / (1.0 + square);
        let along = y - normal.dot(y) * normal;
        let by_motion = 2.0 * k * k * along - k * y.cross(normal);
        let by_k = (4.0 * k * motion - normal.cross(motion)).dot(y);
        let by_angle = (1.0 - square) / (1.0 + square).powi(2) * by_k;
        (by_motion, shares.map(|share| 0.5 * step * share * by_angle * normal))
    }
}

/// The shares of w_A and w_B in the spin of the frame of a contact: R_A and R_B over their sum, the radius of
/// all but balls and capsules without bounds, and of two such the driven one, or both alike; none of those
/// that nothing leads.
fn frame_shares(world: &World, bodies: [usize; 2], led: [bool; 2]) -> [f64; 2] {
    let shares = match bodies.map(|body| ball_radius(world, body)) {
        [Some(a), Some(b)] => [a / (a + b), b / (a + b)],
        [None, Some(_)] => [1.0, 0.0],
        [Some(_), None] => [0.0, 1.0],
        [None, None] => match bodies.map(|body| world.is_prescribed(body)) {
            [true, false] if led[0] => [1.0, 0.0],
            [false, true] if led[1] => [0.0, 1.0],
            _ if led == [true; 2] => [0.5; 2],
            _ => [1.0; 2],
        },
    };
    std::array::from_fn(|k| if led[k] { shares[k] } else { 0.0 })
}

/// What the turn of the contacts' frames makes of the slip ([`FrameTurn`]), as r; empty where nothing that
/// motions or motors lead turns. Velocities `before` the step and `free`, six per body.
pub(crate) fn turned_slip(
    world: &World,
    contacts: &[Contact],
    rows: &[RigidContact],
    [before, free]: [&[f64]; 2],
    step: f64,
) -> Vec<f64> {
    let velocity = |body: usize| frame_velocity(world, [before, free], body);
    let mut is_led: Vec<bool> = (0..world.bodies.len()).map(|body| has_led_turns(world, body)).collect();
    let leads = |placed: &&PlacedJoint| matches!(placed.joint.motor, Some(Motor::Speed { .. }));
    for body in world.joints().iter().filter(leads).flat_map(|placed| placed.joint.bodies.iter().flatten()) {
        is_led[body.index()] = true;
    }
    if !is_led.iter().enumerate().any(|(body, &is_led)| is_led && velocity(body)[1] != Vec3::ZERO) {
        return Vec::new();
    }
    let mut slip = vec![0.0; 3 * contacts.len()];
    slip.par_chunks_exact_mut(3).zip(contacts).zip(rows).with_min_len(TASK).for_each(
        |((u, contact), row)| {
            if let Some(turn) = FrameTurn::of(world, contact, step, |body| is_led[body], velocity) {
                // Along the normal rounding alone.
                let [_, along, across] = to_frame(row, turn.slip());
                u.copy_from_slice(&[0.0, along, across]);
            }
        },
    );
    slip
}

/// Whether a motion leads turns of a body.
pub(crate) fn has_led_turns(world: &World, body: usize) -> bool {
    world.free_degrees(body)[3..] != [true; 3]
}

/// Velocity of a body before the step and its angular velocity, that of a prescribed one in the step.
pub(crate) fn frame_velocity(world: &World, [before, free]: [&[f64]; 2], body: usize) -> [Vec3; 2] {
    let [linear, spin] = velocity_of(before, body);
    [linear, if world.is_prescribed(body) { velocity_of(free, body)[1] } else { spin }]
}
