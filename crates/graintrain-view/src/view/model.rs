//! What a replay shows of a world: which bodies are balls, which share a surface, and the world's frames.

use super::pack::Frame;
use crate::render::camera::Bounds;
use crate::render::subject::{bounds, contact_force, grains, stands_around, towards_grains};
use graintrain::contact::Contact;
use graintrain::math::Vec3;
use graintrain::shape::{Capsule, HalfSpace, Part, Shape, Sphere, Surface};
use graintrain::world::World;

/// Of so many positions of grains the camera takes its view; of more it takes every second, third, ...
const MOST_FITTED: usize = 200_000;

/// The fields of a frame: name, label with unit.
pub const FIELDS: [(&str, &str); 4] = [
    ("speed", "speed (m/s)"),
    ("spin", "angular speed (rad/s)"),
    ("force", "largest contact force (N)"),
    ("contacts", "contacts with force (1)"),
];

/// Grains that are single balls.
#[derive(Debug, Default)]
pub struct Balls {
    /// Which bodies.
    pub body: Vec<usize>,
    /// m, in the world that the model is made of.
    pub radius: Vec<f64>,
}

/// Bodies that share a surface.
#[derive(Debug)]
pub struct Group {
    /// `grain`, `tool`, or `wall` (seen from the side of the grains only).
    pub kind: &'static str,
    /// Corners of the triangles in the bodies' frame, nine numbers each.
    pub triangles: Vec<f32>,
    /// Which bodies.
    pub bodies: Vec<usize>,
}

/// What does not change from frame to frame.
#[derive(Debug)]
pub struct Model {
    /// Number of bodies.
    pub count: usize,
    /// Bodies that are free to move.
    pub grains: Vec<usize>,
    /// Whether a body is one of them.
    pub is_grain: Vec<bool>,
    /// Materials, as indices.
    pub material: Vec<u16>,
    /// Radius of the smallest grain, m.
    pub grain_radius: f64,
    /// Bodies whose orientation is seen.
    pub oriented: Vec<usize>,
    /// Grains that are balls.
    pub balls: Balls,
    /// All else, by surface.
    pub groups: Vec<Group>,
    bounds: Bounds,
    /// Around all that is neither grain nor wall, where it is no larger than the scene.
    tools: Bounds,
    /// Radius of the smallest ball around each body, m.
    reach: Vec<f64>,
}

impl Model {
    /// What there is to be seen of a world.
    pub fn new(world: &World) -> Self {
        let count = world.bodies.len();
        let grains = grains(world);
        let mut is_grain = vec![false; count];
        grains.iter().for_each(|&body| is_grain[body] = true);
        let bounds = bounds(world, &grains);
        let centers: Vec<Vec3> = grains.iter().map(|&body| world.bodies.position[body]).collect();
        let mut tools = Bounds::EMPTY;
        let mut balls = Balls::default();
        let mut groups: Vec<Group> = Vec::new();
        // Group of each geometry that grains share, once there is one.
        let mut shared: Vec<Option<usize>> = vec![None; world.geometries.len()];
        for body in 0..count {
            let index = world.bodies.geometry[body].index();
            let parts = &world.geometries[index].parts;
            match parts.as_slice() {
                [Part { shape: Shape::Sphere(Sphere { radius }), position, .. }]
                    if is_grain[body] && *position == Vec3::ZERO =>
                {
                    balls.body.push(body);
                    balls.radius.push(*radius);
                }
                _ if is_grain[body] => match shared[index] {
                    Some(group) => groups[group].bodies.push(body),
                    None => {
                        let triangles = parts.iter().flat_map(|part| corners(part, None)).collect();
                        shared[index] = Some(groups.len());
                        groups.push(Group { kind: "grain", triangles, bodies: vec![body] });
                    }
                },
                _ => {
                    let may_be_wall = stands_around(world, body, &centers);
                    let (at, radius) = (world.bodies.position[body], reach(world, body));
                    if !may_be_wall && 2.0 * radius < (bounds.high - bounds.low).length() {
                        tools = tools.with(at, radius);
                    }
                    for part in parts {
                        let triangles = corners(part, Some((world, body, &bounds)));
                        let [walls, tools] = match part.shape {
                            Shape::Plane(HalfSpace) => [triangles, Vec::new()],
                            _ if may_be_wall => match sides(world, body, &triangles, &centers) {
                                // The rim of a plate that stands before the grains hides them and tells
                                // nothing.
                                [walls, _] if matches!(part.shape, Shape::Box(_)) && !walls.is_empty() => {
                                    [walls, Vec::new()]
                                }
                                sorted => sorted,
                            },
                            _ => [Vec::new(), triangles],
                        };
                        for (kind, triangles) in [("wall", walls), ("tool", tools)] {
                            match groups.iter_mut().find(|group| group.kind == kind && group.bodies == [body])
                            {
                                _ if triangles.is_empty() => {}
                                Some(group) => group.triangles.extend(triangles),
                                None => groups.push(Group { kind, triangles, bodies: vec![body] }),
                            }
                        }
                    }
                }
            }
        }
        let mut oriented: Vec<usize> = groups.iter().flat_map(|group| group.bodies.iter().copied()).collect();
        oriented.sort_unstable();
        oriented.dedup();
        let smallest = grains.iter().map(|&body| reach(world, body));
        let grain_radius = smallest.fold(f64::INFINITY, f64::min);
        let grain_radius = if grain_radius.is_finite() { grain_radius } else { 1.0 };
        let reach = (0..count).map(|body| reach(world, body)).collect();
        let material = world.bodies.material.iter().map(|material| material.index() as u16).collect();
        Self {
            count,
            material,
            grains,
            is_grain,
            grain_radius,
            oriented,
            balls,
            groups,
            bounds,
            tools,
            reach,
        }
    }

    /// The box that the camera looks at: around the grains of all frames, but for a hundredth of them on each
    /// side, and the tools. Walls may reach far beyond.
    pub fn fitted(&self, frames: &[Frame], absent: &[Vec<[usize; 2]>]) -> Bounds {
        let stride = (frames.len() * self.grains.len()).div_ceil(MOST_FITTED).max(1);
        let all = frames.iter().zip(absent).flat_map(|(frame, absent)| {
            let is_there = |body: &usize| !absent.iter().any(|[first, end]| (*first..*end).contains(body));
            self.grains.iter().copied().filter(is_there).map(|body| frame.position[body])
        });
        let points: Vec<[f32; 3]> = all.step_by(stride).collect();
        let Some(outliers) = points.len().checked_sub(1).map(|last| last / 100) else { return self.bounds };
        let ends = [0, 1, 2].map(|axis| {
            let mut along: Vec<f32> = points.iter().map(|point| point[axis]).collect();
            along.sort_unstable_by(f32::total_cmp);
            [along[outliers], along[along.len() - 1 - outliers]].map(f64::from)
        });
        let [low, high] = [0, 1].map(|end| Vec3::from_array(ends.map(|ends| ends[end])));
        let grains = Bounds::EMPTY.with(low, self.grain_radius).with(high, self.grain_radius);
        Bounds { low: grains.low.min(self.tools.low), high: grains.high.max(self.tools.high) }
    }

    /// Size of a body relative to the first frame.
    fn size(&self, world: &World, body: usize) -> f32 {
        let size = reach(world, body) / self.reach[body];
        if size.is_finite() { size as f32 } else { 1.0 }
    }

    /// The world as a frame, with time steps of `step` s, and with its loaded contacts where `chains`.
    pub fn frame(&self, world: &World, step: f64, chains: bool) -> Frame {
        let bodies = &world.bodies;
        let single = |v: Vec3| v.as_vec3().to_array();
        let loaded = || {
            let normal =
                |(contact, impulse): (&Contact, &Vec3)| (*contact, impulse.dot(contact.normal) / step);
            world.contacts.contacts.iter().zip(&world.contacts.impulse).map(normal).filter(|c| c.1 > 0.0)
        };
        let mut count = vec![0.0_f32; self.count];
        for (contact, _) in loaded() {
            count[contact.body_a as usize] += 1.0;
            count[contact.body_b as usize] += 1.0;
        }
        let lengths = |vectors: &[Vec3]| vectors.iter().map(|v| v.length() as f32).collect::<Vec<f32>>();
        let force = contact_force(world, step).into_iter().map(|force| force as f32).collect();
        Frame {
            time: world.time,
            position: bodies.position.iter().map(|&position| single(position)).collect(),
            orientation: self
                .oriented
                .iter()
                .map(|&body| bodies.orientation[body].to_array().map(|q| q as f32))
                .collect(),
            fields: vec![lengths(&bodies.velocity), lengths(&bodies.angular_velocity), force, count],
            size: (0..self.count).map(|body| self.size(world, body)).collect(),
            contacts: loaded()
                .filter(|_| chains)
                .map(|(c, force)| (c.body_a, c.body_b, single(c.point), force as f32))
                .collect(),
        }
    }
}

/// Triangles of a body (nine numbers each, in its frame): those with the grains on one side, with their
/// fronts towards them, and the others.
fn sides(world: &World, body: usize, triangles: &[f32], grains: &[Vec3]) -> [Vec<f32>; 2] {
    let (position, turn) = (world.bodies.position[body], world.bodies.orientation[body]);
    let mut sorted = [Vec::new(), Vec::new()];
    for own in triangles.as_chunks::<9>().0 {
        let corner = |k: usize| Vec3::new(own[3 * k].into(), own[3 * k + 1].into(), own[3 * k + 2].into());
        let placed = [0, 1, 2].map(|k| position + turn * corner(k));
        match towards_grains(placed, grains) {
            Some(seen) => sorted[0].extend(
                seen.map(|at| (turn.conjugate() * (at - position)).as_vec3().to_array()).as_flattened(),
            ),
            None => sorted[1].extend(own),
        }
    }
    sorted
}

/// Radius of the smallest ball about a body's centre that holds it, m.
fn reach(world: &World, body: usize) -> f64 {
    world.geometries[world.bodies.geometry[body].index()].bounding_radius()
}

/// Corners of a part's triangles in its body's frame. A plane is cut at the scene's bounds; without a scene
/// it has none.
fn corners(part: &Part, scene: Option<(&World, usize, &Bounds)>) -> Vec<f32> {
    let triangles = match (&part.shape, scene) {
        // A capsule of no length is a ball.
        (Shape::Sphere(Sphere { radius }), _) => {
            Shape::Capsule(Capsule { half_length: 0.0, radius: *radius }).surface()
        }
        (Shape::Plane(HalfSpace), Some((world, body, bounds))) => {
            let turn = world.bodies.orientation[body] * part.orientation;
            let origin = world.bodies.position[body] + world.bodies.orientation[body] * part.position;
            let reach = bounds
                .corners()
                .into_iter()
                .map(|corner| turn.conjugate() * (corner - origin))
                .fold(Bounds::EMPTY, |reach, corner| reach.with(corner, 0.0));
            let at = |x: f64, y: f64| Vec3::new(x, y, 0.0);
            let (low, high) = (reach.low, reach.high);
            let vertices = vec![at(low.x, low.y), at(high.x, low.y), at(high.x, high.y), at(low.x, high.y)];
            (!bounds.is_empty()).then(|| Surface { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] })
        }
        (shape, _) => shape.surface(),
    };
    let Some(triangles) = triangles else { return Vec::new() };
    let place = |&corner: &u32| {
        let point = part.position + part.orientation * triangles.vertices[corner as usize];
        point.as_vec3().to_array()
    };
    triangles.triangles.iter().flatten().flat_map(place).collect()
}
