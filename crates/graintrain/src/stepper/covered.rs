//! Contacts that another contact of the same body covers.
//!
//! A ball that rolls over flush tiles is about to meet the edge of the next one: the plane through the
//! nearest points there bars its way, though the edge lies no higher than the tile that carries the ball.
//! Let `n . x = h` be the plane of a contact of body A with B, and let body C lie below it, `n . x <= h` for
//! all of its points. Where A stays above that plane, as its contact with B sees to, A does not meet C: the
//! contact with C is left out. A ball stays above a plane that holds it in one point, a capsule or cylinder
//! above one that holds it on both sides of where it might meet C.

use super::Stepper;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::shape::Shape;
use crate::world::World;
use std::collections::BTreeMap;

/// Bodies reach above a plane that they reach above by more than this fraction of the smaller one's size.
const LEVEL: f64 = 1e-6;

/// Sine of an angle between normals that are the same.
const PARALLEL: f64 = 1e-6;

/// Sine of an angle up to which a capsule or cylinder lies on a plane.
const LYING: f64 = 0.1;

/// A contact as its round body has it.
struct Side {
    contact: usize,
    /// The other body.
    other: usize,
    /// From the other body to the round one.
    normal: Vec3,
    /// The point of the other body's surface, m.
    point: Vec3,
    gap: f64,
}

impl Side {
    fn height(&self, point: Vec3) -> f64 {
        self.normal.dot(point - self.point)
    }
}

impl Stepper {
    /// Leaves out the contacts that others cover. Cost: a pass over the contacts, and for round bodies that
    /// touch several bodies that are not balls a look at their pairs.
    pub(super) fn leave_covered_out(&self, world: &World, contacts: &mut Vec<Contact>) {
        let mut of_bodies: BTreeMap<u32, Vec<Side>> = BTreeMap::new();
        for (index, contact) in contacts.iter().enumerate().filter(|(_, c)| c.image == [0; 3]) {
            for (body, other, sign) in
                [(contact.body_a, contact.body_b, 1.0), (contact.body_b, contact.body_a, -1.0)]
            {
                if self.collider.is_ball(world, other as usize) || !self.is_round(world, body) {
                    continue;
                }
                let normal = sign * contact.normal;
                let to_surface =
                    if contact.lead == Vec3::ZERO { 0.5 * contact.gap * normal } else { sign * contact.lead };
                let (point, gap) = (contact.point - to_surface, contact.gap);
                let side = Side { contact: index, other: other as usize, normal, point, gap };
                of_bodies.entry(body).or_default().push(side);
            }
        }
        let mut covered = vec![false; contacts.len()];
        for (body, mut sides) in of_bodies.into_iter().filter(|(_, sides)| sides.len() > 1) {
            // What is farther is covered by what is nearer, not both by each other.
            sides.sort_by(|a, b| b.gap.total_cmp(&a.gap).then(a.contact.cmp(&b.contact)));
            for side in &sides {
                let tolerance = LEVEL * self.collider.contact_size(world, &contacts[side.contact]);
                let covers = |by: &&Side| !covered[by.contact] && self.lies_below(world, side, by, tolerance);
                let planes: Vec<&Side> = sides.iter().filter(covers).collect();
                covered[side.contact] = self.is_held(world, body as usize, side, &planes, tolerance);
            }
        }
        let mut index = 0..;
        contacts.retain(|_| !covered[index.next().unwrap_or_default()]);
    }

    /// Whether a body is one ball, capsule or cylinder.
    fn is_round(&self, world: &World, body: u32) -> bool {
        let parts = &world.geometries[world.bodies.geometry[body as usize].index()].parts;
        let round = |shape: &Shape| {
            matches!(shape, Shape::Sphere { .. } | Shape::Capsule { .. } | Shape::Cylinder { .. })
        };
        matches!(parts.as_slice(), [part] if round(&part.shape)) && !world.is_prescribed(body as usize)
    }

    /// Whether the other body of a contact lies below the plane of one that stands otherwise, all through the
    /// step.
    fn lies_below(&self, world: &World, side: &Side, plane: &Side, tolerance: f64) -> bool {
        let bodies = &world.bodies;
        if side.normal.cross(plane.normal).length() <= PARALLEL || plane.height(side.point) > tolerance {
            return false;
        }
        let centre = bodies.position[side.other];
        let (reach, radius) = self.collider.reach(world, side.other, plane.normal);
        let spin = |body: usize| bodies.angular_velocity[body];
        let on_plane = bodies.velocity[plane.other]
            + spin(plane.other).cross(plane.point - bodies.position[plane.other]);
        let rises = plane.normal.dot(bodies.velocity[side.other] - on_plane)
            + spin(side.other).length() * radius
            + spin(plane.other).length() * (centre - plane.point).length();
        plane.height(centre) + reach + self.settings.step * rises.max(0.0) <= tolerance
    }

    /// Whether these planes, of which some are the same, hold a round body where it might meet the other one.
    fn is_held(&self, world: &World, body: usize, side: &Side, planes: &[&Side], tolerance: f64) -> bool {
        if self.collider.is_ball(world, body) {
            return !planes.is_empty();
        }
        let part = &world.geometries[world.bodies.geometry[body].index()].parts[0];
        let axis = world.bodies.orientation[body] * (part.orientation * Vec3::Z);
        let along = |of: &Side| axis.dot(of.point);
        planes.iter().any(|first| {
            planes.iter().any(|second| {
                first.normal.cross(second.normal).length() <= PARALLEL
                    && along(first) <= along(side) + tolerance
                    && along(side) <= along(second) + tolerance
                    && axis.dot(first.normal).abs() <= LYING
            })
        })
    }
}
