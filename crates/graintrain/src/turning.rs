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
pub(crate) fn ball_radius(world: &World, body: usize) -> Option<f64> {
    match &world.geometries[world.bodies.geometry[body].index()].parts[..] {
        [part] if matches!(part.shape, Shape::Sphere(_) | Shape::Capsule(_)) => {
            Some(part.shape.half_thickness())
        }
        _ => None,
    }
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
