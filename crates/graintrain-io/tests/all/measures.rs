//! Measurements as a scene asks for them: tables, resumption, errors, and the same numbers from the frames by
//! a script that knows nothing of this program.

use graintrain_io::checkpoint;
use graintrain_io::output::folder::RunFolder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use graintrain_io::scene::Scene;
use std::path::Path;
use std::process::Command;

const SCENE: &str = include_str!("measures.toml");

fn scene(text: &str) -> Result<Scene, String> {
    Scene::parse("heap", "heap.toml", text, Path::new(""), &[]).map_err(|error| error.to_string())
}

/// Runs the scene in a folder, with a pause after so many steps (0: none).
fn run(folder: &Path, pause: u64) {
    let simulation = scene(SCENE).unwrap().build().unwrap();
    let mut settings = RunSettings::new(&simulation, None);
    let steps = settings.steps;
    if pause > 0 {
        settings.steps = pause;
    }
    let text = simulation.resolved.to_toml().unwrap();
    let taken = RunFolder::create(folder, false).unwrap();
    let mut recorder = Recorder::begin(taken, &settings, &simulation.world, &text).unwrap();
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Default::default()).unwrap();
    run.advance(&mut [&mut recorder]).unwrap();
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    drop((run, recorder));
    if pause > 0 {
        let (mut saved, _) = checkpoint::latest(&folder.join("checkpoints")).unwrap();
        saved.settings.steps = steps;
        let taken = RunFolder::open(folder).unwrap();
        let mut recorder = Recorder::resume(taken, &saved.settings, &saved.world, &saved.marks).unwrap();
        assert!(recorder.losses().is_empty());
        let mut run = Run::new(saved.world, saved.settings, saved.totals, Default::default()).unwrap();
        run.advance(&mut [&mut recorder]).unwrap();
        recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    }
}

fn table(folder: &Path, name: &str) -> Vec<Vec<String>> {
    let path = folder.join("measures").join(format!("{name}.csv"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    text.lines().map(|line| line.split(',').map(str::to_string).collect()).collect()
}

fn column(table: &[Vec<String>], name: &str) -> Vec<f64> {
    let index = table[0].iter().position(|column| column == name).unwrap_or_else(|| panic!("{name}"));
    table[1..].iter().map(|row| row[index].parse().unwrap_or(f64::NAN)).collect()
}

#[test]
fn tables_hold_what_the_scene_asks_for() {
    let (whole, paused) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    run(whole.path(), 0);
    // Between two records of every table, and between two checkpoints.
    run(paused.path(), 73);
    let names = ["whole", "core", "floor", "gate", "layers", "rings", "chains"];
    for name in names {
        assert_eq!(table(whole.path(), name), table(paused.path(), name), "{name}");
    }

    let all = table(whole.path(), "whole");
    assert_eq!(all.len(), 1 + 40);
    // The heap weighs what its balls weigh, and nothing is lost in the ledger.
    let ball = |radius: f64| 2500.0 * 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let mass = 108.0 * (ball(0.05) + ball(0.04));
    let weighed = column(&all, "mass");
    assert!(weighed.iter().all(|m| (m - mass).abs() < 1e-9 * mass));
    let last = |name: &str| *column(&all, name).last().unwrap();
    let work = last("work_gravity");
    assert!(work > 0.0 && last("ledger_rest").abs() < 1e-9 * work);
    let kept = work + last("work_drives") - last("lost_friction") - last("lost_normal");
    assert!((kept - last("kinetic")).abs() < 1e-9 * work, "{kept} {}", last("kinetic"));
    // What falls without friction from the side comes to the floor.
    let floor = table(whole.path(), "floor");
    assert_eq!(floor.len(), 1 + 200);
    let force = column(&floor, "force_z");
    let mean = force[150..].iter().sum::<f64>() / 50.0;
    assert!((mean / (-9.81 * mass) - 1.0).abs() < 0.2, "{mean} {}", -9.81 * mass);
    // Through the gate passed what was above and is now below: counted from the frames' places by the script,
    // here by sign.
    let gate = table(whole.path(), "gate");
    let passed = column(&gate, "passed_bodies");
    assert!(passed[0] == 0.0 && *passed.last().unwrap() > 20.0 && passed.iter().all(|n| n.fract() == 0.0));
    let flow = column(&gate, "mass_flow");
    let total: f64 = flow[1..].iter().sum::<f64>() * 0.002;
    let masses = column(&gate, "passed_mass");
    assert!(flow[0].is_nan() && (total - masses.last().unwrap() + masses[0]).abs() < 1e-9 * mass);
    let index = column(&gate, "lacey");
    assert!(index.iter().all(|m| *m < 0.9) && index[0] < 0.3, "{}", index[0]);
    // Eight bins, four times.
    assert_eq!(table(whole.path(), "layers").len(), 1 + 8 * 4);
    assert_eq!(table(whole.path(), "rings").len(), 1 + 4 * 4);
    assert_eq!(table(whole.path(), "chains").len(), 1 + 10 * 4);

    let text = std::fs::read_to_string(whole.path().join("columns.json")).unwrap();
    let columns: serde_json::Value = serde_json::from_str(&text).unwrap();
    for name in names {
        let described = columns[format!("measures/{name}.csv")].as_array().unwrap();
        let named: Vec<&str> = described.iter().map(|column| column["name"].as_str().unwrap()).collect();
        assert_eq!(named, table(whole.path(), name)[0], "{name}");
        assert!(described.iter().all(|column| !column["meaning"].as_str().unwrap().is_empty()));
    }

    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/check_measures.py");
    let python = Command::new("python3").args(["-c", "import tomllib"]).output();
    if !script.exists() || !python.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: the script needs Python 3.11");
        return;
    }
    let output = Command::new("python3").arg(script).arg(whole.path()).output().unwrap();
    let reported = String::from_utf8_lossy(&output.stdout).to_string();
    assert!(output.status.success(), "{reported}{}", String::from_utf8_lossy(&output.stderr));
    let compared: u32 = reported.split_whitespace().next().unwrap().parse().unwrap();
    assert!(compared > 400, "{reported}");
}

/// What `scene.toml` of a run says is the same measurements again.
#[test]
fn resolved_measures_read_back() {
    let resolved = scene(SCENE).unwrap().build().unwrap().resolved;
    let text = resolved.to_toml().unwrap();
    let again = scene(&text).unwrap();
    assert_eq!(again.build().unwrap().measures, resolved.build().unwrap().measures);
    assert_eq!(again.to_toml().unwrap(), text);
}

#[test]
fn what_cannot_be_measured_is_said() {
    let base = "[time]\nstep = 0.01\nsteps = 3\n[body.floor]\nshape = { plane = {} }\n[packing.a]\nradius = 0.1\n\
                lattice = { counts = [2, 2, 2], pitch = 0.3 , origin = [0, 0, 1] }\n";
    for (measure, expected) in [
        ("[measure.x]", "stress"),
        ("[measure.x]\nstress = false", "none"),
        ("[measure.x]\nstrain = true", "strain"),
        ("[measure.x]\nstress = true\nprofile = { from = 0, to = 1, bins = 3 }", "of its own"),
        ("[measure.x]\nprofile = { from = 1, to = 1, bins = 3 }", "above from"),
        ("[measure.x]\nprofile = { from = 0, to = 1 }", "bins"),
        ("[measure.x]\nprofile = { from = 0, to = 1, bins = 0 }", "from 1 to"),
        ("[measure.x]\nforce = { bodies = [\"flor\"] }", "flor"),
        ("[measure.x]\nforce = {}", "bodies"),
        ("[measure.x]\nmixing = { packings = [\"b\"], cell = 1 }", "packing"),
        ("[measure.x]\nshear_box = { sheared = \"floor\", pressing = \"a\", area = 1 }", "body"),
        ("[measure.x]\nwheel = { body = \"tyre\", radius = 1 }", "tyre"),
        ("[measure.x]\nwheel = { body = \"floor\" }", "radius"),
        ("[measure.x]\nstress = true\nevery = \"5 kg\"", "kg"),
        ("[measure.\"a/b\"]\nstress = true", "file"),
        ("[measure.x]\nplane = { normal = [0, 0, 0] }", "normal"),
        ("[measure.x]\nporosity = true\nregion = { box = { min = [0, 0, 0], max = [0, 1, 1] } }", "min"),
        (
            "[measure.x]\nregion = { cylinder = { radius = 1, height = 1 } }\nprofile = { along = \"x\", from = 0, to = 1, bins = 2 }",
            "volume",
        ),
    ] {
        let error = scene(&format!("{base}{measure}\n")).and_then(|s| s.build().map_err(|e| e.to_string()));
        let error = error.err().unwrap_or_else(|| panic!("{measure} is accepted"));
        assert!(error.contains(expected), "{measure}: {error}");
    }
}

/// With nothing to measure the numbers are empty cells, not an end.
#[test]
fn a_region_without_bodies_makes_empty_cells() {
    let text = "[time]\nstep = 0.01\nsteps = 2\n[body.ball]\nshape = { sphere = { radius = 0.1 } }\n[measure.x]\nregion = { box = { min = [5, 5, 5], \
                max = [6, 6, 6] } }\nstress = true\ncoordination = true\nfabric = true\nforces = true\nmotion = true\nporosity = true\n\
                mixing = { packings = [\"a\"], cell = 1 }\nrepose = { width = 1 }\n[packing.a]\nradius = 0.1\nlattice = { counts = [1, 1, 1], pitch = 1, origin = [3, 0, 0] }\n";
    let simulation = scene(text).unwrap().build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let settings = RunSettings::new(&simulation, None);
    let taken = RunFolder::create(folder.path(), false).unwrap();
    let mut recorder = Recorder::begin(taken, &settings, &simulation.world, "").unwrap();
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Default::default()).unwrap();
    run.advance(&mut [&mut recorder]).unwrap();
    let table = table(folder.path(), "x");
    assert_eq!(table.len(), 3);
    assert_eq!(column(&table, "porosity"), [1.0, 1.0]);
    assert!(column(&table, "centre_x")[0].is_nan() && column(&table, "lacey")[0].is_nan());
}
