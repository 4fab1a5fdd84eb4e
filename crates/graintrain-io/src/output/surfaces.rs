//! Frames of the bodies that are not spheres, as triangles: walls, blades, mixers, boxes.

use super::vtp::{CellKind, Cells, DataArray, PolyData};
use crate::body_numbers::BodyNumbers;
use crate::stage::Stage;
use graintrain::math::{Quat, Vec3};
use graintrain::shape::Shape;
use graintrain::world::{FREE, World};
use graintrain_linalg::real;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Segments of a full circle in cylinders and capsules.
const SEGMENTS: u32 = 24;
/// Segments from the pole to the equator of a capsule's caps.
const CAP_SEGMENTS: u32 = 6;

/// A surface of triangles, in m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// Corner points.
    pub vertices: Vec<Vec3>,
    /// Three indices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Triangles {
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    fn box_surface(half: Vec3) -> Self {
        let corner = |k: u32| {
            let sign = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
            half * Vec3::new(sign(0), sign(1), sign(2))
        };
        let mut surface = Self { vertices: (0..8).map(corner).collect(), triangles: Vec::new() };
        for face in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
            surface.quad(face);
        }
        surface
    }

    /// Surface of revolution about z of the profile (distance from the axis, height), given from bottom to
    /// top; both ends lie on the axis.
    fn revolution(profile: &[(f64, f64)]) -> Self {
        let rings = &profile[1..profile.len() - 1];
        let mut surface = Self::default();
        surface.vertices.push(Vec3::new(0.0, 0.0, profile[0].1));
        for &(distance, height) in rings {
            surface.vertices.extend((0..SEGMENTS).map(|k| {
                let (sin, cos) = real::sin_cos(TAU * f64::from(k) / f64::from(SEGMENTS));
                Vec3::new(distance * cos, distance * sin, height)
            }));
        }
        surface.vertices.push(Vec3::new(0.0, 0.0, profile[profile.len() - 1].1));
        let top = surface.vertices.len() as u32 - 1;
        let index = |ring: u32, k: u32| 1 + ring * SEGMENTS + k % SEGMENTS;
        let last = rings.len() as u32 - 1;
        for k in 0..SEGMENTS {
            surface.triangles.push([0, index(0, k + 1), index(0, k)]);
            for ring in 0..last {
                surface.quad([
                    index(ring, k),
                    index(ring, k + 1),
                    index(ring + 1, k + 1),
                    index(ring + 1, k),
                ]);
            }
            surface.triangles.push([top, index(last, k), index(last, k + 1)]);
        }
        surface
    }

    fn capsule(half_length: f64, radius: f64) -> Self {
        let cap = |k: u32| {
            let (sin, cos) = real::sin_cos(FRAC_PI_2 * f64::from(k) / f64::from(CAP_SEGMENTS));
            (radius * sin, half_length + radius * cos)
        };
        let mut profile: Vec<(f64, f64)> =
            (0..=CAP_SEGMENTS).map(cap).map(|(distance, height)| (distance, -height)).collect();
        profile.extend((0..=CAP_SEGMENTS).rev().map(cap));
        Self::revolution(&profile)
    }

    fn cylinder(half_length: f64, radius: f64) -> Self {
        Self::revolution(&[
            (0.0, -half_length),
            (radius, -half_length),
            (radius, half_length),
            (0.0, half_length),
        ])
    }
}

/// The surface of a shape in its own frame; `None` for spheres (drawn as points) and planes (unbounded).
pub fn surface(shape: &Shape) -> Option<Triangles> {
    match shape {
        Shape::Sphere { .. } | Shape::Plane => None,
        Shape::Box { half } => Some(Triangles::box_surface(*half)),
        Shape::Capsule { half_length, radius } => Some(Triangles::capsule(*half_length, *radius)),
        Shape::Cylinder { half_length, radius } => Some(Triangles::cylinder(*half_length, *radius)),
        Shape::Hull(hull) => {
            Some(Triangles { vertices: hull.corners().to_vec(), triangles: hull.triangles() })
        }
        Shape::Mesh { vertices, triangles, .. } => {
            Some(Triangles { vertices: vertices.clone(), triangles: triangles.clone() })
        }
    }
}

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
    fn add(&mut self, body: usize, position: Vec3, orientation: Quat, surface: &Triangles) {
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
    let templates: Vec<Vec<Option<Triangles>>> = world
        .geometries
        .iter()
        .map(|geometry| geometry.parts.iter().map(|part| surface(&part.shape)).collect())
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
                None if part.shape == Shape::Plane && show == Show::Moving => {
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
fn bounds(world: &World, templates: &[Vec<Option<Triangles>>]) -> Option<(Vec3, Vec3)> {
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
                (Shape::Sphere { radius }, _) => include(place, *radius),
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
fn patch(position: Vec3, orientation: Quat, (low, high): (Vec3, Vec3)) -> Triangles {
    let inverse = orientation.conjugate();
    let (mut least, mut most) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for k in 0..8_u32 {
        let pick = |bit: u32, low: f64, high: f64| if k >> bit & 1 == 1 { high } else { low };
        let corner = Vec3::new(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z));
        let local = inverse * (corner - position);
        (least, most) = (least.min(local), most.max(local));
    }
    let at = |x: f64, y: f64| Vec3::new(x, y, 0.0);
    Triangles {
        vertices: vec![at(least.x, least.y), at(most.x, least.y), at(most.x, most.y), at(least.x, most.y)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Volume enclosed by a closed, outward oriented surface: sum of a . (b x c) / 6.
    fn volume(surface: &Triangles) -> f64 {
        let at = |k: u32| surface.vertices[k as usize];
        surface.triangles.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
    }

    /// Every edge of a closed surface is run through once in each direction.
    fn is_closed(surface: &Triangles) -> bool {
        let mut edges: Vec<(u32, u32)> =
            surface.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        let mut reversed: Vec<(u32, u32)> = edges.iter().map(|&(a, b)| (b, a)).collect();
        edges.sort_unstable();
        reversed.sort_unstable();
        edges == reversed
    }

    #[test]
    fn surfaces_are_closed_and_enclose_the_volume_of_the_shape() {
        let half = Vec3::new(0.1, 0.2, 0.3);
        let surface = Triangles::box_surface(half);
        assert!(is_closed(&surface));
        assert!((volume(&surface) - 8.0 * 0.1 * 0.2 * 0.3).abs() < 1e-15);
        // A regular polygon of n corners has the area n/2 sin(2 pi/n) of its circle.
        let polygon = f64::from(SEGMENTS) / 2.0 * (TAU / f64::from(SEGMENTS)).sin();
        let surface = Triangles::cylinder(0.5, 0.2);
        assert!(is_closed(&surface));
        assert!((volume(&surface) - polygon * 0.04 * 1.0).abs() < 1e-12);
        let surface = Triangles::capsule(0.5, 0.2);
        assert!(is_closed(&surface));
        let exact = PI * 0.04 * 1.0 + 4.0 / 3.0 * PI * 0.008;
        assert!((volume(&surface) / exact - 1.0).abs() < 0.02 && volume(&surface) < exact);
    }

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
