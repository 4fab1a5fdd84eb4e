//! Bodies that fly are met where they are: nothing acts on them in the air, and they part with e times the
//! velocity of the touch, at whatever part of a step that is.

use crate::support::*;
use graintrain::handle::{BodyId, GeometryId, MaterialId};
use graintrain::joint::Joint;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, MassProperties, World};
use std::f64::consts::PI;

/// A form, how it lies, and the height of its centre when it touches a floor.
fn forms() -> Vec<(Geometry, Quat, f64)> {
    let flat = Quat::IDENTITY;
    let lying = Quat::from_rotation_x(0.5 * PI);
    vec![
        (Geometry::sphere(0.05).unwrap(), flat, 0.05),
        (Geometry::cuboid(Vec3::new(0.05, 0.05, 0.03)).unwrap(), flat, 0.03),
        (Geometry::capsule(0.05, 0.03).unwrap(), lying, 0.03),
        (Geometry::capsule(0.05, 0.03).unwrap(), flat, 0.08),
        (Geometry::cylinder(0.05, 0.03).unwrap(), lying, 0.03),
        (Geometry::cylinder(0.05, 0.03).unwrap(), flat, 0.05),
    ]
}

/// That body with this gap over the floor and this velocity.
fn over_floor(of: &(Geometry, Quat, f64), law: [f64; 2], gap: f64, velocity: Vec3) -> World {
    let (geometry, orientation, half) = of;
    let mut world = world(law[0], law[1]);
    add_ground(&mut world, 0.0);
    let geometry = world.add_geometry(geometry.clone());
    let body = Body::new(geometry, MaterialId::default(), (half + gap) * Vec3::Z);
    world.add_body(Body { orientation: *orientation, velocity, ..body }).unwrap();
    world
}

/// What falls on a floor flies until it touches and comes back with e^2 of the energy of the touch, at any
/// phase and any step; friction takes mu times the normal impulse, from the touch on.
#[test]
fn what_flies_bounces_where_it_touches_at_any_phase() {
    for form in forms() {
        for (k, e) in [0.01, 0.2, 0.5, 0.9, 1.0].into_iter().enumerate() {
            for (step, speed) in [(1e-3, 1.0), (5e-3, 1.0), (20e-3, 1.0), (20e-3, 3.0)] {
                for phase in 0..16 {
                    let friction = if form.2 == 0.03 && k % 2 == 1 { 0.3 } else { 0.0 };
                    let gap = (f64::from(phase) + 0.5) / 15.0 * (speed + G * step) * step;
                    let velocity = Vec3::new(2.0, 0.0, -speed);
                    let mut world = over_floor(&form, [friction, e], gap, velocity);
                    let what = format!("{form:?}, e = {e}, {step} s, {speed} m/s, phase {phase}");
                    let touch = (speed * speed + 2.0 * G * gap).sqrt();
                    let mut stepper = default_stepper(step);
                    let place = |world: &World| world.bodies.position[1].z - form.2;
                    for made in 1.. {
                        let report = stepper.step(&mut world).unwrap();
                        assert!(report.solve.converged(), "{what}: step {made} {:?}", report.solve.remark);
                        let (time, u) = (f64::from(made) * step, world.bodies.velocity[1]);
                        let flown = gap - speed * time - 0.5 * G * time * time;
                        if flown > 1e-9 {
                            let expected = Vec3::new(2.0, 0.0, -speed - G * time);
                            assert!((u - expected).length() < 1e-9, "{what}: in the air {u}");
                            assert_close(place(&world), flown, 1e-12, &what);
                            continue;
                        }
                        assert!(place(&world) > -1e-4, "{what}: {}", place(&world));
                        if e * touch < 2.0 * G * step {
                            run(&mut stepper, &mut world, 2);
                        }
                        let u = world.bodies.velocity[1];
                        // What comes back within the step rests or has little.
                        let energy = u.z * u.z + 2.0 * G * place(&world);
                        let expected = e * e * touch * touch;
                        if e * touch < 2.0 * G * step {
                            assert!(energy < expected.max(4.0 * G * G * step * step), "{what}: {energy}");
                        } else {
                            assert!(
                                (energy - expected).abs() < 1e-5 * expected,
                                "{what}: {energy}, expected {expected}"
                            );
                            let slid = 2.0 - friction * (1.0 + e) * touch;
                            if friction > 0.0 && form.1 == Quat::IDENTITY {
                                assert_close(u.x, slid, 1e-5, &what);
                            }
                        }
                        break;
                    }
                }
            }
        }
    }
}

/// A rod on a hinge strikes a free box with its whole face: both edges at once, at any phase: the box leaves
/// as the rod came, seen from the rod, with angular momentum about the hinge kept.
#[test]
fn a_hammer_strikes_a_box_flush_at_any_phase() {
    for step in [1e-3, 2e-3, 5e-3] {
        for phase in 0..8 {
            let mut world = world(0.0, 1.0);
            world.gravity = Vec3::ZERO;
            let mut add = |half: Vec3, mass: f64, body: Body| {
                let [x, y, z] = (2.0 * half).to_array();
                let inertia = mass / 12.0 * Vec3::new(y * y + z * z, x * x + z * z, x * x + y * y);
                let mass = Some(MassProperties { mass, inertia: Mat3::from_diagonal(inertia) });
                let geometry = world.add_geometry(Geometry::cuboid(half).unwrap());
                world.add_body(Body { mass, geometry, ..body }).unwrap()
            };
            let body = Body::new(GeometryId::from_index(0), MaterialId::default(), 0.5 * Vec3::X);
            let (spin, arm, angle) = (6.6, 0.6, 0.3 + 6.6 * step * f64::from(phase) / 8.0);
            let (velocity, angular_velocity) = (0.5 * spin * Vec3::Y, spin * Vec3::Z);
            let rod =
                add(Vec3::new(0.5, 0.02, 0.02), 1.0, Body { velocity, angular_velocity, ..body.clone() });
            let turn = Quat::from_rotation_z(angle);
            let place = turn * Vec3::new(arm, 0.07, 0.0);
            let free =
                add(Vec3::new(0.03, 0.05, 0.03), 0.15, Body { position: place, orientation: turn, ..body });
            world.add_joint(Joint::revolute(None, rod, Vec3::ZERO, Vec3::Z)).unwrap();
            let [rod, free] = [rod, free].map(BodyId::index);
            run(&mut default_stepper(step), &mut world, (0.07 / step) as usize);
            let inertia = 1.0 / 3.0 + 0.04 * 0.04 / 12.0;
            let by_box = 0.15 * (arm * arm + (0.06 * 0.06 + 0.1 * 0.1) / 12.0);
            let (speed, left) = (2.0 * spin * arm * inertia, inertia - by_box);
            let [expected, left] = [speed, spin * left].map(|of| of / (inertia + by_box));
            let (got, turns) = (world.bodies.velocity[free].length(), world.bodies.angular_velocity[free].z);
            let what = format!("{step} s, phase {phase}, turns at {turns}");
            assert_close(got, expected, 0.02 * expected, &what);
            assert_close(turns, left + spin, 0.1 * spin, &what);
            assert_close(world.bodies.angular_velocity[rod].z, left, 0.02 * spin, &what);
        }
    }
}

/// A frustum that falls flat on a flat mesh, without friction and with e = 1, bounces without a turn.
#[test]
fn a_frustum_that_falls_flat_on_a_mesh_bounces_flat() {
    for (k, step) in [5e-4, 1e-3, 3e-3, 10e-3].into_iter().enumerate() {
        let mut world = world(0.0, 1.0);
        let corner = |x: f64, y: f64| Vec3::new(x, y, 0.0);
        let vertices =
            [(-3.0, -3.0), (3.0, -3.0), (3.0, 3.0), (-3.0, 3.0), (0.1, 0.05)].map(|(x, y)| corner(x, y));
        let triangles = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let mesh = world.add_geometry(Geometry::mesh(vertices.to_vec(), triangles).unwrap());
        let motion = world.add_motion(Motion::fixed()).unwrap();
        world.add_body(Body { motion, ..Body::new(mesh, MaterialId::default(), Vec3::ZERO) }).unwrap();
        let cone = world.add_geometry(Geometry::cone(0.05, 0.05, 0.03).unwrap());
        let place = Vec3::new(0.02, 0.01, 0.4009183673469388 + 1e-3 * k as f64);
        world.add_body(Body::new(cone, MaterialId::default(), place)).unwrap();
        run(&mut default_stepper(step), &mut world, (1.5 / step) as usize);
        let turns = world.bodies.angular_velocity[1].length();
        assert!(turns < 1e-3, "{step} s: {turns}");
    }
}

/// A touch at the very end of a step is one of the next step, and loses nothing.
#[test]
fn a_touch_between_two_steps_keeps_the_energy() {
    for (step, speed) in [(2e-3, 2.7), (1e-2, 1.0), (2e-2, 0.5)] {
        let gap = step * (speed + 0.5 * G * step);
        for form in &forms()[..2] {
            let mut world = over_floor(form, [0.0, 1.0], gap, -speed * Vec3::Z);
            run(&mut default_stepper(step), &mut world, 4);
            let (u, place) = (world.bodies.velocity[1].z, world.bodies.position[1].z - form.2);
            let energy = u * u + 2.0 * G * place;
            let expected = speed * speed + 2.0 * G * gap;
            assert_close(energy, expected, 1e-6 * expected, &format!("{form:?}, {step} s"));
        }
    }
}

fn stone() -> (Geometry, Vec3) {
    let corners = [[5, 0, 0], [-4, 3, 0], [0, -5, 1], [1, 2, 5], [0, 1, -4], [3, 3, 3]];
    let corners = corners.map(|corner| 0.01 * Vec3::from_array(corner.map(f64::from)));
    Geometry::hull(&corners).unwrap()
}

/// Elastic bodies that tumble, without friction, are struck where they touch, or pass: no plane of a touch
/// that their turn avoids within the step brakes them. In 80 runs of 2 s, with some 800 bounces.
#[test]
fn what_tumbles_keeps_its_energy() {
    let forms = [
        Geometry::cuboid(Vec3::new(0.05, 0.05, 0.03)).unwrap(),
        Geometry::capsule(0.03, 0.03).unwrap(),
        Geometry::cylinder(0.05, 0.03).unwrap(),
        Geometry::cone(0.05, 0.05, 0.0).unwrap(),
        stone().0,
    ];
    for (form, step) in forms.iter().flat_map(|form| [(form, 5e-3), (form, 1e-2)]) {
        for seed in 0..8_u32 {
            let random = |k: u32| 2.0 * scattered(seed * seed + 7 * k, 0.37 * f64::from(k)) - 1.0;
            let mut world = world(0.0, 1.0);
            add_ground(&mut world, 0.0);
            let geometry = world.add_geometry(form.clone());
            let turn = Vec3::new(random(1), random(2), random(3));
            let body = Body {
                velocity: Vec3::new(1.0, 0.5, 0.0),
                angular_velocity: 5.0 * Vec3::new(random(4), random(5), random(6)),
                orientation: Quat::from_scaled_axis(3.0 * turn),
                ..Body::new(geometry, MaterialId::default(), 0.5 * Vec3::Z)
            };
            world.add_body(body).unwrap();
            let energy = |world: &World| {
                world.kinetic_energy() + world.bodies.mass[1] * G * world.bodies.position[1].z
            };
            let before = energy(&world);
            run(&mut default_stepper(step), &mut world, (2.0 / step) as usize);
            let kept = energy(&world) / before;
            assert!((kept - 1.0).abs() < 2e-3, "{form:?}, {step} s, seed {seed}: {kept}");
        }
    }
}

/// A stone that does not turn is thrown into a corner: it touches one wall, turns, touches the other, and
/// comes back to it within the step.
#[test]
fn a_stone_in_a_corner_keeps_its_energy() {
    let mut world = world(0.0, 1.0);
    let plane = world.add_geometry(Geometry::plane());
    let motion = world.add_motion(Motion::fixed()).unwrap();
    for normal in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z] {
        let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
        let wall = Body::new(plane, MaterialId::default(), -0.2 * normal);
        world.add_body(Body { motion, orientation, ..wall }).unwrap();
    }
    let (geometry, centre) = stone();
    let geometry = world.add_geometry(geometry);
    let velocity = Vec3::new(-2.642545351931538, 2.64987236895219, 2.2417947271988883);
    let orientation =
        Quat::from_xyzw(-0.5497238646810017, -0.3306342728546489, -0.6723978391015164, 0.36927739733928033);
    let place = Vec3::new(-0.09, 0.09, -0.09) + orientation * centre;
    let stone = Body { velocity, orientation, ..Body::new(geometry, MaterialId::default(), place) };
    let stone = world.add_body(stone).unwrap().index();
    let energy = |world: &World| {
        world.kinetic_energy() + world.bodies.mass[stone] * G * world.bodies.position[stone].z
    };
    let before = energy(&world);
    run(&mut default_stepper(2e-3), &mut world, 60);
    assert_close(energy(&world), before, 1e-3 * before, "energy");
}
