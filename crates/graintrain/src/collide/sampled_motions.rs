//! The contacts of a pair against brute force: motions that every linearised contact allows, and what then
//! overlaps by dense sampling of both surfaces.

use super::narrow::{Collidable, Placed, body_contacts};
use super::reduce::Touch;
use crate::hull::Hull;
use crate::math::{Quat, Vec3, rotation_exponential};
use crate::shape::{Capsule, Cone, Cuboid, Cylinder, Geometry, Shape};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Largest displacement of any point of the moving body, and the envelope, as lengths of shapes of size
/// about 1.
const ENVELOPE: f64 = 0.02;

fn block() -> Shape {
    Shape::Box(Cuboid { half: Vec3::new(0.5, 0.3, 0.2) })
}

fn wide_block() -> Shape {
    Shape::Box(Cuboid { half: Vec3::new(0.8, 0.7, 0.3) })
}

fn capsule() -> Shape {
    Shape::Capsule(Capsule { half_length: 0.5, radius: 0.1 })
}

fn cylinder() -> Shape {
    Shape::Cylinder(Cylinder { half_length: 0.3, radius: 0.25 })
}

fn stone() -> Shape {
    let point = |k: u32| {
        let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
        Vec3::new(0.5 * a.sin(), 0.4 * b.cos(), 0.3 * (a + b).sin())
    };
    Shape::Hull(Hull::new(&(0..16).map(point).collect::<Vec<_>>()).unwrap().0)
}

/// A prism on a hexagon: faces with more corners than four.
fn prism() -> Shape {
    let corner = |k: u32| {
        let angle = TAU * f64::from(k / 2) / 6.0;
        Vec3::new(0.4 * angle.cos(), 0.4 * angle.sin(), if k % 2 == 1 { 0.25 } else { -0.25 })
    };
    Shape::Hull(Hull::new(&(0..12).map(corner).collect::<Vec<_>>()).unwrap().0)
}

/// With a tip, or blunt: then wider at the top.
fn cone(top_radius: f64) -> Shape {
    Shape::Cone(Cone { height: 0.6, radius: 0.3, top_radius })
}

/// Its mantle is nearer to level than 30 degrees.
fn flat_cone() -> Shape {
    Shape::Cone(Cone { height: 0.1, radius: 0.8, top_radius: 0.5 })
}

/// Points of the surface, edges and corners among them.
fn surface(shape: &Shape) -> Vec<Vec3> {
    let n = 24;
    let mut points = Vec::new();
    for i in 0..=n {
        for j in 0..=n {
            let (u, v) = (2.0 * f64::from(i) / f64::from(n) - 1.0, 2.0 * f64::from(j) / f64::from(n) - 1.0);
            match *shape {
                Shape::Box(Cuboid { half }) => {
                    for side in [-1.0, 1.0] {
                        points.extend(
                            [(side, u, v), (u, side, v), (u, v, side)]
                                .map(|(x, y, z)| half * Vec3::new(x, y, z)),
                        );
                    }
                }
                Shape::Cylinder(Cylinder { half_length, radius }) => {
                    let rim = radius * Vec3::new((TAU * u).cos(), (TAU * u).sin(), 0.0);
                    let height = half_length * Vec3::Z;
                    points.extend([rim + v * height, v * rim + height, v * rim - height]);
                }
                Shape::Cone(Cone { radius, top_radius, .. }) => {
                    let [low, high] = shape.bounds().map(|corner| corner.z * Vec3::Z);
                    let around = Vec3::new((TAU * u).cos(), (TAU * u).sin(), 0.0);
                    let (bottom, top) = (low + radius * around, high + top_radius * around);
                    points.extend([
                        bottom.lerp(top, 0.5 * (v + 1.0)),
                        low.lerp(bottom, v),
                        high.lerp(top, v),
                    ]);
                }
                Shape::Capsule(Capsule { half_length, radius }) => {
                    let around = Vec3::new((TAU * u).cos(), (TAU * u).sin(), 0.0);
                    points.push(radius * around + v * half_length * Vec3::Z);
                    let (sine, cosine) = (0.25 * TAU * v).sin_cos();
                    points.push(
                        radius * (cosine * around + sine * Vec3::Z) + half_length * sine.signum() * Vec3::Z,
                    );
                }
                // A fourth of the lines: the points are per triangle.
                Shape::Hull(_) if i % 4 != 0 || j % 4 != 0 => {}
                Shape::Hull(ref hull) => {
                    // Both parameters from 0 to 1, beyond the diagonal folded back.
                    let (s, t) = (0.5 * (u + 1.0), 0.5 * (v + 1.0));
                    let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
                    points.extend(hull.triangles().into_iter().map(|triangle| {
                        let [a, b, c] = triangle.map(|k| hull.corners()[k as usize]);
                        a + s * (b - a) + t * (c - a)
                    }));
                }
                _ => unreachable!("not sampled"),
            }
        }
    }
    points
}

/// Deepest point of either surface inside the other shape, m; B is at the origin.
fn overlap(a: &Shape, position: Vec3, orientation: Quat, b: &Shape) -> f64 {
    let inverse = orientation.conjugate();
    let of_a = surface(a).into_iter().map(|p| b.form().signed_distance(position + orientation * p).value);
    let of_b = surface(b).into_iter().map(|p| a.form().signed_distance(inverse * (p - position)).value);
    -of_a.chain(of_b).fold(f64::INFINITY, f64::min)
}

fn contacts(a: &Collidable, position: Vec3, orientation: Quat, b: &Collidable, envelope: f64) -> Vec<Touch> {
    let mut touches = Vec::new();
    let me = Placed { form: a, position, orientation };
    let other = Placed { form: b, position: Vec3::ZERO, orientation: Quat::IDENTITY };
    body_contacts(me, other, envelope, &mut touches);
    touches
}

fn random_vector(random: &mut Pcg64) -> Vec3 {
    loop {
        let v = Vec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
        if v.length() < 1.0 {
            return v;
        }
    }
}

/// Deepest overlap, in envelopes, that motions allowed by the contacts of random near pairs lead to.
fn worst(a: &Shape, b: &Shape, cases: usize) -> f64 {
    let [form_a, form_b] = [a, b].map(|shape| Collidable::new(Geometry::single(shape.clone()).unwrap()));
    let mut random = Pcg64::seed_from_u64(1);
    let mut worst: f64 = 0.0;
    let radius = a.bounding_radius();
    for case in 0..cases {
        // Half of the cases lie nearly flat on the top, turned about the vertical.
        let (orientation, direction) = if case % 2 == 0 {
            let quarter =
                [Quat::IDENTITY, Quat::from_rotation_x(TAU / 4.0), Quat::from_rotation_y(TAU / 4.0)];
            let turn = Quat::from_rotation_z(random.random_range(0.0..TAU));
            let tilt = rotation_exponential(ENVELOPE * random_vector(&mut random));
            (tilt * turn * quarter[case / 2 % 3], Vec3::Z)
        } else {
            (rotation_exponential(3.0 * random_vector(&mut random)), random_vector(&mut random).normalize())
        };
        let aside = 0.7 * random_vector(&mut random);
        let aside = aside - aside.dot(direction) * direction;
        let (mut near, mut far) = (0.0, 3.0);
        let gap = 0.3 * ENVELOPE;
        for _ in 0..40 {
            let middle = 0.5 * (near + far);
            let touches = contacts(&form_a, aside + middle * direction, orientation, &form_b, ENVELOPE);
            let least = touches.iter().map(|t| t.gap).fold(f64::INFINITY, f64::min);
            if least < gap { near = middle } else { far = middle }
        }
        let position = aside + far * direction;
        let touches = contacts(&form_a, position, orientation, &form_b, ENVELOPE);
        if touches.is_empty() || overlap(a, position, orientation, b) > 0.0 {
            continue;
        }
        for _ in 0..12 {
            let (move_by, turn) = (random_vector(&mut random), 2.0 * random_vector(&mut random) / radius);
            // As far as all contacts allow, but no point farther than the envelope.
            let mut scale = ENVELOPE / (move_by.length() + turn.length() * radius);
            for touch in &touches {
                let rate = touch.normal.dot(move_by + turn.cross(touch.point - position));
                if rate < 0.0 {
                    scale = scale.min(touch.gap / -rate);
                }
            }
            let turned = rotation_exponential(scale * turn) * orientation;
            let deepest = overlap(a, position + scale * move_by, turned, b);
            worst = worst.max(deepest / ENVELOPE);
        }
    }
    worst
}

#[test]
fn motions_that_the_contacts_allow_do_not_overlap() {
    // Second order in the motion: a turn of ENVELOPE / radius moves points of contact by that times ENVELOPE.
    // The rim of a cylinder is held at four points, between which it is lower by 0.29 of its radius times the
    // turn.
    let cases = [
        ("capsule-box", capsule(), wide_block(), 0.1),
        ("capsule-small box", capsule(), block(), 0.1),
        ("capsule-capsule", capsule(), capsule(), 0.1),
        ("capsule-cylinder", capsule(), cylinder(), 0.1),
        ("box-box", block(), wide_block(), 0.1),
        ("box-same box", block(), block(), 0.1),
        ("cylinder-box", cylinder(), wide_block(), 0.3),
        ("cylinder-small box", cylinder(), block(), 0.3),
        ("cylinder-cylinder", cylinder(), cylinder(), 0.3),
        ("hull-hull", stone(), stone(), 0.1),
        ("hull-prism", stone(), prism(), 0.1),
        ("prism-same prism", prism(), prism(), 0.1),
        ("hull-box", stone(), wide_block(), 0.1),
        ("prism-box", prism(), wide_block(), 0.1),
        ("capsule-hull", capsule(), stone(), 0.1),
        ("capsule-prism", capsule(), prism(), 0.1),
        ("cylinder-hull", cylinder(), stone(), 0.3),
        ("cylinder-prism", cylinder(), prism(), 0.3),
        ("capsule-blunt cone", capsule(), cone(0.4), 0.1),
        ("cone-box", cone(0.0), wide_block(), 0.3),
        ("blunt cone-box", cone(0.4), wide_block(), 0.3),
        ("box-flat cone", block(), flat_cone(), 0.3),
        ("cone-cylinder", cone(0.0), cylinder(), 0.3),
        ("cone-blunt cone", cone(0.0), cone(0.4), 0.3),
        ("cone-hull", cone(0.0), stone(), 0.3),
    ];
    let found: Vec<(&str, f64, f64)> =
        cases.into_iter().map(|(name, a, b, bound)| (name, worst(&a, &b, 150), bound)).collect();
    println!("{found:.3?}");
    for (name, worst, bound) in found {
        assert!(worst <= bound, "{name}: {worst} envelopes");
    }
}

#[test]
fn all_lower_corners_of_a_tilted_box_are_contacts() {
    let form = |half: Vec3| Collidable::new(Geometry::cuboid(half).unwrap());
    let (upper, lower) = (form(Vec3::new(0.1, 0.08, 0.05)), form(Vec3::new(0.5, 0.5, 0.1)));
    let orientation = Quat::from_rotation_y(20.0_f64.to_radians());
    let corner = |x: f64, y: f64, z: f64| orientation * Vec3::new(0.1 * x, 0.08 * y, 0.05 * z);
    let lowest = corner(1.0, 1.0, -1.0).z;
    let position = Vec3::new(0.05, -0.02, 0.1 + 0.05 - lowest);
    let touches = contacts(&upper, position, orientation, &lower, 0.2);
    for (x, y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        let p = position + corner(x, y, -1.0);
        let gap = p.z - 0.1;
        let found = touches.iter().any(|touch| {
            (touch.gap - gap).abs() < 1e-9
                && (touch.normal - Vec3::Z).length() < 1e-9
                && (touch.point - p + 0.5 * gap * Vec3::Z).length() < 1e-9
        });
        assert!(found, "{p} {touches:#?}");
    }
    assert!(touches.iter().all(|touch| touch.gap >= 0.05 - 1e-9));
}

/// Aligned blocks of the same size, one resting on the other, shifted by a hair: nothing holds up sliding.
#[test]
fn a_hair_beyond_the_edge_makes_no_sideways_contact() {
    let form = Collidable::new(Geometry::cuboid(Vec3::splat(0.1)).unwrap());
    for gap in [0.0, -1e-9, 1e-12, 1e-9, 1e-6, 1e-4] {
        for shift in [0.0, 1e-17, 1e-12, 1e-9, 1e-6, 1e-4] {
            let touches = contacts(&form, Vec3::new(shift, -shift, 0.2 + gap), Quat::IDENTITY, &form, 0.05);
            assert!(touches.len() >= 4, "{gap} {shift} {touches:?}");
            for touch in touches {
                assert!(
                    (touch.normal - Vec3::Z).length() < 1e-9 && touch.gap < 0.05,
                    "{gap} {shift} {touch:?}"
                );
            }
        }
    }
}

/// Blocks diagonally apart, no face over another: the pair is found with its true distance.
#[test]
fn blocks_diagonally_apart_have_their_true_distance() {
    let form = Collidable::new(Geometry::cuboid(Vec3::splat(0.1)).unwrap());
    let touches = contacts(&form, Vec3::new(0.23, 0.05, 0.24), Quat::IDENTITY, &form, 0.1);
    let least = touches.iter().map(|touch| touch.gap).fold(f64::INFINITY, f64::min);
    assert!((least - 0.05).abs() < 1e-12, "{touches:?}");
    assert!(touches.len() >= 2, "{touches:?}");
    assert!(contacts(&form, Vec3::new(0.23, 0.05, 0.24), Quat::IDENTITY, &form, 0.049).is_empty());
}
