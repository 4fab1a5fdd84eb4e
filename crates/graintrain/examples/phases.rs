//! Seconds per phase of a step: (2 n + 1)^3 spheres fall into a box under a turning paddle.
//!
//! `cargo run --release -p graintrain --example phases -- n steps`

use graintrain::handle::MaterialId;
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let argument =
        |k: usize, default: usize| std::env::args().nth(k).map_or(Ok(default), |text| text.parse::<usize>());
    let (n, steps) = (argument(1, 8)?, argument(2, 60)?);
    let radius = 0.1;
    let side = 2 * n + 1;
    let half = 1.02 * radius * side as f64;
    let materials = Materials::single("grain", 1000.0, 0.25, 0.0)?;
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), materials)?;
    let fixed = world.add_motion(Motion::fixed())?;
    let plane = world.add_geometry(Geometry::plane());
    for normal in [Vec3::Z, Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y] {
        let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
        let point = if normal == Vec3::Z { Vec3::ZERO } else { -half * normal };
        world.add_body(Body {
            motion: fixed,
            orientation,
            ..Body::new(plane, MaterialId::default(), point)
        })?;
    }
    let turning = world.add_motion(Motion::rotating(Vec3::ZERO, Vec3::Z, Profile::Constant(1.0)))?;
    let paddle = world.add_geometry(Geometry::cuboid(Vec3::new(0.8 * half, 0.05, 2.0 * radius))?);
    let place = Vec3::new(0.0, 0.0, 2.0 * radius);
    world.add_body(Body { motion: turning, ..Body::new(paddle, MaterialId::default(), place) })?;
    let ball = world.add_geometry(Geometry::sphere(radius)?);
    let spacing = 2.02 * radius;
    for index in 0..side * side * side {
        let cell = [index % side, index / side % side, index / (side * side)].map(|i| i as f64 - n as f64);
        let jitter = 0.05 * radius * (index as f64 * 0.618).fract();
        let height = 6.0 * radius + spacing * (cell[2] + n as f64);
        let place = Vec3::new(0.98 * spacing * cell[0] + jitter, 0.98 * spacing * cell[1] - jitter, height);
        world.add_body(Body::new(ball, MaterialId::default(), place))?;
    }
    let mut stepper = Stepper::new(StepSettings {
        step: 0.025,
        envelope: 0.03,
        solver: SolverChoice {
            name: "apgd".parse()?,
            tolerance: 1e-2,
            criterion: graintrain::ccp::Criterion::Mixed,
            max_iterations: Some(200),
            friction: graintrain::ccp::FrictionModel::Relaxed,
        },
        ..StepSettings::default()
    })?;
    for k in 0..steps {
        let report = stepper.step(&mut world)?;
        let p = report.phases;
        if (k + 1) % 10 == 0 {
            println!(
                "step {}: {} contacts, ms: collide {:.1}, assemble {:.1}, solve {:.1} ({} iterations), integrate {:.1}",
                k + 1,
                report.contacts,
                1e3 * p.collide,
                1e3 * p.assemble,
                1e3 * p.solve,
                report.solve.iterations,
                1e3 * p.integrate
            );
        }
    }
    println!("state hash {:016x}", world.state_hash());
    Ok(())
}
