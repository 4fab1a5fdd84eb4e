//! What an interrupted run has lost is reported, what goes on is what would have been, and nothing leads out
//! of its folder.

use graintrain::world::World;
use graintrain_io::checkpoint::{self, Checkpoint};
use graintrain_io::files::OutputError;
use graintrain_io::mark::Loss;
use graintrain_io::output::folder::{PrepareError, RunFolder};
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Ending, Observer, Run, RunSettings, RunTotals, StepView};
use graintrain_io::scene::Scene;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A swinging arm that knocks a ball off the ground, with every table and list that every solver makes.
const SCENE: &str = r#"
[time]
step = "5 ms"
steps = 12
[solver]
tolerance = 1e-6
[output]
every = "10 ms"
checkpoint_every = "5 ms"
[material.steel]
density = 7800
friction = 0.3
[body.ground]
shape = { plane = { normal = [0, 0, 1] } }
motion = "fixed"
[body.ball]
shape = { sphere = { radius = 0.1 } }
position = [0, 0, 0.1]
[body.arm]
shape = { box = { size = [0.5, 0.05, 0.05] } }
position = [0.3, 0, 0.3]
[joint.hinge]
kind = "revolute"
bodies = ["arm"]
point = [0.55, 0, 0.3]
axis = [0, 1, 0]
[measure.all]
energy = true
"#;

/// Makes steps up to this one in a new folder.
fn run(folder: &Path, steps: u64, observers: &mut [&mut dyn Observer]) -> Run {
    let scene = Scene::parse("swing", "swing.toml", SCENE, Path::new(""), &[]).unwrap();
    let simulation = scene.build().unwrap();
    let settings = RunSettings { steps, ..RunSettings::new(&simulation, None) };
    let taken = RunFolder::create(folder, false).unwrap();
    let mut recorder = Recorder::begin(taken, &settings, &simulation.world, "").unwrap();
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), Arc::default()).unwrap();
    let mut all: Vec<&mut dyn Observer> = vec![&mut recorder];
    all.extend(observers.iter_mut().map(|observer| &mut **observer as &mut dyn Observer));
    assert_eq!(run.advance(&mut all).unwrap(), Ending::Finished);
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    run
}

fn saved(folder: &Path) -> Checkpoint {
    let (saved, defects) = checkpoint::latest(&folder.join("checkpoints")).unwrap();
    assert!(defects.is_empty());
    saved
}

/// What is reported when the run in a folder is taken up again.
fn losses(folder: &Path) -> Vec<Loss> {
    let saved = saved(folder);
    let taken = RunFolder::open(folder).unwrap();
    Recorder::resume(taken, &saved.settings, &saved.world, &saved.marks).unwrap().losses()
}

#[test]
fn every_missing_or_damaged_table_and_list_is_reported_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(folder, 6, &mut []);
    let names: Vec<String> = saved(folder).marks.into_keys().collect();
    let all = [
        "all.pvd",
        "bodies.pvd",
        "contacts.pvd",
        "joints.csv",
        "measures/all.csv",
        "steps.csv",
        "surfaces.pvd",
        "wrench.csv",
    ];
    assert_eq!(names, all);
    assert_eq!(losses(folder), []);
    for name in names {
        let path = folder.join(&name);
        let whole = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!(losses(folder), [Loss::Missing(path.clone())]);
        for (ending, length) in [(".bad", whole.len() / 2), (".bad2", whole.len() - 2), (".bad3", 0)] {
            std::fs::write(&path, &whole[..length]).unwrap();
            let bad = folder.join(format!("{name}{ending}"));
            assert_eq!(losses(folder), [Loss::Damaged(bad.clone())], "{length} bytes");
            assert_eq!(std::fs::read(bad).unwrap(), whole[..length]);
            if name.ends_with(".csv") {
                let left = std::fs::read(&path).unwrap();
                let header = whole.iter().position(|&byte| byte == b'\n').unwrap() + 1;
                assert!(left.len() >= header && whole.starts_with(&left), "{name}");
            }
        }
        std::fs::write(&path, &whole).unwrap();
        assert_eq!(losses(folder), []);
    }
}

/// The totals without what clocks say.
fn counted(totals: &RunTotals) -> RunTotals {
    RunTotals {
        wall_seconds: 0.0,
        cpu_seconds: None,
        phases: Default::default(),
        output_seconds: 0.0,
        last_output_seconds: 0.0,
        ..totals.clone()
    }
}

/// Notes what it is shown, and in which order.
#[derive(Default)]
struct Order(Vec<(&'static str, u64)>);

impl Observer for Order {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        self.0.push(("seen", step.world.step));
        Ok(())
    }

    fn keep(&mut self, world: &World, _: &RunTotals) -> Result<(), OutputError> {
        self.0.push(("kept", world.step));
        Ok(())
    }
}

/// A run may be killed after any checkpoint: it has all that belongs to its step, whatever is done about a
/// step beside making it.
#[test]
fn checkpoints_have_all_that_belongs_to_their_step() {
    for steps in [1, 49, 50, 51] {
        let folder = tempfile::tempdir().unwrap();
        let mut order = Order::default();
        let reference = run(folder.path(), steps, &mut [&mut order]);
        let both: Vec<_> = (1..=steps).flat_map(|step| [("seen", step), ("kept", step)]).collect();
        assert_eq!(order.0, both);

        let longer = tempfile::tempdir().unwrap();
        let mut early = KilledAt { step: steps, folder: longer.path(), totals: None };
        run(longer.path(), steps + 3, &mut [&mut early]);
        assert_eq!(early.totals.unwrap(), counted(&reference.totals), "step {steps}");
    }
}

/// Reads the checkpoint that there is once all have kept a step.
struct KilledAt<'a> {
    step: u64,
    folder: &'a Path,
    totals: Option<RunTotals>,
}

impl Observer for KilledAt<'_> {
    fn observe(&mut self, _: StepView<'_>) -> Result<(), OutputError> {
        Ok(())
    }

    fn keep(&mut self, world: &World, _: &RunTotals) -> Result<(), OutputError> {
        if world.step == self.step {
            self.totals = Some(counted(&saved(self.folder).totals));
        }
        Ok(())
    }
}

/// The check sum of a checkpoint says nothing of who wrote it: a name in it that leads out of the folder is
/// refused.
#[test]
fn checkpoints_name_no_files_outside_of_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let run = run(folder.path(), 1, &mut []);
    for name in ["../../EVIL", "/tmp/EVIL", "..", "a/b", "", "a\u{1b}[2J"] {
        let mut settings = run.settings.clone();
        settings.measures[0].name = name.to_string();
        let bytes = checkpoint::to_bytes(&settings, &run.totals, &run.world).unwrap();
        let refused = checkpoint::from_bytes(&bytes, "a").unwrap_err().to_string();
        assert!(
            refused.contains("has a name that is none of a file") && !refused.contains('\u{1b}'),
            "{refused}"
        );
    }
}

#[test]
#[cfg(unix)]
fn folders_that_are_links_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (mine, made) = (folder.path().join("mine"), folder.path().join("made"));
    run(&made, 1, &mut []);
    std::fs::create_dir(&mine).unwrap();
    std::fs::write(mine.join("a.vtp"), "mine").unwrap();
    for inner in ["frames", "checkpoints", "measures", "problems", "plots", ".lock"] {
        let place = made.join(inner);
        let aside = folder.path().join("aside");
        let was_there = std::fs::rename(&place, &aside).is_ok();
        std::os::unix::fs::symlink(&mine, &place).unwrap();
        let refused = RunFolder::open(&made).unwrap_err().to_string();
        assert!(refused.contains("it is a link"), "{refused}");
        assert!(matches!(RunFolder::create(&made, true), Err(PrepareError::Output(_))), "{inner}");
        std::fs::remove_file(&place).unwrap();
        if was_there {
            std::fs::rename(&aside, &place).unwrap();
        }
    }
    assert!(RunFolder::open(&made).is_ok());
    assert_eq!(std::fs::read_dir(&mine).unwrap().count(), 1);
}

/// What a run left that was ended before its first checkpoint is no result; whatever somebody computed is
/// one.
#[test]
fn a_run_that_had_not_begun_leaves_its_folder_free() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    run(folder, 1, &mut []);
    let taken = || RunFolder::create(folder, false);
    assert!(matches!(taken(), Err(PrepareError::Occupied(_))));
    std::fs::remove_dir_all(folder.join("checkpoints")).unwrap();
    assert!(matches!(taken(), Err(PrepareError::Occupied(_))));
    std::fs::remove_file(folder.join("summary.json")).unwrap();
    // Somebody kept the tables of a run alone.
    assert!(matches!(taken(), Err(PrepareError::Occupied(_))));
    let steps = std::fs::read_to_string(folder.join("steps.csv")).unwrap();
    std::fs::write(folder.join("steps.csv"), steps.lines().next().unwrap()).unwrap();
    std::fs::create_dir(folder.join("checkpoints")).unwrap();
    std::fs::write(folder.join("checkpoints/step_00000000.ckpt.part"), "GRAIN").unwrap();
    std::fs::write(folder.join("notes.txt"), "mine").unwrap();
    assert!(matches!(taken(), Err(PrepareError::Occupied(_))));
    std::fs::remove_file(folder.join("notes.txt")).unwrap();
    drop(taken().unwrap());
    assert!(!folder.join("steps.csv").exists());
    run(folder, 1, &mut []);
}

/// A step under way is dropped when the time is up, wherever it is: here in the search for contacts of many
/// bodies in one place.
#[test]
fn a_step_is_stopped_in_the_search_for_contacts() {
    let text = "[time]\nstep = 1e-3\nsteps = 1\n[contact]\nenvelope = 10\n[packing.a]\nradius = 0.1\n\
                lattice = { counts = [100, 100, 1], pitch = 0.3 }\n";
    let scene = Scene::parse("many", "many.toml", text, Path::new(""), &[]).unwrap();
    let simulation = scene.build().unwrap();
    let settings = RunSettings::new(&simulation, None);
    let (stop, before) = (Arc::new(AtomicBool::new(false)), simulation.world.state_hash());
    let mut run = Run::new(simulation.world, settings, RunTotals::default(), stop.clone()).unwrap();
    let start = std::time::Instant::now();
    let timer = std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_millis(50));
        stop.store(true, Ordering::Relaxed);
    });
    assert_eq!(run.advance(&mut []).unwrap(), Ending::Stopped);
    assert!(start.elapsed().as_secs_f64() < 20.0);
    timer.join().unwrap();
    assert_eq!((run.world.step, run.world.state_hash()), (0, before));
}
