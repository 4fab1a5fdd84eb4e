//! Exact friction: a block is thrown along the ground at 5 m/s. The relaxed model makes it hop, Coulomb's
//! does not.
//!
//! `cargo run --release -p graintrain --example exact_friction`

use graintrain::ccp::FrictionModel;
use graintrain::handle::MaterialId;
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{SolverChoice, StepSettings, Stepper};
use graintrain::world::{Body, World};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
        let mut world =
            World::new(Vec3::new(0.0, 0.0, -9.81), Materials::single("stone", 2500.0, 0.5, 0.0)?)?;
        let plane = world.add_geometry(Geometry::plane());
        let fixed = world.add_motion(Motion::fixed())?;
        world.add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })?;
        // Flat enough not to tip over.
        let block = world.add_geometry(Geometry::cuboid(Vec3::new(0.5, 0.5, 0.05))?);
        let thrown = Body {
            velocity: Vec3::new(5.0, 0.0, 0.0),
            ..Body::new(block, MaterialId::default(), 0.05 * Vec3::Z)
        };
        let block = world.add_body(thrown)?.index();
        let settings = StepSettings {
            envelope: 0.01,
            solver: SolverChoice { tolerance: 1e-6, friction, ..SolverChoice::default() },
            ..Default::default()
        };
        let mut stepper = Stepper::new(settings)?;
        let mut highest: f64 = 0.0;
        for _ in 0..1500 {
            stepper.step(&mut world)?;
            highest = highest.max(world.bodies.position[block].z - 0.05);
        }
        let way = world.bodies.position[block].x;
        println!("{friction:?}: slid {way:.3} m (v^2 / 2 mu g = 2.548 m), hop {highest:.3} m");
    }
    Ok(())
}
