//! Which bodies are meant, and how much of a region they fill.

use crate::handle::BodyId;
use crate::load::Region;
use crate::math::{Quat, Vec3};
use crate::shape::{Geometry, Shape, Sphere};
use crate::world::World;
use graintrain_linalg::real;
use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};

/// Slices of a ball that a region cuts.
const SLICES: usize = 128;

/// Points per direction in the box around a body that is no ball and that a region cuts.
const POINTS: i32 = 20;

/// Per body whether it is meant: it can move, it is among `bodies` (`None`: all), and its centre of mass is
/// in `region` (`None`: anywhere).
pub fn selected(world: &World, bodies: Option<&[BodyId]>, region: Option<&Region>) -> Vec<bool> {
    let count = world.bodies.len();
    let mut chosen = vec![bodies.is_none(); count];
    for body in bodies.unwrap_or_default() {
        if let Some(entry) = chosen.get_mut(body.index()) {
            *entry = true;
        }
    }
    for (body, entry) in chosen.iter_mut().enumerate() {
        let inside = region.is_none_or(|region| region.contains(world.bodies.position[body]));
        *entry &= inside && !world.is_prescribed(body);
    }
    chosen
}

/// Lower and upper corner of the box along the axes around a body, m (around its vertices or more where it is
/// a mesh).
pub fn bounds(world: &World, body: usize) -> [Vec3; 2] {
    let (position, orientation) = (world.bodies.position[body], world.bodies.orientation[body]);
    let geometry = &world.geometries[world.bodies.geometry[body].index()];
    geometry.parts.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], part| {
        let [from, to] = part.bounds(position, orientation);
        [low.min(from), high.max(to)]
    })
}

/// The box along the axes around the bodies that are meant; `None` where there are none.
pub fn bounding_box(world: &World, selected: &[bool]) -> Option<Region> {
    let all = (0..world.bodies.len()).filter(|&body| selected[body]);
    let [min, max] = all.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], body| {
        let [a, b] = bounds(world, body);
        [low.min(a), high.max(b)]
    });
    (min.is_finite() && max.is_finite()).then_some(Region::Box { min, max })
}

/// The space that the bodies that are meant have to themselves: the box along the axes around them, from face
/// to face along the axes along which a periodic cell repeats.
pub fn own_space(world: &World, selected: &[bool]) -> Option<Region> {
    let mut around = bounding_box(world, selected)?;
    if let (Some(cell), Region::Box { min, max }) = (world.cell(), &mut around) {
        for axis in (0..3).filter(|&axis| cell.periodic[axis]) {
            (min[axis], max[axis]) = (cell.lower[axis], cell.lower[axis] + cell.size[axis]);
        }
    }
    Some(around)
}

/// Volume of a region, m^3.
pub fn volume(region: &Region) -> f64 {
    match *region {
        Region::Box { min, max } => (max - min).to_array().iter().product(),
        Region::Cylinder { radius, height, .. } => PI * radius * radius * height,
    }
}

/// Area common to the disc of this radius about the origin and the triangle from the origin to `a` and `b`,
/// signed.
fn disc_and_triangle(radius: f64, a: [f64; 2], b: [f64; 2]) -> f64 {
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let dot = |u: [f64; 2], v: [f64; 2]| u[0] * v[0] + u[1] * v[1];
    let sector = |u: [f64; 2], v: [f64; 2]| 0.5 * radius * radius * real::atan2(cross(u, v), dot(u, v));
    let d = [b[0] - a[0], b[1] - a[1]];
    let (quadratic, linear, constant) = (dot(d, d), dot(a, d), dot(a, a) - radius * radius);
    let root = (linear * linear - quadratic * constant).max(0.0).sqrt();
    if quadratic == 0.0 || root == 0.0 {
        return sector(a, b);
    }
    let (enter, leave) = ((-linear - root) / quadratic, (-linear + root) / quadratic);
    if leave <= 0.0 || enter >= 1.0 {
        return sector(a, b);
    }
    let at = |t: f64| [a[0] + t * d[0], a[1] + t * d[1]];
    let (p, q) = (if enter > 0.0 { at(enter) } else { a }, if leave < 1.0 { at(leave) } else { b });
    let before = if enter > 0.0 { sector(a, p) } else { 0.0 };
    let after = if leave < 1.0 { sector(q, b) } else { 0.0 };
    before + 0.5 * cross(p, q) + after
}

/// Area common to a disc about the origin and the rectangle [low, high].
fn disc_and_rectangle(radius: f64, low: [f64; 2], high: [f64; 2]) -> f64 {
    let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
    (0..4).map(|k| disc_and_triangle(radius, corners[k], corners[(k + 1) % 4])).sum()
}

/// Area common to two discs whose centres are `distance` apart.
pub(crate) fn disc_and_disc(a: f64, b: f64, distance: f64) -> f64 {
    let (small, large) = (a.min(b), a.max(b));
    if distance >= a + b {
        return 0.0;
    }
    if distance <= large - small {
        return PI * small * small;
    }
    let angle = |near: f64, far: f64| {
        real::acos(
            ((distance * distance + near * near - far * far) / (2.0 * distance * near)).clamp(-1.0, 1.0),
        )
    };
    let (x, y) = (angle(a, b), angle(b, a));
    a * a * (x - 0.5 * real::sin(2.0 * x)) + b * b * (y - 0.5 * real::sin(2.0 * y))
}

/// Volume of the part between the heights `low` and `high` (above the centre) of a body of revolution inside
/// a ball: the integral of the area that `area` gives for the disc of each radius.
fn slices(radius: f64, low: f64, high: f64, area: impl Fn(f64) -> f64) -> f64 {
    // With z = R sin t the integrand is smooth at the poles.
    let [from, to] = [low, high].map(|z| real::asin((z / radius).clamp(-1.0, 1.0)));
    let width = (to - from) / SLICES as f64;
    let at = |k: usize| from + (k as f64 + 0.5) * width;
    (0..SLICES).map(|k| radius * real::cos(at(k)) * width * area(radius * real::cos(at(k)))).sum()
}

/// Volume that a ball has in common with a region, m^3; exact where the region holds or misses it, otherwise
/// to about 1e-4 of the ball.
pub fn ball_in_region(centre: Vec3, radius: f64, region: &Region) -> f64 {
    let whole = 4.0 / 3.0 * PI * radius.powi(3);
    match *region {
        Region::Box { min, max } => {
            let (low, high) = (min - centre, max - centre);
            if low.cmple(Vec3::splat(-radius)).all() && high.cmpge(Vec3::splat(radius)).all() {
                return whole;
            }
            if low.cmpge(Vec3::splat(radius)).any() || high.cmple(Vec3::splat(-radius)).any() {
                return 0.0;
            }
            slices(radius, low.z, high.z, |r| disc_and_rectangle(r, [low.x, low.y], [high.x, high.y]))
        }
        Region::Cylinder { base, radius: outer, height } => {
            let d = centre - base;
            let distance = real::hypot(d.x, d.y);
            if distance + radius <= outer && d.z >= radius && d.z + radius <= height {
                return whole;
            }
            if distance >= outer + radius || d.z <= -radius || d.z >= height + radius {
                return 0.0;
            }
            slices(radius, -d.z, height - d.z, |r| disc_and_disc(r, outer, distance))
        }
    }
}

/// Volume that a ball has within `distance` of a line parallel to z that passes its centre at `offset`, m^3.
pub(crate) fn ball_in_pipe(radius: f64, offset: f64, distance: f64) -> f64 {
    if offset + radius <= distance {
        return 4.0 / 3.0 * PI * radius.powi(3);
    }
    if offset >= distance + radius || distance <= 0.0 {
        return 0.0;
    }
    slices(radius, -radius, radius, |r| disc_and_disc(r, distance, offset))
}

/// Volume of a ball below the height z above its centre, m^3.
pub(crate) fn ball_below(radius: f64, z: f64) -> f64 {
    let h = (z + radius).clamp(0.0, 2.0 * radius);
    PI * h * h * (radius - h / 3.0)
}

/// Points of a regular grid inside a geometry, in its own frame.
fn inner_points(geometry: &Geometry) -> Vec<Vec3> {
    let solid = || geometry.parts.iter().filter(|part| part.shape.volume() > 0.0);
    let [low, high] = solid().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], part| {
        let [from, to] = part.bounds(Vec3::ZERO, Quat::IDENTITY);
        [low.min(from), high.max(to)]
    });
    let share = |k: i32| (f64::from(k) + 0.5) / f64::from(POINTS);
    let grid = (0..POINTS).flat_map(|i| (0..POINTS).flat_map(move |j| (0..POINTS).map(move |k| [i, j, k])));
    let points = grid.map(|[i, j, k]| low + (high - low) * Vec3::new(share(i), share(j), share(k)));
    let inside = |point: &Vec3| {
        solid().any(|part| {
            let local = part.orientation.inverse() * (*point - part.position);
            part.shape.form().signed_distance(local).value <= 0.0
        })
    };
    points.filter(inside).collect()
}

/// Volume that the bodies which can move have in common with a region, m^3: of balls see [`ball_in_region`];
/// other bodies that the region cuts count by the share of the points of a grid that are inside, to about 1 %
/// of the body, and solid meshes in whole where their centre is inside. In a periodic cell images that reach
/// into the region count, too.
pub fn solid_volume(world: &World, region: &Region) -> f64 {
    let mut grids: HashMap<usize, Vec<Vec3>> = HashMap::new();
    let mut sum = 0.0;
    let movable = || (0..world.bodies.len()).filter(|&body| !world.is_prescribed(body));
    let own_volume = |body: usize| world.geometries[world.bodies.geometry[body].index()].volume;
    if world.cell().is_some_and(|cell| cell.periodic == [true; 3] && cell.region() == *region) {
        return movable().map(own_volume).sum();
    }
    let places = movable().flat_map(|body| {
        let position = world.bodies.position[body];
        let reach = world.geometries[world.bodies.geometry[body].index()].bounding_radius();
        let images = world.cell().into_iter().flat_map(move |cell| cell.images(position, reach));
        std::iter::once((body, position)).chain(images.map(move |(_, image)| (body, image)))
    });
    for (body, position) in places {
        let orientation = world.bodies.orientation[body];
        let index = world.bodies.geometry[body].index();
        let geometry = &world.geometries[index];
        if let [part] = geometry.parts.as_slice()
            && let Shape::Sphere(Sphere { radius }) = part.shape
        {
            sum += ball_in_region(position + orientation * part.position, radius, region);
            continue;
        }
        // The inside of a mesh is not known point by point: it counts where its centre is.
        if geometry.parts.iter().any(|part| matches!(part.shape, Shape::Mesh(_))) {
            sum += if region.contains(position) { geometry.volume } else { 0.0 };
            continue;
        }
        // A ball around the body tells without a grid whether the region holds or misses it.
        let reach = geometry.bounding_radius();
        let around = 4.0 / 3.0 * PI * reach.powi(3);
        let common = ball_in_region(position, reach, region);
        if common == 0.0 || geometry.volume == 0.0 {
            continue;
        }
        if common == around {
            sum += geometry.volume;
            continue;
        }
        let grid = grids.entry(index).or_insert_with(|| inner_points(geometry));
        let inside = grid.iter().filter(|&&point| region.contains(position + orientation * point)).count();
        sum += geometry.volume * inside as f64 / grid.len().max(1) as f64;
    }
    sum
}

/// Area common to a region, seen from above, and the disc of this radius about `centre`, m^2.
pub(crate) fn disc_in_region(region: &Region, centre: Vec3, radius: f64) -> f64 {
    match *region {
        Region::Box { min, max } => {
            let corner = |point: Vec3| [point.x - centre.x, point.y - centre.y];
            disc_and_rectangle(radius, corner(min), corner(max))
        }
        Region::Cylinder { base, radius: own, .. } => {
            disc_and_disc(own, radius, real::hypot(base.x - centre.x, base.y - centre.y))
        }
    }
}

/// Share of a region that no body which can move fills. Overlaps of different bodies count twice.
pub fn porosity(world: &World, region: &Region) -> f64 {
    1.0 - solid_volume(world, region) / volume(region)
}

/// Angles and areas of what a box or cylinder looks like along an axis (0, 1, 2), m^2; `None` for the
/// cylinder from the side.
pub fn cross_section(region: &Region, axis: usize) -> Option<f64> {
    match *region {
        Region::Box { min, max } => {
            let edge = max - min;
            Some(edge[(axis + 1) % 3] * edge[(axis + 2) % 3])
        }
        Region::Cylinder { radius, .. } => (axis == 2).then_some(2.0 * FRAC_PI_2 * radius * radius),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handle::MaterialId;
    use crate::shape::Cuboid;
    use crate::world::Body;

    fn close(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() <= tolerance * expected.abs().max(1e-300), "{found} {expected}");
    }

    /// Half balls, an eighth in a corner, a cap of known height, a thin rod out of a ball's middle.
    #[test]
    fn parts_of_balls_in_regions() {
        let ball = 4.0 / 3.0 * PI * 8.0;
        let region = |min: [f64; 3], max: [f64; 3]| Region::Box { min: min.into(), max: max.into() };
        let common = |region: &Region| ball_in_region(Vec3::ZERO, 2.0, region);
        close(common(&region([-9.0; 3], [9.0; 3])), ball, 0.0);
        assert_eq!(common(&region([2.0, -9.0, -9.0], [9.0; 3])), 0.0);
        for axis in 0..3 {
            let mut min = [-9.0; 3];
            min[axis] = 0.0;
            close(common(&region(min, [9.0; 3])), 0.5 * ball, 1e-4);
            min[axis] = 1.5;
            close(common(&region(min, [9.0; 3])), PI * 0.25 * (2.0 - 0.5 / 3.0), 2e-3);
        }
        close(common(&region([0.0; 3], [9.0; 3])), ball / 8.0, 1e-4);
        close(common(&region([-0.5; 3], [0.5; 3])), 1.0, 1e-5);
        let cylinder = |radius, base| Region::Cylinder { base, radius, height: 20.0 };
        // A cylinder through the middle leaves the ball of the napkin ring.
        let h = (4.0_f64 - 1.0).sqrt();
        close(common(&cylinder(1.0, Vec3::new(0.0, 0.0, -10.0))), ball - 4.0 / 3.0 * PI * h.powi(3), 1e-3);
        close(common(&cylinder(9.0, Vec3::ZERO)), 0.5 * ball, 1e-4);
        close(ball_below(2.0, 0.0), 0.5 * ball, 1e-14);
        close(ball_in_pipe(2.0, 0.0, 1.0), ball - 4.0 / 3.0 * PI * h.powi(3), 1e-3);
    }

    /// A simple cubic lattice has the porosity 1 - pi/6 wherever a cell of it is cut out.
    #[test]
    fn porosity_of_a_cubic_lattice() {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.5).unwrap());
        for i in 0..216 {
            let place = Vec3::new(f64::from(i % 6), f64::from(i / 6 % 6), f64::from(i / 36));
            world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
        }
        for shift in [0.0, 0.25, 0.4321] {
            let region = Region::Box { min: Vec3::splat(1.0 + shift), max: Vec3::splat(4.0 + shift) };
            close(porosity(&world, &region), 1.0 - PI / 6.0, 1e-4);
        }
        let all = selected(&world, None, None);
        let around = bounding_box(&world, &all).unwrap();
        assert_eq!(around, Region::Box { min: Vec3::splat(-0.5), max: Vec3::splat(5.5) });
        close(porosity(&world, &around), 1.0 - PI / 6.0, 1e-12);
    }

    /// Boxes that a region cuts in half.
    #[test]
    fn bodies_that_are_no_balls_count_by_what_is_inside() {
        let mut world = World::default();
        let shape = world
            .add_geometry(Geometry::single(Shape::Box(Cuboid { half: Vec3::new(1.0, 0.5, 0.2) })).unwrap());
        world.add_body(Body::new(shape, MaterialId::default(), Vec3::ZERO)).unwrap();
        let turned = Quat::from_rotation_z(FRAC_PI_2);
        world
            .add_body(Body { orientation: turned, ..Body::new(shape, MaterialId::default(), Vec3::ZERO) })
            .unwrap();
        let region = Region::Box { min: Vec3::new(0.0, -5.0, -5.0), max: Vec3::splat(5.0) };
        close(solid_volume(&world, &region), 0.8, 1e-12);
        assert_eq!(bounds(&world, 1)[1].y, 1.0);
    }
}
