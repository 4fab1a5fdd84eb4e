//! Runs that are killed at random moments and taken up again: all that they leave is that of a run that was
//! never killed.
#![cfg(unix)]

use crate::runs::{ended, graintrain, read};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Streams, outlets and stages that end by what is measured.
const HOPPER: &str = include_str!("../failing/killed_hopper.toml");

/// A periodic cell that is gathered, pressed and sheared, with measurements, one of which remembers.
const CELL: &str = r#"
seed = 3
gravity = [0, 0, 0]
[time]
step = "1 ms"
end = "0.5 s"
[output]
every = "10 ms"
checkpoint_every = "20 ms"
[periodic]
min = [0, 0, 0]
max = [1, 1, 1]
rate = { xx = "-0.5/s", yy = "-0.5/s", zz = "-0.5/s" }
[material.glass]
density = 2500
friction = 0.3
restitution = 0.5
[packing.grains]
radius = 0.1
lattice = { counts = [4, 4, 4], pitch = 0.25, jitter = 0.02 }
[[stage]]
name = "gather"
time = "0.1 s"
[[stage]]
name = "press"
time = "0.2 s"
periodic = { stress = { xx = "1 kPa", yy = "1 kPa", zz = "1 kPa" }, rate = { xy = "0.4/s" }, fastest = "1/s" }
[[stage]]
name = "shear"
time = "0.2 s"
periodic = { stress = { zz = "1 kPa" }, rate = { xz = "0.4/s" }, fastest = "1/s" }
[measure.sample]
stress = true
porosity = true
cell = true
fabric = true
every = "5 ms"
[measure.hist]
histogram = { bins = 10, most = 5 }
start = "0.15 s"
every = "25 ms"
"#;

/// Joints with a motor, a spring and stops, an interior point with its table, exact friction, growth and
/// frames of double precision.
const JOINTS: &str = r#"
seed = 5
[time]
step = "2 ms"
end = "0.8 s"
[solver]
name = "pdip+cholesky"
friction = "coulomb"
[output]
every = "20 ms"
checkpoint_every = "14 ms"
precision = "double"
[material.grain]
density = 1500
friction = 0.4
[body.box]
motion = "fixed"
parts = [
    { shape = { plane = { normal = [0, 0, 1] } }, position = [0, 0, 0] },
    { shape = { plane = { normal = [1, 0, 0] } }, position = [-0.3, 0, 0] },
    { shape = { plane = { normal = [-1, 0, 0] } }, position = [0.3, 0, 0] },
    { shape = { plane = { normal = [0, 1, 0] } }, position = [0, -0.3, 0] },
    { shape = { plane = { normal = [0, -1, 0] } }, position = [0, 0.3, 0] },
]
[packing.grains]
radius = { uniform = { min = 0.03, max = 0.04 } }
lattice = { counts = [5, 5, 2], pitch = 0.1, jitter = 0.005, origin = [-0.25, -0.25, 0] }
[body.arm]
shape = { box = { size = [0.4, 0.04, 0.04] } }
position = [0, 0, 0.5]
[body.blade]
shape = { box = { size = [0.04, 0.2, 0.3] } }
position = [0.2, 0, 0.35]
[joint.turn]
kind = "revolute"
bodies = ["arm"]
point = [0, 0, 0.5]
axis = [0, 0, 1]
motor = { speed = "2 rad/s * sin(2*pi*t/0.5 s)", torque = "200 N m" }
angles = { lower = "-30 deg", upper = "45 deg" }
[joint.wrist]
kind = "revolute"
bodies = ["arm", "blade"]
point = [0.2, 0, 0.5]
axis = [0, 1, 0]
torsion_spring = { stiffness = "3 N m/rad", damping = "0.1 N m s/rad", rest = "5 deg" }
[[stage]]
name = "fill"
time = "0.2 s"
[[stage]]
name = "grow"
growth = { packings = ["grains"], porosity = 0.5, rate = "0.2/s", region = { box = { min = [-0.3, -0.3, 0], max = [0.3, 0.3, 0.15] } } }
time = "0.2 s"
[[stage]]
name = "stir"
[measure.blade]
force = { bodies = ["blade"], point = [0, 0, 0.5] }
energy = true
[measure.bed]
packings = ["grains"]
motion = true
coordination = true
every = "6 ms"
"#;

/// The files of a run by name, without what clocks say: tables by column, the summary by key.
fn files(folder: &Path) -> BTreeMap<String, String> {
    let mut files = BTreeMap::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inner) = folders.pop() {
        for entry in std::fs::read_dir(folder.join(&inner)).unwrap() {
            let entry = entry.unwrap();
            let name = inner.join(entry.file_name());
            if entry.path().is_dir() {
                folders.push(name);
                continue;
            }
            let shown = name.display().to_string();
            let text = match name.extension().and_then(|extension| extension.to_str()) {
                Some("csv") => without_seconds(&read(&entry.path())),
                Some("json") if shown == "summary.json" => counted(&read(&entry.path())),
                // Which checkpoints are left depends on where it was killed.
                Some("ckpt") => continue,
                _ => read(&entry.path()),
            };
            files.insert(shown, text);
        }
    }
    files
}

fn without_seconds(table: &str) -> String {
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let kept: Vec<usize> = (0..header.len()).filter(|&k| !header[k].contains("seconds")).collect();
    let record = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        kept.iter().map(|&k| fields[k]).collect::<Vec<_>>().join(",") + "\n"
    };
    table.lines().map(record).collect()
}

fn counted(summary: &str) -> String {
    let mut summary: serde_json::Value = serde_json::from_str(summary).unwrap();
    let all = summary.as_object_mut().unwrap();
    // Threads are those of whoever ended it: runs are taken up with other numbers of them.
    for key in ["wall_seconds", "cpu_seconds", "phases", "peak_memory_bytes", "threads"] {
        assert!(all.remove(key).is_some(), "{key}");
    }
    serde_json::to_string_pretty(&summary).unwrap()
}

/// Evenly spread numbers in [0, 1).
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Starts a command, lets it go on for a while and ends it: by a kill, which leaves things as they are, or by
/// a signal that lets it put them in order.
fn interrupted(mut command: Command, after: Duration, by: &str) {
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    std::thread::sleep(after);
    // It may be over by now.
    let pid = child.id().to_string();
    let _ = Command::new("kill").args([&format!("-{by}"), &pid]).stderr(Stdio::null()).status();
    let output = child.wait_with_output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!err.contains("panicked") && !err.contains("damaged") && !err.contains("missing"), "{err}");
}

/// 21 interruptions of three runs, at moments of which `GRAINTRAIN_KILLS_SEED` draws others.
#[test]
#[ignore = "slow: three runs of some seconds, each several times"]
fn killed_runs_leave_what_unbroken_ones_do() {
    let seed = std::env::var("GRAINTRAIN_KILLS_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(1);
    let mut draw = Draw(seed);
    for (name, scene) in [("hopper", HOPPER), ("cell", CELL), ("joints", JOINTS)] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
        let run = |out: &str| {
            graintrain(folder.path(), &["run", "scene.toml", "--out", out, "--threads", "2", "--quiet"])
        };
        let start = Instant::now();
        ended(run("whole"), 0);
        let time = start.elapsed();
        let whole = files(&folder.path().join("whole"));
        let out = folder.path().join("killed");
        let mut moments = Vec::new();
        for number in 0..7 {
            let begun = out.join("summary.json").exists();
            let command = if begun {
                graintrain(folder.path(), &["resume", "killed", "--threads", "1", "--quiet"])
            } else {
                run("killed")
            };
            // One while things are begun, the others within a part of the run; checkpoints and frames are
            // written in between.
            let after = time.mul_f64(if number == 0 { 0.02 } else { 0.3 } * draw.next());
            let by = ["KILL", "KILL", "TERM"][number % 3];
            interrupted(command, after, by);
            moments.push((after, by));
        }
        let last = if out.join("summary.json").exists() {
            graintrain(folder.path(), &["resume", "killed", "--threads", "2", "--quiet"])
        } else {
            run("killed")
        };
        let (_, err) = ended(last, 0);
        assert_eq!(err, "", "{name}, {moments:?}");
        let killed = files(&out);
        let names = |files: &BTreeMap<String, String>| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(names(&killed), names(&whole), "{name}, {moments:?}");
        for (file, text) in &whole {
            assert!(
                killed[file] == *text,
                "{name}: {file} differs after {moments:?}\n{text}\n---\n{}",
                killed[file]
            );
        }
        println!("{name}: {} files as in a run of {time:.1?} after {moments:.2?}", whole.len());
    }
}
