//! Periodic cells in scenes: keys, stages, measures, checkpoints.

use graintrain::cell::Drive;
use graintrain::motion::Profile;
use graintrain_io::checkpoint;
use graintrain_io::run::{Ending, Run, RunSettings, RunTotals};
use graintrain_io::scene::Scene;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Balls that are compressed, then sheared under a pressure.
const SCENE: &str = r#"
gravity = [0, 0, 0]
[time]
step = "1 ms"
end = "0.3 s"
[periodic]
min = [0, 0, 0]
max = [1, 1, 1]
rate = { xx = "-0.5/s", yy = "-0.5/s", zz = "-0.5/s" }
[material.glass]
density = 2500
friction = 0
[packing.grains]
radius = 0.09
lattice = { counts = [4, 4, 4], pitch = 0.25, jitter = 0.02 }
[[stage]]
name = "gather"
time = "0.1 s"
[[stage]]
name = "press"
time = "0.2 s"
periodic = { stress = { xx = "1 kPa", yy = "1 kPa", zz = "1 kPa" }, rate = { xy = "0.4/s" }, fastest = "1/s" }
[measure.sample]
stress = true
porosity = true
cell = true
every = "50 ms"
"#;

fn scene(text: &str) -> Result<Scene, String> {
    Scene::parse("cell", "cell.toml", text, Path::new(""), &[]).map_err(|error| error.to_string())
}

/// The run of a scene to its end.
fn finished(scene: &Scene) -> Run {
    let simulation = scene.build().unwrap();
    let settings = RunSettings::new(&simulation, None);
    let stop = Arc::new(AtomicBool::new(false));
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), stop).unwrap();
    assert_eq!(run.advance(&mut []).unwrap(), Ending::Finished);
    run
}

/// Rates, then stresses with a rate: the cell closes as the rate says, then under the pressure, and shears;
/// the records hold what the cell is.
#[test]
fn stages_drive_the_cell() {
    let scene = scene(SCENE).unwrap();
    let run = finished(&scene);
    let cell = run.world.cell().unwrap();
    assert!((cell.strain[3] - 0.4 * 0.2).abs() < 1e-12, "{:?}", cell.strain);
    // Of the edge that the last step of 1 ms began with.
    let on_the_way = cell.rate[0] / (1.0 - 1e-3 * cell.rate[0]);
    assert!(cell.strain[0] < -0.05 && on_the_way >= -1.0 - 1e-9, "{cell:?}");
    assert!(matches!(&cell.drive[4], Drive::Rate(Profile::Constant(rate)) if *rate == 0.0));
    // What was resolved is a scene again.
    let written = scene.to_toml().unwrap();
    let again = Scene::parse("cell", "cell.toml", &written, Path::new(""), &[]).unwrap();
    assert_eq!(finished(&again).world.state_hash(), run.world.state_hash());
}

/// A run that goes on from a checkpoint has the same bits.
#[test]
fn checkpoints_hold_the_cell() {
    let whole = finished(&scene(SCENE).unwrap());
    let part = finished(&scene(&SCENE.replace("0.3 s", "0.157 s")).unwrap());
    let bytes = checkpoint::to_bytes(&part.settings, &part.totals, &part.world).unwrap();
    let mut back = checkpoint::from_bytes(&bytes, "cell").unwrap();
    back.settings.steps = 300;
    let stop = Arc::new(AtomicBool::new(false));
    let mut rest = Run::new(back.world, back.settings, back.totals, stop).unwrap();
    assert_eq!(rest.advance(&mut []).unwrap(), Ending::Finished);
    assert_eq!(rest.world.state_hash(), whole.world.state_hash());
}

#[test]
fn what_makes_no_sense_is_refused() {
    let refused = |from: &str, to: &str, part: &str| {
        let text = SCENE.replace(from, to);
        assert!(text != SCENE, "{from}");
        let error = scene(&text).and_then(|scene| scene.build().map_err(|error| error.to_string()));
        let error = error.map(|_| ()).unwrap_err();
        assert!(error.contains(part), "{error}");
    };
    refused("max = [1, 1, 1]", "max = [1, 0, 1]", "above `min`");
    refused("max = [1, 1, 1]", "max = [1, 1, 1]\naxes = [\"w\"]", "axis");
    refused("max = [1, 1, 1]", "max = [1, 1, 1]\naxes = []", "at least one axis");
    refused("max = [1, 1, 1]", "max = [1, 1, 1]\naxes = [\"x\"]", "does not repeat");
    refused("max = [1, 1, 1]", "max = [1, 1, 1]\npressure = 3", "a rate and a stress");
    refused("xy = \"0.4/s\"", "zz = \"0.4/s\"", "a rate and a stress");
    refused("max = [1, 1, 1]", "max = [1, 1, 0.35]", "less than half");
    refused("rate = { xx = \"-0.5/s\"", "rate = { xx = \"3 m\"", "rate");
    refused("fastest = \"1/s\"", "fastest = 0", "positive");
    refused("max = [1, 1, 1]", "max = [1, 1, 1]\nfastest = 1", "none is imposed");
    refused("max = [1, 1, 1]", "max = [1, 1, 1]\naxes = [\"x\", \"y\", \"z\", \"x\"]", "every axis once");
    refused("xx = \"-0.5/s\"", "xx = \"-1000/s\"", "rate xx");
    refused("xy = \"0.4/s\"", "xy = \"3000/s\"", "rate xy");
    refused(
        "[measure",
        "[stream.rain]\nradius = 0.3\nregion = { box = { min = [0, 0, 0], max = [1, 1, 1] } }\nrate = 10\n[measure",
        "stream `rain`",
    );
    refused("[measure", "[body.floor]\nshape = { plane = {} }\nmotion = \"fixed\"\n[measure", "across z");
    let no_cell: String = SCENE
        .lines()
        .filter(|line| {
            !line.starts_with("rate")
                && !line.starts_with("[periodic]")
                && !line.starts_with("min")
                && !line.starts_with("max")
        })
        .map(|line| format!("{line}\n"))
        .collect();
    assert!(scene(&no_cell).unwrap_err().contains("add `[periodic]`"));
}

/// What a stage drives, or fixes, is held against the cell when the scene is built, at the place where it is
/// written.
#[test]
fn stages_that_the_cell_cannot_follow_are_refused() {
    let refused = |text: &str, part: &str, line: usize| {
        let error = scene(text).unwrap().build().map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(part) && error.contains(&format!("cell.toml:{line}")), "{error}");
    };
    let line = |text: &str, name: &str| text.lines().position(|own| own.contains(name)).unwrap_or_default();
    let layer = SCENE.replace(
        "max = [1, 1, 1]\nrate = { xx = \"-0.5/s\", yy = \"-0.5/s\", zz = \"-0.5/s\" }",
        "max = [1, 1, 1]\naxes = [\"x\", \"y\"]",
    );
    let pressed = layer.replace("rate = { xy = \"0.4/s\" }, ", "");
    refused(&pressed, "a stress can be imposed only where it repeats", line(&pressed, "\"press\""));
    let stone =
        "[body.stone]\nshape = { sphere = { radius = 0.05 } }\nposition = [0.5, 0.5, 0.5]\n[packing.grains]";
    let with_stone = SCENE.replace("[packing.grains]", stone).replace("radius = 0.09", "radius = 0.05");
    scene(&with_stone).unwrap().build().unwrap();
    let fixes = |place: &str| {
        with_stone.replace(place, &format!("{place}\nbody = {{ stone = {{ motion = \"fixed\" }} }}"))
    };
    let text = fixes("time = \"0.1 s\"");
    refused(&text, "'stone' (index 0) is fixed or driven", line(&text, "\"gather\""));
    let text = fixes("time = \"0.2 s\"");
    refused(&text, "'stone' (index 0) is fixed or driven", line(&text, "\"press\""));
}

/// A body may be fixed once the cell is held, and every checkpoint before and after is sound.
#[test]
fn bodies_are_fixed_in_a_cell_that_is_held_again() {
    let stages = "periodic = {}\n[[stage]]\nname = \"fix\"\ntime = \"0.1 s\"\nbody = { stone = { motion = \"fixed\" } }\n";
    let (head, rest) = SCENE.split_once("periodic = { stress").unwrap();
    let tail = rest.split_once('\n').unwrap().1;
    let text = format!("{head}{stages}{tail}").replace(
        "[packing.grains]",
        "[body.stone]\nshape = { sphere = { radius = 0.02 } }\nposition = [0.5, 0.5, 0.5]\n[packing.grains]",
    );
    for end in [50, 100, 101, 250, 300, 301, 350] {
        let part = finished(&scene(&text.replace("0.3 s", &format!("{end} ms"))).unwrap());
        assert_eq!(part.world.step, end);
        let bytes = checkpoint::to_bytes(&part.settings, &part.totals, &part.world).unwrap();
        checkpoint::from_bytes(&bytes, "cell").unwrap();
    }
}

/// Bodies that grow end the run where the cell has no more room for them, in a state that a run can go on
/// from.
#[test]
fn growth_ends_at_half_an_edge() {
    let text = "gravity = [0, 0, 0]\n[time]\nstep = \"1 ms\"\nend = \"1 s\"\n[periodic]\nmin = [0, 0, 0]\nmax = [1, 1, 1]\n\
                [packing.grains]\nradius = 0.1\nlattice = { counts = [1, 1, 1], pitch = 0.25 }\n\
                [[stage]]\nname = \"grow\"\ntime = \"1 s\"\ngrowth = { rate = 5, porosity = 0.3, region = { box = { min = [0, 0, 0], max = [1, 1, 1] } } }\n";
    let simulation = scene(text).unwrap().build().unwrap();
    let settings = RunSettings::new(&simulation, None);
    let stop = Arc::new(AtomicBool::new(false));
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), stop).unwrap();
    let error = run.advance(&mut []).unwrap_err().to_string();
    assert!(error.contains("less than half") && run.world.step > 100, "{error}");
    let bytes = checkpoint::to_bytes(&run.settings, &run.totals, &run.world).unwrap();
    checkpoint::from_bytes(&bytes, "cell").unwrap();
}
