//! Rolling and spinning friction of contacts: what resists a relative rotation of two bodies that touch.
//!
//! With the relative angular velocity w = w_A - w_B, its part w_n along the normal and w_t across it, and the
//! moment tau on body A,
//!
//! ```text
//! |tau_t| <= mu_r g_n,   tau_t = -mu_r g_n w_t / |w_t|   where w_t is not zero        (rolling)
//! |tau_n| <= mu_s g_n,   tau_n = -mu_s g_n w_n / |w_n|   where w_n is not zero        (spinning)
//! ```
//!
//! in the solve of sliding friction, with one normal impulse g_n for all three. The coefficients mu_r and
//! mu_s are lengths, m: that of rolling is the distance by which the normal force stands ahead of the contact
//! point. Materials state them as such, or as a number that is multiplied by the effective radius R* = R_A
//! R_B / (R_A + R_B) of the pair, as is usual for grains (J. Ai, J.-F. Chen, J. M. Rotter, J. Y. Ooi,
//! "Assessment of rolling resistance models in discrete element simulations", Powder Technology 206:269-282,
//! 2011): a ball on an incline then stays below tan = mu_r / R. A cone of its own: A. Tasora, M. Anitescu, "A
//! complementarity-based rolling friction model for rigid contacts", Meccanica 48:1643-1659, 2013; V. Acary,
//! F. Bourrier, "Coulomb friction with rolling resistance as a cone complementarity problem", European
//! Journal of Mechanics A/Solids 85:104046, 2021.

use crate::cell;
use crate::contact::Contact;
use crate::material::{Materials, TurningResistance};
use crate::math::Vec3;
use crate::shape::Shape;
use crate::world::World;
use graintrain_ccp::{RigidContact, TurningFriction, TurningRows};
use graintrain_linalg::real;
use std::f64::consts::PI;

/// Rows and coefficients of the contacts that resist turning, in the order of the contacts. The length of the
/// rows is the effective radius.
pub(crate) fn turning(world: &World, contacts: &[Contact]) -> (Vec<TurningRows>, Vec<TurningFriction>) {
    if !world.materials.resist_turning() {
        return Default::default();
    }
    let material = |body: u32| world.bodies.material[body as usize].index();
    let of_contact = |(i, contact): (usize, &Contact)| {
        let (a, b) = (material(contact.body_a), material(contact.body_b));
        let [rolling, spinning] =
            [Materials::pair_rolling, Materials::pair_spinning].map(|table| table(&world.materials, a, b));
        if rolling == TurningResistance::NONE && spinning == TurningResistance::NONE {
            return None;
        }
        let radius = effective_radius(world, [contact.body_a, contact.body_b]);
        // Between bodies that nothing can move no impulse matters.
        if !radius.is_finite() {
            return None;
        }
        let [rolling, spinning] = [rolling, spinning].map(|resistance| resistance.length(radius) / radius);
        let contact = i as u32;
        Some((TurningRows { contact, length: radius }, TurningFriction { contact, rolling, spinning }))
    };
    contacts.iter().enumerate().filter_map(of_contact).unzip()
}

/// R* = R_A R_B / (R_A + R_B), m; that of the other body where one is a wall.
fn effective_radius(world: &World, bodies: [u32; 2]) -> f64 {
    let [a, b] = bodies.map(|body| radius(world, body as usize));
    1.0 / (1.0 / a + 1.0 / b)
}

/// Radius that a body counts with, m: of balls and capsules their own, of others that move that of the ball
/// of the same volume (of open surfaces, which have none, that of the ball around them); infinite for walls,
/// that is, bodies of other shapes that are fixed or wholly driven.
fn radius(world: &World, body: usize) -> f64 {
    let geometry = &world.geometries[world.bodies.geometry[body].index()];
    match ball_radius(world, body) {
        Some(radius) => radius,
        None if world.is_prescribed(body) => f64::INFINITY,
        None if geometry.volume <= 0.0 => geometry.bounding_radius(),
        None => real::cbrt(0.75 / PI * geometry.volume),
    }
}

/// Radius of a ball or capsule, m.
fn ball_radius(world: &World, body: usize) -> Option<f64> {
    match &world.geometries[world.bodies.geometry[body].index()].parts[..] {
        [part] if matches!(part.shape, Shape::Sphere(_) | Shape::Capsule(_)) => {
            Some(part.shape.half_thickness())
        }
        _ => None,
    }
}

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

/// Turning velocities w_A - w_B in the contacts' frames (n, t1, t2) times the length of the rows, m/s, of
/// velocities of all bodies (six numbers each), prescribed ones included.
pub(crate) fn turning_velocities(
    contacts: &[Contact],
    rows: &[RigidContact],
    turning: &[TurningRows],
    velocity: &[f64],
) -> Vec<f64> {
    let spin = |body: u32| Vec3::from_slice(&velocity[6 * body as usize + 3..6 * body as usize + 6]);
    turning
        .iter()
        .flat_map(|&TurningRows { contact, length }| {
            let Contact { body_a, body_b, .. } = contacts[contact as usize];
            let relative = length * (spin(body_a) - spin(body_b));
            rows[contact as usize].frame.map(|axis| Vec3::from_array(axis).dot(relative))
        })
        .collect()
}

/// Moment on body A of impulses h of turning rows, N m s, world axes.
pub(crate) fn world_moment(row: &RigidContact, length: f64, h: &[f64]) -> Vec3 {
    let [n, t1, t2] = row.frame.map(Vec3::from_array);
    length * (h[0] * n + h[1] * t1 + h[2] * t2)
}

/// The other way round: impulses h of a moment on body A.
pub(crate) fn frame_moment(row: &RigidContact, length: f64, moment: Vec3) -> [f64; 3] {
    row.frame.map(|axis| Vec3::from_array(axis).dot(moment) / length)
}
