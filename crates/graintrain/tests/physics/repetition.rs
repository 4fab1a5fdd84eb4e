//! What makes a step be made again: seams that bar no way, and turning bodies that meet elsewhere than
//! foreseen. Default solver and tolerance.

use crate::support::*;
use graintrain::ccp::FrictionModel;
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3, rotation_exponential};
use graintrain::motion::Motion;
use graintrain::shape::{Geometry, Part};
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::Body;

fn default_stepper(step: f64, friction: FrictionModel) -> Stepper {
    Stepper::new(StepSettings {
        step,
        solver: SolverChoice { friction, ..SolverChoice::default() },
        ..StepSettings::default()
    })
    .unwrap()
}

/// A number in [-1, 1] of a sequence without order (the golden ratio's multiples).
fn centred(k: usize) -> f64 {
    2.0 * scattered(k as u32, 0.0) - 1.0
}

/// A ball and a box with another one on top slide at 1.5 m/s over nine seams of fixed tiles without friction:
/// nothing brakes or lifts them. (The edge of the next tile, seen as a plane, would stop the box and throw up
/// the ball.)
#[test]
fn seams_of_a_floor_do_not_hold_up_what_slides() {
    for (model, step) in [(BOTH[0], 2e-3), (BOTH[0], 5e-3), (BOTH[1], 2e-3)] {
        let mut world = world(0.0, 0.0);
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let tile = world.add_geometry(Geometry::cuboid(Vec3::new(0.05, 0.25, 0.025)).unwrap());
        for k in 0..13 {
            let place = Vec3::new(0.1 * f64::from(k), 0.0, -0.025);
            world.add_body(Body { motion: fixed, ..Body::new(tile, MaterialId::default(), place) }).unwrap();
        }
        let ball = world.add_geometry(Geometry::sphere(0.02).unwrap());
        let cube = world.add_geometry(Geometry::cuboid(Vec3::splat(0.02)).unwrap());
        let velocity = Vec3::new(1.5, 0.0, 0.0);
        for (form, place) in [
            (ball, Vec3::new(0.0, 0.1, 0.02)),
            (cube, Vec3::new(0.013, 0.0, 0.02)),
            (cube, Vec3::new(0.013, 0.0, 0.06)),
        ] {
            world.add_body(Body { velocity, ..Body::new(form, MaterialId::default(), place) }).unwrap();
        }
        let mut stepper = default_stepper(step, model);
        run(&mut stepper, &mut world, (0.6 / step) as usize);
        for body in 13..16 {
            let moved = (world.bodies.velocity[body] - velocity).length();
            assert!(moved < 1e-6, "{model:?}, {step} s, body {body}: {:?}", world.bodies.velocity[body]);
        }
    }
}

/// Balls and turned boxes fall on one another from up to 3.5 m, in steps in which the boxes come to turn by
/// 0.3 rad.
#[test]
fn balls_and_boxes_that_fall_in_a_heap_do_not_enter_each_other() {
    for model in BOTH {
        let mut world = world(0.4, 0.0);
        add_ground(&mut world, 0.0);
        let ball = world.add_geometry(Geometry::sphere(0.05).unwrap());
        let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.05, 0.04, 0.03)).unwrap());
        for k in 0..30 {
            let place = Vec3::new(0.1 * centred(3 * k), 0.1 * centred(3 * k + 1), 0.1 + 0.12 * k as f64);
            let orientation = rotation_exponential(Vec3::new(1.0, 2.0, 3.0) * centred(3 * k + 2));
            let form = if k % 3 == 0 { block } else { ball };
            world.add_body(Body { orientation, ..Body::new(form, MaterialId::default(), place) }).unwrap();
        }
        let mut stepper = default_stepper(5e-3, model);
        for step in 0..240 {
            let report = solved_step(&mut stepper, &mut world);
            let overlap = report.penetration_max_over_size;
            assert!(overlap < 0.005 && report.contacts_missed == 0, "{model:?}, step {step}: {overlap}");
        }
    }
}

/// Boxes and capsules that fly and spin among six walls with e = 1 and without friction: their energy is
/// kept, and none enters another one.
#[test]
fn an_elastic_gas_of_boxes_and_capsules_does_not_overlap() {
    let mut world = world(0.0, 1.0);
    world.gravity = Vec3::ZERO;
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    for inward in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z] {
        let orientation = Quat::from_rotation_arc(Vec3::Z, inward);
        let wall = Body::new(plane, MaterialId::default(), -0.2 * inward);
        world.add_body(Body { motion: fixed, orientation, ..wall }).unwrap();
    }
    let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.025, 0.025, 0.02)).unwrap());
    let capsule = world.add_geometry(Geometry::capsule(0.015, 0.02).unwrap());
    for k in 0..27 {
        let place = 0.12 * Vec3::new((k % 3) as f64 - 1.0, (k / 3 % 3) as f64 - 1.0, (k / 9) as f64 - 1.0);
        let random = |first: usize| Vec3::new(centred(first), centred(first + 1), centred(first + 2));
        let form = if k % 2 == 0 { block } else { capsule };
        let (velocity, angular_velocity) = (4.0 * random(7 * k), 30.0 * random(7 * k + 3));
        world
            .add_body(Body { velocity, angular_velocity, ..Body::new(form, MaterialId::default(), place) })
            .unwrap();
    }
    let before = world.kinetic_energy();
    let mut stepper = default_stepper(2e-3, FrictionModel::Relaxed);
    for step in 0..250 {
        let overlap = solved_step(&mut stepper, &mut world).penetration_max_over_size;
        assert!(overlap < 0.01, "step {step}: {overlap}");
    }
    assert_close(world.kinetic_energy() / before, 1.0, 5e-3, "energy");
}

/// A thin plate slides over a flat mesh and over flush boxes of one body in steps in which it would fall by a
/// tenth of its thickness and more, and goes on. (The edge of the next triangle or box stopped it within a
/// step: what it would fall in the step hid that it passes freely.)
#[test]
fn seams_do_not_stop_a_thin_plate_in_long_steps() {
    let lattice = |k: u32| f64::from(k) * 0.5 - 1.5;
    let vertices = (0..49).map(|k: u32| Vec3::new(lattice(k % 7), lattice(k / 7), 0.0)).collect();
    let cell = |k: u32| 7 * (k / 6) + k % 6;
    let triangles = (0..36).map(cell).flat_map(|v| [[v, v + 1, v + 8], [v, v + 8, v + 7]]).collect();
    let boxes = (0..6).map(|k| Part {
        shape: Geometry::cuboid(Vec3::new(0.25, 1.5, 0.2)).unwrap().parts[0].shape.clone(),
        position: Vec3::new(0.5 * f64::from(k) - 0.25, 0.0, -0.2),
        orientation: Quat::IDENTITY,
    });
    let (row, centre) = Geometry::compound(boxes.collect()).unwrap();
    let mesh = Geometry::mesh(vertices, triangles).unwrap();
    for (floor, place, speed, step) in [
        (&mesh, Vec3::ZERO, 1.0, 1e-2),
        (&mesh, Vec3::ZERO, 1.0, 2e-2),
        (&row, centre, 5.0, 1e-2),
        (&row, centre, 5.0, 2e-2),
    ] {
        let mut world = world(0.0, 0.0);
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let floor = world.add_geometry(floor.clone());
        world.add_body(Body { motion: fixed, ..Body::new(floor, MaterialId::default(), place) }).unwrap();
        let plate = world.add_geometry(Geometry::cuboid(Vec3::new(0.15, 0.15, 0.005)).unwrap());
        let velocity = speed * Vec3::X;
        let start = Vec3::new(-0.2, 0.03, 0.005);
        world.add_body(Body { velocity, ..Body::new(plate, MaterialId::default(), start) }).unwrap();
        let mut stepper = default_stepper(step, FrictionModel::Relaxed);
        run(&mut stepper, &mut world, (0.3 / step) as usize);
        let moved = (world.bodies.velocity[1] - velocity).length();
        assert!(moved < 1e-6 * speed, "{step} s: {:?}", world.bodies.velocity[1]);
    }
}

/// A kerb of half its thickness stops a plate in steps in which it would fall by nearly all of it. (Relaxed
/// friction would carry it over: dt mu |u_t| is more than the height of the kerb.)
#[test]
fn a_kerb_stops_a_thin_plate_in_long_steps() {
    for (model, friction, step) in BOTH
        .into_iter()
        .zip([0.0, 0.05])
        .flat_map(|(model, mu)| [1e-3, 1e-2, 3e-2].map(|step| (model, mu, step)))
    {
        let mut world = world(friction, 0.0);
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        for (half, place) in [([2.0, 1.0, 0.1], [0.0, 0.0, -0.1]), ([0.5, 1.0, 0.1], [1.5, 0.0, -0.095])] {
            let form = world.add_geometry(Geometry::cuboid(half.into()).unwrap());
            let body = Body::new(form, MaterialId::default(), place.into());
            world.add_body(Body { motion: fixed, ..body }).unwrap();
        }
        let plate = world.add_geometry(Geometry::cuboid(Vec3::new(0.2, 0.2, 0.005)).unwrap());
        let start = Vec3::new(0.0, 0.0, 0.005);
        let body = Body::new(plate, MaterialId::default(), start);
        world.add_body(Body { velocity: 5.0 * Vec3::X, ..body }).unwrap();
        let settings = StepSettings {
            step,
            envelope: 0.02,
            solver: SolverChoice { friction: model, ..SolverChoice::default() },
            ..StepSettings::default()
        };
        let mut stepper = Stepper::new(settings).unwrap();
        run(&mut stepper, &mut world, (0.6 / step) as usize);
        let place = world.bodies.position[2];
        assert!(place.x < 0.801, "{model} {step} s: {place}");
    }
}

/// Discs that wobble nearly flat change the place where they stand by a tenth of a radian of their rim in a
/// step: what the planes of contacts do not foresee of that is removed at the end of the step.
#[test]
fn discs_that_wobble_do_not_sink() {
    for (model, step) in BOTH.into_iter().zip([2e-3, 1e-3]) {
        let mut world = world(0.4, 0.0);
        add_ground(&mut world, 0.0);
        let disc = world.add_geometry(Geometry::cylinder(0.005, 0.05).unwrap());
        for k in 0..8 {
            let orientation = rotation_exponential(Vec3::new(1.0, 2.0, 0.3) * centred(3 * k + 2));
            let place = Vec3::new(3.0 * k as f64, 0.0, 0.4);
            let body = Body { orientation, ..Body::new(disc, MaterialId::default(), place) };
            let body = world.add_body(body).unwrap().index();
            world.bodies.velocity[body] = 3.0 * Vec3::new(centred(k), centred(k + 9), centred(k + 23));
            world.bodies.angular_velocity[body] =
                16.0 * Vec3::new(centred(k + 5), centred(k + 11), centred(k + 31));
        }
        let mut stepper = default_stepper(step, model);
        for k in 0..(1.5 / step) as usize {
            let report = solved_step(&mut stepper, &mut world);
            let overlap = report.penetration_max_over_size;
            assert!(overlap < 0.005, "{model:?}, step {k}: {overlap}");
        }
    }
}

/// Boxes and beams that turn at up to 60 rad/s fall on each other without friction, 5 ms: what displacements
/// and turns leave stays below 1 % of a size.
#[test]
fn boxes_that_turn_fast_fall_on_each_other() {
    let sizes = [[0.3, 0.15, 0.15], [0.3, 0.05, 0.05], [0.05, 0.3, 0.025], [0.025, 0.025, 0.025]];
    for seed in 0..8 {
        let mut world = world(0.0, 0.0);
        add_ground(&mut world, 0.0);
        for (layer, k) in (0..10).zip(100 * seed..) {
            let number = |i: usize| centred(17 * k + 7 * i + 3);
            let vector = |i: usize| Vec3::new(number(i), number(i + 1), number(i + 2));
            let half = Vec3::from_array(sizes[(k * 5 + 3 * layer) % 4]);
            let geometry = world.add_geometry(Geometry::cuboid(half).unwrap());
            let place = Vec3::new(0.25 * number(0), 0.25 * number(1), 0.6 + 0.75 * layer as f64);
            let mut body = Body::new(geometry, MaterialId::default(), place);
            body.orientation = rotation_exponential(2.0 * vector(2));
            body.velocity = Vec3::new(0.0, 0.0, -7.0 - 5.0 * number(5));
            body.angular_velocity = Vec3::new(8.0 * number(6), 8.0 * number(7), 60.0 * number(8));
            world.add_body(body).unwrap();
        }
        let mut stepper = default_stepper(5e-3, BOTH[0]);
        for step in 0..120 {
            let report = stepper.step(&mut world).unwrap();
            let overlap = report.penetration_max_over_size;
            assert!(report.solve.converged() && overlap < 0.01, "{seed} {step}: {overlap}");
        }
    }
}

/// A pyramid of boxes at a tolerance of 1e-2: what displacements remove at one contact does not stay as
/// overlap at the next.
#[test]
fn a_pyramid_at_a_loose_tolerance_does_not_sink() {
    let mut world = world(0.6, 0.0);
    add_ground(&mut world, 0.0);
    let cube = world.add_geometry(Geometry::cuboid(Vec3::splat(0.5)).unwrap());
    for level in 0..16 {
        for k in 0..16 - level {
            let place = Vec3::new(0.5 * f64::from(level) + f64::from(k), 0.0, f64::from(level) + 0.5);
            world.add_body(Body::new(cube, MaterialId::default(), place)).unwrap();
        }
    }
    let solver = SolverChoice { tolerance: 1e-2, ..SolverChoice::default() };
    let mut stepper =
        Stepper::new(StepSettings { step: 1.0 / 60.0, solver, ..StepSettings::default() }).unwrap();
    let mut worst = 0.0_f64;
    for _ in 0..200 {
        let report = stepper.step(&mut world).unwrap();
        assert!(report.solve.converged());
        worst = worst.max(report.penetration_max_over_size);
    }
    assert!(worst < 0.008, "{worst}");
}
