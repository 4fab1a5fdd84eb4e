//! Real packings at rest: Kleinert's piles and Dosta's bed.

use crate::support::*;
use graintrain::ccp::FrictionModel::Relaxed;
use graintrain::handle::MaterialId;
use graintrain::material::Materials;
use graintrain::math::Vec3;
use graintrain::motion::Motion;
use graintrain::shape::Geometry;
use graintrain::world::{Body, World};
use graintrain_testdata::public_data;

/// Contents of a packing of the public data.
fn data(name: &str) -> Option<String> {
    let path = public_data(&format!("packings/{name}"))?;
    Some(std::fs::read_to_string(path).unwrap())
}

/// The numbers of the first ascii data array whose tag has all the words.
fn array(text: &str, words: &[&str]) -> Vec<f64> {
    let tag = text
        .split("<DataArray")
        .skip(1)
        .find(|rest| {
            let tag = rest.split('>').next().unwrap();
            words.iter().all(|word| tag.contains(word))
        })
        .unwrap();
    let (_, body) = tag.split_once('>').unwrap();
    body.split('<').next().unwrap().split_whitespace().map(|x| x.parse().unwrap()).collect()
}

/// What a packing did.
struct Rest {
    mean_speed: f64,
    /// Displacement over radius: median and largest.
    median_moved: f64,
    moved: f64,
    /// Grains that moved more than 5 % of their radius.
    loose: usize,
    /// Force on the boundary over the weight, mean over the last tenth.
    carried: f64,
    residual: f64,
    unconverged: usize,
    iterations: usize,
    contacts: usize,
}

fn settle(
    world: &mut World,
    radius: &[f64],
    boundary: usize,
    step: f64,
    steps: usize,
    tolerance: f64,
) -> Rest {
    let grains: Vec<usize> = (0..world.bodies.len()).filter(|&b| b != boundary).collect();
    let start = world.bodies.position.clone();
    let weight: f64 = grains.iter().map(|&b| world.bodies.mass[b]).sum::<f64>() * world.gravity.length();
    let mean_radius = radius.iter().sum::<f64>() / radius.len() as f64;
    let mut stepper = stepper(step, 0.15 * mean_radius, tolerance, Relaxed);
    let mut rest = Rest {
        mean_speed: 0.0,
        median_moved: 0.0,
        moved: 0.0,
        loose: 0,
        carried: 0.0,
        residual: 0.0,
        unconverged: 0,
        iterations: 0,
        contacts: 0,
    };
    let last = steps.div_ceil(10);
    for k in 0..steps {
        let report = stepper.step(world).unwrap();
        rest.residual = f64::max(rest.residual, report.solve.residual.max);
        rest.unconverged += usize::from(!report.solve.converged());
        rest.iterations += report.solve.iterations;
        rest.contacts = report.contacts;
        if k + last >= steps {
            let wrench = report.wrenches.iter().find(|w| w.body.index() == boundary).unwrap();
            rest.carried += -wrench.force.z / weight / last as f64;
        }
    }
    rest.mean_speed =
        grains.iter().map(|&b| world.bodies.velocity[b].length()).sum::<f64>() / grains.len() as f64;
    let mut moved: Vec<f64> =
        grains.iter().zip(radius).map(|(&b, r)| (world.bodies.position[b] - start[b]).length() / r).collect();
    moved.sort_by(f64::total_cmp);
    rest.median_moved = moved[moved.len() / 2];
    rest.moved = moved[moved.len() - 1];
    rest.loose = moved.iter().filter(|&&m| m > 0.05).count();
    rest
}

fn report(name: &str, step: f64, rest: &Rest, steps: usize) {
    println!(
        "{name} dt {step}: {} contacts, mean speed {:.2e} m/s, moved {:.4} radii (median), {:.3} (most), {} \
         grains more than 0.05, ground carries {:.6} of the \
         weight, residual up to {:.1e}, {} of {steps} steps unconverged, {:.1} iterations per step",
        rest.contacts,
        rest.mean_speed,
        rest.median_moved,
        rest.moved,
        rest.loose,
        rest.carried,
        rest.residual,
        rest.unconverged,
        rest.iterations as f64 / steps as f64
    );
}

/// Kleinert 2015: mu 0.4, g = 10 m/s^2, no rotation; stays at rest for 1 s.
fn kleinert(name: &str, step: f64, steps: usize) {
    let Some(text) = data(name) else { return };
    let (points, radius) = (array(&text, &["Points"]), array(&text, &["\"radius\""]));
    let mass = array(&text, &["\"mass\""]);
    let materials = Materials::single("grain", 1650.0, 0.4, 0.0).unwrap();
    let mut world = World::new(Vec3::new(0.0, 0.0, -10.0), materials).unwrap();
    let ground = add_ground(&mut world, 0.0).index();
    let sliding = Motion::fixed().with_free([true, true, true, false, false, false]);
    let motion = world.add_motion(sliding).unwrap();
    for (point, &r) in points.chunks_exact(3).zip(&radius) {
        let geometry = world.add_geometry(Geometry::sphere(r).unwrap());
        world
            .add_body(Body { motion, ..Body::new(geometry, MaterialId::default(), Vec3::from_slice(point)) })
            .unwrap();
    }
    for (body, m) in mass.iter().enumerate() {
        assert_close(world.bodies.mass[body + 1], *m, 1e-3 * m, "mass of the file");
    }
    let rest = settle(&mut world, &radius, ground, step, steps, 1e-4);
    report(name, step, &rest, steps);
    assert!(rest.mean_speed < 1e-3);
    // Not every grain of the files is carried: see docs/mechanics.md. Those fall; the pile as a whole stays.
    assert!(rest.median_moved < 0.02 && rest.loose < radius.len() * 8 / 100);
    assert_close(rest.carried, 1.0, 1e-3, "weight on the ground");
}

#[test]
#[ignore = "slow: 1.1 s of a real pile in 1100 steps"]
fn kleinert_2048_stays_at_rest() {
    kleinert("kleinert_particles2048pile.vtu", 1e-2, 100);
    kleinert("kleinert_particles2048pile.vtu", 1e-3, 1000);
}

#[test]
#[ignore = "slow: 1.1 s of a real pile in 1100 steps"]
fn kleinert_5040_stays_at_rest() {
    kleinert("kleinert_particles5040pile.vtu", 1e-2, 100);
    kleinert("kleinert_particles5040pile.vtu", 1e-3, 1000);
}

/// Dosta et al. 2024: 25 000 spheres in a box of thin walls (a triangle mesh). Without rotation: grains that
/// may roll are not at rest in this packing, whatever the program (docs/mechanics.md).
#[test]
#[ignore = "slow: 25 000 spheres, 120 steps"]
fn dosta_bed_stays_at_rest() {
    let (Some(grains), Some(walls)) =
        (data("dosta_penetration_25k.txt"), data("dosta_penetration_walls.txt"))
    else {
        return;
    };
    let rows = |text: &str| -> Vec<Vec<f64>> {
        text.lines()
            .skip(1)
            .map(|line| line.split_whitespace().filter_map(|x| x.parse().ok()).collect::<Vec<f64>>())
            .collect()
    };
    let corners: Vec<Vec3> = rows(&walls)
        .iter()
        .filter(|row| row.len() == 9)
        .flat_map(|row| row.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>())
        .collect();
    let triangles: Vec<[u32; 3]> =
        (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    // The last line of the file is the intruder, which has six columns.
    let spheres: Vec<Vec<f64>> = rows(&grains).into_iter().filter(|row| row.len() == 4).collect();
    assert_eq!(spheres.len(), 25_000);
    for (step, steps) in [(1e-3, 100), (1e-2, 20)] {
        let mut materials = Materials::single("glass", 2500.0, 0.3, 0.0).unwrap();
        let steel = materials.add("steel", 7200.0).unwrap();
        materials.set_pair(MaterialId::default(), steel, 0.2, 0.0).unwrap();
        let mut world = World::new(Vec3::new(0.0, 0.0, -G), materials).unwrap();
        let fixed = world.add_motion(Motion::fixed()).unwrap();
        let mesh = world.add_geometry(Geometry::mesh(corners.clone(), triangles.clone()).unwrap());
        world.add_body(Body { motion: fixed, ..Body::new(mesh, steel, Vec3::ZERO) }).unwrap();
        let sliding = Motion::fixed().with_free([true, true, true, false, false, false]);
        let sliding = world.add_motion(sliding).unwrap();
        let ball = world.add_geometry(Geometry::sphere(spheres[0][0]).unwrap());
        for row in &spheres {
            assert_eq!(row[0], spheres[0][0]);
            let position = Vec3::from_slice(&row[1..]);
            world
                .add_body(Body { motion: sliding, ..Body::new(ball, MaterialId::default(), position) })
                .unwrap();
        }
        let rest = settle(&mut world, &vec![spheres[0][0]; spheres.len()], 0, step, steps, 1e-3);
        report("Dosta 25k", step, &rest, steps);
        assert!(rest.mean_speed < 1e-3 && rest.loose < spheres.len() / 100);
        assert_close(rest.carried, 1.0, 1e-3, "weight on the walls");
    }
}
