//! A custom shape mix: boxes, capsules, cylinders and dumb-bells (compounds of three parts) fall on a heap.
//!
//! `cargo run --release -p graintrain --example shape_mix`

use graintrain::handle::MaterialId;
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::Motion;
use graintrain::shape::{Cuboid, Geometry, Part, Shape, Sphere};
use graintrain::stepper::{StepSettings, Stepper};
use graintrain::world::{Body, World};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let wood = Materials::single("wood", 700.0, 0.4, 0.0)?;
    let mut world = World::new(Vec3::new(0.0, 0.0, -9.81), wood)?;
    let plane = world.add_geometry(Geometry::plane());
    let fixed = world.add_motion(Motion::fixed())?;
    world.add_body(Body { motion: fixed, ..Body::new(plane, MaterialId::default(), Vec3::ZERO) })?;
    let part = |shape, x| Part { shape, position: Vec3::new(x, 0.0, 0.0), orientation: Quat::IDENTITY };
    let end = || Shape::Sphere(Sphere { radius: 0.015 });
    let bar = Shape::Box(Cuboid { half: Vec3::new(0.02, 0.005, 0.005) });
    let (dumb_bell, _centre) =
        Geometry::compound(vec![part(end(), -0.025), part(bar, 0.0), part(end(), 0.025)])?;
    let shapes = [
        Geometry::cuboid(Vec3::new(0.03, 0.02, 0.01))?,
        Geometry::capsule(0.02, 0.012)?,
        Geometry::cylinder(0.02, 0.015)?,
        dumb_bell,
    ]
    .map(|shape| world.add_geometry(shape));
    for i in 0..40_u32 {
        let place =
            Vec3::new(0.09 * f64::from(i % 2), 0.09 * f64::from(i / 2 % 2), 0.05 + 0.08 * f64::from(i / 4));
        let orientation = Quat::from_axis_angle(Vec3::ONE.normalize(), f64::from(i));
        world.add_body(Body {
            orientation,
            ..Body::new(shapes[(i * 7 / 3 % 4) as usize], MaterialId::default(), place)
        })?;
    }
    let mut stepper = Stepper::new(StepSettings { step: 2e-3, envelope: 2e-3, ..Default::default() })?;
    for _ in 0..1000 {
        stepper.step(&mut world)?;
    }
    let top = world.bodies.position.iter().fold(0.0, |top: f64, x| top.max(x.z));
    let (contacts, energy) = (world.contacts.contacts.len(), world.kinetic_energy());
    println!("40 bodies, {contacts} contacts, highest centre at {top:.3} m, {energy:.1e} J");
    Ok(())
}
