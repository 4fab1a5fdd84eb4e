//! Fields in bins along an axis or a radius.

use super::space::{ball_below, ball_in_pipe, bounds, cross_section, disc_in_region, own_space};
use crate::load::Region;
use crate::math::Vec3;
use crate::world::World;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Along what bins lie one behind the other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Along {
    /// A coordinate: 0, 1, 2 for x, y, z.
    Axis(usize),
    /// The distance from the upright line through this point.
    Radius(Vec3),
}

/// Bins of equal width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bins {
    /// Along what.
    pub along: Along,
    /// Lower edge of the first, m.
    pub from: f64,
    /// Upper edge of the last, m.
    pub to: f64,
    /// How many.
    pub count: usize,
}

/// What is in a bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bin {
    /// Middle of the bin, m.
    pub middle: f64,
    /// Bodies of which a part is inside, by that part.
    pub bodies: f64,
    /// Mass per volume, kg/m^3.
    pub density: f64,
    /// Share of the volume that bodies fill.
    pub solid: f64,
    /// Mean velocity by mass, m/s.
    pub velocity: Vec3,
    /// Mean angular velocity by mass, rad/s.
    pub spin: Vec3,
    /// Granular temperature: a third of the mean square of what velocities deviate from that mean, m^2/s^2.
    pub temperature: f64,
}

/// The fields of the bodies that are meant. A ball counts in every bin by the volume that it has there, any
/// other body by its centre of mass. The volume of a bin is what it has in common with the region; without
/// one, with the box around the bodies that are meant, which ends at the faces of a periodic cell.
///
/// Bins along x or y in a cylinder have no volume of their own: densities are then NaN.
pub fn profile(world: &World, selected: &[bool], bins: &Bins, region: Option<&Region>) -> Vec<Bin> {
    let around = own_space(world, selected);
    let space = region.or(around.as_ref());
    let width = (bins.to - bins.from) / bins.count as f64;
    let edge = |k: usize| bins.from + k as f64 * width;
    let mut found: Vec<Bin> =
        (0..bins.count).map(|k| Bin { middle: edge(k) + 0.5 * width, ..Bin::default() }).collect();
    // Bin, body, share of it, and what its image is faster by.
    let mut shares: Vec<(usize, usize, f64, Vec3)> = Vec::new();
    let meant = (0..world.bodies.len()).filter(|&body| selected[body]);
    for (body, centre, faster) in meant.flat_map(|body| places(world, body, bins.along)) {
        // The bins that the body can reach.
        let place = coordinate(bins.along, centre);
        let reach = ball(world, body).unwrap_or(0.0);
        let bin_at = |x: f64| ((x - bins.from) / width).floor().clamp(-1.0, bins.count as f64) as i64;
        for k in bin_at(place - reach).max(0)..=bin_at(place + reach).min(bins.count as i64 - 1) {
            let k = k as usize;
            let share = share(world, body, centre, bins.along, [edge(k), edge(k + 1)]);
            if share > 0.0 {
                shares.push((k, body, share, faster));
            }
        }
    }
    let mut mass = vec![0.0; bins.count];
    for &(k, body, share, faster) in &shares {
        let m = share * world.bodies.mass[body];
        mass[k] += m;
        found[k].bodies += share;
        found[k].velocity += m * (world.bodies.velocity[body] + faster);
        found[k].spin += m * world.bodies.angular_velocity[body];
        found[k].solid += share * world.geometries[world.bodies.geometry[body].index()].volume;
    }
    for (bin, m) in found.iter_mut().zip(&mass).filter(|(_, m)| **m > 0.0) {
        bin.velocity /= *m;
        bin.spin /= *m;
    }
    for &(k, body, share, faster) in &shares {
        let deviation = (world.bodies.velocity[body] + faster - found[k].velocity).length_squared();
        found[k].temperature += share * world.bodies.mass[body] / mass[k] * deviation / 3.0;
    }
    for (k, bin) in found.iter_mut().enumerate() {
        let volume = space.and_then(|space| bin_volume(bins.along, edge(k), edge(k + 1), space));
        bin.density = mass[k] / volume.unwrap_or(f64::NAN);
        bin.solid /= volume.unwrap_or(f64::NAN);
    }
    found
}

fn coordinate(along: Along, point: Vec3) -> f64 {
    match along {
        Along::Axis(axis) => point[axis],
        Along::Radius(centre) => real::hypot(point.x - centre.x, point.y - centre.y),
    }
}

/// The radius of a body that is one ball.
fn ball(world: &World, body: usize) -> Option<f64> {
    world.geometries[world.bodies.geometry[body].index()].ball()
}

/// Where a body is seen, and what it is faster by there: itself, and the images of a ball that reaches
/// through a face of a periodic cell.
fn places(world: &World, body: usize, along: Along) -> Vec<(usize, Vec3, Vec3)> {
    let centre = world.bodies.position[body];
    let mut found = vec![(body, centre, Vec3::ZERO)];
    if let (Some(cell), Some(radius), Along::Axis(axis)) = (world.cell(), ball(world, body), along) {
        for sign in [-1, 1].into_iter().filter(|_| cell.periodic[axis]) {
            let mut n = [0; 3];
            n[axis] = sign;
            let image = centre + cell.shift(n);
            let (low, high) = (cell.lower[axis] - radius, cell.lower[axis] + cell.size[axis] + radius);
            if (low..high).contains(&image[axis]) {
                found.push((body, image, cell.image_velocity(n)));
            }
        }
    }
    found
}

/// Share of a body's volume between two edges.
fn share(world: &World, body: usize, centre: Vec3, along: Along, [low, high]: [f64; 2]) -> f64 {
    let place = coordinate(along, centre);
    let Some(radius) = ball(world, body) else { return f64::from(u8::from((low..high).contains(&place))) };
    let whole = 4.0 / 3.0 * PI * radius.powi(3);
    let between = match along {
        Along::Axis(_) => ball_below(radius, high - place) - ball_below(radius, low - place),
        Along::Radius(_) => ball_in_pipe(radius, place, high) - ball_in_pipe(radius, place, low),
    };
    between / whole
}

/// Volume of a bin in a space; `None` where it is not known.
fn bin_volume(along: Along, low: f64, high: f64, space: &Region) -> Option<f64> {
    match along {
        Along::Axis(axis) => {
            let (bottom, top) = match *space {
                Region::Box { min, max } => (min[axis], max[axis]),
                Region::Cylinder { base, height, .. } => (base.z, base.z + height),
            };
            let common = (high.min(top) - low.max(bottom)).max(0.0);
            Some(cross_section(space, axis)? * common).filter(|volume| *volume > 0.0)
        }
        Along::Radius(centre) => {
            let disc = |radius: f64| disc_in_region(space, centre, radius.max(0.0));
            let height = match *space {
                Region::Box { min, max } => max.z - min.z,
                Region::Cylinder { height, .. } => height,
            };
            Some((disc(high) - disc(low)) * height).filter(|volume| *volume > 0.0)
        }
    }
}

/// The lowest and the highest place of the bodies that are meant along an axis or radius, m; `None` where
/// there are none.
pub fn extent(world: &World, selected: &[bool], along: Along) -> Option<[f64; 2]> {
    let all = (0..world.bodies.len()).filter(|&body| selected[body]);
    let span = all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], body| {
        let [a, b] = match along {
            Along::Axis(axis) => bounds(world, body).map(|corner| corner[axis]),
            Along::Radius(_) => {
                let place = coordinate(along, world.bodies.position[body]);
                let reach = world.geometries[world.bodies.geometry[body].index()].bounding_radius();
                [(place - reach).max(0.0), place + reach]
            }
        };
        [low.min(a), high.max(b)]
    });
    (span[0] < span[1]).then_some(span)
}

#[cfg(test)]
mod tests {
    use super::super::space::selected;
    use super::*;
    use crate::handle::MaterialId;
    use crate::shape::Geometry;
    use crate::world::Body;

    /// A cubic lattice of touching balls that shears: in every layer density rho pi/6, velocity that of the
    /// layer, no temperature; half a layer up the means of two layers and a temperature of a twelfth of the
    /// square of their difference.
    #[test]
    fn a_lattice_that_shears() {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.5).unwrap());
        for i in 0..125 {
            let place = Vec3::new(f64::from(i % 5), f64::from(i / 5 % 5), f64::from(i / 25));
            let velocity = Vec3::new(place.z, 0.0, 0.0);
            world.add_body(Body { velocity, ..Body::new(ball, MaterialId::default(), place) }).unwrap();
        }
        let all = selected(&world, None, None);
        let bins = |from, to, count| Bins { along: Along::Axis(2), from, to, count };
        let layers = profile(&world, &all, &bins(-0.5, 4.5, 5), None);
        for (k, bin) in layers.iter().enumerate() {
            assert!((bin.density - 1000.0 * PI / 6.0).abs() < 1e-9, "{bin:?}");
            assert!((bin.solid - PI / 6.0).abs() < 1e-12 && (bin.bodies - 25.0).abs() < 1e-9);
            assert!((bin.velocity.x - k as f64).abs() < 1e-12 && bin.temperature < 1e-20, "{bin:?}");
        }
        let between = profile(&world, &all, &bins(0.0, 1.0, 1), None)[0];
        assert!((between.velocity.x - 0.5).abs() < 1e-12 && (between.temperature - 1.0 / 12.0).abs() < 1e-12);
        assert_eq!(extent(&world, &all, Along::Axis(2)), Some([-0.5, 4.5]));
    }

    /// A ring of balls that turns about the axis: all mass between the edges of its bin, by volume.
    #[test]
    fn bins_along_a_radius() {
        let mut world = World::default();
        let ball = world.add_geometry(Geometry::sphere(0.1).unwrap());
        for k in 0..12 {
            let angle = f64::from(k) * PI / 6.0;
            let place = Vec3::new(2.0 + angle.cos(), angle.sin(), 0.5);
            world.add_body(Body::new(ball, MaterialId::default(), place)).unwrap();
        }
        let all = selected(&world, None, None);
        let bins = Bins { along: Along::Radius(Vec3::new(2.0, 0.0, 9.0)), from: 0.0, to: 1.5, count: 3 };
        let region = Region::Cylinder { base: Vec3::new(2.0, 0.0, 0.0), radius: 1.5, height: 1.0 };
        let found = profile(&world, &all, &bins, Some(&region));
        let bodies: Vec<f64> = found.iter().map(|bin| bin.bodies).collect();
        assert!(bodies[0] == 0.0 && (bodies[1] + bodies[2] - 12.0).abs() < 1e-2, "{bodies:?}");
        // A circle of radius 1 leaves a little less than half of each ball inside.
        assert!((bodies[1] / 12.0 - 0.5).abs() < 0.03 && bodies[1] < bodies[2]);
        let mass: f64 = found.iter().zip([0.25, 0.75, 1.25]).map(|(bin, area)| bin.density * area * PI).sum();
        assert!((mass / (12.0 * world.bodies.mass[0]) - 1.0).abs() < 1e-3);
    }
}
