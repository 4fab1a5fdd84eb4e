//! Contacts that another contact of the same body covers.
//!
//! A ball that rolls over flush tiles is about to meet the edge of the next one: the plane through the
//! nearest points there bars its way, though the edge lies no higher than the tile that carries the ball. Let
//! `n . x = h` be the plane of a rigid contact of body A with B, and let body C lie below it, `n . x <= h`
//! for all of its points. Where A stays above that plane, as its contact with B sees to, A does not meet C:
//! the contact with C is left out. A ball stays above a plane that holds it in one point, a capsule or
//! cylinder that lies on it above one that holds it on both sides of where it might meet C, a box, hull or
//! cone above one that holds it in points between which it might meet C, or there; each part of A by itself.
//! Nor does A meet C, with another normal, at a point that stands over B no higher than its size: below it
//! there is B, and C's edge or side is hidden.
//! Boxes, hulls and cones on free ones, and images in a periodic cell are not looked at; of what lies askew
//! to an edge some contacts stay. A body C that begins to rise in the step is met one step
//! late, or as soon as it overlaps.

use crate::collide::Collider;
use crate::contact::Contact;
use crate::math::{Vec3, tangents};
use crate::shape::{Part, Shape};
use crate::world::World;
use rayon::prelude::*;

/// Bodies reach above a plane that they reach above by more than this fraction of the smaller one's size.
const LEVEL: f64 = 1e-6;

/// Sine of an angle between normals that are the same.
const PARALLEL: f64 = 1e-6;

/// Points are inside a body up to this fraction of the smaller one's size beside it.
const ROUNDING: f64 = 1e-9;

/// A plane that holds a body this near to a place, over half a capsule's or cylinder's length or the smaller
/// one's size, holds it there.
const END: f64 = 0.01;

/// How far a circle bulges beyond a square in it, over its radius.
const ARC: f64 = 0.3;

/// Sine of an angle up to which a capsule or cylinder lies on a plane.
const LYING: f64 = 0.1;

/// A contact seen from the one of its bodies that may be held off the other.
struct Side {
    contact: usize,
    own: usize,
    /// Which of its parts, and what that is.
    part: usize,
    kind: Kind,
    /// The other body, which of its parts it is, and whether some of them are meshes.
    other: usize,
    carrier: usize,
    is_on_mesh: bool,
    /// From the other body to its own one.
    normal: Vec3,
    /// The point of the other body's surface, m.
    point: Vec3,
    /// The point of its own body's surface, m.
    own_point: Vec3,
}

impl Side {
    fn height(&self, point: Vec3) -> f64 {
        self.normal.dot(point - self.point)
    }
}

/// Leaves out the contacts of a step of this length, s, that others cover. Cost: a pass over the contacts,
/// and a look at the pairs of those that a body has with bodies of a later [`Kind`].
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
        let contacts = self.contacts;
        let has_mesh: Vec<bool> =
            self.world.geometries.iter().map(|form| form.parts.iter().any(is_mesh)).collect();
        let side = |index: usize| {
            let contact = &contacts[index];
            let lead =
                if contact.lead == Vec3::ZERO { 0.5 * contact.gap * contact.normal } else { contact.lead };
            let ends = [(contact.body_a as usize, 1.0), (contact.body_b as usize, -1.0)];
            let [a, b] = ends.map(|(body, sign)| {
                let point = contact.point + sign * lead;
                let (part, kind) = self.part_at(body, point);
                let kind = if self.world.is_prescribed(body) { Kind::Support } else { kind };
                (body, part, kind, point, sign)
            });
            if a.2 == b.2 || contact.image != [0; 3] {
                return None;
            }
            let ((own, part, kind, own_point, sign), (other, carrier, _, point, _)) =
                if a.2 < b.2 { (a, b) } else { (b, a) };
            let is_on_mesh = has_mesh[self.world.bodies.geometry[other].index()];
            Some(Side {
                contact: index,
                own,
                part,
                kind,
                other,
                carrier,
                is_on_mesh,
                normal: sign * contact.normal,
                point,
                own_point,
            })
        };
        let mut sides: Vec<Side> = (0..contacts.len()).into_par_iter().filter_map(side).collect();
        sides.sort_by_key(|side| (side.own, side.part, side.contact));
        let groups: Vec<&[Side]> = sides.chunk_by(|a, b| (a.own, a.part) == (b.own, b.part)).collect();
        let mut covered: Vec<usize> = groups.par_iter().flat_map_iter(|sides| self.of_part(sides)).collect();
        covered.sort_unstable();
        covered
    }

    fn parts(&self, body: usize) -> &[Part] {
        &self.world.geometries[self.world.bodies.geometry[body].index()].parts
    }

    /// The part of a body that has this point of its surface, and what it is.
    fn part_at(&self, body: usize, point: Vec3) -> (usize, Kind) {
        let (bodies, parts) = (&self.world.bodies, self.parts(body));
        if let [part] = parts {
            return (0, Kind::of(part));
        }
        let own = bodies.orientation[body].conjugate() * (point - bodies.position[body]);
        let tie = LEVEL * self.collider.body_size(self.world, body).min(f64::MAX);
        let mut nearest = (f64::INFINITY, 0, Kind::Support);
        for (k, part) in parts.iter().enumerate() {
            let at = part.orientation.conjugate() * (own - part.position);
            let form = part.shape.form();
            if is_mesh(part) || at.length() - form.bounding_radius() > nearest.0 {
                continue;
            }
            let (distance, kind) = (form.signed_distance(at).value.abs(), Kind::of(part));
            // Where parts touch, the one that a single plane holds less.
            if distance < nearest.0 - tie || distance <= nearest.0 + tie && kind > nearest.2 {
                nearest = (distance, k, kind);
            }
        }
        (nearest.1, nearest.2)
    }

    /// Those of the contacts of a part that others cover, none of which is covered itself.
    fn of_part(&self, sides: &[Side]) -> Vec<usize> {
        let (world, contacts) = (self.world, self.contacts);
        let is_rigid = |side: &Side| {
            let [a, b] = world.materials_of(&contacts[side.contact]);
            world.materials.pair_elasticity(a, b).is_rigid()
        };
        let mut planes: Vec<Vec<usize>> = vec![Vec::new(); sides.len()];
        for (k, plane) in sides.iter().enumerate().filter(|(_, plane)| is_rigid(plane)) {
            let mut below: Vec<(usize, bool)> = Vec::new();
            for (side, planes) in sides.iter().zip(&mut planes) {
                let tolerance = LEVEL * self.collider.contact_size(world, &contacts[side.contact]);
                if !self.may_cover(side, plane, tolerance) {
                    continue;
                }
                let known = below.iter().find(|(body, _)| *body == side.other).map(|(_, lies)| *lies);
                let lies = known.unwrap_or_else(|| self.lies_below(side.other, plane, tolerance));
                if known.is_none() {
                    below.push((side.other, lies));
                }
                if lies {
                    planes.push(k);
                }
            }
        }
        let is_covered = |k: usize, covered: &[bool]| {
            let side = &sides[k];
            let kept: Vec<&Side> = planes[k].iter().filter(|&&k| !covered[k]).map(|&k| &sides[k]).collect();
            // Of one body only what lies on it along a line is held off it so.
            let others = kept.iter().filter(|plane| plane.other != side.other || side.kind != Kind::Convex);
            self.is_held(side, &others.copied().collect::<Vec<_>>())
                || kept.iter().any(|plane| self.is_over(side, plane))
        };
        let none = vec![false; sides.len()];
        let mut covered: Vec<bool> = (0..sides.len()).map(|k| is_covered(k, &none)).collect();
        // What is not covered after all holds more, so that one pass does.
        for k in 0..sides.len() {
            covered[k] = covered[k] && is_covered(k, &covered);
        }
        sides.iter().zip(&covered).filter(|(_, covered)| **covered).map(|(side, _)| side.contact).collect()
    }

    /// Whether the plane of another contact may cover a contact, whose points lie below it and above.
    fn may_cover(&self, side: &Side, plane: &Side, tolerance: f64) -> bool {
        // Of several that carry the body alike none covers another one; meshes know their own edges.
        let is_alike = side.normal.cross(plane.normal).length() <= PARALLEL
            && self.contacts[side.contact].gap <= self.contacts[plane.contact].gap + tolerance;
        let is_one = side.other == plane.other && side.kind == Kind::Convex;
        let sunk = END / LEVEL * tolerance;
        !(is_alike || is_one && side.is_on_mesh)
            && plane.height(side.point) <= tolerance
            && plane.height(side.own_point) >= -sunk
    }

    /// Whether a body lies below the plane of a contact, all through the step.
    fn lies_below(&self, body: usize, plane: &Side, tolerance: f64) -> bool {
        let bodies = &self.world.bodies;
        let centre = bodies.position[body];
        let (reach, radius) = self.collider.reach(self.world, body, plane.normal);
        let spin = |body: usize| bodies.angular_velocity[body];
        let on_plane = bodies.velocity[plane.other]
            + spin(plane.other).cross(plane.point - bodies.position[plane.other]);
        let rises = plane.normal.dot(bodies.velocity[body] - on_plane)
            + spin(body).length() * radius
            + spin(plane.other).length() * (centre - plane.point).length();
        plane.height(centre) + reach + self.step * rises.max(0.0) <= tolerance
    }

    /// Whether the own point of a contact stands over the part of a body that has a plane, no higher than its
    /// size: what it would meet below is that one, right under the plane, and no edge or side of another part
    /// that lies there.
    fn is_over(&self, side: &Side, plane: &Side) -> bool {
        let bodies = &self.world.bodies;
        let is_parallel = side.normal.cross(plane.normal).length() <= PARALLEL;
        let is_one = side.other == plane.other && self.parts(plane.other).len() == 1;
        let is_ahead = [side, plane].iter().any(|side| self.contacts[side.contact].lead != Vec3::ZERO);
        if is_parallel || is_one || is_ahead {
            return false;
        }
        let size = self.collider.contact_size(self.world, &self.contacts[side.contact]);
        if plane.height(side.own_point) > size {
            return false;
        }
        let under = side.own_point - (plane.height(side.own_point) + LEVEL * size) * plane.normal;
        let part = &self.parts(plane.other)[plane.carrier];
        let own = bodies.orientation[plane.other].conjugate() * (under - bodies.position[plane.other]);
        let at = part.orientation.conjugate() * (own - part.position);
        !is_mesh(part) && part.shape.form().signed_distance(at).value <= ROUNDING * size
    }

    /// Whether these planes, of which some are the same, hold a body where it might meet the other one.
    fn is_held(&self, side: &Side, planes: &[&Side]) -> bool {
        let world = self.world;
        let part = &self.parts(side.own)[side.part];
        let form = part.shape.form();
        let half_length = form.half_axis();
        if half_length == Some(0.0) {
            return !planes.is_empty();
        }
        let (turn, centre) = (world.bodies.orientation[side.own], world.bodies.position[side.own]);
        let (axis, centre) = (turn * (part.orientation * Vec3::Z), centre + turn * part.position);
        let size = self.collider.contact_size(world, &self.contacts[side.contact]);
        let is_parallel = |a: &Side, b: &Side| a.normal.cross(b.normal).length() <= PARALLEL;
        planes.iter().enumerate().any(|(k, plane)| {
            let mut same = planes.iter().filter(|other| is_parallel(other, plane));
            match half_length {
                Some(half_length) if axis.dot(plane.normal).abs() <= LYING => {
                    // Of the segment that the body is about; beyond its ends there is nothing that could
                    // meet.
                    let along = |of: &Side| axis.dot(of.point - centre).clamp(-half_length, half_length);
                    let (at, tolerance) = (along(side), END * half_length);
                    along(plane) <= at + tolerance && same.any(|other| at <= along(other) + tolerance)
                }
                // All of them are looked at together.
                _ if planes[..k].iter().any(|other| is_parallel(other, plane)) => false,
                _ => {
                    let others = same.filter(|other| other.other != side.other);
                    let around = others.map(|other| other.own_point).collect();
                    let (distance, is_area) = beside(side.own_point, around, plane.normal);
                    let bulge =
                        if form.is_of_revolution() && is_area { ARC * form.reach(Vec3::X) } else { 0.0 };
                    distance <= bulge + END * size
                }
            }
        })
    }
}

/// What a part may be held off: parts of a later kind.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
enum Kind {
    /// A ball, capsule or cylinder.
    Round,
    /// Convex.
    Convex,
    /// A mesh or plane, and what is driven.
    Support,
}

impl Kind {
    /// Of a part of a body that is not driven.
    fn of(part: &Part) -> Self {
        match &part.shape {
            shape if shape.form().half_axis().is_some() => Self::Round,
            Shape::Mesh(_) | Shape::Plane(_) => Self::Support,
            _ => Self::Convex,
        }
    }
}

fn is_mesh(part: &Part) -> bool {
    matches!(part.shape, Shape::Mesh(_))
}

/// How far a point is from the convex hull of others, all of a plane with this normal, m, and whether that is
/// more than a point or a line. Cost: sorts them (A. M. Andrew, "Another efficient algorithm for convex hulls
/// in two dimensions", Information Processing Letters 9:216-219, 1979).
fn beside(point: Vec3, others: Vec<Vec3>, normal: Vec3) -> (f64, bool) {
    let (along, across) = tangents(normal);
    let flat = |other: Vec3| (along.dot(other - point), across.dot(other - point));
    let mut flat: Vec<(f64, f64)> = others.into_iter().map(flat).collect();
    flat.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let turn =
        |a: (f64, f64), b: (f64, f64), c: (f64, f64)| (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0);
    // Counter-clockwise: the lower side from the left, then the upper one from the right.
    let mut hull: Vec<(f64, f64)> = Vec::new();
    for side in [flat.clone(), flat.iter().rev().copied().collect()] {
        let first = hull.len();
        for p in side {
            while hull.len() >= first + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    }
    if hull.is_empty() {
        hull.extend(flat.first());
    }
    let is_area = hull.len() > 2;
    let sides = || hull.iter().copied().zip(hull.iter().copied().cycle().skip(1));
    if is_area && sides().all(|(a, b)| turn(a, b, (0.0, 0.0)) >= 0.0) {
        return (0.0, true);
    }
    let to_side = |((a, b), (c, d)): ((f64, f64), (f64, f64))| {
        let (way, square) = ((c - a, d - b), (c - a).powi(2) + (d - b).powi(2));
        let share = if square > 0.0 { (-(a * way.0 + b * way.1) / square).clamp(0.0, 1.0) } else { 0.0 };
        ((a + share * way.0).powi(2) + (b + share * way.1).powi(2)).sqrt()
    };
    (sides().map(to_side).fold(f64::INFINITY, f64::min), is_area)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Inside a square, on its edge, beside an edge and a corner; of two points and of one; over the plane.
    #[test]
    fn beside_is_the_distance_to_the_hull() {
        let square = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (0.2, 0.1)];
        let square: Vec<Vec3> = square.map(|(x, y)| Vec3::new(x, y, 0.3)).into();
        let cases = [((0.9, -0.4), 0.0), ((1.0, 0.5), 0.0), ((1.5, 0.5), 0.5), ((4.0, 5.0), 5.0)];
        for ((x, y), expected) in cases {
            let point = Vec3::new(x, y, -2.0);
            for normal in [Vec3::Z, -Vec3::Z] {
                let (distance, is_area) = beside(point, square.clone(), normal);
                assert!((distance - expected).abs() < 1e-15 && is_area, "{point}");
            }
        }
        for (count, expected) in [(2, 1.0), (1, 2.0_f64.sqrt())] {
            let (distance, is_area) = beside(Vec3::ZERO, square[..count].to_vec(), Vec3::Z);
            assert!((distance - expected).abs() < 1e-15 && !is_area);
        }
        assert_eq!(beside(Vec3::ZERO, Vec::new(), Vec3::Z), (f64::INFINITY, false));
    }
}
