//! Frames of the bodies that are not spheres, as triangles: walls, blades, mixers, boxes.

use super::vtp::{CellKind, Cells, DataArray, PolyData};
use crate::body_numbers::BodyNumbers;
use crate::stage::Stage;
use graintrain::math::{Quat, Vec3};
use graintrain::shape::{HalfSpace, Shape, Sphere, Surface};
use graintrain::world::{FREE, World};

/// Which bodies a frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Show {
    /// Bodies that never move in the whole run ([`never_moves`]); planes are not among them, since the patch
    /// that stands for one follows the scene.
    Fixed,
    /// All others.
    Moving,
}

/// Which bodies never move: their motion is rest, and no stage gives them another one. The answer is the same
/// in every step of a run.
pub fn never_moves(world: &World, stages: &[Stage]) -> Vec<bool> {
    let mut never: Vec<bool> =
        (0..world.bodies.len()).map(|body| world.is_prescribed(body) && is_at_rest(world, body)).collect();
    for (body, _) in stages.iter().flat_map(|stage| &stage.motions) {
        if let Some(never) = never.get_mut(body.index()) {
            *never = false;
        }
    }
    never
}

/// Collects the triangles of a frame.
struct Builder<'a> {
    world: &'a World,
    points: Vec<Vec3>,
    cells: Cells,
    body: Vec<i64>,
}

impl Builder<'_> {
    fn add(&mut self, body: usize, position: Vec3, orientation: Quat, surface: &Surface) {
        let first = self.points.len() as i64;
        self.points.extend(surface.vertices.iter().map(|&vertex| position + orientation * vertex));
        for triangle in &surface.triangles {
            self.cells.push(triangle.map(|corner| first + i64::from(corner)));
            self.body.push(body as i64);
        }
    }

    fn finish(self, numbers: &BodyNumbers) -> PolyData {
        let bodies = &self.world.bodies;
        let body = |k: &i64| *k as usize;
        let point_body = {
            let mut owner = vec![0_usize; self.points.len()];
            for (triangle, &body) in self.cells.connectivity.chunks_exact(3).zip(&self.body) {
                for &point in triangle {
                    owner[point as usize] = body as usize;
                }
            }
            owner
        };
        let velocity = self.points.iter().zip(&point_body).map(|(&point, &body)| {
            bodies.velocity[body] + bodies.angular_velocity[body].cross(point - bodies.position[body])
        });
        let point_data = vec![DataArray::vector("v", velocity.collect::<Vec<_>>())];
        let material = self.body.iter().map(|k| bodies.material[body(k)].index() as i32).collect();
        let number = self.body.iter().map(|k| numbers.number(body(k)) as i64).collect();
        let cell_data = vec![DataArray::int32("type", material), DataArray::int64("body_id", number)];
        PolyData { points: self.points, cells: self.cells, point_data, cell_data }
    }
}

/// The frame: the surfaces of all shapes but spheres. A plane is drawn as a square patch that reaches below
/// all bodies.
///
/// Cell arrays: `body_id` (number, as in the frames of bodies), `type` (material). Point array: `v` (m/s).
pub fn surfaces(world: &World, numbers: &BodyNumbers, stages: &[Stage], show: Show) -> PolyData {
    let mut builder =
        Builder { world, points: Vec::new(), cells: Cells::new(CellKind::Polys), body: Vec::new() };
    let templates: Vec<Vec<Option<Surface>>> = world
        .geometries
        .iter()
        .map(|geometry| geometry.parts.iter().map(|part| part.shape.surface()).collect())
        .collect();
    let is_fixed = never_moves(world, stages);
    let bounds = bounds(world, &templates).unwrap_or((-Vec3::ONE, Vec3::ONE));
    for body in 0..world.bodies.len() {
        let geometry = world.bodies.geometry[body].index();
        let (position, orientation) = (world.bodies.position[body], world.bodies.orientation[body]);
        for (part, template) in world.geometries[geometry].parts.iter().zip(&templates[geometry]) {
            let place = position + orientation * part.position;
            let turn = orientation * part.orientation;
            match template {
                Some(surface) if (show == Show::Fixed) == is_fixed[body] => {
                    builder.add(body, place, turn, surface);
                }
                None if part.shape == Shape::Plane(HalfSpace) && show == Show::Moving => {
                    builder.add(body, place, turn, &patch(place, turn, bounds));
                }
                _ => {}
            }
        }
    }
    builder.finish(numbers)
}

/// Whether the prescribed motion of the body is rest at all times.
fn is_at_rest(world: &World, body: usize) -> bool {
    match world.bodies.motion[body] {
        FREE => false,
        motion => {
            let motion = &world.motions[motion.index()];
            motion.translation.is_empty() && motion.rotation.is_none()
        }
    }
}

/// Box around all spheres and bounded surfaces; `None` where there are none.
fn bounds(world: &World, templates: &[Vec<Option<Surface>>]) -> Option<(Vec3, Vec3)> {
    let mut bounds = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut include = |point: Vec3, reach: f64| {
        bounds = (bounds.0.min(point - reach), bounds.1.max(point + reach));
    };
    for body in 0..world.bodies.len() {
        let geometry = world.bodies.geometry[body].index();
        let (position, orientation) = (world.bodies.position[body], world.bodies.orientation[body]);
        for (part, template) in world.geometries[geometry].parts.iter().zip(&templates[geometry]) {
            let place = position + orientation * part.position;
            let turn = orientation * part.orientation;
            match (&part.shape, template) {
                (Shape::Sphere(Sphere { radius }), _) => include(place, *radius),
                (_, Some(surface)) => {
                    surface.vertices.iter().for_each(|&vertex| include(place + turn * vertex, 0.0));
                }
                _ => {}
            }
        }
    }
    (bounds.0.is_finite() && bounds.1.is_finite()).then_some(bounds)
}

/// The part of the plane z = 0 of the given frame that lies below the box.
fn patch(position: Vec3, orientation: Quat, (low, high): (Vec3, Vec3)) -> Surface {
    let inverse = orientation.conjugate();
    let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for k in 0..8_u32 {
        let pick = |bit: u32, low: f64, high: f64| if k >> bit & 1 == 1 { high } else { low };
        let corner = Vec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z));
        let local = inverse * (corner - position);
        (least, most) = (least.min(local), most.max(local));
    }
    let at = |x: f64, y: f64| Vec3::new(x, y, 0.0);
    Surface {
        vertices: vec![at(least.x, least.y), at(most.x, least.y), at(most.x, most.y), at(least.x, most.y)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_drawn_below_all_bodies() {
        let tilt = Quat::from_rotation_y(0.7);
        let place = Vec3::new(0.0, 0.0, -1.0);
        let (low, high) = (Vec3::new(-1.0, -2.0, 0.0), Vec3::new(3.0, 4.0, 5.0));
        let patch = patch(place, tilt, (low, high));
        assert!(patch.vertices.iter().all(|vertex| vertex.z == 0.0));
        let centre = tilt.conjugate() * (0.5 * (low + high) - place);
        assert!(patch.vertices[0].x < centre.x && centre.x < patch.vertices[2].x);
        assert!(patch.vertices[0].y <= -2.0 && patch.vertices[2].y >= 4.0);
    }
}
