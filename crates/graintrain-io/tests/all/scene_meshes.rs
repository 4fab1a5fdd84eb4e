//! Solid meshes in scenes: mass from the file, what is refused, and a wheel from a binary STL file in
//! millimetres that rolls through grains. Packings of clumps.

use graintrain::ccp::FrictionModel;
use graintrain::collide::deepest_overlap;
use graintrain::math::Vec3;
use graintrain::stepper::{StepReport, Stepper};
use graintrain::world::World;
use graintrain_io::files::OutputError;
use graintrain_io::run::{Ending, Observer, Run, RunSettings, RunTotals, StepView};
use graintrain_io::scene::{Scene, Simulation, builtin};
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Corners of the circumference: twelve grousers, between which the wheel is thinner.
const CORNERS: u32 = 48;

/// Outline of the wheel at corner k, mm from its axis, which is y.
fn outline(k: u32) -> [f64; 2] {
    let radius = if (k / 2).is_multiple_of(2) { 100.0 } else { 92.0 };
    let angle = TAU * f64::from(k % CORNERS) / f64::from(CORNERS);
    [radius * angle.cos(), radius * angle.sin()]
}

/// The wheel, 50 mm wide, its frame in the middle of one side.
fn triangles() -> Vec<[[f64; 3]; 3]> {
    let at = |k: u32, y: f64| {
        let [z, x] = outline(k);
        [x, y, z]
    };
    let (near, far) = (0.0, 50.0);
    let sides = (0..CORNERS).flat_map(|k| {
        [
            [[0.0, near, 0.0], at(k + 1, near), at(k, near)],
            [[0.0, far, 0.0], at(k, far), at(k + 1, far)],
            [at(k, near), at(k + 1, far), at(k, far)],
            [at(k, near), at(k + 1, near), at(k + 1, far)],
        ]
    });
    sides.collect()
}

fn binary_stl(triangles: &[[[f64; 3]; 3]]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        triangle.iter().flatten().for_each(|&x| bytes.extend((x as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn folder(name: &str, triangles: &[[[f64; 3]; 3]]) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("graintrain-meshes-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("wheel.stl"), binary_stl(triangles)).unwrap();
    folder
}

fn build(text: &str, folder: &Path) -> Result<Simulation, String> {
    let scene = Scene::parse("wheel", "wheel.toml", text, folder, &[]).map_err(|error| error.to_string())?;
    scene.build().map_err(|error| error.to_string())
}

fn wheel_of(world: &World) -> usize {
    world.bodies.name.iter().position(|name| name == "wheel").unwrap()
}

const WHEEL: &str = include_str!("wheel.toml");

/// Volume and inertia about the axis of a polygon of corners p_k: sums over its triangles, in m.
#[test]
fn a_solid_mesh_from_millimetres_has_the_mass_of_its_volume() {
    let folder = folder("mass", &triangles());
    let text = WHEEL.replace("mass = \"3 kg\"\n", "");
    let world = build(&text, &folder).unwrap().world;
    let wheel = wheel_of(&world);
    let (mut area, mut second) = (0.0, 0.0);
    for k in 0..CORNERS {
        let ([a, b], [c, d]) = (outline(k), outline(k + 1));
        let cross = (a * d - b * c) * 1e-6;
        area += 0.5 * cross;
        second += cross / 12.0 * (a * a + b * b + c * c + d * d + a * c + b * d) * 1e-6;
    }
    let (mass, inertia) = (2600.0 * 0.05 * area, 2600.0 * 0.05 * second);
    // The file has single precision.
    assert!((world.bodies.mass[wheel] / mass - 1.0).abs() < 1e-6, "{}", world.bodies.mass[wheel]);
    assert!((world.bodies.inertia[wheel].y_axis.y / inertia - 1.0).abs() < 1e-6);
    // The frame's origin is in the middle of one side.
    let centre = Vec3::new(-0.08, 0.0, 0.21);
    assert!((world.bodies.position[wheel] - centre).length() < 1e-6, "{}", world.bodies.position[wheel]);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn meshes_that_bound_no_solid_are_reported() {
    type Mesh = Vec<[[f64; 3]; 3]>;
    type Case = (&'static str, fn(Mesh) -> Mesh, &'static str);
    let cases: [Case; 3] = [
        ("hole", |triangles| triangles[1..].to_vec(), "not closed: 3 edges"),
        (
            "turned",
            |mut triangles| {
                triangles[5].swap(0, 1);
                triangles
            },
            "the wrong way round",
        ),
        ("inside-out", |triangles| triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect(), "inside out"),
    ];
    for (name, change, expected) in cases {
        let folder = folder(name, &change(triangles()));
        let error = build(WHEEL, &folder).err().unwrap_or_else(|| panic!("{name} was accepted"));
        assert!(error.contains(expected), "{name}: {error}");
        // A surface may be free with a given mass and inertia.
        let given =
            WHEEL.replace(", solid = true", "").replace("mass = \"3 kg\"", "mass = 3\ninertia = [1, 1, 1]");
        let world = build(&given, &folder).unwrap().world;
        assert_eq!(world.bodies.mass[wheel_of(&world)], 3.0);
        std::fs::remove_dir_all(folder).unwrap();
    }
    let folder = folder("two", &triangles());
    let alone = WHEEL.replace(", solid = true", "");
    assert!(build(&alone, &folder).unwrap_err().contains("mass and inertia"));
    let second = format!(
        "{WHEEL}[body.second]\nshape = {{ mesh = {{ file = \"wheel.stl\", scale = 0.001 }} }}\nposition = [0, 0, 0.2]\n"
    );
    assert!(build(&second, &folder).unwrap_err().contains("between two meshes"));
    std::fs::remove_dir_all(folder).unwrap();
}

/// The step whose bits are compared: the wheel stands in the grains and begins to roll.
const EARLY: u64 = 120;

/// Pull, load carried, torque about the axis, height of the axle.
fn of_wheel(world: &World, report: &StepReport, wheel: usize) -> [f64; 4] {
    let wrench = report.wrenches.iter().find(|wrench| wrench.body.index() == wheel).unwrap();
    [wrench.force.x, wrench.force.z, wrench.torque.y, world.bodies.position[wheel].z]
}

/// What is measured at the wheel in every step (pull, load carried, torque about the axis, height of the
/// axle), the hash of the state after the step [`EARLY`], and the world at the end.
fn run(simulation: Simulation, steps: u64) -> (Vec<[f64; 4]>, u64, World) {
    let mut world = simulation.world;
    let wheel = wheel_of(&world);
    let mut stepper = Stepper::new(simulation.settings).unwrap();
    let (mut series, mut early, mut unconverged) = (Vec::new(), 0, 0);
    for _ in 0..simulation.steps.min(steps) {
        let report: StepReport = stepper.step(&mut world).unwrap();
        assert_eq!(report.contacts_missed, 0, "step {}", world.step);
        // A step may end at its budget.
        unconverged += u64::from(!report.solve.converged());
        assert!(report.solve.residual.rms < 1e-2, "step {}: {:?}", world.step, report.solve.residual);
        if world.step == EARLY {
            early = world.state_hash();
        }
        series.push(of_wheel(&world, &report, wheel));
    }
    assert!(
        50 * unconverged <= world.step,
        "{unconverged} of {} steps did not reach their tolerance",
        world.step
    );
    (series, early, world)
}

/// Mean pull, load carried, torque and height, and the standard error of each from the means of ten parts of
/// the series.
fn means(series: &[[f64; 4]]) -> [[f64; 2]; 4] {
    std::array::from_fn(|k| {
        let mean = |rows: &[[f64; 4]]| rows.iter().map(|row| row[k]).sum::<f64>() / rows.len() as f64;
        let parts: Vec<f64> = series.chunks(series.len().div_ceil(10)).map(mean).collect();
        let (whole, count) = (mean(series), parts.len() as f64);
        let scatter = parts.iter().map(|part| (part - whole).powi(2)).sum::<f64>() / (count - 1.0);
        [whole, (scatter / count).sqrt()]
    })
}

/// The grains carry weight and load of the wheel; turning against slip costs a torque; the same bits again.
#[test]
fn a_wheel_from_cad_rolls_through_grains() {
    let folder = folder("wheel", &triangles());
    let simulation = build(WHEEL, &folder).unwrap();
    let step = simulation.settings.step;
    let (series, hash, world) = run(simulation, u64::MAX);
    let [[pull, _], [carried, _], [torque, _], [height, _]] = means(&series[series.len() / 2..]);
    let weight = 3.0 * 9.81 + 40.0;
    println!(
        "pull {pull:.1} N, carried {carried:.1} N of {weight:.1} N, torque {torque:.2} N m, axle at {height:.4} m"
    );
    // From 0.4 s on at 80 % of the speed of rolling, whatever the grains do.
    let way = world.bodies.position[wheel_of(&world)].x + 0.08;
    assert!((way - 0.8 * 0.1 * (world.time - 0.4)).abs() < step * 1e-6, "{way}");
    assert!(world.bodies.position.iter().all(|x| x.z >= 0.0 && x.x.abs() < 0.23 && x.y.abs() < 0.09));
    assert!((carried / weight - 1.0).abs() < 0.05, "{carried} N of {weight} N");
    assert!(torque < 0.0, "the bed resists turning: {torque} N m");
    // It sank into the bed (100 mm, loosely on its lattice) and did not fall through it.
    assert!((0.11..0.16).contains(&height), "axle at {height} m");
    assert!(pull.abs() < 0.6 * weight, "pull {pull} N beyond what friction allows");
    assert_eq!(run(build(WHEEL, &folder).unwrap(), EARLY).1, hash);
    std::fs::remove_dir_all(folder).unwrap();
}

fn built_in_wheel(folder: &Path) -> Simulation {
    let path = folder.join("wheel.stl").to_string_lossy().into_owned();
    Scene::load("wheel", &[("path".to_string(), path)]).unwrap().build().unwrap()
}

#[test]
fn the_built_in_wheel_is_short_and_stands_over_five_thousand_grains() {
    let text = builtin::find("wheel").unwrap().text;
    let lines = text.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
    assert!(lines.count() < 50);
    let folder = folder("built-in", &triangles());
    let world = built_in_wheel(&folder).world;
    assert_eq!(world.bodies.len(), 5000 + 4);
    assert!((world.bodies.mass[wheel_of(&world)] / 3.0 - 1.0).abs() < 0.01);
    assert_eq!(deepest_overlap(&world), None);
    std::fs::remove_dir_all(folder).unwrap();
}

/// A wheel seven times as large, in metres, and twice as wide, its frame far from it: the bed, the grains,
/// the start and the step follow.
#[test]
fn the_built_in_wheel_takes_any_wheel() {
    let large = |[x, y, z]: [f64; 3]| [7e-3 * x + 11.0, 14e-3 * y, 7e-3 * z - 3.0];
    let triangles: Vec<[[f64; 3]; 3]> = triangles().iter().map(|corners| corners.map(large)).collect();
    let folder = folder("any", &triangles);
    let path = folder.join("wheel.stl").to_string_lossy().into_owned();
    let settings = [("path".to_string(), path), ("scale".to_string(), "1 m".to_string())];
    let simulation = Scene::load("wheel", &settings).unwrap().build().unwrap();
    let world = &simulation.world;
    assert_eq!(deepest_overlap(world), None);
    // 0.7 m wide: 2.8 of that are 17 rows of grains of 10.5 cm.
    let grains = world.bodies.len() - 4;
    assert_eq!(grains, 50 * 17 * 10);
    assert!((simulation.settings.step / (4e-3 * 7.0_f64.sqrt()) - 1.0).abs() < 1e-6);
    // Above the bed, its middle between the sides, two radii behind the middle.
    let place = world.bodies.position[wheel_of(world)];
    let highest = world.bodies.position[4..].iter().map(|x| x.z).fold(0.0, f64::max);
    assert!((place - Vec3::new(-1.4, 0.0, place.z)).length() < 0.02, "{place}");
    assert!((0.7..1.0).contains(&(place.z - highest)), "{place} over {highest}");
    std::fs::remove_dir_all(folder).unwrap();
}

/// A file that is not there, or no parameter: named with the place in the scene and what to do.
#[test]
fn extents_of_files_that_cannot_be_read() {
    let missing = [("path".to_string(), "/nowhere/wheel.stl".to_string())];
    let error = Scene::load("wheel", &missing).unwrap_err().to_string();
    assert!(error.contains("/nowhere/wheel.stl") && error.contains("--set path=FILE"), "{error}");
    let base = "[parameters]\nn = 3\nword = \"mesh_max_x\"\n[time]\nstep = 1\nsteps = 1\n[body.a]\nshape = { sphere = { radius = \"X\" } }\n";
    for (text, expected) in [
        ("mesh_max_x(other)", "`other` is no parameter"),
        ("mesh_max_x(n)", "`n` names no file"),
        ("mesh_max_x(3)", "takes the parameter that names a file"),
        ("mesh_max_x", "takes the parameter that names a file"),
        ("mesh_max_x(n", "takes the parameter that names a file"),
    ] {
        let error = build(&base.replace('X', text).replace("word = \"mesh_max_x\"\n", ""), Path::new(""));
        let error = error.err().unwrap_or_else(|| panic!("{text} is accepted"));
        assert!(error.contains(expected), "{text}: {error}");
    }
}

/// Keeps what acts on the wheel in every step that rolls: pull, load carried, torque about the axis, height.
struct Rolling {
    wheel: usize,
    series: Vec<[f64; 4]>,
    unconverged: u64,
}

impl Observer for Rolling {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        let StepView { world, report, totals, .. } = step;
        assert_eq!(report.contacts_missed, 0, "step {}", world.step);
        self.unconverged += u64::from(!report.solve.converged());
        if totals.stages.last().is_some_and(|stage| stage.name == "roll") {
            self.series.push(of_wheel(world, report, self.wheel));
        }
        Ok(())
    }
}

/// Pull, load and torque of the second half of the roll do not drift: both of its halves agree within what
/// they scatter.
#[test]
#[ignore = "5 000 grains for 900 steps: a minute or more"]
fn the_wheel_in_five_thousand_grains_is_steady() {
    let folder = folder("large", &triangles());
    assert_eq!(run(built_in_wheel(&folder), EARLY).1, run(built_in_wheel(&folder), EARLY).1);
    let mut simulation = built_in_wheel(&folder);
    simulation.settings.solver.friction = FrictionModel::Relaxed;
    let settings = RunSettings::new(&simulation, None);
    let mut watch = Rolling { wheel: wheel_of(&simulation.world), series: Vec::new(), unconverged: 0 };
    let stop = Arc::new(AtomicBool::new(false));
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), stop).unwrap();
    assert_eq!(run.advance(&mut [&mut watch]).unwrap(), Ending::Finished);
    let Rolling { series, unconverged, .. } = watch;
    assert!(50 * unconverged <= run.world.step, "{unconverged} steps did not reach their tolerance");
    let rolling = &series[series.len() / 2..];
    let (first, second) = rolling.split_at(rolling.len() / 2);
    let (whole, first, second) = (means(rolling), means(first), means(second));
    println!("pull, carried, torque, height with standard errors: {whole:.4?}");
    let weight = 3.0 * 9.81 + 40.0;
    assert!((whole[1][0] / weight - 1.0).abs() < 0.02, "{whole:?}");
    for k in 0..3 {
        let apart = (first[k][0] - second[k][0]).abs();
        assert!(apart < 4.0 * first[k][1].hypot(second[k][1]), "{k}: {first:?} {second:?}");
    }
    assert!(whole[2][0] < 0.0 && whole[0][0].abs() < 0.6 * weight, "{whole:?}");
    std::fs::remove_dir_all(folder).unwrap();
}

const CLUMPS: &str = r#"
[time]
step = "2 ms"
end = "1.5 s"
[body.ground]
shape = { plane = {} }
[packing.clumps]
parts = [
    { shape = { sphere = { radius = "2 cm" } } },
    { shape = { sphere = { radius = "2 cm" } }, position = ["2 cm", 0, 0] },
]
random_rotation = true
lattice = { counts = [4, 4, 3], pitch = "7 cm" }
"#;

/// Two balls of radius R at the distance R: the union has the volume of both less the lens 5/12 pi R^3; their
/// centre comes to the place on the lattice, every body is turned another way, and they come to rest.
#[test]
fn packings_of_clumps_weigh_their_union_and_rest() {
    let simulation = build(CLUMPS, Path::new("")).unwrap();
    let again = build(&simulation.resolved.to_toml().unwrap(), Path::new("")).unwrap();
    assert_eq!(again.world, simulation.world);
    let (mut world, radius) = (simulation.world, 0.02_f64);
    let volume = (8.0 / 3.0 - 5.0 / 12.0) * PI * radius.powi(3);
    assert_eq!(world.bodies.len(), 49);
    assert!((world.bodies.mass[1] / (1000.0 * volume) - 1.0).abs() < 1e-12);
    assert!((world.bodies.position[1] - Vec3::splat(0.035)).length() < 1e-15);
    // Uniform rotations take an axis to any place of the sphere: its mean square along each direction is 1/3
    // +- 0.04 (48 of them).
    let axes: Vec<Vec3> = world.bodies.orientation[1..].iter().map(|turn| *turn * Vec3::X).collect();
    for k in 0..3 {
        let square = axes.iter().map(|axis| axis[k] * axis[k]).sum::<f64>() / 48.0;
        assert!((square - 1.0 / 3.0).abs() < 0.13, "{square}");
    }
    let mut stepper = Stepper::new(simulation.settings).unwrap();
    for _ in 0..simulation.steps {
        let report = stepper.step(&mut world).unwrap();
        assert!(
            report.solve.converged()
                && report.contacts_missed == 0
                && report.penetration_max_over_size < 0.01
        );
    }
    assert!(world.bodies.position[1..].iter().all(|x| (0.9 * radius..0.25).contains(&x.z)));
    for (right, wrong) in [
        ("random_rotation = true", "radius = 1"),
        ("sphere = { radius = \"2 cm\" }", "plane = {}"),
        ("lattice = { counts = [4, 4, 3], pitch = \"7 cm\" }", "file = { path = \"a.csv\" }"),
    ] {
        assert!(build(&CLUMPS.replace(right, wrong), Path::new("")).is_err(), "{wrong} was accepted");
    }
}

/// The hull of the wheel's points has no grooves; its frame is the file's. Inside, or in a plane, points are
/// recognised as such.
#[test]
fn a_hull_from_a_file_stands_where_the_file_says() {
    let folder = folder("hull", &triangles());
    let text =
        WHEEL.replace("mass = \"3 kg\"\n", "").replace(", solid = true", "").replace("mesh =", "hull =");
    let world = build(&text, &folder).unwrap().world;
    let wheel = wheel_of(&world);
    // The outer corners, between which the hull is straight.
    let outer: Vec<[f64; 2]> = (0..CORNERS).filter(|k| (k / 2).is_multiple_of(2)).map(outline).collect();
    let next = outer.iter().cycle().skip(1);
    let area: f64 = outer.iter().zip(next).map(|([a, b], [c, d])| 0.5e-6 * (a * d - b * c)).sum();
    let mass = 2600.0 * 0.05 * area;
    assert!((world.bodies.mass[wheel] / mass - 1.0).abs() < 1e-6, "{}", world.bodies.mass[wheel]);
    let centre = Vec3::new(-0.08, 0.0, 0.21);
    assert!((world.bodies.position[wheel] - centre).length() < 1e-6, "{}", world.bodies.position[wheel]);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn hulls_of_points_are_read_packed_and_refused() {
    let scene = |hull: &str| {
        format!(
            "[time]\nstep = 1e-3\nsteps = 1\n[packing.stones]\nshape = {{ hull = {hull} }}\nlattice = {{ counts = [2, 2, 2], pitch = 3 }}\n"
        )
    };
    let points = "{ points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.2, 0.2, 0.2]], scale = 2 }";
    let world = build(&scene(points), Path::new(".")).unwrap().world;
    assert_eq!(world.bodies.len(), 8);
    assert!((world.geometries[0].volume - 8.0 / 6.0).abs() < 1e-12);
    // The same again from what the run's folder keeps.
    let first = Scene::parse("stones", "stones.toml", &scene(points), Path::new("."), &[]).unwrap();
    let again = build(&first.to_toml().unwrap(), Path::new(".")).unwrap().world;
    assert_eq!(again.geometries, world.geometries);
    for (hull, expected) in [
        ("{ points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]] }", "lie in a plane"),
        ("{ points = [] }", "lie in a plane"),
        ("{ file = \"absent.stl\" }", "absent.stl"),
        ("{ scale = 2 }", "points"),
    ] {
        let error =
            build(&scene(hull), Path::new(".")).err().unwrap_or_else(|| panic!("{hull} was accepted"));
        assert!(
            error.contains(expected) && error.contains("stones") || error.contains("wheel.toml"),
            "{error}"
        );
    }
}
