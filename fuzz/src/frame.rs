//! The folder of a run, read back for replays and exports: the lists of frames, the frames, the last
//! checkpoint.
//!
//! An input is a bundle of files of a run, by their names behind the number of the run, as in
//! `--- 1/frames/bodies_00000002.vtp`; the other files are as they were.

use crate::{bundle, scene};
use graintrain_io::output::folder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Run, RunSettings, RunTotals};
use graintrain_view::view::RunFolder;
use graintrain_view::view::vtp_file::VtpFile;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The files of a run by their names.
type Files = BTreeMap<String, Vec<u8>>;

/// Scenes that are run: bodies of several forms, with joints, that come and go, in a cell.
const SCENES: &[&str] = &[
    include_str!("../seeds/shapes.toml"),
    include_str!("../seeds/joints.toml"),
    include_str!("../seeds/stages.toml"),
    include_str!("../seeds/cell.toml"),
];

/// Reads a run's folder with these files in the place of its own.
pub fn run(input: &[u8]) -> bool {
    let parts = bundle::parts(input);
    let named = |name: &str| -> Option<(usize, String)> {
        let (number, file) = name.split_once('/')?;
        let number: usize = number.parse().ok()?;
        runs().get(number)?.contains_key(file).then(|| (number, file.to_string()))
    };
    let Some((number, _)) = parts.first().and_then(|part| named(part.name)) else { return false };
    let given: Files =
        parts.iter().filter_map(|part| Some((named(part.name)?.1, part.content.to_vec()))).collect();
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    for (name, content) in runs()[number].iter() {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap_or(folder.path()))
            .expect("temporary folders can be made");
        std::fs::write(path, given.get(name).unwrap_or(content)).expect("temporary files can be written");
    }
    let frames: Vec<bool> = given
        .keys()
        .filter(|name| name.ends_with(".vtp"))
        .map(|name| read(&folder.path().join(name)))
        .collect();
    replay(folder.path()) && !frames.contains(&false)
}

/// Reads a frame by itself.
fn read(path: &Path) -> bool {
    VtpFile::read(path).is_ok_and(|file| file.cell().is_ok())
}

/// Reads the worlds and the points of all frames; whether all can be read.
fn replay(folder: &Path) -> bool {
    let Ok(run) = RunFolder::open(folder) else { return false };
    let readable = |index: usize| {
        let snapshot = run.snapshot(index).inspect(|snapshot| {
            let mut bytes = Vec::new();
            let written = [
                snapshot.write_lammps(&mut bytes),
                snapshot.write_xyz(&mut bytes),
                snapshot.write_yade(&mut bytes),
            ];
            assert!(written.iter().all(Result::is_ok));
        });
        let world = run.world(index).inspect(|world| {
            world.state_hash();
        });
        world.is_ok() && snapshot.is_ok()
    };
    let frames: Vec<bool> = (0..run.times().len()).map(readable).collect();
    !frames.contains(&false)
}

/// The runs, made when they are first asked for.
fn runs() -> &'static [Files] {
    static RUNS: OnceLock<Vec<Files>> = OnceLock::new();
    RUNS.get_or_init(|| SCENES.iter().map(|text| made(text)).collect())
}

/// Runs a scene for some steps and returns what is needed to replay it.
fn made(text: &str) -> Files {
    let folder = tempfile::tempdir().expect("temporary folders can be made");
    let simulation = scene::simulation(text);
    let mut settings = RunSettings { steps: 6, ..RunSettings::new(&simulation, None) };
    settings.output.every = 6;
    let taken = folder::RunFolder::create(folder.path(), false).expect("the folder is empty");
    let mut recorder =
        Recorder::begin(taken, &settings, &simulation.world, "").expect("the folder can be written");
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Arc::default())
        .expect("settings are sound");
    run.advance(&mut [&mut recorder]).expect("seeds make steps");
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).expect("the folder can be written");
    let mut files = Files::new();
    for inner in ["", "frames", "checkpoints"] {
        let entries = std::fs::read_dir(folder.path().join(inner)).expect("the folder is there");
        for path in entries.map(|entry| entry.expect("the folder can be read").path()) {
            let is_read = path
                .extension()
                .is_some_and(|ending| ["pvd", "vtp", "ckpt"].iter().any(|known| ending == *known));
            if is_read && path.is_file() {
                let name =
                    path.strip_prefix(folder.path()).expect("it is inside").to_string_lossy().into_owned();
                files.insert(name, std::fs::read(&path).expect("the file can be read"));
            }
        }
    }
    files
}

/// Every list and every frame of the runs.
pub fn seeds() -> Vec<Vec<u8>> {
    let own = |(number, files): (usize, &Files)| {
        let texts = files.iter().filter(|(name, _)| !name.ends_with(".ckpt"));
        texts
            .map(|(name, content)| bundle::input([(format!("{number}/{name}").as_str(), &content[..])]))
            .collect::<Vec<_>>()
    };
    runs().iter().enumerate().flat_map(own).collect()
}
