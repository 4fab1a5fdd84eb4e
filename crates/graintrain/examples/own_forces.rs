//! Own forces: a program sets forces on bodies between steps (wind that pushes light balls), and removes what
//! has left.
//!
//! `cargo run --release -p graintrain --example own_forces`

use graintrain::handle::{BodyId, MaterialId};
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::{Body, World};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let foam = Materials::single("foam", 30.0, 0.3, 0.0)?;
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), foam)?;
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    world.add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })?;
    let ball = world.add_geometry(Geometry::sphere(0.02)?);
    for i in 0..10_u32 {
        world.add_body(Body::new(ball, MaterialId::default(), Vec3::new(0.0, 0.05 * f64::from(i), 0.02)))?;
    }
    let mut stepper = Stepper::new(StepSettings { envelope: 2e-3, ..Default::default() })?;
    for step in 1..=1500 {
        world.clear_forces();
        for b in 1..world.bodies.len() {
            // Drag of a wind of 5 m/s along x, at the centre: 1/2 rho c_d A |v| v.
            let relative = Vec3::new(5.0, 0.0, 0.0) - world.bodies.velocity[b];
            let force = 0.5 * 1.2 * 0.47 * 1.26e-3 * relative.length() * relative;
            world.add_force_at(BodyId::from_index(b), force, world.bodies.position[b])?;
        }
        stepper.step(&mut world)?;
        let away: Vec<bool> = world.bodies.position.iter().map(|x| x.x > 1.0).collect();
        if away.contains(&true) {
            world.remove_bodies(|body| away[body]);
        }
        if step % 300 == 0 {
            println!("{:.1} s: {} balls left", world.time, world.bodies.len() - 1);
        }
    }
    Ok(())
}
