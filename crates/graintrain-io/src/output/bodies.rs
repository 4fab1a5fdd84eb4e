//! Frames of the bodies as points.

use super::vtp::{Cells, DataArray, PolyData, Values};
use crate::body_numbers::BodyNumbers;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::shape::{Geometry, Shape};
use graintrain::world::World;

/// What the array `shapetype` tells of a sphere and of a body of several parts; of others it is
/// [`Shape::code`].
const SPHERE: i32 = 0;
const COMPOUND: i32 = 6;

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
            let ends = contact.surface_points();
            let bodies = [(contact.body_a as usize, force), (contact.body_b as usize, -force)];
            for ((body, force), point) in bodies.into_iter().zip(ends) {
                loads.force[body] += force;
                loads.torque[body] += world.arm_to(body, point, step).cross(force);
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
    kind: i32,
    half_axes: Vec3,
    orientation: Quat,
}

/// A point of a geometry in its own frame.
struct Template {
    position: Vec3,
    radius: f64,
    kind: i32,
    /// Of an ellipsoid inside the shape, m.
    half_axes: Vec3,
    /// From the axes of the shape to those of the body.
    orientation: Quat,
}

impl Template {
    fn sphere(position: Vec3, shape: &Shape) -> Self {
        let radius = shape.inscribed_radius();
        let half_axes = Vec3::splat(radius);
        Self { position, radius, kind: SPHERE, half_axes, orientation: Quat::IDENTITY }
    }
}

/// Points of a geometry in its own frame with their radii: one per sphere, or, where there is none and the
/// body can move (`free`), one at the centre with the radius of an inscribed ball, so that it hides inside
/// the drawn surface.
fn points_of(geometry: &Geometry, free: bool) -> Vec<Template> {
    let spheres: Vec<_> = geometry
        .parts
        .iter()
        .filter(|part| matches!(part.shape, Shape::Sphere(_)))
        .map(|part| Template::sphere(part.position, &part.shape))
        .collect();
    if !spheres.is_empty() || !free {
        return spheres;
    }
    let kind = if let [part] = geometry.parts.as_slice() { part.shape.code() } else { COMPOUND };
    let inscribed = geometry.parts.iter().map(|part| part.shape.inscribed_radius());
    let radius = inscribed.reduce(f64::min).unwrap_or(0.0);
    let turned = match geometry.parts.as_slice() {
        [part] => part.shape.inscribed_half_axes().map(|half_axes| (half_axes, part.orientation)),
        _ => None,
    };
    let (half_axes, orientation) = turned.unwrap_or((Vec3::splat(radius), Quat::IDENTITY));
    vec![Template { position: Vec3::ZERO, radius, kind, half_axes, orientation }]
}

/// The frame: one point per sphere, plus one per other body with a degree of freedom. Walls, blades and
/// mixers without a sphere are left to the surfaces.
///
/// Arrays: `id` (the body's number for its first point, then numbers from the count of numbers on), `body`
/// (number: the index in the scene, for bodies that entered later the next ones; see [`BodyNumbers`]),
/// `geometry` (index of its form, only while bodies enter and leave), `type` (material), `shapetype`,
/// `radius` (m), `mass` (kg, of the body), `v` (m/s, of the point), `omega` (rad/s), `quat` (x y z w), `f`
/// (N) and `tq` (N m), the net contact force and torque on the body averaged over the step of length `step`,
/// and `contacts`, its number of loaded contacts.
///
/// Where a free body is no sphere there are also `tensor` (rotation matrix from the axes of the shape to
/// those of the world, column by column) and `shapex`, `shapey`, `shapez` (m, half-axes of an ellipsoid
/// inside the shape): these are what OVITO's reader makes orientations and shapes of. It then sets its own
/// radii to zero, which is why samples of spheres between plates go without.
pub fn particles(world: &World, numbers: &BodyNumbers, step: f64) -> PolyData {
    let bodies = &world.bodies;
    let templates = |free: bool| -> Vec<Vec<Template>> {
        world.geometries.iter().map(|geometry| points_of(geometry, free)).collect()
    };
    let (held, free) = (templates(false), templates(true));
    let mut points = Vec::with_capacity(bodies.len());
    for body in 0..bodies.len() {
        let can_move = !world.is_prescribed(body);
        let geometry = bodies.geometry[body].index();
        for template in if can_move { &free[geometry] } else { &held[geometry] } {
            let &Template { radius, kind, half_axes, .. } = template;
            let position = bodies.position[body] + bodies.orientation[body] * template.position;
            let orientation = bodies.orientation[body] * template.orientation;
            points.push(Point { body, position, radius, kind, half_axes, orientation });
        }
    }
    let number = |body: usize| numbers.number(body) as i64;
    let mut next_id = numbers.given(bodies.len()) as i64;
    let mut previous_body = usize::MAX;
    let id = points
        .iter()
        .map(|point| {
            if point.body != previous_body {
                previous_body = point.body;
                return number(point.body);
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
    let mut point_data = vec![
        DataArray::int64("id", id),
        DataArray::int32(
            "type",
            points.iter().map(|point| bodies.material[point.body].index() as i32).collect(),
        ),
        DataArray::int32("shapetype", points.iter().map(|point| point.kind).collect()),
        DataArray::scalar("radius", points.iter().map(|point| point.radius).collect()),
        DataArray::scalar("mass", points.iter().map(|point| bodies.mass[point.body]).collect()),
        DataArray::vector("v", velocity),
        DataArray::vector("omega", of_bodies(&bodies.angular_velocity)),
        DataArray { name: "quat", components: 4, values: Values::Real(quaternion) },
        DataArray::vector("f", of_bodies(&loads.force)),
        DataArray::vector("tq", of_bodies(&loads.torque)),
        DataArray::int32("contacts", points.iter().map(|point| loads.contacts[point.body]).collect()),
        DataArray::int64("body", points.iter().map(|point| number(point.body)).collect()),
    ];
    if numbers.has_changed() {
        let geometry = points.iter().map(|point| bodies.geometry[point.body].index() as i64);
        point_data.push(DataArray::int64("geometry", geometry.collect()));
    }
    if points.iter().any(|point| point.kind != SPHERE && world.is_free(point.body)) {
        let turned = |point: &Point| Mat3::from_quat(point.orientation).to_cols_array();
        let tensor = Values::Real(points.iter().flat_map(turned).collect());
        point_data.push(DataArray { name: "tensor", components: 9, values: tensor });
        for (axis, name) in ["shapex", "shapey", "shapez"].into_iter().enumerate() {
            let half_axes = points.iter().map(|point| point.half_axes[axis]).collect();
            point_data.push(DataArray::scalar(name, half_axes));
        }
    }
    PolyData {
        points: points.iter().map(|point| point.position).collect(),
        cells: Cells::verts(points.len()),
        point_data,
        cell_data: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use graintrain::handle::MaterialId;
    use graintrain::material::Materials;
    use graintrain::shape::Capsule;
    use graintrain::shape::Part;
    use graintrain::world::Body;

    fn world(geometry: Geometry, orientation: Quat) -> World {
        let materials = Materials::single("glass", 2500.0, 0.3, 0.0).unwrap();
        let mut world = World::new(Vec3::ZERO, materials).unwrap();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::ZERO)).unwrap();
        let geometry = world.add_geometry(geometry);
        world.add_body(Body { orientation, ..Body::new(geometry, MaterialId::default(), Vec3::X) }).unwrap();
        world
    }

    fn real<'a>(data: &'a PolyData, name: &str) -> Option<&'a [f64]> {
        let array = data.point_data.iter().find(|array| array.name == name)?;
        match &array.values {
            Values::Real(values) => Some(values),
            _ => None,
        }
    }

    /// A capsule whose shape lies along x of a body that is turned by a quarter about z points along y.
    #[test]
    fn tensors_turn_shapes_to_where_they_are() {
        let along_x = Part {
            shape: Shape::Capsule(Capsule { half_length: 0.3, radius: 0.1 }),
            position: Vec3::ZERO,
            orientation: Quat::from_rotation_y(std::f64::consts::FRAC_PI_2),
        };
        let (geometry, centre) = Geometry::compound(vec![along_x]).unwrap();
        assert!(centre.length() < 1e-12);
        let quarter = Quat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let data = particles(&world(geometry, quarter), &BodyNumbers::default(), 0.01);
        let tensor = real(&data, "tensor").unwrap();
        // The third column is where the capsule's own axis, z, points to.
        let axis = Vec3::from_slice(&tensor[15..18]);
        assert!(axis.cross(Vec3::Y).length() < 1e-12, "{axis}");
        let half: Vec<f64> = ["shapex", "shapey", "shapez"].map(|name| real(&data, name).unwrap()[1]).into();
        assert_eq!(half, [0.1, 0.1, 0.4]);
        assert_eq!(real(&data, "shapez").unwrap()[0], 0.1);
        assert_eq!(real(&data, "radius").unwrap(), [0.1, 0.1]);
    }

    #[test]
    fn frames_of_spheres_are_spared_shapes() {
        let data =
            particles(&world(Geometry::sphere(0.2).unwrap(), Quat::IDENTITY), &BodyNumbers::default(), 0.01);
        assert!(real(&data, "tensor").is_none() && real(&data, "shapex").is_none());
    }
}
