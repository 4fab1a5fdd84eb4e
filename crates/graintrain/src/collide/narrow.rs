//! Narrow phase: contacts of two bodies near each other.

use super::capsule::capsule_contacts;
use super::manifold::{Solid, manifold_contacts};
use super::mesh::{TriangleTree, Visitor};
use super::plane::plane_contacts;
use super::reduce::{Touch, reduce};
use crate::math::{Mat3, Quat, Vec3, mix};
use crate::shape::{Capsule, Geometry, HalfSpace, Shape, Sphere};
use parry3d_f64::bounding_volume::Aabb;
use std::sync::Arc;

/// A geometry with what the collision phase derives from it once.
pub(crate) struct Collidable {
    /// The geometry it was made from.
    pub geometry: Arc<Geometry>,
    /// Radius of a ball about the body's origin that holds it; infinite with a plane.
    pub bounding_radius: f64,
    /// The radius, where the geometry is one sphere about the body's origin: the hot path.
    pub ball: Option<f64>,
    /// Smallest half thickness of its parts, m; infinite for planes and surfaces alone.
    pub size: f64,
    /// One entry per part: the tree of a mesh.
    pub trees: Vec<Option<TriangleTree>>,
    /// One entry per part: radius of a ball about the part's origin that holds the part.
    pub part_radius: Vec<f64>,
    /// One entry per part: box along the part's axes around it.
    pub part_bounds: Vec<Aabb>,
}

impl Collidable {
    pub(crate) fn new(geometry: impl Into<Arc<Geometry>>) -> Self {
        let geometry = geometry.into();
        let tree = |shape: &Shape| match shape {
            Shape::Mesh(mesh) => Some(TriangleTree::new(mesh)),
            _ => None,
        };
        let bounds = |shape: &Shape| {
            let [low, high] = shape.bounds();
            Aabb::new(low, high)
        };
        Self {
            bounding_radius: geometry.bounding_radius(),
            size: geometry.parts.iter().map(|part| part.shape.half_thickness()).fold(f64::INFINITY, f64::min),
            ball: geometry.ball(),
            trees: geometry.parts.iter().map(|part| tree(&part.shape)).collect(),
            part_radius: geometry.parts.iter().map(|part| part.shape.bounding_radius()).collect(),
            part_bounds: geometry.parts.iter().map(|part| bounds(&part.shape)).collect(),
            geometry,
        }
    }
}

/// A body in the world.
#[derive(Clone, Copy)]
pub(crate) struct Placed<'a> {
    pub form: &'a Collidable,
    pub position: Vec3,
    pub orientation: Quat,
}

/// A part of a body in the world.
pub(super) struct PlacedPart<'a> {
    pub shape: &'a Shape,
    pub tree: Option<&'a TriangleTree>,
    pub radius: f64,
    pub position: Vec3,
    pub orientation: Quat,
}

impl<'a> Placed<'a> {
    pub(super) fn part(&self, index: usize) -> PlacedPart<'a> {
        let part = &self.form.geometry.parts[index];
        PlacedPart {
            shape: &part.shape,
            tree: self.form.trees[index].as_ref(),
            radius: self.form.part_radius[index],
            position: self.position + self.orientation * part.position,
            orientation: self.orientation * part.orientation,
        }
    }
}

impl<'a> PlacedPart<'a> {
    pub(super) fn solid(&self) -> Solid<'a> {
        Solid::Placed { shape: self.shape, position: self.position, orientation: self.orientation }
    }

    /// As the mesh that `of` is sees it.
    pub(super) fn visitor(&self, of: &PlacedPart<'_>) -> Visitor<'a> {
        let inverse = of.orientation.conjugate();
        let position = inverse * (self.position - of.position);
        Visitor { shape: self.shape, position, orientation: inverse * self.orientation }
    }
}

/// Size and place of the smaller one.
pub(super) fn unit_and_origin(a: &PlacedPart<'_>, b: &PlacedPart<'_>) -> (f64, Vec3) {
    if a.radius < b.radius { (a.radius, a.position) } else { (b.radius, b.position) }
}

/// Contacts of bodies A and B with gap up to the envelope, reduced to what each patch needs, ordered by
/// feature.
pub(crate) fn body_contacts(a: Placed<'_>, b: Placed<'_>, envelope: f64, touches: &mut Vec<Touch>) {
    let (parts_a, parts_b) = (a.form.geometry.parts.len(), b.form.geometry.parts.len());
    if parts_a == 1 && parts_b == 1 {
        part_contacts(&a.part(0), &b.part(0), envelope, touches);
        reduce(touches);
        return;
    }
    let mut found = Vec::new();
    for index_a in 0..parts_a {
        let part_a = a.part(index_a);
        for index_b in 0..parts_b {
            let part_b = b.part(index_b);
            let apart = (part_a.position - part_b.position).length() - part_a.radius - part_b.radius;
            if apart > envelope {
                continue;
            }
            part_contacts(&part_a, &part_b, envelope, &mut found);
            reduce(&mut found);
            // The same number whichever body is A, so that it persists when the two change places.
            let parts = mix((index_a as u64) << 32) ^ mix(index_b as u64);
            for touch in &mut found {
                touch.feature = parts.wrapping_add(touch.feature);
            }
            touches.append(&mut found);
        }
    }
    touches.sort_by_key(|touch| touch.feature);
}

/// Contacts of two parts with gap up to the envelope, normals from B to A, unreduced.
fn part_contacts(a: &PlacedPart<'_>, b: &PlacedPart<'_>, envelope: f64, touches: &mut Vec<Touch>) {
    if is_second(a.shape, b.shape) {
        ordered_contacts(a, b, envelope, touches);
    } else {
        let first = touches.len();
        ordered_contacts(b, a, envelope, touches);
        for touch in &mut touches[first..] {
            touch.normal = -touch.normal;
        }
    }
}

/// Rank of a shape: kernels take the lower rank as A.
fn rank(shape: &Shape) -> (u8, i32) {
    match shape {
        Shape::Sphere(_) => (0, 0),
        Shape::Capsule(_) => (1, 0),
        Shape::Mesh(_) => (3, 0),
        Shape::Plane(_) => (4, 0),
        solid => (2, solid.code()),
    }
}

fn is_second(a: &Shape, b: &Shape) -> bool {
    rank(a) <= rank(b)
}

/// Contacts of two parts of which A has the lower rank; computed in B's frame, given in the world.
fn ordered_contacts(a: &PlacedPart<'_>, b: &PlacedPart<'_>, envelope: f64, touches: &mut Vec<Touch>) {
    let first = touches.len();
    let inverse = b.orientation.conjugate();
    let position = inverse * (a.position - b.position);
    match (a.shape, b.shape) {
        (_, Shape::Mesh(_)) => {
            let Some(tree) = b.tree else { return };
            tree.contacts(&a.visitor(b), envelope, touches);
        }
        (_, Shape::Plane(HalfSpace)) => {
            let rotation = Mat3::from_quat(inverse * a.orientation);
            plane_contacts(a.shape, position, rotation, envelope, touches);
        }
        (&Shape::Sphere(Sphere { radius }), solid) => {
            let distance = solid.form().signed_distance(position);
            let gap = distance.value - radius;
            if gap <= envelope {
                let point = position - (radius + 0.5 * gap) * distance.normal;
                touches.push(Touch { point, normal: distance.normal, gap, feature: 0 });
            }
        }
        (&Shape::Capsule(Capsule { half_length, radius }), solid) => {
            let half_axis = inverse * (a.orientation * Vec3::new(0.0, 0.0, half_length));
            let distance = |p: Vec3| solid.form().signed_distance(p);
            let borders = solid.form().crossings(position, half_axis);
            capsule_contacts(position, half_axis, radius, distance, &borders, envelope, touches);
        }
        _ => {
            let (unit, origin) = unit_and_origin(a, b);
            manifold_contacts(a.solid(), b.solid(), unit, origin, envelope, touches);
            return;
        }
    }
    for touch in &mut touches[first..] {
        touch.point = b.position + b.orientation * touch.point;
        touch.normal = b.orientation * touch.normal;
    }
}
