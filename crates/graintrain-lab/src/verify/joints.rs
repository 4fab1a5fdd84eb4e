//! Joints, motors and springs: A33 to A41, A45, A46.

use super::bench::{Accuracy, Bench, G, add_ground, world};
use super::source::{RELAXED, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::{BodyId, JointId, MaterialId};
use graintrain::joint::{Joint, Motor};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::{Body, MassProperties, World};
use std::f64::consts::TAU;

const REDUCED: Source = Source::Algebra(
    "Lagrange's equations in reduced coordinates, by Runge and Kutta; the scheme's velocities belong to the middle of steps, so that a \
     start at rest is one half a step later; it is of second order",
);

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A33",
        title: "Pendulum",
        setup: "A rod of 1 m on a hinge is let go from the horizontal: 10 s of it in steps of 1 ms.",
        sources: &[REDUCED],
        measure: Measure::Small(pendulum),
    },
    Definition {
        id: "A34",
        title: "Double pendulum",
        setup: "Two rods of 0.8 m on hinges, at 2 and 1.2 rad from the vertical, 1.2 s.",
        sources: &[REDUCED],
        measure: Measure::Small(double_pendulum),
    },
    Definition {
        id: "A35",
        title: "Slider-crank",
        setup: "A crank of 0.1 m at 8 rad/s drives a slider of 3 kg through a rod of 0.35 m without mass, 1 s.",
        sources: &[Source::Algebra("x = r cos + sqrt(l^2 - r^2 sin^2), torque = m x'' dx/dangle")],
        measure: Measure::Small(slider_crank),
    },
    Definition {
        id: "A36",
        title: "Four-bar linkage",
        setup: "Crank 0.2 m, coupler 0.6 m, rocker 0.5 m, ground 0.55 m, driven at 5 rad/s; hinges hold each other thrice over.",
        sources: &[Source::Algebra("two circles that meet")],
        measure: Measure::Small(four_bar),
    },
    Definition {
        id: "A37",
        title: "Gears",
        setup: "A torque of 3 N m on a gear that drives another of four times the radius, 3 s.",
        sources: &[Source::Algebra(
            "w_2 = -w_1 / 4, w_1' = T / (I_1 + I_2 / 16), torque on the second I_2 w_2'",
        )],
        measure: Measure::Small(gears),
    },
    Definition {
        id: "A38",
        title: "Motor with a limit",
        setup: "A motor on a pinion lifts 2 kg on a rack, with 3 N m and with 1.5 N m at most.",
        sources: &[Source::Algebra("it lifts at its speed, or lets down with what is left of gravity")],
        measure: Measure::Small(motor),
    },
    Definition {
        id: "A39",
        title: "Spring and damper",
        setup: "0.7 kg on a spring of 40 N/m, with and without a damper of 1.5 N s/m, 1 s.",
        sources: &[Source::Algebra(
            "x_0 cos(w t) without; with it e^(-d t) (cos + d / w sin), of first order in the step",
        )],
        measure: Measure::Small(oscillator),
    },
    Definition {
        id: "A40",
        title: "Driven wheel",
        setup: "A ball of 0.3 m on the axle of a carriage of 50 kg is driven at 1.5 rad/s on level ground.",
        sources: &[Source::Algebra("it rolls: speed = radius x rate"), RELAXED],
        measure: Measure::Small(wheel),
    },
    Definition {
        id: "A41",
        title: "Chain",
        setup: "20 links of 0.1 kg hang from one another; then the last has 100 t.",
        sources: &[Source::Algebra("they rest, and every joint carries what hangs below")],
        measure: Measure::Small(chain),
    },
    Definition {
        id: "A45",
        title: "Heavy weight on a light chain",
        setup: "A ball of 100 kg swings for 1 s on three links of 10 g and of 0.1 g, at 0.5 m/s and 3 m/s, steps of 5 ms: far beyond what the \
                links swing by.",
        sources: &[REDUCED],
        measure: Measure::Small(light_chain),
    },
    Definition {
        id: "A46",
        title: "Light beads over a drum",
        setup: "25 beads of 0.1 g on rods without mass roll over a fixed drum under 1.5 kg and 1 kg, 0.2 s in steps of 1 ms.",
        sources: &[Source::Algebra(
            "Atwood's machine: (m_1 - m_2) / (m_1 + m_2) g, tension 2 m_1 m_2 / (m_1 + m_2) g",
        )],
        measure: Measure::Small(drum),
    },
];

/// A body of this mass and moment of inertia, drawn as a small ball.
fn lump(world: &mut World, position: Vec3, mass: f64, inertia: f64) -> Result<BodyId, VerifyError> {
    let geometry = world.add_geometry(Geometry::sphere(1e-3)?);
    let mass = Some(MassProperties { mass, inertia: Mat3::from_diagonal(Vec3::splat(inertia)) });
    Ok(world.add_body(Body { mass, ..Body::new(geometry, MaterialId::default(), position) })?)
}

/// A thin rod between two points.
fn rod(world: &mut World, ends: [Vec3; 2], mass: f64) -> Result<BodyId, VerifyError> {
    let square = (ends[1] - ends[0]).length_squared();
    lump(world, 0.5 * (ends[0] + ends[1]), mass, mass * square / 12.0)
}

/// Classical Runge-Kutta of y' = f(y).
fn runge_kutta<const N: usize>(mut y: [f64; N], time: f64, f: impl Fn([f64; N]) -> [f64; N]) -> [f64; N] {
    let steps = (time / 2e-5).ceil();
    let h = time / steps;
    let at = |y: [f64; N], c: f64, k: [f64; N]| std::array::from_fn(|i| y[i] + c * k[i]);
    for _ in 0..steps as usize {
        let k1 = f(y);
        let k2 = f(at(y, 0.5 * h, k1));
        let k3 = f(at(y, 0.5 * h, k2));
        let k4 = f(at(y, h, k3));
        y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
    y
}

fn coordinate(world: &World, joint: JointId) -> f64 {
    world.joints()[joint.index()].state.coordinate
}

fn drive(world: &World, joint: JointId) -> f64 {
    world.joints()[joint.index()].state.drive
}

fn speed(rate: f64, limit: Option<f64>) -> Motor {
    Motor::Speed { speed: Profile::Constant(rate), limit: limit.map(Profile::Constant) }
}

/// Benches in both friction models, with the solver's defaults: joints are solved directly whatever the
/// tolerance.
fn benches(step: f64) -> Result<Vec<Bench>, VerifyError> {
    MODELS.into_iter().map(|model| Bench::new(step, 1e-3, Accuracy::SCENES, model)).collect()
}

fn pendulum() -> Result<Vec<Row>, VerifyError> {
    let (step, length, mass) = (1e-3, 1.0, 2.0);
    let mut rows = Vec::new();
    for mut bench in benches(step)? {
        let mut world = world(0.5, 0.0)?;
        let bar = rod(&mut world, [Vec3::ZERO, Vec3::new(length, 0.0, 0.0)], mass)?;
        let hinge = world.add_joint(Joint::revolute(None, bar, Vec3::ZERO, Vec3::Y))?;
        let mut worst = [0.0_f64; 2];
        for n in 0..10_000 {
            let before = world.bodies.position[bar.index()].z;
            let report = bench.step(&mut world)?;
            let height = 0.5 * (before + world.bodies.position[bar.index()].z);
            let energy = (report.kinetic_energy + mass * G * height).abs();
            let part = &mut worst[usize::from(n >= 5000)];
            *part = part.max(energy / (0.5 * mass * G * length));
        }
        let f = 1.5 * G / length;
        let [exact, _] = runge_kutta([0.0, 0.0], 10.0 + 0.5 * step, |[a, w]| [w, f * a.cos()]);
        rows.push(bench.row("angle after 10 s (rad)", coordinate(&world, hinge), exact, 1e-4));
        rows.push(bench.row("energy off in 5 s, over the largest", worst[0], 0.0, 2e-5));
        rows.push(bench.row("energy off in the next 5 s", worst[1], 0.0, 2e-5));
    }
    Ok(rows)
}

fn double_pendulum() -> Result<Vec<Row>, VerifyError> {
    let (step, length, time) = (5e-4, 0.8, 1.2);
    let (a0, b0) = (2.0_f64, 1.2_f64);
    let down = |angle: f64| Vec3::new(angle.sin(), 0.0, -angle.cos());
    let equations = |[a, b, u, v]: [f64; 4]| {
        let (c, s, g) = ((a - b).cos(), (a - b).sin(), G / length);
        let (m11, m12, m22) = (4.0 / 3.0, 0.5 * c, 1.0 / 3.0);
        let (f1, f2) = (-0.5 * s * v * v - 1.5 * g * a.sin(), 0.5 * s * u * u - 0.5 * g * b.sin());
        let d = m11 * m22 - m12 * m12;
        [u, v, (f1 * m22 - f2 * m12) / d, (f2 * m11 - f1 * m12) / d]
    };
    let [a, b, ..] = runge_kutta([a0, b0, 0.0, 0.0], time + 0.5 * step, equations);
    let exact = length * down(a) + 0.5 * length * down(b);
    let mut rows = Vec::new();
    for mut bench in benches(step)? {
        let mut world = world(0.5, 0.0)?;
        let knee = length * down(a0);
        let upper = rod(&mut world, [Vec3::ZERO, knee], 1.0)?;
        let lower = rod(&mut world, [knee, knee + length * down(b0)], 1.0)?;
        world.add_joint(Joint::revolute(None, upper, Vec3::ZERO, Vec3::Y))?;
        world.add_joint(Joint::revolute(Some(upper), lower, knee, Vec3::Y))?;
        bench.steps(&mut world, (time / step).round() as usize)?;
        let found = world.bodies.position[lower.index()];
        rows.push(bench.row("x of the lower rod (m)", found.x, exact.x, 1e-5));
        rows.push(bench.row("z of the lower rod (m)", found.z, exact.z, 1e-5));
    }
    Ok(rows)
}

fn slider_crank() -> Result<Vec<Row>, VerifyError> {
    let (r, l, rate, mass, step) = (0.1, 0.35, 8.0, 3.0, 5e-4);
    let position = |angle: f64| r * angle.cos() + (l * l - (r * angle.sin()).powi(2)).sqrt();
    let mut rows = Vec::new();
    for mut bench in benches(step)? {
        let mut world = world(0.5, 0.0)?;
        world.gravity = Vec3::ZERO;
        let (pin, end) = (Vec3::new(r, 0.0, 0.0), Vec3::new(r + l, 0.0, 0.0));
        let crank = lump(&mut world, Vec3::ZERO, 1e-3, 1e-7)?;
        let connecting = lump(&mut world, 0.5 * (pin + end), 1e-6, 1e-9)?;
        let slider = lump(&mut world, end, mass, 1e-2)?;
        let main = Joint::revolute(None, crank, Vec3::ZERO, Vec3::Z).with_motor(speed(rate, None));
        let main = world.add_joint(main)?;
        world.add_joint(Joint::revolute(Some(crank), connecting, pin, Vec3::Z))?;
        world.add_joint(Joint::revolute(Some(connecting), slider, end, Vec3::Z))?;
        world.add_joint(Joint::prismatic(None, slider, end, Vec3::X))?;
        let (mut off, mut torque_off, mut largest) = (0.0_f64, 0.0_f64, 0.0_f64);
        for n in 1..=2000 {
            bench.step(&mut world)?;
            let angle = f64::from(n) * step * rate;
            off = off.max((world.bodies.position[slider.index()].x - position(angle)).abs());
            if n > 1 {
                // The torque of a step holds at its start.
                let (at, h) = (angle - step * rate, 1e-4);
                let slope = (position(at + h) - position(at - h)) / (2.0 * h);
                let bend = (position(at + h) - 2.0 * position(at) + position(at - h)) / (h * h);
                let exact = mass * rate * rate * bend * slope;
                largest = largest.max(exact.abs());
                torque_off = torque_off.max((drive(&world, main) - exact).abs());
            }
        }
        rows.push(bench.row("largest error of the position (m)", off, 0.0, 1e-12));
        rows.push(bench.row(
            "largest error of the torque, over the largest",
            torque_off / largest,
            0.0,
            1e-4,
        ));
    }
    Ok(rows)
}

fn four_bar() -> Result<Vec<Row>, VerifyError> {
    let (crank_length, coupler_length, rocker_length, ground): (f64, f64, f64, f64) = (0.2, 0.6, 0.5, 0.55);
    let knee = |angle: f64| {
        let pin = crank_length * Vec3::new(angle.cos(), 0.0, angle.sin());
        let d = Vec3::new(ground, 0.0, 0.0) - pin;
        let (square, c) = (d.length_squared(), d.length());
        let along = (coupler_length.powi(2) - rocker_length.powi(2) + square) / (2.0 * c);
        let across = (coupler_length.powi(2) - along * along).sqrt();
        (pin, pin + along / c * d + across / c * Vec3::new(-d.z, 0.0, d.x))
    };
    let mut rows = Vec::new();
    for mut bench in benches(1e-3)? {
        let mut world = world(0.5, 0.0)?;
        let (pin, joint) = knee(0.0);
        let far = Vec3::new(ground, 0.0, 0.0);
        let crank = rod(&mut world, [Vec3::ZERO, pin], 0.4)?;
        let coupler = rod(&mut world, [pin, joint], 1.0)?;
        let rocker = rod(&mut world, [joint, far], 0.8)?;
        world.add_joint(Joint::revolute(None, crank, Vec3::ZERO, Vec3::Y).with_motor(speed(-5.0, None)))?;
        world.add_joint(Joint::revolute(Some(crank), coupler, pin, Vec3::Y))?;
        world.add_joint(Joint::revolute(Some(coupler), rocker, joint, Vec3::Y))?;
        let output = world.add_joint(Joint::revolute(None, rocker, far, Vec3::Y))?;
        let start = (joint - far).z.atan2((joint - far).x);
        let mut off = 0.0_f64;
        for n in 1..=1500 {
            bench.step(&mut world)?;
            let arm = knee(5e-3 * f64::from(n)).1 - far;
            off = off.max((coordinate(&world, output) - (start - arm.z.atan2(arm.x))).abs());
        }
        rows.push(bench.row("largest error of the rocker's angle (rad)", off, 0.0, 1e-11));
    }
    Ok(rows)
}

fn gears() -> Result<Vec<Row>, VerifyError> {
    let (i1, i2, ratio, torque, step): (f64, f64, f64, f64, f64) = (0.02, 0.5, -0.25, 3.0, 1e-3);
    let acceleration = torque / (i1 + ratio * ratio * i2);
    let mut rows = Vec::new();
    for mut bench in benches(step)? {
        let mut world = world(0.5, 0.0)?;
        let first = lump(&mut world, Vec3::ZERO, 1.0, i1)?;
        let second = lump(&mut world, Vec3::X, 4.0, i2)?;
        let motor = Motor::Force(Profile::Constant(torque));
        let a = world.add_joint(Joint::revolute(None, first, Vec3::ZERO, Vec3::Z).with_motor(motor))?;
        let b = world.add_joint(Joint::revolute(None, second, Vec3::X, Vec3::Z))?;
        let gear = world.add_joint(Joint::gear([a, b], ratio))?;
        bench.steps(&mut world, 3000)?;
        let [wa, wb] = [first, second].map(|body| world.bodies.angular_velocity[body.index()].z);
        let exact = acceleration * step * 3000.0;
        rows.push(bench.row("speed of the first (rad/s)", wa, exact, 1e-11 * exact));
        rows.push(bench.row("ratio of the speeds", wb / wa, ratio, 1e-14));
        let carried = i2 * ratio * acceleration;
        rows.push(bench.row("torque on the second (N m)", drive(&world, gear), carried, 1e-10));
        rows.push(bench.row("slip of the teeth (rad)", coordinate(&world, gear), 0.0, 1e-10));
    }
    Ok(rows)
}

fn motor() -> Result<Vec<Row>, VerifyError> {
    let (mass, radius, inertia): (f64, f64, f64) = (2.0, 0.1, 1e-3);
    let mut rows = Vec::new();
    for limit in [3.0, 1.5] {
        for mut bench in benches(1e-3)? {
            let mut world = world(0.5, 0.0)?;
            let weight = lump(&mut world, Vec3::ZERO, mass, 1e-3)?;
            let pinion = lump(&mut world, Vec3::X, 1.0, inertia)?;
            let turn = Joint::revolute(None, pinion, Vec3::X, Vec3::Y).with_motor(speed(2.0, Some(limit)));
            let turn = world.add_joint(turn)?;
            let slide = world.add_joint(Joint::prismatic(None, weight, Vec3::ZERO, Vec3::Z))?;
            world.add_joint(Joint::gear([turn, slide], radius))?;
            bench.steps(&mut world, 1000)?;
            let found = world.bodies.velocity[weight.index()].z;
            let (exact, torque) = if limit > mass * G * radius {
                (2.0 * radius, mass * G * radius)
            } else {
                ((limit / radius - mass * G) / (mass + inertia / (radius * radius)), limit)
            };
            rows.push(bench.row(format!("speed with {limit} N m (m/s)"), found, exact, 1e-10));
            rows.push(bench.row(format!("torque with {limit} N m (N m)"), drive(&world, turn), torque, 1e-9));
        }
    }
    Ok(rows)
}

fn oscillator() -> Result<Vec<Row>, VerifyError> {
    let (mass, stiffness, step) = (0.7_f64, 40.0, 1e-4);
    let mut rows = Vec::new();
    for damping in [0.0, 1.5] {
        for mut bench in benches(step)? {
            let mut world = world(0.5, 0.0)?;
            world.gravity = Vec3::ZERO;
            let ball = lump(&mut world, Vec3::ZERO, mass, 1e-3)?;
            let slide = Joint::prismatic(None, ball, Vec3::ZERO, Vec3::X).with_spring(stiffness, damping);
            world.add_joint(slide)?;
            world.bodies.position[ball.index()].x = 0.1;
            bench.steps(&mut world, 10_000)?;
            let d = 0.5 * damping / mass;
            let w = (stiffness / mass - d * d).sqrt();
            let t = world.time + 0.5 * step;
            let exact = 0.1 * (-d * t).exp() * ((w * t).cos() + d / w * (w * t).sin());
            let allowed = if damping > 0.0 { 5e-5 } else { 1e-7 };
            let found = world.bodies.position[ball.index()].x;
            rows.push(bench.row(format!("x with a damper of {damping} N s/m (m)"), found, exact, allowed));
        }
    }
    Ok(rows)
}

fn wheel() -> Result<Vec<Row>, VerifyError> {
    let (radius, rate) = (0.3, 1.5);
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-9) {
            let mut bench = Bench::new(1e-3, 1e-3, accuracy, model)?;
            let mut world = world(0.5, 0.0)?;
            add_ground(&mut world, 0.0)?;
            let hub = Vec3::new(0.0, 0.0, radius);
            let ball = world.add_geometry(Geometry::sphere(radius)?);
            let wheel = world.add_body(Body::new(ball, MaterialId::default(), hub))?;
            let carriage = lump(&mut world, hub, 50.0, 1.0)?;
            let guide = lump(&mut world, hub + Vec3::Y, 1.0, 1.0)?;
            let axle =
                Joint::revolute(Some(carriage), wheel, hub, Vec3::Y).with_motor(speed(rate, Some(60.0)));
            world.add_joint(axle)?;
            // The carriage may rise and go ahead, but not turn.
            world.add_joint(Joint::prismatic(None, guide, hub, Vec3::Z))?;
            world.add_joint(Joint::prismatic(Some(guide), carriage, hub, Vec3::X))?;
            bench.steps(&mut world, 1500)?;
            let found = world.bodies.velocity[carriage.index()].x;
            let digits = accuracy.allowed(1e-9, G * 1e-3);
            let turns = world.bodies.angular_velocity[wheel.index()].y;
            rows.push(bench.row("rate of the wheel (rad/s)", turns, rate, digits / radius));
            rows.push(bench.row("speed over radius x rate", found / (radius * turns), 1.0, digits));
        }
    }
    Ok(rows)
}

fn chain() -> Result<Vec<Row>, VerifyError> {
    let (count, length, mass) = (20, 0.1, 0.1);
    let mut rows = Vec::new();
    for last in [0.1, 1e5] {
        for mut bench in benches(1e-3)? {
            let mut world = world(0.5, 0.0)?;
            let (mut above, mut joints) = (None, Vec::new());
            for k in 0..count {
                let ends = [k, k + 1].map(|k| Vec3::new(0.0, 0.0, -length * f64::from(k)));
                let link = rod(&mut world, ends, if k == count - 1 { last } else { mass })?;
                joints.push(world.add_joint(Joint::spherical(above, link, ends[0]))?);
                above = Some(link);
            }
            bench.steps(&mut world, 500)?;
            let fastest = world.bodies.velocity.iter().map(|u| u.length()).fold(0.0, f64::max);
            let carried = |k: i32| G * (f64::from(count - 1 - k) * mass + last);
            let force = |joint: &JointId| world.joints()[joint.index()].state.force;
            let off = joints
                .iter()
                .zip(0..)
                .map(|(joint, k)| (force(joint) - Vec3::new(0.0, 0.0, carried(k))).length() / carried(k));
            let off = off.fold(0.0, f64::max);
            let with = if last > mass { "with 100 t" } else { "alone" };
            rows.push(bench.row(format!("largest speed, {with} (m/s)"), fastest, 0.0, 1e-9));
            rows.push(bench.row(
                format!("largest relative error of a joint's force, {with}"),
                off,
                0.0,
                1e-9,
            ));
        }
    }
    Ok(rows)
}

/// A rigid body (its centre `arm` from the pin, this radius of gyration) on a rod without mass, angles from
/// the vertical.
fn hanging_body([a, b, u, v]: [f64; 4], length: f64, arm: f64, gyration: f64) -> [f64; 4] {
    let (sin, cos) = (a - b).sin_cos();
    let coupling = length * arm * cos;
    let [m, n] = [length * length, arm * arm + gyration * gyration];
    let f = -length * arm * sin * v * v - G * length * a.sin();
    let h = length * arm * sin * u * u - G * arm * b.sin();
    let determinant = m * n - coupling * coupling;
    [u, v, (n * f - coupling * h) / determinant, (m * h - coupling * f) / determinant]
}

fn light_chain() -> Result<Vec<Row>, VerifyError> {
    let (step, heavy, length, arm, radius) = (5e-3, 100.0, 0.3, 0.2, 0.2);
    let mut rows = Vec::new();
    for (light, speed) in [(1e-2, 0.5), (1e-4, 0.5), (1e-2, 3.0)] {
        let [a, b, ..] = runge_kutta([0.0, 0.0, speed / length, 0.0], 1.0, |y| {
            hanging_body(y, length, arm, 0.4_f64.sqrt() * radius)
        });
        let exact = Vec3::new(length * a.sin() + arm * b.sin(), 0.0, -length * a.cos() - arm * b.cos());
        for mut bench in benches(step)? {
            let mut world = world(0.5, 0.0)?;
            let pin = |k: usize| Vec3::new(0.0, 0.0, -0.1 * k as f64);
            let ball = lump(&mut world, pin(3) - arm * Vec3::Z, heavy, 0.4 * heavy * radius * radius)?;
            world.bodies.velocity[ball.index()].x = speed;
            let mut above = None;
            for k in 0..3 {
                let link = rod(&mut world, [pin(k), pin(k + 1)], light)?;
                world.add_joint(Joint::spherical(above, link, pin(k)))?;
                above = Some(link);
            }
            world.add_joint(Joint::spherical(above, ball, pin(3)))?;
            let mut opening = 0.0_f64;
            for _ in 0..(1.0 / step).round() as usize {
                opening = opening.max(bench.step(&mut world)?.errors.joint_opening_max);
            }
            let off = (world.bodies.position[ball.index()] - exact).length();
            let what = format!("links of {light} kg, {speed} m/s");
            rows.push(bench.row(
                format!("place of the ball off (m), {what}"),
                off,
                0.0,
                4e-4 * speed * speed,
            ));
            rows.push(bench.row(format!("joints open by (m), {what}"), opening, 0.0, 1e-10));
        }
    }
    Ok(rows)
}

fn drum() -> Result<Vec<Row>, VerifyError> {
    let ([fast, slow], step, time) = ([1.5, 1.0], 1e-3, 0.2);
    let mut rows = Vec::new();
    for mut bench in benches(step)? {
        let mut world = world(0.5, 0.0)?;
        let drum = world.add_geometry(Geometry::cylinder(0.2, 0.5)?);
        let motion = world.add_motion(Motion::fixed())?;
        let orientation = Quat::from_rotation_x(0.25 * TAU);
        world.add_body(Body { motion, orientation, ..Body::new(drum, MaterialId::default(), Vec3::ZERO) })?;
        let over = (0..25).map(|k| (0.5 * TAU * f64::from(k) / 24.0).sin_cos());
        let over = over.map(|(sin, cos)| (Vec3::new(0.51 * cos, 0.0, 0.51 * sin), 1e-4));
        let [first, last] = [(0.51, fast), (-0.51, slow)].map(|(x, mass)| (Vec3::new(x, 0.0, -0.1), mass));
        let bead = world.add_geometry(Geometry::sphere(0.01)?);
        let mut before: Option<(BodyId, Vec3)> = None;
        let mut weight = None;
        for (place, mass) in std::iter::once(first).chain(over).chain([last]) {
            let inertia = Mat3::from_diagonal(Vec3::splat(4e-5 * mass));
            let mass = Some(MassProperties { mass, inertia });
            let body = world.add_body(Body { mass, ..Body::new(bead, MaterialId::default(), place) })?;
            weight.get_or_insert(body);
            if let Some((other, end)) = before.replace((body, place)) {
                world.add_joint(Joint::distance(Some(other), body, [end, place]))?;
            }
        }
        bench.steps(&mut world, (time / step).round() as usize)?;
        let fall = weight.map_or(f64::NAN, |weight| -world.bodies.velocity[weight.index()].z);
        let exact = (fast - slow) / (fast + slow) * G * time;
        rows.push(bench.row("speed after 0.2 s (m/s)", fall, exact, 0.01 * exact));
        let tension = 2.0 * fast * slow / (fast + slow) * G;
        let found = world.joints()[0].state.force.length();
        rows.push(bench.row("tension (N)", found, tension, 0.01 * tension));
    }
    Ok(rows)
}
