//! Tier B: density and contacts per grain of packings.
//!
//! B1 settles under gravity. The others compress a gas: six walls without friction close in at a constant rate of strain. Grains are rigid, so that the pressure p on the walls rises
//! from that of a gas without bound where the sample jams; it is taken as jammed where the inertial number
//! I = rate d sqrt(rho / p) falls below 1e-3. Density and contacts are those of the inside, 3 diameters off all walls.

use super::bench::{Accuracy, Bench, add_plane, add_sphere, add_walls, random, world};
use super::source::{AGNOLIN_ROUX, SILBERT, SONG_WANG_MAKSE, Source};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use crate::reproduce::ReproduceError;
use graintrain::handle::{BodyId, MaterialId};
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel::{self, Relaxed};
use std::f64::consts::PI;
use std::sync::atomic::Ordering;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "B1",
        title: "Random close packing without friction",
        setup: "4 624 spheres, radii within 10 %, without friction fall into a box 17 diameters wide and come to rest for 3 s; the inside is \
                3 diameters off the walls and the surface.",
        sources: &[AGNOLIN_ROUX, SILBERT],
        measure: Measure::Sample(|sampling| {
            let (bench, jammed) = settle(sampling)?;
            Ok(vec![
                bench.row("volume fraction inside (1)", jammed.density, 0.639, 0.005),
                bench.row("contacts per grain of the backbone (1)", jammed.contacts, 6.0, 0.15),
            ])
        }),
    },
    Definition {
        id: "B2",
        title: "Isotropic compression with friction",
        setup: "A gas of 2 197 spheres, radii within 10 %, mu = 0.3 from the gas on, is compressed by six smooth walls to an inertial number of 1e-3.",
        sources: &[AGNOLIN_ROUX],
        measure: Measure::SampleWithFriction(|sampling, model| {
            let (bench, jammed) = compress(0.3, 13, sampling, model)?;
            Ok(vec![
                bench.row("volume fraction inside (1)", jammed.density, 0.593, 0.01),
                bench.row("contacts per grain of the backbone (1)", jammed.contacts, 4.5, 0.2),
            ])
        }),
    },
    Definition {
        id: "B3",
        title: "Density and contacts over the friction coefficient",
        setup: "As B2 with 1 728 spheres at mu = 0.1, 1 and 10: towards random loose packing (B1 has mu = 0).",
        sources: &[
            SILBERT,
            SONG_WANG_MAKSE,
            Source::Algebra("isostatic packings have 4 contacts per grain with much friction"),
        ],
        measure: Measure::SampleWithFriction(over_friction),
    },
];

const RADIUS: f64 = 0.01;

/// Of the walls, relative to the box, 1/s.
const RATE: f64 = 0.1;

/// Of compressions, s.
const STEP: f64 = 1e-3;

/// Of what settles, s.
const SETTLING_STEP: f64 = 1e-2;

/// Inertial number at which a sample counts as jammed.
const JAMMED: f64 = 1e-3;

/// Diameters next to walls that are left out.
const MARGIN: f64 = 3.0;

/// Volume fraction of the gas.
const GAS: f64 = 0.5;

/// A jammed sample.
struct Jammed {
    /// Volume fraction inside.
    density: f64,
    /// Contacts with force per grain inside that is no rattler.
    contacts: f64,
}

fn over_friction(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let mut rows = Vec::new();
    let mut last: Option<Jammed> = None;
    // Ends by the literature; what lies between only has to fall.
    for (friction, ends) in [(0.1, None), (1.0, None), (10.0, Some((0.55, 4.0)))] {
        let (bench, jammed) = compress(friction, 12, sampling, model)?;
        if let Some((density, contacts)) = ends {
            rows.push(bench.row(
                format!("mu = {friction}: volume fraction (1)"),
                jammed.density,
                density,
                0.01,
            ));
            rows.push(bench.row(
                format!("mu = {friction}: contacts per grain (1)"),
                jammed.contacts,
                contacts,
                0.3,
            ));
        }
        if let Some(last) = last {
            let below = |value: f64| if value < 0.0 { 0.0 } else { value };
            let what = format!("mu = {friction}: density above that of the smaller mu (1)");
            rows.push(bench.row(what, below(jammed.density - last.density), 0.0, 0.002));
        }
        let z = jammed.contacts;
        let what = format!("mu = {friction}: volume fraction by z / (z + 2 sqrt 3), B4 (1)");
        rows.push(bench.row(what, jammed.density, z / (z + 2.0 * 3.0_f64.sqrt()), 0.02));
        last = Some(jammed);
    }
    Ok(rows)
}

/// Compresses `edge`^3 spheres until they jam.
fn compress(
    friction: f64,
    edge: i32,
    sampling: &mut Sampling<'_>,
    model: FrictionModel,
) -> Result<(Bench, Jammed), VerifyError> {
    (sampling.progress)(&format!("compression, friction {friction}"));
    let mut world = World::new(Vec3::ZERO, Materials::single("stuff", 1000.0, friction, 0.0)?)?;
    let smooth = world.materials.add("wall", 1000.0)?;
    world.materials.set_pair(MaterialId::default(), smooth, 0.0, 0.0)?;
    let pitch = 2.0 * RADIUS * (PI / 6.0 / GAS).cbrt();
    let half = 0.5 * pitch * f64::from(edge);
    // The strain is of the box as it was, d(half)/dt = -RATE half(0).
    let mut walls = Vec::new();
    for normal in [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z] {
        let plane = world.add_geometry(Geometry::plane());
        let inwards = world.add_motion(Motion::translating(normal, Profile::Constant(RATE * half)))?;
        let orientation = Quat::from_rotation_arc(Vec3::Z, normal);
        let body = Body { motion: inwards, orientation, ..Body::new(plane, smooth, -half * normal) };
        walls.push((world.add_body(body)?, normal));
    }
    let mut next = random(7);
    for k in 0..edge.pow(3) {
        let place =
            Vec3::from_array([k % edge, k / edge % edge, k / edge.pow(2)].map(|i| f64::from(i) + 0.5));
        let radius = RADIUS * (0.9 + 0.05 * (next() + 1.0));
        let jitter = 0.05 * RADIUS * Vec3::new(next(), next(), next());
        let grain = add_sphere(&mut world, radius, pitch * place - half * Vec3::ONE + jitter)?;
        world.bodies.velocity[grain] = 0.5 * Vec3::new(next(), next(), next());
    }
    let mut bench = Bench::new(STEP, 0.02 * RADIUS, Accuracy::SCENES, model)?;
    loop {
        if sampling.stop.load(Ordering::Relaxed) {
            return Err(ReproduceError::Stopped.into());
        }
        let report = bench.step(&mut world)?;
        let half = half * (1.0 - RATE * world.time);
        let force = |(body, normal): &(BodyId, Vec3)| {
            let wrench = report.wrenches.iter().find(|wrench| wrench.body == *body);
            wrench.map_or(0.0, |wrench| -wrench.force.dot(*normal))
        };
        let pressure = walls.iter().map(force).sum::<f64>() / (6.0 * 4.0 * half * half);
        let inertial = RATE * 2.0 * RADIUS * (1000.0 / pressure.max(f64::MIN_POSITIVE)).sqrt();
        // Where nothing jams until the box is half as wide, the last state is judged.
        if inertial < JAMMED || RATE * world.time > 0.5 {
            let inside = Inside { centre: Vec3::ZERO, half: Vec3::splat(half - MARGIN * 2.0 * RADIUS) };
            return Ok((bench, inside.of(&world, 2)));
        }
    }
}

/// Spheres without friction that fall into a box and come to rest.
fn settle(sampling: &mut Sampling<'_>) -> Result<(Bench, Jammed), VerifyError> {
    (sampling.progress)("settling without friction");
    let (wide, high) = (17, 16);
    let mut world = world(0.0, 0.0)?;
    let half = RADIUS * f64::from(wide);
    add_walls(&mut world, half)?;
    add_plane(&mut world, Vec3::ZERO, Vec3::Z)?;
    let mut next = random(7);
    let mut grains = Vec::new();
    for k in 0..wide * wide * high {
        let place =
            Vec3::from_array([k % wide, k / wide % wide, k / (wide * wide)].map(|i| f64::from(i) + 0.5));
        let radius = RADIUS * (0.9 + 0.05 * (next() + 1.0));
        let jitter = 0.08 * RADIUS * Vec3::new(next(), next(), next());
        // So that no crystal is handed in.
        let shift = 0.3 * RADIUS * Vec3::new(next(), next(), 0.0);
        let corner = Vec3::new(-half, -half, 0.0);
        let mut centre = corner + 2.0 * RADIUS * place * Vec3::new(1.0, 1.0, 1.2) + jitter + shift;
        centre = centre.clamp(Vec3::splat(radius - half), Vec3::new(half - radius, half - radius, 1.0));
        centre.z = centre.z.max(radius);
        grains.push(add_sphere(&mut world, radius, centre)?);
    }
    let mut bench = Bench::new(SETTLING_STEP, 0.05 * RADIUS, Accuracy::SCENES, Relaxed)?;
    while world.time < 3.0 {
        if sampling.stop.load(Ordering::Relaxed) {
            return Err(ReproduceError::Stopped.into());
        }
        bench.step(&mut world)?;
    }
    let mut heights: Vec<f64> = grains.iter().map(|&grain| world.bodies.position[grain].z).collect();
    heights.sort_unstable_by(f64::total_cmp);
    // The surface is as high as nine grains in ten of its layer.
    let top = heights[heights.len() - (wide * wide) as usize / 10];
    let margin = MARGIN * 2.0 * RADIUS;
    let inside = Inside {
        centre: 0.5 * top * Vec3::Z,
        half: Vec3::new(half - margin, half - margin, 0.5 * top - margin),
    };
    Ok((bench, inside.of(&world, 4)))
}

/// The box in which a sample is measured.
struct Inside {
    centre: Vec3,
    half: Vec3,
}

impl Inside {
    fn holds(&self, point: Vec3) -> bool {
        (point - self.centre).abs().cmple(self.half).all()
    }

    /// Density and contacts of the spheres in it; grains with fewer than `least` contacts to others that are held are rattlers.
    fn of(&self, world: &World, least: u32) -> Jammed {
        Jammed { density: self.density(world), contacts: self.contacts(world, least) }
    }

    /// Volume fraction, by points in each sphere.
    fn density(&self, world: &World) -> f64 {
        let fine = 12;
        let points: Vec<Vec3> = (0..fine * fine * fine)
            .map(|k| [k % fine, k / fine % fine, k / (fine * fine)])
            .map(|k| Vec3::from_array(k.map(|i| (2.0 * f64::from(i) + 1.0) / f64::from(fine) - 1.0)))
            .filter(|p| p.length() <= 1.0)
            .collect();
        let mut volume = 0.0;
        for body in (0..world.bodies.len()).filter(|&body| world.is_free(body)) {
            let own = world.bodies.mass[body] / 1000.0;
            let radius = (own * 3.0 / (4.0 * PI)).cbrt();
            let inside = |p: &&Vec3| self.holds(world.bodies.position[body] + radius * **p);
            volume += own * points.iter().filter(inside).count() as f64 / points.len() as f64;
        }
        volume / (8.0 * self.half.x * self.half.y * self.half.z)
    }

    /// Contacts with force per grain that is held.
    fn contacts(&self, world: &World, least: u32) -> f64 {
        let set = &world.contacts;
        let mean = set.impulse.iter().map(|g| g.length()).sum::<f64>() / set.impulse.len().max(1) as f64;
        let mut held = vec![true; world.bodies.len()];
        loop {
            let mut count = vec![0_u32; world.bodies.len()];
            for (contact, impulse) in set.contacts.iter().zip(&set.impulse) {
                let [a, b] = [contact.body_a, contact.body_b].map(|body| body as usize);
                if impulse.length() > 1e-4 * mean && held[a] && held[b] {
                    count[a] += 1;
                    count[b] += 1;
                }
            }
            let grains = (0..held.len()).filter(|&body| held[body] && world.is_free(body));
            let (held_still, loose): (Vec<usize>, Vec<usize>) =
                grains.partition(|&body| count[body] >= least);
            if loose.is_empty() {
                let inside = held_still.into_iter().filter(|&body| self.holds(world.bodies.position[body]));
                let found: Vec<f64> = inside.map(|body| f64::from(count[body])).collect();
                return found.iter().sum::<f64>() / found.len().max(1) as f64;
            }
            loose.into_iter().for_each(|body| held[body] = false);
        }
    }
}
