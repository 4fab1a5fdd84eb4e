//! Frames of the bodies as points.

use super::size::inscribed_radius;
use super::vtp::{Cells, DataArray, PolyData, Values};
use graintrain::math::{Quat, Vec3};
use graintrain::shape::{Geometry, Shape};
use graintrain::world::World;

/// Kind of a body, as the array `shapetype` tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ShapeType {
    Sphere = 0,
    Box = 1,
    Capsule = 2,
    Cylinder = 3,
    Plane = 4,
    Mesh = 5,
    /// Several parts, of which this point is not a sphere.
    Compound = 6,
}

/// Net contact force and torque on every body, averaged over the step, and its number of loaded contacts.
struct ContactLoads {
    /// N.
    force: Vec<Vec3>,
    /// About the centre of mass, N m.
    torque: Vec<Vec3>,
    /// Contacts with a force.
    contacts: Vec<i32>,
}

impl ContactLoads {
    fn new(world: &World, step: f64) -> Self {
        let bodies = world.bodies.len();
        let mut loads = Self {
            force: vec![Vec3::ZERO; bodies],
            torque: vec![Vec3::ZERO; bodies],
            contacts: vec![0; bodies],
        };
        for (contact, &impulse) in world.contacts.contacts.iter().zip(&world.contacts.impulse) {
            if impulse == Vec3::ZERO {
                continue;
            }
            let force = impulse / step;
            for (body, force) in [(contact.body_a as usize, force), (contact.body_b as usize, -force)] {
                loads.force[body] += force;
                loads.torque[body] += (contact.point - world.bodies.position[body]).cross(force);
                loads.contacts[body] += 1;
            }
        }
        loads
    }
}

/// A point of the frame: a sphere, or the centre of a body that is not one.
struct Point {
    body: usize,
    position: Vec3,
    radius: f64,
    kind: ShapeType,
}

/// Points of a geometry in its own frame with their radii: one per sphere, or, where there is none and the body can
/// move (`free`), one at the centre with the radius of an inscribed ball, so that it hides inside the drawn surface.
fn points_of(geometry: &Geometry, free: bool) -> Vec<(Vec3, f64, ShapeType)> {
    let spheres: Vec<_> = geometry
        .parts
        .iter()
        .filter_map(|part| match part.shape {
            Shape::Sphere { radius } => Some((part.position, radius, ShapeType::Sphere)),
            _ => None,
        })
        .collect();
    if !spheres.is_empty() || !free {
        return spheres;
    }
    let kind = match geometry.parts.as_slice() {
        [part] => match part.shape {
            Shape::Sphere { .. } => ShapeType::Sphere,
            Shape::Box { .. } => ShapeType::Box,
            Shape::Plane => ShapeType::Plane,
            Shape::Capsule { .. } => ShapeType::Capsule,
            Shape::Cylinder { .. } => ShapeType::Cylinder,
            Shape::Mesh { .. } => ShapeType::Mesh,
        },
        _ => ShapeType::Compound,
    };
    let radius =
        geometry.parts.iter().map(|part| inscribed_radius(&part.shape)).fold(f64::INFINITY, f64::min);
    vec![(Vec3::ZERO, radius, kind)]
}

/// The frame: one point per sphere, plus one per other body with a degree of freedom. Walls, blades and mixers without
/// a sphere are left to the surfaces.
///
/// Arrays: `id` (the body's index for its first point, then numbers from the number of bodies on), `body` (index),
/// `type` (material), `shapetype`, `radius` (m), `mass` (kg, of the body), `v` (m/s, of the point), `omega` (rad/s),
/// `quat` (x y z w), `f` (N) and `tq` (N m), the net contact force and torque on the body averaged over the step of
/// length `step`, and `contacts`, its number of loaded contacts.
pub fn particles(world: &World, step: f64) -> PolyData {
    let bodies = &world.bodies;
    let templates = |free: bool| -> Vec<Vec<(Vec3, f64, ShapeType)>> {
        world.geometries.iter().map(|geometry| points_of(geometry, free)).collect()
    };
    let (held, free) = (templates(false), templates(true));
    let mut points = Vec::with_capacity(bodies.len());
    for body in 0..bodies.len() {
        let can_move = !world.is_prescribed(body);
        let geometry = bodies.geometry[body] as usize;
        for &(position, radius, kind) in if can_move { &free[geometry] } else { &held[geometry] } {
            let position = bodies.position[body] + bodies.orientation[body] * position;
            points.push(Point { body, position, radius, kind });
        }
    }
    let mut next_id = bodies.len() as i64;
    let mut previous_body = usize::MAX;
    let id = points
        .iter()
        .map(|point| {
            if point.body != previous_body {
                previous_body = point.body;
                return point.body as i64;
            }
            next_id += 1;
            next_id - 1
        })
        .collect();
    let loads = ContactLoads::new(world, step);
    let of_bodies = |values: &[Vec3]| points.iter().map(|point| values[point.body]).collect::<Vec<_>>();
    let velocity = points.iter().map(|point| {
        let arm = point.position - bodies.position[point.body];
        bodies.velocity[point.body] + bodies.angular_velocity[point.body].cross(arm)
    });
    let quaternion =
        points.iter().flat_map(|point| Quat::to_array(&bodies.orientation[point.body])).collect();
    let point_data = vec![
        DataArray::int64("id", id),
        DataArray::int32("type", points.iter().map(|point| bodies.material[point.body] as i32).collect()),
        DataArray::int32("shapetype", points.iter().map(|point| point.kind as i32).collect()),
        DataArray::scalar("radius", points.iter().map(|point| point.radius).collect()),
        DataArray::scalar("mass", points.iter().map(|point| bodies.mass[point.body]).collect()),
        DataArray::vector("v", velocity),
        DataArray::vector("omega", of_bodies(&bodies.angular_velocity)),
        DataArray { name: "quat", components: 4, values: Values::Real(quaternion) },
        DataArray::vector("f", of_bodies(&loads.force)),
        DataArray::vector("tq", of_bodies(&loads.torque)),
        DataArray::int32("contacts", points.iter().map(|point| loads.contacts[point.body]).collect()),
        DataArray::int64("body", points.iter().map(|point| point.body as i64).collect()),
    ];
    PolyData {
        points: points.iter().map(|point| point.position).collect(),
        cells: Cells::verts(points.len()),
        point_data,
        cell_data: Vec::new(),
    }
}
