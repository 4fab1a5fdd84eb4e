//! Rotation: A15, A16, and driven bodies.

use crate::support::*;
use graintrain::ccp::FrictionModel::Relaxed;
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::{Joint, Motor};
use graintrain::load::{Action, Load};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Axes, Motion, Profile};
use graintrain::shape::{Cylinder, Geometry, Part, Shape, Sphere};
use graintrain::world::{Body, World};
use std::f64::consts::PI;

/// A15: a body with inertia (1, 2, 3) spun about its middle axis turns over.
#[test]
fn a15_torque_free_body_turns_over() {
    let mut world = world(0.0, 0.0);
    world.gravity = Vec3::ZERO;
    let body = add_sphere(&mut world, 0.1, Vec3::ZERO);
    world.bodies.inertia[body] = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
    world.bodies.angular_velocity[body] = Vec3::new(0.01, 1.0, 0.01);
    let own =
        |world: &World| world.bodies.orientation[body].conjugate() * world.bodies.angular_velocity[body];
    let inertia = world.bodies.inertia[body];
    let momentum = |world: &World| (inertia * own(world)).length();
    let (first_momentum, first_energy) = (momentum(&world), world.kinetic_energy());
    let step = 1e-3;
    let mut stepper = stepper(step, 0.0, 1e-6, Relaxed);
    let mut turns = Vec::new();
    let mut last = own(&world).y;
    for _ in 0..51_000 {
        stepper.step(&mut world).unwrap();
        let now = own(&world).y;
        if now * last < 0.0 {
            turns.push(world.time - step * now / (now - last));
        }
        last = now;
    }
    let drift = (momentum(&world) / first_momentum - 1.0).abs();
    let energy = (world.kinetic_energy() / first_energy - 1.0).abs();
    println!("A15: turns over at {turns:?} s, |L| drift {drift:.1e}, T drift {energy:.1e}");
    assert_eq!(turns.len(), 3);
    for (got, expected) in turns.iter().zip([10.9169, 30.4698, 50.0226]) {
        assert_close(*got, expected, 0.01 * expected, "time of turning over");
    }
    assert!(drift < 1e-6 && energy < 1e-4);
}

/// A cone of half angle alpha that lies on a plane tilted by beta rolls about its tip: T = 3/40 m h^2
/// theta'^2 (1 + 5 cos^2 alpha) with theta the angle of the line of contact to the steepest one (Landau and
/// Lifshitz, Mechanics, section 32, problem 7), so that small swings have omega^2 = 5 g cos alpha sin beta /
/// (h (1 + 5 cos^2 alpha)).
#[test]
fn a_cone_rolls_on_a_slope_as_a_pendulum() {
    let (height, alpha, beta) = (0.1, 0.5_f64, 0.2_f64);
    for model in BOTH {
        for (step, tolerance) in [(1e-3, 2e-3), (4e-3, 1e-2)] {
            let mut world = world(1.0, 0.0);
            world.gravity = G * Vec3::new(beta.sin(), 0.0, -beta.cos());
            add_ground(&mut world, 0.0);
            let form = world.add_geometry(Geometry::cone(height, height * alpha.tan(), 0.0).unwrap());
            let axis = Vec3::new(alpha.cos(), 0.0, alpha.sin());
            let turn = Quat::from_rotation_z(0.1);
            let orientation = turn * Quat::from_rotation_arc(Vec3::Z, -axis);
            let place = turn * (0.75 * height * axis);
            let body = Body { orientation, ..Body::new(form, MaterialId::default(), place) };
            let body = world.add_body(body).unwrap().index();
            let mut stepper = stepper(step, 1e-3, 1e-6, model);
            let mut zeros = Vec::new();
            let mut last = place.y;
            while zeros.len() < 5 && world.time < 4.0 {
                solved_step(&mut stepper, &mut world);
                let now = world.bodies.position[body].y;
                if now * last < 0.0 {
                    zeros.push(world.time - step * now / (now - last));
                }
                last = now;
            }
            let cosine = alpha.cos();
            let omega = (5.0 * G * cosine * beta.sin() / (height * (1.0 + 5.0 * cosine * cosine))).sqrt();
            let period = 0.5 * (zeros[4] - zeros[0]);
            let tip = world.bodies.position[body]
                + world.bodies.orientation[body] * Vec3::new(0.0, 0.0, 0.75 * height);
            println!("{model:?} {step}: period {} of {}, tip {tip}", period, 2.0 * PI / omega);
            assert_close(period * omega / (2.0 * PI), 1.0, tolerance, "period");
            assert!(tip.length() < 0.01 * height, "{tip}");
        }
    }
}

/// A disc on a thin tip that stands on a rough plane and does not slip.
struct Top {
    world: World,
    body: usize,
    /// Distance from the tip to the centre of mass, m.
    length: f64,
    /// Inertia about the tip across the axis, and about the axis, per mass.
    across: f64,
    along: f64,
}

fn top(tilt: f64, spin: f64) -> Top {
    let mut world = world(2.0, 0.0);
    add_ground(&mut world, 0.0);
    let tip = 1e-5;
    let length = 0.05;
    let part = |shape, z| Part { shape, position: Vec3::new(0.0, 0.0, z), orientation: Quat::IDENTITY };
    let disc = Shape::Cylinder(Cylinder { half_length: 0.005, radius: 0.04 });
    let (form, centre) =
        Geometry::compound(vec![part(Shape::Sphere(Sphere { radius: tip }), 0.0), part(disc, length)])
            .unwrap();
    let across = form.unit_inertia.x_axis.x / form.volume + centre.z * centre.z;
    let along = form.unit_inertia.z_axis.z / form.volume;
    let form = world.add_geometry(form);
    let orientation = Quat::from_rotation_y(tilt);
    let position = orientation * centre + Vec3::new(0.0, 0.0, tip);
    let axis = orientation * Vec3::Z;
    let body = Body {
        orientation,
        angular_velocity: spin * axis,
        ..Body::new(form, MaterialId::default(), position)
    };
    let body = world.add_body(body).unwrap().index();
    Top { world, body, length: centre.z, across, along }
}

/// A16: steady precession: `I1 cos(tilt) W^2 - I3 w3 W + m g l = 0`, for fast spin W = m g l / (I3 w3).
#[test]
fn a16_heavy_top_precesses() {
    let spin = 300.0;
    let tilt: f64 = 0.4;
    let Top { mut world, body, length, across, along } = top(tilt, spin);
    let fast = G * length / (along * spin);
    // Fixed-point iterations of the quadratic with w3 = spin + W cos(tilt).
    let steady =
        |rate: f64| (G * length + across * tilt.cos() * rate * rate) / (along * (spin + rate * tilt.cos()));
    let rate = steady(steady(steady(fast)));
    // Regular precession from the start: no nutation.
    let regular = rate * Vec3::Z;
    let arm = world.bodies.position[body];
    world.bodies.angular_velocity[body] += regular;
    world.bodies.velocity[body] = regular.cross(arm);
    let mut stepper = stepper(1e-4, 1e-4, 1e-8, Relaxed);
    run(&mut stepper, &mut world, 5_000);
    let axis = world.bodies.orientation[body] * Vec3::Z;
    let turned = axis.y.atan2(axis.x);
    println!(
        "A16: precession {:.4} rad/s, expected {rate:.4}; tilt {:.4} rad",
        turned / world.time,
        axis.z.acos()
    );
    assert_close(turned / world.time, rate, 0.01 * rate, "precession");
    assert_close(axis.z.acos(), tilt, 0.01 * tilt, "tilt");
}

/// A16: a sleeping top is stable exactly if w3^2 >= 4 I1 m g l / I3^2.
#[test]
fn a16_sleeping_top() {
    let critical = {
        let Top { length, across, along, .. } = top(0.0, 0.0);
        (4.0 * across * G * length).sqrt() / along
    };
    for (factor, stable) in [(1.2, true), (0.8, false)] {
        let Top { mut world, body, .. } = top(1e-3, factor * critical);
        let mut stepper = stepper(5e-5, 1e-4, 1e-8, Relaxed);
        let mut widest: f64 = 0.0;
        for _ in 0..10_000 {
            solved_step(&mut stepper, &mut world);
            widest = widest.max((world.bodies.orientation[body] * Vec3::Z).z.min(1.0).acos());
        }
        println!(
            "A16: spin {factor} of critical ({critical:.1} rad/s): tilt up to {widest:.1e} rad from 1e-3"
        );
        assert_eq!(widest < 1e-2, stable);
    }
}

/// A wheel whose axle stands out from a ball joint, let go at rest but for its spin: it falls, swings up
/// again and goes round. `body axis, then spin` after so many seconds by Euler's equations about the joint
/// with torque a e x g (Runge and Kutta's fourth-order method, body axes, z along the axle).
fn gyroscope_by_runge_kutta(inertia: Vec3, arm: f64, mass: f64, spin: f64, end: f64) -> Vec3 {
    let slope = |(q, w): (Quat, Vec3)| {
        let torque = (arm * Vec3::Z).cross(q.conjugate() * Vec3::new(0.0, 0.0, -mass * G));
        let turn = (q * Quat::from_xyzw(w.x, w.y, w.z, 0.0)) * 0.5;
        (turn, (torque - w.cross(inertia * w)) / inertia)
    };
    let (mut q, mut w) = (Quat::from_rotation_y(0.5 * PI), spin * Vec3::Z);
    let count = 40_000;
    let h = end / f64::from(count);
    for _ in 0..count {
        let at = |(dq, dw): (Quat, Vec3), h: f64| (q + dq * h, w + dw * h);
        let k1 = slope((q, w));
        let k2 = slope(at(k1, 0.5 * h));
        let k3 = slope(at(k2, 0.5 * h));
        let k4 = slope(at(k3, h));
        q = (q + (k1.0 + k2.0 * 2.0 + k3.0 * 2.0 + k4.0) * (h / 6.0)).normalize();
        w += h / 6.0 * (k1.1 + 2.0 * k2.1 + 2.0 * k3.1 + k4.1);
    }
    q * Vec3::Z
}

/// A wheel on an axle along x that a ball joint at the origin holds.
fn gyroscope(arm: f64, spin: f64) -> (World, BodyId) {
    let mut world = world(0.3, 0.0);
    let form = world.add_geometry(Geometry::cylinder(0.01, 0.1).unwrap());
    let wheel = Body {
        orientation: Quat::from_rotation_y(0.5 * PI),
        angular_velocity: spin * Vec3::X,
        ..Body::new(form, MaterialId::default(), arm * Vec3::X)
    };
    let wheel = world.add_body(wheel).unwrap();
    world.add_joint(Joint::spherical(None, wheel, Vec3::ZERO)).unwrap();
    (world, wheel)
}

/// Beyond 1 rad per step steps tell that the momentum of weight leads the axle nowhere near where it should.
#[test]
fn a_gyroscope_that_turns_too_far_in_a_step_is_reported() {
    for (spin, is_resolved) in [(100.0, true), (300.0, false)] {
        let (mut world, _) = gyroscope(0.2, spin);
        let mut stepper = stepper(4e-3, 1e-3, 1e-6, Relaxed);
        let mut lost = 0.0;
        for _ in 0..250 {
            lost += solved_step(&mut stepper, &mut world).errors.momentum_lost_max;
        }
        assert!(if is_resolved { lost == 0.0 } else { (0.1..2.0).contains(&lost) }, "{spin} {lost}");
    }
}

/// A gyroscope on a ball joint goes its way nearly to second order in the step, and does not sink.
#[test]
fn a_gyroscope_on_a_joint_goes_its_way() {
    let (arm, spin, end) = (0.2, 100.0, 3.0);
    let axle = |step: f64| {
        let (mut world, wheel) = gyroscope(arm, spin);
        let mut stepper = stepper(step, 1e-3, 1e-6, Relaxed);
        for _ in 0..(end / step).round() as usize {
            solved_step(&mut stepper, &mut world);
        }
        let body = wheel.index();
        let (mass, inertia) = (world.bodies.mass[body], world.bodies.inertia[body]);
        let across = mass * arm * arm;
        let inertia = Vec3::new(inertia.x_axis.x + across, inertia.y_axis.y + across, inertia.z_axis.z);
        let exact = gyroscope_by_runge_kutta(inertia, arm, mass, spin, end);
        (world.bodies.position[body] / arm - exact).length()
    };
    let [coarse, fine] = [4e-3, 1e-3].map(axle);
    println!("gyroscope: off by {coarse:.1e} and {fine:.1e} of its arm at 4 and 1 ms");
    assert!(fine < 3e-3 && (10.0..25.0).contains(&(coarse / fine)), "{coarse} {fine}");
}

/// A propeller and a disc driven on a swinging arm turn by 0.5 to 3 rad in a step, and joints find where.
#[test]
fn joints_hold_what_turns_far_in_a_step() {
    for (blade, speed, step) in
        [(true, 100.0, 5e-3), (true, 300.0, 5e-3), (false, 200.0, 1e-2), (false, 600.0, 5e-3)]
    {
        let mut world = world(0.3, 0.0);
        let arm = world.add_geometry(Geometry::cuboid(Vec3::new(0.2, 0.02, 0.02)).unwrap());
        let rotor =
            if blade { Geometry::cuboid(Vec3::new(0.1, 0.01, 0.01)) } else { Geometry::cylinder(0.01, 0.1) };
        let rotor = world.add_geometry(rotor.unwrap());
        let arm = world.add_body(Body::new(arm, MaterialId::default(), 0.2 * Vec3::X)).unwrap();
        let place = Vec3::new(0.4, 0.0, 0.05);
        let rotor =
            Body { angular_velocity: speed * Vec3::Z, ..Body::new(rotor, MaterialId::default(), place) };
        let rotor = world.add_body(rotor).unwrap();
        world.add_joint(Joint::spherical(None, arm, Vec3::ZERO)).unwrap();
        let motor = Motor::Speed { speed: Profile::Constant(speed), limit: None };
        world.add_joint(Joint::revolute(Some(arm), rotor, place, Vec3::Z).with_motor(motor)).unwrap();
        let mut stepper = stepper(step, 1e-3, 1e-4, Relaxed);
        let (mut unsolved, mut open) = (0, 0.0_f64);
        for _ in 0..(1.0 / step) as usize {
            let report = stepper.step(&mut world).unwrap();
            unsolved += usize::from(!report.solve.converged());
            open = open.max(report.errors.joint_opening_max);
        }
        assert!(unsolved <= 2 && open < 1e-6, "{blade} {speed} {step}: {unsolved} steps, open by {open} m");
    }
}

/// A mixer arm far from its axis stays on its circle, and drags a ball along by friction.
#[test]
fn a_driven_body_stays_on_its_circle() {
    let mut world = world(0.5, 0.0);
    let table = world.add_geometry(Geometry::cylinder(0.1, 2.0).unwrap());
    let axis_point = Vec3::new(0.5, 0.0, 0.0);
    let turning = world.add_motion(Motion::rotating(axis_point, Vec3::Z, Profile::Constant(0.5))).unwrap();
    let arm = world
        .add_body(Body { motion: turning, ..Body::new(table, MaterialId::default(), Vec3::ZERO) })
        .unwrap()
        .index();
    let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.05)).unwrap());
    let rider =
        world.add_body(Body::new(block, MaterialId::default(), Vec3::new(0.9, 0.0, 0.15))).unwrap().index();
    // Already turning with the table.
    world.bodies.velocity[rider] = Vec3::new(0.0, 0.5 * 0.4, 0.0);
    world.bodies.angular_velocity[rider] = 0.5 * Vec3::Z;
    let mut stepper = stepper(5e-3, 0.01, 1e-8, Relaxed);
    for _ in 0..400 {
        solved_step(&mut stepper, &mut world);
    }
    let angle: f64 = 0.5 * world.time;
    let exact = axis_point + Vec3::new(-0.5 * angle.cos(), -0.5 * angle.sin(), 0.0);
    assert!((world.bodies.position[arm] - exact).length() < 1e-13);
    let turn = Quat::from_rotation_z(angle);
    assert!(turn.angle_between(world.bodies.orientation[arm]) < 1e-7);
    let ridden = axis_point + 0.4 * Vec3::new(angle.cos(), angle.sin(), 0.0) + 0.15 * Vec3::Z;
    let error = (world.bodies.position[rider] - ridden).length();
    println!("driven table: the rider is {error:.1e} m from its circle after {angle} rad");
    assert!(error < 2e-3);
}

/// A press held by a mixed motion: only z is dynamic; a blade that is driven along x and loaded in z by its
/// weight.
#[test]
fn mixed_motions_move_as_reported() {
    let mut world = world(0.3, 0.0);
    let ground = add_ground(&mut world, 0.0);
    let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.1)).unwrap());
    let driven = Motion::translating(Vec3::new(1.0, 0.0, 5.0), Profile::Constant(0.2));
    let driven = world.add_motion(driven.with_free([false, false, true, false, false, false])).unwrap();
    let blade = world
        .add_body(Body {
            motion: driven,
            ..Body::new(block, MaterialId::default(), Vec3::new(0.0, 0.0, 0.1))
        })
        .unwrap();
    let step = 1e-3;
    let mut stepper = stepper(step, 0.01, 1e-10, Relaxed);
    let mut last = None;
    for _ in 0..200 {
        last = Some(solved_step(&mut stepper, &mut world));
    }
    let body = blade.index();
    assert_close(world.bodies.position[body].x, 0.2 * world.time, 1e-12, "driven along x");
    assert_close(world.bodies.position[body].y, 0.0, 0.0, "held in y");
    assert_eq!(world.bodies.orientation[body], Quat::IDENTITY);
    let weight = world.bodies.mass[body] * G;
    let report = last.unwrap();
    let wrench = |b: BodyId| report.wrenches.iter().find(|w| w.body == b).unwrap();
    assert_close(wrench(blade).force.z, weight, 1e-6 * weight, "load in z");
    assert_close(wrench(blade).force.x, -0.3 * weight, 1e-4 * weight, "drag of friction");
    assert!((wrench(ground).force + wrench(blade).force).length() < 1e-9 * weight);
}

/// A torque changes the angular momentum of a free body by its impulse, however far the body turns in a step.
#[test]
fn loads_change_the_angular_momentum_of_what_spins_fast_by_their_impulse() {
    for inertia in [Vec3::new(0.0025, 0.0025, 0.005), Vec3::new(0.004, 0.003, 0.005)] {
        for step in [1e-4, 1e-3, 5e-3, 1e-2] {
            let mut world = world(0.0, 0.0);
            world.gravity = Vec3::ZERO;
            let body = add_sphere(&mut world, 0.1, Vec3::ZERO);
            world.bodies.inertia[body] = Mat3::from_diagonal(inertia);
            world.bodies.angular_velocity[body] = Vec3::new(0.0, 0.0, 1000.0);
            let terms = vec![(Vec3::Y, Profile::Constant(0.981))];
            let torque = Action::Torque { terms, axes: Axes::World };
            world.add_load(Load::on(BodyId::from_index(body), torque)).unwrap();
            let mut stepper = stepper(step, 0.02, 1e-9, Relaxed);
            for _ in 0..(0.2 / step).round() as usize {
                stepper.step(&mut world).unwrap();
            }
            let at = Mat3::from_quat(world.bodies.orientation[body]);
            let spin = world.bodies.angular_velocity[body];
            let momentum = at * Mat3::from_diagonal(inertia) * at.transpose() * spin;
            let expected = Vec3::new(0.0, 0.1962, 5.0);
            assert!((momentum - expected).length() < 1e-9, "{inertia} {step}: {momentum}");
        }
    }
}
