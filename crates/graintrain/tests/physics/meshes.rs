//! Bodies made of triangles that have a mass.

use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::collide::Collider;
use graintrain::handle::MaterialId;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepError, StepSettings, Stepper};
use graintrain::world::{Body, MassProperties, World};
use rand::{RngExt, SeedableRng};
use std::f64::consts::{PI, TAU};

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

/// A fixed or turning mesh body.
fn add_surface(world: &mut World, vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>, motion: Motion) -> usize {
    let geometry = world.add_geometry(Geometry::mesh(vertices, triangles).unwrap());
    let motion = world.add_motion(motion).unwrap();
    let body = Body { motion, ..Body::new(geometry, MaterialId::default(), Vec3::ZERO) };
    world.add_body(body).unwrap().index()
}

/// What is thin in front slides along the floor of a valley into its slope: it goes up or stops there, and
/// does not go under the slope, though the way out through its own top is shorter.
#[test]
fn wedges_slide_into_the_slope_of_a_valley() {
    let wedge: Vec<Vec3> = [(0.0, 0.0), (0.2, 0.0), (0.0, 0.067)]
        .iter()
        .flat_map(|&(x, z)| [0.0, 0.1].map(|y| Vec3::new(x, y, z)))
        .collect();
    let shapes = [
        ("wedge", Geometry::hull(&wedge).unwrap().0, 0.067 / 3.0),
        ("cone", Geometry::cone(0.06, 0.1, 0.0).unwrap(), 0.015),
        ("frustum", Geometry::cone(0.02, 0.1, 0.05).unwrap(), 0.0079),
    ];
    for (name, shape, height) in shapes {
        for (slope, step) in [(34.0_f64, 2e-3), (60.0, 2e-3), (60.0, 1e-2)] {
            let (sin, cos) = slope.to_radians().sin_cos();
            let profile = [(-1.0, 0.0), (0.0, 0.0), (0.5 * cos, 0.5 * sin), (1.5 * cos, 1.5 * sin)];
            let place = |&(x, z): &(f64, f64)| [-1.0, 0.0, 1.0].map(|y| Vec3::new(x, y, z));
            let vertices: Vec<Vec3> = profile.iter().flat_map(place).collect();
            let square = |a: u32| [[a, a + 3, a + 4], [a, a + 4, a + 1]];
            let triangles = [0, 1, 3, 4, 6, 7].into_iter().flat_map(square).collect();
            let mut world = world(0.6, 0.0);
            add_surface(&mut world, vertices, triangles, Motion::fixed());
            let geometry = world.add_geometry(shape.clone());
            let place = Vec3::new(-0.5, 0.02, height + 1e-4);
            let velocity = Vec3::new(4.0, 0.0, 0.0);
            let body = Body {
                velocity,
                orientation: Quat::from_rotation_z(0.3),
                ..Body::new(geometry, MaterialId::default(), place)
            };
            let body = world.add_body(body).unwrap().index();
            let mut stepper = stepper(step, FrictionModel::Coulomb);
            for _ in 0..(0.4 / step) as usize {
                let report = stepper.step(&mut world).unwrap();
                let overlap = report.penetration_max_over_size;
                assert!(overlap < 2e-3, "{name} {slope} {step}: {overlap}");
                let Vec3 { x, z, .. } = world.bodies.position[body];
                assert!(z > (x * sin / cos).max(0.0), "{name} {slope} {step}: {x} {z}");
            }
        }
    }
}

/// A surface that goes along this profile (x, z), flat along y between -0.5 and 0.5.
fn along(profile: &[(f64, f64)]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let vertices = profile.iter().flat_map(|&(x, z)| [-0.5, 0.5].map(|y| Vec3::new(x, y, z))).collect();
    let squares = (0..profile.len() as u32 - 1).map(|k| 2 * k);
    (vertices, squares.flat_map(|a| [[a, a + 2, a + 1], [a + 1, a + 2, a + 3]]).collect())
}

/// A box slides over a lip of two centimetres and off a cliff. At the lip it overlaps both slopes of an acute
/// ridge by a hair, of which the far one is no reason to push it back by its length.
#[test]
fn a_box_slides_over_a_lip_and_off_a_cliff() {
    for step in [2e-3, 5e-3] {
        let profile = [(-2.0, 0.0), (0.0, 0.0), (0.02, 0.02), (0.021, -2.0), (3.0, -2.0)];
        let (vertices, triangles) = along(&profile);
        let mut world = world(0.2, 0.0);
        add_surface(&mut world, vertices, triangles, Motion::fixed());
        let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.2, 0.1, 0.025)).unwrap());
        let body = Body::new(block, MaterialId::default(), Vec3::new(-0.15, 0.0, 0.046));
        world.add_body(Body { velocity: Vec3::new(2.0, 0.0, 0.0), ..body }).unwrap();
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        for _ in 0..(0.5 / step) as usize {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.overlap_corrected_max < 1e-3, "{step}: {}", report.overlap_corrected_max);
        }
        assert!(world.bodies.position[1].x > 0.3, "{step}: {}", world.bodies.position[1]);
    }
}

/// Rods lie in a scroll as chords of its outer turn, their middles nearer to the turn within: it shows them
/// one side of the outer turn and the other of the inner.
#[test]
fn rods_lie_in_a_scroll() {
    let lying = Quat::from_rotation_y(0.5 * PI);
    let shapes = [
        ("capsule", Geometry::capsule(0.22, 0.01).unwrap(), lying),
        ("cylinder", Geometry::cylinder(0.22, 0.01).unwrap(), lying),
        ("box", Geometry::cuboid(Vec3::new(0.22, 0.01, 0.01)).unwrap(), Quat::IDENTITY),
    ];
    let turn = |k: i32| TAU * f64::from(k) / 48.0;
    let at = |k: i32| (0.2 + 0.12 * f64::from(k) / 48.0, turn(k).sin_cos());
    let profile: Vec<(f64, f64)> = (0..=96).map(at).map(|(r, (sin, cos))| (r * cos, r * sin)).collect();
    for (name, shape, orientation) in shapes {
        let (vertices, triangles) = along(&profile);
        let mut world = world(0.3, 0.0);
        add_surface(&mut world, vertices, triangles, Motion::fixed());
        let rod = world.add_geometry(shape);
        let body = Body::new(rod, MaterialId::default(), Vec3::new(0.0, 0.0, -0.31));
        world.add_body(Body { orientation, ..body }).unwrap();
        let mut stepper = stepper(2e-3, FrictionModel::Coulomb);
        for _ in 0..300 {
            let overlap = stepper.step(&mut world).unwrap().penetration_max_over_size;
            assert!(overlap < 1e-3, "{name}: {overlap}");
        }
        let Vec3 { x, z, .. } = world.bodies.position[1];
        assert!(x.hypot(z) < 0.44, "{name}: {x} {z}");
    }
}

/// Without friction a drum of facets turns under what lies in it: no contact with the facets further up
/// carries it along.
#[test]
fn a_turning_drum_without_friction_carries_nothing_up() {
    let flat = Vec3::new(0.05, 0.05, 0.02);
    let shapes = [
        Geometry::cuboid(flat).unwrap(),
        Geometry::cuboid(Vec3::splat(0.01)).unwrap(),
        Geometry::cylinder(0.02, 0.05).unwrap(),
    ];
    for (shape, half_height) in shapes.into_iter().zip([0.02, 0.01, 0.02]) {
        for (facets, step) in [(96_u32, 2e-2), (384, 2e-2), (384, 5e-3)] {
            let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
            for k in 0..facets {
                let angle = TAU * f64::from(k) / f64::from(facets);
                vertices.extend([-0.2, 0.2].map(|y| 0.5 * Vec3::new(angle.cos(), 2.0 * y, angle.sin())));
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| (2 * k + i) % (2 * facets));
                triangles.extend([[a, b, c], [b, d, c]]);
            }
            let mut world = world(0.0, 0.0);
            let turning = Motion::rotating(Vec3::ZERO, Vec3::Y, Profile::Constant(-0.5));
            add_surface(&mut world, vertices, triangles, turning);
            let geometry = world.add_geometry(shape.clone());
            let place = Vec3::new(0.0, 0.0, half_height - 0.496);
            let body = world.add_body(Body::new(geometry, MaterialId::default(), place)).unwrap().index();
            let mut stepper = stepper(step, FrictionModel::Relaxed);
            for _ in 0..(0.6 / step) as usize {
                stepper.step(&mut world).unwrap();
            }
            // A flat body tips from facet to facet, which moves its centre a little.
            let angle = world.bodies.position[body].x.atan2(-world.bodies.position[body].z);
            assert!(angle.abs() < 0.05, "{half_height} {facets} {step}: {angle}");
        }
    }
}

/// Flat tiles with edges of 20 mm, in z = 0, around the origin and ahead along x: 150 by 20.
fn tiles() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let tiles = (150, 20);
    for i in 0..=tiles.0 {
        for j in 0..=tiles.1 {
            vertices.push(0.02 * Vec3::new(f64::from(i) - 5.0, f64::from(j) - 10.0, 0.0));
            if i < tiles.0 && j < tiles.1 {
                let first = (i * (tiles.1 + 1) + j) as u32;
                let [a, b, c, d] = [first, first + 1, first + tiles.1 as u32 + 1, first + tiles.1 as u32 + 2];
                triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
    }
    (vertices, triangles)
}

/// Over tiles without friction bodies slide as over a plane, whatever the shape, the speed and the step.
#[test]
fn tiles_do_not_brake_what_slides_over_them() {
    let lying = Quat::from_rotation_y(0.5 * PI);
    let hull: Vec<Vec3> = (0..8)
        .map(|k| {
            0.03 * Vec3::new(f64::from(k & 1) - 0.5, f64::from(k >> 1 & 1) - 0.5, f64::from(k >> 2) - 0.5)
        })
        .collect();
    let shapes = [
        ("capsule", Geometry::capsule(0.03, 0.01).unwrap(), lying, 0.01),
        ("cylinder", Geometry::cylinder(0.03, 0.01).unwrap(), lying, 0.01),
        ("coin", Geometry::cylinder(0.005, 0.03).unwrap(), Quat::IDENTITY, 0.005),
        ("box", Geometry::cuboid(Vec3::new(0.03, 0.02, 0.01)).unwrap(), Quat::IDENTITY, 0.01),
        ("hull", Geometry::hull(&hull).unwrap().0, Quat::IDENTITY, 0.015),
        ("ball", Geometry::sphere(0.01).unwrap(), Quat::IDENTITY, 0.01),
    ];
    let (vertices, triangles) = tiles();
    for (name, shape, orientation, height) in shapes {
        for (speed, step) in [(1.0, 5e-3), (3.0, 5e-3), (3.0, 2e-2)] {
            for turn in [0.0, 0.3] {
                let mut world = world(0.0, 0.0);
                add_surface(&mut world, vertices.clone(), triangles.clone(), Motion::fixed());
                let geometry = world.add_geometry(shape.clone());
                let orientation = Quat::from_rotation_z(turn) * orientation;
                let body =
                    Body { orientation, ..Body::new(geometry, MaterialId::default(), Vec3::Z * height) };
                let body = world.add_body(body).unwrap().index();
                world.bodies.velocity[body] = Vec3::X * speed;
                let mut stepper = stepper(step, FrictionModel::Relaxed);
                let steps = (0.8 / step) as usize;
                for k in 0..steps {
                    stepper.step(&mut world).unwrap();
                    let (v, place) = (world.bodies.velocity[body], world.bodies.position[body]);
                    let at = format!("{name} {speed} {step} {turn} {k}: {v} {place}");
                    assert!((v.x - speed).hypot(v.y) < 1e-6, "{at}");
                    assert!(v.z.abs() < 3e-3 && (place.z - height).abs() < 5e-5, "{at}");
                }
            }
        }
    }
}

/// Wheels and capsules roll over tiles as over a plane: no point of theirs that is yet to come down holds
/// them up.
#[test]
fn tiles_do_not_brake_what_rolls_over_them() {
    let axle = Quat::from_rotation_x(0.5 * PI);
    let (vertices, triangles) = tiles();
    for (name, shape, radius, off) in [
        ("coin", Geometry::cylinder(0.003, 0.03).unwrap(), 0.03, 1e-5),
        ("roller", Geometry::cylinder(0.03, 0.01).unwrap(), 0.01, 1e-5),
        ("capsule", Geometry::capsule(0.03, 0.01).unwrap(), 0.01, 1e-5),
    ] {
        for (turn, speed, step) in [(0.0, 1.0, 1e-3), (0.1, 1.0, 1e-3), (0.1, 1.0, 5e-3), (0.2, 3.0, 5e-3)] {
            let mut world = world(0.5, 0.0);
            add_surface(&mut world, vertices.clone(), triangles.clone(), Motion::fixed());
            let geometry = world.add_geometry(shape.clone());
            let turned = Quat::from_rotation_z(turn);
            let body = Body {
                orientation: turned * axle,
                ..Body::new(geometry, MaterialId::default(), Vec3::Z * radius)
            };
            let body = world.add_body(body).unwrap().index();
            let velocity = turned * Vec3::X * speed;
            world.bodies.velocity[body] = velocity;
            world.bodies.angular_velocity[body] = turned * Vec3::Y * (speed / radius);
            let mut stepper = stepper(step, FrictionModel::Coulomb);
            for k in 0..(0.8 / speed / step) as usize {
                stepper.step(&mut world).unwrap();
                let (v, place) = (world.bodies.velocity[body], world.bodies.position[body]);
                let at = format!("{name} {turn} {speed} {step} {k}: {v} {place}");
                assert!((v - velocity).length() < off * speed, "{at}");
                assert!((place.z - radius).abs() < 1e-5, "{at}");
            }
        }
    }
}

/// Boxes that stand on an edge or a corner just where tiles, slopes of a valley or four corners meet are held
/// there, and random ones fall through nothing.
#[test]
fn what_stands_on_the_borders_of_triangles_does_not_fall_through() {
    let grid = |size: f64, height: &dyn Fn(f64, f64) -> f64| {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let count = (1.0 / size).round() as u32;
        for i in 0..=count {
            for j in 0..=count {
                let [x, y] = [i, j].map(|k| size * f64::from(k) - 0.5);
                vertices.push(Vec3::new(x, y, height(x, y)));
                if i < count && j < count {
                    let a = i * (count + 1) + j;
                    let [b, c, d] = [a + 1, a + count + 1, a + count + 2];
                    triangles.extend([[a, c, b], [b, c, d]]);
                }
            }
        }
        (vertices, triangles)
    };
    let on_edge = Quat::from_rotation_y(0.25 * PI);
    let on_corner = Quat::from_rotation_arc(Vec3::ONE.normalize(), Vec3::Z);
    type Surface = fn(f64, f64) -> f64;
    let flat: Surface = |_, _| 0.0;
    let valley: Surface = |x, _| 0.3 * x.abs();
    let bumps: Surface = |x, y| 0.02 * (20.0 * x).sin() * (17.0 * y).cos();
    let slope: Surface = |x, _| 0.5 * x;
    for (surface, tile, orientation, fall) in [
        (flat, 0.1, on_edge, 0.0),
        (flat, 0.1, on_edge, 0.2),
        (valley, 0.1, on_edge, 0.0),
        (valley, 0.1, on_edge, 0.1),
        (flat, 0.1, on_corner, 0.0),
        (slope, 0.005, on_edge, 0.02),
    ] {
        for model in BOTH {
            let mut world = world(0.5, 0.0);
            let (vertices, triangles) = grid(tile, &surface);
            add_surface(&mut world, vertices, triangles, Motion::fixed());
            let geometry = world.add_geometry(Geometry::cuboid(Vec3::splat(0.05)).unwrap());
            let lowest = if orientation == on_edge { 0.05 * 2.0_f64.sqrt() } else { 0.05 * 3.0_f64.sqrt() };
            let place = Vec3::Z * (lowest + fall);
            let body = Body { orientation, ..Body::new(geometry, MaterialId::default(), place) };
            let body = world.add_body(body).unwrap().index();
            if tile < 0.01 {
                world.bodies.velocity[body] = -5.0 * Vec3::Z;
            }
            let mut stepper = stepper(5e-3, model);
            for k in 0..60 {
                stepper.step(&mut world).unwrap();
                let p = world.bodies.position[body];
                assert!(p.z > surface(p.x, p.y) + 0.045, "{tile} {fall} {model} {k}: {p}");
            }
        }
    }
    for (surface, tile) in [(flat, 0.1), (bumps, 0.025)] {
        let mut world = world(0.5, 0.0);
        let (vertices, triangles) = grid(tile, &surface);
        add_surface(&mut world, vertices, triangles, Motion::fixed());
        let geometry = world.add_geometry(Geometry::cuboid(Vec3::splat(0.04)).unwrap());
        for k in 0..16_u32 {
            let [i, j] = [k % 4, k / 4].map(|n| 0.2 * f64::from(n) - 0.3);
            let turn = f64::from(k);
            let orientation = Quat::from_rotation_x(1.3 * turn) * Quat::from_rotation_y(2.1 * turn);
            let place = Vec3::new(i, j, 0.2);
            world
                .add_body(Body { orientation, ..Body::new(geometry, MaterialId::default(), place) })
                .unwrap();
        }
        let mut stepper = stepper(5e-3, FrictionModel::Relaxed);
        for k in 0..120 {
            stepper.step(&mut world).unwrap();
            for p in &world.bodies.position[1..] {
                let beside = p.x.abs() > 0.45 || p.y.abs() > 0.45;
                assert!(beside || p.z > surface(p.x, p.y), "{tile} {k}: {p}");
            }
        }
    }
}

/// A body of this form, turned, that falls from here on a fixed mesh, after so many steps of 2 ms.
fn after_fall(
    mesh: Geometry,
    form: Geometry,
    turn: Quat,
    start: (Vec3, Vec3),
    steps: usize,
    model: FrictionModel,
) -> (World, usize) {
    let mut world = world(0.3, 0.0);
    let (mesh, form) = (world.add_geometry(mesh), world.add_geometry(form));
    let motion = world.add_motion(Motion::fixed()).unwrap();
    world.add_body(Body { motion, ..Body::new(mesh, MaterialId::default(), Vec3::ZERO) }).unwrap();
    let (position, velocity) = start;
    let body = Body { orientation: turn, velocity, ..Body::new(form, MaterialId::default(), position) };
    let body = world.add_body(body).unwrap().index();
    let mut stepper = stepper(2e-3, model);
    for _ in 0..steps {
        solved_step(&mut stepper, &mut world);
    }
    (world, body)
}

/// Bars across a mesh whose flat faces are not convex (the ends of a step, a window in a sheet): triangles
/// that lie beside the bar in the plane of the face are no reason to push it along its axis.
#[test]
fn bars_lie_on_steps_and_in_windows() {
    let profile = [(-0.5, -0.3), (0.5, -0.3), (0.5, 0.0), (0.0, 0.0), (0.0, 0.2), (-0.5, 0.2)];
    let step: Vec<Vec3> =
        [-0.5, 0.5].iter().flat_map(|&y| profile.iter().map(move |&(x, z)| Vec3::new(x, y, z))).collect();
    let mut sides =
        vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [6, 8, 7], [6, 9, 8], [6, 10, 9], [6, 11, 10]];
    sides.extend((0..6).flat_map(|k| {
        let next = (k + 1) % 6;
        [[k, k + 6, next + 6], [k, next + 6, next]]
    }));
    let ring = |r: f64| [(-r, -r), (r, -r), (r, r), (-r, r)].map(|(x, z)| Vec3::new(x, 0.0, z));
    let window = [ring(1.0), ring(0.2)].concat();
    let sheet: Vec<[u32; 3]> =
        (0..4).flat_map(|k| [[k, (k + 1) % 4, (k + 1) % 4 + 4], [k, (k + 1) % 4 + 4, k + 4]]).collect();
    let turn = Quat::from_rotation_x(PI / 2.0);
    for model in BOTH {
        for (what, form) in [
            ("capsule", Geometry::capsule(0.75, 0.05)),
            ("cylinder", Geometry::cylinder(0.75, 0.05)),
            ("box", Geometry::cuboid(Vec3::new(0.05, 0.05, 0.75))),
        ] {
            let form = form.unwrap();
            let meshes = [(&step, &sides, 0.05), (&window, &sheet, -0.15)];
            for (vertices, triangles, rest) in meshes {
                let mesh = Geometry::mesh(vertices.clone(), triangles.clone()).unwrap();
                let start = (Vec3::new(0.1, 0.0, rest + 0.05), Vec3::ZERO);
                let (world, body) = after_fall(mesh, form.clone(), turn, start, 200, model);
                let place = world.bodies.position[body];
                let off = (place - Vec3::new(0.1, 0.0, rest)).length();
                assert!(off < 1e-4, "{model:?} {what} {rest}: {place}");
            }
        }
    }
}

/// What rolls or slides over the edge of a table of triangles leaves it as it leaves a box.
#[test]
fn bodies_leave_a_mesh_as_they_leave_a_box() {
    let half = Vec3::new(1.0, 1.0, 0.15);
    let turn = Quat::from_rotation_x(-PI / 2.0);
    for (what, form, height) in [
        ("capsule", Geometry::capsule(0.2, 0.1), 0.1),
        ("cylinder", Geometry::cylinder(0.2, 0.1), 0.1),
        ("cone", Geometry::cone(0.4, 0.1, 0.1), 0.1),
        ("box", Geometry::cuboid(Vec3::new(0.1, 0.05, 0.2)), 0.05),
    ] {
        let form = form.unwrap();
        let start = (Vec3::new(0.55, 0.5, 0.15 + height), Vec3::new(2.0, -1.8, 0.0));
        let (vertices, triangles) = brick(half, 1);
        let solid = Geometry::solid_mesh(vertices.clone(), triangles.clone()).unwrap().0;
        let tables = [Geometry::cuboid(half), Geometry::mesh(vertices, triangles), Ok(solid)];
        let ends = tables.map(|table| {
            let model = FrictionModel::Coulomb;
            let (world, body) = after_fall(table.unwrap(), form.clone(), turn, start, 250, model);
            world.bodies.velocity[body]
        });
        let off = ends.map(|end| (end - ends[0]).length());
        assert!(off.iter().all(|off| *off < 5e-3), "{what}: {ends:?}");
    }
}

/// A box that slides over an edge of a free tetrahedron of triangles to where the next face has its centre
/// behind it, in free flight: as over the hull of the same points.
#[test]
fn a_box_slides_off_a_solid_mesh_as_off_a_hull() {
    let points =
        [[0.3, 0.0, -0.2], [-0.2, 0.3, -0.2], [-0.2, -0.3, -0.2], [0.0, 0.0, 0.4]].map(Vec3::from_array);
    let mut energies = Vec::new();
    for as_mesh in [false, true] {
        let mut world = world(0.3, 0.0);
        world.gravity = Vec3::ZERO;
        let triangles = vec![[2, 1, 0], [3, 0, 1], [3, 1, 2], [3, 2, 0]];
        let (tetrahedron, _) =
            if as_mesh { Geometry::solid_mesh(points.to_vec(), triangles) } else { Geometry::hull(&points) }
                .unwrap();
        let tetrahedron = world.add_geometry(tetrahedron);
        let turned =
            |axis: [f64; 3], angle: f64| Quat::from_axis_angle(Vec3::from_array(axis).normalize(), angle);
        let centre = points.iter().sum::<Vec3>() / 4.0;
        let orientation = turned([1.486_142, 0.566_084, 0.554_688], 2.120_112);
        world
            .add_body(Body {
                orientation,
                angular_velocity: Vec3::new(0.294_009, -2.133_911, -0.576_655),
                ..Body::new(tetrahedron, MaterialId::default(), orientation * centre)
            })
            .unwrap();
        let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.075, 0.15)).unwrap());
        world
            .add_body(Body {
                orientation: turned([0.430_440, -0.282_266, -1.129_171], 2.588_672),
                velocity: Vec3::new(1.162_780, 0.137_207, 1.621_455),
                angular_velocity: Vec3::new(0.899_894, -1.418_807, -2.287_529),
                ..Body::new(form, MaterialId::default(), Vec3::new(-0.496_900, -0.058_977, -0.529_637))
            })
            .unwrap();
        for (body, mass) in [(0, 5.0), (1, 1.0)] {
            let factor = mass / world.bodies.mass[body];
            world.bodies.mass[body] = mass;
            world.bodies.inertia[body] = factor * world.bodies.inertia[body];
        }
        let mut stepper = stepper(2e-3, FrictionModel::Coulomb);
        run(&mut stepper, &mut world, 250);
        energies.push(world.kinetic_energy());
    }
    assert!((energies[1] / energies[0] - 1.0).abs() < 5e-3, "{energies:?}");
}

/// Edge of the squares of [`bumps`], m, and how many there are along an edge.
const SQUARE: (f64, usize) = (6e-3, 10);

/// Random heights over a grid around the origin, as triangles, and the height of the ground over (x, y).
fn bumps(random: &mut rand_pcg::Pcg64) -> (Vec<Vec3>, Vec<[u32; 3]>, impl Fn(f64, f64) -> f64 + use<>) {
    let (edge, count) = SQUARE;
    let heights: Vec<Vec<f64>> =
        (0..=count).map(|_| (0..=count).map(|_| random.random_range(-3.8e-3..3.8e-3)).collect()).collect();
    let middle = 0.5 * edge * count as f64;
    let place =
        |i: usize, j: usize| Vec3::new(edge * i as f64 - middle, edge * j as f64 - middle, heights[i][j]);
    let vertices =
        (0..=count).flat_map(|i| (0..=count).map(move |j| (i, j))).map(|(i, j)| place(i, j)).collect();
    let number = |i: usize, j: usize| (i * (count + 1) + j) as u32;
    let squares = (0..count).flat_map(|i| (0..count).map(move |j| (i, j)));
    let halves = |(i, j): (usize, usize)| {
        let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
        [[a, b, d], [b, c, d]]
    };
    let triangles = squares.flat_map(halves).collect();
    let height = move |x: f64, y: f64| {
        let (x, y) = ((x + middle) / edge, (y + middle) / edge);
        let (i, j) = (x as usize, y as usize);
        let (x, y) = (x - i as f64, y - j as f64);
        let at = |di: usize, dj: usize| heights[i + di][j + dj];
        if x + y <= 1.0 {
            at(0, 0) + x * (at(1, 0) - at(0, 0)) + y * (at(0, 1) - at(0, 0))
        } else {
            at(1, 1) + (1.0 - x) * (at(0, 1) - at(1, 1)) + (1.0 - y) * (at(1, 0) - at(1, 1))
        }
    };
    (vertices, triangles, height)
}

/// Points of the surface of a solid of revolution of 5 mm about z, of radius r(z), or of a box, dense enough.
fn surface(of: &str) -> Vec<Vec3> {
    let steps = |count: i32| (0..=count).map(move |k| f64::from(k) / f64::from(count));
    if of == "box" {
        let sides = steps(40).flat_map(|s| steps(40).map(move |t| (2.0 * s - 1.0, 2.0 * t - 1.0)));
        let faces =
            |(s, t): (f64, f64)| [-1.0, 1.0].into_iter().flat_map(move |e| [[e, s, t], [s, e, t], [s, t, e]]);
        return sides.flat_map(faces).map(|p| Vec3::from_array(p) * Vec3::new(6e-3, 4e-3, 0.5e-3)).collect();
    }
    let ring = |(radius, z): (f64, f64)| {
        steps(120).map(move |share| {
            let (sine, cosine) = (TAU * share).sin_cos();
            Vec3::new(radius * cosine, radius * sine, z)
        })
    };
    let profile = |share: f64| match of {
        // Its centre of mass is a quarter of the height above its base.
        "cone" => (5e-3 * (1.0 - share), 0.01 * share - 2.5e-3),
        "disc" => (5e-3, 1e-3 * share - 0.5e-3),
        _ => {
            let (sine, cosine) = (TAU * (share.min(0.25) + (share - 0.75).max(0.0))).sin_cos();
            (3e-3 * sine, -3e-3 * cosine + 0.016 * (share - 0.5).clamp(-0.25, 0.25))
        }
    };
    let side: Vec<(f64, f64)> = steps(60).map(profile).collect();
    let base = steps(20).map(|share| (5e-3 * share, profile(0.0).1));
    side.into_iter().chain(base.filter(|_| of != "capsule")).flat_map(ring).collect()
}

/// What is apart from a bumpy sheet overlaps no triangle of it, however far contacts are looked for, and what
/// it cuts overlaps one: the planes of triangles do not go on beside them.
#[test]
fn what_is_apart_from_a_bumpy_sheet_overlaps_none_of_its_triangles() {
    let mut random = rand_pcg::Pcg64::seed_from_u64(5);
    for (kind, form) in [
        ("cone", Geometry::cone(0.01, 5e-3, 0.0)),
        ("disc", Geometry::cylinder(0.5e-3, 5e-3)),
        ("capsule", Geometry::capsule(4e-3, 3e-3)),
        ("box", Geometry::cuboid(Vec3::new(6e-3, 4e-3, 0.5e-3))),
    ] {
        let (form, points) = (form.unwrap(), surface(kind));
        let (mut apart, mut inside, mut missed) = (0, 0, 0);
        for case in 0..1000 {
            let (vertices, triangles, height) = bumps(&mut random);
            let mut any = |size: f64| random.random_range(-size..size);
            let orientation = Quat::from_scaled_axis(Vec3::new(any(PI), any(PI), any(PI)));
            let place = Vec3::new(any(6e-3), any(6e-3), 6e-3 + any(6e-3));
            let above = |p: &Vec3| {
                let p = place + orientation * *p;
                p.z - height(p.x, p.y)
            };
            let lowest = points.iter().map(above).fold(f64::INFINITY, f64::min);
            let highest = points.iter().map(above).fold(f64::NEG_INFINITY, f64::max);
            let mut world = world(0.3, 0.0);
            add_surface(&mut world, vertices, triangles, Motion::fixed());
            let form = world.add_geometry(form.clone());
            world.add_body(Body { orientation, ..Body::new(form, MaterialId::default(), place) }).unwrap();
            let contacts = Collider::default().contacts(&world, 0.015, 0.0);
            let deepest = contacts.iter().map(|c| c.gap).fold(f64::INFINITY, f64::min);
            // Between two of the points the ground rises by less than that.
            if lowest > 4e-4 || highest < -4e-4 {
                apart += 1;
                assert!(deepest >= 0.0, "{kind} {case}: {lowest} {highest} {deepest}");
            } else if (-1e-3..-1e-4).contains(&lowest) {
                inside += 1;
                missed += usize::from(deepest >= 0.0);
            }
        }
        // Of a tip that is through the surface beside a ridge, the ways out lead over the ridge.
        assert!(apart > 300 && inside > 30 && 50 * missed <= inside, "{kind}: {apart} {inside} {missed}");
    }
}

/// A disc whose centre lies beyond the border of a sheet tips over it as over the edge of a box; a ball and a
/// cube in a closed shell rest on its bottom, whether it counts as a solid or not.
#[test]
fn discs_tip_over_borders_and_bodies_stay_in_shells() {
    let half = Vec3::new(0.2, 0.2, 0.05);
    let tables = [false, true].map(|as_box| {
        let (vertices, triangles) = brick(half, 1);
        let top = 8..12;
        let sheet = || Geometry::mesh(vertices.clone(), triangles[top.clone()].to_vec());
        let table = if as_box { Geometry::cuboid(half) } else { sheet() };
        let disc = Geometry::cylinder(0.0025, 0.2).unwrap();
        let start = (Vec3::new(0.23, 0.003, 0.0525), Vec3::ZERO);
        let (world, body) =
            after_fall(table.unwrap(), disc, Quat::IDENTITY, start, 200, FrictionModel::Coulomb);
        (world.bodies.position[body], world.bodies.angular_velocity[body])
    });
    let [sheet, table] = tables;
    assert!(table.0.z < -0.1 && (sheet.0 - table.0).length() < 5e-3, "{tables:?}");
    assert!((sheet.1 - table.1).length() < 2e-2 * table.1.length(), "{tables:?}");
    for solid in [false, true] {
        for form in [Geometry::sphere(0.1), Geometry::cuboid(Vec3::splat(0.1))] {
            let (vertices, triangles) = brick(Vec3::splat(0.5), 1);
            let shell = if solid {
                Geometry::solid_mesh(vertices, triangles).unwrap().0
            } else {
                Geometry::mesh(vertices, triangles).unwrap()
            };
            let start = (Vec3::new(0.1, 0.2, -0.35), Vec3::ZERO);
            let turn = Quat::IDENTITY;
            let (world, body) = after_fall(shell, form.unwrap(), turn, start, 200, FrictionModel::Coulomb);
            assert!((world.bodies.position[body].z + 0.4).abs() < 1e-4, "{solid}");
        }
    }
}

/// Over the edge of a block of small triangles things slide without friction as over that of a box: a face
/// that lies on the corners of triangles has its own normal, and a disc is not pushed off the side below it.
#[test]
fn edges_of_fine_meshes_bear_faces_as_edges_of_boxes() {
    let half = Vec3::new(0.3, 0.4, 0.25);
    let tilt = Quat::from_rotation_y(0.6);
    let plank = (Geometry::cuboid(Vec3::new(0.6, 0.25, 0.025)).unwrap(), Quat::from_rotation_x(2e-3) * tilt);
    let disc = (Geometry::cylinder(0.05, 0.15).unwrap(), Quat::IDENTITY);
    let over_edge = Vec3::new(0.3, 0.01, 0.25) + plank.1 * Vec3::new(0.03, 0.0, 0.0256);
    let bodies = [(plank, over_edge, Vec3::ZERO, 0.3), (disc, Vec3::new(0.1, 0.03, 0.3), 0.3 * Vec3::X, 0.6)];
    for ((shape, orientation), place, velocity, end) in bodies {
        for (model, step) in BOTH.into_iter().flat_map(|model| [(model, 1e-3), (model, 5e-3)]) {
            let run = |cuts: Option<u32>| {
                let mut world = world(0.0, 0.0);
                if let Some(cuts) = cuts {
                    let (vertices, triangles) = brick(half, cuts);
                    add_surface(&mut world, vertices, triangles, Motion::fixed());
                } else {
                    let geometry = world.add_geometry(Geometry::cuboid(half).unwrap());
                    let motion = world.add_motion(Motion::fixed()).unwrap();
                    let block = Body::new(geometry, MaterialId::default(), Vec3::ZERO);
                    world.add_body(Body { motion, ..block }).unwrap();
                }
                let geometry = world.add_geometry(shape.clone());
                let body = Body { orientation, ..Body::new(geometry, MaterialId::default(), place) };
                let body = world.add_body(body).unwrap().index();
                world.bodies.velocity[body] = velocity;
                let mut stepper = stepper(step, model);
                for k in 0..(end / step) as usize {
                    let report = stepper.step(&mut world).unwrap();
                    assert!(report.overlap_corrected_max < 1e-3, "{k}: {}", report.overlap_corrected_max);
                }
                (world.bodies.position[body], world.bodies.velocity[body])
            };
            let (place, velocity) = run(None);
            for cuts in [1, 8, 20] {
                let (at, with) = run(Some(cuts));
                let apart = [(at - place).length(), (with - velocity).length()];
                let allowed = 0.02 * velocity.length();
                assert!(
                    apart[0] < 0.3 * allowed && apart[1] < allowed,
                    "{model:?} {step} {cuts}: {apart:?} {velocity}"
                );
            }
        }
    }
}
