//! Mesh, cylinder, capsule: A21 to A23.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, world};
use super::source::Source;
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel;
use std::f64::consts::FRAC_PI_2;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A21",
        title: "Sphere on a triangle mesh",
        setup: "A sphere falls 2 cm at 1 m/s along a flat mesh of triangles and across their edges, mu = 0.25, for 0.5 s; and again on a plane.",
        sources: &[Source::Algebra("a flat mesh is a plane: the same path")],
        measure: Measure::Small(mesh),
    },
    Definition {
        id: "A22",
        title: "Cylinder",
        setup: "A solid cylinder lies across a plane tilted by 20 degrees with mu = 0.5 and rolls; it is thrown along a level plane at 1 m/s \
                with mu = 0.25; and it stands upright on the tilted plane.",
        sources: &[Source::Algebra(
            "it rolls with 2/3 g sin; thrown it ends up rolling at 2/3 v; standing it stays, since its axis falls within its foot and tan 20 degrees < mu",
        )],
        measure: Measure::Small(cylinder),
    },
    Definition {
        id: "A23",
        title: "Capsule that falls on a box",
        setup: "A capsule tilted by 30, 60 or 85 degrees from the vertical falls from 0.2 m on a fixed box, mu = 0.5, e = 0, dt = 1 and 5 ms, 1.5 s.",
        sources: &[Source::Algebra("it comes to rest lying on the face; rigid bodies do not overlap")],
        measure: Measure::Small(capsule),
    },
];

/// A square of 16 x 16 cells of two triangles each, with edges of 5 cm, at z = 0.
fn flat_mesh() -> Result<Geometry, VerifyError> {
    let cells = 16_u32;
    let mut vertices = Vec::new();
    for k in 0..(cells + 1).pow(2) {
        let (i, j) = (f64::from(k % (cells + 1)), f64::from(k / (cells + 1)));
        vertices.push(Vec3::new(0.05 * i - 0.4, 0.05 * j - 0.4, 0.0));
    }
    let mut triangles = Vec::new();
    for k in 0..cells * cells {
        let corner = k % cells + k / cells * (cells + 1);
        let above = corner + cells + 1;
        triangles.extend([[corner, corner + 1, above + 1], [corner, above + 1, above]]);
    }
    Ok(Geometry::mesh(vertices, triangles)?)
}

fn mesh() -> Result<Vec<Row>, VerifyError> {
    let (radius, step) = (0.03, 1e-3);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-10) {
            let run = |ground: Geometry| -> Result<(Bench, World, f64), VerifyError> {
                let mut world = world(0.25, 0.0)?;
                let ground = world.add_geometry(ground);
                let fixed = world.add_motion(Motion::fixed())?;
                world.add_body(Body {
                    motion: fixed,
                    ..Body::new(ground, MaterialId::default(), Vec3::ZERO)
                })?;
                let start = Vec3::new(-0.353, -0.017, radius + 0.02);
                let ball = add_sphere(&mut world, radius, start)?;
                world.bodies.velocity[ball] = Vec3::new(1.0, 0.1, 0.0);
                let mut bench = Bench::new(step, 3e-3, accuracy, model)?;
                let mut overlap: f64 = 0.0;
                for _ in 0..500 {
                    overlap = overlap.max(bench.step(&mut world)?.penetration_max);
                }
                Ok((bench, world, overlap))
            };
            let (_, plane, _) = run(Geometry::plane())?;
            let (bench, mesh, overlap) = run(flat_mesh()?)?;
            let apart = (plane.bodies.position[1] - mesh.bodies.position[1]).length();
            let spin = (plane.bodies.angular_velocity[1] - mesh.bodies.angular_velocity[1]).length() * radius;
            rows.push(bench.row(
                "distance of the two paths' ends (m)",
                apart,
                0.0,
                accuracy.allowed(1e-8, 0.5),
            ));
            rows.push(bench.row("difference of R omega (m/s)", spin, 0.0, accuracy.allowed(1e-8, 1.0)));
            rows.push(bench.row("deepest overlap over R (1)", overlap / radius, 0.0, 0.02));
        }
    }
    Ok(rows)
}

/// A cylinder of radius 0.1 and length 0.3 on a tilted plane, its axis along the plane's normal or across the
/// slope.
fn on_slope(friction: f64, tilt: f64, standing: bool) -> Result<(World, usize), VerifyError> {
    let (radius, half_length) = (0.1, 0.15);
    let mut world = world(friction, 0.0)?;
    add_ground(&mut world, tilt)?;
    let form = world.add_geometry(Geometry::cylinder(half_length, radius)?);
    let turn = Quat::from_rotation_y(tilt);
    let (height, own) =
        if standing { (half_length, Quat::IDENTITY) } else { (radius, Quat::from_rotation_x(FRAC_PI_2)) };
    let body =
        Body { orientation: turn * own, ..Body::new(form, MaterialId::default(), height * (turn * Vec3::Z)) };
    let body = world.add_body(body)?.index();
    Ok((world, body))
}

fn cylinder() -> Result<Vec<Row>, VerifyError> {
    let (tilt, step) = (20.0_f64.to_radians(), 1e-3);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-8) {
            let bench = || Bench::new(step, 0.01, accuracy, model);
            let (mut world, body) = on_slope(0.5, tilt, false)?;
            let mut rolling = bench()?;
            rolling.steps(&mut world, 500)?;
            let downhill = Quat::from_rotation_y(tilt) * Vec3::X;
            let a = world.bodies.velocity[body].dot(downhill) / world.time;
            let expected = 2.0 / 3.0 * G * tilt.sin();
            rows.push(rolling.row("rolling: acceleration (m/s^2)", a, expected, 0.005 * expected));
            let (mut world, body) = on_slope(0.25, 0.0, false)?;
            world.bodies.velocity[body] = Vec3::X;
            let mut thrown = bench()?;
            thrown.steps(&mut world, 500)?;
            let speed = world.bodies.velocity[body].x;
            rows.push(thrown.row("thrown: speed once rolling (m/s)", speed, 2.0 / 3.0, 0.005 * 2.0 / 3.0));
            let (mut world, body) = on_slope(0.5, tilt, true)?;
            let start = world.bodies.position[body];
            let mut standing = bench()?;
            standing.steps(&mut world, 2000)?;
            let way = (world.bodies.position[body] - start).length();
            rows.push(standing.row("standing: way in 2 s (m)", way, 0.0, 6e-7));
        }
    }
    Ok(rows)
}

/// Deepest overlap over R, speed at the end and tilt of the axis from the horizontal at the end.
fn falling_capsule(
    tilt: f64,
    step: f64,
    accuracy: Accuracy,
    model: FrictionModel,
) -> Result<(Bench, [f64; 3]), VerifyError> {
    let radius = 0.01;
    let mut world = world(0.5, 0.0)?;
    let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.2))?);
    let fixed = world.add_motion(Motion::fixed())?;
    world.add_body(Body {
        motion: fixed,
        ..Body::new(block, MaterialId::default(), Vec3::new(0.0, 0.0, -0.2))
    })?;
    let rod = world.add_geometry(Geometry::capsule(0.02, radius)?);
    let orientation = Quat::from_rotation_y(tilt.to_radians());
    let body = Body { orientation, ..Body::new(rod, MaterialId::default(), Vec3::new(0.0, 0.0, 0.2)) };
    let body = world.add_body(body)?.index();
    let mut bench = Bench::new(step, 0.1 * radius, accuracy, model)?;
    let mut deepest: f64 = 0.0;
    while world.time < 1.5 {
        deepest = deepest.max(bench.step(&mut world)?.penetration_max);
    }
    let axis = world.bodies.orientation[body] * Vec3::Z;
    Ok((bench, [deepest / radius, world.bodies.velocity[body].length(), axis.z.abs().asin()]))
}

fn capsule() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for tilt in [30.0, 60.0, 85.0] {
            for step in [1e-3, 5e-3] {
                let accuracy = Accuracy::SCENES;
                let (bench, [overlap, speed, lean]) = falling_capsule(tilt, step, accuracy, model)?;
                let row = |what: &str, measured, allowed| {
                    bench.row(format!("{tilt} degrees: {what}"), measured, 0.0, allowed)
                };
                rows.push(row("deepest overlap over R (1)", overlap, 0.02));
                rows.push(row("speed at the end (m/s)", speed, accuracy.promise() * G * step));
                rows.push(row("tilt at the end (rad)", lean, 1e-3));
            }
        }
    }
    Ok(rows)
}
