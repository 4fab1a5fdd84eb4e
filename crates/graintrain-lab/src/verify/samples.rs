//! Tier B in small: granular samples that take about a minute each.

use super::bench::{Accuracy, Bench, G, add_plane, add_sphere, add_walls, random, world};
use super::source::{BEVERLOO, JANSSEN, LANDRY, MELLMANN, Source, ZHOU};
use super::{Definition, Measure, Row, Sampling, VerifyError};
use crate::reproduce::ReproduceError;
use graintrain::handle::{BodyId, MaterialId};
use graintrain::math::{Quat, Vec3};
use graintrain::motion::{Motion, Profile};
use graintrain::shape::Geometry;
use graintrain::stepper::StepReport;
use graintrain::world::{Body, World};
use graintrain_ccp::FrictionModel;
use std::f64::consts::{PI, TAU};
use std::sync::atomic::Ordering;

/// The cases.
pub const CASES: &[Definition] = &[
    Definition {
        id: "B9",
        title: "Silo: the floor's load saturates",
        setup: "Spheres of 2 cm, radii within 10 %, mu = 0.5, fill a shaft 5 diameters wide to about 4 and 8 widths; then the floor is lowered \
                by half a diameter at 5 cm/s, and its load averaged over the last third of that.",
        sources: &[
            JANSSEN,
            LANDRY,
            Source::Algebra(
                "saturated pressure rho g D / (4 mu K); K between 0.4 and 0.9, doubling the fill changes the load by less than 3 %",
            ),
        ],
        measure: Measure::SampleWithFriction(silo),
    },
    Definition {
        id: "B10",
        title: "Discharge through an orifice",
        setup: "A bin of 1 936 spheres of 2 cm, radii within 10 %, mu = 0.5, 11 diameters wide, empties through square openings of 5, 6 and \
                7 diameters; the rate is that from the first 150 grains on until 45 % have left.",
        sources: &[
            BEVERLOO,
            Source::Algebra(
                "W = C rho_bulk sqrt(g) D_h^{5/2} (1 - k d / D_h)^{5/2} (4 / pi for the area of a square) with k = 1.45: C between \
                 0.55 and 0.65; W over (D_h - k d)^{5/2} is the same for all openings, so that the exponent is 5/2 within 0.1",
            ),
        ],
        measure: Measure::SampleWithFriction(discharge),
    },
    Definition {
        id: "B11",
        title: "Angle of repose",
        setup: "Spheres of 2 cm, radii within 10 %, lie 4 diameters deep between smooth walls on a rough floor; the end wall is drawn \
                away at 0.2 m/s and the slope left after 1.5 s fitted by a line. The figures \
                are of heaps left by a discharge.",
        sources: &[ZHOU],
        measure: Measure::SampleWithFriction(repose),
    },
    Definition {
        id: "B13",
        title: "Rotating drum, rolling regime",
        setup: "A drum of radius 10 diameters and depth 4 between smooth ends, a third full of spheres with mu = 0.5, turns at 1 and 2 rad/s; \
                its surface is fitted by a line over the second half of 2 s.",
        sources: &[
            MELLMANN,
            Source::Algebra("qualitative: the surface is flat and its angle rises mildly with the speed"),
        ],
        measure: Measure::SampleWithFriction(drum),
    },
];

const RADIUS: f64 = 0.01;

/// Steps until a time, unless stopped.
fn until(
    time: f64,
    world: &mut World,
    bench: &mut Bench,
    sampling: &Sampling<'_>,
    mut each: impl FnMut(&World, &StepReport),
) -> Result<(), VerifyError> {
    while world.time < time - 1e-9 {
        if sampling.stop.load(Ordering::Relaxed) {
            return Err(ReproduceError::Stopped.into());
        }
        let report = bench.step(world)?;
        each(world, &report);
    }
    Ok(())
}

/// A block of spheres of radii within 10 %, counts along x, y, z, its lowest corner at a point.
fn fill(world: &mut World, counts: [i32; 3], corner: Vec3) -> Result<Vec<usize>, VerifyError> {
    let mut next = random(1);
    let pitch = 2.0 * RADIUS;
    let mut grains = Vec::new();
    for k in 0..counts.iter().product() {
        let place = [k % counts[0], k / counts[0] % counts[1], k / (counts[0] * counts[1])];
        let place = Vec3::from_array(place.map(|i| f64::from(i) + 0.5));
        let radius = RADIUS * (0.9 + 0.05 * (next() + 1.0));
        let jitter = 0.04 * RADIUS * Vec3::new(next(), next(), next());
        grains.push(add_sphere(world, radius, corner + pitch * place + jitter)?);
    }
    Ok(grains)
}

/// Makes everything touch this body's material with friction of its own.
fn own_material(world: &mut World, body: BodyId, friction: f64) -> Result<(), VerifyError> {
    let material = world.materials.add(&format!("wall {body}"), 1000.0)?;
    for other in world.materials.handles() {
        world.materials.set_pair(other, material, friction, 0.0)?;
    }
    world.bodies.material[body.index()] = material;
    Ok(())
}

fn silo(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let (friction, wide) = (0.5, 5);
    let width = 2.0 * RADIUS * f64::from(wide);
    let mut loads = Vec::new();
    let (mut all, mut density) = (None, 0.0);
    for high in [20, 40] {
        (sampling.progress)(&format!("silo, {high} layers"));
        let mut world = world(friction, 0.0)?;
        add_walls(&mut world, 0.5 * width)?;
        let floor = world.add_geometry(Geometry::plane());
        let (settled, speed) = (0.8, 0.05);
        let sinking = Motion::translating(
            -Vec3::Z,
            Profile::Table {
                times: vec![0.0, settled, settled + 1e-3, 9.0],
                values: vec![0.0, 0.0, speed, speed],
            },
        );
        let sinking = world.add_motion(sinking)?;
        let floor = world
            .add_body(Body { motion: sinking, ..Body::new(floor, MaterialId::default(), Vec3::ZERO) })?;
        let grains = fill(&mut world, [wide, wide, high], Vec3::new(-0.5 * width, -0.5 * width, 0.0))?;
        let mut bench = Bench::new(2e-3, 0.1 * RADIUS, Accuracy::SCENES, model)?;
        until(settled, &mut world, &mut bench, sampling, |_, _| {})?;
        let (mut load, mut count, end) = (0.0, 0.0, settled + RADIUS / speed);
        until(end, &mut world, &mut bench, sampling, |world, report| {
            if world.time > settled + 2.0 / 3.0 * (end - settled) {
                let force = report.wrenches.iter().find(|wrench| wrench.body == floor);
                load -= force.map_or(f64::NAN, |wrench| wrench.force.z);
                count += 1.0;
            }
        })?;
        loads.push(load / count);
        let mass: f64 = grains.iter().map(|&grain| world.bodies.mass[grain]).sum();
        let top = grains.iter().map(|&grain| world.bodies.position[grain].z).fold(0.0, f64::max);
        density = mass / (width * width * (top - world.bodies.position[floor.index()].z));
        all = Some(match all {
            Some(sum) => bench.and(&sum),
            None => bench,
        });
    }
    let Some(bench) = all else { return Ok(Vec::new()) };
    let pressure = loads[1] / (width * width);
    let k = density * G * width / (4.0 * friction * pressure);
    Ok(vec![
        bench.row("load under twice the fill over that under the single (1)", loads[1] / loads[0], 1.0, 0.03),
        bench.row("K from the saturated load, expected 0.4 to 0.9 (1)", k, 0.65, 0.25),
    ])
}

fn discharge(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let (wide, high) = (11, 16);
    let diameter = 2.0 * RADIUS;
    let half = 0.5 * diameter * f64::from(wide);
    let settled = 0.25;
    let (mut constants, mut logarithms) = (Vec::new(), Vec::new());
    let mut all: Option<Bench> = None;
    for opening in [5.0, 6.0, 7.0] {
        (sampling.progress)(&format!("discharge, opening {opening} diameters"));
        let mut world = world(0.5, 0.0)?;
        add_walls(&mut world, half)?;
        // Floor: four bars around the opening, each along one side and past one corner.
        let gap = 0.5 * opening * diameter;
        let fixed = world.add_motion(Motion::fixed())?;
        let (along, across) = (0.5 * (half + gap), 0.5 * (half - gap));
        let thick = 2.0 * RADIUS;
        let bar = world.add_geometry(Geometry::cuboid(Vec3::new(along, across, thick))?);
        for quarter in 0..4 {
            let turn = Quat::from_rotation_z(0.25 * TAU * f64::from(quarter));
            let place = turn * Vec3::new(half - along, -half + across, -thick);
            world.add_body(Body {
                motion: fixed,
                orientation: turn,
                ..Body::new(bar, MaterialId::default(), place)
            })?;
        }
        // The lid of the opening is drawn away under it.
        let down = Profile::Table {
            times: vec![0.0, settled, settled + 1e-3, 9.0],
            values: vec![0.0, 0.0, 3.0, 3.0],
        };
        let down = world.add_motion(Motion::translating(-Vec3::Z, down))?;
        let lid = world.add_geometry(Geometry::cuboid(Vec3::new(gap, gap, thick))?);
        world.add_body(Body {
            motion: down,
            ..Body::new(lid, MaterialId::default(), Vec3::new(0.0, 0.0, -thick))
        })?;
        let grains = fill(&mut world, [wide, wide, high], Vec3::new(-half, -half, 0.0))?;
        let mut bench = Bench::new(2e-3, 0.1 * RADIUS, Accuracy::SCENES, model)?;
        until(settled, &mut world, &mut bench, sampling, |_, _| {})?;
        let top = grains.iter().map(|&grain| world.bodies.position[grain].z).fold(0.0, f64::max);
        let mass: f64 = grains.iter().map(|&grain| world.bodies.mass[grain]).sum();
        let density = mass / (4.0 * half * half * top);
        let (mut times, mut through) = (Vec::new(), Vec::new());
        while through.last().is_none_or(|&fallen| fallen < 0.45 * mass) && world.time < 6.0 {
            until(world.time + 2e-3, &mut world, &mut bench, sampling, |world, _| {
                let fallen = |grain: &&usize| world.bodies.position[**grain].z < -2.0 * thick;
                times.push(world.time);
                through
                    .push(grains.iter().filter(fallen).map(|&grain| world.bodies.mass[grain]).sum::<f64>());
            })?;
        }
        let begin = through.partition_point(|&fallen| fallen < 150.0 / grains.len() as f64 * mass);
        let end = through.len() - 1;
        // Not a number where the opening clogs.
        let rate = match through.get(begin) {
            Some(first) => (through[end] - first) / (times[end] - times[begin]),
            None => f64::NAN,
        };
        // By the hydraulic diameter of the square, its side.
        let free = (opening - 1.45) * diameter;
        constants.push(rate / (4.0 / PI * density * G.sqrt() * free.powf(2.5)));
        logarithms.push((free.ln(), rate.ln()));
        all = Some(match all {
            Some(sum) => bench.and(&sum),
            None => bench,
        });
    }
    let Some(bench) = all else { return Ok(Vec::new()) };
    let mean = constants.iter().sum::<f64>() / constants.len() as f64;
    let n = logarithms.len() as f64;
    let (x, y) = logarithms.iter().fold((0.0, 0.0), |(x, y), p| (x + p.0 / n, y + p.1 / n));
    let (xx, xy) = logarithms
        .iter()
        .fold((0.0, 0.0), |(xx, xy), p| (xx + (p.0 - x).powi(2), xy + (p.0 - x) * (p.1 - y)));
    Ok(vec![
        bench.row("C, mean over the openings, expected 0.55 to 0.65 (1)", mean, 0.6, 0.05),
        bench.row("exponent (1)", xy / xx, 2.5, 0.1),
    ])
}

/// Slope (rad) and root mean square deviation of the line through the highest grains of columns a grain wide,
/// x in [low, high).
fn surface(world: &World, grains: &[usize], low: f64, high: f64) -> (f64, f64) {
    let columns = ((high - low) / (2.0 * RADIUS)) as usize;
    let mut tops = vec![f64::NEG_INFINITY; columns];
    for &grain in grains {
        let place = world.bodies.position[grain];
        let column = ((place.x - low) / (2.0 * RADIUS)).floor();
        if column >= 0.0 && (column as usize) < columns {
            tops[column as usize] = tops[column as usize].max(place.z);
        }
    }
    let points: Vec<(f64, f64)> = (0..columns)
        .filter(|&k| tops[k].is_finite())
        .map(|k| (low + (k as f64 + 0.5) * 2.0 * RADIUS, tops[k]))
        .collect();
    let n = points.len() as f64;
    let (x, z) = points.iter().fold((0.0, 0.0), |(x, z), p| (x + p.0 / n, z + p.1 / n));
    let (xx, xz) =
        points.iter().fold((0.0, 0.0), |(xx, xz), p| (xx + (p.0 - x).powi(2), xz + (p.0 - x) * (p.1 - z)));
    let slope = xz / xx;
    let rough = points.iter().map(|p| (p.1 - z - slope * (p.0 - x)).powi(2)).sum::<f64>() / n;
    (slope.atan(), rough.sqrt())
}

fn repose(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let (deep, wide, high) = (4, 14, 12);
    let depth = 2.0 * RADIUS * f64::from(deep);
    let mut rows = Vec::new();
    for (friction, expected) in [(0.25, 18.5), (0.5, 21.5)] {
        (sampling.progress)(&format!("heap, friction {friction}"));
        let mut world = world(friction, 0.0)?;
        let mut smooth = vec![add_plane(&mut world, Vec3::ZERO, Vec3::X)?];
        smooth.push(add_plane(&mut world, Vec3::new(0.0, -0.5 * depth, 0.0), Vec3::Y)?);
        smooth.push(add_plane(&mut world, Vec3::new(0.0, 0.5 * depth, 0.0), -Vec3::Y)?);
        let gate = world.add_geometry(Geometry::plane());
        let settled = 0.3;
        let away = Profile::Table {
            times: vec![0.0, settled, settled + 0.01, 9.0],
            values: vec![0.0, 0.0, 0.2, 0.2],
        };
        let away = world.add_motion(Motion::translating(Vec3::X, away))?;
        let orientation = Quat::from_rotation_arc(Vec3::Z, -Vec3::X);
        let place = Vec3::new(2.0 * RADIUS * f64::from(wide), 0.0, 0.0);
        smooth.push(world.add_body(Body {
            motion: away,
            orientation,
            ..Body::new(gate, MaterialId::default(), place)
        })?);
        for wall in smooth {
            own_material(&mut world, wall, 0.0)?;
        }
        add_plane(&mut world, Vec3::new(0.0, 0.0, -RADIUS), Vec3::Z)?;
        // The floor is a layer of spheres that stay.
        let fixed = world.add_motion(Motion::fixed())?;
        let ball = world.add_geometry(Geometry::sphere(RADIUS)?);
        for k in 0..45 * deep {
            let [x, y] = [k % 45, k / 45].map(|i| 2.0 * RADIUS * (f64::from(i) + 0.5));
            world.add_body(Body {
                motion: fixed,
                ..Body::new(ball, MaterialId::default(), Vec3::new(x, y - 0.5 * depth, 0.0))
            })?;
        }
        let grains = fill(&mut world, [wide, deep, high], Vec3::new(0.0, -0.5 * depth, RADIUS))?;
        let mut bench = Bench::new(2e-3, 0.1 * RADIUS, Accuracy::SCENES, model)?;
        until(settled + 1.5, &mut world, &mut bench, sampling, |_, _| {})?;
        let foot = grains.iter().map(|&grain| world.bodies.position[grain]).filter(|p| p.z > 1.5 * RADIUS);
        let reach = foot.map(|p| p.x).fold(0.0, f64::max);
        let (slope, _) = surface(&world, &grains, 0.1 * reach, 0.85 * reach);
        let what = format!("slope left, mu = {friction} (degrees)");
        rows.push(bench.row(what, -slope.to_degrees(), expected, 2.5));
    }
    Ok(rows)
}

/// The inside of a drum about the y axis, 72 facets.
fn shell(radius: f64, half_depth: f64) -> Result<Geometry, VerifyError> {
    let facets = 72_u32;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for k in 0..facets {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(facets)).sin_cos();
        vertices.extend([-half_depth, half_depth].map(|y| Vec3::new(radius * cos, y, radius * sin)));
        let (a, b) = (2 * k, 2 * ((k + 1) % facets));
        triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
    }
    Ok(Geometry::mesh(vertices, triangles)?)
}

fn drum(sampling: &mut Sampling<'_>, model: FrictionModel) -> Result<Vec<Row>, VerifyError> {
    let (radius, deep) = (20.0 * RADIUS, 4);
    let depth = 2.0 * RADIUS * f64::from(deep);
    let (mut angles, mut rows) = (Vec::new(), Vec::new());
    for speed in [1.0, 2.0] {
        (sampling.progress)(&format!("drum, {speed} rad/s"));
        let mut world = world(0.5, 0.0)?;
        for normal in [Vec3::Y, -Vec3::Y] {
            let end = add_plane(&mut world, -0.5 * depth * normal, normal)?;
            own_material(&mut world, end, 0.0)?;
        }
        let drum = world.add_geometry(shell(radius, depth)?);
        let turning = world.add_motion(Motion::rotating(Vec3::ZERO, Vec3::Y, Profile::Constant(speed)))?;
        world.add_body(Body { motion: turning, ..Body::new(drum, MaterialId::default(), Vec3::ZERO) })?;
        let grains =
            fill(&mut world, [13, deep, 8], Vec3::new(-13.0 * RADIUS, -0.5 * depth, -14.0 * RADIUS))?;
        let mut bench = Bench::new(2e-3, 0.1 * RADIUS, Accuracy::SCENES, model)?;
        let (mut angle, mut rough, mut count) = (0.0, 0.0, 0.0);
        until(2.0, &mut world, &mut bench, sampling, |world, _| {
            if world.time > 1.0 {
                let (slope, deviation) = surface(world, &grains, -0.5 * radius, 0.5 * radius);
                angle += slope.to_degrees().abs();
                rough += deviation;
                count += 1.0;
            }
        })?;
        let flat = rough / count / (2.0 * RADIUS);
        let lost =
            grains.iter().filter(|&&grain| world.bodies.position[grain].length() > 1.2 * radius).count();
        let what = format!("{speed} rad/s: surface off its line, rms over a diameter (1)");
        rows.push(bench.row(what, flat, 0.0, 1.0));
        rows.push(bench.row(format!("{speed} rad/s: grains lost"), lost as f64, 0.0, 0.0));
        angles.push(angle / count);
        if speed == 2.0 {
            let what = format!("angle at 2 rad/s less that at 1 rad/s, {:.1} degrees (degrees)", angles[0]);
            rows.push(bench.row(what, angles[1] - angles[0], 5.0, 5.0));
        }
    }
    Ok(rows)
}
