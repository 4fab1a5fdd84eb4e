//! The replay's page: what is drawn, in which colours, and the HTML around it.

use super::pack::{Frame, Ranges, pack};
use super::tables::{Plot, plots};
use super::{RunFolder, ViewError};
use crate::plot::svg::escape;
use crate::render::camera::Bounds;
use crate::render::subject::{bounds, contact_force, grains, stands_around, towards_grains};
use graintrain::math::Vec3;
use graintrain::shape::{Part, Shape};
use graintrain::world::World;
use graintrain_io::output::surfaces::{Triangles, surface};
use rayon::prelude::*;
use serde::Serialize;

const TEMPLATE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");

/// Contacts below this part of the largest usual force are not embedded: their tubes would be thinner than a line.
const WEAKEST_CHAIN: f64 = 0.027;

/// Of so many positions of grains the camera takes its view; of more it takes every second, third, ...
const MOST_FITTED: usize = 200_000;

/// How a replay is made.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewSettings {
    /// Most frames in the page; more are thinned evenly.
    pub max_frames: usize,
    /// Whether contact forces are embedded.
    pub force_chains: bool,
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self { max_frames: 240, force_chains: true }
    }
}

/// What the page's script knows besides the frames.
#[derive(Serialize)]
struct Header {
    facts: String,
    bodies: usize,
    oriented: Vec<usize>,
    low: [f32; 3],
    high: [f32; 3],
    speed_max: f32,
    force_max: f32,
    chain_shown: f32,
    size_max: f32,
    radius_max: f64,
    grain_radius: f64,
    up: [f64; 3],
    center: [f64; 3],
    half: [f64; 3],
    radius: f64,
    grain: Vec<u8>,
    balls: Balls,
    groups: Vec<Group>,
    frames: Vec<FrameHeader>,
    plots: Vec<Plot>,
}

/// Grains that are single balls.
#[derive(Default, Serialize)]
struct Balls {
    body: Vec<usize>,
    radius: Vec<f64>,
}

/// Bodies that share a surface.
#[derive(Serialize)]
struct Group {
    /// `grain`, `tool`, or `wall` (seen from the side of the grains only).
    kind: &'static str,
    /// Corners of the triangles in the bodies' frame, nine numbers each.
    triangles: Vec<f32>,
    bodies: Vec<usize>,
}

#[derive(Serialize)]
struct FrameHeader {
    time: f64,
    contacts: usize,
    /// Bodies that are not there: ranges of indices.
    absent: Vec<[usize; 2]>,
}

/// The bodies that are not there as ranges of indices.
fn absent(present: &[bool]) -> Vec<[usize; 2]> {
    let mut first = 0;
    let mut ranges = Vec::new();
    for run in present.chunk_by(|a, b| a == b) {
        if !run[0] {
            ranges.push([first, first + run.len()]);
        }
        first += run.len();
    }
    ranges
}

/// The replay of a run's folder as one HTML page.
///
/// # Errors
/// [`ViewError`] for a folder without checkpoint or frames, or with damaged ones.
pub fn page(run: &RunFolder, settings: &ViewSettings) -> Result<String, ViewError> {
    let times = run.times();
    if times.is_empty() {
        return Err(ViewError::NoFrames { folder: run.path().to_path_buf() });
    }
    let stride = times.len().div_ceil(settings.max_frames.max(1));
    // The last frame is always shown.
    let mut shown: Vec<usize> = (0..times.len()).rev().step_by(stride).collect();
    shown.reverse();
    let (first, _) = run.world_of_all(shown[0])?;
    let model = Model::new(&first);
    let made = shown
        .par_iter()
        .map(|&index| {
            let (world, present) = run.world_of_all(index)?;
            Ok((model.frame(&world, run.step, settings.force_chains), absent(&present)))
        })
        .collect::<Result<Vec<_>, ViewError>>()?;
    let (mut frames, absent): (Vec<Frame>, Vec<Vec<[usize; 2]>>) = made.into_iter().unzip();
    let chain_shown = usual_largest(frames.iter().flat_map(|frame| frame.contacts.iter().map(|c| c.3)));
    for frame in &mut frames {
        frame.contacts.retain(|contact| f64::from(contact.3) >= WEAKEST_CHAIN * f64::from(chain_shown));
    }
    if frames.iter().all(|frame| frame.size.iter().all(|size| (size - 1.0).abs() < 1e-5)) {
        frames.iter_mut().for_each(|frame| frame.size.clear());
    }
    let ranges = Ranges::of(&frames);
    let data = pack(&frames, &ranges)?;
    let scene = model.fitted(&frames, &absent);
    let duration = times[times.len() - 1];
    let header = Header {
        facts: format!("{} bodies, {} frames, {duration:.3} s", model.count, frames.len()),
        bodies: model.count,
        low: ranges.low,
        high: ranges.high,
        speed_max: ranges.speed,
        force_max: ranges.force,
        chain_shown,
        size_max: ranges.size,
        radius_max: frames.iter().map(|frame| model.largest_ball(frame)).fold(0.0, f64::max),
        grain_radius: model.grain_radius,
        up: (-first.gravity).normalize_or(Vec3::Z).to_array(),
        center: scene.center().to_array(),
        half: (0.5 * (scene.high - scene.low)).to_array(),
        radius: 0.5 * (scene.high - scene.low).length(),
        frames: frames
            .iter()
            .zip(absent)
            .map(|(f, absent)| FrameHeader { time: f.time, contacts: f.contacts.len(), absent })
            .collect(),
        plots: plots(run.path())?,
        oriented: model.oriented,
        grain: model.is_grain.iter().map(|&grain| u8::from(grain)).collect(),
        balls: model.balls,
        groups: model.groups,
    };
    // A closing tag inside the data would end the element.
    let header = serde_json::to_string(&header).map_err(std::io::Error::from)?.replace('<', "\\u003c");
    Ok(TEMPLATE
        .replace("{{title}}", &escape(&run.scene))
        .replace("{{script}}", SCRIPT)
        .replace("{{header}}", &header)
        .replace("{{data}}", &data))
}

/// The largest of some values, or their 99.5th percentile where few values are far larger; at least a tiny positive number.
fn usual_largest(values: impl Iterator<Item = f32>) -> f32 {
    let mut sorted: Vec<f32> = values.filter(|value| *value > 0.0 && value.is_finite()).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let largest = sorted.last().copied().unwrap_or(1.0);
    let usual = sorted.get(sorted.len() * 995 / 1000).copied().unwrap_or(largest);
    if largest > 1.5 * usual { usual } else { largest }
}

/// What does not change from frame to frame.
struct Model {
    count: usize,
    grains: Vec<usize>,
    is_grain: Vec<bool>,
    grain_radius: f64,
    oriented: Vec<usize>,
    balls: Balls,
    groups: Vec<Group>,
    bounds: Bounds,
    /// Around all that is neither grain nor wall, where it is no larger than the scene.
    tools: Bounds,
    /// Radius of the smallest ball around each body, m.
    reach: Vec<f64>,
}

impl Model {
    fn new(world: &World) -> Self {
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
                [Part { shape: Shape::Sphere { radius }, position, .. }]
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
                            Shape::Plane => [triangles, Vec::new()],
                            _ if may_be_wall => sides(world, body, &triangles, &centers),
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
        Self { count, grains, is_grain, grain_radius, oriented, balls, groups, bounds, tools, reach }
    }

    /// The box that the camera looks at: around the grains of all frames, but for a hundredth of them on each side, and the tools. Walls
    /// may reach far beyond.
    fn fitted(&self, frames: &[Frame], absent: &[Vec<[usize; 2]>]) -> Bounds {
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

    /// Radius of the largest ball of a frame, m.
    fn largest_ball(&self, frame: &Frame) -> f64 {
        let size = |body: usize| frame.size.get(body).map_or(1.0, |size| f64::from(*size));
        self.balls
            .body
            .iter()
            .zip(&self.balls.radius)
            .map(|(body, radius)| radius * size(*body))
            .fold(0.0, f64::max)
    }

    /// Size of a body relative to the first frame.
    fn size(&self, world: &World, body: usize) -> f32 {
        let size = reach(world, body) / self.reach[body];
        if size.is_finite() { size as f32 } else { 1.0 }
    }

    fn frame(&self, world: &World, step: f64, chains: bool) -> Frame {
        let bodies = &world.bodies;
        let single = |v: Vec3| v.as_vec3().to_array();
        let contacts = world.contacts.contacts.iter().zip(&world.contacts.impulse).filter(|_| chains);
        Frame {
            time: world.time,
            position: bodies.position.iter().map(|&position| single(position)).collect(),
            orientation: self
                .oriented
                .iter()
                .map(|&body| bodies.orientation[body].to_array().map(|q| q as f32))
                .collect(),
            speed: bodies.velocity.iter().map(|velocity| velocity.length() as f32).collect(),
            size: (0..self.count).map(|body| self.size(world, body)).collect(),
            force: contact_force(world, step).into_iter().map(|force| force as f32).collect(),
            contacts: contacts
                .map(|(contact, impulse)| {
                    let force = (impulse.dot(contact.normal) / step) as f32;
                    (contact.body_a, contact.body_b, single(contact.point), force)
                })
                .filter(|contact| contact.3 > 0.0)
                .collect(),
        }
    }
}

/// Triangles of a body (nine numbers each, in its frame): those with the grains on one side, with their fronts towards them, and the others.
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

/// Corners of a part's triangles in its body's frame. A plane is cut at the scene's bounds; without a scene it has none.
fn corners(part: &Part, scene: Option<(&World, usize, &Bounds)>) -> Vec<f32> {
    let triangles = match (&part.shape, scene) {
        // A capsule of no length is a ball.
        (Shape::Sphere { radius }, _) => surface(&Shape::Capsule { half_length: 0.0, radius: *radius }),
        (Shape::Plane, Some((world, body, bounds))) => {
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
            (!bounds.is_empty()).then(|| Triangles { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] })
        }
        (shape, _) => surface(shape),
    };
    let Some(triangles) = triangles else { return Vec::new() };
    let place = |&corner: &u32| {
        let point = part.position + part.orientation * triangles.vertices[corner as usize];
        point.as_vec3().to_array()
    };
    triangles.triangles.iter().flatten().flat_map(place).collect()
}
