//! Rest: A10 to A13, A24.

use super::bench::{Accuracy, Bench, G, add_ground, add_plane, add_sphere, world};
use super::source::{OLSEN_KAMRIN, Source};
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::{Quat, Vec3};
use graintrain::shape::{Capsule, Cuboid, Geometry, Part, Shape};
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel;
use std::f64::consts::PI;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A10",
        title: "Stack of ten boxes",
        setup: "Ten boxes of 0.2 m stand on each other for 0.5 s at dt = 5 ms; in a second stack the top is 1000 times as dense.",
        sources: &[Source::Algebra("the force between two boxes is the weight above; nothing moves")],
        measure: Measure::Small(stacks),
    },
    Definition {
        id: "A11",
        title: "Pyramids of spheres",
        setup: "One sphere lies on two or three touching spheres of its size on a plane, with friction 0.002 above and below the thresholds \
                between spheres and on the ground.",
        sources: &[Source::Algebra(
            "statics: 2+1 stands exactly if mu >= 0.2679 (tan 15 degrees) between spheres and 0.0893 on the ground, 3+1 if 0.3178 and 0.0795",
        )],
        measure: Measure::Small(pyramids),
    },
    Definition {
        id: "A12",
        title: "Sphere in a groove",
        setup: "A sphere lies in a V between two planes at 30, 45 and 60 degrees from the vertical, without friction and with mu = 0.3.",
        sources: &[Source::Algebra(
            "statics: without friction each wall presses with m g / (2 sin); with friction forces add up to the weight within their cones",
        )],
        measure: Measure::Small(grooves),
    },
    Definition {
        id: "A13",
        title: "Table on four legs",
        setup: "A table stands on four legs of round ends, mu = 0.4: one force more than statics can tell.",
        sources: &[Source::Algebra("forces add up to the weight and moments to zero"), OLSEN_KAMRIN],
        measure: Measure::Small(table),
    },
    Definition {
        id: "A24",
        title: "Heavy on light",
        setup: "A box stands on an equal box that is a thousand or a million times lighter, for 1 s at dt = 5 ms, mu = 0.5.",
        sources: &[Source::Algebra("the forces are the weights above; nothing moves, nothing sinks in")],
        measure: Measure::Small(heavy_on_light),
    },
];

/// Normal force between two bodies, N, from the contacts of the last step.
fn normal_force(world: &World, step: f64, a: u32, b: u32) -> f64 {
    let set = &world.contacts;
    let both = set.contacts.iter().zip(&set.impulse);
    both.filter(|(c, _)| [(a, b), (b, a)].contains(&(c.body_a, c.body_b)))
        .map(|(c, impulse)| impulse.dot(c.normal) / step)
        .sum()
}

/// What a stack of boxes did: largest relative error of a force between two, and of a box's way over its
/// height per second; deepest overlap over the height.
struct Stood {
    bench: Bench,
    force: f64,
    creep: f64,
    overlap: f64,
}

/// Boxes of 0.2 m on each other; `top` is the density of the highest, the others have 1000 kg/m^3.
fn stack(
    count: u32,
    top: f64,
    steps: usize,
    accuracy: Accuracy,
    model: FrictionModel,
) -> Result<Stood, VerifyError> {
    let step = 0.005;
    let mut world = world(0.5, 0.0)?;
    let heavy = world.materials.add("top", top)?;
    for (i, j) in [(MaterialId::default(), heavy), (heavy, heavy)] {
        world.materials.set_pair(i, j, 0.5, 0.0)?;
    }
    add_ground(&mut world, 0.0)?;
    let block = world.add_geometry(Geometry::cuboid(Vec3::splat(0.1))?);
    for k in 0..count {
        let material = if k + 1 == count { heavy } else { MaterialId::default() };
        world.add_body(Body::new(block, material, Vec3::new(0.0, 0.0, 0.1 + 0.2 * f64::from(k))))?;
    }
    let start = world.bodies.position.clone();
    let mut bench = Bench::new(step, 0.01, accuracy, model)?;
    let mut overlap: f64 = 0.0;
    for _ in 0..steps {
        overlap = overlap.max(bench.step(&mut world)?.penetration_max / 0.2);
    }
    let (mut above, mut force) = (0.0, 0.0_f64);
    for level in (1..=count).rev() {
        above += world.bodies.mass[level as usize] * G;
        force = force.max((normal_force(&world, step, level, level - 1) / above - 1.0).abs());
    }
    let moved = start.iter().zip(&world.bodies.position).map(|(a, b)| (*a - *b).length());
    let creep = moved.fold(0.0, f64::max) / 0.2 / world.time;
    Ok(Stood { bench, force, creep, overlap })
}

fn stacks() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for (top, name) in [(1000.0, "equal"), (1e6, "top 1000 : 1")] {
            for accuracy in Accuracy::both(1e-10) {
                let Stood { bench, force, creep, .. } = stack(10, top, 100, accuracy, model)?;
                let what = format!("{name}: largest relative error of a force (1)");
                rows.push(bench.row(what, force, 0.0, accuracy.allowed(1e-6, 1.0)));
                let what = format!("{name}: creep over the size of a box (1/s)");
                rows.push(bench.row(what, creep, 0.0, accuracy.allowed(1e-6, G * 0.005 / 0.2)));
            }
        }
    }
    Ok(rows)
}

fn heavy_on_light() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for ratio in [1e3, 1e6] {
            let accuracy = Accuracy::SCENES;
            let Stood { bench, force, creep, overlap } = stack(2, 1000.0 * ratio, 200, accuracy, model)?;
            let row = |what: &str, measured, allowed| {
                bench.row(format!("{ratio:.0} : 1: {what}"), measured, 0.0, allowed)
            };
            let promise = accuracy.promise();
            rows.push(row("largest relative error of a force (1)", force, promise));
            rows.push(row("creep over the size of a box (1/s)", creep, promise * G * 0.005 / 0.2));
            rows.push(row("deepest overlap over the size of a box (1)", overlap, 1e-3));
        }
    }
    Ok(rows)
}

/// Equal spheres: a ring of `base` touching spheres on the ground and one on top. Displacement of the top
/// after half a second, m.
fn pyramid(
    base: usize,
    sphere_sphere: f64,
    sphere_ground: f64,
    accuracy: Accuracy,
    model: FrictionModel,
) -> Result<(Bench, f64), VerifyError> {
    let radius = 0.1;
    let mut world = world(sphere_sphere, 0.0)?;
    let ground_material = world.materials.add("ground", 1000.0)?;
    world.materials.set_pair(MaterialId::default(), ground_material, sphere_ground, 0.0)?;
    let ground = add_ground(&mut world, 0.0)?;
    world.bodies.material[ground.index()] = ground_material;
    let ring = radius / (PI / base as f64).sin();
    for k in 0..base {
        let angle = 2.0 * PI * k as f64 / base as f64;
        add_sphere(&mut world, radius, Vec3::new(ring * angle.cos(), ring * angle.sin(), radius))?;
    }
    let height = radius + (4.0 * radius * radius - ring * ring).sqrt();
    let top = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, height))?;
    let start = world.bodies.position[top];
    let mut bench = Bench::new(0.002, 1e-3, accuracy, model)?;
    bench.steps(&mut world, 250)?;
    Ok((bench, (world.bodies.position[top] - start).length()))
}

fn pyramids() -> Result<Vec<Row>, VerifyError> {
    let margin = 2e-3;
    let mut rows = Vec::new();
    for model in MODELS {
        for (base, sphere, ground) in [(2, 0.2679, 0.0893), (3, 0.3178, 0.0795)] {
            for accuracy in Accuracy::both(1e-9) {
                let mut row = |name: &str, sphere, ground, stands: bool| -> Result<(), VerifyError> {
                    let (bench, moved) = pyramid(base, sphere, ground, accuracy, model)?;
                    let what = format!(
                        "{base}+1, {name}: stands, within 0.1 mm for 0.5 s (1: yes; top moved by {moved:.1e} m)"
                    );
                    let number = |yes: bool| f64::from(u8::from(yes));
                    rows.push(bench.row(what, number(moved < 1e-4), number(stands), 0.0));
                    Ok(())
                };
                row("both above", sphere + margin, ground + margin, true)?;
                row("spheres below", sphere - margin, 1.0, false)?;
                row("ground below", 1.0, ground - margin, false)?;
            }
        }
    }
    Ok(rows)
}

fn grooves() -> Result<Vec<Row>, VerifyError> {
    let (radius, step) = (0.1, 1e-3);
    let mut rows = Vec::new();
    for model in MODELS {
        for (degrees, friction) in [(30.0_f64, 0.0), (45.0, 0.0), (60.0, 0.0), (45.0, 0.3)] {
            for accuracy in Accuracy::both(1e-11) {
                let half = degrees.to_radians();
                let mut world = world(friction, 0.0)?;
                for sign in [-1.0, 1.0] {
                    // A wall at `half` from the vertical.
                    add_plane(&mut world, Vec3::ZERO, Vec3::new(sign * half.cos(), 0.0, half.sin()))?;
                }
                let ball = add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, radius / half.sin()))?;
                let weight = world.bodies.mass[ball] * G;
                let mut bench = Bench::new(step, 1e-3, accuracy, model)?;
                bench.steps(&mut world, 20)?;
                let set = &world.contacts;
                let digits = accuracy.allowed(1e-8, 1.0);
                let name = format!("{degrees} degrees, mu {friction}");
                if friction == 0.0 {
                    let force = set.contacts.iter().zip(&set.impulse).map(|(c, g)| g.dot(c.normal) / step);
                    let worst = force.map(|f| (f / weight - 0.5 / half.sin()).abs()).fold(0.0, f64::max);
                    let what = format!("{name}: largest error of a force over the weight (1)");
                    rows.push(bench.row(what, worst, 0.0, digits));
                } else {
                    let total: Vec3 = set.impulse.iter().copied().sum::<Vec3>() / (step * weight);
                    let error = (total - Vec3::Z).length();
                    rows.push(bench.row(
                        format!("{name}: error of the sum over the weight (1)"),
                        error,
                        0.0,
                        digits,
                    ));
                    let excess = set.contacts.iter().zip(&set.impulse).map(|(c, g)| {
                        let normal = g.dot(c.normal);
                        ((*g - normal * c.normal).length() - friction * normal).max(0.0) / (step * weight)
                    });
                    let excess = excess.fold(0.0, f64::max);
                    let what = format!("{name}: friction beyond the cone over the weight (1)");
                    rows.push(bench.row(what, excess, 0.0, digits));
                }
            }
        }
    }
    Ok(rows)
}

fn table() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        for accuracy in Accuracy::both(1e-11) {
            let mut world = world(0.4, 0.0)?;
            add_ground(&mut world, 0.0)?;
            let part = |x: f64, y: f64, z: f64, shape: Shape| Part {
                shape,
                position: Vec3::new(x, y, z),
                orientation: Quat::IDENTITY,
            };
            let mut parts =
                vec![part(0.0, 0.0, 0.75, Shape::Box(Cuboid { half: Vec3::new(0.6, 0.4, 0.05) }))];
            for (x, y) in [(0.5, 0.3), (0.5, -0.3), (-0.5, -0.3), (-0.5, 0.3)] {
                parts.push(part(x, y, 0.35, Shape::Capsule(Capsule { half_length: 0.3, radius: 0.05 })));
            }
            let (geometry, centre) = Geometry::compound(parts)?;
            let geometry = world.add_geometry(geometry);
            let body = world.add_body(Body::new(geometry, MaterialId::default(), centre))?.index();
            let step = 1e-3;
            let mut bench = Bench::new(step, 1e-3, accuracy, model)?;
            bench.steps(&mut world, 20)?;
            let weight = world.bodies.mass[body] * G;
            let (mut sum, mut moment, mut uneven) = (0.0, Vec3::ZERO, 0.0_f64);
            for (contact, impulse) in world.contacts.contacts.iter().zip(&world.contacts.impulse) {
                let force = *impulse / step / weight;
                sum += force.z;
                moment += (contact.point - world.bodies.position[body]).cross(force);
                uneven = uneven.max((force.z - 0.25).abs());
            }
            let digits = accuracy.allowed(1e-8, 1.0);
            rows.push(bench.row("sum of the forces over the weight (1)", sum, 1.0, digits));
            rows.push(bench.row("moment of the forces over the weight (m)", moment.length(), 0.0, digits));
            let what = "largest difference of a leg's force from a quarter of the weight (1)";
            rows.push(bench.row(what, uneven, 0.0, accuracy.allowed(1e-6, 1.0)));
        }
    }
    Ok(rows)
}
