//! First pile: 64 balls fall on the ground and come to rest. No files, only the core crate.
//!
//! `cargo run --release -p graintrain --example first_pile`

use graintrain::handle::MaterialId;
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::{Body, World};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // One material: name, density in kg/m^3, friction, restitution.
    let glass = Materials::single("glass", 2500.0, 0.3, 0.0)?;
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), glass)?;
    // Shapes and motions are added once and shared by bodies.
    let ball = world.add_geometry(Geometry::sphere(0.01)?);
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    let ground =
        world.add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })?;
    for i in 0..64_u32 {
        // A cube of 4 x 4 x 4 balls whose layers do not stand exactly on top of each other.
        let [x, y, z] = [i % 4, i / 4 % 4, i / 16].map(f64::from);
        let place = Vec3::new(0.022 * x + 0.003 * z, 0.022 * y - 0.002 * z, 0.02 + 0.025 * z);
        world.add_body(Body::new(ball, MaterialId::default(), place))?;
    }
    let settings = StepSettings { step: 2e-3, envelope: 0.003, ..StepSettings::default() };
    let mut stepper = Stepper::new(settings)?;
    for step in 1..=500 {
        let report = stepper.step(&mut world)?;
        if step % 100 == 0 {
            let floor = report.wrenches.iter().find(|wrench| wrench.body == ground);
            let (time, contacts, energy) = (world.time, report.contacts_with_force, report.kinetic_energy);
            let force = floor.map_or(0.0, |wrench| -wrench.force.z);
            println!("{time:.1} s: {contacts} contacts, {energy:.1e} J, {force:.3} N on the ground");
        }
    }
    let weight = 9.81 * world.bodies.mass.iter().sum::<f64>();
    println!("the balls weigh {weight:.3} N");
    Ok(())
}
