//! Driven blade: a blade pushes a row of boxes over the ground, and the force on it is read in every step.
//!
//! `cargo run --release -p graintrain --example driven_blade`

use graintrain::handle::MaterialId;
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::{Body, World};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let materials = Materials::single("stone", 2500.0, 0.3, 0.0)?;
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), materials)?;
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    world.add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })?;
    // A cuboid takes half its edges: cubes of 4 cm, the blade meets one after the other.
    let cube = world.add_geometry(Geometry::cuboid(Vec3::splat(0.02))?);
    for i in 1..=4_u32 {
        world.add_body(Body::new(cube, MaterialId::default(), Vec3::new(0.06 * f64::from(i), 0.0, 0.02)))?;
    }
    let blade = world.add_geometry(Geometry::cuboid(Vec3::new(0.005, 0.1, 0.05))?);
    let driven = world.add_motion(Motion::translating(Vec3::X, Profile::Constant(0.1)))?;
    let blade = world.add_body(Body {
        motion: driven,
        ..Body::new(blade, MaterialId::default(), Vec3::new(0.0, 0.0, 0.052))
    })?;
    let mut stepper = Stepper::new(StepSettings { step: 1e-3, envelope: 0.002, ..Default::default() })?;
    let mut drag = 0.0;
    for step in 1..=1500 {
        let report = stepper.step(&mut world)?;
        let on_blade = report.wrenches.iter().find(|wrench| wrench.body == blade);
        drag -= on_blade.map_or(0.0, |wrench| wrench.force.x) / 100.0;
        if step % 100 == 0 {
            println!("{:.1} s: drag {drag:.3} N (mu m g of one cube is 0.471 N)", world.time);
            drag = 0.0;
        }
    }
    Ok(())
}
