//! What nothing touches: parabolas, bounces and tumbling keep what they have to keep, at any step.

use crate::support::*;
use graintrain::cell::Cell;
use graintrain::handle::MaterialId;
use graintrain::load::{Action, Load};
use graintrain::material::TurningResistance;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::Body;

#[test]
fn a_throw_is_its_parabola() {
    for (step, is_periodic, wind) in [(1e-3, false, 0.0), (0.02, false, 0.7), (0.02, true, 0.0)] {
        let mut world = world(0.3, 0.0);
        let acceleration = [wind, 0.0, 0.0].map(Profile::Constant);
        world.add_load(Load::on_all(Action::Uniform { acceleration })).unwrap();
        let start = Vec3::new(0.0, 0.0, 20.0);
        let ball = add_sphere(&mut world, 0.05, start);
        if is_periodic {
            let cell = Cell::new(Vec3::splat(-50.0), Vec3::splat(50.0), [true; 3]).unwrap();
            world.set_cell(Some(cell)).unwrap();
        }
        let velocity = Vec3::new(3.0, -1.0, 5.0);
        world.bodies.velocity[ball] = velocity;
        run(&mut default_stepper(step), &mut world, (1.0 / step).round() as usize);
        let exact = start + velocity + 0.5 * Vec3::new(wind, 0.0, -G);
        assert!((world.bodies.position[ball] - exact).length() < 1e-11, "{}", world.bodies.position[ball]);
    }
}

/// A ball with e = 1 comes back to the height that it fell from.
#[test]
fn a_ball_bounces_to_its_height_twenty_times() {
    for step in [1e-3, 8e-3] {
        let mut world = world(0.3, 1.0);
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.55));
        let mut stepper = default_stepper(step);
        let (mut bounces, mut first) = (0, f64::INFINITY);
        while bounces < 20 {
            bounces += solved_step(&mut stepper, &mut world).impacts;
            let height = world.bodies.position[ball].z + world.bodies.velocity[ball].z.powi(2) / (2.0 * G);
            first = if first.is_finite() { first } else { height };
            assert!((height - first).abs() < 1e-10, "{step} s, bounce {bounces}: {height} for {first}");
        }
    }
}

/// Where a ball is after its bounces is where it would be if it had been followed through each of them: it
/// falls until it touches, and rises from then on. (It began to rise with the step, up to two steps early.)
#[test]
fn bounces_keep_their_time() {
    for (step, restitution) in [(1e-3, 1.0), (8e-3, 1.0), (7e-3, 0.8)] {
        let mut world = world(0.3, restitution);
        add_ground(&mut world, 0.0);
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.55));
        let mut stepper = default_stepper(step);
        // Of the last touch, and the speed after it.
        let (mut touch, mut speed) = ((1.0 / G).sqrt(), restitution * G.sqrt());
        for k in 1..=(2.0 / step) as usize {
            solved_step(&mut stepper, &mut world);
            let time = k as f64 * step;
            while time > touch + 2.0 * speed / G {
                touch += 2.0 * speed / G;
                speed *= restitution;
            }
            let since = time - touch;
            let exact = if since < 0.0 {
                0.5 - 0.5 * G * time * time
            } else {
                speed * since - 0.5 * G * since * since
            };
            let height = world.bodies.position[ball].z - 0.05;
            assert!(
                (height - exact).abs() < 1e-9,
                "e = {restitution}, {step} s, step {k}: {height}, not {exact}"
            );
        }
    }
}

/// Balls that meet off their centres go on as they were until they touch, and with what the impact gives them
/// from then on, their turn included.
#[test]
fn balls_that_meet_go_on_as_they_were_until_they_touch() {
    let cases = [(0.8, 1e-3, 3.0), (0.8, 1e-2, 3.0), (0.8, 1e-2, 7.0), (0.0, 1e-3, 3.0), (0.0, 1e-2, 7.0)];
    for (restitution, step, speed) in cases {
        for phase in 0..8 {
            let mut world = world(0.4, restitution);
            world.gravity = Vec3::ZERO;
            let start = Vec3::new(-0.08 - step * speed * (1.0 + f64::from(phase) / 8.0), 0.06, 0.0);
            let pair = [start, Vec3::ZERO].map(|place| add_sphere(&mut world, 0.05, place));
            world.bodies.velocity[pair[0]] = speed * Vec3::X;
            run(&mut default_stepper(step), &mut world, 6);
            let bodies = &world.bodies;
            let of = |k: usize| {
                let orbit = bodies.mass[k] * bodies.position[k].cross(bodies.velocity[k]);
                orbit + bodies.inertia[k] * bodies.angular_velocity[k]
            };
            let [before, after] = [bodies.mass[0] * start.cross(speed * Vec3::X), of(pair[0]) + of(pair[1])];
            let off = (after - before).length();
            assert!(off < 1e-12 * before.length(), "{step} s, {speed} m/s, phase {phase}: {off} kg m^2/s");
            let parting = Vec3::new(-0.8, 0.6, 0.0).dot(bodies.velocity[pair[0]] - bodies.velocity[pair[1]]);
            assert!(
                (parting - restitution * 0.8 * speed).abs() < 1e-9,
                "{restitution} {step} s: {parting} m/s"
            );
            // Centres are 0.1 m from each other then.
            let touch = (-0.08 - start.x) / speed;
            for (body, before) in pair.into_iter().zip([speed * Vec3::X, Vec3::ZERO]) {
                let from = if before == Vec3::ZERO { Vec3::ZERO } else { start };
                let since = 6.0 * step - touch;
                let exact = from + touch * before + since * bodies.velocity[body];
                let off = (bodies.position[body] - exact).length();
                assert!(off < 1e-9, "{step} s, {speed} m/s, phase {phase}: {off} m");
                let turn = bodies.orientation[body].to_scaled_axis();
                let off = (turn - since * bodies.angular_velocity[body]).length();
                assert!(off < 1e-9 && turn.length() > 0.0, "{step} s, {speed} m/s, phase {phase}: {off} rad");
            }
        }
    }
}

/// What lies behind a plate that a fast ball bounces off is not met, and the arm of the impulse is the
/// radius. (The ball went on from behind the plate with the velocity after its touch.)
#[test]
fn nothing_is_met_behind_what_a_ball_bounces_off() {
    let step = 1e-2;
    for (speed, phase) in [(20.0, 0.9), (20.0, 0.2), (30.0, 0.9)] {
        let mut world = world(0.0, 0.9);
        world.gravity = Vec3::ZERO;
        let plate = world.add_geometry(Geometry::cuboid(Vec3::new(1.0, 1.0, 0.005)).unwrap());
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        for z in [-0.005, -0.055] {
            let place = Vec3::new(0.0, 0.0, z);
            world.add_body(Body { motion: fixed, ..Body::new(plate, MaterialId::default(), place) }).unwrap();
        }
        let start = 0.05 + step * speed * (1.0 + phase);
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, start));
        world.bodies.velocity[ball].z = -speed;
        let mut stepper = default_stepper(step);
        run(&mut stepper, &mut world, 1);
        assert_eq!(solved_step(&mut stepper, &mut world).impacts, 1);
        assert_close(world.bodies.velocity[ball].z, 0.9 * speed, 1e-9, "speed");
        let set = &world.contacts;
        let pushing = set.contacts.iter().zip(&set.impulse).find(|(_, g)| **g != Vec3::ZERO).unwrap().0;
        let side = usize::from(pushing.body_b as usize == ball);
        let arm = world.arm_to(ball, pushing.surface_points()[side], step);
        assert_close(arm.length(), 0.05, 1e-9, "arm");
    }
}

/// A ball with e = 0.6 reaches e^2 times its height after every bounce, wherever in a step it touches, on a
/// floor at rest and in the frame of one that rises.
#[test]
fn bounces_reach_the_square_of_the_restitution_times_their_height() {
    for (step, lift) in [(1e-3, 0.0), (5e-3, 0.0), (2e-3, 0.3)] {
        let mut world = world(0.3, 0.6);
        let form = world.add_geometry(Geometry::plane());
        let rising = world.add_motion(Motion::translating(Vec3::Z, Profile::Constant(lift))).unwrap();
        let floor = Body { motion: rising, ..Body::new(form, MaterialId::default(), Vec3::ZERO) };
        let floor = world.add_body(floor).unwrap().index();
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.55));
        world.bodies.velocity[ball] = Vec3::Z * lift;
        let mut stepper = default_stepper(step);
        let mut bounces = 0;
        while bounces < 5 {
            bounces += solved_step(&mut stepper, &mut world).impacts;
            let above = world.bodies.position[ball].z - world.bodies.position[floor].z - 0.05;
            let height = above + (world.bodies.velocity[ball].z - lift).powi(2) / (2.0 * G);
            let expected = 0.5 * 0.36_f64.powi(bounces as i32);
            assert!((height / expected - 1.0).abs() < 1e-8, "{step} s, {bounces}: {height} for {expected}");
        }
    }
}

/// Nor is a bounce lost where the ball touches the floor just after a step begins, or just before its end.
#[test]
fn bounces_do_not_depend_on_the_phase_of_the_touch() {
    let step = 5e-3_f64;
    for (restitution, k) in [0.6, 1.0].into_iter().flat_map(|e| (0..10).map(move |k| (e, k))) {
        let mut world = world(0.3, restitution);
        add_ground(&mut world, 0.0);
        let phase = 0.1 * f64::from(k) + 0.02;
        let height = 0.5 * G * ((40.0 + phase) * step).powi(2);
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.05 + height));
        run(&mut default_stepper(step), &mut world, 50);
        let (place, speed) = (world.bodies.position[ball].z, world.bodies.velocity[ball].z);
        let reached = (place - 0.05 + speed * speed / (2.0 * G)) / height;
        let expected = restitution * restitution;
        assert!((reached - expected).abs() < 1e-8, "e = {restitution}, phase {phase}: {reached}");
    }
}

/// A heavy slab that rests on the ground carries a bounce as the ground does, though it is free to fall.
#[test]
fn a_free_slab_that_rests_carries_a_bounce() {
    let step = 5e-3_f64;
    for phase in [0.1, 0.4, 0.7] {
        let mut world = world(0.3, 0.6);
        add_ground(&mut world, 0.0);
        let slab = world.add_geometry(Geometry::cuboid(Vec3::new(0.5, 0.5, 0.05)).unwrap());
        world.add_body(Body::new(slab, MaterialId::default(), Vec3::new(0.0, 0.0, 0.05))).unwrap();
        let height = 0.5 * G * ((40.0 + phase) * step).powi(2);
        let ball = add_sphere(&mut world, 0.01, Vec3::new(0.0, 0.0, 0.11 + height));
        run(&mut default_stepper(step), &mut world, 48);
        let (place, speed) = (world.bodies.position[ball].z, world.bodies.velocity[ball].z);
        let reached = (place - 0.11 + speed * speed / (2.0 * G)) / height;
        assert!((reached - 0.36).abs() < 0.01, "phase {phase}: {reached}");
    }
}

/// Free bodies that tumble, one of them about its middle axis, keep angular momentum and energy.
#[test]
fn what_tumbles_keeps_its_angular_momentum() {
    for step in [1e-3, 5e-3] {
        let mut world = world(0.3, 0.0);
        let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.06, 0.02)).unwrap());
        for (k, spin) in
            [Vec3::new(1e-3, 5.0, 1e-3), Vec3::new(4.0, -3.0, 2.0), 60.0 * Vec3::ONE].into_iter().enumerate()
        {
            let place = Vec3::new(0.0, k as f64, 0.0);
            let body = world.add_body(Body::new(form, MaterialId::default(), place)).unwrap().index();
            world.bodies.angular_velocity[body] = spin;
        }
        let state = |world: &graintrain::world::World, body: usize| {
            let rotation = Mat3::from_quat(world.bodies.orientation[body]);
            let w = world.bodies.angular_velocity[body];
            let momentum = rotation * world.bodies.inertia[body] * rotation.transpose() * w;
            (momentum, 0.5 * w.dot(momentum))
        };
        let before: Vec<_> = (0..3).map(|body| state(&world, body)).collect();
        run(&mut default_stepper(step), &mut world, (20.0 / step) as usize);
        for (body, (momentum, energy)) in before.into_iter().enumerate() {
            let (l, e) = state(&world, body);
            assert!(
                (l - momentum).length() < 1e-9 * momentum.length(),
                "{step} s, body {body}: {l} for {momentum}"
            );
            assert!((e / energy - 1.0).abs() < 1e-9, "{step} s, body {body}: {e} J for {energy} J");
        }
    }
}

/// The phase of the tumbling is of second order: a tenth of the step, a hundredth of the error.
#[test]
fn the_way_of_tumbling_is_of_second_order() {
    let end = |step: f64| {
        let mut world = world(0.3, 0.0);
        let form = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.06, 0.02)).unwrap());
        let body = world.add_body(Body::new(form, MaterialId::default(), Vec3::ZERO)).unwrap().index();
        world.bodies.angular_velocity[body] = Vec3::new(4.0, -3.0, 2.0);
        run(&mut default_stepper(step), &mut world, (1.0 / step).round() as usize);
        world.bodies.orientation[body]
    };
    let exact = end(1e-4);
    let [coarse, fine] = [1e-2, 1e-3].map(|step| (end(step) - exact).length());
    assert!(coarse < 2e-3 && (60.0..140.0).contains(&(coarse / fine)), "{coarse} {fine}");
}

/// Balls without restitution stop each other when they touch, once: what slides along a wall afterwards is no
/// impact, step after step. Where they resist spinning the contact problem has them, which transmits moments:
/// J = m v / 2 goes over and takes mu J R / I of the spin, with the spinning friction mu R as its length.
#[test]
fn balls_stop_each_other_once() {
    for spinning in [TurningResistance::NONE, TurningResistance::Length(0.01)] {
        let mut world = world(0.3, 0.0);
        world.gravity = Vec3::ZERO;
        let stuff = MaterialId::default();
        world.materials.set_pair_turning(stuff, stuff, TurningResistance::NONE, spinning).unwrap();
        let pair = [Vec3::ZERO, 0.1053 * Vec3::X].map(|place| add_sphere(&mut world, 0.05, place));
        world.bodies.velocity[pair[0]] = Vec3::X;
        world.bodies.angular_velocity[pair[0]] = 50.0 * Vec3::X;
        let wall = world.add_geometry(Geometry::plane());
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let wall = Body::new(wall, MaterialId::default(), -0.5 * Vec3::Z);
        world.add_body(Body { motion: fixed, ..wall }).unwrap();
        let sliding = add_sphere(&mut world, 0.05, Vec3::new(1.0, 1.0, -0.3977));
        world.bodies.velocity[sliding] = Vec3::new(5.0, 0.0, -5.0);
        let mut stepper = default_stepper(1e-3);
        let impacts: usize = (0..40).map(|_| solved_step(&mut stepper, &mut world).impacts).sum();
        let bodies = &world.bodies;
        let lost = 0.01 * 0.5 * bodies.mass[pair[0]] / bodies.inertia[pair[0]].x_axis.x;
        let (lost, expected) = if spinning == TurningResistance::NONE { (0.0, 2) } else { (lost, 0) };
        assert_eq!(impacts, expected);
        assert_close(bodies.angular_velocity[pair[0]].x, 50.0 - lost, 1e-4, "spin");
        assert_close(bodies.velocity[pair[0]].x, 0.5, 1e-6, "velocity");
        assert!(bodies.velocity[sliding].z.abs() < 1e-9 && bodies.velocity[sliding].x < 4.9);
    }
}

/// A thin disc that meets a sheet edge first is spun by ten radians in a step of 10 ms: its centre does not
/// pass all the same.
#[test]
fn what_is_spun_by_a_sheet_does_not_pass_it() {
    let step = 1e-2;
    for (tilt, speed) in [(0.6, 92.0), (1.2, 92.0), (1.5, 150.0), (0.9, 250.0), (1.4, 40.0)] {
        for phase in [0.1, 0.5, 0.9] {
            let mut world = world(0.3, 0.0);
            world.gravity = Vec3::ZERO;
            let corners = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)];
            let corners = corners.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec();
            let sheet = Geometry::mesh(corners, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
            let sheet = world.add_geometry(sheet);
            let fixed = world.add_motion(Motion::fixed()).unwrap();
            let sheet = Body::new(sheet, MaterialId::default(), Vec3::ZERO);
            world.add_body(Body { motion: fixed, ..sheet }).unwrap();
            let disc = world.add_geometry(Geometry::cylinder(0.0067, 0.0155).unwrap());
            let place = Vec3::new(0.2, -0.4, 0.02 + step * speed * (2.0 + phase));
            let orientation = Quat::from_rotation_x(0.3) * Quat::from_rotation_y(tilt);
            let velocity = speed * Vec3::new(0.05, 0.0, -1.0);
            let disc = Body { orientation, velocity, ..Body::new(disc, MaterialId::default(), place) };
            let disc = world.add_body(disc).unwrap().index();
            run(&mut default_stepper(step), &mut world, 30);
            let (place, velocity) = (world.bodies.position[disc], world.bodies.velocity[disc]);
            assert!(place.z > 0.0, "{tilt} {speed} {phase}: {place} {velocity}");
        }
    }
}
