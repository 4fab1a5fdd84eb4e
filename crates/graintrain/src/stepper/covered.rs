//! Contacts that another contact of the same body covers.
//!
//! A ball that rolls over flush tiles is about to meet the edge of the next one: the plane through the
//! nearest points there bars its way, though the edge lies no higher than the tile that carries the ball. Let
//! `n . x = h` be the plane of a rigid contact of body A with B, and let body C lie below it, `n . x <= h`
//! for all of its points. Where A stays above that plane, as its contact with B sees to, A does not meet C:
//! the contact with C is left out. A ball stays above a plane that holds it in one point, a capsule or
//! cylinder that lies on it above one that holds it on both sides of where it might meet C. Bodies of several
//! parts and images in a periodic cell are not looked at; of what lies askew to an edge some contacts stay. A
//! body C that begins to rise in the step is met one step late, or as soon as it overlaps.

use crate::collide::Collider;
use crate::contact::Contact;
use crate::math::Vec3;
use crate::world::World;
use rayon::prelude::*;

/// Bodies reach above a plane that they reach above by more than this fraction of the smaller one's size.
const LEVEL: f64 = 1e-6;

/// Sine of an angle between normals that are the same.
const PARALLEL: f64 = 1e-6;

/// A plane that holds a capsule or cylinder this near to an end, over half its length, holds the end.
const END: f64 = 0.01;

/// Sine of an angle up to which a capsule or cylinder lies on a plane.
const LYING: f64 = 0.1;

/// A contact as its round body has it.
struct Side {
    contact: usize,
    round: usize,
    /// The other body.
    other: usize,
    /// From the other body to the round one.
    normal: Vec3,
    /// The point of the other body's surface, m.
    point: Vec3,
}

impl Side {
    fn height(&self, point: Vec3) -> f64 {
        self.normal.dot(point - self.point)
    }
}

/// Leaves out the contacts of a step of this length, s, that others cover. Cost: a pass over the contacts,
/// and a look at the pairs of those that a round body has with bodies that are not round and free.
pub(super) fn leave_covered_out(world: &World, collider: &Collider, step: f64, contacts: &mut Vec<Contact>) {
    let covered = Cover { world, collider, step, contacts }.covered();
    leave_out(contacts, &covered);
}

/// Takes these out, which are given by their places, ascending.
pub(super) fn leave_out(contacts: &mut Vec<Contact>, places: &[usize]) {
    let mut place = 0..;
    contacts.retain(|_| places.binary_search(&place.next().unwrap_or_default()).is_err());
}

/// What covers contacts.
struct Cover<'a> {
    world: &'a World,
    collider: &'a Collider,
    step: f64,
    contacts: &'a [Contact],
}

impl Cover<'_> {
    /// The contacts that others cover, ascending.
    fn covered(&self) -> Vec<usize> {
        let (world, contacts) = (self.world, self.contacts);
        let is_round: Vec<bool> =
            (0..world.bodies.len()).into_par_iter().map(|body| is_round(world, body)).collect();
        let side = |index: usize| {
            let contact = &contacts[index];
            let [a, b] = [contact.body_a, contact.body_b].map(|body| is_round[body as usize]);
            if a == b || contact.image != [0; 3] {
                return None;
            }
            let (round, other, sign) = if a {
                (contact.body_a, contact.body_b, 1.0)
            } else {
                (contact.body_b, contact.body_a, -1.0)
            };
            let normal = sign * contact.normal;
            let to_surface =
                if contact.lead == Vec3::ZERO { 0.5 * contact.gap * normal } else { sign * contact.lead };
            let (point, other) = (contact.point - to_surface, other as usize);
            Some(Side { contact: index, round: round as usize, other, normal, point })
        };
        let mut sides: Vec<Side> = (0..contacts.len()).into_par_iter().filter_map(side).collect();
        sides.sort_by_key(|side| (side.round, side.contact));
        let groups: Vec<&[Side]> = sides.chunk_by(|a, b| a.round == b.round).collect();
        let mut covered: Vec<usize> = groups.par_iter().flat_map_iter(|sides| self.of_body(sides)).collect();
        covered.sort_unstable();
        covered
    }

    /// Those of the contacts of a round body that others cover, none of which is covered itself.
    fn of_body(&self, sides: &[Side]) -> Vec<usize> {
        let (world, contacts) = (self.world, self.contacts);
        let is_rigid = |side: &Side| {
            let [a, b] = world.materials_of(&contacts[side.contact]);
            world.materials.pair_elasticity(a, b).is_rigid()
        };
        let lies_below = |side: &Side, plane: &Side| {
            let tolerance = LEVEL * self.collider.contact_size(world, &contacts[side.contact]);
            is_rigid(plane) && self.lies_below(side, plane, tolerance)
        };
        let planes: Vec<Vec<usize>> = sides
            .iter()
            .map(|side| (0..sides.len()).filter(|&k| lies_below(side, &sides[k])).collect())
            .collect();
        let mut covered: Vec<bool> = planes.iter().map(|planes| !planes.is_empty()).collect();
        loop {
            let open = (0..sides.len()).find(|&k| {
                let kept = planes[k].iter().filter(|&&k| !covered[k]).map(|&k| &sides[k]);
                covered[k] && !is_held(world, &sides[k], &kept.collect::<Vec<_>>())
            });
            match open {
                Some(k) => covered[k] = false,
                None => break,
            }
        }
        sides.iter().zip(&covered).filter(|(_, covered)| **covered).map(|(side, _)| side.contact).collect()
    }

    /// Whether the other body of a contact lies below the plane of another one, all through the step.
    fn lies_below(&self, side: &Side, plane: &Side, tolerance: f64) -> bool {
        let bodies = &self.world.bodies;
        // Of several that carry the body alike none covers another one.
        let is_alike = side.normal.cross(plane.normal).length() <= PARALLEL
            && self.contacts[side.contact].gap <= self.contacts[plane.contact].gap + tolerance;
        if is_alike || plane.height(side.point) > tolerance {
            return false;
        }
        let centre = bodies.position[side.other];
        let (reach, radius) = self.collider.reach(self.world, side.other, plane.normal);
        let spin = |body: usize| bodies.angular_velocity[body];
        let on_plane = bodies.velocity[plane.other]
            + spin(plane.other).cross(plane.point - bodies.position[plane.other]);
        let rises = plane.normal.dot(bodies.velocity[side.other] - on_plane)
            + spin(side.other).length() * radius
            + spin(plane.other).length() * (centre - plane.point).length();
        plane.height(centre) + reach + self.step * rises.max(0.0) <= tolerance
    }
}

/// Whether a body is one ball, capsule or cylinder.
fn is_round(world: &World, body: usize) -> bool {
    let parts = &world.geometries[world.bodies.geometry[body].index()].parts;
    matches!(parts.as_slice(), [part] if part.shape.form().half_axis().is_some())
        && !world.is_prescribed(body)
}

/// Whether these planes, of which some are the same, hold a round body where it might meet the other one.
fn is_held(world: &World, side: &Side, planes: &[&Side]) -> bool {
    let part = &world.geometries[world.bodies.geometry[side.round].index()].parts[0];
    let Some(half_length) = part.shape.form().half_axis().filter(|half_length| *half_length > 0.0) else {
        return !planes.is_empty();
    };
    let (turn, centre) = (world.bodies.orientation[side.round], world.bodies.position[side.round]);
    let (axis, centre) = (turn * (part.orientation * Vec3::Z), centre + turn * part.position);
    let tolerance = END * half_length;
    // Of the segment that the body is about; beyond its ends there is nothing that could meet.
    let along = |of: &Side| axis.dot(of.point - centre).clamp(-half_length, half_length);
    planes.iter().any(|first| {
        planes.iter().any(|second| {
            first.normal.cross(second.normal).length() <= PARALLEL
                && along(first) <= along(side) + tolerance
                && along(side) <= along(second) + tolerance
                && axis.dot(first.normal).abs() <= LYING
        })
    })
}
