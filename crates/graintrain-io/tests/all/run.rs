//! Runs that stop, are killed, fail and go on.

use crate::pauses::StopAfter;
use graintrain::assemble::OverlapCorrection;
use graintrain::ccp::{Criterion, FrictionModel};
use graintrain::formula::{Formula, Function, Operation};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::load::{Action, Load};
use graintrain::material::{Materials, TurningResistance};
use graintrain::math::Vec3;
use graintrain::motion::{Motion, Profile};
use graintrain::shape::{Cuboid, Geometry, Shape};
use graintrain::stepper::{SolverChoice, StepSettings};
use graintrain::world::{Body, World};
use graintrain_io::checkpoint;
use graintrain_io::output::OutputSettings;
use graintrain_io::output::folder::RunFolder;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::{RunStatus, Summary};
use graintrain_io::output::vtp::Precision;
use graintrain_io::run::{Ending, Run, RunError, RunSettings, RunTotals};
use graintrain_io::scene::{Scene, setting};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// 27 balls of two sizes and some boxes fall onto a plane and are stirred by a turning bar.
fn world() -> World {
    let mut world =
        World::new(Vec3::new(0.0, 0.0, -9.81), Materials::single("glass", 2500.0, 0.3, 0.0).unwrap())
            .unwrap();
    let glass = MaterialId::default();
    let (rolling, spinning) = (TurningResistance::Ratio(0.05), TurningResistance::Length(1e-3));
    world.materials.set_pair_turning(glass, glass, rolling, spinning).unwrap();
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let turning = world.add_motion(Motion::rotating(Vec3::ZERO, Vec3::Z, Profile::Constant(3.0))).unwrap();
    let ground = world.add_geometry(Geometry::plane());
    let bar = world
        .add_geometry(Geometry::single(Shape::Box(Cuboid { half: Vec3::new(0.5, 0.05, 0.05) })).unwrap());
    let forms = [
        world.add_geometry(Geometry::sphere(0.1).unwrap()),
        world.add_geometry(Geometry::sphere(0.08).unwrap()),
        world.add_geometry(Geometry::cuboid(Vec3::new(0.08, 0.06, 0.05)).unwrap()),
    ];
    world
        .add_body(Body {
            name: "ground".into(),
            motion: fixed,
            ..Body::new(ground, MaterialId::default(), Vec3::ZERO)
        })
        .unwrap();
    let height = Vec3::new(0.0, 0.0, 0.1);
    world
        .add_body(Body {
            name: "bar".into(),
            motion: turning,
            ..Body::new(bar, MaterialId::default(), height)
        })
        .unwrap();
    for k in 0..27_usize {
        let at = |n: usize| 0.22 * (n as f64 - 1.0);
        let shift = 0.013 * ((7 * k) % 5) as f64;
        let centre = Vec3::new(at(k % 3) + shift, at(k / 3 % 3) - shift, 0.5 + at(k / 9));
        world.add_body(Body::new(forms[k % 3], MaterialId::default(), centre)).unwrap();
    }
    let swing = Profile::Sinusoidal { amplitude: 0.5, period: 0.1, phase: 0.0 };
    let rising = Formula::new(vec![Operation::Time, Operation::Function(Function::Sqrt)]).unwrap();
    let acceleration = [swing, Profile::Formula(rising), Profile::Constant(0.0)];
    world.add_load(Load::on_all(Action::Uniform { acceleration })).unwrap();
    let drag = Action::Drag { linear: 0.1, quadratic: 0.1, angular: 1e-4, medium: Vec3::X };
    world.add_load(Load::on(BodyId::from_index(5), drag)).unwrap();
    let falling = Profile::Table { times: vec![0.0, 1.0], values: vec![-9.0, -10.0] };
    world.set_gravity_of_time([Profile::Constant(0.0), Profile::Constant(0.0), falling]).unwrap();
    world
}

fn settings(steps: u64) -> RunSettings {
    RunSettings {
        scene: "stirred".into(),
        stepping: StepSettings {
            step: 0.01,
            envelope: 0.02,
            overlap: OverlapCorrection::Position,
            solver: SolverChoice {
                name: "apgd".parse().unwrap(),
                tolerance: 1e-5,
                criterion: Criterion::Maximum,
                max_iterations: None,
                friction: FrictionModel::Relaxed,
            },
        },
        steps,
        output: OutputSettings {
            every: 4,
            bodies: true,
            contacts: true,
            precision: Precision::Double,
            checkpoint_every: 7,
        },
        stages: Vec::new(),
        measures: Vec::new(),
        open_boundaries: Default::default(),
        dump_problem_every: None,
    }
}

/// With a tolerance and an iteration limit.
fn with_limits(tolerance: f64, max_iterations: usize, steps: u64) -> RunSettings {
    let mut settings = settings(steps);
    settings.stepping.solver.tolerance = tolerance;
    settings.stepping.solver.max_iterations = Some(max_iterations);
    settings
}

fn never() -> Arc<AtomicBool> {
    Arc::new(AtomicBool::new(false))
}

/// Runs `steps` steps into the folder without an interruption.
fn run_whole(folder: &Path, settings: &RunSettings) -> Run {
    let mut recorder =
        Recorder::begin(RunFolder::create(folder, false).unwrap(), settings, &world(), "").unwrap();
    let mut run = Run::new(world(), settings.clone(), RunTotals::default(), never()).unwrap();
    assert_eq!(run.advance(&mut [&mut recorder]).unwrap(), Ending::Finished);
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    run
}

fn resume(folder: &Path) -> Run {
    let taken = RunFolder::open(folder).unwrap();
    let (checkpoint, defects) = checkpoint::latest(&folder.join("checkpoints")).unwrap();
    assert!(defects.is_empty());
    let mut recorder =
        Recorder::resume(taken, &checkpoint.settings, &checkpoint.world, &checkpoint.marks).unwrap();
    let mut run = Run::new(checkpoint.world, checkpoint.settings, checkpoint.totals, never()).unwrap();
    assert_eq!(run.advance(&mut [&mut recorder]).unwrap(), Ending::Finished);
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Finished).unwrap();
    run
}

fn read(folder: &Path, file: &str) -> String {
    std::fs::read_to_string(folder.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The table without its columns of seconds, which differ from run to run.
fn without_seconds(table: &str) -> Vec<String> {
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let kept: Vec<usize> = (0..header.len()).filter(|&k| !header[k].starts_with("seconds")).collect();
    assert!(kept.len() < header.len());
    table
        .lines()
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            kept.iter().map(|&k| fields[k]).collect::<Vec<_>>().join(",")
        })
        .collect()
}

fn assert_same_outputs(whole: &Path, other: &Path, last_step: u64) {
    for file in ["wrench.csv", "all.pvd", "bodies.pvd", "contacts.pvd", "surfaces.pvd"] {
        assert_eq!(read(whole, file), read(other, file), "{file}");
    }
    for kind in ["bodies", "contacts", "surfaces"] {
        let file = format!("frames/{kind}_{last_step:08}.vtp");
        assert_eq!(read(whole, &file), read(other, &file), "{file}");
    }
    assert_eq!(without_seconds(&read(whole, "steps.csv")), without_seconds(&read(other, "steps.csv")));
    let hash = |folder| serde_json::from_str::<Summary>(&read(folder, "summary.json")).unwrap().state_hash;
    assert_eq!(hash(whole), hash(other));
}

#[test]
fn a_stopped_run_goes_on_to_the_same_bits() {
    let (whole, stopped) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let settings = settings(40);
    let reference = run_whole(whole.path(), &settings);
    assert!(reference.totals.figures.contacts_max > 20, "{:?}", reference.totals);
    assert_eq!(reference.totals.figures.unconverged_steps, 0);

    let stop = never();
    let mut recorder =
        Recorder::begin(RunFolder::create(stopped.path(), false).unwrap(), &settings, &world(), "").unwrap();
    let mut run = Run::new(world(), settings.clone(), RunTotals::default(), stop.clone()).unwrap();
    let ending = run.advance(&mut [&mut recorder, &mut StopAfter(23, stop)]).unwrap();
    assert_eq!((ending, run.world.step), (Ending::Stopped, 23));
    recorder.checkpoint(&run.world, &run.totals, RunStatus::Stopped).unwrap();
    drop((run, recorder));

    let resumed = resume(stopped.path());
    assert_eq!(resumed.world, reference.world);
    assert_eq!(resumed.world.state_hash(), reference.world.state_hash());
    assert_eq!(resumed.totals.figures.contacts_mean, reference.totals.figures.contacts_mean);
    assert_same_outputs(whole.path(), stopped.path(), 40);
}

#[test]
fn a_killed_run_goes_on_from_its_last_checkpoint() {
    let (whole, killed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let settings = settings(30);
    let reference = run_whole(whole.path(), &settings);

    let stop = never();
    let mut recorder =
        Recorder::begin(RunFolder::create(killed.path(), false).unwrap(), &settings, &world(), "").unwrap();
    let mut run = Run::new(world(), settings.clone(), RunTotals::default(), stop.clone()).unwrap();
    let _ = run.advance(&mut [&mut recorder, &mut StopAfter(26, stop)]).unwrap();
    // No last checkpoint: the process is gone. The one of step 21 remains, and records of steps 22 to 26
    // after it.
    drop((run, recorder));
    assert_eq!(read(killed.path(), "steps.csv").lines().count(), 27);

    let resumed = resume(killed.path());
    assert_eq!(resumed.world.state_hash(), reference.world.state_hash());
    assert_same_outputs(whole.path(), killed.path(), 30);
}

#[test]
fn a_solve_that_is_stopped_leaves_the_state_as_it_was() {
    let stop = never();
    // Nothing reaches a residual of 1e-300: the solve goes on until the flag is set.
    let settings = with_limits(1e-300, usize::MAX, 1_000_000);
    let mut run = Run::new(world(), settings, RunTotals::default(), stop.clone()).unwrap();
    let handle = std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_millis(300));
        stop.store(true, Ordering::Relaxed);
    });
    assert_eq!(run.advance(&mut []).unwrap(), Ending::Stopped);
    handle.join().unwrap();
    let mut again = Run::new(
        world(),
        RunSettings { steps: run.world.step, ..run.settings.clone() },
        RunTotals::default(),
        never(),
    )
    .unwrap();
    assert_eq!(again.advance(&mut []).unwrap(), Ending::Finished);
    assert_eq!(again.world.state_hash(), run.world.state_hash());
}

#[test]
fn strict_runs_end_where_a_solve_misses_its_tolerance() {
    let settings = with_limits(1e-12, 3, 60);
    let mut run = Run::new(world(), settings.clone(), RunTotals::default(), never()).unwrap();
    assert_eq!(run.advance(&mut []).unwrap(), Ending::Finished);
    assert!(run.totals.figures.unconverged_steps > 0);

    let mut run = Run::new(world(), settings, RunTotals::default(), never()).unwrap();
    run.strict = true;
    match run.advance(&mut []) {
        Err(RunError::NotConverged { step, residual, .. }) => {
            assert_eq!(step, run.world.step);
            assert!(residual > 1e-12);
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(run.totals.figures.unconverged_steps, 1);
}

#[test]
fn a_step_that_fails_keeps_the_state_before_it() {
    let mut run = Run::new(world(), settings(10), RunTotals::default(), never()).unwrap();
    run.world.bodies.velocity[5] = Vec3::new(0.0, 1e308, 0.0);
    run.world.bodies.velocity[6] = Vec3::new(0.0, f64::NAN, 0.0);
    let before = run.world.state_hash();
    assert!(matches!(run.advance(&mut []), Err(RunError::Step(_))));
    assert_eq!(run.world.state_hash(), before);
}

/// A packing that is large enough to be begun in single precision, with a curvature remembered from step to
/// step: a run that goes on from a checkpoint, with any number of threads, has the bits of an uninterrupted
/// one.
#[test]
fn what_a_solver_remembers_is_in_the_checkpoint() {
    for friction in [FrictionModel::Relaxed, FrictionModel::Coulomb] {
        let simulation = Scene::load("sedimentation", &[setting("n=4").unwrap()]).unwrap().build().unwrap();
        let settings = |steps| {
            let mut all = RunSettings { steps, ..RunSettings::new(&simulation, None) };
            all.stepping.solver.friction = friction;
            all.stepping.solver.tolerance = 1e-2;
            all
        };
        let on = |threads: usize, world: World, steps: u64| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut run = Run::new(world, settings(steps), RunTotals::default(), never()).unwrap();
                assert_eq!(run.advance(&mut []).unwrap(), Ending::Finished);
                run.world
            })
        };
        let whole = on(1, simulation.world.clone(), 48);
        // Exact friction begins with sweeps, which meet no curvature.
        assert!(friction == FrictionModel::Coulomb || whole.contacts.curvature.is_some());
        let half = on(2, simulation.world.clone(), 36);
        let bytes = checkpoint::to_bytes(&settings(36), &RunTotals::default(), &half).unwrap();
        let kept = checkpoint::from_bytes(&bytes, "half").unwrap().world;
        for threads in [1, 2, 3, 4] {
            let resumed = on(threads, kept.clone(), 48);
            assert_eq!(resumed.state_hash(), whole.state_hash(), "{friction:?}, {threads} threads");
            assert_eq!(resumed.contacts, whole.contacts);
        }
    }
}
