//! What is in the picture: the world's bodies and contacts as primitives with colours.

use super::camera::{Bounds, Camera};
use super::color::{Rgb, categorical, viridis};
use super::primitive::{Form, Look, Primitive};
use super::{ColorBy, RenderSettings};
use graintrain::contact::Contact;
use graintrain::math::Vec3;
use graintrain::shape::{Capsule, Cuboid, Cylinder, HalfSpace, Mesh, Part, Shape, Sphere, Surface};
use graintrain::world::World;

/// Brighter than white: walls face away from the key light.
const WALL: Rgb = [1.15, 1.16, 1.18];
const TOOL: Rgb = [0.42, 0.48, 0.56];
const PANE: Rgb = [0.35, 0.45, 0.55];

/// Share of the grains that have to lie on one side of a wall.
const ONE_SIDE: f64 = 0.98;

/// The quantity that colours stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// Name with unit.
    pub label: String,
    /// Values at the two ends of the colour map.
    pub range: [f64; 2],
    /// Whether some values exceed the range.
    pub exceeded: bool,
}

/// Bodies that are free to translate: what the picture is about.
pub fn grains(world: &World) -> Vec<usize> {
    (0..world.bodies.len()).filter(|&body| world.free_degrees(body)[..3] == [true; 3]).collect()
}

/// Farther than this part of the diagonal of the grains' box, what is no grain does not belong to the
/// picture: a gate that has dropped.
const FAR: f64 = 0.3;

/// The box that holds the grains and everything else of a like size beside them. Half-spaces do not count.
pub fn bounds(world: &World, grains: &[usize]) -> Bounds {
    let ball = |bounds: Bounds, body: usize, part: &Part| {
        let center = part_center(world, body, part);
        bounds.with(center, part.shape.bounding_radius())
    };
    let parts_of = |body: usize| &world.geometries[world.bodies.geometry[body].index()].parts;
    let mut bounds = Bounds::EMPTY;
    for &body in grains {
        bounds = parts_of(body).iter().fold(bounds, |bounds, part| ball(bounds, body, part));
    }
    let diagonal = if bounds.is_empty() { f64::INFINITY } else { (bounds.high - bounds.low).length() };
    let around = bounds;
    let beside = |reach: &Bounds| {
        let apart = (reach.low - around.high).max(around.low - reach.high);
        around.is_empty() || apart.max_element() < FAR * diagonal
    };
    let mut is_grain = vec![false; world.bodies.len()];
    grains.iter().for_each(|&body| is_grain[body] = true);
    let mut planes = Vec::new();
    for body in (0..world.bodies.len()).filter(|&body| !is_grain[body]) {
        for part in parts_of(body) {
            if part.shape == Shape::Plane(HalfSpace) {
                planes.push((
                    part_center(world, body, part),
                    world.bodies.orientation[body] * part.orientation * Vec3::Z,
                ));
            }
            let points = part_points(world, body, part);
            let reach = points.iter().fold(Bounds::EMPTY, |bounds, &point| bounds.with(point, 0.0));
            if !reach.is_empty() && (reach.high - reach.low).length() < 3.0 * diagonal && beside(&reach) {
                bounds = Bounds { low: bounds.low.min(reach.low), high: bounds.high.max(reach.high) };
            }
        }
    }
    // Walls that are half-spaces along the axes end where they meet.
    for (point, normal) in planes {
        let axis = normal.abs().max_position();
        let beyond = (bounds.low[axis] - point[axis]).max(point[axis] - bounds.high[axis]);
        if normal[axis].abs() > 0.999 && beyond < FAR * diagonal {
            bounds.low[axis] = bounds.low[axis].min(point[axis]);
            bounds.high[axis] = bounds.high[axis].max(point[axis]);
        }
    }
    bounds
}

fn part_center(world: &World, body: usize, part: &Part) -> Vec3 {
    world.bodies.position[body] + world.bodies.orientation[body] * part.position
}

/// Points whose hull holds a part; none for a half-space.
fn part_points(world: &World, body: usize, part: &Part) -> Vec<Vec3> {
    let center = part_center(world, body, part);
    let rotation = world.bodies.orientation[body] * part.orientation;
    let points = match &part.shape {
        Shape::Plane(_) => return Vec::new(),
        Shape::Hull(hull) => hull.corners().to_vec(),
        Shape::Mesh(Mesh { vertices, .. }) => vertices.clone(),
        solid => {
            let [low, high] = solid.bounds();
            Bounds { low, high }.corners().to_vec()
        }
    };
    points.into_iter().map(|point| center + rotation * point).collect()
}

/// Largest normal force at each body's contacts, N.
pub fn contact_force(world: &World, step: f64) -> Vec<f64> {
    let mut force = vec![0.0_f64; world.bodies.len()];
    for (contact, impulse) in world.contacts.contacts.iter().zip(&world.contacts.impulse) {
        let normal = impulse.dot(contact.normal) / step;
        for body in [contact.body_a, contact.body_b] {
            force[body as usize] = force[body as usize].max(normal);
        }
    }
    force
}

/// Label and values of the grains; none where colours stand for no numbers.
fn grain_values(
    world: &World,
    grains: &[usize],
    settings: &RenderSettings,
) -> Option<(&'static str, Vec<f64>)> {
    Some(match settings.color {
        ColorBy::Identity => return None,
        ColorBy::Speed => {
            ("speed (m/s)", grains.iter().map(|&body| world.bodies.velocity[body].length()).collect())
        }
        ColorBy::Force => {
            let force = contact_force(world, settings.step);
            ("largest contact force (N)", grains.iter().map(|&body| force[body]).collect())
        }
        ColorBy::Radius => {
            let radius = |&body: &usize| {
                let parts = &world.geometries[world.bodies.geometry[body].index()].parts;
                parts.iter().map(|part| part.shape.bounding_radius()).fold(0.0, f64::max)
            };
            ("radius (m)", grains.iter().map(radius).collect())
        }
    })
}

/// Normal forces of the contacts that carry any, N.
fn chain_values(world: &World, settings: &RenderSettings) -> Vec<f64> {
    let set = &world.contacts;
    let normal = |(contact, impulse): (&Contact, &Vec3)| impulse.dot(contact.normal) / settings.step;
    set.contacts.iter().zip(&set.impulse).map(normal).filter(|&force| force > 0.0).collect()
}

/// What the colours of a picture stand for: of grains, or of contacts where these are shown.
pub fn shown_values(world: &World, settings: &RenderSettings) -> Vec<f64> {
    if settings.force_chains {
        return chain_values(world, settings);
    }
    grain_values(world, &grains(world), settings).map(|(_, values)| values).unwrap_or_default()
}

/// Colours of the grains, and the legend where colours stand for numbers.
fn grain_colors(world: &World, grains: &[usize], settings: &RenderSettings) -> (Vec<Rgb>, Option<Legend>) {
    let Some((label, values)) = grain_values(world, grains, settings) else {
        return (grains.iter().map(|&body| categorical(body)).collect(), None);
    };
    let legend = legend(label, &values, settings.range, settings.color == ColorBy::Radius);
    let [low, high] = legend.range;
    (values.iter().map(|value| viridis((value - low) / (high - low))).collect(), Some(legend))
}

/// Range of a colour map: as asked for, else from zero (or the smallest value) to the largest, or to the 99th
/// percentile where a few values would stretch it.
fn legend(label: &str, values: &[f64], range: Option<[f64; 2]>, from_smallest: bool) -> Legend {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let largest = sorted.last().copied().unwrap_or(0.0);
    let range = range.unwrap_or_else(|| {
        let usual = sorted.get(sorted.len() * 99 / 100).copied().unwrap_or(0.0);
        let high = if largest > 1.5 * usual && usual > 0.0 { usual } else { largest };
        let low = if from_smallest { sorted.first().copied().unwrap_or(0.0) } else { 0.0 };
        let high = if high > low { high } else { low + low.abs().max(1.0) };
        [low, high]
    });
    Legend { label: label.into(), range, exceeded: largest > range[1] * (1.0 + 1e-9) }
}

/// Everything that is seen from a camera, and the legend of the colours.
pub fn primitives(
    world: &World,
    grains: &[usize],
    bounds: &Bounds,
    camera: &Camera,
    settings: &RenderSettings,
) -> (Vec<Primitive>, Option<Legend>) {
    let mut primitives = Vec::with_capacity(world.bodies.len());
    let (colors, mut legend) = grain_colors(world, grains, settings);
    let look = if settings.force_chains { Look::Ghost } else { Look::Solid };
    let mut is_grain = vec![false; world.bodies.len()];
    for (&body, &color) in grains.iter().zip(&colors) {
        is_grain[body] = true;
        for part in &world.geometries[world.bodies.geometry[body].index()].parts {
            let color = if settings.force_chains { [0.6, 0.64, 0.7] } else { color };
            primitives.extend(forms(world, body, part, bounds).map(|form| Primitive { form, color, look }));
        }
    }
    let centers: Vec<Vec3> = grains.iter().map(|&body| world.bodies.position[body]).collect();
    for body in (0..world.bodies.len()).filter(|&body| !is_grain[body]) {
        let may_be_wall = stands_around(world, body, &centers);
        for part in &world.geometries[world.bodies.geometry[body].index()].parts {
            for form in forms(world, body, part, bounds) {
                let (color, look) = match wall_hides(&form, &centers, camera).filter(|_| may_be_wall) {
                    Some(true) => (PANE, Look::Glass),
                    Some(false) => (WALL, Look::Solid),
                    None => (TOOL, Look::Solid),
                };
                primitives.push(Primitive { form, color, look });
            }
        }
    }
    if settings.force_chains {
        legend = Some(force_chains(world, &is_grain, settings, &mut primitives));
    }
    (primitives, legend)
}

/// The primitives of a part in the world.
fn forms<'a>(
    world: &'a World,
    body: usize,
    part: &'a Part,
    bounds: &Bounds,
) -> Box<dyn Iterator<Item = Form> + 'a> {
    let center = part_center(world, body, part);
    let rotation = world.bodies.orientation[body] * part.orientation;
    let axis = rotation * Vec3::Z;
    let one = |form| Box::new(std::iter::once(form));
    match &part.shape {
        &Shape::Sphere(Sphere { radius }) => one(Form::Ball { center, radius }),
        &Shape::Box(Cuboid { half }) => one(Form::Box { center, rotation, half }),
        &Shape::Capsule(Capsule { half_length, radius }) => {
            one(Form::Capsule { from: center - half_length * axis, to: center + half_length * axis, radius })
        }
        &Shape::Cylinder(Cylinder { half_length, radius }) => {
            one(Form::Cylinder { from: center - half_length * axis, to: center + half_length * axis, radius })
        }
        Shape::Plane(HalfSpace) if bounds.is_empty() => Box::new(std::iter::empty()),
        Shape::Plane(HalfSpace) => {
            // The part of the boundary under the scene, as a thin plate.
            let reach = bounds
                .corners()
                .into_iter()
                .map(|corner| rotation.conjugate() * (corner - center))
                .fold(Bounds::EMPTY, |reach, corner| reach.with(corner, 0.0));
            let thickness = 0.004 * (bounds.high - bounds.low).length();
            let mut half = 0.5 * (reach.high - reach.low);
            half.z = 0.5 * thickness;
            let middle = reach.center().with_z(-half.z);
            one(Form::Box { center: center + rotation * middle, rotation, half })
        }
        solid => Box::new(solid.surface().into_iter().flat_map(move |Surface { vertices, triangles }| {
            let corners =
                move |triangle: [u32; 3]| triangle.map(|i| center + rotation * vertices[i as usize]);
            triangles.into_iter().map(move |triangle| Form::Triangle { corners: corners(triangle) })
        })),
    }
}

/// For a wall (a plate or triangle that has nearly all grains on one side): a point of it and its normal
/// towards the grains. `None` for anything else.
fn wall(form: &Form, grains: &[Vec3]) -> Option<(Vec3, Vec3)> {
    let (point, normal) = match *form {
        Form::Box { center, rotation, half } => {
            let axes = [Vec3::X, Vec3::Y, Vec3::Z];
            let thinnest = (0..3).min_by(|&a, &b| half[a].total_cmp(&half[b]))?;
            (center, rotation * axes[thinnest])
        }
        Form::Triangle { corners: [a, b, c] } => (a, (b - a).cross(c - a)),
        _ => return None,
    };
    let above = grains.iter().filter(|&&grain| normal.dot(grain - point) > 0.0).count() as f64;
    let share = above / grains.len().max(1) as f64;
    if share >= ONE_SIDE {
        Some((point, normal))
    } else if share <= 1.0 - ONE_SIDE {
        Some((point, -normal))
    } else {
        None
    }
}

/// For a wall: whether it stands between the grains and the camera.
fn wall_hides(form: &Form, grains: &[Vec3], camera: &Camera) -> Option<bool> {
    wall(form, grains).map(|(point, normal)| normal.dot(camera.eye - point) < 0.0)
}

/// Whether a body may be a wall: seen along some axis most grains lie within its box, as before a plate, in a
/// trough or on a floor. What is smaller is a tool, like a wheel over a bed, however many grains are on one
/// side of it.
pub fn stands_around(world: &World, body: usize, grains: &[Vec3]) -> bool {
    let parts = &world.geometries[world.bodies.geometry[body].index()].parts;
    if parts.iter().any(|part| part.shape == Shape::Plane(HalfSpace)) {
        return true;
    }
    let points = parts.iter().flat_map(|part| part_points(world, body, part));
    let reach = points.fold(Bounds::EMPTY, |bounds, point| bounds.with(point, 0.0));
    let within =
        |grain: &Vec3, axis: usize| grain[axis] >= reach.low[axis] && grain[axis] <= reach.high[axis];
    (0..3).any(|along| {
        let others = [(along + 1) % 3, (along + 2) % 3];
        let count = grains.iter().filter(|grain| others.iter().all(|&axis| within(grain, axis))).count();
        2 * count > grains.len()
    })
}

/// A triangle of a wall with its front towards the grains; `None` where they are on both sides.
pub fn towards_grains(corners: [Vec3; 3], grains: &[Vec3]) -> Option<[Vec3; 3]> {
    let [a, b, c] = corners;
    let (_, normal) = wall(&Form::Triangle { corners }, grains)?;
    Some(if normal.dot((b - a).cross(c - a)) >= 0.0 { corners } else { [a, c, b] })
}

/// Adds a tube per loaded contact, from centre to contact point to centre, whose thickness and colour grow
/// with the normal force.
fn force_chains(
    world: &World,
    is_grain: &[bool],
    settings: &RenderSettings,
    primitives: &mut Vec<Primitive>,
) -> Legend {
    let set = &world.contacts;
    let normal = |i: usize| set.impulse[i].dot(set.contacts[i].normal) / settings.step;
    let count = set.contacts.len().min(set.impulse.len());
    let loaded = chain_values(world, settings);
    let legend = legend("normal contact force (N)", &loaded, settings.range, false);
    let strongest = legend.range[1];
    for i in 0..count {
        let force = normal(i);
        let contact = &set.contacts[i];
        let ends = [contact.body_a as usize, contact.body_b as usize];
        let radius_of = |body: usize| {
            let parts = &world.geometries[world.bodies.geometry[body].index()].parts;
            parts.iter().map(|part| part.shape.bounding_radius()).fold(0.0, f64::max)
        };
        let grains = ends.into_iter().filter(|&body| is_grain[body]);
        let grain_radius = grains.map(radius_of).fold(f64::INFINITY, f64::min);
        let radius = 0.45 * grain_radius * (force / strongest).clamp(0.0, 1.0);
        if !(radius > 0.012 * grain_radius && radius.is_finite()) {
            continue;
        }
        let color = viridis((force - legend.range[0]) / (strongest - legend.range[0]));
        for body in ends.into_iter().filter(|&body| is_grain[body]) {
            let form = Form::Capsule { from: world.bodies.position[body], to: contact.point, radius };
            primitives.push(Primitive { form, color, look: Look::Solid });
        }
    }
    legend
}
