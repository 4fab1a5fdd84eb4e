//! Small assemblies: A26, A27, A29.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, add_walls, random, world};
use super::source::Source;
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A26",
        title: "Loaded bed",
        setup: "A press of ten times the weight of the grains, free to sink only, lies on 64 spheres in a box, mu = 0.3; after 1 s at dt = 2 ms \
                the force on the box is averaged over 0.2 s.",
        sources: &[Source::Algebra("at rest the box carries the weight of grains and press, upwards only")],
        measure: Measure::Small(loaded_bed),
    },
    Definition {
        id: "A27",
        title: "Column that overlaps",
        setup: "Twenty spheres stand on each other, each 0.1 % of R inside the one below, for 0.2 s at dt = 0.1 ms.",
        sources: &[Source::Algebra("mending an overlap moves bodies apart by it and gives them no velocity")],
        measure: Measure::Small(column),
    },
    Definition {
        id: "A29",
        title: "A heavy body that touches nothing",
        setup: "Eight spheres fall into a box with mu = 0.3, 0.5 s at dt = 2 ms; and again while a sphere a million times as heavy rests \
                on the ground 20 m away.",
        sources: &[Source::Algebra(
            "bodies without a contact in common do not act on each other: the same path",
        )],
        measure: Measure::Small(bystander),
    },
];

fn loaded_bed() -> Result<Vec<Row>, VerifyError> {
    let (radius, step) = (0.05, 2e-3);
    let mut rows = Vec::new();
    for model in MODELS {
        {
            let accuracy = Accuracy::SCENES;
            let mut world = world(0.3, 0.0)?;
            add_ground(&mut world, 0.0)?;
            add_walls(&mut world, 0.22)?;
            let mut next = random(3);
            for k in 0..64 {
                let place = [k % 4, k / 4 % 4, k / 16].map(|i| 0.108 * f64::from(i));
                let jitter = 0.002 * Vec3::new(next(), next(), next());
                let place = Vec3::from_array(place) + Vec3::new(-0.162, -0.162, 0.054);
                add_sphere(&mut world, radius, place + jitter)?;
            }
            let grains: f64 = (5..69).map(|body| world.bodies.mass[body]).sum();
            let half = Vec3::new(0.21, 0.21, 0.02);
            let dense = 10.0 * grains / (8.0 * half.x * half.y * half.z);
            let heavy = world.materials.add("press", dense)?;
            world.materials.set_pair(MaterialId::default(), heavy, 0.3, 0.0)?;
            let press = world.add_geometry(Geometry::cuboid(half)?);
            let sinking = Motion::fixed().with_free([false, false, true, false, false, false]);
            let sinking = world.add_motion(sinking)?;
            let place = Vec3::new(0.0, 0.0, 0.45);
            world.add_body(Body { motion: sinking, ..Body::new(press, heavy, place) })?;
            let weight = 11.0 * grains * G;
            let mut bench = Bench::new(step, 5e-3, accuracy, model)?;
            bench.steps(&mut world, 500)?;
            let (mut force, mut overlap) = (0.0, 0.0_f64);
            for _ in 0..100 {
                let report = bench.step(&mut world)?;
                let walls = report.wrenches.iter().filter(|wrench| wrench.body.index() < 5);
                force -= walls.map(|wrench| wrench.force.z).sum::<f64>() / 100.0;
                overlap = overlap.max(report.penetration_max / radius);
            }
            rows.push(bench.row("mean force on the box over the weight (1)", force / weight, 1.0, 2e-3));
            rows.push(bench.row("deepest overlap at rest over R (1)", overlap, 0.0, 0.02));
        }
    }
    Ok(rows)
}

fn column() -> Result<Vec<Row>, VerifyError> {
    let (radius, step, count) = (0.1, 1e-4, 20);
    let mut rows = Vec::new();
    for model in MODELS {
        let accuracy = Accuracy::SCENES;
        let mut world = world(0.3, 0.0)?;
        add_ground(&mut world, 0.0)?;
        let overlap = 1e-3 * radius;
        for k in 0..count {
            let height = radius - overlap + (2.0 * radius - overlap) * f64::from(k);
            add_sphere(&mut world, radius, Vec3::new(0.0, 0.0, height))?;
        }
        let touching = radius * f64::from(2 * count - 1);
        let start = world.bodies.position.clone();
        let mut bench = Bench::new(step, 1e-3, accuracy, model)?;
        let (mut highest, mut fastest, mut overlap, mut sideways) = (f64::MIN, 0.0_f64, 0.0, 0.0_f64);
        for _ in 0..2000 {
            overlap = bench.step(&mut world)?.penetration_max;
            highest = highest.max(world.bodies.position[count as usize].z - touching);
            let speeds = world.bodies.velocity.iter().map(|u| u.length());
            fastest = speeds.fold(fastest, f64::max);
            for (now, first) in world.bodies.position.iter().zip(&start) {
                let way = *now - *first;
                sideways = sideways.max(way.x.hypot(way.y));
            }
        }
        let rise = highest.max(0.0) / radius;
        rows.push(bench.row("top above where the spheres would just touch, over R (1)", rise, 0.0, 1e-3));
        rows.push(bench.row("deepest overlap at the end over R (1)", overlap / radius, 0.0, 1.1e-3));
        rows.push(bench.row("largest speed of a sphere (m/s)", fastest, 0.0, 1e-3));
        rows.push(bench.row("largest way sideways over R (1)", sideways / radius, 0.0, 1e-3));
    }
    Ok(rows)
}

fn bystander() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for model in MODELS {
        let run = |heavy: bool| -> Result<(Bench, World), VerifyError> {
            let radius = 0.05;
            let mut world = world(0.3, 0.0)?;
            add_ground(&mut world, 0.0)?;
            let fixed = world.add_motion(Motion::fixed())?;
            let wall = world.add_geometry(Geometry::cuboid(Vec3::new(0.02, 0.2, 0.2))?);
            for x in [-0.14, 0.14] {
                world.add_body(Body {
                    motion: fixed,
                    ..Body::new(wall, MaterialId::default(), Vec3::new(x, 0.0, 0.2))
                })?;
            }
            let mut next = random(9);
            for k in 0..8 {
                let place = [k % 2, k / 2 % 2, k / 4].map(|i| 0.105 * f64::from(i) - 0.0525);
                let jitter = 0.004 * Vec3::new(next(), next(), next());
                let place = Vec3::from_array(place) + Vec3::new(0.0, 0.0, 0.15);
                add_sphere(&mut world, radius, place + jitter)?;
            }
            if heavy {
                let dense = world.materials.add("heavy", 1e6)?;
                for other in [MaterialId::default(), dense] {
                    world.materials.set_pair(other, dense, 0.3, 0.0)?;
                }
                let ball = add_sphere(&mut world, 0.5, Vec3::new(20.0, 0.0, 0.5))?;
                world.bodies.material[ball] = dense;
                world.bodies.mass[ball] *= 1e3;
                world.bodies.inertia[ball] = 1e3 * world.bodies.inertia[ball];
            }
            let mut bench = Bench::new(2e-3, 5e-3, Accuracy::SCENES, model)?;
            bench.steps(&mut world, 250)?;
            Ok((bench, world))
        };
        let (_, alone) = run(false)?;
        let (bench, beside) = run(true)?;
        let paths = alone.bodies.position.iter().zip(&beside.bodies.position);
        let apart = paths.map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max);
        rows.push(bench.row("largest distance of a sphere from its place without it (m)", apart, 0.0, 1e-12));
    }
    Ok(rows)
}
