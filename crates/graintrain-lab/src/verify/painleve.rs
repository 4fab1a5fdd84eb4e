//! The paradox of the sliding rod: A14.

use super::bench::{Accuracy, Bench, G, add_ground, world};
use super::source::{GENOT_BROGLIATO, PAINLEVE};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};

/// The cases.
pub const CASES: &[Definition] = &[Definition {
    id: "A14",
    title: "Painleve's rod",
    setup: "The tip of a thin rod at 63.43 degrees to the ground slides towards its lean at 3 m/s for 0.1 s, mu below and above 4/3, from \
            where on no finite force is a solution: it jams by an impact of friction.",
    sources: &[PAINLEVE, GENOT_BROGLIATO],
    measure: Measure::Small(rod),
}];

fn rod() -> Result<Vec<Row>, VerifyError> {
    let (half_length, radius) = (0.5, 1e-3);
    let angle = 63.43_f64.to_radians();
    let mut rows = Vec::new();
    for model in MODELS {
        for friction in [0.5, 1.2, 1.5, 2.0] {
            let mut world = world(friction, 0.0)?;
            add_ground(&mut world, 0.0)?;
            let rod = world.add_geometry(Geometry::capsule(half_length, radius)?);
            // Leans towards +x from the tip.
            let axis = Vec3::new(angle.cos(), 0.0, angle.sin());
            let orientation = Quat::from_rotation_arc(Vec3::Z, axis);
            let position = half_length * axis + Vec3::new(0.0, 0.0, radius);
            let body = world
                .add_body(Body { orientation, ..Body::new(rod, MaterialId::default(), position) })?
                .index();
            world.bodies.velocity[body] = Vec3::new(-3.0, 0.0, 0.0);
            let energy = |world: &World| {
                world.kinetic_energy() + world.bodies.mass[body] * G * world.bodies.position[body].z
            };
            let mut bench = Bench::new(1e-3, 0.01, Accuracy::SCENES, model)?;
            let first = energy(&world);
            let (mut last, mut rise) = (first, 0.0_f64);
            for _ in 0..100 {
                let report = bench.step(&mut world)?;
                let now = energy(&world);
                rise = rise.max((now - last - report.correction_energy) / first);
                last = now;
            }
            let what =
                format!("mu {friction}: largest rise of the energy in a step over the first energy (1)");
            rows.push(bench.row(what, rise, 0.0, 1e-6));
        }
    }
    Ok(rows)
}
