//! The built-in scenes: they build, with the right number of bodies, and survive being written and read
//! again.

use graintrain::collide::deepest_overlap;
use graintrain::math::Vec3;
use graintrain::shape::{Mesh, Shape, Sphere};
use graintrain::stepper::Stepper;
use graintrain_io::scene::{Scene, Simulation, builtin};
use graintrain_testdata::public_data;
use std::path::Path;

fn settings(list: &[(&str, &str)]) -> Vec<(String, String)> {
    list.iter().map(|(key, value)| (key.to_string(), value.to_string())).collect()
}

fn build(name: &str, list: &[(&str, &str)]) -> Simulation {
    let scene = Scene::load(name, &settings(list)).unwrap_or_else(|error| panic!("{name}: {error}"));
    scene.build().unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The resolved scene gives the same world, bit for bit, and writes itself the same way.
fn assert_resolves(simulation: &Simulation) {
    let text = simulation.resolved.to_toml().unwrap();
    let again = Scene::parse(&simulation.resolved.name, "resolved.toml", &text, Path::new("/elsewhere"), &[])
        .unwrap_or_else(|error| panic!("{error}\n{text}"));
    let rebuilt = again.build().unwrap();
    assert_eq!(rebuilt.world, simulation.world);
    assert_eq!(rebuilt.steps, simulation.steps);
    assert_eq!(rebuilt.output, simulation.output);
    assert_eq!(format!("{:?}", rebuilt.settings), format!("{:?}", simulation.settings));
    let without_comments =
        |text: String| text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n");
    assert_eq!(without_comments(rebuilt.resolved.to_toml().unwrap()), without_comments(text));
}

fn data(file: &str) -> Option<String> {
    public_data(&format!("packings/{file}"))?.to_str().map(str::to_string)
}

/// Deepest overlap as a fraction of the smallest radius.
fn overlap(simulation: &Simulation) -> f64 {
    let world = &simulation.world;
    let sizes =
        world.geometries.iter().flat_map(|geometry| &geometry.parts).map(|p| p.shape.half_thickness());
    deepest_overlap(world).map_or(0.0, |overlap| overlap.depth) / sizes.fold(f64::INFINITY, f64::min)
}

#[test]
fn the_papers_scenes_have_its_numbers_of_bodies_and_no_overlap() {
    let cases = [
        ("sedimentation", "1", 27 + 2),
        ("sedimentation", "4", 729 + 2),
        ("sedimentation", "8", 4915),
        ("sedimentation", "16", 35_939),
        ("drafting", "1", 27 + 2),
        ("drafting", "4", 729 + 2),
        ("drafting", "8", 4915),
        // Below n = 3 the sample has seven layers all the same: fewer jam between the halves.
        ("direct-shear", "1", 84 + 3),
        ("direct-shear", "4", 1053 + 3),
        ("direct-shear", "8", 7228),
        ("direct-shear", "16", 53_364),
    ];
    for (name, n, bodies) in cases {
        let simulation = build(name, &[("n", n)]);
        assert_eq!(simulation.world.bodies.len(), bodies, "{name} n = {n}");
        assert_eq!(overlap(&simulation), 0.0, "{name} n = {n}");
        // The paper names 25 ms for the sedimentation; the blade is too fast for it.
        let step = if name == "drafting" { 0.0125 } else { 0.025 };
        assert_eq!(simulation.settings.step, step, "{name}");
        if n == "4" {
            assert_resolves(&simulation);
        }
    }
}

/// A third of this sample is wedged between the halves of the box: relaxed friction throws grains at hundreds
/// of times the speed at which they meet (23 413 J). With exact friction a step that its budget ends is as
/// sound as the others.
#[test]
fn the_smallest_shear_box_throws_nothing() {
    let Simulation { mut world, settings, steps, .. } = build("direct-shear", &[("n", "1")]);
    let mut stepper = Stepper::new(settings).unwrap();
    let mut unconverged = 0;
    for step in 1..=steps {
        let report = stepper.step(&mut world).unwrap();
        unconverged += u64::from(!report.solve.converged());
        assert!(report.solve.residual.rms < 1e-2, "step {step}: {:?}", report.solve.residual);
        assert!(report.penetration_max_over_size < 0.01, "step {step}: {}", report.penetration_max_over_size);
        // What fell in has come to rest by then.
        assert!(step < 60 || report.kinetic_energy < 200.0, "step {step}: {} J", report.kinetic_energy);
    }
    println!("{unconverged} of {steps} steps did not reach their tolerance");
    assert!(50 * unconverged <= steps, "{unconverged} of {steps}");
}

#[test]
fn the_lattice_of_the_common_job_is_reproduced_up_to_its_random_numbers() {
    let simulation = build("sedimentation", &[("n", "4"), ("jitter", "0")]);
    let bodies = &simulation.world.bodies;
    assert_eq!(bodies.name[..2], ["box", "mixer"]);
    let first = bodies.position[2];
    assert!((bodies.position[3] - first - 0.23 * Vec3::Z).length() < 1e-12);
    assert!((first.x - 0.115).abs() < 1e-12 && (first.y - 0.115).abs() < 1e-12);
    let jittered = build("sedimentation", &[("n", "4")]);
    let moves = (2..bodies.len()).map(|b| (jittered.world.bodies.position[b] - bodies.position[b]).abs());
    let largest = moves.fold(Vec3::ZERO, Vec3::max);
    assert!(largest.max_element() <= 0.012 && largest.min_element() > 0.011, "{largest}");
    let other = build("sedimentation", &[("n", "4"), ("seed", "2")]);
    assert_ne!(other.world.bodies.position, jittered.world.bodies.position);
}

#[test]
fn masses_and_motions_of_the_paper() {
    let shear = build("direct-shear", &[("n", "2")]);
    let world = &shear.world;
    let press = world.bodies.name.iter().position(|name| name == "press").unwrap();
    assert_eq!(world.free_degrees(press), [false, false, true, false, false, false]);
    let volume = (7.0 * 0.23 - 0.08) * (5.0 * 0.23 - 0.08) * 0.2;
    assert!((world.bodies.mass[press] / (1e4 * volume) - 1.0).abs() < 1e-12);
    let lower = world.bodies.name.iter().position(|name| name == "lower").unwrap();
    let motion = &world.motions[world.bodies.motion[lower].index()];
    let distance = |from: f64, to: f64| motion.translation[0].1.integral(from, to - from);
    assert_eq!(distance(0.0, 1.0), 0.0);
    assert!((distance(1.0, 3.0) - 0.3).abs() < 1e-12, "half a period is a stroke");
    assert!(distance(1.0, 5.0).abs() < 1e-12, "a period is there and back");

    let drafting = build("drafting", &[("n", "8")]);
    let blade = drafting.world.bodies.name.iter().position(|name| name == "blade").unwrap();
    let motion = &drafting.world.motions[drafting.world.bodies.motion[blade].index()];
    let end = drafting.world.bodies.position[blade].x + motion.translation[0].1.integral(1.0, 2.0);
    let length = 17.0 * 0.23 + 0.2;
    assert!((end + 0.05 - length / 2.0).abs() < 1e-9, "the blade stops half way");
}

#[test]
fn small_scenes_build_without_overlap_and_survive_resolving() {
    for (name, bodies) in [
        ("incline", 3),
        ("stack", 6),
        ("excavator", 16 * 6 * 5 + 4),
        ("shear-box", 19 * 19 * 14 + 3),
        ("hopper", 4),
        ("silo", 2),
        ("repose", 1),
    ] {
        let simulation = build(name, &[]);
        assert_eq!(simulation.world.bodies.len(), bodies, "{name}");
        assert!(overlap(&simulation) < 1e-9, "{name}: {}", overlap(&simulation));
        assert_resolves(&simulation);
    }
    assert_eq!(build("stack", &[("n", "9")]).world.bodies.len(), 10);
}

#[test]
fn kleinerts_piles_are_read_as_published() {
    for (file, count) in [("kleinert_particles2048pile.vtu", 2048), ("kleinert_particles5040pile.vtu", 5040)]
    {
        let Some(path) = data(file) else { continue };
        let simulation = build("pile", &[("path", &path)]);
        let world = &simulation.world;
        assert_eq!(world.bodies.len(), count + 1);
        assert_eq!(world.gravity, Vec3::new(0.0, 0.0, -10.0));
        assert_eq!(world.materials.pair_friction(0, 0), 0.4);
        let mut masses = 0.0;
        for body in 1..=count {
            let position = world.bodies.position[body];
            assert!(position.min_element() > 0.0 && position.max_element() < 10.0);
            assert_eq!(world.free_degrees(body), [true, true, true, false, false, false]);
            let Shape::Sphere(Sphere { radius }) =
                world.geometries[world.bodies.geometry[body].index()].parts[0].shape
            else {
                panic!("not a sphere")
            };
            assert!((0.008..=0.016).contains(&radius), "{radius}");
            masses += world.bodies.mass[body];
        }
        assert!(overlap(&simulation) < 0.01);
        if count == 2048 {
            // First entries of the file, and the sum of its own masses.
            assert_eq!(world.bodies.position[1], Vec3::new(5.36588, 5.61032, 0.014759));
            assert!((world.bodies.mass[1] / 2.2204e-2 - 1.0).abs() < 1e-4);
            assert_resolves(&simulation);
        }
        assert!(masses > 0.0);
    }
}

#[test]
fn dostas_bed_is_read_without_the_ball() {
    let Some(path) = data("dosta_penetration_25k.txt") else { return };
    let simulation = build("dosta", &[("path", &path)]);
    let world = &simulation.world;
    assert_eq!(world.bodies.len(), 25_000 + 2);
    assert_eq!(world.geometries.len(), 3, "box, ball, and one sphere shared by all grains");
    let grains = 2..world.bodies.len();
    let low = grains.clone().map(|b| world.bodies.position[b]).fold(Vec3::INFINITY, Vec3::min);
    let high = grains.map(|b| world.bodies.position[b]).fold(Vec3::NEG_INFINITY, Vec3::max);
    assert!((low - Vec3::new(-0.048_000_316_11, -0.029_000_296_95, -0.089_243_543_73)).length() < 1e-10);
    assert!((high - Vec3::new(0.048_000_277_27, 0.029_000_416_2, -0.056_547_215_7)).length() < 1e-9);
    assert!((world.bodies.mass[2] - 2500.0 * 4.0 / 3.0 * std::f64::consts::PI * 1e-9).abs() < 1e-15);
    assert_eq!(world.bodies.velocity[1], Vec3::new(0.0, 0.0, -5.0));
    assert_eq!(world.materials.pair_restitution(0, 1), 0.4);
    // With the ball's line the file is refused, and the message names the line.
    let settings = settings(&[("path", &path), ("skip_last", "0")]);
    let error = Scene::load("dosta", &settings).unwrap().build().unwrap_err();
    assert!(error.kind.to_string().contains("line 25002: 6 values"), "{error}");
}

#[test]
fn the_walls_of_dostas_box_are_a_mesh() {
    let Some(path) = data("dosta_penetration_walls.txt") else { return };
    let text = format!(
        "[time]\nstep = 1e-4\nend = 1\n[body.walls]\nshape = {{ mesh = {{ file = '{path}' }} }}\n\
         [body.ball]\nshape = {{ sphere = {{ radius = '1 cm' }} }}\n"
    );
    let simulation = Scene::parse("walls", "walls.toml", &text, Path::new(""), &[]).unwrap().build().unwrap();
    let Shape::Mesh(Mesh { vertices, triangles, .. }) = &simulation.world.geometries[0].parts[0].shape else {
        panic!("not a mesh")
    };
    assert!(triangles.len() > 40, "{}", triangles.len());
    let high = vertices.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    assert_eq!(high, Vec3::new(0.051, 0.032, 0.107757));
    assert_resolves(&simulation);
}

#[test]
fn names_are_unique_and_every_file_of_the_folder_is_built_in() {
    let mut names: Vec<_> = builtin::SCENES.iter().map(|scene| scene.name.to_string()).collect();
    names.sort_unstable();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes");
    let mut files: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    files.sort_unstable();
    assert_eq!(names, files);
}
