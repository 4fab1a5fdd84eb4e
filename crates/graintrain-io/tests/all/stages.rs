//! Stages: conditions, what changes between them, going on in the middle of one.

use crate::pauses::run_with_pauses;
use graintrain::math::Vec3;
use graintrain_io::output::summary::Summary;
use graintrain_io::run::Run;
use graintrain_io::scene::Scene;
use graintrain_io::stage::StageEnd;
use std::path::Path;

/// A box falls, comes to rest, is pushed by a load against friction, and then slides on a moving floor
/// without it.
const SCENE: &str = r#"
[time]
step = "1 ms"
end = "3 s"
[solver]
tolerance = 1e-8
friction = "coulomb"
[material.a]
density = 1000
friction = 0.5
[body.floor]
shape = { box = { size = [9, 9, 0.2] } }
position = [0, 0, -0.1]
motion = "fixed"
[body.block]
shape = { box = { size = [0.2, 0.2, 0.1] } }
position = [0, 0, 0.07]
[load.push]
bodies = ["block"]
force = ["30 N", 0, 0]
[[stage]]
name = "settle"
at_least = "20 ms"
kinetic_energy = "1e-6 J"
loads = []
[[stage]]
name = "push"
time = "0.2 s"
loads = ["push"]
[[stage]]
name = "rest"
at_least = "5 ms"
unbalanced_force = 1e-3
loads = []
[[stage]]
name = "slide"
time = "0.1 s"
gravity = [0, 0, "-1.62 m/s^2"]
material = { a = { friction = 0 } }
body.floor.motion = { translation = [{ direction = [0, 1, 0], speed = { sinusoidal = { amplitude = 1, period = "0.4 s" } } }] }
[measure.block]
motion = true
bodies = ["block"]
stage = "push"
"#;

fn scene(text: &str) -> Result<Scene, String> {
    Scene::parse("stages", "stages.toml", text, Path::new(""), &[]).map_err(|error| error.to_string())
}

/// Runs the scene in a folder, stopped and taken up again after these steps.
fn run(folder: &Path, pauses: &[u64]) -> Run {
    run_with_pauses(&scene(SCENE).unwrap(), folder, pauses)
}

#[test]
fn stages_follow_each_other_and_survive_interruptions() {
    let (whole, paused) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let reference = run(whole.path(), &[]);
    let stages = &reference.totals.stages;
    let ends: Vec<StageEnd> = stages.iter().map(|stage| stage.end.unwrap()).collect();
    assert_eq!(
        ends,
        [StageEnd::KineticEnergy, StageEnd::Time, StageEnd::UnbalancedForce, StageEnd::Time],
        "{stages:?}"
    );
    for pair in stages.windows(2) {
        assert_eq!(pair[0].last_step, Some(pair[1].first_step));
    }
    assert_eq!(stages[1].last_step.unwrap() - stages[1].first_step, 200);
    assert_eq!(reference.world.step, stages[3].first_step + 100);
    // Pushed for 0.2 s: a = F / m - mu g, and then it slides v^2 / (2 mu g).
    let text = std::fs::read_to_string(whole.path().join("measures/block.csv")).unwrap();
    let rows: Vec<Vec<f64>> = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
        .collect();
    assert_eq!(rows.len(), 200);
    let speed = rows[199][7];
    let expected = 0.2 * (30.0 / 4.0 - 0.5 * 9.81);
    assert!((speed - expected).abs() < 0.01 * expected, "{speed} {expected}");
    let way = reference.world.bodies.position[1].x - rows[199][4];
    assert!((way - speed * speed / (2.0 * 0.5 * 9.81)).abs() < 2e-3 * speed, "{way}");
    // The floor went under it from the beginning of its stage on: the mean of a quarter of a period.
    let floor = reference.world.bodies.position[0].y;
    let expected = 0.4 / std::f64::consts::TAU;
    assert!((floor - expected).abs() < 1e-9, "{floor}");
    assert!(reference.world.bodies.velocity[1].y.abs() < 1e-9);
    assert_eq!(reference.world.gravity, Vec3::new(0.0, 0.0, -1.62));

    // In the middle of stages, at their last steps, and after their first ones.
    let changes: Vec<u64> = stages.iter().map(|stage| stage.last_step.unwrap()).collect();
    let resumed =
        run(paused.path(), &[7, changes[0], changes[0] + 1, changes[1] - 1, changes[2], changes[2] + 50]);
    assert_eq!(resumed.world, reference.world);
    assert_eq!(resumed.world.state_hash(), reference.world.state_hash());
    assert_eq!(resumed.totals.stages, reference.totals.stages);
    let read = |folder: &Path, file: &str| std::fs::read_to_string(folder.join(file)).unwrap();
    assert_eq!(read(whole.path(), "measures/block.csv"), read(paused.path(), "measures/block.csv"));
    let summary: Summary = serde_json::from_str(&read(whole.path(), "summary.json")).unwrap();
    assert_eq!(summary.stages, reference.totals.stages);
    // The frame of the end is there although the run ended early.
    let last = format!("frames/bodies_{:08}.vtp", reference.world.step);
    assert!(whole.path().join(last).exists());
}

#[test]
fn resolved_stages_read_back() {
    let simulation = scene(SCENE).unwrap().build().unwrap();
    let text = simulation.resolved.to_toml().unwrap();
    let again = scene(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert_eq!(again.to_toml().unwrap(), text);
    assert_eq!(again.build().unwrap().stages, simulation.stages);
}

#[test]
fn stages_that_cannot_be_are_reported() {
    let base = "[time]\nstep = 0.01\nsteps = 3\n[body.floor]\nshape = { plane = {} }\n[body.ball]\nshape = { sphere = { radius = 0.1 } }\n\
                position = [0, 0, 1]\n";
    for (stages, expected) in [
        ("[[stage]]\ntime = 1", "name"),
        ("[[stage]]\nname = \"a\"\n[[stage]]\nname = \"b\"", "never begins"),
        ("[[stage]]\nname = \"a\"\ntime = 1\n[[stage]]\nname = \"a\"", "two stages"),
        ("[[stage]]\nname = \"a\"\nloads = [\"push\"]", "push"),
        ("[[stage]]\nname = \"a\"\nmaterial = { glas = { friction = 1 } }", "glas"),
        ("[[stage]]\nname = \"a\"\nbody = { bal = { motion = \"fixed\" } }", "bal"),
        ("[[stage]]\nname = \"a\"\nbody = { ball = {} }", "motion"),
        ("[[stage]]\nname = \"a\"\nbody = { floor = { motion = \"free\" } }", "no mass"),
        ("[[stage]]\nname = \"a\"\nkinetic_energy = 0", "positive"),
        ("[[stage]]\nname = \"a\"\ntime = \"1 kg\"", "kg"),
        ("[[stage]]\nname = \"a\"\n[measure.x]\nstress = true\nstage = \"b\"", "stage"),
    ] {
        let error = scene(&format!("{base}{stages}\n")).and_then(|s| s.build().map_err(|e| e.to_string()));
        let error = error.err().unwrap_or_else(|| panic!("{stages} is accepted"));
        assert!(error.contains(expected), "{stages}: {error}");
    }
}

/// Ends that can never come are refused when the scene is read.
#[test]
fn ends_that_never_come_are_refused() {
    let stream =
        "[stream.rain]\nradius = 0.1\nrate = 5\nregion = { box = { min = [0, 0, 1], max = [1, 1, 2] } }\n";
    let refused = |from: &str, to: &str, more: &str, part: &str| {
        let error = scene(&format!("{}{more}", SCENE.replace(from, to))).unwrap_err();
        assert!(error.contains(part), "{error}");
    };
    refused("kinetic_energy = \"1e-6 J\"", "time = \"10 ms\"", "", "at least 0.02 s");
    refused("kinetic_energy = \"1e-6 J\"", "filled = true", stream, "`rain` never ends");
    let elsewhere = format!("{stream}count = 3\nstage = \"rest\"\n");
    refused("kinetic_energy = \"1e-6 J\"", "filled = true", &elsewhere, "no stream flows in it");
    let steady = "steady = { measure = \"block\", column = \"mass\", over = \"10 ms\" }";
    refused("kinetic_energy = \"1e-6 J\"", steady, "", "in the stage `push` alone");
    assert!(
        scene(&format!(
            "{}{stream}count = 3\n",
            SCENE.replace("kinetic_energy = \"1e-6 J\"", "filled = true")
        ))
        .is_ok()
    );
}
