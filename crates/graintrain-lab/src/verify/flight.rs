//! Bodies without contact, and the top: A1, A15, A16.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, world};
use super::source::{GOLDSTEIN, LANDAU, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::joint::Joint;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::shape::{Cylinder, Geometry, Part, Shape, Sphere};
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel::{self, Relaxed};
use std::f64::consts::FRAC_PI_2;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A1",
        title: "Free flight",
        setup: "A sphere is thrown at (0.5, -0.3, 4) m/s and flies for 1 s without touching anything.",
        sources: &[Source::Algebra("the parabola x_0 + t v_0 + g t^2 / 2")],
        measure: Measure::Small(free_flight),
    },
    Definition {
        id: "A15",
        title: "Torque-free body that turns over",
        setup: "A body with principal moments of inertia 1, 2, 3 kg m^2 spins at 1 rad/s about its middle axis, disturbed by 0.01 rad/s about \
                the others.",
        sources: &[LANDAU],
        measure: Measure::Small(turning_over),
    },
    Definition {
        id: "A16",
        title: "Heavy top",
        setup: "A disc on a thin tip, 5 cm from tip to centre of mass, spins on a rough plane: tilted by 0.4 rad at 300 rad/s, and \
                nearly upright at 1.2 and 0.8 of the critical spin. A wheel at 100 rad/s on the free end of a horizontal axle of 20 cm \
                precesses about a ball joint.",
        sources: &[GOLDSTEIN],
        measure: Measure::Small(heavy_top),
    },
];

fn free_flight() -> Result<Vec<Row>, VerifyError> {
    let (step, steps) = (1e-3, 1000);
    let mut world = world(0.0, 0.0)?;
    let ball = add_sphere(&mut world, 0.1, Vec3::new(1.0, 2.0, 3.0))?;
    world.bodies.velocity[ball] = Vec3::new(0.5, -0.3, 4.0);
    let mut bench = Bench::new(step, 0.01, Accuracy::SCENES, Relaxed)?;
    bench.steps(&mut world, steps)?;
    let rows = [bench.row("height after 1 s (m)", world.bodies.position[ball].z, 3.0 + 4.0 - 0.5 * G, 1e-12)];
    Ok(rows.map(Row::without_contact).into())
}

fn turning_over() -> Result<Vec<Row>, VerifyError> {
    let mut world = world(0.0, 0.0)?;
    world.gravity = Vec3::ZERO;
    let body = add_sphere(&mut world, 0.1, Vec3::ZERO)?;
    world.bodies.inertia[body] = Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0));
    world.bodies.angular_velocity[body] = Vec3::new(0.01, 1.0, 0.01);
    let own =
        |world: &World| world.bodies.orientation[body].conjugate() * world.bodies.angular_velocity[body];
    let inertia = world.bodies.inertia[body];
    let energy = world.kinetic_energy();
    let momentum = (inertia * own(&world)).length();
    let (step, mut turns) = (1e-3, Vec::new());
    let mut bench = Bench::new(step, 0.0, Accuracy::SCENES, Relaxed)?;
    let mut last = 1.0;
    for _ in 0..51_000 {
        bench.step(&mut world)?;
        let now = own(&world).y;
        if now * last < 0.0 {
            turns.push(world.time - step * now / (now - last));
        }
        last = now;
    }
    let turn = |k: usize| turns.get(k).copied().unwrap_or(f64::NAN);
    let rows = [
        bench.row("first turn-over (s)", turn(0), 10.9169, 0.109),
        bench.row("second turn-over (s)", turn(1), 30.4698, 0.305),
        bench.row("third turn-over (s)", turn(2), 50.0226, 0.5),
        bench.row("relative drift of the energy (1)", world.kinetic_energy() / energy - 1.0, 0.0, 1e-4),
        bench.row(
            "relative drift of the angular momentum (1)",
            (inertia * own(&world)).length() / momentum - 1.0,
            0.0,
            1e-6,
        ),
    ];
    Ok(rows.map(Row::without_contact).into())
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

impl Top {
    fn new(tilt: f64, spin: f64) -> Result<Self, VerifyError> {
        let mut world = world(2.0, 0.0)?;
        add_ground(&mut world, 0.0)?;
        let (tip, length) = (1e-5, 0.05);
        let part = |shape, z| Part { shape, position: Vec3::new(0.0, 0.0, z), orientation: Quat::IDENTITY };
        let disc = Shape::Cylinder(Cylinder { half_length: 0.005, radius: 0.04 });
        let (form, centre) =
            Geometry::compound(vec![part(Shape::Sphere(Sphere { radius: tip }), 0.0), part(disc, length)])?;
        let across = form.unit_inertia.x_axis.x / form.volume + centre.z * centre.z;
        let along = form.unit_inertia.z_axis.z / form.volume;
        let form = world.add_geometry(form);
        let orientation = Quat::from_rotation_y(tilt);
        let position = orientation * centre + Vec3::new(0.0, 0.0, tip);
        let angular_velocity = spin * (orientation * Vec3::Z);
        let body = world.add_body(Body {
            orientation,
            angular_velocity,
            ..Body::new(form, MaterialId::default(), position)
        })?;
        Ok(Self { world, body: body.index(), length: centre.z, across, along })
    }

    fn tilt(&self) -> f64 {
        (self.world.bodies.orientation[self.body] * Vec3::Z).z.clamp(-1.0, 1.0).acos()
    }
}

fn heavy_top() -> Result<Vec<Row>, VerifyError> {
    let mut rows = gyroscope()?.to_vec();
    for model in MODELS {
        rows.extend(precession(model)?);
        rows.extend(sleeping(model)?);
    }
    Ok(rows)
}

/// Steady precession: I1 cos(tilt) W^2 - I3 w3 W + m g l = 0.
fn precession(model: FrictionModel) -> Result<[Row; 2], VerifyError> {
    let (spin, tilt) = (300.0, 0.4_f64);
    let mut top = Top::new(tilt, spin)?;
    let (fall, along, across) = (G * top.length, top.along, top.across);
    // Fixed-point iterations of the quadratic with w3 = spin + W cos(tilt).
    let steady = |w: f64| (fall + across * tilt.cos() * w * w) / (along * (spin + w * tilt.cos()));
    let rate = (0..4).fold(fall / (along * spin), |w, _| steady(w));
    // Regular precession from the start: no nutation.
    let arm = top.world.bodies.position[top.body];
    top.world.bodies.angular_velocity[top.body] += rate * Vec3::Z;
    top.world.bodies.velocity[top.body] = (rate * Vec3::Z).cross(arm);
    let mut bench = Bench::new(1e-4, 1e-4, Accuracy::SCENES, model)?;
    bench.steps(&mut top.world, 5_000)?;
    let axis = top.world.bodies.orientation[top.body] * Vec3::Z;
    let turned = axis.y.atan2(axis.x) / top.world.time;
    Ok([
        bench.row("rate of precession (rad/s)", turned, rate, 0.01 * rate),
        bench.row("tilt after 0.5 s (rad)", top.tilt(), tilt, 0.01 * tilt),
    ])
}

/// Regular precession of a horizontal axle: W = m g l / (I3 w3), with I3 w3 of the wheel.
fn gyroscope() -> Result<[Row; 2], VerifyError> {
    let (arm, spin, step, steps) = (0.2, 100.0, 1e-3, 3000);
    let mut world = world(0.0, 0.0)?;
    let form = world.add_geometry(Geometry::cylinder(0.01, 0.1)?);
    let turned = Quat::from_rotation_y(FRAC_PI_2);
    let wheel = world
        .add_body(Body { orientation: turned, ..Body::new(form, MaterialId::default(), arm * Vec3::X) })?;
    world.add_joint(Joint::spherical(None, wheel, Vec3::ZERO))?;
    let body = wheel.index();
    let rate = world.bodies.mass[body] * G * arm / (world.bodies.inertia[body].z_axis.z * spin);
    world.bodies.angular_velocity[body] = spin * Vec3::X + rate * Vec3::Z;
    world.bodies.velocity[body] = arm * rate * Vec3::Y;
    let mut bench = Bench::new(step, 1e-3, Accuracy::SCENES, Relaxed)?;
    let (mut angle, mut last) = (0.0, Vec3::X);
    for _ in 0..steps {
        bench.step(&mut world)?;
        let axle = world.bodies.position[body];
        angle += last.cross(axle).z.atan2(last.dot(axle));
        last = axle;
    }
    let rows = [
        bench.row("gyroscope on a joint: rate of precession (rad/s)", angle / world.time, rate, 1e-3 * rate),
        bench.row("gyroscope on a joint: height over the arm after 3 s", last.z / arm, 0.0, 1e-3),
    ];
    Ok(rows.map(Row::without_contact))
}

/// A sleeping top is stable exactly if w3^2 >= 4 I1 m g l / I3^2.
fn sleeping(model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let Top { length, across, along, .. } = Top::new(0.0, 0.0)?;
    let critical = (4.0 * across * G * length).sqrt() / along;
    let mut rows = Vec::new();
    for (factor, stable) in [(1.2, 1.0), (0.8, 0.0)] {
        let mut top = Top::new(1e-3, factor * critical)?;
        let mut bench = Bench::new(5e-5, 1e-4, Accuracy::SCENES, model)?;
        let mut widest: f64 = 0.0;
        for _ in 0..10_000 {
            bench.step(&mut top.world)?;
            widest = widest.max(top.tilt());
        }
        let what = format!(
            "stays within 0.01 rad for 0.5 s at {factor} of the critical spin (1: yes; tilt up to {widest:.1e} rad)"
        );
        rows.push(bench.row(what, f64::from(u8::from(widest < 1e-2)), stable, 0.0));
    }
    Ok(rows)
}
