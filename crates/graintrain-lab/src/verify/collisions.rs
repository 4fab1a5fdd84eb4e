//! What meets and what does not, in steps in which bodies go far: A47 to A51.

use super::bench::{Accuracy, Bench, G, add_ground, add_sphere, random, world};
use super::source::Source;
use super::{Definition, MODELS, Measure, Row, VerifyError};
use graintrain::handle::MaterialId;
use graintrain::math::{Vec3, rotation_exponential};
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "A47",
        title: "Balls that pass each other",
        setup: "Balls at 1 to 20 m/s pass others at rest by 0.05 to 15 % of the sum of both radii, 150 pairs at each step.",
        sources: &[Source::Algebra("nothing touches: no velocity changes")],
        measure: Measure::Small(passing),
    },
    Definition {
        id: "A48",
        title: "Balls that meet off their centres",
        setup: "Balls at 1 to 20 m/s hit others at rest without friction, e = 0.9, at any offset and moment of the step, 150 pairs at each step.",
        sources: &[Source::Algebra(
            "(1 + e) times the reduced mass times the speed along the line of centres at touch goes over",
        )],
        measure: Measure::Small(meeting),
    },
    Definition {
        id: "A49",
        title: "Fast bodies on a thin plate",
        setup: "40 capsules, cylinders and boxes of about 1 cm each, turned anyhow, hit a plate of 1 mm with 50 and 200 m/s, steps of 1 ms.",
        sources: &[Source::Algebra("none goes through")],
        measure: Measure::Small(thin_plate),
    },
    Definition {
        id: "A50",
        title: "Bounces",
        setup: "A sphere falls on a plane and bounces: twenty times with e = 1, five times with e = 0.6.",
        sources: &[Source::Algebra("each bounce reaches e^2 times the height of the one before")],
        measure: Measure::Small(bounces),
    },
    Definition {
        id: "A51",
        title: "Discs that wobble",
        setup: "Flat discs of radius 5 cm and 1 cm thick are thrown on a plane and run round their rims for 1.5 s.",
        sources: &[Source::Algebra("rigid bodies do not overlap")],
        measure: Measure::Small(discs),
    },
];

/// A pair of balls: the first flies along x, past or onto the second, which rests.
struct Pair {
    bodies: [usize; 2],
    speed: f64,
    /// Distance of the way from the second ball's centre over the sum of the radii.
    offset: f64,
}

/// Pairs far from each other that touch or come nearest at about the 30th step.
fn pairs(world: &mut World, [least, most]: [f64; 2], step: f64) -> Result<Vec<Pair>, VerifyError> {
    let mut next = random(11);
    let mut between = |least: f64, most: f64| least + 0.5 * (most - least) * (1.0 + next());
    let mut all = Vec::new();
    for k in 0..150 {
        let radii = [0.05, between(0.02, 0.1)];
        let (speed, offset) = (between(1.0, 20.0), between(least, most));
        let place = Vec3::new(0.0, 0.0, 10.0 * f64::from(k));
        let (before, reach) = (speed * step * between(29.0, 31.0), radii[0] + radii[1]);
        let at_touch = reach * (1.0 - offset * offset).max(0.0).sqrt();
        let start = place + Vec3::new(-before - at_touch, offset * reach, 0.0);
        let bodies = [add_sphere(world, radii[0], start)?, add_sphere(world, radii[1], place)?];
        world.bodies.velocity[bodies[0]] = speed * Vec3::X;
        all.push(Pair { bodies, speed, offset });
    }
    Ok(all)
}

/// The largest error of the velocities of pairs with these offsets, over the speed, where `expected` are
/// those of both balls.
fn worst(
    bench: &mut Bench,
    (restitution, step): (f64, f64),
    offsets: [f64; 2],
    expected: impl Fn(&World, &Pair) -> [Vec3; 2],
) -> Result<f64, VerifyError> {
    let mut world = world(0.0, restitution)?;
    world.gravity = Vec3::ZERO;
    let pairs = pairs(&mut world, offsets, step)?;
    bench.steps(&mut world, 60)?;
    let error = |pair: &Pair| {
        let expected = expected(&world, pair);
        let errors =
            pair.bodies.iter().zip(expected).map(|(&body, v)| (world.bodies.velocity[body] - v).length());
        errors.sum::<f64>() / pair.speed
    };
    Ok(pairs.iter().map(error).fold(0.0, f64::max))
}

fn passing() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for (model, step) in MODELS.into_iter().flat_map(|model| [2e-3, 1e-2].map(|step| (model, step))) {
        let mut bench = Bench::new(step, 2e-3, Accuracy::SCENES, model)?;
        let on = |_: &World, pair: &Pair| [pair.speed * Vec3::X, Vec3::ZERO];
        let error = worst(&mut bench, (1.0, step), [1.0005, 1.15], on)?;
        rows.push(bench.row(format!("change of velocity over the speed, {step} s"), error, 0.0, 1e-9));
    }
    Ok(rows)
}

fn meeting() -> Result<Vec<Row>, VerifyError> {
    let restitution = 0.9;
    let mut rows = Vec::new();
    for (model, step) in MODELS.into_iter().flat_map(|model| [2e-3, 1e-2].map(|step| (model, step))) {
        let mut bench = Bench::new(step, 2e-3, Accuracy::SCENES, model)?;
        let after = |world: &World, pair: &Pair| {
            let normal = Vec3::new(-(1.0 - pair.offset * pair.offset).sqrt(), pair.offset, 0.0);
            let [a, b] = pair.bodies.map(|body| world.bodies.mass[body]);
            let impulse = -(1.0 + restitution) * pair.speed * normal.x * a * b / (a + b) * normal;
            [pair.speed * Vec3::X + impulse / a, -impulse / b]
        };
        let error = worst(&mut bench, (restitution, step), [0.0, 0.9995], after)?;
        rows.push(bench.row(format!("error of both velocities over the speed, {step} s"), error, 0.0, 1e-8));
    }
    Ok(rows)
}

fn thin_plate() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for (speed, model) in [50.0, 200.0].into_iter().flat_map(|speed| MODELS.map(|model| (speed, model))) {
        let shapes = [
            Geometry::capsule(0.005, 0.003)?,
            Geometry::cylinder(0.006, 0.004)?,
            Geometry::cuboid(Vec3::new(0.008, 0.005, 0.004))?,
        ];
        let mut bench = Bench::new(1e-3, 1e-3, Accuracy::SCENES, model)?;
        let mut through = 0;
        for shape in shapes {
            let mut world = world(0.3, 0.0)?;
            world.gravity = Vec3::ZERO;
            let plate = world.add_geometry(Geometry::cuboid(Vec3::new(20.0, 20.0, 5e-4))?);
            let motion = world.add_motion(Motion::fixed())?;
            world.add_body(Body { motion, ..Body::new(plate, MaterialId::default(), Vec3::ZERO) })?;
            let form = world.add_geometry(shape);
            let mut next = random(3);
            for k in 0..40 {
                let orientation = rotation_exponential(3.0 * Vec3::new(next(), next(), next()));
                let height = speed * 1e-3 * (3.5 + 0.5 * next());
                let place = Vec3::new(0.2 * f64::from(k) - 4.0, 0.0, height);
                let body =
                    world.add_body(Body { orientation, ..Body::new(form, MaterialId::default(), place) })?;
                world.bodies.velocity[body.index()] = -speed * Vec3::Z;
            }
            bench.steps(&mut world, 14)?;
            through += world.bodies.position[1..].iter().filter(|place| place.z < 0.0).count();
        }
        rows.push(bench.row(format!("bodies of 120 below it, {speed} m/s"), through as f64, 0.0, 0.0));
    }
    Ok(rows)
}

fn bounces() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for (restitution, count, step) in [(1.0_f64, 20, 1e-3), (1.0, 20, 8e-3), (0.6, 5, 1e-3), (0.6, 5, 5e-3)] {
        let mut world = world(0.3, restitution)?;
        add_ground(&mut world, 0.0)?;
        let ball = add_sphere(&mut world, 0.05, Vec3::new(0.0, 0.0, 0.55))?;
        let mut bench = Bench::new(step, 1e-3, Accuracy::SCENES, MODELS[0])?;
        let (mut bounces, mut off) = (0, 0.0_f64);
        while bounces < count {
            bounces += bench.step(&mut world)?.impacts;
            let (place, speed) = (world.bodies.position[ball].z, world.bodies.velocity[ball].z);
            let height = place - 0.05 + speed * speed / (2.0 * G);
            off = off.max((height - 0.5 * restitution.powi(2 * bounces as i32)).abs());
        }
        let what = format!("e = {restitution}, {step} s: error of the height (m)");
        rows.push(bench.row(what, off, 0.0, 1e-9));
    }
    Ok(rows)
}

fn discs() -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    for (model, step) in MODELS.into_iter().flat_map(|model| [1e-3, 2e-3].map(|step| (model, step))) {
        let mut world = world(0.4, 0.0)?;
        add_ground(&mut world, 0.0)?;
        let disc = world.add_geometry(Geometry::cylinder(0.005, 0.05)?);
        let mut next = random(5);
        for k in 0..8 {
            let orientation = rotation_exponential(Vec3::new(1.0, 2.0, 0.3) * next());
            let place = Vec3::new(3.0 * f64::from(k), 0.0, 0.4);
            let body =
                world.add_body(Body { orientation, ..Body::new(disc, MaterialId::default(), place) })?;
            world.bodies.velocity[body.index()] = 1.5 * Vec3::new(next(), next(), next());
            world.bodies.angular_velocity[body.index()] = 8.0 * Vec3::new(next(), next(), next());
        }
        let mut bench = Bench::new(step, 1e-3, Accuracy::SCENES, model)?;
        let mut deepest = 0.0_f64;
        for _ in 0..(1.5 / step) as usize {
            deepest = deepest.max(bench.step(&mut world)?.penetration_max_over_size);
        }
        rows.push(bench.row(format!("overlap over half the thickness, {step} s"), deepest, 0.0, 0.01));
    }
    Ok(rows)
}
