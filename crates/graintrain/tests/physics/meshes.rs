//! Bodies made of triangles that have a mass.

use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::handle::MaterialId;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepError, StepSettings, Stepper};
use graintrain::world::{Body, MassProperties, World};

const BOTH: [FrictionModel; 2] = [FrictionModel::Relaxed, FrictionModel::Coulomb];

fn stepper(step: f64, friction: FrictionModel) -> Stepper {
    Stepper::new(StepSettings {
        step,
        envelope: 2e-3,
        solver: SolverChoice { tolerance: 1e-8, friction, ..SolverChoice::default() },
        ..StepSettings::default()
    })
    .unwrap()
}

/// A box of half edges h as triangles, each face cut into `cuts`^2 squares.
fn brick(h: Vec3, cuts: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let point = |i: u32, j: u32| {
                let mut p = Vec3::ZERO;
                p[axis] = sign;
                p[(axis + 1) % 3] = 2.0 * f64::from(i) / f64::from(cuts) - 1.0;
                p[(axis + 2) % 3] = 2.0 * f64::from(j) / f64::from(cuts) - 1.0;
                h * p
            };
            for (i, j) in (0..cuts).flat_map(|i| (0..cuts).map(move |j| (i, j))) {
                let first = vertices.len() as u32;
                vertices.extend([point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)]);
                let turn = |[a, b, c]: [u32; 3]| if sign > 0.0 { [a, b, c] } else { [a, c, b] };
                triangles.extend([turn([first, first + 1, first + 2]), turn([first, first + 2, first + 3])]);
            }
        }
    }
    (vertices, triangles)
}

/// A mesh of a box falls, rests and slides as the box does: friction angle below and above the slope.
#[test]
fn a_box_of_triangles_rests_and_slides_as_a_box() {
    let h = Vec3::new(0.3, 0.2, 0.1);
    for model in BOTH {
        for (tilt, slides) in [(0.0_f64, false), (0.25, false), (0.45, true)] {
            let mut ends = Vec::new();
            for as_mesh in [false, true] {
                let mut world = world(0.4, 0.0);
                let ground = add_ground(&mut world, tilt);
                let (vertices, triangles) = brick(h, 3);
                let geometry = if as_mesh {
                    Geometry::solid_mesh(vertices, triangles).unwrap().0
                } else {
                    Geometry::cuboid(h).unwrap()
                };
                let geometry = world.add_geometry(geometry);
                let orientation = Quat::from_rotation_y(tilt);
                let position = orientation * Vec3::new(0.0, 0.0, h.z);
                let body = Body { orientation, ..Body::new(geometry, MaterialId::default(), position) };
                let body = world.add_body(body).unwrap().index();
                let mut stepper = stepper(1e-3, model);
                let mut carried = Vec3::ZERO;
                for _ in 0..300 {
                    let report = stepper.step(&mut world).unwrap();
                    assert!(report.solve.converged());
                    carried = report.wrenches.iter().find(|w| w.body == ground).unwrap().force;
                }
                let weight = world.bodies.mass[body] * G;
                let normal = carried.dot(Quat::from_rotation_y(tilt) * Vec3::Z);
                assert!((normal / (weight * tilt.cos()) + 1.0).abs() < 0.02, "{model:?} {tilt}: {carried}");
                ends.push(world.bodies.velocity[body]);
            }
            let down = Quat::from_rotation_y(tilt) * Vec3::X;
            let expected = if slides { 0.3 * G * (tilt.sin() - 0.4 * tilt.cos()) } else { 0.0 };
            if model == FrictionModel::Coulomb {
                for velocity in &ends {
                    assert!(
                        (velocity.dot(down) - expected).abs() < 2e-4,
                        "{tilt}: {velocity}, not {expected}"
                    );
                }
            }
            assert!((ends[0] - ends[1]).length() < 1e-3, "{model:?} {tilt}: {} and {}", ends[0], ends[1]);
        }
    }
}

/// Balls carry a plate of triangles with its weight, and a capsule lies on top of it.
#[test]
fn a_plate_of_triangles_rests_on_balls() {
    for model in BOTH {
        let mut world = world(0.5, 0.0);
        let ground = add_ground(&mut world, 0.0);
        for (x, y) in [(-0.2, -0.2), (0.2, -0.2), (-0.2, 0.2), (0.2, 0.2), (0.0, 0.0)] {
            add_sphere(&mut world, 0.05, Vec3::new(x, y, 0.05));
        }
        let (vertices, triangles) = brick(Vec3::new(0.3, 0.3, 0.02), 2);
        // Anywhere in its own frame: what counts is the centre of mass.
        let vertices = vertices.into_iter().map(|v| v + Vec3::new(5.0, 0.0, -1.0)).collect();
        let (plate, centre) = Geometry::solid_mesh(vertices, triangles).unwrap();
        assert!((centre - Vec3::new(5.0, 0.0, -1.0)).length() < 1e-12);
        let plate = world.add_geometry(plate);
        world.add_body(Body::new(plate, MaterialId::default(), Vec3::new(0.0, 0.0, 0.12))).unwrap();
        let rod = world.add_geometry(Geometry::capsule(0.1, 0.03).unwrap());
        let orientation = Quat::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let place = Vec3::new(0.02, 0.03, 0.17);
        world.add_body(Body { orientation, ..Body::new(rod, MaterialId::default(), place) }).unwrap();
        let mut stepper = stepper(2e-3, model);
        let mut carried = 0.0;
        for _ in 0..600 {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.solve.converged() && report.contacts_missed == 0);
            carried = -report.wrenches.iter().find(|w| w.body == ground).unwrap().force.z;
        }
        let weight: f64 = world.bodies.mass[1..].iter().sum::<f64>() * G;
        assert!((carried / weight - 1.0).abs() < 1e-3, "{model:?}: {carried} N of {weight} N");
        assert!((world.bodies.position[6].z - 0.12).abs() < 1e-4, "{}", world.bodies.position[6]);
        assert!(world.bodies.velocity.iter().all(|u| u.length() < 1e-3));
    }
}

/// A surface that does not close moves with the mass and inertia that are given; impossible ones are refused.
#[test]
fn a_surface_moves_with_a_given_mass() {
    let mut world = world(0.5, 0.0);
    add_ground(&mut world, 0.0);
    let (vertices, triangles) = brick(Vec3::splat(0.1), 1);
    let shell = world.add_geometry(Geometry::mesh(vertices, triangles[2..].to_vec()).unwrap());
    let body = Body::new(shell, MaterialId::default(), Vec3::new(0.0, 0.0, 0.3));
    assert!(world.add_body(body.clone()).is_err());
    let given = |mass, inertia| Body { mass: Some(MassProperties { mass, inertia }), ..body.clone() };
    for (mass, inertia) in [
        (0.0, Mat3::IDENTITY),
        (1.0, Mat3::ZERO),
        (1.0, Mat3::from_diagonal(Vec3::new(1.0, -1.0, 1.0))),
        (1.0, Mat3::from_cols(Vec3::X, Vec3::new(0.5, 1.0, 0.0), Vec3::Z)),
    ] {
        assert!(world.add_body(given(mass, inertia)).is_err(), "{mass} {inertia:?}");
    }
    let shell = world.add_body(given(3.0, 0.02 * Mat3::IDENTITY)).unwrap().index();
    let mut stepper = stepper(1e-3, FrictionModel::Coulomb);
    let mut carried = 0.0;
    for _ in 0..600 {
        carried = -stepper.step(&mut world).unwrap().wrenches[0].force.z;
    }
    assert!((carried - 3.0 * G).abs() < 1e-3, "{carried}");
    assert!((world.bodies.position[shell].z - 0.1).abs() < 1e-3);
}

/// Two meshes do not touch: said as soon as they come near each other, not left to be seen.
#[test]
fn meshes_that_would_pass_through_each_other_stop_the_run() {
    let mut world: World = world(0.5, 0.0);
    let (vertices, triangles) = brick(Vec3::splat(0.1), 1);
    let cube = world.add_geometry(Geometry::solid_mesh(vertices, triangles).unwrap().0);
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let below = Body::new(cube, MaterialId::default(), Vec3::ZERO);
    world.add_body(Body { motion: fixed, ..below.clone() }).unwrap();
    world.add_body(Body { position: Vec3::new(0.0, 0.0, 1.0), name: "falling".into(), ..below }).unwrap();
    let mut stepper = stepper(5e-3, FrictionModel::Relaxed);
    let stopped = (0..200).find_map(|_| stepper.step(&mut world).err());
    assert!(
        matches!(&stopped, Some(StepError::Meshes { second, .. }) if second.contains("falling")),
        "{stopped:?}"
    );
    assert!(world.bodies.position[1].z > 0.3);
}
