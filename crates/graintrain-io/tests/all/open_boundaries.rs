//! Bodies that enter, leave and grow: amounts, ledgers, going on in the middle.

use crate::pauses::run_with_pauses;
use graintrain::measure::space::porosity;
use graintrain_io::run::Run;
use graintrain_io::scene::Scene;
use graintrain_io::stage::StageEnd;
use std::path::Path;

/// A stream over a funnel of four planes with a hole, an outlet below, clumps and balls of two sizes.
const HOPPER: &str = r#"
seed = 3
[time]
step = "2 ms"
end = "1.2 s"
[output]
every = "0.1 s"
[material.a]
density = 1000
friction = 0.4
[body.left]
shape = { box = { size = [0.6, 0.6, 0.02] } }
position = [-0.33, 0, 0]
rotation = { axis = [0, 1, 0], angle = "30 deg" }
motion = "fixed"
[body.right]
shape = { box = { size = [0.6, 0.6, 0.02] } }
position = [0.33, 0, 0]
rotation = { axis = [0, 1, 0], angle = "-30 deg" }
motion = "fixed"
[packing.first]
radius = 0.02
lattice = { counts = [3, 3, 2], pitch = 0.05, origin = [-0.07, -0.07, 0.1] }
[stream.rain]
radius = { uniform = { min = 0.01, max = 0.03 } }
rate = "200/s"
velocity = [0, 0, "-1 m/s"]
count = 150
region = { box = { min = [-0.2, -0.15, 0.4], max = [0.2, 0.15, 0.5] } }
[stream.twins]
parts = [
  { shape = { sphere = { radius = 0.015 } } },
  { shape = { sphere = { radius = 0.015 } }, position = [0.02, 0, 0] },
]
random_rotation = true
mass_rate = "0.5 kg/s"
start = "0.2 s"
end = "0.9 s"
region = { cylinder = { base = [0, 0, 0.52], radius = 0.1, height = 0.1 } }
[outlet.below]
behind = { point = [0, 0, -0.3], normal = [0, 0, -1] }
[outlet.far]
outside = { box = { min = [-2, -2, -2], max = [2, 2, 2] } }
[measure.all]
exchange = true
energy = true
motion = true
[measure.rain]
motion = true
streams = ["rain"]
[measure.first]
motion = true
packings = ["first"]
"#;

fn scene(text: &str) -> Result<Scene, String> {
    Scene::parse("a", "a.toml", text, Path::new(""), &[]).map_err(|error| error.to_string())
}

/// Runs a scene in a folder, stopped and taken up again after these steps.
fn run(text: &str, folder: &Path, pauses: &[u64]) -> Run {
    run_with_pauses(&scene(text).unwrap(), folder, pauses)
}

/// The records of a table by column.
fn table(folder: &Path, name: &str) -> impl Fn(&str) -> Vec<f64> {
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    let header: Vec<String> = text.lines().next().unwrap().split(',').map(str::to_string).collect();
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect())
        .collect();
    move |column: &str| {
        let k =
            header.iter().position(|name| name == column).unwrap_or_else(|| panic!("{column} {header:?}"));
        rows.iter().map(|row| row[k]).collect()
    }
}

#[test]
fn streams_and_outlets_keep_their_books_and_survive_interruptions() {
    let (whole, paused) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let reference = run(HOPPER, whole.path(), &[]);
    let state = &reference.totals.open_boundaries;
    let [rain, twins] = [0, 1].map(|k| state.streams[k]);
    assert!(rain.is_done && rain.given.bodies == 150, "{rain:?}");
    // 200 per second from 0: the last of 150 came at 0.75 s.
    // 0.5 kg/s over 0.7 s, never ahead of it and behind by a body at most.
    assert!(twins.is_done && twins.given.mass <= 0.35 && twins.given.mass > 0.35 - 0.03, "{twins:?}");
    let left = state.left();
    assert!(left.bodies > 20, "{left:?}");
    assert_eq!(reference.world.bodies.len() as u64, 20 + 150 + twins.given.bodies - left.bodies);
    let all = table(whole.path(), "measures/all.csv");
    let (mass, entered, gone) = (all("mass"), all("entered_mass"), all("left_mass"));
    let initial = 18.0 * 1000.0 * 4.0 / 3.0 * std::f64::consts::PI * 0.02_f64.powi(3);
    for ((mass, entered), gone) in mass.iter().zip(&entered).zip(&gone) {
        assert!((mass - (initial + entered - gone)).abs() < 1e-12);
    }
    // The ledger closes over all steps, those included in which bodies came and left.
    let terms = ["work_gravity", "work_loads", "work_drives", "entered_energy", "ledger_rest"];
    let losses = ["lost_friction", "lost_normal", "left_energy"];
    let (mut sum, mut throughput) = (vec![0.0; mass.len()], vec![0.0; mass.len()]);
    for (sign, columns) in [(1.0, terms.as_slice()), (-1.0, losses.as_slice())] {
        for column in columns {
            for (k, value) in all(column).into_iter().enumerate() {
                sum[k] += sign * value;
                throughput[k] += value.abs();
            }
        }
    }
    for (k, kinetic) in all("kinetic").into_iter().enumerate() {
        assert!((kinetic - sum[k]).abs() <= 1e-10 * throughput[k].max(1e-9), "record {k}");
    }
    // Those that are named by packing and stream are followed, though indices move up.
    let count = |name: &str| *table(whole.path(), name)("count").last().unwrap();
    let present = |wanted: std::ops::Range<u64>| {
        let numbers = &state.numbers;
        (0..reference.world.bodies.len()).filter(|&body| wanted.contains(&numbers.number(body))).count()
            as f64
    };
    assert_eq!(count("measures/first.csv"), present(2..20));
    assert!(present(2..20) < 18.0);
    assert!(count("measures/rain.csv") > 0.0 && count("measures/rain.csv") < 150.0);
    let again = run(HOPPER, paused.path(), &[7, 150, 151, 400]);
    assert_eq!(again.world.state_hash(), reference.world.state_hash());
    assert_eq!(again.world, reference.world);
    assert_eq!(again.totals.open_boundaries, reference.totals.open_boundaries);
    for name in ["measures/all.csv", "measures/rain.csv", "bodies.pvd"] {
        let read = |folder: &Path| std::fs::read_to_string(folder.join(name)).unwrap();
        assert_eq!(read(whole.path()), read(paused.path()), "{name}");
    }
}

/// Energies are relative to a cell that deforms, and so is the velocity with which a body enters it,
/// whenever.
#[test]
fn a_body_enters_a_deforming_cell_with_its_velocity_relative_to_it() {
    for start in ["0", "0.01"] {
        let text = format!(
            r#"
gravity = [0, 0, 0]
[time]
step = "1 ms"
steps = 50
[material.a]
[periodic]
min = [0, 0, 0]
max = [1, 1, 1]
rate = {{ xy = 0.5 }}
[stream.s]
radius = 0.05
velocity = [1, 0, 0]
count = 1
start = {start}
region = {{ box = {{ min = [0.1, 0.1, 0.7], max = [0.9, 0.9, 0.95] }} }}
[measure.e]
energy = true
exchange = true
"#
        );
        let folder = tempfile::tempdir().unwrap();
        run(&text, folder.path(), &[]);
        let read = table(folder.path(), "measures/e.csv");
        let [kinetic, entered] = ["kinetic", "entered_energy"].map(|column| *read(column).last().unwrap());
        assert!(entered > 0.2 && (kinetic - entered).abs() < 1e-12 * entered, "{start}: {kinetic} {entered}");
    }
}

#[test]
fn a_body_that_finds_no_place_waits_and_this_is_said() {
    let text = r#"
[time]
step = "5 ms"
end = "1 s"
[body.floor]
shape = { plane = {} }
[stream.fill]
radius = 0.05
count = 60
region = { box = { min = [-0.06, -0.06, 0], max = [0.06, 0.06, 0.6] } }
[measure.all]
exchange = true
"#;
    let folder = tempfile::tempdir().unwrap();
    let run = run(text, folder.path(), &[]);
    let state = run.totals.open_boundaries.streams[0];
    assert!(state.waits && !state.is_done && state.steps_waited > 50 && state.given.bodies >= 5, "{state:?}");
    assert_eq!(*table(folder.path(), "measures/all.csv")("streams_waiting").last().unwrap(), 1.0);
    let summary = std::fs::read_to_string(folder.path().join("summary.json")).unwrap();
    assert!(summary.contains("\"steps_waited\""), "{summary}");
    // Nobody entered another.
    assert!(
        run.totals.figures.penetration_max_over_radius < 0.02,
        "{}",
        run.totals.figures.penetration_max_over_radius
    );
}

/// Fill in a stage until all are there, settle until the height is steady, grow until a porosity.
#[test]
fn stages_end_when_filled_steady_or_dense() {
    let text = r#"
[time]
step = "2 ms"
end = "20 s"
[material.a]
friction = 0.5
[body.box]
parts = [
  { shape = { plane = {} } },
  { shape = { plane = { normal = [1, 0, 0] } }, position = [-0.1, 0, 0] },
  { shape = { plane = { normal = [-1, 0, 0] } }, position = [0.1, 0, 0] },
  { shape = { plane = { normal = [0, 1, 0] } }, position = [0, -0.1, 0] },
  { shape = { plane = { normal = [0, -1, 0] } }, position = [0, 0.1, 0] },
  { shape = { plane = { normal = [0, 0, -1] } }, position = [0, 0, 0.25] },
]
[stream.sand]
radius = { uniform = { min = 0.015, max = 0.025 } }
count = 80
stage = "fill"
region = { box = { min = [-0.1, -0.1, 0.1], max = [0.1, 0.1, 0.25] } }
[measure.bed]
motion = true
every = "20 ms"
[[stage]]
name = "fill"
filled = true
[[stage]]
name = "settle"
steady = { measure = "bed", column = "centre_z", over = "0.4 s", change = 1e-3 }
[[stage]]
name = "grow"
time = "10 s"
gravity = [0, 0, 0]
material = { a = { friction = 0 } }
growth = { rate = "0.3/s", porosity = 0.5, region = { box = { min = [-0.1, -0.1, 0], max = [0.1, 0.1, 0.25] } } }
[[stage]]
name = "after"
time = "10 ms"
"#;
    let folder = tempfile::tempdir().unwrap();
    let done = run(text, folder.path(), &[]);
    let ends: Vec<StageEnd> = done.totals.stages.iter().map(|stage| stage.end.unwrap()).collect();
    let expected = [StageEnd::Filled, StageEnd::Steady, StageEnd::Porosity, StageEnd::Time];
    assert_eq!(ends, expected, "{:?}", done.totals.stages);
    let growth = done.settings.stages[2].growth.clone().unwrap();
    let found = porosity(&done.world, &growth.region);
    // Some overlap counts twice.
    assert!((found - 0.5).abs() < 2e-3, "{found}");
    // By hand: all spheres are inside.
    let volume = |body: usize| done.world.geometries[done.world.bodies.geometry[body].index()].volume;
    let solid: f64 = (1..81).map(volume).sum();
    assert!((solid / (0.2 * 0.2 * 0.25) - 0.5).abs() < 2e-3, "{solid}");
    let mass: f64 = (1..81).map(|body| done.world.bodies.mass[body]).sum();
    assert!((mass / (1000.0 * solid) - 1.0).abs() < 1e-9);
    assert!((done.totals.open_boundaries.entered().mass / mass - 1.0).abs() < 1e-9);
    let elsewhere = tempfile::tempdir().unwrap();
    let grow = done.totals.stages[2].first_step;
    let again = run(text, elsewhere.path(), &[30, grow + 5, grow + 40]);
    assert_eq!(again.world, done.world);
}

#[test]
fn overlap_of_a_file_is_relaxed_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("soft.csv");
    let mut text = "x,y,z,radius\n".to_string();
    for k in 0..64 {
        // Every ball overlaps its neighbours by a fifth of its radius.
        let [x, y, z] = [k % 4, k / 4 % 4, k / 16].map(|i| 0.18 * f64::from(i));
        text += &format!("{x},{y},{},0.1\n", z + 0.09);
    }
    std::fs::write(&path, text).unwrap();
    let scene_text = |relax: bool| {
        format!(
            "[time]\nstep = 0.01\nsteps = 1\n[contact]\nrelax = {relax}\n[body.floor]\nshape = {{ plane = {{}} }}\n\
             [packing.p]\nvelocity = [1, 0, 0]\nfile = {{ path = {path:?} }}\n"
        )
    };
    let error = scene(&scene_text(false)).unwrap().build().unwrap_err().to_string();
    assert!(error.contains("overlap"), "{error}");
    let world = scene(&scene_text(true)).unwrap().build().unwrap().world;
    let deepest = graintrain::collide::deepest_overlap(&world).map_or(0.0, |overlap| overlap.depth);
    assert!(deepest <= 0.001, "{deepest}");
    assert!(world.bodies.velocity[1..].iter().all(|v| *v == graintrain::math::Vec3::X));
    let moved = (1..65).map(|body| world.bodies.position[body].length()).fold(0.0, f64::max);
    assert!(moved < 1.5, "{moved}");
}

#[test]
fn wrong_streams_are_refused_with_their_place() {
    let with = |body: &str| {
        let text = format!("[time]\nstep = 0.01\nsteps = 1\n{body}");
        scene(&text)
            .and_then(|scene| scene.build().map(|_| ()).map_err(|error| error.to_string()))
            .unwrap_err()
    };
    let region = "region = { box = { min = [0, 0, 0], max = [1, 1, 1] } }";
    let cases = [
        (format!("[stream.a]\nradius = 0.1\n{region}"), "nothing ends"),
        (format!("[stream.a]\nparts = []\nrate = 1\n{region}"), "at least one part"),
        (format!("[stream.a]\nradius = 0.1\nrate = 1\nmass_rate = 1\n{region}"), "mass_rate"),
        (format!("[stream.a]\nradius = 0.6\nrate = 1\n{region}"), "none would ever enter"),
        (format!("[stream.a]\nrate = 1\n{region}"), "radius"),
        (format!("[stream.a]\nradius = 0.1\nrate = \"1 kg\"\n{region}"), "rate"),
        (format!("[stream.a]\nradius = 0.1\nrate = 1\nstage = \"b\"\n{region}"), "stage"),
        (format!("[stream.a]\nradius = 0.1\nrate = 1\nstart = 2\nend = 1\n{region}"), "after start"),
        ("[outlet.a]\n".to_string(), "behind"),
        ("[[stage]]\nname = \"a\"\nfilled = true\n".to_string(), "there are none"),
        (
            format!(
                "[[stage]]\nname = \"a\"\nsteady = {{ measure = \"m\", column = \"q\", over = 1 }}\n[measure.m]\nmotion = true\n\
                 [stream.a]\nradius = 0.1\nrate = 1\n{region}"
            ),
            "has no column `q`",
        ),
    ];
    for (text, expected) in cases {
        let error = with(&text);
        assert!(error.contains(expected), "{text}\n{error}");
    }
    // A stream alone makes a scene: it begins empty.
    let empty = format!("[time]\nstep = 0.01\nsteps = 50\n[stream.a]\nradius = 0.1\nrate = 20\n{region}");
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(run(&empty, folder.path(), &[]).world.bodies.len(), 10);
}

/// Balls of sizes of their own that pass through leave no forms behind: as many as there are at a time.
#[test]
fn forms_of_those_who_left_are_used_again() {
    let text = r#"
[time]
step = "5 ms"
end = "2 s"
[stream.rain]
radius = { uniform = { min = 0.01, max = 0.03 } }
rate = "200/s"
velocity = [0, 0, "-2 m/s"]
region = { box = { min = [-0.4, -0.4, 0], max = [0.4, 0.4, 0.2] } }
[outlet.below]
behind = { point = [0, 0, -0.5] }
"#;
    let folder = tempfile::tempdir().unwrap();
    let run = run(text, folder.path(), &[]);
    let given = run.totals.open_boundaries.streams[0].given.bodies;
    let (forms, present) = (run.world.geometries.len(), run.world.bodies.len());
    assert!(given > 300 && present < 100 && forms < 100, "{given} {present} {forms}");
    // Every body has a form of its own, of its own mass.
    for body in 0..present {
        let volume = run.world.geometries[run.world.bodies.geometry[body].index()].volume;
        let mass = run.world.materials.density[run.world.bodies.material[body].index()] * volume;
        assert!((run.world.bodies.mass[body] / mass - 1.0).abs() < 1e-12, "{body}");
    }
}
