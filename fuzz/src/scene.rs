//! Scenes: the text is read, written out resolved, read again; what is small is built, and what is smaller
//! makes a step.

use crate::checkpoint::step;
use graintrain::measure::space::volume;
use graintrain_io::mark::Marks;
use graintrain_io::run::{RunSettings, RunTotals};
use graintrain_io::scene::model::PackingSource;
use graintrain_io::scene::schema::SCENE;
use graintrain_io::scene::{Scene, SceneError, builtin};
use std::path::Path;

/// Scenes with more bodies are not built.
const MOST_BUILT: f64 = 2000.0;
/// Worlds with more bodies make no step.
const MOST_STEPPED: usize = 60;

/// Reads a scene and, where it is small, builds it and makes a step.
pub fn run(input: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(input) else { return false };
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    for (name, content) in FILES {
        std::fs::write(folder.path().join(name), content).expect("temporary files can be written");
    }
    let parse = |text: &str| Scene::parse("a", "a.toml", text, folder.path(), &[]);
    let Ok(scene) = parse(text).inspect_err(explain) else { return false };
    written(&scene, parse);
    if bodies(&scene) <= MOST_BUILT
        && let Ok(simulation) = scene.build().inspect_err(explain)
    {
        simulation.world.state_hash();
        written(&simulation.resolved, parse);
        let settings = RunSettings::new(&simulation, None);
        if simulation.world.bodies.len() <= MOST_STEPPED {
            step(simulation.world, settings, RunTotals::default(), &Marks::new());
        }
    }
    true
}

/// What a scene is written out as is read as the same scene.
fn written(scene: &Scene, parse: impl Fn(&str) -> Result<Scene, SceneError>) {
    let Ok(text) = scene.to_toml() else { return };
    match parse(&text) {
        Err(error) => panic!("a resolved scene is refused: {error}\n{text}"),
        Ok(again) => {
            let own = |text: &str| {
                text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n")
            };
            assert_eq!(
                again.to_toml().map(|text| own(&text)).ok(),
                Some(own(&text)),
                "read again it is another"
            );
        }
    }
}

/// Puts an error into words, as for people.
fn explain(error: &SceneError) {
    assert!(!error.to_string().is_empty());
    let _ = (error.help(), error.location.as_ref().map(|location| location.line_column()));
}

/// How many bodies its packings ask for; those in files are few.
fn bodies(scene: &Scene) -> f64 {
    let count = |source: &PackingSource| match source {
        PackingSource::Lattice(lattice) => lattice.counts.iter().map(|&n| n as f64).product(),
        PackingSource::Drop(drop) => drop.count as f64,
        PackingSource::Poisson(poisson) => volume(&poisson.region) / poisson.distance.powi(3),
        PackingSource::File(_) => 0.0,
    };
    scene.packings.iter().map(|(_, packing)| count(&packing.source)).sum()
}

/// The files that the seeds name.
const FILES: &[(&str, &str)] = &[
    ("kleinert_particles2048pile.vtu", include_str!("../seeds/ascii.vtu")),
    ("dosta_penetration_25k.txt", "Radius[mm] PosX[m] PosY[m] PosZ[m]\n2 0 0 0\n2 0.01 0 0\n10 0 0 0.06\n"),
    ("wheel.stl", include_str!("../seeds/wheel.stl")),
    ("stress.csv", "t[ms],p[kPa]\n0,0\n50,10\n400,10\n"),
];

/// Parameters that make built-in scenes small.
const SMALL: &[(&str, &str)] = &[
    ("\nn = 8 ", "\nn = 1 "),
    ("\nn = 19 ", "\nn = 2 "),
    ("\nalong = 22", "\nalong = 3"),
    ("\nacross = 8", "\nacross = 2"),
    ("\nhigh = 16", "\nhigh = 2"),
    ("\nrows = 16 ", "\nrows = 3 "),
    ("\nlayers = 5\n", "\nlayers = 1\n"),
    ("counts = [50, 10, 10]", "counts = [3, 2, 2]"),
];

/// Scenes that have what the built-in ones lack.
const OWN: &[&str] = &[
    include_str!("../seeds/joints.toml"),
    include_str!("../seeds/loads.toml"),
    include_str!("../seeds/materials.toml"),
    include_str!("../seeds/shapes.toml"),
    include_str!("../seeds/cell.toml"),
    include_str!("../seeds/stages.toml"),
];

/// The texts of small scenes.
pub(crate) fn texts() -> Vec<String> {
    let small = |text: &str| SMALL.iter().fold(text.to_string(), |text, (from, to)| text.replace(from, to));
    let builtin = builtin::SCENES.iter().map(|scene| small(scene.text));
    builtin.chain(OWN.iter().map(|text| text.to_string())).collect()
}

/// Small scenes.
pub fn seeds() -> Vec<Vec<u8>> {
    texts().into_iter().map(String::into_bytes).collect()
}

/// Every key with its example.
pub fn words() -> Vec<Vec<u8>> {
    let keys = SCENE.all().into_iter().flat_map(|table| table.keys);
    keys.map(|key| format!("{} = {}", key.name, key.example).into_bytes()).collect()
}

/// Builds a scene whose files are those of the seeds.
///
/// # Panics
/// Where it cannot be built.
pub(crate) fn simulation(text: &str) -> graintrain_io::scene::Simulation {
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    for (name, content) in FILES {
        std::fs::write(folder.path().join(name), content).expect("temporary files can be written");
    }
    let scene = Scene::parse("a", "a.toml", text, Path::new(folder.path()), &[]);
    scene.and_then(|scene| scene.build()).expect("seeds can be built")
}
