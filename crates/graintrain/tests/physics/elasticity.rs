//! Contacts with stiffness and damping, and contacts that pull: A43 and A44 of `verify`, presses, every
//! production solver.

use crate::support::*;
use graintrain::handle::MaterialId;
use graintrain::material::Elasticity;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};
use std::f64::consts::PI;

const RADIUS: f64 = 0.1;

fn elastic(friction: f64, stiffness: f64, damping: f64) -> World {
    let mut world = world(friction, 0.0);
    let stuff = MaterialId::default();
    world.materials.set_pair_elasticity(stuff, stuff, Elasticity { stiffness, damping }).unwrap();
    world
}

fn plate(world: &mut World, position: Vec3, orientation: Quat, speed: Vec3) {
    let plane = world.add_geometry(Geometry::plane());
    let motion = world.add_motion(Motion::translating(speed, Profile::Constant(1.0))).unwrap();
    world
        .add_body(Body { motion, orientation, ..Body::new(plane, MaterialId::default(), position) })
        .unwrap();
}

/// A ball on a plane sinks by m g / k, a block on its four corners by a quarter of that, whoever solves it.
#[test]
fn weight_over_stiffness_is_the_compression() {
    for model in BOTH {
        for solver in ["apgd", "apgs", "pgs", "auto", "ipm", "path"] {
            let mut world = elastic(0.5, 1e4, 200.0);
            add_ground(&mut world, 0.0);
            let ball = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, RADIUS));
            let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.08, 0.05)).unwrap());
            let place = Vec3::new(1.0, 0.0, 0.05);
            let block = world.add_body(Body::new(form, MaterialId::default(), place)).unwrap().index();
            let settings = StepSettings {
                step: 1e-3,
                envelope: 0.02,
                solver: SolverChoice {
                    name: solver.parse().unwrap(),
                    tolerance: 1e-9,
                    friction: model,
                    ..SolverChoice::default()
                },
                ..StepSettings::default()
            };
            run(&mut Stepper::new(settings).unwrap(), &mut world, 1000);
            let sunk = |body: usize, height: f64| height - world.bodies.position[body].z;
            let expected = |body: usize| world.bodies.mass[body] * G / 1e4;
            assert_close(sunk(ball, RADIUS), expected(ball), 1e-8, solver);
            assert_close(sunk(block, 0.05), expected(block) / 4.0, 1e-8, solver);
        }
    }
}

/// Without gravity and damping a ball leaves a wall after half a period pi sqrt(m/k), as fast as it came.
#[test]
fn a_bounce_takes_half_a_period() {
    for model in BOTH {
        let mut world = elastic(0.3, 1e4, 0.0);
        world.gravity = Vec3::ZERO;
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, RADIUS));
        world.bodies.velocity[ball].z = -0.5;
        let half = PI * (world.bodies.mass[ball] / 1e4).sqrt();
        let step = half / 2000.0;
        let mut stepper = stepper(step, 0.02, 1e-9, model);
        let mut deepest: f64 = 0.0;
        while world.bodies.position[ball].z < RADIUS || world.time == 0.0 {
            solved_step(&mut stepper, &mut world);
            deepest = deepest.max(RADIUS - world.bodies.position[ball].z);
        }
        assert_close(world.time, half, 2e-3 * half, "half a period");
        // Implicit Euler takes omega dt pi / 2 of the amplitude in half a period.
        let kept = 1.0 - 0.5 * PI * PI / 2000.0;
        assert_close(world.bodies.velocity[ball].z, 0.5 * kept, 1e-3 * 0.5, "speed");
        assert_close(deepest, 0.5 * half / PI, 2e-3 * deepest, "compression");
    }
}

/// Pressed beyond its weight and let go, a ball follows x'' = -k x - d x' about its equilibrium while it
/// touches.
#[test]
fn a_damped_oscillator() {
    for model in BOTH {
        let (stiffness, damping) = (1e4, 30.0);
        let mut world = elastic(0.3, stiffness, damping);
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, RADIUS, Vec3::ZERO);
        let mass = world.bodies.mass[ball];
        let (rest, pressed) = (mass * G / stiffness, 0.8 * mass * G / stiffness);
        world.bodies.position[ball].z = RADIUS - rest - pressed;
        let (omega, decay) = ((stiffness / mass).sqrt(), 0.5 * damping / mass);
        let damped = (omega * omega - decay * decay).sqrt();
        let mut stepper = stepper(2e-5, 0.02, 1e-10, model);
        for _ in 0..10 {
            run(&mut stepper, &mut world, 1000);
            let t = world.time;
            let phase = (damped * t).cos() + decay / damped * (damped * t).sin();
            let expected = -pressed * (-decay * t).exp() * phase;
            let found = world.bodies.position[ball].z - RADIUS + rest;
            assert_close(found, expected, 0.02 * pressed, "position");
        }
    }
}

/// Between two plates that close without mercy a rigid ball has no solution; an elastic one carries k times
/// the compression of each side.
#[test]
fn a_press_that_would_be_infeasible_has_the_force_of_its_springs() {
    for model in BOTH {
        let mut world = elastic(0.3, 1e6, 0.0);
        world.gravity = Vec3::ZERO;
        plate(&mut world, Vec3::ZERO, Quat::IDENTITY, Vec3::ZERO);
        let down = Quat::from_rotation_x(PI);
        plate(&mut world, Vec3::new(0.0, 0.0, 2.0 * RADIUS), down, Vec3::new(0.0, 0.0, -0.01));
        add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, RADIUS));
        let mut stepper = stepper(1e-3, 0.02, 1e-9, model);
        let mut force = 0.0;
        for _ in 0..500 {
            let report = solved_step(&mut stepper, &mut world);
            force = report.wrenches[0].force.z;
            assert_eq!(report.overlap_corrected_max, 0.0);
        }
        // 5 mm, half on each side.
        assert_close(force, -1e6 * 2.5e-3, 1e-3 * 2500.0, "force");
    }
}

/// Stiffness without bound is the rigid contact; mass ratios of 1e6 and sizes of 30 stay solved.
#[test]
fn stiff_contacts_are_rigid_and_light_bodies_carry_heavy_ones() {
    for model in BOTH {
        let tower = |elasticity: Elasticity| {
            let mut world = world(0.5, 0.0);
            let stuff = MaterialId::default();
            world.materials.set_pair_elasticity(stuff, stuff, elasticity).unwrap();
            add_ground(&mut world, 0.0);
            let small = add_sphere(&mut world, RADIUS / 30.0, Vec3::new(0.0, 0.0, RADIUS / 30.0));
            let large = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, RADIUS * (1.0 + 2.0 / 30.0)));
            world.bodies.mass[large] = 1e6 * world.bodies.mass[small];
            let mut stepper = stepper(1e-3, 0.003, 1e-8, model);
            run(&mut stepper, &mut world, 20);
            [small, large].map(|body| world.bodies.position[body])
        };
        let rigid = tower(Elasticity::RIGID);
        let stiff = tower(Elasticity { stiffness: 1e14, damping: 0.0 });
        for (a, b) in rigid.iter().zip(&stiff) {
            assert!((a - b).length() < 1e-8, "{model}: {a} {b}");
        }
    }
}

/// A stiffness that is all but nothing lets bodies through, whatever the smallness of the number.
#[test]
fn the_softest_contacts_do_not_break_the_step() {
    for stiffness in [1e-6, 1e-300, 5e-324] {
        let mut world = elastic(0.5, stiffness, 0.0);
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, RADIUS));
        run(&mut stepper(1e-3, 0.02, 1e-9, BOTH[0]), &mut world, 50);
        assert_close(world.bodies.velocity[ball].z, -G * 0.05, 1e-6, "free fall");
    }
}

/// A ball hangs from a plate by F > m g, a block holds on a wall by mu F > m g; with less they fall freely,
/// with m g in the ledger.
#[test]
fn cohesion_carries_up_to_its_force() {
    for model in BOTH {
        for (share, holds) in [(1.02, true), (0.98, false)] {
            let mut world = world(0.5, 0.0);
            let stuff = MaterialId::default();
            plate(&mut world, Vec3::ZERO, Quat::from_rotation_x(PI), Vec3::ZERO);
            let ball = add_sphere(&mut world, RADIUS, Vec3::new(0.0, 0.0, -RADIUS));
            let weight = G * world.bodies.mass[ball];
            world.materials.set_pair_cohesion(stuff, stuff, share * weight).unwrap();
            let start = world.bodies.position[ball];
            let mut stepper = stepper(1e-3, 0.02, 1e-9, model);
            let mut on_plate = Vec3::ZERO;
            for _ in 0..300 {
                on_plate = solved_step(&mut stepper, &mut world).wrenches[0].force;
            }
            let way = (world.bodies.position[ball] - start).length();
            if holds {
                assert!(way < 1e-7, "{model}: {way:e}");
                assert_close(on_plate.z, -weight, 1e-6 * weight, "force on the plate");
            } else {
                // 2 % of g while it touches, then all of it.
                assert!(way > 0.2 && on_plate == Vec3::ZERO, "{model}: {way} {on_plate}");
            }

            let mut world = world_of_wall(share, 0.5);
            let block = 1;
            let start = world.bodies.position[block];
            let mut stepper = crate::support::stepper(1e-3, 0.02, 1e-9, model);
            run(&mut stepper, &mut world, 300);
            let way = (world.bodies.position[block] - start).length();
            assert!(if holds { way < 1e-6 } else { way > 5e-3 }, "{model}: {way:e}");
        }
    }
}

/// A block whose face lies on the wall x <= 0 and that pulls with `share` of what friction mu needs to carry
/// it.
fn world_of_wall(share: f64, mu: f64) -> World {
    let mut world = world(mu, 0.0);
    let stuff = MaterialId::default();
    plate(&mut world, Vec3::ZERO, Quat::from_rotation_y(PI / 2.0), Vec3::ZERO);
    // Flat, so that its weight does not tip it off the wall.
    let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.001, 0.1, 0.1)).unwrap());
    let place = Vec3::new(0.001, 0.0, 0.0);
    let block = world.add_body(Body::new(form, MaterialId::default(), place)).unwrap().index();
    let weight = G * world.bodies.mass[block];
    world.materials.set_pair_cohesion(stuff, stuff, share * weight / mu).unwrap();
    world
}

/// A block that slides down a wall to which it sticks: z = -(g - mu F / m) t^2 / 2.
#[test]
fn what_sticks_and_slides_goes_on_sticking() {
    for step in [1e-3, 5e-3] {
        let mu = 0.3;
        let mut world = world(mu, 0.0);
        let plane = world.add_geometry(Geometry::plane());
        let motion = world.add_motion(Motion::fixed()).unwrap();
        let orientation = Quat::from_rotation_arc(Vec3::Z, Vec3::X);
        let wall = Body::new(plane, MaterialId::default(), Vec3::ZERO);
        world.add_body(Body { motion, orientation, ..wall }).unwrap();
        let form = world.add_geometry(Geometry::cuboid(Vec3::splat(0.05)).unwrap());
        let block = world.add_body(Body::new(form, MaterialId::default(), 0.05 * Vec3::X)).unwrap().index();
        let stuff = MaterialId::default();
        let pull = 30.0 * world.bodies.mass[block];
        world.materials.set_pair_cohesion(stuff, stuff, pull).unwrap();
        let mut stepper =
            Stepper::new(StepSettings { step, envelope: 5e-3, ..StepSettings::default() }).unwrap();
        run(&mut stepper, &mut world, (0.5 / step) as usize);
        let expected = -0.5 * (G - mu * 30.0) * world.time * world.time;
        assert_close(world.bodies.position[block].z, expected, 0.03 * expected.abs(), &format!("{step} s"));
    }
}

/// What flies past a surface without having touched it is not pulled to it, however fast.
#[test]
fn cohesion_does_not_reach_what_flies_past() {
    let mut world = world(0.5, 0.0);
    world.gravity = Vec3::ZERO;
    add_ground(&mut world, 0.0);
    let ball = add_sphere(&mut world, 0.02, Vec3::new(0.0, 0.0, 0.025));
    world.bodies.velocity[ball] = 5.0 * Vec3::X;
    let stuff = MaterialId::default();
    world.materials.set_pair_cohesion(stuff, stuff, 50.0).unwrap();
    let settings = StepSettings { step: 5e-3, envelope: 0.02, ..StepSettings::default() };
    let mut stepper = Stepper::new(settings).unwrap();
    for _ in 0..60 {
        solved_step(&mut stepper, &mut world);
        assert!(world.bodies.velocity[ball].z >= 0.0, "{}", world.bodies.velocity[ball]);
    }
}
