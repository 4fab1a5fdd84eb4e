//! Chains, rods and ropes: light links under heavy loads, at rest and swinging faster than a step resolves.

use crate::joints::{BOTH, GRAVITY, earth, lump, rod, run, runge_kutta, stepper};
use graintrain::ccp::{FrictionModel, Status};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::joint::Joint;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::{Body, MassProperties};
use std::f64::consts::TAU;

/// Links that hang from one another, and one with a body a million times as heavy at its end, stay at rest;
/// the joints carry what hangs.
#[test]
fn a_chain_at_rest_carries_its_weight() {
    for last in [0.1, 1e5] {
        for friction in BOTH {
            let mut world = earth();
            let (count, length, mass) = (20, 0.1, 0.1);
            let mut above = None;
            let mut joints = Vec::new();
            for k in 0..count {
                let [top, bottom] = [k, k + 1].map(|k| Vec3::new(0.0, 0.0, -length * f64::from(k)));
                let own = if k == count - 1 { last } else { mass };
                let link = rod(&mut world, [top, bottom], own);
                joints.push(world.add_joint(Joint::spherical(above, link, top)).unwrap());
                above = Some(link);
            }
            let mut stepper = stepper(1e-3, friction);
            run(&mut world, &mut stepper, 200);
            let fastest = world.bodies.velocity.iter().map(|u| u.length()).fold(0.0, f64::max);
            assert!(fastest < 1e-10, "{fastest}");
            for (k, joint) in joints.iter().enumerate() {
                let carried = GRAVITY * (f64::from(count - 1 - k as i32) * mass + last);
                let force = world.joints()[joint.index()].state.force;
                assert!((force - Vec3::new(0.0, 0.0, carried)).length() < 1e-9 * carried, "{k}: {force}");
            }
        }
    }
}

/// Light links between the world and a slider that is pulled hard, across gravity: they sag by next to
/// nothing and come to rest, at steps far beyond their swings.
#[test]
fn a_taut_light_chain_comes_to_rest() {
    for (step, pull) in [(2e-2, 1e2), (2e-2, 1e5), (5e-3, 1e5), (5e-3, 1e7), (1e-3, 1e7)] {
        let mut world = earth();
        let place = |k: f64| Vec3::new(0.1 * k, 0.0, 0.0);
        let links = [0.0, 1.0].map(|k| rod(&mut world, [place(k), place(k + 1.0)], 0.1));
        let slider = lump(&mut world, place(2.0), 5.0, Vec3::splat(1e-2));
        world.add_joint(Joint::spherical(None, links[0], place(0.0))).unwrap();
        world.add_joint(Joint::spherical(Some(links[0]), links[1], place(1.0))).unwrap();
        world.add_joint(Joint::spherical(Some(links[1]), slider, place(2.0))).unwrap();
        world.add_joint(Joint::prismatic(None, slider, place(2.0), Vec3::X)).unwrap();
        world.bodies.force[slider.index()] = pull * Vec3::X;
        let mut stepper = stepper(step, FrictionModel::Relaxed);
        let mut most = 0.0_f64;
        for _ in 0..(0.5 / step) as usize {
            stepper.step(&mut world).unwrap();
            most = most.max(world.kinetic_energy());
        }
        // What a step falls freely, at the most, before the pull is known.
        let free = 0.5 * 0.2 * (GRAVITY * step).powi(2);
        assert!(most < 20.0 * free, "{step} {pull}: {most} J of {free}");
        assert!(world.kinetic_energy() < 0.1 * free, "{step} {pull}: {} J", world.kinetic_energy());
        // Their own weights over the pull times half a link, and what is left to come to rest.
        let sag = -world.bodies.position[links[0].index()].z;
        assert!((sag - 0.05 * 0.1 * GRAVITY / pull).abs() < 1e-3, "{step} {pull}: {sag}");
    }
}

/// A rigid body (mass, its centre `arm` from the pin, moment about the centre) on a rod without mass of this
/// length, angles from the vertical.
fn hanging_body([a, b, u, v]: [f64; 4], length: f64, arm: f64, gyration: f64) -> [f64; 4] {
    let (sin, cos) = (a - b).sin_cos();
    let coupling = length * arm * cos;
    let [m, n] = [length * length, arm * arm + gyration * gyration];
    let right = [
        -length * arm * sin * v * v - GRAVITY * length * a.sin(),
        length * arm * sin * u * u - GRAVITY * arm * b.sin(),
    ];
    let determinant = m * n - coupling * coupling;
    let accelerations = [
        (n * right[0] - coupling * right[1]) / determinant,
        (m * right[1] - coupling * right[0]) / determinant,
    ];
    [u, v, accelerations[0], accelerations[1]]
}

/// A ball of 100 kg swings on three links of 10 g and 0.1 g, at steps far beyond what these swing by: it goes
/// where it would on a rod without mass, joints stay closed and energy is kept, whether it swings a little,
/// far out, or over the top.
#[test]
fn a_heavy_weight_swings_on_a_light_chain() {
    let (length, arm, radius) = (0.3, 0.2, 0.2);
    for (light, step, speed) in
        [(1e-2, 1e-3, 0.5), (1e-2, 5e-3, 0.5), (1e-4, 5e-3, 0.5), (1e-2, 5e-3, 3.0), (1e-2, 5e-3, 6.0)]
    {
        let mut world = earth();
        let heavy = 100.0;
        let pin = |k: usize| Vec3::new(0.0, 0.0, -0.1 * k as f64);
        let links: Vec<BodyId> = (0..3).map(|k| rod(&mut world, [pin(k), pin(k + 1)], light)).collect();
        let ball = pin(3) - Vec3::new(0.0, 0.0, arm);
        let ball = lump(&mut world, ball, heavy, Vec3::splat(0.4 * heavy * radius * radius));
        world.bodies.velocity[ball.index()].x = speed;
        let hangs = [None, Some(links[0]), Some(links[1]), Some(links[2])];
        for (k, (above, below)) in hangs.into_iter().zip([links[0], links[1], links[2], ball]).enumerate() {
            world.add_joint(Joint::spherical(above, below, pin(k))).unwrap();
        }
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        let start = 0.5 * heavy * speed * speed + heavy * GRAVITY * world.bodies.position[ball.index()].z;
        for _ in 0..(1.0 / step).round() as usize {
            let before = world.bodies.position[ball.index()].z;
            let report = stepper.step(&mut world).unwrap();
            assert_eq!(report.solve.status, Status::Converged, "{step} {light}: {:?}", report.solve.remark);
            assert!(report.errors.joint_opening_max < 1e-10, "{}", report.errors.joint_opening_max);
            let height = 0.5 * (before + world.bodies.position[ball.index()].z);
            let energy = report.kinetic_energy + heavy * GRAVITY * height;
            let (swing, size) = (heavy * GRAVITY * 0.5, 0.5 * heavy * speed * speed);
            assert!((energy - start).abs() < 0.004 * size.max(swing), "{step} {speed}: {energy} of {start}");
        }
        let gyration = (0.4_f64).sqrt() * radius;
        // Places are those of the middle of a velocity's step.
        let [a, b, ..] =
            runge_kutta([0.0, 0.0, speed / length, 0.0], 1.0, |y| hanging_body(y, length, arm, gyration));
        let exact = Vec3::new(length * a.sin() + arm * b.sin(), 0.0, -length * a.cos() - arm * b.cos());
        let off = (world.bodies.position[ball.index()] - exact).length();
        assert!(off < 4e-4 * speed * speed, "{light} {step} {speed}: {off}");
    }
}

/// A chain of links of 10 g and 0.1 m that is let go level, one link heavier by a ratio, swings for two
/// seconds: it goes slack where it turns back, and there no path closes the joints of links as light as
/// these are. Joints stay closed and energy is kept.
#[test]
fn chains_of_light_links_and_a_heavy_one_swing() {
    let length = 0.1;
    for (links, heavy, ratio, has_rods, step) in [
        (5, 4, 1e4, true, 1e-3),
        (5, 4, 1e6, true, 5e-3),
        (3, 2, 1e6, false, 5e-3),
        (5, 2, 1e5, false, 2e-3),
        (5, 2, 1e5, false, 5e-3),
    ] {
        let mut world = earth();
        let pin = |k: usize| Vec3::new(length * k as f64, 0.0, 0.0);
        let mut bodies: Vec<BodyId> = Vec::new();
        for k in 0..links {
            let mass = if k == heavy { 1e-2 * ratio } else { 1e-2 };
            let above = bodies.last().copied();
            let (body, joint) = if has_rods {
                let bead = lump(&mut world, pin(k + 1), mass, Vec3::splat(1e-5 * mass));
                (bead, Joint::distance(above, bead, [pin(k), pin(k + 1)]))
            } else {
                let link = rod(&mut world, [pin(k), pin(k + 1)], mass);
                (link, Joint::spherical(above, link, pin(k)))
            };
            world.add_joint(joint).unwrap();
            bodies.push(body);
        }
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        let (mut least, mut most, mut fastest) = (0.0_f64, 0.0_f64, 0.0_f64);
        for k in 0..(2.0 / step).round() as usize {
            let before = world.bodies.position.clone();
            let report = stepper.step(&mut world).unwrap();
            let at = format!("{links} {ratio} {step}: step {k}");
            assert_eq!(report.solve.status, Status::Converged, "{at}: {:?}", report.solve.remark);
            let open = report.errors.joint_opening_max;
            assert!(open < 1e-4 * length, "{at}: {open}");
            // Velocities are those of the middle of the step.
            let places = before.iter().zip(&world.bodies.position).zip(&world.bodies.mass);
            let height: f64 = places.map(|((a, b), mass)| 0.5 * mass * (a.z + b.z)).sum();
            let energy = report.kinetic_energy + GRAVITY * height;
            (least, most) = (least.min(energy), most.max(energy));
            fastest = fastest.max(report.kinetic_energy);
        }
        assert!(least > -0.01 * fastest && most < 0.01 * fastest, "{links} {ratio} {step}: {least} {most}");
    }
}

/// A chain of hinged links of 1 g and 0.3 m that stands folded above its first hinge, the last link a million
/// times as heavy: that falls freely, until it jerks the slack chain straight within one step. The jerk takes
/// energy, as any inelastic impact does; joints stay closed.
#[test]
fn a_falling_weight_jerks_a_slack_chain_straight() {
    let (length, fold) = (0.3, 0.4_f64);
    for (links, ratio, step) in
        [(6, 1e6, 5e-3), (6, 1e6, 2e-3), (6, 1e6, 5e-4), (6, 1e3, 2e-3), (12, 1e6, 2e-3)]
    {
        let mut world = earth();
        let (mut pin, mut above) = (Vec3::ZERO, None);
        for k in 0..links {
            let (sine, cosine) = (fold * k as f64).sin_cos();
            let next = pin + length * Vec3::new(cosine, 0.0, sine);
            let mass = if k + 1 == links { 1e-3 * ratio } else { 1e-3 };
            let link = lump(&mut world, 0.5 * (pin + next), mass, Vec3::splat(0.1 * mass * length * length));
            world.add_joint(Joint::revolute(above, link, pin, Vec3::Y)).unwrap();
            (pin, above) = (next, Some(link));
        }
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        let (mut start, mut lost, mut fastest) = (None, 0.0_f64, 0.0_f64);
        for k in 0..(1.2 / step).round() as usize {
            let before = world.bodies.position.clone();
            let report = stepper.step(&mut world).unwrap();
            let at = format!("{links} {ratio} {step}: step {k}");
            assert_eq!(report.solve.status, Status::Converged, "{at}: {:?}", report.solve.remark);
            let open = report.errors.joint_opening_max;
            assert!(open < 1e-9 * length, "{at}: {open}");
            // Velocities are those of the middle of the step.
            let places = before.iter().zip(&world.bodies.position).zip(&world.bodies.mass);
            let height: f64 = places.map(|((a, b), mass)| 0.5 * mass * (a.z + b.z)).sum();
            let energy = report.kinetic_energy + GRAVITY * height;
            fastest = fastest.max(report.kinetic_energy);
            let rise = energy - *start.get_or_insert(energy);
            assert!(rise < 1e-3 * fastest, "{at}: {rise} of {fastest}");
            lost = lost.min(rise);
        }
        assert!(lost < -0.3 * fastest, "{links} {ratio} {step}: {lost} of {fastest}");
    }
}

/// Beads of 0.1 g on rods without mass over a drum, with weights of 1.5 kg and 1 kg: they roll, so that the
/// weights fall as over a pulley.
#[test]
fn light_beads_roll_over_a_drum_under_heavy_weights() {
    let mut world = earth();
    let drum = world.add_geometry(Geometry::cylinder(0.2, 0.5).unwrap());
    let motion = world.add_motion(Motion::fixed()).unwrap();
    let orientation = Quat::from_axis_angle(Vec3::X, 0.25 * TAU);
    world
        .add_body(Body { motion, orientation, ..Body::new(drum, MaterialId::default(), Vec3::ZERO) })
        .unwrap();
    let bead = world.add_geometry(Geometry::sphere(0.01).unwrap());
    let over = (0..25).map(|k| (0.5 * TAU * f64::from(k) / 24.0).sin_cos());
    let mut places = vec![Vec3::new(0.51, 0.0, -0.1)];
    places.extend(over.map(|(sin, cos)| Vec3::new(0.51 * cos, 0.0, 0.51 * sin)));
    places.push(Vec3::new(-0.51, 0.0, -0.1));
    let weights = [1.5, 1.0];
    let masses = std::iter::once(weights[0]).chain([1e-4; 25]).chain([weights[1]]);
    let bodies: Vec<BodyId> = places
        .iter()
        .zip(masses)
        .map(|(&place, mass)| {
            let mass = Some(MassProperties { mass, inertia: Mat3::from_diagonal(Vec3::splat(4e-5 * mass)) });
            world.add_body(Body { mass, ..Body::new(bead, MaterialId::default(), place) }).unwrap()
        })
        .collect();
    for (pair, ends) in bodies.windows(2).zip(places.windows(2)) {
        world.add_joint(Joint::distance(Some(pair[0]), pair[1], [ends[0], ends[1]])).unwrap();
    }
    let step = 1e-3;
    let mut stepper = stepper(step, FrictionModel::Coulomb);
    for _ in 0..200 {
        let report = stepper.step(&mut world).unwrap();
        assert_eq!(report.solve.status, Status::Converged, "{:?}", report.solve.remark);
        assert!(report.solve.iterations < 10_000, "{}", report.solve.iterations);
        assert!(report.errors.joint_opening_max < 1e-12);
    }
    let [fast, slow] = weights;
    let fall = (fast - slow) / (fast + slow) * GRAVITY * 0.2;
    let found = -world.bodies.velocity[bodies[0].index()].z;
    assert!((found - fall).abs() < 0.01 * fall, "{found} {fall}");
    let tension = 2.0 * fast * slow / (fast + slow) * GRAVITY;
    let found = world.joints()[0].state.force.length();
    assert!((found - tension).abs() < 0.01 * tension, "{found} {tension}");
}

/// A load on a rod so short that a step is five of its swings travels with what carries it: its swing is
/// damped beside the carrier, not beside the ground.
#[test]
fn a_load_on_a_taut_rod_travels_with_its_carrier() {
    let mut world = earth();
    let speed = Vec3::new(2.0, -1.0, 0.0);
    let form = world.add_geometry(Geometry::sphere(1e-4).unwrap());
    let motion = world.add_motion(Motion::translating(speed, Profile::Constant(1.0))).unwrap();
    let carrier = Body { motion, velocity: speed, ..Body::new(form, MaterialId::default(), Vec3::ZERO) };
    let carrier = world.add_body(carrier).unwrap();
    let place = Vec3::new(0.0, 0.0, -1e-3);
    let load = lump(&mut world, place, 10.0, Vec3::splat(1e-3));
    world.bodies.velocity[load.index()] = speed;
    world.add_joint(Joint::distance(Some(carrier), load, [Vec3::ZERO, place])).unwrap();
    run(&mut world, &mut stepper(0.05, FrictionModel::Coulomb), 40);
    let off = world.bodies.velocity[load.index()] - speed;
    assert!(off.length() < 1e-9, "{off}");
}

/// Two light links with stops hold 2 t that move up along them: where a stop would hold a link against all
/// that pulls at it, the link is as stiff as before, and nobody is thrown.
#[test]
fn light_links_with_stops_hold_a_heavy_weight() {
    for step in [1e-3, 1e-2] {
        let mut world = earth();
        let link = Vec3::new(1.7e-3, 1.7e-3, 3e-4);
        let bodies = [(0.1, 0.5, link, 3.0), (0.3, 0.5, link, -3.0), (0.7, 2e3, Vec3::splat(40.0), 1.0)];
        let mut above = None;
        for (k, (depth, mass, inertia, spin)) in bodies.into_iter().enumerate() {
            let body = lump(&mut world, Vec3::new(0.0, 0.0, -depth), mass, inertia);
            world.bodies.angular_velocity[body.index()] = spin * Vec3::Y;
            let pin = Vec3::new(0.0, 0.0, -0.2 * k as f64);
            let hinge = Joint::revolute(above, body, pin, Vec3::Y).with_limits(Some(-0.7), Some(0.7));
            world.add_joint(hinge).unwrap();
            above = Some(body);
        }
        world.bodies.velocity[above.unwrap().index()] = Vec3::Z;
        let mut stepper = stepper(step, FrictionModel::Coulomb);
        for n in 0..(1.0 / step) as usize {
            let report = stepper.step(&mut world).unwrap();
            assert!(report.kinetic_energy < 1e3, "{step} s, step {n}: {}", report.kinetic_energy);
        }
    }
}

/// A straight chain between two fixed points has no path at all, and stacks with heavy balls on top of light
/// ones press on it: where its joints can only be closed into what it carries, no step that makes bodies
/// overlap says that it has converged.
#[test]
fn a_step_that_makes_bodies_overlap_has_not_converged() {
    let mut world = earth();
    let [link, ball] =
        [Geometry::capsule(0.013, 0.012), Geometry::sphere(0.05)].map(|g| world.add_geometry(g.unwrap()));
    let place = |k: i32, y: f64| Vec3::new(0.05 * f64::from(k), y, 1.0);
    for y in [0.0, 0.06] {
        let mut last = None;
        for k in 0..16 {
            let body = Body::new(link, MaterialId::default(), place(k, y));
            let own =
                world.add_body(Body { orientation: Quat::from_rotation_y(0.25 * TAU), ..body }).unwrap();
            world.add_joint(Joint::spherical(last, own, place(k, y) - Vec3::new(0.025, 0.0, 0.0))).unwrap();
            last = Some(own);
        }
        let end = place(15, y) + Vec3::new(0.025, 0.0, 0.0);
        world.add_joint(Joint::spherical(None, last.unwrap(), end)).unwrap();
    }
    for x in [0.25, 0.351, 0.452] {
        for (height, mass) in [(1.055, 0.001), (1.156, 10.0), (1.257, 1.0)] {
            let body = Body::new(ball, MaterialId::default(), Vec3::new(x, 0.03, height));
            let mass = Some(MassProperties { mass, inertia: Mat3::from_diagonal(Vec3::splat(1e-3 * mass)) });
            world.add_body(Body { mass, ..body }).unwrap();
        }
    }
    let mut stepper = stepper(4e-3, FrictionModel::Coulomb);
    let (mut before, mut told) = (0.0, 0);
    for _ in 0..40 {
        let report = stepper.step(&mut world).unwrap();
        let overlap = report.penetration_max_over_size;
        let deepens = overlap > 0.01 && overlap > before + 1e-3;
        assert!(!(deepens && report.solve.status == Status::Converged), "{before} {overlap}");
        told += u32::from(deepens);
        before = overlap;
    }
    assert!(told > 0);
}
