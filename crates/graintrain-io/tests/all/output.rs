//! Outputs and checkpoints of hand-made worlds.

use graintrain::assemble::OverlapCorrection;
use graintrain::ccp::newton::NewtonRecord;
use graintrain::ccp::{FrictionModel, Residual, SolveReport, Status};
use graintrain::contact::{Contact, ContactSet};
use graintrain::handle::{BodyId, MaterialId};
use graintrain::material::Materials;
use graintrain::math::{Quat, Vec3};
use graintrain::measure::energy::Ledger;
use graintrain::motion::{Motion, Profile};
use graintrain::shape::{Geometry, Part, Shape, Sphere};
use graintrain::stepper::{PhaseSeconds, PhysicalErrors, SolverChoice, StepReport, StepSettings, Wrench};
use graintrain::world::{Body, World};
use graintrain_io::checkpoint::{self, CheckpointError};
use graintrain_io::output::OutputSettings;
use graintrain_io::output::folder::{PrepareError, RunFolder};
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::{RunStatus, Summary};
use graintrain_io::output::vtp::Precision;
use graintrain_io::run::{Observer, RunSettings, RunTotals, StepView};
use std::path::Path;

/// Two spheres, a dumb-bell, a box and a capsule that move, on a plane, beside a fixed wall and a turning
/// cylinder.
fn world() -> World {
    let mut world =
        World::new(Vec3::new(0.0, 0.0, -9.81), Materials::single("glass", 2500.0, 0.3, 0.0).unwrap())
            .unwrap();
    let fixed = world.add_motion(Motion::fixed()).unwrap();
    let turning = world.add_motion(Motion::rotating(Vec3::ZERO, Vec3::Z, Profile::Constant(2.0))).unwrap();
    let small = world.add_geometry(Geometry::sphere(0.1).unwrap());
    let large = world.add_geometry(Geometry::sphere(0.2).unwrap());
    let end = |x: f64| Part {
        shape: Shape::Sphere(Sphere { radius: 0.1 }),
        position: Vec3::new(x, 0.0, 0.0),
        orientation: Quat::IDENTITY,
    };
    let bell = world.add_geometry(Geometry::compound(vec![end(-0.1), end(0.1)]).unwrap().0);
    let brick = world.add_geometry(Geometry::cuboid(Vec3::new(0.1, 0.2, 0.3)).unwrap());
    let pill = world.add_geometry(Geometry::capsule(0.2, 0.1).unwrap());
    let ground = world.add_geometry(Geometry::plane());
    let wall = world.add_geometry(Geometry::cuboid(Vec3::new(0.05, 1.0, 1.0)).unwrap());
    let drum = world.add_geometry(Geometry::cylinder(0.5, 0.1).unwrap());
    let at = |geometry, x: f64, z: f64| Body::new(geometry, MaterialId::default(), Vec3::new(x, 0.0, z));
    world.add_body(at(small, 0.0, 0.1)).unwrap();
    world.add_body(Body { velocity: Vec3::X, ..at(large, 0.5, 0.2) }).unwrap();
    let quarter = Quat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    world.add_body(Body { orientation: quarter, angular_velocity: Vec3::Z, ..at(bell, 1.0, 0.1) }).unwrap();
    world.add_body(at(brick, 1.5, 0.3)).unwrap();
    world.add_body(at(pill, 2.0, 0.3)).unwrap();
    world.add_body(Body { name: "ground".into(), motion: fixed, ..at(ground, 0.0, 0.0) }).unwrap();
    world.add_body(Body { name: "wall, left".into(), motion: fixed, ..at(wall, -1.0, 1.0) }).unwrap();
    world.add_body(Body { name: "drum".into(), motion: turning, ..at(drum, -0.5, 0.5) }).unwrap();
    world
}

/// Puts the world a step further, as if solved: contacts of the two spheres with the ground and with each
/// other.
fn advance(world: &mut World, settings: &RunSettings) -> StepReport {
    world.step += 1;
    world.time += settings.stepping.step;
    world.bodies.position[1].x += settings.stepping.step;
    let weight = |body: usize| world.bodies.mass[body] * 9.81 * settings.stepping.step;
    let contact = |a: u32, b: u32, point: Vec3, normal: Vec3, gap: f64| Contact {
        body_a: a,
        body_b: b,
        identity: u64::from(a) << 32 | u64::from(b),
        point,
        normal,
        gap,
        lead: Vec3::ZERO,
        image: [0; 3],
    };
    world.contacts = ContactSet {
        contacts: vec![
            contact(0, 5, Vec3::ZERO, Vec3::Z, -1e-5),
            contact(1, 5, Vec3::new(0.5, 0.0, 0.0), Vec3::Z, 0.0),
            contact(0, 1, Vec3::new(0.25, 0.0, 0.15), -Vec3::X, 0.2),
        ],
        impulse: vec![
            Vec3::new(0.0, 0.0, weight(0)),
            Vec3::new(-0.3 * weight(1), 0.0, weight(1)),
            Vec3::ZERO,
        ],
        friction: vec![0.3; 3],
        moment: Vec::new(),
        bounced: Vec::new(),
        curvature: None,
    };
    let residual = Residual { max: 3e-5, rms: 1e-5 };
    let total: f64 = weight(0) + weight(1);
    StepReport {
        contacts: 3,
        contacts_with_force: 2,
        parts: 1,
        solve: SolveReport {
            solver: "apgd".into(),
            status: Status::Converged,
            iterations: 12,
            residual,
            residual_relaxed: residual,
            residual_coulomb: Residual { max: 0.01, rms: 0.001 },
            objective: -1.0,
            seconds: 0.01,
            ..SolveReport::default()
        },
        penetration_max: 1e-5,
        penetration_max_over_size: 1e-4,
        errors: PhysicalErrors {
            approach_max: 2e-6,
            overlap_per_step_max_over_size: 3e-7,
            cone_excess_max: 4e-3,
            slip_angle_max: 5e-2,
            joint_opening_max: 8e-9,
            momentum_lost_max: 2e-3,
        },
        impacts: 3,
        impact_residual: Default::default(),
        restitution_lowered: 1,
        contacts_added: 2,
        contacts_missed: 1,
        contacts_apart: 2,
        impulse_apart_max: 9e-6,
        overlap_corrected_max: 6e-6,
        correction_energy: 7e-5,
        ledger: Ledger { loads: 8e-5, ..Ledger::default() },
        kinetic_energy: world.kinetic_energy(),
        phases: PhaseSeconds { collide: 0.1, assemble: 0.2, solve: 0.3, integrate: 0.4 },
        processor: None,
        wrenches: vec![
            Wrench {
                body: BodyId::from_index(5),
                force: Vec3::new(0.0, 0.0, -total / settings.stepping.step),
                torque: Vec3::ZERO,
            },
            Wrench { body: BodyId::from_index(6), ..Wrench::default() },
            Wrench { body: BodyId::from_index(7), ..Wrench::default() },
        ],
    }
}

fn settings() -> RunSettings {
    RunSettings {
        scene: "hand-made".into(),
        stepping: StepSettings {
            step: 0.025,
            envelope: 0.01,
            overlap: OverlapCorrection::Position,
            solver: SolverChoice {
                name: "apgd".parse().unwrap(),
                tolerance: 1e-4,
                criterion: graintrain::ccp::Criterion::Mixed,
                max_iterations: None,
                friction: FrictionModel::Relaxed,
            },
        },
        steps: 5,
        output: OutputSettings {
            every: 2,
            bodies: true,
            contacts: true,
            precision: Precision::Double,
            checkpoint_every: 1000,
        },
        stages: Vec::new(),
        measures: Vec::new(),
        open_boundaries: Default::default(),
        dump_problem_every: None,
    }
}

fn view<'a>(world: &'a World, report: &'a StepReport, totals: &'a RunTotals) -> StepView<'a> {
    StepView { world, report, totals, measured: &[], problem: None }
}

fn read(folder: &Path, file: &str) -> String {
    std::fs::read_to_string(folder.join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// Runs all steps into the folder and gives the final state.
fn record(folder: &Path) -> (World, RunTotals) {
    let settings = settings();
    let (mut world, totals) = (world(), RunTotals::default());
    let mut recorder =
        Recorder::begin(RunFolder::create(folder, false).unwrap(), &settings, &world, "").unwrap();
    for _ in 0..settings.steps {
        let report = advance(&mut world, &settings);
        recorder.observe(view(&world, &report, &totals)).unwrap();
    }
    recorder.checkpoint(&world, &totals, RunStatus::Finished).unwrap();
    (world, totals)
}

#[test]
fn a_recorded_run_has_all_files() {
    let folder = tempfile::tempdir().unwrap();
    // A folder named by this variable keeps the files, so that other programs can be tried on them.
    let kept = std::env::var_os("GRAINTRAIN_KEEP_OUTPUT").map(std::path::PathBuf::from);
    let folder = kept.as_deref().unwrap_or(folder.path());
    let (world, _) = record(folder);
    // Frames of step 0, of every second step, and of the last one.
    let pvd = read(folder, "bodies.pvd");
    for step in [0, 2, 4, 5] {
        let file = format!("frames/bodies_{step:08}.vtp");
        assert!(pvd.contains(&format!("file=\"{file}\"")), "{pvd}");
        let text = read(folder, &file);
        // Two spheres, two of the dumb-bell, a box and a capsule; neither wall nor drum nor ground.
        assert!(text.contains("NumberOfPoints=\"6\" NumberOfVerts=\"6\""), "{text}");
    }
    assert!(read(folder, "surfaces.pvd").contains("part=\"1\""));
    assert!(read(folder, "frames/contacts_00000005.vtp").contains("NumberOfLines=\"3\""));
    let steps = read(folder, "steps.csv");
    let rows: Vec<Vec<&str>> = steps.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 6);
    assert!(rows.iter().all(|row| row.len() == rows[0].len()), "{steps}");
    let column = |name: &str| rows[0].iter().position(|column| *column == name).expect(name);
    assert_eq!(rows[5][column("step")], "5");
    assert_eq!(rows[5][column("time")].parse::<f64>().unwrap(), world.time);
    assert_eq!(rows[3][column("status")], "converged");
    assert_eq!(rows[3][column("residual")].parse::<f64>().unwrap(), 3e-5);
    assert_eq!(rows[3][column("seconds_integrate")], "0.4");
    assert_eq!(rows[3][column("parts")], "1");
    assert_eq!(rows[3][column("slip_angle")], "0.05");
    assert_eq!(rows[3][column("penetration_over_size")], "0.0001");
    assert_eq!(rows[3][column("correction_energy")], "7e-5");
    assert_eq!(rows[3][column("load_work")], "8e-5");
    let wrench = read(folder, "wrench.csv");
    assert_eq!(wrench.lines().count(), 1 + 5 * 3);
    assert!(wrench.contains(",6,\"wall, left\",0.0,0.0,0.0,"), "{wrench}");
    let summary: Summary = serde_json::from_str(&read(folder, "summary.json")).unwrap();
    assert_eq!((summary.steps, summary.status), (5, RunStatus::Finished));
    assert_eq!(summary.state_hash, format!("{:016x}", world.state_hash()));
}

/// `columns.json` names exactly the columns of every table, in their order, each with a meaning.
#[test]
fn columns_are_explained_beside_the_tables() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, mut world) = (settings(), world());
    let mut recorder =
        Recorder::begin(RunFolder::create(folder.path(), false).unwrap(), &settings, &world, "").unwrap();
    let mut report = advance(&mut world, &settings);
    report.solve.newton.push(NewtonRecord::default());
    recorder.observe(view(&world, &report, &RunTotals::default())).unwrap();
    let columns: serde_json::Value = serde_json::from_str(&read(folder.path(), "columns.json")).unwrap();
    let tables = columns.as_object().unwrap();
    let files = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    let mut files: Vec<String> = files.map(|name| name.into_string().unwrap()).collect();
    files.retain(|name| name.ends_with(".csv"));
    files.sort();
    assert_eq!(files, ["joints.csv", "newton.csv", "steps.csv", "wrench.csv"]);
    assert_eq!(tables.len(), files.len());
    for file in &files {
        let text = read(folder.path(), file);
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let listed = tables[file].as_array().unwrap();
        let names: Vec<&str> = listed.iter().map(|column| column["name"].as_str().unwrap()).collect();
        assert_eq!(names, header, "{file}");
        // This world has no joints.
        if file != "joints.csv" {
            assert_eq!(text.lines().nth(1).unwrap().split(',').count(), header.len(), "{file}");
        }
        assert!(listed.iter().all(|column| column["unit"].is_string() && column["meaning"] != ""));
    }
}

#[test]
fn occupied_folders_are_left_alone_unless_forced() {
    let folder = tempfile::tempdir().unwrap();
    let _ = record(folder.path());
    std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    std::fs::write(folder.path().join("frames/picture.png"), "mine").unwrap();
    assert!(matches!(RunFolder::create(folder.path(), false), Err(PrepareError::Occupied(_))));
    assert!(folder.path().join("steps.csv").exists());
    let _ = RunFolder::create(folder.path(), true).unwrap();
    let left: Vec<_> =
        ["steps.csv", "bodies.pvd", "frames/bodies_00000002.vtp", "checkpoints/step_00000005.ckpt"]
            .into_iter()
            .filter(|file| folder.path().join(file).exists())
            .collect();
    assert!(left.is_empty(), "{left:?}");
    assert_eq!(read(folder.path(), "notes.txt"), "mine");
    assert_eq!(read(folder.path(), "frames/picture.png"), "mine");
}

#[test]
fn outputs_resumed_from_a_checkpoint_are_those_of_an_uninterrupted_run() {
    let (whole, cut) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let _ = record(whole.path());
    let settings = settings();
    let (mut world, totals) = (world(), RunTotals::default());
    let mut recorder =
        Recorder::begin(RunFolder::create(cut.path(), false).unwrap(), &settings, &world, "").unwrap();
    for step in 1..=4 {
        let report = advance(&mut world, &settings);
        recorder.observe(view(&world, &report, &totals)).unwrap();
        if step == 3 {
            recorder.checkpoint(&world, &totals, RunStatus::Running).unwrap();
        }
    }
    drop((recorder, world));
    let (resumed, defects) = checkpoint::latest(&cut.path().join("checkpoints")).unwrap();
    assert!(defects.is_empty());
    assert_eq!((resumed.world.step, &resumed.settings), (3, &settings));
    let mut world = resumed.world;
    let mut recorder =
        Recorder::resume(RunFolder::open(cut.path()).unwrap(), &settings, &world, &resumed.marks).unwrap();
    for _ in 4..=5 {
        let report = advance(&mut world, &settings);
        recorder.observe(view(&world, &report, &totals)).unwrap();
    }
    recorder.checkpoint(&world, &totals, RunStatus::Finished).unwrap();
    for file in ["steps.csv", "wrench.csv", "all.pvd", "bodies.pvd", "surfaces.pvd", "contacts.pvd"] {
        assert_eq!(read(whole.path(), file), read(cut.path(), file), "{file}");
    }
    assert_eq!(
        read(whole.path(), "frames/bodies_00000005.vtp"),
        read(cut.path(), "frames/bodies_00000005.vtp")
    );
}

#[test]
fn damaged_checkpoints_are_reported_and_the_one_before_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let (settings, totals, mut world) = (settings(), RunTotals::default(), world());
    let mut paths = Vec::new();
    for _ in 0..3 {
        let _ = advance(&mut world, &settings);
        paths.push(checkpoint::write(folder.path(), &settings, &totals, &world).unwrap());
    }
    assert!(!paths[0].exists(), "only the last two are kept");
    let read_back = checkpoint::read(&paths[2]).unwrap();
    assert_eq!(read_back.world, world);
    assert_eq!(read_back.world.state_hash(), world.state_hash());
    let whole = std::fs::read(&paths[2]).unwrap();
    for length in [0, 7, 8, 31, 32, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&paths[2], &whole[..length]).unwrap();
        let defect = checkpoint::read(&paths[2]).unwrap_err();
        assert!(matches!(defect, CheckpointError::Truncated { .. }), "{length}: {defect}");
    }
    let (older, defects) = checkpoint::latest(folder.path()).unwrap();
    assert_eq!((older.world.step, defects.len()), (2, 1));
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x10;
        std::fs::write(&paths[2], &damaged).unwrap();
        // The length of the expanded payload only bounds it: a larger one changes nothing.
        if let Ok(read) = checkpoint::read(&paths[2]) {
            assert!((24..32).contains(&at) && read.world == world, "byte {at} was damaged unnoticed");
        }
    }
    std::fs::remove_file(&paths[1]).unwrap();
    std::fs::write(&paths[2], "steps and bodies").unwrap();
    assert!(matches!(checkpoint::latest(folder.path()), Err(CheckpointError::NotACheckpoint { .. })));
    std::fs::remove_file(&paths[2]).unwrap();
    assert!(matches!(checkpoint::latest(folder.path()), Err(CheckpointError::None { .. })));
}
