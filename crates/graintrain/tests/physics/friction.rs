//! Sliding and rolling: A2 to A6.

use crate::support::*;
use graintrain::ccp::FrictionModel::{self, Coulomb, Relaxed};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use std::f64::consts::PI;

const UPRIGHT: [bool; 6] = [true, true, true, false, false, false];

/// A block of half height 0.1 on a plane tilted about y; `free` says which of its degrees of freedom are
/// dynamic.
fn block_on_incline(friction: f64, tilt: f64, free: [bool; 6]) -> (World, usize) {
    let mut world = world(friction, 0.0);
    add_ground(&mut world, tilt);
    let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.3, 0.3, 0.1)).unwrap());
    let motion = world.add_motion(Motion::fixed().with_free(free)).unwrap();
    let orientation = Quat::from_rotation_y(tilt);
    let position = orientation * Vec3::new(0.0, 0.0, 0.1);
    let body = world
        .add_body(Body { motion, orientation, ..Body::new(block, MaterialId::default(), position) })
        .unwrap();
    (world, body.index())
}

fn downhill(tilt: f64) -> Vec3 {
    Quat::from_rotation_y(tilt) * Vec3::X
}

fn height(world: &World, body: usize, tilt: f64) -> f64 {
    (Quat::from_rotation_y(tilt) * Vec3::Z).dot(world.bodies.position[body]) - 0.1
}

/// A2: friction holds a box on an incline for 10 000 steps.
#[test]
fn a02_block_stays_on_an_incline() {
    let tilt = 20.0_f64.to_radians();
    for model in BOTH {
        let (mut world, block) = block_on_incline(0.5, tilt, [true; 6]);
        let start = world.bodies.position[block];
        let mut stepper = stepper(1e-3, 0.01, 1e-7, model);
        run(&mut stepper, &mut world, 10_000);
        let slide = (world.bodies.position[block] - start).length();
        let speed = world.bodies.velocity[block].length();
        println!("A2 {model:?}: speed {speed:.1e} m/s, slide {slide:.1e} m");
        assert!(speed < 1e-7 && slide < 1e-6 * 0.6);
    }
}

/// A3: a = g (sin - mu cos); the relaxation opens a gap dt mu v.
#[test]
fn a03_block_slides_down_an_incline() {
    let tilt = 30.0_f64.to_radians();
    let step = 0.01;
    for (model, distance) in [(Coulomb, 1.1899), (Relaxed, 1.1878)] {
        for free in [UPRIGHT, [true; 6]] {
            let (mut world, block) = block_on_incline(0.3, tilt, free);
            let start = world.bodies.position[block];
            let mut stepper = stepper(step, 0.05, 1e-9, model);
            run(&mut stepper, &mut world, 100);
            let speed = world.bodies.velocity[block].dot(downhill(tilt));
            let slid = (world.bodies.position[block] - start).dot(downhill(tilt));
            let gap = height(&world, block, tilt);
            println!(
                "A3 {model:?} {free:?}: speed {speed:.5} m/s, slid {slid:.5} m, gap {:.4} mm",
                1e3 * gap
            );
            assert_close(speed, 2.3563, 0.003 * 2.3563, "speed");
            if model == Coulomb {
                assert_close(gap, 0.0, 1e-8, "gap");
            } else {
                assert_close(gap, step * 0.3 * speed, 0.01 * step * 0.3 * speed, "gap");
            }
            if free == UPRIGHT {
                assert_close(slid, distance, 5e-5, "distance");
            }
        }
    }
}

/// A4: thrown at 5 m/s on a flat plane with mu = 0.5.
#[test]
fn a04_thrown_block_stops() {
    let cases =
        [(Coulomb, 1e-3, 0.0), (Relaxed, 0.025, 0.2185), (Relaxed, 0.01, 0.2099), (Relaxed, 1e-3, 0.2045)];
    for (model, step, hop) in cases {
        let (mut world, block) = block_on_incline(0.5, 0.0, UPRIGHT);
        world.bodies.velocity[block] = Vec3::new(5.0, 0.0, 0.0);
        let mut stepper = stepper(step, 0.3, 1e-9, model);
        let (mut highest, mut time) = (0.0_f64, 0.0);
        while world.bodies.velocity[block].length() > 1e-6 {
            solved_step(&mut stepper, &mut world);
            highest = highest.max(height(&world, block, 0.0));
            time = world.time;
            assert!(time < 2.0);
        }
        let distance = world.bodies.position[block].x;
        println!("A4 {model:?} h={step}: distance {distance:.4} m, time {time:.4} s, hop {highest:.4} m");
        assert_close(highest, hop, 1e-4, "hop");
        if step == 1e-3 {
            assert_close(distance, 2.5459, 1e-4, "distance of the reference computation");
            assert_close(distance, 25.0 / G, 0.005 * 25.0 / G, "v0^2 / (2 mu g)");
            assert_close(time, 1.0200, 1.5e-3, "stopping time");
        }
    }
}

/// A5: a sliding sphere ends up rolling at 5/7 of its speed.
#[test]
fn a05_sphere_slips_then_rolls() {
    let radius = 0.1;
    let (friction, step) = (0.25, 2.5e-4);
    for model in BOTH {
        let mut world = world(friction, 0.0);
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius));
        world.bodies.velocity[ball] = Vec3::X;
        let mut stepper = stepper(step, 0.02, 1e-10, model);
        let (mut rolling, mut travelled, mut hop) = (None, 0.0, 0.0_f64);
        for _ in 0..1600 {
            solved_step(&mut stepper, &mut world);
            let slip = world.bodies.velocity[ball].x - radius * world.bodies.angular_velocity[ball].y;
            hop = hop.max(world.bodies.position[ball].z - radius);
            if slip < 1e-6 && rolling.is_none() {
                rolling = Some(world.time);
                travelled = world.bodies.position[ball].x;
            }
        }
        let time = rolling.unwrap();
        let speed = world.bodies.velocity[ball].x;
        println!(
            "A5 {model:?}: speed {speed:.6} m/s, rolls after {time:.4} s and {travelled:.5} m, hop {:.3} mm",
            1e3 * hop
        );
        assert_close(speed, 5.0 / 7.0, 1e-4, "speed");
        assert_close(time, 2.0 / (7.0 * friction * G), 0.01 * 0.1165, "time");
        assert_close(travelled, 12.0 / (49.0 * friction * G), 0.012 * 0.09986, "distance");
        assert_close(hop, if model == Coulomb { 0.0 } else { 2.1e-3 }, 1e-4, "hop");
    }
}

fn sphere_down_incline(friction: f64, tilt: f64, model: FrictionModel) -> (f64, f64, f64) {
    let radius = 0.1;
    let mut world = world(friction, 0.0);
    add_ground(&mut world, tilt);
    let normal = Quat::from_rotation_y(tilt) * Vec3::Z;
    let ball = add_sphere(&mut world, radius, radius * normal);
    let mut stepper = stepper(1e-3, 0.02, 1e-10, model);
    run(&mut stepper, &mut world, 500);
    let speed = world.bodies.velocity[ball].dot(downhill(tilt));
    let spin = world.bodies.angular_velocity[ball].y;
    (speed / world.time, spin / world.time, speed - radius * spin)
}

/// A6: rolls exactly if mu >= 2/7 tan(tilt).
#[test]
fn a06_sphere_on_an_incline() {
    let tilt = 30.0_f64.to_radians();
    let threshold = 2.0 / 7.0 * tilt.tan();
    for model in BOTH {
        let (rolling, _, slip) = sphere_down_incline(0.5, tilt, model);
        println!("A6 {model:?}: mu 0.5: a {rolling:.5} m/s2, slip {slip:.1e}");
        assert_close(rolling, 5.0 / 7.0 * G * tilt.sin(), 0.005 * 3.5, "rolling acceleration");
        assert!(slip.abs() < 1e-7);
        let (sliding, spin, _) = sphere_down_incline(0.1, tilt, model);
        assert_close(sliding, G * (tilt.sin() - 0.1 * tilt.cos()), 0.005 * 4.0, "sliding acceleration");
        let alpha = 2.5 * 0.1 * G * tilt.cos() / 0.1;
        assert_close(spin, alpha, 0.005 * alpha, "angular acceleration");
        let (_, _, above) = sphere_down_incline(threshold + 1e-3, tilt, model);
        let (_, _, below) = sphere_down_incline(threshold - 1e-3, tilt, model);
        println!("A6 {model:?}: slip at threshold +-1e-3 after 0.5 s: {above:.1e}, {below:.1e} m/s");
        assert!(above.abs() < 1e-7 && below > 1e-2);
    }
}

/// A cylinder on its mantle and a coin on its rim keep on rolling, and are pulled faster, when they
/// turn by more than a radian in a step: points of their rims far from the ground do not come down, other
/// points take their places. A third of the force is friction that spins the cylinder.
#[test]
fn what_rolls_may_turn_by_more_than_a_radian_in_a_step() {
    let lying = Quat::from_rotation_x(0.5 * PI);
    for (length, pull, speed, step) in
        [(0.1, 3.0, 0.0, 0.02), (0.02, 3.0, 0.0, 0.02), (0.005, 0.0, 5.0, 0.02), (0.005, 0.0, 35.0, 0.005)]
    {
        let mut world = world(0.5, 0.0);
        add_ground(&mut world, 0.0);
        let geometry = world.add_geometry(Geometry::cylinder(length, 0.05).unwrap());
        let body = Body {
            orientation: lying,
            velocity: Vec3::new(speed, 0.0, 0.0),
            angular_velocity: Vec3::new(0.0, speed / 0.05, 0.0),
            ..Body::new(geometry, MaterialId::default(), Vec3::new(0.0, 0.0, 0.05))
        };
        let body = world.add_body(body).unwrap();
        let force = Vec3::new(pull * world.bodies.mass[body.index()], 0.0, 0.0);
        world.bodies.force[body.index()] = force;
        let mut stepper = stepper(step, 1e-3, 1e-8, FrictionModel::Coulomb);
        run(&mut stepper, &mut world, (2.0 / step) as usize);
        let (v, x) = (world.bodies.velocity[body.index()], world.bodies.position[body.index()]);
        let expected = speed + 2.0 / 3.0 * pull * 2.0;
        assert!((v - Vec3::new(expected, 0.0, 0.0)).length() < 1e-4 * expected, "{length} {pull}: {v}");
        assert!((x.z - 0.05).abs() < 1e-5, "{length} {pull}: {x}");
    }
}
